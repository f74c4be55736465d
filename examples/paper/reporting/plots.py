"""The plots of the page, in the colours that every model has in the project."""

import sys
from functools import partial
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter
from measuring import plan

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    SingleTaskGP,
)
from skmtgp.inspection import COLORS as PALETTE
from skmtgp.inspection import color_of

sys.path.append(str(Path(__file__).parents[3] / "docs"))
import stacked

from . import figure4, learning, novel_task, overview, published, table2
from .markdown import MISSING
from .summaries import geometric_mean

OURS = color_of(MultiTaskGPRegressor())
COLORS = {
    "LR": color_of(BayesianLinearRegression()),
    "sGP": color_of(SingleTaskGP()),
    "iGP": color_of(IndependentGP()),
    "pGP": color_of(PooledGP()),
    "mGP-BIC": OURS,
    "add_task": OURS,
    "refit": PALETTE[2],
    "annealed": OURS,
    "staged": PALETTE[0],
    "simultaneous": PALETTE[5],
}
MARKERS = {"LR": "x", "sGP": "s", "iGP": "D", "pGP": "^", "refit": "D", "staged": "s"}
MARKERS["simultaneous"] = "^"
X_LABELS = {"n": "n", "n_new": "samples of c15"}
save = partial(stacked.save, dpi=180)
WIDE = ("mGP-BIC", "add_task", "annealed")


def draw(rows, folder):
    """Write all plots for which there are rows.

    Parameters
    ----------
    rows : dict of str to DataFrame
        Of each experiment.
    folder : Path
        Where the images go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    averages = table2.averages(rows["table2"])
    if len(averages):
        save(samples(averages), folder / "paper-table2.png")
    errors = figure4.errors(rows["figure4"])
    if len(errors):
        save(overview_joints(errors), folder / "paper-figure4.png")
    for subset in plan.TEST_SETS if len(errors) else ():
        save(joints(errors, subset), folder / f"paper-figure4-{subset}.png")
    found = learning.compared(rows["learning"])
    if len(found):
        save(learners(found), folder / "paper-learning.png")
    found = novel_task.at_rank(rows["novel_task"])
    if len(found):
        save(novel(found), folder / "paper-novel-task.png")


def samples(averages):
    """LR and sGP against samples of a load, joint 3 and the paper's numbers."""
    figure, axes = plt.subplots(
        1, 2, figsize=(10, 4.6), layout="constrained", sharey=True
    )
    for ax, subset in zip(axes, plan.TEST_SETS, strict=True):
        for (model, joint), means in averages.groupby(["model", "joint"]):
            y = means[f"nmse_{subset}"].droplevel(["model", "joint"])
            ax.plot(y.index, y, color=COLORS[model], **sample_style(model, joint))
        mark_printed(ax, subset)
        ax.set_title(subset.capitalize())
        log_axes(ax, sorted(averages.index.unique("n_per_load")), "samples of a load")
    axes[0].set_ylabel("nMSE, averaged over 15 loads")
    legend(figure, axes.flat)
    return figure


def sample_style(model, joint):
    """The printed joint stands out."""
    if joint == plan.TABLE2_JOINT:
        return {"lw": 2.4, "marker": "o", "ms": 6, "label": f"{model}, joint {joint}"}
    return {"lw": 0.9, "alpha": 0.6, "label": f"{model}, other joints"}


def mark_printed(ax, subset):
    """The paper's numbers of joint 3."""
    for model, marker in (("LR", "P"), ("sGP", "*")):
        values = published.TABLE2[model, subset]
        if values:
            style = {"ls": "", "ms": 13, "mfc": "none", "color": COLORS["mGP-BIC"]}
            name = f"{model}, joint 3, in the paper"
            ax.plot(values.keys(), values.values(), marker, label=name, **style)


def joints(errors, subset):
    """Figure 4: error against n, a panel for each joint."""
    title = f"{subset.capitalize()}: error of the torques against n"
    column, models = f"nmse_{subset}", figure4.MODELS
    return panels(errors, "n", column, models, title, "nMSE, averaged over 14 loads")


