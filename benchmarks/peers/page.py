"""Make docs/benchmarks.md and its plots from the results, and from nothing else."""

import argparse
import json
from pathlib import Path
from statistics import median

import plots
from compare import (
    NAMES,
    OURS,
    SMALL_N,
    TIME_GOAL,
    against_ours,
    best_error_ratios,
    goals,
    highest_score,
    jittered,
    label,
    missed,
    problem_of,
    summary,
    usable,
    variants,
)
from markup import DASH, number, printed, table
from own_goals import own_goals
from results import RESULTS, Table
from sparse_page import SparseResults

DOCS = Path(__file__).resolve().parents[2] / "docs"
OWN = {
    "likelihood": "One evaluation over its floor, LAPACK's potrf and potri",
    "memory": "Peak memory of a whole fit over the data; the goal is 4",
    "prediction": "Means; the goals are 300 us over validation, and 1.5",
    "large_fit": "One fit to many samples",
    "modes": "Likelihoods found, and the time to find them",
    "noisy_modes": "Likelihoods found for small and noisy data",
    "levels_and_units": "Tasks with different levels, units and precisions",
    "defaults": "What each choice of the defaults costs, where",
    "kronecker": "One evaluation of complete data over one eigh of its N inputs",
    "digits": "Digits lost where there is next to no noise",
}
WORDS = {True: "yes", False: "**no**", None: "not measured"}

INTRODUCTION = """\
# Benchmarks

The same data, kernel, starting point and threads for skmtgp, GPyTorch, BoTorch, GPy,
GPflow and scikit-learn: how long an evaluation of the marginal likelihood and its
gradient takes, which likelihood is reached and how soon, and how well the model then
predicts. `make bench` measures all of it again; this page is made from
`benchmarks/results` alone, and `benchmarks/README.md` says how each package is set.
"""

METHOD = """\
## What is compared

Data: the Puma 560 torques of 14 loads (`fetch_puma560`, loads c1 to c14), joint by
joint; a draw is its `random_state`. Targets are scaled to mean zero and variance one.
The model: a Gaussian process of mean zero with

```text
K[(x, t), (x', t')] = K^rho[t, t'] (b + sum_d w_d u_d u'_d
                      + a exp(-1/2 sum_d (x_d - x'_d)^2 / l_d^2)) + sigma^2 I,
```

u = (x, sgn(qd)), rank 4, no priors; the peers' multi-task kernels also have, and learn,
a diagonal of K^rho, which starts at e^-12. skmtgp has it here too (`diagonal=True`) but
not where it is as shipped. Every peer starts where skmtgp's own best
mode came from: skmtgp's first stage, which the peers get for nothing, and which counts
in skmtgp's time. Each peer is run as its documentation's example of multi-task
regression does (*shipped*) and with the best settings known for it (*best*). A fit that
reaches its budget of time ends with the best parameters so far. Fits have one thread
each; their times are the processor's, which other work on the machine hardly changes,
but those of the peers at n = 280 are the time that passed while other work went on,
which favours skmtgp there. A budget is ten times what skmtgp took, but never more than
the seconds that the tables name; at n = 896 that is less than ten times. scikit-learn,
whose kernels have an n x n x p gradient, is measured at n = 280 alone.

Likelihoods and errors are those of one plain implementation
(`benchmarks/peers/reference.py`), at the parameters that each package ended with.
Likelihoods are of the scaled targets, in nats. nMSE is the mean squared error over the
variance of the targets, averaged over loads.
"""

JITTER = """\
At the parameters of {n} of {of} fits of the peers at their best K is not positive
definite in double precision. The reference then adds jitter, at most {most:.1g}, which
lowers their likelihood by up to {cost:.0f} nats. The goal of the highest likelihood
therefore counts a peer's own score where that is higher; the tables have the
reference's.
"""


def goals_section(fits, timings):
    """Goals and whether they are reached."""
    text = ["## Goals\n", goals_table(goals(fits, timings))]
    lost = missed(fits)
    if lost:
        text.append("A peer found a higher likelihood here:\n")
        rows = [(*problem_of(r), label(r), number(-r["lead"])) for r in lost]
        head = ["n", "joint", "draw", "package", "nats above skmtgp"]
        text.append(table(head, rows))
    slow = [r for r in against_ours(fits) if 0.0 < r["times"] < TIME_GOAL]
    slow = [r for r in slow if r["settings"] == "best"]
    if slow:
        text.append(f"Passed, but not {TIME_GOAL:g} times sooner:\n")
        rows = [(*problem_of(r), label(r), number(r["times"])) for r in slow]
        text.append(table(["n", "joint", "draw", "package", "times"], rows))
    return text


