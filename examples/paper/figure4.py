"""Figure 4: sGP, iGP, pGP and mGP of several ranks on loads c1 to c14.

Every joint is learned from n / 14 samples of each load. The paper selects the samples
of each n independently. Here, within a draw, a larger n includes the samples of a
smaller one, and draws differ in their samples and in their loads. ``page.py`` chooses
the common rank, eq. 8, from the likelihoods.
"""

from measuring import plan
from measuring.data import errors, per_load
from measuring.models import by_rank, facts, make, make_search, timed
from measuring.runner import Experiment, Option, main

MODELS = ("mGP", "sGP", "iGP", "pGP")  # the longest first


def units(arguments, rows):
    """Each n, draw, joint and model; small n first."""
    return [
        {
            **{"n": n, "draw": draw, "joint": joint, "model": model},
            "ranks": plan.ranks_of(n, arguments.ranks),
        }
        for n in sorted(arguments.sizes)
        for draw in plan.draws_of(n, arguments.draws)
        for model in MODELS
        for joint in arguments.joints
    ]


def measure(unit, setting):
    """One model of one joint, or one at each rank."""
    draw, joint = unit["draw"], unit["joint"]
    data = setting.source.train(draw, per_load(unit["n"]), plan.LOADS, joint)
    models, seconds = timed(learn, unit, setting, *data)
    return [
        {
            **{"rank": rank, "fit_seconds": seconds, **facts(model)},
            **errors(model, setting.source, draw, joint, plan.LOADS),
        }
        for rank, model in models
    ]


def learn(unit, setting, X, y):
    """Pairs of a rank, None where there is none, and a model."""
    if unit["model"] == "mGP":
        return list(by_rank(make_search(unit["ranks"], setting.max_iter).fit(X, y)))
    return [(None, make(unit["model"], setting.max_iter).fit(X, y))]


EXPERIMENT = Experiment(
    name="figure4",
    summary=__doc__.splitlines()[0],
    options={
        "sizes": Option(plan.SIZES, (56, 84), "samples of all 14 loads"),
        "joints": Option(plan.JOINTS, plan.JOINTS, "joints"),
        "draws": Option(plan.DRAWS, (0,), "draws; above n = 600 the first alone"),
        "ranks": Option(plan.RANKS, (1, 2), "ranks; at n = 2800 only 4, 5, 6 of them"),
    },
    stages=(units,),
    measure=measure,
)

if __name__ == "__main__":
    main(EXPERIMENT)
