"""Section 3.3: load c15 joins a model of c1 to c14 with a few samples.

`add_task` learns only the new row and column of the task covariance. It is compared
with sGP, which only knows the samples of c15, and with learning all 15 loads again. BIC
over the joints, eq. 8, chooses the rank. `add_task` is measured at every rank of the
search, so that the choice can come last, and the refit at the chosen rank.
"""

from functools import partial

import numpy as np
from measuring import plan
from measuring.criteria import bic
from measuring.data import errors, per_load
from measuring.models import by_rank, facts, make, make_search, timed
from measuring.runner import Experiment, Option, main
from measuring.store import measured

from skmtgp import add_task


def first_units(arguments, rows):
    """What does not need the rank."""
    return [
        {**case, "joint": joint, "model": model, **chosen(arguments)}
        for case in cases(arguments)
        for model in ("add_task", "sGP")
        for joint in arguments.joints
    ]


def last_units(arguments, rows):
    """Learning anew at the rank that BIC chooses, where all joints are known."""
    units = []
    for case in cases(arguments):
        rank = common_rank(rows, case, arguments.joints)
        if rank is None:
            print(f"novel_task: no rank for {case}, as joints are missing")
            continue
        more = {"model": "refit", "rank": rank, **chosen(arguments)}
        units += [{**case, "joint": joint, **more} for joint in arguments.joints]
    return units


def cases(arguments):
    """Each n and draw."""
    return [{"n": n, "draw": d} for n in arguments.sizes for d in arguments.draws]


def chosen(arguments):
    """Settings that all units share."""
    return {"samples": arguments.samples, "ranks": arguments.ranks}


def common_rank(rows, case, joints):
    """The rank with the lowest BIC; None until all joints are there."""
    wanted = {**case, "model": "add_task", "n_new": 0}
    rows = measured(rows)
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    criterion = bic(rows, case["n"], joints)
    return int(criterion.idxmin()) if len(criterion) else None


def measure(unit, setting):
    """One model of one joint, with each number of samples of the new load."""
    draw, joint = unit["draw"], unit["joint"]
    train = partial(setting.source.train, draw, joint=joint)
    known = train(per_load(unit["n"]), plan.LOADS)
    X, y = train(max(unit["samples"]), [plan.NEW_LOAD])
    new = {k: (X[:k], y[:k]) for k in unit["samples"]}
    rows = []
    for row, model in MEASURES[unit["model"]](unit, setting, known, new):
        if row["n_new"]:
            loads = [plan.NEW_LOAD]
            row |= errors(model, setting.source, draw, joint, loads)
        rows.append({**facts(model), **row})
    return rows


def add_tasks(unit, setting, known, new):
    """The model without the new load (n_new = 0) and with it, at each rank."""
    search = make_search(unit["ranks"], setting.max_iter)
    _, seconds = timed(search.fit, *known)
    for rank, model in by_rank(search):
        yield {"rank": rank, "n_new": 0, "fit_seconds": seconds}, model
        for n_new, data in new.items():
            extended, seconds_of_border = timed(add_task, model, *data)
            row = {"rank": rank, "n_new": n_new, "fit_seconds": seconds_of_border}
            yield row, extended


def alone(unit, setting, known, new):
    """A Gaussian process of the new load's samples."""
    for n_new, data in new.items():
        model, seconds = timed(make("sGP", setting.max_iter).fit, *data)
        yield {"n_new": n_new, "fit_seconds": seconds}, model


def anew(unit, setting, known, new):
    """All loads learned together, at the common rank."""
    for n_new, data in new.items():
        both = [np.concatenate(parts) for parts in zip(known, data, strict=True)]
        model = make("mGP", setting.max_iter, rank=unit["rank"])
        _, seconds = timed(model.fit, *both)
        yield {"rank": unit["rank"], "n_new": n_new, "fit_seconds": seconds}, model


MEASURES = {"add_task": add_tasks, "sGP": alone, "refit": anew}

EXPERIMENT = Experiment(
    name="novel_task",
    summary=__doc__.splitlines()[0],
    options={
        "sizes": Option((plan.SMALL_N,), (56,), "samples of all 14 loads"),
        "samples": Option(plan.NEW_SAMPLES, (1, 2, 4), "samples of the new load"),
        "joints": Option(plan.JOINTS, plan.JOINTS, "joints"),
        "draws": Option(plan.DRAWS, (0,), "draws"),
        "ranks": Option(plan.NOVEL_RANKS, (1, 2), "ranks that BIC chooses from"),
    },
    stages=(first_units, last_units),
    measure=measure,
)

if __name__ == "__main__":
    main(EXPERIMENT)
