"""Section 3.3: a new load joins."""

import numpy as np
import pandas as pd
from measuring import plan
from measuring.criteria import bic

from .goals import judge
from .markdown import MISSING, image, made_by, number
from .summaries import geometric_mean, grid, select

MODELS = ("add_task", "sGP", "refit")
NAMES = {
    "add_task": "add_task: only the new row and column",
    "sGP": "sGP: the new load alone",
    "refit": "refit: all loads again",
}
SAMPLES, FACTOR, SECONDS = 20, 10.0, 0.5
TEXT = """\
A model has learned the loads c1 to c14 (n = 280, rank by BIC over the six joints). Then
it gets a few samples of c15, which is heavier than all of them. `add_task` learns only
the new row and column of the task covariance, as section 3.3 of the paper proposes
without an experiment. We compare it with a Gaussian process of the new samples alone
(sGP), and with learning all 15 loads again at the same rank.
"""


def ranks(rows):
    """The common rank of each (n, draw) of which all joints are there."""
    rows = select(rows, model="add_task", n_new=0)
    found = {}
    for n, draw in sorted(set(zip(rows["n"], rows["draw"], strict=True))):
        criterion = bic(select(rows, n=n, draw=draw), n, plan.JOINTS)
        if len(criterion):
            found[n, draw] = int(criterion.idxmin())
    return found


def at_rank(rows):
    """Rows with samples of the new load, `add_task` at the common rank alone."""
    parts = [rows[rows["model"] != "add_task"]]
    for (n, draw), rank in ranks(rows).items():
        parts.append(select(rows, n=n, draw=draw, model="add_task", rank=rank))
    rows = pd.concat(parts, ignore_index=True)
    return rows[rows["n_new"] > 0]


def factors(rows):
    """Error of sGP over that of add_task in extrapolation, by joint and samples."""
    wide = at_rank(rows).pivot_table(
        index=["n", "joint", "n_new", "draw"],
        columns="model",
        values="nmse_extrapolation",
    )
    wide = wide.reindex(columns=["sGP", "add_task"]).dropna()
    ratios = wide["sGP"] / wide["add_task"]
    groups = ratios.groupby(["joint", "n_new"])
    return groups.agg([geometric_mean, "size"]).set_axis(["factor", "draws"], axis=1)


def section(rows):
    """The section of the page."""
    text = ["## A novel task\n", TEXT, made_by("novel_task")]
    found = at_rank(rows)
    if len(found):
        text += [image("paper-novel-task.png", "nMSE of the new load")]
    chosen = [f"{rank} (draw {draw})" for (_, draw), rank in ranks(rows).items()]
    text += [f"Rank: {', '.join(chosen) or MISSING}.\n"]
    text += ["nMSE of sGP in extrapolation, divided by that of add_task:\n"]
    text += [factors_table(factors(rows)), "Median seconds for a joint:\n"]
    return [*text, seconds_table(found)]


def samples_of(found):
    """Numbers of samples, the paper's and others."""
    there = found.index.unique("n_new") if len(found) else ()
    return {k: str(k) for k in sorted({*plan.NEW_SAMPLES, *there})}


def factors_table(found):
    """A line for each joint, a column for each number of samples."""

    def cell(joint, n_new):
        return number(found["factor"].get((joint, n_new)), 2)

    joints = {joint: f"joint {joint}" for joint in plan.JOINTS}
    return grid(joints, samples_of(found), cell, "samples of c15")


def seconds_table(found):
    """Medians over joints and draws."""
    medians = found.groupby(["model", "n_new"])["fit_seconds"].median()

    def cell(model, n_new):
        return number(medians.get((model, n_new)), 2)

    return grid(NAMES, samples_of(medians), cell, "samples of c15")


def goals(rows):
    """What is to be reached."""
    rows = rows[rows["n"] == plan.SMALL_N]
    return [_factor(factors(rows)), _seconds(at_rank(rows))]


def _factor(found):
    text = f"`add_task` with {SAMPLES} samples of c15 beats sGP on them by a factor of "
    text += f"{FACTOR:g} or more in extrapolation at joints 2 to 6"
    keys = [(joint, SAMPLES) for joint in plan.JOINTS[1:]]
    there = found[found.index.isin(keys)]
    measured = ""
    if len(there):
        joint, _ = there["factor"].idxmin()
        measured = f"factor at least {number(there['factor'].min(), 2)} (joint {joint})"
    complete = len(there) == len(keys) and (there["draws"] >= len(plan.DRAWS)).all()
    return judge(text, measured, (there["factor"] >= FACTOR).all(), complete)


def _seconds(rows):
    text = f"`add_task` takes well under a second a joint at n = {plan.SMALL_N} (the "
    text += f"median of each joint at most {SECONDS:g} s)"
    rows = select(rows, model="add_task", n_new=SAMPLES)
    medians = rows.groupby("joint")["fit_seconds"].median()
    measured = ""
    if len(medians):
        measured = f"{number(medians.max(), 2)} s (joint {medians.idxmax()})"
    complete = np.isin(plan.JOINTS, medians.index).all()
    return judge(text, measured, (medians <= SECONDS).all(), complete)