def goals_table(found):
    """Goals, what was measured, whether they are reached."""
    rows = [(goal, measured, WORDS[ok]) for goal, measured, ok in found]
    return table(["goal", "measured", "reached"], rows, "---")


def own_section(folder):
    """What the package's own benchmarks printed, and which goals they reach."""
    reached = own_goals(folder)
    text = [goals_table(reached)] if reached else []
    for name, title in OWN.items():
        text += printed(folder, name, title)
    if (folder / "growth.csv").exists():
        text += [
            "Time and memory as the work grows, on one thread "
            "(`python benchmarks/growth.py`):\n",
            "![time and memory as the work grows](images/growth.png)\n",
        ]
    return ["## The engine alone\n", *text] if text else []


def timings_section(timings):
    """Seconds and memory of an evaluation."""
    if not timings:
        return []
    sizes = sorted({r["n"] for r in timings})
    text = ["## One evaluation of the likelihood and its gradient\n"]
    text.append("![seconds against n](images/benchmark-evaluation.png)\n")
    columns = {
        "Milliseconds:\n": lambda r: number(1e3 * r["seconds"]),
        "Over the floor, LAPACK's potrf and potri in the same process:\n": lambda r: (
            number(r["seconds"] / r["floor_seconds"])
        ),
        "Peak memory, MiB over what the loaded package takes:\n": lambda r: number(
            r["memory_mib"]
        ),
    }
    for title, show in columns.items():
        text += [title, timings_table(timings, sizes, show)]
    return text


def timings_table(timings, sizes, show):
    """One number for each package and n; a dash where it failed."""
    cell = {
        (r["package"], r["settings"], r["n"]): show(r)
        for r in timings
        if "seconds" in r
    }
    rows = [
        (
            label({"package": package, "settings": settings}),
            *(cell.get((package, settings, n), DASH) for n in sizes),
        )
        for package, settings in variants(timings)
    ]
    return table(["package", *(f"n = {n}" for n in sizes)], rows)


def fits_section(fits):
    """Medians for each n, then by joint."""
    text = []
    for n in sorted({r["n"] for r in usable(fits)}):
        text.append(f"## Fits at n = {n}\n")
        text.append(f"![likelihood against time](images/benchmark-fits-{n}.png)\n")
        text += [medians_table(fits, n)]
        if len({row["fits"] for row in summary(fits, n)}) > 1:
            text.append("Not everything has been measured: see the column *fits*.\n")
        for draw_median, title in ((likelihood_of, LIKELIHOODS), (error_of, ERRORS)):
            text += [title, joints_table(fits, n, draw_median)]
    if text:
        text.append("![likelihoods below skmtgp's](images/benchmark-deficits.png)\n")
    return text


LIKELIHOODS = "Log marginal likelihood by joint, median of the draws:\n"
ERRORS = "nMSE in extrapolation by joint, median of the draws:\n"


def medians_table(fits, n):
    """Medians over joints and draws."""
    head = "package,fits,likelihood,below skmtgp,evaluations,seconds,at budget,"
    head += "nMSE interpolation,nMSE extrapolation,passed by skmtgp after (s)"
    rows = [
        (
            label(r),
            r["fits"],
            number(r["likelihood"]),
            number(r["deficit"]),
            number(r["evaluations"]),
            number(r["seconds"]),
            r["at_budget"],
            number(r["nmse_interpolation"]),
            number(r["nmse_extrapolation"]),
            number(r["passed"]),
        )
        for r in summary(fits, n)
    ]
    budgets = [
        r["budget"] for r in usable(fits) if r["n"] == n and r["package"] != OURS
    ]
    text = "Medians over joints and draws"
    if budgets:
        text += f"; a peer may take {span(budgets)} s"
    return f"{text}:\n\n" + table(head.split(","), rows)


def span(values):
    """The least and the largest, or the only one."""
    ends = sorted({f"{min(values):.0f}", f"{max(values):.0f}"}, key=float)
    return " to ".join(ends)


def likelihood_of(rows):
    """Median likelihood."""
    return f"{median(r['likelihood'] for r in rows):.0f}"


def error_of(rows):
    """Median error in extrapolation."""
    return f"{median(r['nmse_extrapolation'] for r in rows):.1e}"


