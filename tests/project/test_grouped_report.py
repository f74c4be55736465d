"""The report of grouped.py compares the same fits, whatever a file lacks."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
grouped_report = pytest.importorskip("grouped_report")
sys.path.pop(0)

DEFAULT, SEARCH = grouped_report.FITTED
SHIPPED, TOLD = grouped_report.AS_SHIPPED, grouped_report.TOLD
CHOSE = {
    "rank": "1",
    "shared": "False",
    "diagonal": "False",
    "noise": "shared",
    "normalize_y": "shared",
}


def fit(name, model, cover, *, settings=SHIPPED, told=False, rmse=1.0, **more):
    """A row of the file."""
    row = {"set": name, "split": "random0", "model": model, "settings": settings}
    row |= {"n": 50, "groups": 5, "inputs": 1, "deviation": 1.0, "seconds": 2.0}
    row |= {"rmse": rmse, "log_loss": 0.5, "coverage": cover, "chose": CHOSE}
    return row | {"warnings": {TOLD: 1} if told else {}} | more


def test_rows_are_beside_the_default_in_the_same_sets():
    auto = {"settings": "hyperparameters=auto", "rmse": 0.5, "seconds": 20.0}
    rows = [
        fit("a", DEFAULT, 0.7, told=True),
        fit("b", DEFAULT, 0.8, told=True),
        fit("c", DEFAULT, 0.95),
        fit("a", DEFAULT, 0.9, **auto),
        fit("c", SEARCH, 0.9),
    ]
    frame = grouped_report.pd.DataFrame(rows).assign(over=0.5)
    table = grouped_report.by_word(frame).set_index(["", "model", "settings"])
    of_auto = table.loc[("told", DEFAULT, "hyperparameters=auto")]
    assert of_auto["fits"] == 1
    assert of_auto["cover"] == 0.9
    assert of_auto["cover, default"] == 0.7  # of a alone
    assert of_auto["ratio"] == pytest.approx(0.5)
    assert of_auto["times"] == pytest.approx(10.0)
    assert table.loc[("told", DEFAULT, SHIPPED), "cover"] == pytest.approx(0.75)
    assert table.loc[("not told", SEARCH, SHIPPED), "cover, default"] == 0.95


@pytest.mark.parametrize(
    "row",
    [
        fit("a", SEARCH, 0.9),
        fit("a", DEFAULT, 0.9, settings="rank=1"),
        fit("a", DEFAULT, None, rmse=None, log_loss=None, chose=None, failed="late"),
    ],
    ids=["search", "other settings", "failed"],
)
def test_files_without_fits_of_the_default_are_reported(row, capsys):
    grouped_report.report([row], SHIPPED)
    printed = capsys.readouterr().out
    assert row["model"] in printed
    assert f"{TOLD}, and" not in printed
