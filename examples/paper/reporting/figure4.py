"""Figure 4: what follows from its rows, and the goals."""

import pandas as pd
from measuring import plan
from measuring.criteria import bic

from .goals import judge
from .markdown import number
from .summaries import over_draws, select

BEST = "mGP-BIC"
OTHERS = ("sGP", "iGP", "pGP")
MODELS = (*OTHERS, BEST)
RELATED = plan.JOINTS[1:]  # the joints whose torques the loads change
SMALL_FACTOR, NATS = 5.0, 0.1


def cases(rows):
    """Each n and draw, in order."""
    return sorted(set(zip(rows["n"], rows["draw"], strict=True)))


def criteria(rows):
    """BIC by rank of each (n, draw) of which all joints are there."""
    found = {}
    for n, draw in cases(rows):
        ranks = bic(select(rows, n=n, draw=draw, model="mGP"), n, plan.JOINTS)
        if len(ranks):
            found[n, draw] = ranks
    return found


def starts(rows):
    """The likelier of iGP and pGP, by (n, draw, joint)."""
    rows = rows[rows["model"].isin(("iGP", "pGP"))]
    wide = rows.pivot(
        index=["n", "draw", "joint"], columns="model", values="log_marginal_likelihood"
    )
    return wide.dropna().idxmax(axis=1) if wide.shape[1] == 2 else pd.Series(dtype=str)


def errors(rows):
    """A row for each n, draw, joint and model, mGP at the common rank alone."""
    parts = [rows[rows["model"].isin(OTHERS)]]
    for (n, draw), ranks in criteria(rows).items():
        rank = ranks.idxmin()
        of_rank = select(rows, n=n, draw=draw, model="mGP", rank=rank)
        parts.append(of_rank.assign(model=BEST))
    return pd.concat(parts, ignore_index=True)


def gains(rows):
    """Likelihood gained from a rank to the next, the smallest of each fit.

    Returns
    -------
    gains : Series
        By n, draw and joint.
    """
    of_ranks = rows[rows["model"] == "mGP"].sort_values("rank")
    groups = of_ranks.groupby(["n", "draw", "joint"])["log_marginal_likelihood"]
    return groups.agg(lambda values: values.diff().min()).dropna()


def factors(rows, subset="extrapolation"):
    """The next best model's error over that of mGP-BIC, by joint and n.

    Returns
    -------
    factors : DataFrame
        With the columns factor, next (its name), pooled (that of pGP) and draws.
    """
    means = over_draws(errors(rows), ["joint", "n"], f"nmse_{subset}", len(MODELS))
    if means.empty:
        empty = pd.MultiIndex.from_tuples([], names=["joint", "n"])
        names = ["factor", "next", "pooled", "draws"]
        return pd.DataFrame(columns=names, index=empty)
    ratios = means[list(OTHERS)].div(means[BEST], axis=0)
    return pd.DataFrame(
        {
            "factor": ratios.min(axis=1),
            "next": ratios.idxmin(axis=1),
            "pooled": ratios["pGP"],
            "draws": means["draws"],
        }
    )


def goals(rows):
    """What is to be reached, at the paper's n."""
    rows = rows[rows["n"].isin(plan.SIZES)]
    found = factors(rows)
    joint, n = (found.index.get_level_values(name) for name in ("joint", "n"))
    related = joint.isin(RELATED)
    return [
        _lowest(found[related]),
        _small_factor(found[related & (n == plan.SMALL_N)]),
        _as_good_as_pooled(found[~related]),
        _second(found[related]),
        _ranks(rows),
        _nested(rows),
    ]


def whole(found, joints, sizes):
    """Whether all cells and draws of the plan are there."""
    return all(
        (joint, n) in found.index
        and found.loc[(joint, n), "draws"] >= len(plan.draws_of(n))
        for joint in joints
        for n in sizes
    )


def _lowest(found):
    text = "Figure 4: mGP-BIC lowest in extrapolation at joints 2 to 6 for every n"
    holds = found["factor"] > 1.0
    measured = f"{holds.sum()} of {len(found)} joints and n" if len(found) else ""
    if len(found):
        measured += f"; {_worst(found['factor'])}"
    return judge(text, measured, holds.all(), whole(found, RELATED, plan.SIZES))


def _small_factor(found):
    text = f"Figure 4, n = {plan.SMALL_N}: by a factor of {SMALL_FACTOR:g} or more "
    text += "over the next"
    measured = _worst(found["factor"]) if len(found) else ""
    holds = (found["factor"] >= SMALL_FACTOR).all()
    return judge(text, measured, holds, whole(found, RELATED, [plan.SMALL_N]))


def _as_good_as_pooled(found):
    text = "Figure 4: at least as good as pGP at joint 1 in extrapolation, for every n"
    what = "pGP's error over mGP-BIC's"
    measured = _worst(found["pooled"], what) if len(found) else ""
    holds = (found["pooled"] >= 1.0).all()
    return judge(text, measured, holds, whole(found, plan.JOINTS[:1], plan.SIZES))


def _second(found):
    text = "Figure 4: iGP usually second in extrapolation at joints 2 to 6"
    n_second = int((found["next"] == "iGP").sum())
    measured = f"{n_second} of {len(found)} joints and n" if len(found) else ""
    complete = whole(found, RELATED, plan.SIZES)
    return judge(text, measured, 2 * n_second > len(found), complete)


def _ranks(rows):
    text = "Figure 4: BIC chooses rank 4 or 5"
    chosen = {case: int(ranks.idxmin()) for case, ranks in criteria(rows).items()}
    counts = pd.Series(list(chosen.values()), dtype=int).value_counts().sort_index()
    measured = ", ".join(
        f"rank {r}: {count} of {len(chosen)}" for r, count in counts.items()
    )
    holds = set(chosen.values()) <= {4, 5}
    planned = {(n, draw) for n in plan.SIZES for draw in plan.draws_of(n)}
    return judge(text, measured, holds, planned <= set(chosen))


def _nested(rows):
    text = f"The likelihood does not fall by more than {NATS:g} nat when the rank "
    text += "grows, on any joint, n and draw"
    found = gains(rows)
    planned = sum(len(plan.draws_of(n)) for n in plan.SIZES) * len(plan.JOINTS)
    measured = ""
    if len(found):
        n, draw, joint = found.idxmin()
        measured = f"smallest gain {number(found.min())} nats (n = {n}, joint {joint}, "
        measured += f"draw {draw}), of {len(found)} fits"
    return judge(text, measured, (found >= -NATS).all(), len(found) >= planned)


def _worst(values, what="factor"):
    """The smallest, and where."""
    joint, n = values.idxmin()
    return f"{what} at least {number(values.min(), 2)} (joint {joint}, n = {n})"
