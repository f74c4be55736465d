"""What follows from the results: medians, ratios, goals reached and missed."""

from statistics import median

import numpy as np

OURS = "skmtgp"
NAMES = {
    "skmtgp": "skmtgp",
    "gpytorch": "GPyTorch",
    "botorch": "BoTorch",
    "gpy": "GPy",
    "gpflow": "GPflow",
    "sklearn": "scikit-learn",
}
SPEED_GOALS = {"gpy": 3.5, "gpytorch": 5.0, "sklearn": 25.0}
GOAL_N, SMALL_N = 2800, 280
TIME_GOAL, ERROR_GOAL = 5.0, 10.0


def label(row):
    """Name of a row's package and settings."""
    name = NAMES[row["package"]]
    alone = row["package"] == OURS and row["settings"] == "best"
    return name if alone else f"{name}, {row['settings']}"


def variants(rows):
    """The pairs of package and settings, this package first."""
    order = list(NAMES)
    pairs = {(r["package"], r["settings"]) for r in rows}
    return sorted(pairs, key=lambda p: (order.index(p[0]), p[1]))


def of_variant(rows, package, settings):
    """The rows of a package with its settings."""
    return [r for r in rows if (r["package"], r["settings"]) == (package, settings)]


def problem_of(row):
    """The problem that a fit is of."""
    return row["n"], row["joint"], row["draw"]


def usable(rows):
    """The fits that came to an end with a model."""
    return [row for row in rows if "likelihood" in row]


def our_fits(rows):
    """The fits of skmtgp at its best, the peers' model, by problem."""
    return {problem_of(r): r for r in of_variant(usable(rows), OURS, "best")}


def passed_after(ours, likelihood):
    """Seconds after which this package's fit had a likelihood; None if never."""
    for seconds, value in ours["trace"]:
        if value >= likelihood:
            return seconds
    return None


def reached_after(row):
    """Seconds after which a fit had found its own best likelihood."""
    return row["trace"][-1][0] if row.get("trace") else row["seconds"]


def against_ours(rows):
    """The peers' fits, each with its deficit and the times compared.

    Adds `deficit` (nats), `lead` (the same, or by the peer's own score where that is
    higher), `passed` (seconds, None if never), `times` (its seconds over `passed`, 0 if
    never) and `error_ratio` (its extrapolation error over ours).
    """
    ours, found = our_fits(rows), []
    for row in usable(rows):
        mine = ours.get(problem_of(row))
        if row["package"] == OURS or mine is None:
            continue
        passed = passed_after(mine, row["likelihood"])
        found.append(
            {
                **row,
                "deficit": mine["likelihood"] - row["likelihood"],
                "lead": mine["likelihood"] - highest_score(row),
                "passed": passed,
                "times": reached_after(row) / passed if passed else 0.0,
                "error_ratio": row["nmse_extrapolation"] / mine["nmse_extrapolation"],
            }
        )
    return found


def highest_score(row):
    """A peer's likelihood by the reference, or its own at its best, if that is higher.

    Where its parameters leave K singular, the reference adds jitter, which costs nats.
    As shipped, a package's own score may count priors.
    """
    own = row.get("own_likelihood") if row["settings"] == "best" else None
    return row["likelihood"] if own is None else max(row["likelihood"], own)


def summary(rows, n):
    """Medians over joints and draws, a row for each package and settings."""
    best = our_fits(rows)
    ours = [
        {
            **r,
            "deficit": best[problem_of(r)]["likelihood"] - r["likelihood"],
            "passed": None,
        }
        for r in usable(rows)
        if r["n"] == n and r["package"] == OURS and problem_of(r) in best
    ]
    rows = ours + [r for r in against_ours(rows) if r["n"] == n]
    table = []
    for package, settings in variants(rows):
        group = of_variant(rows, package, settings)
        never = package != OURS and any(r["passed"] is None for r in group)
        passed = [r["passed"] for r in group if r["passed"] is not None]
        table.append(
            {
                "package": package,
                "settings": settings,
                "fits": len(group),
                **{k: median(r[k] for r in group) for k in MEDIANS},
                "passed": median(passed) if passed and not never else None,
                "at_budget": sum(r["stop"] == "budget" for r in group),
            }
        )
    return table


MEDIANS = (
    "likelihood",
    "deficit",
    "evaluations",
    "seconds",
    "nmse_interpolation",
    "nmse_extrapolation",
)


