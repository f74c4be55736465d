"""Tasks with levels, units and precisions of their own: errors of the defaults.

``python benchmarks/levels_and_units.py`` prints, for each kind of data, the error of
the package's defaults beside that of the paper's settings (``task_levels=False,
normalize_y="shared", noise="shared"``), of the baselines, and of what can be had by
hand: each task centred or standardised, noise per task, the true levels subtracted.
Models "by hand" have the paper's settings. The defaults are held against a goal.
``--only`` runs some of them, ``--seeds`` fewer draws or more. The data are drawn, but
for

- "jura": metals in the soil, from the folder ``--data``, which has jura/jura.csv. It is
  no part of this repository, and left out where it is not given;
- "puma": torques of the Puma 560, n = 280, three draws; ``--joints`` says of which.
  All defaults, and the paper's settings at rank 4, are held against the fits of the
  package's first version at rank 4 (results/fits.jsonl), by the medians of the draws,
  as the page of benchmarks has them.

levels_data.py says how the others are drawn. Seconds are the processor's.
"""

import argparse
import inspect
import json
import time
import warnings
from functools import partial
from pathlib import Path

import levels_data
import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from threadpoolctl import threadpool_limits

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import fetch_puma560
from skmtgp.exceptions import (
    JitterWarning,
    PrecisionWarning,
    UnidentifiedNoiseWarning,
)
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.metrics import normalized_mean_squared_error
from skmtgp.model_selection import TaskStratifiedKFold

PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
EXPECTED = (
    ConvergenceWarning,
    JitterWarning,
    PrecisionWarning,
    UnidentifiedNoiseWarning,
)
RESULTS = Path(__file__).parent / "results"
LOADS, N_PER_LOAD, TEST_ROWS = range(1, 15), 20, 2000
SUBSETS = "interpolation", "extrapolation"


def has(name, estimator=MultiTaskGPRegressor):
    """Whether an estimator has a parameter: the script runs before they exist, too."""
    return name in inspect.signature(estimator).parameters


def paper(estimator=MultiTaskGPRegressor, **params):
    """An estimator with the paper's settings, as far as it has them.

    Where it is held against the defaults it has full rank.
    """
    known = PAPER if has("task_levels") else {"noise": "shared"}
    known = {name: value for name, value in known.items() if has(name, estimator)}
    return estimator(**{**known, **params})


class Section:
    """What is printed of one kind of data, line by line.

    Parameters
    ----------
    name, data, measure : str
        What it is.
    """

    verdicts = []  # of all sections

    def __init__(self, name, data, measure):
        self.name = name
        print(f"\n{name}: {data}\n{'':2}{measure}", flush=True)

    def line(self, label, measure, goal=None):
        """Measure, print it with the seconds and whether the goal is met."""
        begin = time.process_time()
        value = measure()
        seconds = time.process_time() - begin
        shown = "" if goal is None else f"   {self.judge(label, value, goal)}"
        print(f"{'':2}{label:<52}{value:>12.4g}{seconds:>8.1f} s{shown}", flush=True)
        return value

    def judge(self, label, value, goal):
        """Keep whether a goal is met, by the digits that are shown, for the end."""
        limit, sign = goal
        shown = sign * float(f"{value:.4g}"), sign * float(f"{limit:.4g}")
        met = "met" if shown[0] <= shown[1] else "NOT MET"
        goal = f"at {'most' if sign > 0 else 'least'} {limit:.4g}"
        self.verdicts.append((self.name, label, f"{value:.4g}", goal, met))
        return f"goal {goal}: {met}"

    def note(self, text):
        """Print something else."""
        print(f"{'':2}{text}", flush=True)


def at_most(value):
    """A goal of an error."""
    return value, 1


def at_least(value):
    """A goal of a likelihood or an explained variance."""
    return value, -1


