"""The tables of the appendix, and what the page on measuring has of the results."""

import json
from statistics import median

from compare import (
    NAMES,
    OURS,
    SMALL_N,
    against_ours,
    best_error_ratios,
    highest_score,
    jittered,
    label,
    summary,
    usable,
    variants,
)
from markup import DASH, number, printed, table

OWN = {
    "likelihood": "Time of one evaluation, relative to LAPACK's potrf and potri",
    "memory": "Peak memory of a whole fit, beyond the data",
    "prediction": "Time and memory of predicting means",
    "large_fit": "One fit to many samples",
    "kronecker": (
        "Time of one evaluation with complete data, relative to eigh of its N inputs"
    ),
    "digits": "Digits lost where there is almost no noise",
    "modes": "Likelihoods found, and the time to find them",
    "noisy_modes": "Likelihoods found for small and noisy data",
    "ordinary": "Drawn problems in 29 classes, compared with simpler models",
    "levels_and_units": "Tasks with different levels, units and precisions",
    "defaults": "Where each default costs or gains accuracy",
}

JITTER = """\
For {n} of {of} fits of the other packages at their best, K is not positive definite in
double precision at the final parameters. The reference then adds jitter, at most
{most:.1g}. This lowers their likelihood by up to {cost:.0f} nats. The tables show these
likelihoods. The count of the highest likelihoods uses a package's own value if it is
higher.
"""


def own_section(folder):
    """What the package's own benchmarks printed, and which goals they reach."""
    text = []
    for name, title in OWN.items():
        text += printed(folder, name, title)
    if (folder / "growth.csv").exists():
        text += [
            "Time and memory as the work grows, on one thread "
            "(`python benchmarks/growth.py`):\n",
            "![time and memory as the work grows](images/growth.png)\n",
        ]
    return ["## skmtgp alone\n", *text] if text else []


def timings_section(timings):
    """Seconds and memory of an evaluation."""
    if not timings:
        return []
    sizes = sorted({r["n"] for r in timings})
    text = ["## One evaluation of the likelihood and its gradient\n"]
    text.append("![seconds against n](images/benchmark-evaluation.png)\n")
    columns = {
        "Milliseconds:\n": lambda r: number(1e3 * r["seconds"]),
        "Relative to LAPACK's potrf and potri in the same process:\n": lambda r: number(
            r["seconds"] / r["floor_seconds"]
        ),
        "Peak memory in MiB, beyond what the loaded package takes:\n": lambda r: number(
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
        text.append(f"## Fits of {n} rows\n")
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
        text += f". The time limit of the other packages is {span(budgets)} s"
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
    title = (
        "The lowest nMSE in extrapolation of the other packages, divided by skmtgp's, "
    )
    title += f"n = {SMALL_N}:\n"
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
    rows = [
        (label(r), number(r["likelihood"], 6), f"{r['difference']:.1e}")
        for r in checks
        if "likelihood" in r
    ]
    if not rows:
        return []
    return [
        "The table has the likelihood at the start by the reference, and how much the "
        "package's own value differs from it. GPyTorch as shipped computes in single "
        "precision. BoTorch as shipped adds a prior of the noise and of the tasks' "
        "correlations. It starts at |F|, because it has no negative correlations "
        "between tasks.\n",
        table(["package", "reference", "difference"], rows),
    ]


def failures_section(rows):
    """What did not work, and why."""
    failed = [
        (label(r), r["n"], r.get("joint", DASH), r.get("draw", DASH), reason(r))
        for r in rows
        if "error" in r
    ]
    head = ["package", "n", "joint", "draw", "reason"]
    return [table(head, failed)] if failed else []


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
        f"- {run['begun']}: `{run['command']}` at {run['commit']}; running at the same "
        f"time: {run['beside']}"
        for run in runs
    ]
    versions = sorted({(r["package"], r["version"]) for r in rows if "version" in r})
    text = ", ".join(f"{NAMES[package]} {version}" for package, version in versions)
    dates = sorted(r["date"] for r in rows)
    if dates:
        lines.append(f"- measured between {dates[0]} and {dates[-1]} UTC")
    return "\n".join([*lines, f"- {text}"])