def goals(fits, timings):
    """The goals of the comparison: what was wanted, what was found, whether reached.

    Returns
    -------
    goals : list of (str, str, bool or None)
        None where nothing has been measured.
    """
    return [
        *speed_goals(timings),
        likelihood_goal(fits),
        time_goal(fits),
        error_goal(fits),
    ]


def speed_goals(timings):
    """An evaluation at n = 2800 against each peer at its best."""
    found = []
    times = {
        r["package"]: r["seconds"]
        for r in timings
        if r["n"] == GOAL_N and r["settings"] == "best" and "seconds" in r
    }
    for package, factor in SPEED_GOALS.items():
        goal = f"an evaluation at n = {GOAL_N}, {factor:g} times faster than "
        goal += f"{NAMES[package]}'s at its best"
        if OURS in times and package in times:
            ratio = times[package] / times[OURS]
            found.append((goal, f"{ratio:.1f} times", ratio >= factor))
        else:
            found.append((goal, "not measured", None))
    return found


def likelihood_goal(fits):
    """The highest likelihood on every joint, n and draw."""
    goal = "the highest likelihood on every joint, n and draw"
    rows = against_ours(fits)
    if not rows:
        return goal, "not measured", None
    worst = {}
    for row in rows:
        key = problem_of(row)
        worst[key] = min(worst.get(key, np.inf), row["lead"])
    won = sum(lead >= 0.0 for lead in worst.values())
    text = (
        f"{won} of {len(worst)} problems; smallest lead {min(worst.values()):.1f} nats"
    )
    behind = shipped_behind(fits)
    if behind:
        text += (
            f"; as shipped, whose K^rho has no diagonal, behind a peer on {len(behind)}"
            f" (joint {', '.join(map(str, sorted({joint for _, joint, _ in behind})))})"
        )
    return goal, text, won == len(worst)


def shipped_behind(fits):
    """The problems on which a peer has a higher likelihood than skmtgp as shipped."""
    ours = of_variant(usable(fits), OURS, "shipped")
    peers = {}
    for row in usable(fits):
        if row["package"] != OURS:
            key = problem_of(row)
            peers[key] = max(peers.get(key, -np.inf), highest_score(row))
    return [
        problem_of(row)
        for row in ours
        if row["likelihood"] < peers.get(problem_of(row), -np.inf)
    ]


def time_goal(fits):
    """The best likelihood of each peer passed in a fifth of its time."""
    goal = f"each peer's best passed in 1/{TIME_GOAL:g} of the time that it took"
    rows = [r for r in against_ours(fits) if r["settings"] == "best"]
    if not rows:
        return goal, "not measured", None
    reached = sum(r["times"] >= TIME_GOAL for r in rows)
    middle = median(r["times"] for r in rows)
    ended = sum(r["stop"] == "budget" for r in rows)
    text = (
        f"{reached} of {len(rows)} fits; median 1/{middle:.1f}; {ended} of them were "
    )
    return goal, f"{text}ended by their budget", reached == len(rows)


def error_goal(fits):
    """Extrapolation error against the best peer's on the median joint."""
    goal = f"extrapolation error at n = {SMALL_N}, {ERROR_GOAL:g} times lower than the "
    goal += "best peer's on the median joint"
    ratios = best_error_ratios(fits)
    if not ratios:
        return goal, "not measured", None
    by_joint = {}
    for (_, joint, _), ratio in ratios.items():
        by_joint.setdefault(joint, []).append(ratio)
    middle = median(median(of_joint) for of_joint in by_joint.values())
    return goal, f"{middle:.1f} times", middle >= ERROR_GOAL


def best_error_ratios(fits):
    """The lowest extrapolation error of all peers over ours, by problem."""
    ratios = {}
    for row in against_ours(fits):
        if row["n"] == SMALL_N:
            key = problem_of(row)
            ratios[key] = min(ratios.get(key, np.inf), row["error_ratio"])
    return ratios


def missed(fits):
    """The problems on which a peer found a higher likelihood."""
    return [r for r in against_ours(fits) if r["lead"] < 0.0]


def jittered(fits):
    """The best fits whose parameters leave K singular for the reference."""
    rows = [r for r in against_ours(fits) if r["settings"] == "best"]
    return [r for r in rows if r.get("jitter")]