def sites(arguments):
    """Levels, levels 50 times larger, units."""
    section = Section(
        "sites",
        "six sites, levels from -5 to 40, signals of deviation 1.5, 300 rows",
        "nMSE per task of 5 folds",
    )
    variants = {
        "as they are": levels_data.sites(),
        "levels 50 times larger": levels_data.sites(times=50.0),
        "units from 1 to 1000": levels_data.sites(units=True),
    }
    firsts = {}
    for name, (X, y) in variants.items():
        section.note(f"{name}:")
        for rank in (None, 2):
            goal, label = 0.09, "defaults" + ("" if rank is None else f", rank {rank}")
            if rank in firsts:
                goal = min(goal, 1.01 * firsts[rank])
            measure = partial(folds, MultiTaskGPRegressor(rank=rank), X, y)
            value = section.line(label, measure, at_most(goal))
            firsts.setdefault(rank, value)
        others = {
            "the paper's settings": paper(rank=6),
            "the paper's settings, rank 2": paper(rank=2),
            "IndependentGP": IndependentGP(),
            "IndependentGP, the paper's settings": paper(IndependentGP),
            "PooledGP": PooledGP(),
            "SingleTaskGP": SingleTaskGP(),
        }
        for label, model in others.items():
            section.line(label, partial(folds, model, X, y))
        by_hand = {"centred": center, "standardised": standardize}
        for label, prepare in by_hand.items():
            measure = partial(folds, paper(rank=2), X, y, prepare)
            section.line(f"{label} by hand, rank 2", measure)


def keep(y, tasks):
    """Levels of 0 and scales of 1."""
    return np.zeros(tasks.max() + 1), np.ones(tasks.max() + 1)


def center(y, tasks):
    """The average of each task, and scales of 1."""
    counts = np.bincount(tasks)
    return np.bincount(tasks, y) / counts, np.ones(len(counts))


def standardize(y, tasks):
    """Average and deviation of each task."""
    level, _ = center(y, tasks)
    return level, np.sqrt(center((y - level[tasks]) ** 2, tasks)[0])


def predict(model, X, y, X_test, prepare=keep):
    """Predictions of a model that learns from targets prepared by hand."""
    tasks, test = X[:, -1].astype(int), X_test[:, -1].astype(int)
    level, scale = prepare(y, tasks)
    model = clone(model).fit(X, (y - level[tasks]) / scale[tasks])
    return level[test] + scale[test] * model.predict(X_test)


def folds(model, X, y, prepare=keep):
    """NMSE per task of predictions of five folds."""
    mean = np.empty_like(y)
    for train, test in TaskStratifiedKFold(5, shuffle=True, random_state=0).split(X):
        mean[test] = predict(model, X[train], y[train], X[test], prepare)
    return normalized_mean_squared_error(y, mean, tasks=X[:, -1])


def by_draws(draws, model, error, prepare=keep):
    """Median of the errors over the draws."""
    values = []
    for draw in draws:
        by_hand = partial(prepare, draw) if prepare is true_levels else prepare
        mean = predict(model, draw.X, draw.y, draw.X_test, by_hand)
        values.append(error(draw, mean))
    return np.median(values)


def true_levels(draw, y, tasks):
    """The true levels, and scales of 1."""
    return draw.levels, np.ones(len(draw.levels))


def squared_error(draw, mean):
    """Mean squared error of f."""
    return np.mean((mean - draw.f_test) ** 2)


def short(arguments):
    """Many short tasks."""
    n = arguments.seeds or 30
    section = Section(
        "short",
        f"12 tasks of 8 rows, levels of deviation 4, {n} draws",
        "median of the mean squared error of f",
    )
    draws = [levels_data.short_tasks(seed) for seed in range(n)]

    def line(label, model, prepare=keep, goal=None):
        section.line(
            label, partial(by_draws, draws, model, squared_error, prepare), goal
        )

    line("defaults", MultiTaskGPRegressor(), goal=at_most(0.03))
    line("defaults, rank 2", MultiTaskGPRegressor(rank=2))
    line("the paper's settings", paper(rank=12))
    line("the paper's settings, rank 2", paper(rank=2))
    line("IndependentGP", IndependentGP())
    line("PooledGP", PooledGP())
    line("SingleTaskGP", SingleTaskGP())
    line("own averages off by hand", paper(rank=12), center)
    line("own averages off by hand, rank 2", paper(rank=2), center)
    line("true levels off by hand", paper(rank=12), true_levels)
    line("true levels off by hand, rank 2", paper(rank=2), true_levels)
    line("defaults, noise per task", MultiTaskGPRegressor(noise="per_task"))


