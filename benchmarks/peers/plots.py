"""The plots of the pages; those of the short one can be read on a phone."""

import sys
from functools import partial
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import everyday
import matplotlib.pyplot as plt
import numpy as np
from compare import (
    NAMES,
    OURS,
    against_ours,
    label,
    of_variant,
    our_fits,
    problem_of,
    usable,
    variants,
)
from overview import EVERYDAY, GROUPS

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import stacked

from skmtgp import MultiTaskGPRegressor, SingleTaskGP
from skmtgp.inspection import COLORS as PALETTE
from skmtgp.inspection import color_of
from skmtgp.inspection._drawing import MARKERS as SHAPES

PACKAGES = "gpytorch", "skmtgp", "gpy", "gpflow", "botorch", None, "sklearn"
COLORS = dict(zip(PACKAGES, PALETTE, strict=True))
SHAPE = dict(zip(PACKAGES, SHAPES, strict=True))
OF_GROUPS = {  # colour and marker
    "skmtgp": (color_of(MultiTaskGPRegressor()), "s"),
    "another multi-task GP": (PALETTE[0], "o"),
    "one GP, one-hot tasks": (PALETTE[3], "v"),
    "a GP for each task": (color_of(SingleTaskGP()), "P"),
    "ridge": (PALETTE[4], "D"),
    "boosted trees": (PALETTE[2], "^"),
}
PHONE = {"font.size": 11, "axes.titlesize": 11}
save = partial(stacked.save, dpi=200)
STYLES = {"best": "-", "shipped": ":"}
MARKERS = {"best": "o", "shipped": "x"}


def draw(results, folder):
    """Write all plots for which there is data."""
    fits, timings = results.fits, results.timings
    folder.mkdir(parents=True, exist_ok=True)
    if any("seconds" in row for row in timings):
        save(evaluations(timings), folder / "benchmark-evaluation.png")
        save(speed(timings), folder / "benchmark-speed.png")
    if everyday.there(results.real):
        save(everyday_fits(results.real), folder / "benchmark-everyday.png")
    if usable(fits):
        save(climb(fits), folder / "benchmark-climb.png")
    for n in sorted({row["n"] for row in usable(fits)}):
        figure = traces([r for r in usable(fits) if r["n"] == n])
        save(figure, folder / f"benchmark-fits-{n}.png")
    if against_ours(fits):
        save(deficits(against_ours(fits)), folder / "benchmark-deficits.png")


def speed(timings):
    """Milliseconds of an evaluation against n, each package at its best."""
    rows = [r for r in timings if "seconds" in r and r["settings"] == "best"]
    with plt.rc_context(PHONE):
        figure, ax = plt.subplots(figsize=(5.2, 4.4), layout="constrained")
        for package, settings in variants(rows):
            group = sorted(of_variant(rows, package, settings), key=lambda r: r["n"])
            times = [1e3 * r["seconds"] for r in group]
            ax.plot([r["n"] for r in group], times, **style(package))
        ax.set(xscale="log", yscale="log", xlabel="rows", ylabel="milliseconds")
        sizes = sorted({r["n"] for r in rows})
        ax.set_xticks(sizes, [f"{n:,}" for n in sizes])
        ax.minorticks_off()
        ax.yaxis.set_major_formatter("{x:,.0f}")
        ax.set_title("One evaluation of likelihood and gradient")
        ax.grid(alpha=0.3)
        ax.legend(frameon=False)
    return figure


def style(package):
    """Colour, marker and width of a package's line."""
    wide = package == OURS
    return {
        "color": COLORS[package],
        "marker": SHAPE[package],
        "label": NAMES[package],
        "lw": 3.0 if wide else 1.6,
        "ms": 7.0 if wide else 5.0,
        "zorder": 3 if wide else 2,
    }


