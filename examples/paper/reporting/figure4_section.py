"""Figure 4: the section of the page."""

from measuring import plan

from . import published
from .figure4 import MODELS, NATS, cases, criteria, errors, factors, gains, starts
from .markdown import MISSING, error, image, made_by, number, table
from .summaries import grid, over_draws

TEXT = """\
The figures show the average nMSE against the number n of samples of all 14 loads, c1 to
c14. The paper's figure has joints 1 and 4 and gives no numbers. We can only compare
with its words. It finds mGP-BIC favourable in almost all cases, above all in
extrapolation. At joint 1 mGP-BIC is close to pGP. At the other joints iGP is usually
second. Lines are geometric means over the draws, and faint dots are single draws. There
are three draws up to n = 532, and one above.
"""
RANKS = """\
The paper's mGP starts from K_0, the task covariance of iGP (I) or pGP (1 1^T),
whichever is likelier. In the paper iGP was likelier except at joint 1 with n < 532. BIC
is eq. 8 of the paper, summed over the six joints; the table has the difference from its
lowest value. The last column has the ranks that the paper chose. On our trajectories
the torques of all loads mix 4, 5, 5, 4, 4 and 3 functions at joints 1 to 6. The number
is small because the tool does not turn. Then only a load's mass and its first moments
change the torques.
"""


def section(rows):
    """The section of the page."""
    text = ["## Figure 4: the multi-task model\n", TEXT, made_by("figure4")]
    found = errors(rows)
    for subset in reversed(plan.TEST_SETS) if len(found) else ():
        text += [image(f"paper-figure4-{subset}.png", f"nMSE in {subset} against n")]
    text += ["The next best model's nMSE in extrapolation, divided by mGP-BIC's:\n"]
    text += [factors_table(factors(rows))]
    text += means_tables(found)
    text += ["## The rank\n", RANKS, made_by("figure4"), ranks_table(rows)]
    return [*text, *nested(rows), *search_times(rows)]


def factors_table(found):
    """The next best model over mGP-BIC."""

    def cell(joint, n):
        if (joint, n) not in found.index:
            return MISSING
        row = found.loc[(joint, n)]
        return f"{number(row['factor'], 2)} ({row['next']})"

    return by_joint_and_n(found, cell)


def by_joint_and_n(found, cell):
    """A line for each joint, a column for each n."""
    sizes = {*plan.SIZES, *(found.index.unique("n") if len(found) else ())}
    joints = {joint: f"joint {joint}" for joint in plan.JOINTS}
    return grid(joints, {n: f"n = {n}" for n in sorted(sizes)}, cell, "")


def means_tables(found):
    """Errors of all models at the smallest n."""
    models = [m for m in MODELS if (found["model"] == m).any()]
    text = []
    for subset in plan.TEST_SETS if len(found) else ():
        n = found["n"].min()
        of_n = found[found["n"] == n]
        column = f"nmse_{subset}"
        means = over_draws(of_n, ["joint"], column, len(models)).drop(columns="draws")
        cells = means.to_dict()

        def cell(joint, model, cells=cells):
            return error(cells[model].get(joint))

        joints = {joint: f"joint {joint}" for joint in plan.JOINTS}
        text += [f"nMSE at n = {n}, {subset}:\n"]
        text += [grid(joints, {m: m for m in models}, cell, "")]
    return text


def ranks_table(rows):
    """Who won, BIC of each rank, the rank that is chosen."""
    found, won = criteria(rows), starts(rows)
    ranks = sorted({*plan.RANKS}.union(*(values.index for values in found.values())))
    head = ["n", "draw", "K_0 is iGP at joints", "pGP at joints"]
    head += [*(f"r = {r}" for r in ranks), "chosen", "paper's"]
    lines = [
        [n, draw, *winners(won, n, draw), *criterion(found.get((n, draw)), ranks)]
        + [published.RANKS.get(n, "-")]
        for n, draw in cases(rows)
    ]
    return table(head, lines)


def winners(won, n, draw):
    """Joints of iGP and of pGP."""
    for name in ("iGP", "pGP"):
        joints = [j for (*case, j), m in won.items() if (*case, m) == (n, draw, name)]
        yield " ".join(map(str, joints)) or "-"


def criterion(values, ranks):
    """BIC of each rank less the lowest, and the rank that has it."""
    if values is None:
        return [MISSING] * (len(ranks) + 1)
    above = values - values.min()
    cells = [f"{above[r]:.0f}" if r in above.index else "-" for r in ranks]
    return [*cells, f"**{values.idxmin()}**"]


def nested(rows):
    """How the likelihood grows with the rank."""
    found = gains(rows)
    text = "A model of a higher rank contains those of lower ranks. "
    if found.empty:
        return [text + "Their likelihoods are missing.\n"]
    n, draw, joint = found.idxmin()
    text += "So its log likelihood should not be lower. From one rank to the next, the "
    text += f"smallest gain is {number(found.min())} nats (n = {n}, draw {draw}, joint "
    lose = (found < -NATS).sum()
    text += f"{joint}); {lose} of {len(found)} fits lose more than {NATS:g} nat.\n"
    smallest = found.groupby(["joint", "n"]).min()

    def cell(joint, n):
        return number(smallest.get((joint, n)))

    title = "The smallest gain from a rank to the next, in nats, over the draws:\n"
    return [text, title, by_joint_and_n(smallest, cell)]


def search_times(rows):
    """How long the search over the ranks takes."""
    of_search = rows[rows["model"] == "mGP"]
    if of_search.empty:
        return []
    by = of_search.groupby(["n", "draw", "joint"])
    seconds, counts = by["fit_seconds"].first(), by["rank"].count()
    lines = [
        [n, counts[n].max(), len(of_n), *(f"{m:.1f}" for m in minutes(of_n))]
        for n, of_n in seconds.groupby("n")
    ]
    head = ["n", "ranks", "searches", "minutes of one, median", "largest"]
    title = "Minutes of one core that the search over the ranks of a joint takes:\n"
    return [title, table([*head, "six joints on two cores, about"], lines)]


def minutes(seconds):
    """The median, the largest, and half of six times the mean."""
    return seconds.median() / 60, seconds.max() / 60, seconds.mean() * 6 / 2 / 60
