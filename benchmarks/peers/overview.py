"""The short page: what it says of the results, and its three tables."""

import csv
import re
from statistics import median
from textwrap import fill

import everyday
from compare import (
    GOAL_N,
    NAMES,
    OURS,
    SMALL_N,
    against_ours,
    best_error_ratios,
    likelihood_goal,
    problem_of,
    shipped_behind,
    summary,
)
from markup import DASH, number, table
from sparse_page import DENSE

NOT_MEASURED = "Not measured."
WRAP = {"break_long_words": False, "break_on_hyphens": False}
IMAGE = "```{{image}} images/{name}.png\n:alt: {alt}\n:width: 560px\n```"
SINGLE = "gpytorch", "shipped"  # in single precision
CLOSE = 1.05  # times the lowest error
BEST, WORST = 2, 3  # everyday tests of the short table
GROUPS = {  # of the models of everyday data
    "skmtgp": (everyday.DEFAULT,),
    "another multi-task GP": ("GPy ICM", "GPy LMC", "GPyTorch ICM", "GPyTorch LMC"),
    "one GP, one-hot tasks": ("GPR, one-hot tasks",),
    "a GP for each task": ("GPR of each task",),
    "ridge": ("ridge",),
    "boosted trees": ("boosted trees",),
}
EVERYDAY = {  # what is predicted of each set
    ("boys", "ages"): "heights of boys",
    ("states", "years"): "output of US states",
    ("pupils", "pupils"): "marks in 131 schools",
    ("firms", "years"): "investment of firms",
    ("jura", "sites"): "cadmium in soil, ppm",
    ("jura_logs", "sites"): "cadmium, in logarithms",
    ("meat", "samples"): "contents of meat",
    ("ur10e", "seconds"): "real arm, seconds left out",
    ("ur10e", "trajectory"): "real arm, another motion",
}


def values(results):
    """What the page has from the results."""
    fits, timings = results.fits, results.timings
    errors = error_rows(results)
    points = [
        *speed_words(timings),
        *likelihood_words(fits),
        *error_words(fits, errors),
    ]
    return {
        "summary": bullets(points),
        "evaluation_figure": figure(
            "benchmark-speed", "milliseconds of an evaluation against rows", timings
        ),
        "evaluation_table": evaluation_table(timings),
        "climb_figure": figure(
            "benchmark-climb", "nats below skmtgp's final likelihood in time", fits
        ),
        "climb_table": climb_table(fits),
        "error_table": short_table(errors),
        "caveats": bullets(caveats(results)),
    }


def bullets(points):
    """A list."""
    lines = [fill(f"- {p}", 88, subsequent_indent="  ", **WRAP) for p in points]
    return "\n".join(lines) or NOT_MEASURED


def figure(name, alt, rows):
    """A picture, if there is something to draw."""
    return IMAGE.format(name=name, alt=alt) if rows else ""


def seconds_at(timings, n):
    """Seconds of each package at its best."""
    return {
        r["package"]: r["seconds"]
        for r in timings
        if r["n"] == n and r["settings"] == "best" and "seconds" in r
    }


def speed_words(timings):
    """How much longer the other packages take."""
    found = seconds_at(timings, GOAL_N)
    ours, others = found.pop(OURS, None), sorted((s, p) for p, s in found.items())
    if ours and others:
        (least, first), (most, last) = others[0], others[-1]
        yield (
            f"**Speed.** With {GOAL_N:,} rows, the likelihood and its gradient take "
            f"{ours:.2g} s. The others, in double precision, take "
            f"{least / ours:.1f} ({NAMES[first]}) to {most / ours:.0f} times as long "
            f"({NAMES[last]})."
        )


def likelihood_words(fits):
    """On how many problems skmtgp's likelihood is the highest."""
    if against_ours(fits):
        _, measured, _ = likelihood_goal(fits)
        won, of = re.match(r"(\d+) of (\d+)", measured).groups()
        rows = [r for r in against_ours(fits) if r["settings"] == "best"]
        yield (
            f"**Likelihood.** skmtgp finds the highest on {won} of {of} problems. It "
            "passes another package's highest in 1/"
            f"{median(r['times'] for r in rows):.0f} of that package's time (median)."
        )


