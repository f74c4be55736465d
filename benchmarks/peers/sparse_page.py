"""The page's section on learning from the whole training set by inducing inputs."""

import csv
from pathlib import Path

import numpy as np
from compare import NAMES, OURS
from markup import number, printed, table
from problem import NOISE
from results import Table

DENSE = Path(__file__).resolve().parents[2] / "examples/paper/results/figure4.csv"
DENSE_N, WHOLE_N, WHOLE_M = 2800, 56_000, 500
SPEED_GOAL, MEMORY_GOAL = 3.0, 8.0  # times, GB
KINDS = {"inputs": "m inputs, r tasks", "points": "m points"}
DEFAULTS = 1100, (5,)  # n_exact, and the only rank
ERRORS = "nmse_interpolation", "nmse_extrapolation"

INTRODUCTION = """\
## The whole training set

The whole training set has 14 loads with 4000 samples each: n = 56,000. Here skmtgp uses
`inference="sparse"`: a lower bound on the likelihood from m inducing inputs, chosen
among the samples. In GPyTorch (SGPR) and GPflow (SGPR) an inducing point is an input of
one task. They run twice. With *m points* they get as many points as skmtgp has inputs.
With *m inputs, r tasks* they get each of skmtgp's inputs for as many tasks as the rank.
Their bound is then the same as skmtgp's. Errors are those on the whole interpolation
and extrapolation sets. With one thread, times are processor time.
"""

FITS = """\
Whole fits of skmtgp, beside exact inference (dense) at n = 2800 with the rank that BIC
chooses. Where several ranks were searched, the table shows the one with the lowest BIC
and the time of all. *Exact* is `n_exact`, 1100 by default. The bound is that of the
scaled targets. A fit uses fewer than m inducing inputs where more would have no
variance left in double precision. A larger m then changes nothing:
"""

MORE_ROWS = """\
Do more rows lower the errors? Exact inference from some of the rows, at the parameters
that sparse inference has learned from all rows"""

TIMES = """\
Seconds of one evaluation of the bound and its gradient, on random data at rank 4. A
dash means that it failed or was not tried:
"""

MEMORY = "Peak memory of this evaluation, MiB beyond what the loaded package takes:\n"

PEERS = """\
Fits with a time limit, all from the same start: the mode of exact inference on 1100 of
the samples. Finding it counts in skmtgp's time only. The noise variance of the other
packages starts at 2e-10 or above. Bounds are higher with less noise, so they say little
about the fits. A plain implementation computes the other packages' bounds and errors at
their parameters. All packages choose their inducing points twice, the other packages
after half of the time. skmtgp ends by itself:
"""

CHECKS = """\
The packages' own bounds at a start, minus those of a plain implementation. With all
inputs inducing (m = n), minus the exact likelihood:
"""