def jura(arguments):
    """Metals of different units."""
    section = Section(
        "jura",
        "Cd, Ni and Zn as tasks, Cd at the 100 validation sites",
        "mean absolute error in ppm",
    )
    if arguments.data is None or not (arguments.data / "jura" / "jura.csv").exists():
        section.note("left out: --data FOLDER, with jura/jura.csv, is not given")
        return
    models = {
        "the paper's settings": paper(rank=3, task_feature="task"),
        "the paper's settings, noise per task": paper(
            rank=3, task_feature="task", noise="per_task"
        ),
        "IndependentGP": IndependentGP(task_feature="task"),
        "PooledGP": PooledGP(task_feature="task"),
        "SingleTaskGP": SingleTaskGP(task_feature="task"),
    }
    by_hand = {
        "standardised by hand": paper(rank=3, task_feature="task"),
        "standardised by hand, noise per task": paper(
            rank=3, task_feature="task", noise="per_task"
        ),
    }
    for logarithms, goal in ((False, 0.46), (True, 0.405)):
        section.note("logarithms, the error of exp:" if logarithms else "ppm:")
        data = levels_data.jura(arguments.data, logarithms=logarithms)
        error = partial(jura_error, *data, logarithms)
        model = MultiTaskGPRegressor(task_feature="task")
        section.line("defaults", partial(error, model), at_most(goal))
        if not logarithms:
            inside = clone(model).set_params(target_transform=(np.log, np.exp))
            section.line("defaults, logarithms inside", partial(error, inside))
        for label, model in models.items():
            section.line(label, partial(error, model))
        for label, model in by_hand.items():
            section.line(label, partial(error, model, by_hand=True))


def jura_error(X, y, new, truth, logarithms, model, *, by_hand=False):
    """Mean absolute error of Cd, in ppm."""
    level, scale = 0.0, 1.0
    if by_hand:
        of_task = y.groupby(X["task"])
        y = (y - of_task.transform("mean")) / of_task.transform("std")
        level, scale = of_task.mean()["Cd"], of_task.std()["Cd"]
    mean = level + scale * model.fit(X, y).predict(new)
    return np.abs((np.exp(mean) if logarithms else mean) - truth).mean()


def sensors(arguments):
    """Tasks of different precision."""
    n = arguments.seeds or 5
    section = Section(
        "sensors",
        f"300 precise rows and 30 of 100 times the noise variance, {n} draws",
        "median of the nMSE of f of the second sensor",
    )
    for unit in (1.0, 100.0):
        section.note(
            f"the second in a unit that makes its numbers {unit:g} times larger:"
        )
        draws = [levels_data.sensors(seed, unit) for seed in range(n)]

        def line(label, model, prepare=keep, goal=None, draws=draws):
            measure = partial(by_draws, draws, model, nmse_of_last, prepare)
            return section.line(label, measure, goal)

        best = line("defaults, noise per task", MultiTaskGPRegressor(noise="per_task"))
        by_hand = paper(rank=2, noise="per_task")
        if unit == 1.0:
            best = min(best, line("the paper's settings, noise per task", by_hand))
        else:
            line("the paper's settings, noise per task", by_hand)
        line("defaults", MultiTaskGPRegressor(), goal=at_most(1.05 * best))
        line("the paper's settings", paper(rank=2))
        line("IndependentGP", IndependentGP())
        line("SingleTaskGP", SingleTaskGP())
        line("standardised by hand", paper(rank=2), standardize)
        line("standardised by hand, noise per task", by_hand, standardize)


def nmse_of_f(draw, mean):
    """NMSE of f, averaged over tasks."""
    return normalized_mean_squared_error(draw.f_test, mean, tasks=draw.tasks_test)