def error_words(fits, rows):
    """Errors on the robot, and on everyday data."""
    ratios = best_error_ratios(fits)
    words = []
    if ratios:
        by_joint = {}
        for (_, joint, _), ratio in ratios.items():
            by_joint.setdefault(joint, []).append(ratio)
        words.append(
            "On new motions of a simulated robot, the best other package has "
            f"{median(map(median, by_joint.values())):.1f} times skmtgp's error."
        )
    of_data = [row for row in rows if row.everyday]
    if of_data:
        close = sum(row.ours <= CLOSE * row.least for row in of_data)
        words.append(
            f"On {close} of {len(of_data)} tests with everyday data, skmtgp is the "
            f"best or within {100 * (CLOSE - 1):.0f} % of the best. On "
            f"{len(of_data) - close} another model is better."
        )
    if words:
        yield " ".join(["**Error.**", *words])


def evaluation_table(timings):
    """Milliseconds at each n."""
    sizes = sorted({r["n"] for r in timings})
    lines = {}
    for r in timings:
        key = r["package"], r["settings"]
        if (r["settings"] == "best" or key == SINGLE) and "seconds" in r:
            lines.setdefault(key, {})[r["n"]] = number(1e3 * r["seconds"])
    order = list(NAMES)
    rows = [
        (
            NAMES[key[0]] + (", single precision" if key == SINGLE else ""),
            *(lines[key].get(n, DASH) for n in sizes),
        )
        for key in sorted(lines, key=lambda k: (order.index(k[0]), k[1]))
    ]
    head = ["milliseconds", *(f"{n:,} rows" for n in sizes)]
    return table(head, rows) if rows else NOT_MEASURED


def climb_table(fits):
    """Where the fits end, and when skmtgp was there."""
    rows = [
        (
            NAMES[r["package"]],
            number(r["likelihood"]),
            number(r["seconds"]),
            f"{number(r['passed'])} s" if r["passed"] else DASH,
        )
        for r in summary(fits, SMALL_N)
        if r["settings"] == "best"
    ]
    head = [
        "280 rows, medians",
        "log likelihood",
        "seconds",
        "skmtgp is there after",
    ]
    return table(head, rows) if rows else NOT_MEASURED


class ErrorRow:
    """Errors of several models on one test.

    Parameters
    ----------
    name : str
        What is predicted.
    errors : list of float or None
        By GROUPS.
    everyday : bool
        Whether it is everyday data.
    """

    def __init__(self, name, errors, everyday):
        self.name, self.errors, self.everyday = name, errors, everyday

    @property
    def ours(self):
        """The error of this package's default."""
        return self.errors[0]

    @property
    def least(self):
        """The lowest error."""
        return min(error for error in self.errors if error is not None)

    @property
    def other(self):
        """The lowest error of the other models, and which of them has it."""
        pairs = zip(self.errors[1:], list(GROUPS)[1:], strict=True)
        return min(pair for pair in pairs if pair[0] is not None)

    @property
    def lead(self):
        """The lowest error of the other models over this package's."""
        return self.other[0] / self.ours

    def cells(self):
        """Errors, the lowest in bold."""
        return self.emphasised(self.errors)

    def emphasised(self, errors):
        """Some of the errors as words."""
        words = [everyday.shown(error) for error in errors]
        least = everyday.shown(self.least)
        return [f"**{word}**" if word == least else word for word in words]


def error_rows(results):
    """Of the robot, then of everyday data."""
    rows = list(robot_rows(results.fits))
    for (data, test), name in EVERYDAY.items():
        if data in everyday.there(results.real):
            found = everyday.compared(results.real, data, test, GROUPS.values())
            errors = [each and each[0] for each in found]
            rows.append(ErrorRow(name, errors, everyday=True))
    return rows


def robot_rows(fits):
    """Medians over joints and draws; the best of the other packages."""
    rows = [r for r in summary(fits, SMALL_N) if r["settings"] == "best"]
    ours = [r for r in rows if r["package"] == OURS]
    peers = [r for r in rows if r["package"] != OURS]
    for kind, name in ROBOT.items():
        if ours and peers:
            least = min(r[kind] for r in peers)
            alone = each_task_alone(kind)
            yield ErrorRow(name, [ours[0][kind], least, None, alone, None, None], False)