class SparseResults:
    """What has been measured of the sparse models.

    Parameters
    ----------
    folder : Path
        Of the results.
    """

    def __init__(self, folder):
        self.folder = folder
        fits, self.timings, self.peers, self.checks = (
            Table(f"sparse_{kind}", folder).select()
            for kind in ("fits", "timings", "peers", "checks")
        )
        self.fits = chosen(fits)

    def section(self):
        """The lines of the page; none if nothing has been measured."""
        parts = [
            *self.own_fits(),
            *printed(self.folder, "more_rows", MORE_ROWS),
            *self.evaluations(),
            *self.peers_fits(),
            *self.checked(),
            *self.failures(),
        ]
        if (self.folder / "sparse_growth.csv").exists():
            parts.append("From 10,000 samples to all 960,000 samples of the data:\n")
            parts.append("![time and memory against n](images/sparse-growth.png)\n")
        return [INTRODUCTION, *parts] if parts else []

    def goals(self):
        """What was wanted, what was found, whether reached."""
        return [*self.error_goal(), *self.memory_goal(), *self.speed_goals()]

    def error_goal(self):
        """Both errors against those of exact inference, for each way of fitting."""
        exact, ways = dense_errors(), {}
        for row in self.fits:
            if (row["n"], row["m"]) == (WHOLE_N, WHOLE_M) and row["joint"] in exact:
                ways.setdefault(way_of(row), []).append(row)
        for (n_exact, ranks), rows in ways.items():
            ratios = {
                f"joint {row['joint']}, {kind.removeprefix('nmse_')}": (
                    row[kind] / exact[row["joint"]][kind]
                )
                for row in rows
                for kind in ERRORS
            }
            missed = [f"{r:.2g} times at {at}" for at, r in ratios.items() if r >= 1.0]
            goal = f"both errors below those of dense inference at n = {DENSE_N}: "
            rank = f"the rank of {', '.join(map(str, ranks))} by BIC"
            rank = rank if len(ranks) > 1 else f"rank {ranks[0]}"
            goal += f"{rank}, n_exact = {n_exact}"
            found = [f"{len(ratios) - len(missed)} of {len(ratios)}"]
            for kind in ERRORS:
                of_kind = kind.removeprefix("nmse_")
                middle = np.median([r for at, r in ratios.items() if of_kind in at])
                found.append(f"median {middle:.2g} times in {of_kind}")
            yield goal, "; ".join([*found, *missed]), not missed

    def memory_goal(self):
        """The largest peak of all fits."""
        peaks = [row["peak_mib"] for row in self.fits if row["n"] == WHOLE_N]
        if peaks:
            most = max(peaks) * 2**20 / 1e9
            goal = f"a fit in less than {MEMORY_GOAL:g} GB"
            yield goal, f"{most:.1f} GB at most", most < MEMORY_GOAL

    def speed_goals(self):
        """An evaluation against the faster peer, for each kind of inducing points."""
        at = [
            row
            for row in self.timings
            if (row["n"], row["m"]) == (WHOLE_N, WHOLE_M) and "seconds" in row
        ]
        ours = [seconds(row) for row in at if row["package"] == OURS]
        for settings, kind in KINDS.items():
            peers = [
                seconds(row)
                for row in at
                if row["package"] != OURS and row["settings"] == settings
            ]
            if ours and peers:
                ratio = min(peers) / ours[0]
                goal = f"an evaluation at n = {WHOLE_N}, m = {WHOLE_M}, {SPEED_GOAL:g} "
                goal += f"times faster than the best peer's, {kind}"
                yield goal, f"{ratio:.2g} times", ratio >= SPEED_GOAL

    def own_fits(self):
        """Each fit of skmtgp."""
        if not self.fits:
            return []
        head = "n,m,exact,ranks,rank,joint,draw,inducing,seconds,threads,evaluations,"
        head += "MiB,bound,noise floor,noise,"
        head += "nMSE interpolation,dense,nMSE extrapolation,dense"
        exact = dense_errors()
        rows = []
        for row in self.fits:
            words = [row["n"], row["m"], row["n_exact"]]
            words.append(", ".join(map(str, row["ranks"])))
            words += [row[k] for k in ("rank", "joint", "draw")]
            words += [row["n_inducing"], number(seconds(row)), row["threads"]]
            words += [row["n_evaluations"]]
            words += [number(row["peak_mib"]), f"{row['bound']:.1f}"]
            words += [number(row["noise_floor"]), number(row["noise"])]
            for kind in ERRORS:
                of_dense = exact.get(row["joint"], {}).get(kind)
                words += [number(row[kind]), number(of_dense)]
            rows.append(words)
        return [FITS, table(head.split(","), rows)]

    def evaluations(self):
        """Seconds and memory of each package."""
        if not self.timings:
            return []
        sizes = sorted({(row["n"], row["m"]) for row in self.timings})
        head = ["package", *(f"n = {n}, m = {m}" for n, m in sizes)]
        text = []
        for title, value in ((TIMES, seconds), (MEMORY, memory)):
            lines = {}
            for row in self.timings:
                cells = lines.setdefault(name(row), {})
                if "seconds" in row:
                    cells[row["n"], row["m"]] = number(value(row))
            rows = [
                (package, *(cells.get(size, "-") for size in sizes))
                for package, cells in in_order(lines).items()
            ]
            text += [title, table(head, rows)]
        return text

    def peers_fits(self):
        """The peers' fits, and skmtgp's of the same data."""
        done = [row for row in self.peers if "bound" in row]
        problems = {problem_of(row) for row in done}
        ours = [
            {**row, "package": OURS, "settings": "inputs"}
            for row in self.fits
            if problem_of(row) in problems
            and row["noise_floor"] == NOISE[0]
            and way_of(row) == DEFAULTS
        ]
        if not done:
            return []
        head = "package,n,m,rank,joint,draw,inducing,seconds,evaluations,bound,noise,"
        head += "nMSE interpolation,nMSE extrapolation"
        rows = [
            (
                name(row),
                *problem_of(row),
                row["n_inducing"],
                number(seconds(row)),
                row.get("evaluations", row.get("n_evaluations")),
                f"{row['bound']:.1f}",
                *(number(row[key]) for key in ("noise", *ERRORS)),
            )
            for row in sorted([*ours, *done], key=problem_of)
        ]
        return [PEERS, table(head.split(","), rows)]

    def checked(self):
        """The bounds at a start."""
        done = [row for row in self.checks if "likelihood" in row]
        rows = [
            (
                name(row),
                row["n"],
                row["m"],
                f"{row['likelihood']:.1f}",
                f"{row['difference']:.1e}",
            )
            for row in done
        ]
        head = ["package", "n", "m", "reference", "difference"]
        return [CHECKS, table(head, rows)] if rows else []

    def failures(self):
        """What did not work, and why."""
        failed = [
            (name(row), row["n"], row["m"], row.get("joint", "-"), reason(row))
            for rows in (self.checks, self.timings, self.peers)
            for row in rows
            if "error" in row
        ]
        head = ["package", "n", "m", "joint", "reason"]
        return ["Failures:\n", table(head, failed)] if failed else []