def everyday_fits(rows):
    """Seconds and error of the same fits, a line for each test of everyday data."""
    figure, axes = plt.subplots(
        1, 2, figsize=(9.5, 5.4), layout="constrained", sharey=True
    )
    there = {t: name for t, name in EVERYDAY.items() if t[0] in everyday.there(rows)}
    for y, test in enumerate(there):
        mark(axes, y, everyday.compared(rows, *test, GROUPS.values()))
    axes[0].set_yticks(range(len(there)), there.values(), fontsize=9)
    axes[0].set_ylim(len(there) - 0.5, -0.5)
    axes[0].set(xscale="log", xlabel="seconds of a fit")
    axes[1].set(xscale="log", xlabel="error, skmtgp's is 1")
    for ax, ticks in zip(axes, EVERYDAY_TICKS, strict=True):
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.minorticks_off()
        ax.grid(axis="x", alpha=0.3)
        for y in range(1, len(there)):
            ax.axhline(y - 0.5, color="0.85", lw=0.8, zorder=0)
    handles = axes[0].lines[: len(GROUPS)]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


EVERYDAY_TICKS = (0.01, 0.1, 1, 10), (0.2, 0.5, 1, 2, 5, 20, 100)


def mark(axes, y, found):
    """The seconds and the errors of one test, below each other so that all are seen."""
    ours = found[0][0]
    for k, (name, each) in enumerate(zip(GROUPS, found, strict=True)):
        error, seconds = each or (np.nan, np.nan)
        color, marker = OF_GROUPS[name]
        style = {"color": color, "ls": "", "ms": 7 if name == OURS else 5}
        for ax, x in zip(axes, (seconds, error / ours), strict=True):
            ax.plot(x, y + 0.14 * (k - 2.5), marker, label=name, **style)


def climb(fits):
    """Nats below skmtgp's final likelihood in time, a panel for each n."""
    rows = [r for r in usable(fits) if r["settings"] == "best"]
    sizes = sorted({r["n"] for r in rows})
    size = (5.2, 1.2 + 2.9 * len(sizes))
    with plt.rc_context(PHONE):
        figure, axes = plt.subplots(
            len(sizes),
            1,
            figsize=size,
            layout="constrained",
            squeeze=False,
            sharex=True,
        )
        for ax, n in zip(axes[:, 0], sizes, strict=True):
            climb_panel(ax, [r for r in rows if r["n"] == n])
            ax.set_title(f"{n:,} rows")
        axes[-1, 0].set_xlabel("seconds")
        figure.supylabel("log likelihood below skmtgp's final one", fontsize=11)
        handles = axes[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def climb_panel(ax, rows):
    """Medians over joints and draws, from when half have one to their median end."""
    final = {key: r["likelihood"] for key, r in our_fits(rows).items()}
    for package, settings in variants(rows):
        group = [
            r for r in of_variant(rows, package, settings) if problem_of(r) in final
        ]
        if not group:
            continue
        last = np.median([r["seconds"] for r in group])
        times = np.geomspace(0.3, last, 60)
        found = [[final[problem_of(r)] - at(r, t) for r in group] for t in times]
        marks = {"markevery": [-1]}
        ax.plot(times, np.median(found, axis=1), **style(package), **marks)
    ax.set(xscale="log")
    ax.set_yscale("symlog", linthresh=10.0)
    ax.set_yticks([0, 10, 100, 1000, 10000], ["0", "10", "100", "1,000", "10,000"])
    ax.set_xticks([1, 10, 100], ["1", "10", "100"])
    ax.minorticks_off()
    ax.set_ylim(20000, -4)
    ax.grid(alpha=0.3)


def at(row, seconds):
    """The best likelihood after some time; -inf before there was any."""
    known = [value for when, value in row["trace"] if when <= seconds]
    return max(known, default=-np.inf)


def evaluations(timings):
    """Seconds of an evaluation against n."""
    figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
    rows = [r for r in timings if "seconds" in r]
    for package, settings in variants(rows):
        group = of_variant(rows, package, settings)
        line(ax, group, "seconds", STYLES[settings], label(group[0]))
    ours = [r for r in rows if r["package"] == OURS]
    ax.plot(
        [r["n"] for r in ours],
        [r["floor_seconds"] for r in ours],
        "--k",
        label="potrf and potri",
    )
    ax.set(xscale="log", yscale="log", xlabel="rows n", ylabel="seconds")
    sizes = sorted({r["n"] for r in rows})
    ax.set_xticks(sizes, sizes)
    ax.minorticks_off()
    ax.set_title("Likelihood and gradient, once")
    ax.grid(alpha=0.3)
    ax.legend()
    return figure


def line(ax, rows, key, style, name):
    """One package's line."""
    rows = sorted(rows, key=lambda r: r["n"])
    color, wide = COLORS[rows[0]["package"]], rows[0]["package"] == OURS
    x, y = [r["n"] for r in rows], [r[key] for r in rows]
    ax.plot(x, y, style, marker="o", color=color, label=name, lw=2.5 if wide else 1.5)


def traces(fits):
    """Likelihood against seconds, a panel for each joint, the first draw."""
    draw = min(r["draw"] for r in fits)
    fits = [r for r in fits if r["draw"] == draw]
    joints = sorted({r["joint"] for r in fits})
    columns = min(3, len(joints))
    rows = -(-len(joints) // columns)
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(max(8.5, 4.2 * columns), 3.4 * rows + 1.1),
        layout="constrained",
        squeeze=False,
    )
    for ax, joint in zip(axes.flat, joints, strict=False):
        panel(ax, [r for r in fits if r["joint"] == joint])
        ax.set_title(f"joint {joint}")
    for ax in axes[-1]:
        ax.set_xlabel("seconds")
    handles = {}
    for ax in axes.flat:
        handles |= {h.get_label(): h for h in ax.get_lines()}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)
    figure.suptitle(f"Log marginal likelihood against seconds, n = {fits[0]['n']}")
    figure.supylabel("log marginal likelihood")
    return figure


