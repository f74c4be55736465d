"""Table 2: linear regression and a Gaussian process for each load alone.

LR and sGP learn each of the loads c1 to c15 from its own samples, at four numbers of
samples. ``python examples/paper/table2.py --help`` says what can be chosen.
"""

from measuring import plan
from measuring.data import errors
from measuring.models import facts, make, timed
from measuring.runner import Experiment, Option, main

LARGE = 4000  # samples of a load at which the time allows some joints only
MODELS = ("LR", "sGP")


def units(arguments, rows):
    """Each model, joint and load; small sizes first, the printed joint first."""
    return [
        {"model": model, "n_per_load": size, "load": load, "joint": joint, "draw": 0}
        for size in sorted(arguments.sizes)
        for joint in sorted(joints_at(size, arguments), key=printed_first)
        for model in MODELS
        for load in arguments.loads
    ]


def joints_at(size, arguments):
    """Joints that are learned from so many samples."""
    return arguments.joints_4000 if size >= LARGE else arguments.joints


def printed_first(joint):
    """Joint 3 of the paper's table, then the others."""
    return joint != plan.TABLE2_JOINT, joint


def measure(unit, setting):
    """One model of one load."""
    loads, joint, draw = [unit["load"]], unit["joint"], unit["draw"]
    data = setting.source.train(draw, unit["n_per_load"], loads, joint)
    model, seconds = timed(make(unit["model"], setting.max_iter).fit, *data)
    scores = errors(model, setting.source, draw, joint, loads)
    return [{**facts(model), "fit_seconds": seconds, **scores}]


EXPERIMENT = Experiment(
    name="table2",
    summary=__doc__.splitlines()[0],
    options={
        "sizes": Option(plan.TABLE2_SIZES, (4, 8), "samples of each load"),
        "joints": Option(plan.JOINTS, (3, 4), "joints"),
        "joints_4000": Option((plan.TABLE2_JOINT,), (), "joints at 4000 samples"),
        "loads": Option(plan.ALL_LOADS, (1, 2, 3), "loads"),
    },
    stages=(units,),
    measure=measure,
)

if __name__ == "__main__":
    main(EXPERIMENT)
