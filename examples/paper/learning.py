"""Section 3: learning in stages, all at once, and as the package does it.

All three have the same data, model and starting values. "staged" is the paper's
heuristic to the letter, "simultaneous" learns all parameters at once from a random task
covariance, and "annealed" is the default of `MultiTaskGPRegressor`.
"""

from measuring import plan
from measuring.data import errors, per_load
from measuring.models import facts, make, timed
from measuring.runner import Experiment, Option, main


def units(arguments, rows):
    """Each draw, rank, joint and learner."""
    return [
        {"n": n, "draw": draw, "joint": joint, "rank": rank, "learning": learning}
        for n in sorted(arguments.sizes)
        for draw in arguments.draws
        for rank in arguments.ranks
        for joint in arguments.joints
        for learning in plan.LEARNERS
    ]


def measure(unit, setting):
    """One way to learn one joint."""
    draw, joint = unit["draw"], unit["joint"]
    data = setting.source.train(draw, per_load(unit["n"]), plan.LOADS, joint)
    options = {"rank": unit["rank"], "learning": unit["learning"]}
    model = make("mGP", setting.max_iter, random_state=draw, **options)
    _, seconds = timed(model.fit, *data)
    scores = errors(model, setting.source, draw, joint, plan.LOADS)
    return [{**facts(model), "fit_seconds": seconds, **scores}]


EXPERIMENT = Experiment(
    name="learning",
    summary=__doc__.splitlines()[0],
    options={
        "sizes": Option((plan.SMALL_N,), (56,), "samples of all 14 loads"),
        "joints": Option(plan.JOINTS, (1, 2), "joints"),
        "draws": Option(plan.DRAWS, (0,), "draws"),
        "ranks": Option(plan.SMALL_RANKS, (2,), "ranks"),
    },
    stages=(units,),
    measure=measure,
)

if __name__ == "__main__":
    main(EXPERIMENT)