def panel(ax, fits):
    """The fits of one problem."""
    for package, settings in variants(fits):
        (row,) = of_variant(fits, package, settings)
        points = np.array([*row["trace"], (row["seconds"], row["trace"][-1][1])])
        ax.step(
            *points.T,
            STYLES[settings],
            where="post",
            color=COLORS[package],
            label=label(row),
            lw=2.5 if package == OURS else 1.3,
        )
    most = max(r["likelihood"] for r in fits)
    ax.set(xscale="log", ylim=(-0.1 * most, 1.05 * most))
    ax.grid(alpha=0.3)


def deficits(rows):
    """How far each peer's likelihood is below ours, a panel for each n."""
    sizes = sorted({r["n"] for r in rows})
    figure, axes = plt.subplots(
        1,
        len(sizes),
        figsize=(max(8.5, 5.5 * len(sizes)), 4.9),
        layout="constrained",
        squeeze=False,
        sharey=True,
    )
    names = [name for name in NAMES if name != OURS]
    for ax, n in zip(axes[0], sizes, strict=True):
        for row in [r for r in rows if r["n"] == n]:
            shift = 0.13 * (names.index(row["package"]) - 2)
            ax.plot(
                row["joint"] + shift,
                row["deficit"],
                MARKERS[row["settings"]],
                color=COLORS[row["package"]],
                label=label(row),
                ms=5,
            )
        ax.axhline(0.0, color="k", lw=0.8)
        ax.set_yscale("symlog", linthresh=10.0)
        ax.set(title=f"n = {n}", xlabel="joint")
        ax.set_xticks(sorted({r["joint"] for r in rows}))
        ax.grid(axis="y", alpha=0.3)
    axes[0, 0].set_ylabel("nats below skmtgp")
    handles = {}
    for ax in axes.flat:
        handles |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)
    return figure
