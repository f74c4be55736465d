"""Files of results: tidy CSV, the rows of a unit of work appended as soon as known.

A unit is identified by its key. Its rows are whole lines, written at once, of one date
and with their number in each, so that whatever an interruption left of them is known
and ignored. The last complete group of a key counts.
"""

import csv
import time
from io import StringIO
from pathlib import Path

import pandas as pd

RESULTS = Path(__file__).resolve().parents[1] / "results"
SCORES = ("nmse_interpolation", "nmse_extrapolation")
FIT = ("log_marginal_likelihood", "n_iter", "n_evaluations", "fit_seconds")
KEYS = {
    "table2": ("n_per_load", "joint", "load", "model"),
    "figure4": ("n", "draw", "joint", "model"),
    "learning": ("n", "draw", "joint", "rank", "learning"),
    "novel_task": ("n", "draw", "joint", "model"),
}
COLUMNS = {
    "table2": (*FIT, *SCORES),
    "figure4": ("rank", "n_hyperparameters", *FIT, *SCORES),
    "learning": (*FIT, *SCORES),
    "novel_task": ("rank", "n_new", "n_hyperparameters", *FIT, *SCORES),
}
OF_UNIT = ("seconds", "warned", "error", "unit_rows", "date")
TEXT = ("model", "learning", "warned", "error", "date")


def header(name):
    """Columns of an experiment's file."""
    return (*KEYS[name], *COLUMNS[name], *OF_UNIT)


def read(name, folder=RESULTS):
    """All rows of complete units, failed ones included; empty without a file."""
    path = Path(folder) / f"{name}.csv"
    text = path.read_text() if path.exists() else ""
    text = _whole_lines(text) or ",".join(header(name)) + "\n"
    found = tuple(text[: text.index("\n")].split(","))
    if found != header(name):
        raise ValueError(
            f"{path.name} has the columns {found}, not {header(name)}: it was written "
            "by another version. Move it away."
        )
    types = dict.fromkeys(TEXT, str)
    rows = pd.read_csv(StringIO(text), float_precision="round_trip", dtype=types)
    rows = rows.fillna(dict.fromkeys(TEXT, ""))
    return _complete(rows, list(KEYS[name]))


def measured(rows):
    """The rows of units that did not fail."""
    return rows[rows["error"] == ""].reset_index(drop=True)


def failed(rows):
    """The rows that say why a unit has none."""
    return rows[rows["error"] != ""].reset_index(drop=True)


def _whole_lines(text):
    return text[: text.rfind("\n") + 1]


def _complete(rows, key):
    """Rows of the last complete group of each key, in the order of the file."""
    if rows.empty:
        return rows
    written = rows.groupby([*key, "date"])["unit_rows"].transform("size")
    rows = rows[written == rows["unit_rows"]]
    last = rows.groupby(key)["date"].transform("last")
    return rows[rows["date"] == last].reset_index(drop=True)


class Table:
    """The file of an experiment, to append to.

    Parameters
    ----------
    name : str
        Of the experiment.
    folder : Path
        Where its file is.
    """

    def __init__(self, name, folder=RESULTS):
        self.name, self.folder = name, Path(folder)
        self.path = self.folder / f"{name}.csv"
        self._cut_half_line()
        rows = read(name, folder)
        self.done = set(map(self.key, measured(rows).to_dict("records")))
        self.failed = set(map(self.key, failed(rows).to_dict("records")))

    def key(self, unit):
        """What identifies a unit."""
        return tuple(unit[name] for name in KEYS[self.name])

    def append(self, unit, rows):
        """Write the rows of a unit, all at once."""
        date = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())
        common = {"unit_rows": len(rows), "date": date}
        text = "".join(self._line({**unit, **row, **common}) for row in rows)
        self.folder.mkdir(parents=True, exist_ok=True)
        if not self.path.exists() or not self.path.stat().st_size:
            text = ",".join(header(self.name)) + "\n" + text
        with self.path.open("ab", buffering=0) as file:
            file.write(text.encode())

    def _line(self, row):
        line = StringIO()
        values = [row.get(name) for name in header(self.name)]
        csv.writer(line, lineterminator="\n").writerow(values)
        return line.getvalue()

    def _cut_half_line(self):
        if self.path.exists():
            data = self.path.read_bytes()
            with self.path.open("rb+") as file:
                file.truncate(data.rfind(b"\n") + 1)
