"""What the README shows runs, and the files that it links to exist."""

import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import ConvergenceWarning

from skmtgp.datasets import make_sites
from skmtgp.exceptions import UnidentifiedNoiseWarning

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"

pytestmark = pytest.mark.skipif(not README.is_file(), reason="only in a checkout")


@pytest.fixture
def text():
    return README.read_text("utf-8")


@pytest.fixture
def blocks(text):
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.fixture
def sites():
    """A frame with a site, and one target for each row."""
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"x": rng.uniform(0, 6, 50), "site": list("abcde") * 10})
    scale = frame["site"].map({"a": 1.0, "b": -2.0, "c": 0.5, "d": 1.5, "e": 3.0})
    return frame, scale * np.sin(frame["x"]) + 0.1 * rng.standard_normal(50)


def test_the_first_lines(blocks, capsys):
    names = {}
    exec(blocks[0], names)
    assert len(blocks[0].split("\n")) <= 9
    assert names["mean"].shape == names["std"].shape == (73,)
    assert "hill" in capsys.readouterr().out


def test_errors_of_the_sites(text):
    sys.path.insert(0, str(ROOT / "examples"))
    example = pytest.importorskip("sites")
    sys.path.pop(0)
    X, y, truth = make_sites(return_truth=True)
    with pytest.warns(UnidentifiedNoiseWarning):
        models = example.fitted(X, y)
    found = example.errors(models, list(X["site"].unique()), truth)
    rows = re.findall(r"\| (?:one model of all|a model of each) sites? \|(.*)\|", text)
    printed = np.array([row.split("|") for row in rows], dtype=float)
    np.testing.assert_allclose(found.T, printed, atol=0.02)


def test_the_robot(blocks, capsys):
    exec(blocks[3], {})
    *_, alone, together = re.findall(r"\) (\S+)$", capsys.readouterr().out, re.M)
    assert 0.0 < float(together) < 0.1 * float(alone)


def test_data_of_your_own(blocks, sites):
    (frame, y), second = sites, blocks[1]
    new = frame["site"] == "e"
    names = {
        "frame": frame[~new],
        "y": y[~new],
        "new_frame": frame[~new][:4],
        "few_rows_of_a_new_site": frame[new],
        "few_targets": y[new],
    }
    exec(second, names)
    assert names["mean"].shape == names["std"].shape == (4,)
    assert (names["lower"] < names["upper"]).all()
    assert names["model"].tasks_.tolist() == list("abcde")
    assert names["search"].best_estimator_.tasks_.tolist() == list("abcd")


def test_a_table_with_gaps_and_text(blocks):
    rng = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "site": np.repeat(["a", "b", "c"], [25, 12, 2]),
            "temperature": rng.uniform(0, 6, 39),
            "humidity": rng.uniform(0, 1, 39),
            "operator": rng.choice(["ann", "bob"], 39),
        }
    )
    y = np.sin(table["temperature"]) * table["site"].map({"a": 1, "b": 1e3, "c": 2})
    y += 0.1 * rng.standard_normal(39) * table["site"].map({"a": 1, "b": 1e3, "c": 1})
    table.loc[::7, "humidity"] = np.nan
    names = {"table": table, "y": y, "new_table": table[:4]}
    quick = 'rank=1, max_iter=3, learning="staged", noise="shared", '
    code = blocks[2].replace("GPRegressor(", f"GPRegressor({quick}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        exec(code, names)
    assert (names["lower"] < names["upper"]).all()
    assert np.isfinite(names["search"].cv_results_["mean_test_score"]).all()
    assert names["search"].best_estimator_[-1].tasks_.tolist() == ["a", "b", "c"]


def test_folds_have_the_tasks_of_the_model(text):
    (advice,) = re.findall(r"`cv=TaskStratifiedKFold\((.*?)\)`", text)
    assert advice == re.search(r'task_feature="\w+"', text)[0]


def test_links(text):
    paths = [p for p in re.findall(r"\]\(([^)]+)\)", text) if "://" not in p]
    missing = [path for path in paths if not (ROOT / path.split("#")[0]).exists()]
    assert paths
    assert not missing
