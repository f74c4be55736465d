"""Section 3: the ways to learn, compared."""

from measuring import plan

from .markdown import image, made_by, number, table
from .summaries import geometric_mean

NAMES = {
    "annealed": "annealed, the default",
    "staged": "staged, the paper's section 3",
    "simultaneous": "simultaneous, from a random start",
}
CASE = ["n", "draw", "joint", "rank"]
TIE = 0.1  # nats
TEXT = """\
The same data and models (n = 280, ranks 4 and 5, six joints, three draws) are learned
in three ways. The first is skmtgp's default. The second follows the paper's stages to
the letter. The third learns all parameters at once from a random task covariance, which
the paper found worse. *Nats below the best* is how far a log likelihood is below the
highest of the three.
"""


def compared(rows):
    """Rows of the cases that all learners have, with their nats below the best."""
    learners = rows.groupby(CASE)["learning"].transform("nunique")
    rows = rows[learners == len(plan.LEARNERS)]
    best = rows.groupby(CASE)["log_marginal_likelihood"].transform("max")
    return rows.assign(deficit=best - rows["log_marginal_likelihood"])


def section(rows):
    """The section of the page."""
    text = ["## Learning in stages\n", TEXT, made_by("learning")]
    found = compared(rows)
    if len(found):
        text += [image("paper-learning.png", "likelihood and error of three learners")]
    head = ["learner", "fits", "best", "nats below the best, median", "largest"]
    head += ["evaluations", "seconds", "nMSE interpolation", "nMSE extrapolation"]
    lines = [line(found[found["learning"] == k], k) for k in NAMES]
    note = f"*Best* counts the fits within {TIE:g} nat of the highest likelihood. "
    note += "Evaluations and seconds are medians, and errors are geometric means over "
    note += "joints, ranks and draws.\n"
    return [*text, table(head, lines), note]


def line(rows, learner):
    """Medians of a learner."""
    if rows.empty:
        return [NAMES[learner], 0, *[number(None)] * 7]
    return [
        NAMES[learner],
        len(rows),
        int((rows["deficit"] <= TIE).sum()),
        number(rows["deficit"].median()),
        number(rows["deficit"].max()),
        number(rows["n_evaluations"].median()),
        number(rows["fit_seconds"].median()),
        *(number(geometric_mean(rows[f"nmse_{s}"]), 2) for s in plan.TEST_SETS),
    ]