def way_of(row):
    """How a fit was made: rows that were learned exactly, ranks that were searched."""
    return row["n_exact"], tuple(row["ranks"])


def chosen(fits):
    """Of the ranks of a search, the one that all joints want together: eq. 8."""
    searches = {}
    for row in fits:
        search = *way_of(row), row["n"], row["m"], row["draw"], row["noise_floor"]
        searches.setdefault(search, {}).setdefault(row["rank"], []).append(row)
    best = [min(of.values(), key=criterion) for of in searches.values()]
    return [row for rows in best for row in rows]


def criterion(rows):
    """BIC of a rank, summed over the joints; of one rank there is nothing to choose."""
    return sum(
        -2.0 * row["bound"] + row["n_hyperparameters"] * np.log(row["n"])
        for row in rows
        if len(row["ranks"]) > 1
    )


def name(row):
    """A package, and its inducing points."""
    kind = "" if row["package"] == OURS else f", {KINDS[row['settings']]}"
    return NAMES[row["package"]] + kind


def in_order(lines):
    """The packages' lines, this package first."""
    first = [line for line in lines if line == NAMES[OURS]]
    return {line: lines[line] for line in [*first, *sorted(set(lines) - set(first))]}


def problem_of(row):
    """The problem that a fit is of."""
    return tuple(row[key] for key in ("n", "m", "rank", "joint", "draw"))


def seconds(row):
    """The processor's where there is one thread, else those that passed."""
    passed = row["wall_seconds"] if "wall_seconds" in row else row["seconds"]
    return row.get("processor_seconds", passed) if row["threads"] == 1 else passed


def memory(row):
    """MiB of an evaluation."""
    return row["memory_mib"]


def reason(row):
    """The last line of an error, fit for a table."""
    return row["error"].strip().splitlines()[-1].replace("|", "/")[:120]


def dense_errors(path=DENSE):
    """Errors of exact inference at the rank that BIC chooses, by joint.

    Empty until a rank of all six joints has been measured, by ``make paper``.
    """
    if not path.exists():
        return {}
    with path.open() as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if row["model"] == "mGP" and int(row["n"]) == DENSE_N and not row["error"]
        ]
    ranks = {}
    for row in rows:
        ranks.setdefault(int(row["rank"]), {})[int(row["joint"])] = row
    whole = [of_rank for of_rank in ranks.values() if len(of_rank) == 6]
    if not whole:
        return {}
    best = min(whole, key=bic)
    return {j: {kind: float(row[kind]) for kind in ERRORS} for j, row in best.items()}


def bic(of_rank):
    """Equation 8, summed over the joints."""
    return sum(
        -2.0 * float(row["log_marginal_likelihood"])
        + int(row["n_hyperparameters"]) * np.log(DENSE_N)
        for row in of_rank.values()
    )