def nmse_of_last(draw, mean):
    """NMSE of f of the last task."""
    last = draw.tasks_test == draw.tasks_test.max()
    return normalized_mean_squared_error(draw.f_test[last], mean[last])


def schools(arguments):
    """Very many tasks of a handful of rows."""
    n = arguments.seeds or 1
    section = Section(
        "schools",
        f"139 levels around one function of 27 inputs, 5 rows each, {n} draw(s)",
        "explained variance of f, per cent",
    )
    draws = [levels_data.schools(seed) for seed in range(n)]

    def line(label, model, prepare=keep, goal=None, draws=draws):
        measure = partial(by_draws, draws, model, explained, prepare)
        return section.line(label, measure, goal)

    line("PooledGP", PooledGP())
    flat = [one_hot(draw) for draw in draws]
    best = line("PooledGP, a level of each by hand", leveled(), draws=flat)
    line("PooledGP, true levels off by hand", PooledGP(), true_levels)
    if has("shared"):
        goal = at_least(best)
        line(
            "rank 0, a shared function",
            MultiTaskGPRegressor(rank=0, shared=True),
            goal=goal,
        )
        line("RankSearchIC()", RankSearchIC(), goal=goal)
    else:
        section.note("rank 0 and RankSearchIC: no `shared` yet")
    line("the paper's settings, rank 1", paper(rank=1))
    if arguments.long:
        line("the paper's settings, rank 2", paper(rank=2))


def explained(draw, mean):
    """Explained variance of f, in per cent."""
    return 100.0 * (1.0 - squared_error(draw, mean) / draw.f_test.var())


def one_hot(draw):
    """The same data with a column for each task before the column of the task."""

    def wide(X):
        tasks = X[:, -1].astype(int)
        return np.column_stack([X[:, :-1], np.eye(len(draw.levels))[tasks], tasks])

    return draw._replace(X=wide(draw.X), X_test=wide(draw.X_test))


def leveled():
    """PooledGP with a level of each of 139 tasks in its kernel."""
    smooth = ConstantKernel() * RBF(np.full(27, 5.0), (1e-1, 1e4))
    linear = ConstantKernel(0.1) * ARDLinear(
        1.0, 0.0, weights_bounds="fixed", bias_bounds="fixed"
    )
    return PooledGP(
        Columns(smooth, list(range(27))) + Columns(linear, list(range(27, 27 + 139)))
    )


def confounded(arguments):
    """Tasks whose means are confounded with x."""
    n = arguments.seeds or 15
    section = Section(
        "confounded",
        f"six tasks of 20 rows, seen in different ranges of x, {n} draws",
        "median of the nMSE of f over all x, averaged over tasks",
    )
    designs = {
        "one trend": {},
        "one trend, own levels": {"own_levels": True},
        "two tasks seen in summer alone": {"season": True},
        "two tasks seen in summer alone, own levels": {
            "season": True,
            "own_levels": True,
        },
    }
    for name, design in designs.items():
        section.note(f"{name}:")
        draws = [levels_data.confounded(seed, **design) for seed in range(n)]

        def line(label, model, prepare=keep, goal=None, draws=draws):
            measure = partial(by_draws, draws, model, nmse_of_f, prepare)
            return section.line(label, measure, goal)

        for rank in (None, 2):
            suffix = "" if rank is None else f", rank {rank}"
            before = line(f"the paper's settings{suffix}", paper(rank=rank or 6))
            model = MultiTaskGPRegressor(rank=rank)
            line(f"defaults{suffix}", model, goal=at_most(1.05 * before))
        line("IndependentGP", IndependentGP())
        line("own averages off by hand", paper(rank=6), center)
        line("the truth: PooledGP without the true levels", PooledGP(), true_levels)


