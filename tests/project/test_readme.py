"""What the README shows runs, and the files that it links to exist."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

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
    return frame, scale * np.sin(frame["x"])


def test_ten_lines(blocks, capsys):
    first, _ = blocks
    exec(first, {})
    *_, alone, together = re.findall(r"\) (\S+)$", capsys.readouterr().out, re.M)
    assert 0.0 < float(together) < 0.1 * float(alone)


def test_data_of_your_own(blocks, sites):
    (frame, y), (_, second) = sites, blocks
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
    assert names["model"].tasks_.tolist() == list("abcde")
    assert names["search"].best_estimator_.tasks_.tolist() == list("abcd")


def test_folds_have_the_tasks_of_the_model(text):
    (advice,) = re.findall(r"`cv=TaskStratifiedKFold\((.*?)\)`", text)
    assert advice == re.search(r'task_feature="\w+"', text)[0]


def test_links(text):
    paths = [p for p in re.findall(r"\]\(([^)]+)\)", text) if "://" not in p]
    missing = [path for path in paths if not (ROOT / path.split("#")[0]).exists()]
    assert paths
    assert not missing
