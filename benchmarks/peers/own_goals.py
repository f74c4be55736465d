"""The goals of the engine alone, read from what its own benchmarks printed."""

import re

ABOVE_THE_FLOOR = re.compile(
    r"^ *(\d+) +[\d.]+ +[\d.]+ +([\d.]+) +([\d.]+) +[\d.]+ +[\d.]+ +([\d.]+)$"
)
VALUE_N, VALUE_GOAL = 4000, 1.4
EIGH_N, EIGH_GOAL = 2000, 3.0
MEMORY_GOAL = 4.0  # n x n doubles
STATE_GOAL, JOINTS_GOAL, BATCH_GOAL = 300.0, 2.0, 1.5  # us, ms, times
SEARCH_GOAL, FIT_GOAL, LARGE_FIT_GOAL = 180.0, 10.0, 600.0  # s
BELOW_GOAL, ALONE_GOAL, FALL_GOAL = 5.0, 10.0, 0.1  # nats


def own_goals(folder):
    """What was wanted, what was found, whether reached.

    Parameters
    ----------
    folder : Path
        Of the results.

    Returns
    -------
    goals : list of (str, str, bool)
        Of what has been measured.
    """
    goals = []
    for name, read in READERS.items():
        path = folder / f"{name}.txt"
        if path.exists():
            lines = path.read_text().splitlines()
            goals += read([line for line in lines if not line.startswith("#")])
    return goals


def likelihood_goals(lines):
    """Value and gradient over the floor at each n; the value at the largest."""
    found, threads = {}, "1"
    for line in lines:
        if line.startswith("threads: "):
            threads = line.removeprefix("threads: ")
        elif match := ABOVE_THE_FLOOR.match(line):
            n, ratio, goal, of_value = (float(x) for x in match.groups())
            found.setdefault((int(n), goal), {})[threads] = ratio, of_value
    goals = []
    for (n, goal), by_threads in found.items():
        ratios = {threads: ratio for threads, (ratio, _) in by_threads.items()}
        what = f"value and gradient at n = {n}, at most {goal:g} times potrf and potri"
        goals.append((what, of_threads(ratios), max(ratios.values()) <= goal))
        if n == VALUE_N:
            ratios = {threads: ratio for threads, (_, ratio) in by_threads.items()}
            what = f"the value alone at n = {n}, at most {VALUE_GOAL:g} times potrf"
            goals.append((what, of_threads(ratios), max(ratios.values()) <= VALUE_GOAL))
    return goals


def of_threads(ratios):
    """Ratios by the number of threads, in words."""
    words = {"1": "one thread"}
    return ", ".join(
        f"{ratio:.2f} ({words.get(threads, f'{threads} threads')})"
        for threads, ratio in ratios.items()
    )


def memory_goals(lines):
    """Peak memory of a fit."""
    most = max(float(line.split()[2]) for line in lines[1:])
    goal = f"memory of a fit at n = 2800 and 4000, at most {MEMORY_GOAL:g} n x n arrays"
    return [(goal, f"{most:.2f}", most <= MEMORY_GOAL)]


def prediction_goals(lines):
    """Means of one state and of many."""
    one = float(number_in(r"(\d+) us over it", lines))
    joints = float(number_in(r"pipeline of six outputs: ([\d.]+) ms", lines))
    many = float(number_in(r"products .* ratio ([\d.]+)", lines))
    return [
        (
            f"the mean of one state, at most {STATE_GOAL:g} us over its validation",
            f"{one:g} us",
            one <= STATE_GOAL,
        ),
        (
            f"six joints of one state, by the pipeline, at most {JOINTS_GOAL:g} ms",
            f"{joints:g} ms",
            joints <= JOINTS_GOAL,
        ),
        (
            f"the means of many, at most {BATCH_GOAL:g} times their products and exp",
            f"{many:g}",
            many <= BATCH_GOAL,
        ),
    ]


def modes_goals(lines):
    """The time of a search and of a fit, and what they miss."""
    seconds = float(number_in(r"two processes: (\d+) s", lines))
    search = lines.index(next(line for line in lines if "two processes" in line))
    alone = lines.index(next(line for line in lines if line.startswith("Rank 4")))
    rows = [line.split()[1:] for line in lines[search + 3 : alone - 2]]
    below = max(float(x) for row in rows for x in row)
    fall = max(0.0, -float(number_in(r"to the next: (-?[\d.]+)", lines)))
    fits = [[float(x) for x in line.split()[1:]] for line in lines[alone + 1 :] if line]
    longest, lowest = (max(column) for column in zip(*fits, strict=True))
    return [
        (
            f"RankSearchIC, six ranks and joints at n = 280, at most {SEARCH_GOAL:g} s",
            f"{seconds:.0f} s",
            seconds <= SEARCH_GOAL,
        ),
        (
            f"each of its modes at most {BELOW_GOAL:g} nats below the best known",
            f"{below:.1f} nats",
            below <= BELOW_GOAL,
        ),
        (
            f"none more than {FALL_GOAL:g} nat below that of a lower rank",
            f"{fall:.2f} nats",
            fall <= FALL_GOAL,
        ),
        (
            f"a fit of rank 4 at n = 280, at most {FIT_GOAL:g} s on one core",
            f"{longest:.1f} s",
            longest <= FIT_GOAL,
        ),
        (
            f"its mode at most {ALONE_GOAL:g} nats below the best known",
            f"{lowest:.1f} nats",
            lowest <= ALONE_GOAL,
        ),
    ]


def large_fit_goals(lines):
    """The time of one fit to many samples."""
    seconds = float(number_in(r": (\d+) s \(goal", lines))
    goal = f"a fit of rank 4 at n = 2800, at most {LARGE_FIT_GOAL:g} s"
    return [(goal, f"{seconds:.0f} s", seconds <= LARGE_FIT_GOAL)]


def number_in(pattern, lines):
    """What the pattern finds first."""
    return re.search(pattern, "\n".join(lines)).group(1)


def kronecker_goals(lines):
    """An evaluation for complete data over one eigen-decomposition."""
    rows = {int(line.split()[0]): float(line.split()[4]) for line in lines[1:]}
    ratio = rows[EIGH_N]
    goal = f"value and gradient of complete data, N = {EIGH_N}, at most {EIGH_GOAL:g} "
    return [(f"{goal}times one eigh", f"{ratio:.2f}", ratio <= EIGH_GOAL)]


READERS = {
    "likelihood": likelihood_goals,
    "memory": memory_goals,
    "prediction": prediction_goals,
    "modes": modes_goals,
    "large_fit": large_fit_goals,
    "kronecker": kronecker_goals,
}
