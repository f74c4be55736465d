"""Whether SingleTaskGP is better where UnrelatedTasksWarning names it.

``python benchmarks/separate.py --draws 20`` fits the default to two kinds of data of
four unrelated tasks, 30 rows each, in which one kernel does not suit all tasks:

- own input: there are four inputs, and each task depends on another one;
- own speed: one input, and length-scales of 0.3, 0.6, 1.2 and 2.4.

It also fits the problems of ordinary.py, in every class in turn. "told" is how many
fits warn. "error" is the geometric mean of the root mean squared error of SingleTaskGP
over that of the default, where it warned and elsewhere; "search" is that of
RankSearchIC. "seconds" is the share of the fit that the question takes.
"""

import argparse
import time
import warnings
from unittest.mock import patch

import numpy as np
import ordinary_data
import pandas as pd
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp._estimators import other_models
from skmtgp.exceptions import UnrelatedTasksWarning

N_TASKS, ROWS, N_TEST, NOISE = 4, 30, 50, 0.15
SPEEDS = np.array([0.3, 0.6, 1.2, 2.4])
MANY = ("131-tasks", "115-tasks")  # are never asked, and take long


def own_input(rng):
    """Training rows, rows to predict, and their function."""

    def draw(n):
        X = rng.uniform(-2.0, 2.0, (n * N_TASKS, N_TASKS))
        task = np.repeat(np.arange(N_TASKS), n)
        x = X[np.arange(len(X)), task]
        return np.column_stack([X, task]), np.sin(2.0 * x) + 0.3 * x

    return with_noise(draw, rng)


def own_speed(rng):
    """The same of functions that are drawn together."""
    n = ROWS + N_TEST
    task = np.repeat(np.arange(N_TASKS), n)
    x = rng.uniform(0.0, 6.0, n * N_TASKS)
    K = np.exp(-0.5 * np.square((x[:, None] - x) / SPEEDS[task]))
    K *= task[:, None] == task
    f = rng.multivariate_normal(
        np.zeros(len(x)), K, check_valid="ignore", method="eigh"
    )
    X, train = np.column_stack([x, task]), np.arange(len(x)) % n < ROWS
    y = f + NOISE * rng.standard_normal(len(f))
    return X[train], y[train], X[~train], f[~train]


def with_noise(draw, rng):
    """Rows with noise, and rows without."""
    (X, f), (X_test, f_test) = draw(ROWS), draw(N_TEST)
    return X, f + NOISE * rng.standard_normal(len(f)), X_test, f_test


def ordinary(n):
    """Problems of all classes in turn."""
    classes = [name for name in ordinary_data.CLASSES if name not in MANY]
    for k in range(n):
        problem = ordinary_data.problem(classes[k % len(classes)], k // len(classes))
        yield problem.X, problem.y, problem.X_test, problem.f_test


class Clock:
    """How long the question took."""

    def __init__(self, function):
        self.function, self.seconds = function, 0.0

    def __call__(self, *given, **named):  # noqa: D102
        begin = time.process_time()
        found = self.function(*given, **named)
        self.seconds += time.process_time() - begin
        return found


def asked(X, y, *questions):
    """The default fit, what it warns of, and which share of it questions take."""
    clocks = {name: Clock(getattr(other_models, name)) for name in questions}
    begin = time.process_time()
    catching = warnings.catch_warnings(record=True)
    with patch.multiple(other_models, **clocks), catching as caught:
        warnings.simplefilter("always")
        model = MultiTaskGPRegressor().fit(X, y)
    seconds = sum(clock.seconds for clock in clocks.values())
    return model, caught, seconds / (time.process_time() - begin)


def row(X, y, X_test, f_test):
    """What one data set says."""
    model, caught, share = asked(X, y, "gain_of_separate_models")
    told = any(of.category is UnrelatedTasksWarning for of in caught)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        others = SingleTaskGP().fit(X, y), RankSearchIC().fit(X, y)
    errors = [
        np.sqrt(np.square(of.predict(X_test) - f_test).mean())
        for of in (model, *others)
    ]
    names = {"error": errors[1] / errors[0], "search": errors[2] / errors[0]}
    return {"told": told, "share": share} | names


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=20)
    n = parser.parse_args().draws
    seeds = [np.random.default_rng(seed) for seed in range(n)]
    sets = {
        "own input": (own_input(rng) for rng in seeds),
        "own speed": (own_speed(rng) for rng in seeds),
        "ordinary": ordinary(8 * n),
    }
    lines = []
    with threadpool_limits(1):
        for kind, of_kind in sets.items():
            found = pd.DataFrame([row(*of) for of in of_kind])
            for told, rows in found.groupby("told"):
                means = np.exp(np.log(rows[["error", "search"]]).mean())
                line = {"data": kind, "told": told, "fits": len(rows)}
                better = (rows["error"] < 1.0).mean()
                share = rows["share"].mean()
                lines.append(line | dict(means) | {"better": better, "seconds": share})
    print(pd.DataFrame(lines).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