def puma(arguments):
    """Torques without noise, whose levels are part of the functions."""
    n = arguments.seeds or 3
    section = Section(
        "puma",
        f"Puma 560, n = 280, {n} draws",
        "log likelihood (targets of variance one); nMSE inter- and extrapolation",
    )
    draws = [[puma_rows(of, seed) for of in ("train", *SUBSETS)] for seed in range(n)]
    models = {
        "the paper's settings, rank 4": paper(rank=4),
        "all defaults": MultiTaskGPRegressor(),
    }
    if arguments.long:
        models["defaults, rank 4"] = MultiTaskGPRegressor(rank=4)
    for joint in arguments.joints:
        section.note(f"joint {joint}:")
        stored = [puma_before(joint, seed) for seed in range(n)]
        medians = {"before": np.median(stored, axis=0)}
        for label, model in models.items():
            fits = [puma_line(section, label, model, data, joint) for data in draws]
            medians[label] = np.median(fits, axis=0)
        first, second, *_ = models
        before = medians["before"]
        section.judge(
            f"joint {joint}, nats, {first}", *puma_least(medians[first], before)
        )
        section.judge(
            f"joint {joint}, nats, {second}", *puma_least(medians[second], before)
        )
        for k, subset in enumerate(SUBSETS, 1):
            goal = at_most(1.5 * before[k])
            section.judge(
                f"joint {joint}, {subset}, {second}", medians[second][k], goal
            )


def puma_rows(subset, seed):
    """Inputs with the load, and the torques, as benchmarks/peers draws them."""
    n = N_PER_LOAD if subset == "train" else TEST_ROWS
    return fetch_puma560(
        subset=subset, n_per_load=n, loads=LOADS, random_state=seed, return_X_y=True
    )


def puma_line(section, label, model, data, joint):
    """Learn and print: log likelihood of scaled torques, errors of both test sets."""
    (X, y), *tests = [(X, y[:, joint - 1]) for X, y in data]
    begin = time.process_time()
    pipeline = make_inverse_dynamics_regressor(clone(model)).fit(X, y)
    seconds = time.process_time() - begin
    model = pipeline[-1]
    likelihood = model.log_marginal_likelihood_value_ + len(y) * np.log(y.std())
    errors = [
        normalized_mean_squared_error(
            y_test, pipeline.predict(X_test), tasks=X_test[:, -1]
        )
        for X_test, y_test in tests
    ]
    line = f"{label:<40}{likelihood:>12.1f}{errors[0]:>12.2e}{errors[1]:>12.2e}"
    form = str(model._likelihoods[0].prior.task_covariance)
    section.note(f"{line}{seconds:>8.1f} s   {form}, {model.normalize_y_} units")
    return likelihood, *errors


def puma_least(found, before):
    """The likelihood, and the goal that it is at most 5 nats lower than before."""
    return found[0], at_least(before[0] - 5.0)


def puma_before(joint, draw):
    """Likelihood and errors at rank 4 that results/fits.jsonl has."""
    wanted = {"package": "skmtgp", "settings": "shipped", "n": 280}
    wanted |= {"draw": draw, "joint": joint}
    with (RESULTS / "fits.jsonl").open() as file:
        rows = [json.loads(line) for line in file]
    row = [row for row in rows if wanted.items() <= row.items()][-1]  # which counts
    return row["likelihood"], *(row[f"nmse_{subset}"] for subset in SUBSETS)


PARTS = {
    f.__name__: f for f in (sites, short, jura, sensors, schools, confounded, puma)
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seeds", type=int, help="draws, where they are averaged")
    parser.add_argument("--data", type=Path, help="folder with jura/jura.csv")
    parser.add_argument("--joints", type=int, nargs="+", default=range(1, 7))
    parser.add_argument(
        "--long",
        action="store_true",
        help="schools at rank 2, the Puma's at rank 4, too",
    )
    arguments = parser.parse_args()
    for kind in EXPECTED:
        warnings.simplefilter("ignore", kind)
    with threadpool_limits(1):
        for name in arguments.only:
            PARTS[name](arguments)
    table = pd.DataFrame(
        Section.verdicts, columns=["data", "of", "value", "goal", "is"]
    )
    print(f"\n{table.to_string(index=False)}")


if __name__ == "__main__":
    main()