ROBOT = {
    "nmse_interpolation": "simulated robot, known motions",
    "nmse_extrapolation": "simulated robot, new motions",
}


def each_task_alone(kind, path=DENSE):
    """Median error of a Gaussian process for each load, from the paper's experiment."""
    if not path.exists():
        return None
    with path.open() as file:
        rows = csv.DictReader(file)
        found = [
            float(row[kind])
            for row in rows
            if row["model"] == "sGP" and int(row["n"]) == SMALL_N and not row["error"]
        ]
    return median(found) if found else None


def error_table(rows):
    """A line for each test, a column for each model."""
    lines = [(row.name, *row.cells()) for row in rows]
    return table(["error", *GROUPS], lines) if lines else NOT_MEASURED


def short_table(rows):
    """The robot's new motions, and everyday data where skmtgp is best and worst."""
    robot = [row for row in rows if not row.everyday][-1:]
    of_data = sorted((row for row in rows if row.everyday), key=lambda row: -row.lead)
    if len(of_data) > BEST + WORST:
        of_data = of_data[:BEST] + of_data[-WORST:]
    lines = [
        (row.name, *row.emphasised([row.ours, row.other[0]]), row.other[1])
        for row in [*robot, *of_data]
    ]
    head = ["error", "skmtgp", "the best other", "which is"]
    return table(head, lines) if lines else NOT_MEASURED


def caveats(results):
    """What the numbers do not say."""
    yield (
        "The simulated robot's torques have almost no noise. There, better "
        "hyperparameters lower the error several times. With noise, all multi-task "
        "models have similar errors."
    )
    yield from fits_caveats(results.fits)
    yield (
        "All times are of two cores. GPyTorch, BoTorch and GPflow can use a GPU, "
        "skmtgp cannot."
    )
    yield from sparse_caveat(results.sparse)
    yield from drawn_caveat(results.folder)


def fits_caveats(fits):
    """Budgets, and the diagonal that the default has not."""
    rows = [r for r in against_ours(fits) if r["settings"] == "best"]
    if rows:
        ended = sum(r["stop"] == "budget" for r in rows)
        yield (
            f"{ended} of {len(rows)} fits of the other packages reached their time "
            "limit. With more time some would end higher. At 280 rows their times are "
            "wall-clock times beside other work, which favours skmtgp."
        )
    behind = shipped_behind(fits)
    if behind:
        yield (
            "Here skmtgp's task covariance has a diagonal, as in the other packages. "
            "Without it, as by default, another package ends higher on "
            f"{len(behind)} of {len({problem_of(r) for r in rows})} problems."
        )


def sparse_caveat(sparse):
    """How close GPflow and GPyTorch are where rows are many."""
    for goal, measured, _ in sparse.speed_goals():
        if goal.endswith("m points"):
            yield (
                "The lead is small with 56,000 rows and 500 inducing points: the next "
                f"package's evaluation takes {measured} as long."
            )


def drawn_caveat(folder):
    """Errors on drawn problems, and coverage of the default of a later version."""
    path, of_default = folder / "ordinary.txt", folder / "ordinary_default.txt"
    if not (path.exists() and of_default.exists()):
        return
    errors, later = drawn_table(path)["ALL"], drawn_table(of_default)
    shares = {name: float(row["coverage"]) for name, row in later.items()}
    yield (
        f"On {errors['fits']} randomly drawn problems, the median error is "
        f"{errors['/best of 3']} times that of the best of three simpler models. The "
        f"95 % intervals hold {100 * shares['ALL']:.0f} % of new targets, in the worst "
        f"class {100 * min(shares.values()):.0f} %: see "
        "[Intervals](guide/intervals.md)."
    )


def drawn_table(path):
    """The first table of a report of ordinary problems: a dict for each class."""
    lines = iter(path.read_text("utf-8").splitlines())
    names = next(re.split(" {2,}", x.strip()) for x in lines if "coverage" in x)
    rows = {}
    for name, *values in map(str.split, lines):
        rows[name] = dict(zip(names, values, strict=True))
        if name == "ALL":
            return rows
    raise ValueError(f"{path} has no line ALL.")