def overview_joints(errors):
    """The paper's two joints, to be read on a phone."""
    ticks = sorted(errors["n"].unique())
    with plt.rc_context({"font.size": 11, "axes.titlesize": 11}):
        figure, axes = plt.subplots(
            2, 1, figsize=(5.2, 6.6), layout="constrained", sharex=True
        )
        for joint, ax in zip(overview.PAPER_JOINTS, axes, strict=True):
            of_joint = errors[errors["joint"] == joint]
            for model in figure4.MODELS:
                of_model = of_joint[of_joint["model"] == model]
                line(ax, of_model, "n", "nmse_extrapolation", model, ticks)
            log_axes(ax, ticks, "samples of all 14 loads")
            ax.set(title=f"joint {joint}", ylabel="nMSE on new motions")
        axes[0].set_xlabel("")
        handles = axes[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def novel(found):
    """Error on the new load against its samples, a panel for each joint."""
    title = "Extrapolation: error of c15 against its samples"
    column, models = "nmse_extrapolation", novel_task.MODELS
    return panels(found, "n_new", column, models, title, "nMSE of c15")


def panels(rows, x, y, models, title, label):
    """A panel for each joint, a line for each model."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 7), layout="constrained")
    figure.suptitle(title)
    ticks, name = sorted(rows[x].unique()), X_LABELS[x]
    for joint, ax in zip(plan.JOINTS, axes.flat, strict=True):
        of_joint = rows[rows["joint"] == joint]
        for model in models:
            line(ax, of_joint[of_joint["model"] == model], x, y, model, ticks)
        ax.set_title(f"joint {joint}" + (f": {MISSING}" if of_joint.empty else ""))
        if len(of_joint):
            log_axes(ax, ticks, name)
    for ax in axes[:, 0]:
        ax.set_ylabel(label)
    legend(figure, axes.flat)
    return figure


def line(ax, rows, x, y, name, ticks):
    """Geometric means over draws, with gaps, and the draws as faint dots."""
    if rows.empty:
        return
    color, wide = COLORS[name], name in WIDE
    style = {"color": color, "marker": MARKERS.get(name, "o"), "ms": 5}
    if name == "refit":  # mostly on the line of add_task: a rim around its dots
        style |= {"ms": 10, "mfc": "none"}
    means = rows.groupby(x)[y].agg(geometric_mean).reindex(ticks)
    width = 2.4 if wide else 1.5
    ax.plot(means.index, means, lw=width, label=name, zorder=3 if wide else 2, **style)
    several = rows[rows.groupby(x)[y].transform("size") > 1]
    style |= {"ls": "", "ms": 4, "alpha": 0.35, "mew": 0}
    ax.plot(several[x], several[y], **style)


def learners(found):
    """Likelihood below the best, evaluations and error of each way to learn."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
    titles = {
        "deficit": "Log likelihood below the best, nats",
        "n_evaluations": "Evaluations of the likelihood",
        "nmse_extrapolation": "nMSE in extrapolation",
    }
    for ax, (column, title) in zip(axes, titles.items(), strict=True):
        for name in plan.LEARNERS:
            dots(ax, found[found["learning"] == name], column, name)
        ax.set(yscale="log", title=title, xlabel="joint")
        ax.set_xticks(sorted(found["joint"].unique()))
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_yscale("symlog", linthresh=0.1)
    axes[0].set_ylim(bottom=-0.02)
    axes[1].yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[1].yaxis.set_major_formatter("{x:.0f}")
    axes[1].yaxis.set_minor_formatter(NullFormatter())
    legend(figure, axes.flat)
    return figure


def dots(ax, rows, column, name):
    """A dot for each fit, side by side."""
    shift = 0.24 * (plan.LEARNERS.index(name) - 1) + 0.05 * (rows["draw"] - 1.0)
    style = {"ls": "", "ms": 5, "alpha": 0.7, "mew": 0, "color": COLORS[name]}
    marker = MARKERS.get(name, "o")
    ax.plot(rows["joint"] + shift, rows[column], marker, label=name, **style)


def log_axes(ax, ticks, label):
    """log2 in x with ticks at what was measured, log in y."""
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    ax.minorticks_off()
    close = [b for a, b in pairwise(ticks) if b / a < 1.2]
    ax.set_xticks(ticks, [f"\n{t}" if t in close else str(t) for t in ticks])
    ax.set_xlabel(label)
    ax.grid(alpha=0.3)


def legend(figure, axes):
    """One for all panels, below."""
    handles = {}
    for ax in axes:
        handles |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    columns = 3 if len(handles) > 4 else len(handles)
    names = list(handles)
    figure.legend(handles.values(), names, loc="outside lower center", ncols=columns)