def joints_table(fits, n, show):
    """A number for each package and joint."""
    rows = [r for r in usable(fits) if r["n"] == n]
    joints = sorted({r["joint"] for r in rows})
    lines = []
    for package, settings in variants(rows):
        line = [label({"package": package, "settings": settings})]
        for joint in joints:
            key = package, settings, joint
            group = [
                r for r in rows if (r["package"], r["settings"], r["joint"]) == key
            ]
            line.append(show(group) if group else DASH)
        lines.append(line)
    return table(["package", *(f"joint {j}" for j in joints)], lines)


def errors_section(fits):
    """How many times lower the error is than the best peer's."""
    ratios = best_error_ratios(fits)
    if not ratios:
        return []
    joints = sorted({joint for _, joint, _ in ratios})
    cells = [[v for (_, j, _), v in ratios.items() if j == joint] for joint in joints]
    rows = [["median of the draws", *(number(median(c)) for c in cells)]]
    title = f"The peers' lowest nMSE in extrapolation over skmtgp's, n = {SMALL_N}:\n"
    return [title, table(["", *(f"joint {j}" for j in joints)], rows)]


def jitter_section(fits):
    """Whom the reference scores lower than the package itself."""
    rows = jittered(fits)
    if not rows:
        return []
    of = sum(r["settings"] == "best" for r in against_ours(fits))
    most = max(r["jitter"] for r in rows)
    cost = max(highest_score(r) - r["likelihood"] for r in rows)
    return [JITTER.format(n=len(rows), of=of, most=most, cost=cost)]


def checks_section(checks):
    """The likelihoods at the start."""
    if not checks:
        return []
    rows = [
        (label(r), number(r["likelihood"], 6), f"{r['difference']:.1e}")
        for r in checks
        if "likelihood" in r
    ]
    return [
        "## The same model\n",
        "Likelihood at the start by the reference, and the package's own less it. "
        "GPyTorch as shipped computes in single precision; BoTorch as shipped counts a "
        "prior of the noise and of the tasks' correlations, and starts at |F|, because "
        "it has no negative correlations between tasks.\n",
        table(["package", "reference", "difference"], rows),
    ]


def failures_section(*kinds):
    """What did not work, and why."""
    failed = [row for rows in kinds for row in rows if "error" in row]
    if not failed:
        return []
    rows = [
        (label(r), r["n"], r.get("joint", DASH), r.get("draw", DASH), reason(r))
        for r in failed
    ]
    head = ["package", "n", "joint", "draw", "reason"]
    return ["## Failures\n", table(head, rows)]


def reason(row):
    """The last line of an error, fit for a table."""
    return row["error"].strip().splitlines()[-1].replace("|", "/")[:120]


def machine_section(folder, rows):
    """Versions, processor, date, command."""
    path = folder / "machine.json"
    machine = json.loads(path.read_text()) if path.exists() else {}
    runs = machine.pop("runs", [])
    words = {"memory_gib": "memory, GiB"}
    lines = [f"- {words.get(key, key)}: {value}" for key, value in machine.items()]
    lines += [
        f"- {run['begun']}: `{run['command']}` at {run['commit']}, "
        f"beside it: {run['beside']}"
        for run in runs
    ]
    versions = sorted({(r["package"], r["version"]) for r in rows if "version" in r})
    text = ", ".join(f"{NAMES[package]} {version}" for package, version in versions)
    dates = sorted(r["date"] for r in rows)
    if dates:
        lines.append(f"- measured between {dates[0]} and {dates[-1]} UTC")
    return ["## Where it was measured\n", "\n".join([*lines, f"- {text}"]) + "\n"]


def main():
    """Write the page and the plots."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--docs", type=Path, default=DOCS)
    arguments = parser.parse_args()
    fits, timings, checks = (
        Table(kind, arguments.results).select()
        for kind in ("fits", "timings", "checks")
    )
    sparse = SparseResults(arguments.results)
    parts = [
        INTRODUCTION,
        *goals_section(fits, timings),
        *timings_section(timings),
        *fits_section(fits),
        *errors_section(fits),
        *sparse.section(),
        *own_section(arguments.results),
        METHOD,
        *jitter_section(fits),
        *checks_section(checks),
        *failures_section(fits, timings, checks),
        *machine_section(
            arguments.results, [*fits, *timings, *sparse.timings, *sparse.peers]
        ),
    ]
    arguments.docs.mkdir(parents=True, exist_ok=True)
    (arguments.docs / "benchmarks.md").write_text("\n".join(parts))
    plots.draw(fits, timings, arguments.docs / "images")
    peers = len({r["package"] for r in fits} - {OURS})
    print(f"{arguments.docs / 'benchmarks.md'}: {len(fits)} fits, {peers} peers")


if __name__ == "__main__":
    main()
