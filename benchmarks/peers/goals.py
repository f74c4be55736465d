"""What was to be reached, for those who develop the package: benchmarks/README.md."""

from compare import TIME_GOAL, against_ours, goals, label, missed, problem_of
from markup import number, table
from own_goals import own_goals

WORDS = {True: "yes", False: "**no**", None: "not measured"}


def goals_text(results):
    """Tables of goals, and where they are missed."""
    parts = [
        "Against the other packages:\n",
        goals_table(goals(results.fits, results.timings)),
        *missed_section(results.fits),
        *slow_section(results.fits),
        *of("The whole training set", results.sparse.goals()),
        *of("The engine alone", own_goals(results.folder)),
    ]
    return "\n".join(parts).rstrip("\n")


def goals_table(found):
    """Goals, what was measured, whether they are reached."""
    rows = [(goal, measured, WORDS[ok]) for goal, measured, ok in found]
    return table(["goal", "measured", "reached"], rows, "---")


def of(title, found):
    """Goals of a part, if it has been measured."""
    return [f"{title}:\n", goals_table(found)] if found else []


def missed_section(fits):
    """The problems on which a peer found a higher likelihood."""
    rows = [(*problem_of(r), label(r), number(-r["lead"])) for r in missed(fits)]
    head = ["n", "joint", "draw", "package", "nats above skmtgp"]
    return (
        ["A peer found a higher likelihood here:\n", table(head, rows)] if rows else []
    )


def slow_section(fits):
    """The fits that skmtgp passed, but not soon enough."""
    slow = [
        (*problem_of(r), label(r), number(r["times"]))
        for r in against_ours(fits)
        if 0.0 < r["times"] < TIME_GOAL and r["settings"] == "best"
    ]
    head = ["n", "joint", "draw", "package", "times"]
    title = f"Passed, but not {TIME_GOAL:g} times sooner:\n"
    return [title, table(head, slow)] if slow else []
