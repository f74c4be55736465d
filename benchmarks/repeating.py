"""Whether the default says that targets repeat in time, and forecasts by what it names.

``python benchmarks/repeating.py`` draws series of two to eight tasks. Of those with a
period it learns from the first 85 % of the time, and forecasts the rest by the default
and by the model that its SeveralKernelsWarning names. It prints, for each kind,

- "told": how many fits said that targets repeat, and of how many;
- "right": in how many of these the period was within 2 % of the true one;
- "default" and "named": the root mean squared error of the forecasts of these, over
  that of the last value of each task (geometric means);
- "held": the share of 95 % intervals of the named model that hold what came;
- "seconds": the processor's that the question took, and those of the whole fit.

Those with a period are hours with a daily wave and a drift of each task, months with a
yearly wave, a drift that all tasks share and a peak in November, and nights of visits
once or twice a night to stars that vary within a day. Those without are random walks,
autoregressions, smooth and rough functions, shocks, growth curves, noise, and waves
that die out or become faster.
"""

import argparse
import time
import warnings

import numpy as np
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, Matern
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp._estimators import other_models
from skmtgp.exceptions import SeveralKernelsWarning
from skmtgp.kernels import Columns

KNOWN = {"Columns": Columns, "ExpSineSquared": ExpSineSquared}
KNOWN |= {"RBF": RBF, "Matern": Matern}
AHEAD, RIGHT = 0.15, 0.02
DAY, YEAR, STAR = 24.0, 1.0, 0.61


def walks(rng, n_tasks, n, memory):
    """Random walks, or autoregressions of less memory."""
    f, steps = np.zeros((n_tasks, n)), rng.standard_normal((n_tasks, n))
    for i in range(1, n):
        f[:, i] = memory * f[:, i - 1] + steps[:, i]
    return f


def smooth(rng, n_tasks, x, *, rough):
    """Draws of a Gaussian process of two functions."""
    scale = np.exp(rng.uniform(np.log(2.0), np.log(20.0)))
    r = np.abs(x[:, None] - x) / scale
    K = (1.0 + r) * np.exp(-r) if rough else np.exp(-0.5 * r**2)
    C = np.linalg.cholesky(K + 1e-8 * np.eye(len(x)))
    return rng.standard_normal((n_tasks, 2)) @ (C @ rng.standard_normal((len(x), 2))).T


def hours(rng, n_tasks):
    """Every three hours of eight days: a wave of a day, and a drift of each task."""
    x = np.arange(0.0, 8.0 * DAY, 3.0)
    turn, size = 2.0 * np.pi * x / DAY, rng.uniform(0.5, 2.0, (n_tasks, 1))
    f = size * (np.sin(turn) + 0.5 * np.sin(2.0 * turn + 1.0))
    return x, f + 0.1 * walks(rng, n_tasks, len(x), 1.0), 0.2


def months(rng, n_tasks):
    """Five years: a wave, slopes, a drift that all tasks share, and Novembers."""
    x = np.arange(60) / 12.0
    f = rng.uniform(0.5, 1.5, (n_tasks, 1)) * np.sin(2.0 * np.pi * x)
    f += rng.uniform(-0.3, 0.6, (n_tasks, 1)) * x + 0.1 * walks(rng, 1, 60, 1.0)
    return x, f + 0.8 * (np.arange(60) % 12 == 10), 0.1


def nights(rng, n_tasks):
    """One or two visits in each of forty nights to stars with a common period."""
    x = np.sort(np.arange(40) + rng.uniform(0.0, 0.4, (2, 40)), axis=None)
    x = x[rng.random(80) < 0.8]
    turn, size = 2.0 * np.pi * x / STAR, rng.uniform(0.5, 2.0, (n_tasks, 1))
    return x, size * (np.sin(turn) + 0.4 * np.cos(2.0 * turn)), 0.2


PERIODS = {hours: DAY, months: YEAR, nights: STAR}


def without(kind, rng, n_tasks):
    """Series of a kind that does not repeat."""
    n = int(rng.integers(25, 80))
    x, c = np.arange(n, dtype=float), np.linspace(0.0, 1.0, n)
    size = rng.uniform(0.5, 2.0, (n_tasks, 1))
    if kind.startswith("uneven"):
        x = np.sort(rng.uniform(0.0, n, n))
    f = {
        "walks": lambda: walks(rng, n_tasks, n, 1.0),
        "uneven autoregressions": lambda: walks(rng, n_tasks, n, 0.8),
        "autoregressions": lambda: walks(rng, n_tasks, n, 0.8),
        "one walk of all": lambda: size * walks(rng, 1, n, 1.0),
        "smooth": lambda: smooth(rng, n_tasks, x, rough=False),
        "uneven smooth": lambda: smooth(rng, n_tasks, x, rough=False),
        "rough": lambda: smooth(rng, n_tasks, x, rough=True),
        "shocks": lambda: np.tile(rng.standard_normal(n), (n_tasks, 1)),
        "growth": lambda: (
            10.0 / (1.0 + np.exp(6.0 - 12.0 * (c - rng.normal(0.0, 0.1, size.shape))))
        ),
        "noise": lambda: np.zeros((n_tasks, n)),
        "dying waves": lambda: size * np.exp(-4.0 * c) * np.cos(12.0 * np.pi * c),
        "faster waves": lambda: size * np.cos(2.0 * np.pi * (3.0 * c + 4.0 * c**2)),
    }[kind]()
    return x, f, rng.choice([0.05, 0.3, 1.0]) * (f.std() or 1.0)


NONE = (
    "walks",
    "uneven autoregressions",
    "autoregressions",
    "one walk of all",
    "smooth",
    "uneven smooth",
    "rough",
    "shocks",
    "growth",
    "noise",
    "dying waves",
    "faster waves",
)


def table(rng, n_tasks, x, f, noise):
    """Rows of all tasks with levels of their own."""
    f = f + rng.uniform(0.0, 9.0, (n_tasks, 1))
    y = f + noise * rng.standard_normal(f.shape)
    return np.column_stack([np.tile(x, n_tasks), np.repeat(range(n_tasks), len(x))]), y


class Asked:
    """The question, which keeps what it found and its seconds."""

    def __init__(self, ask):
        self.ask, self.found = ask, []

    def __call__(self, *of):
        """Ask, and keep the answer."""
        begin = time.process_time()
        answer = self.ask(*of)
        self.found.append((answer, time.process_time() - begin))
        return answer


def fit(X, y, asked):
    """The default, the warning if targets repeat, and the seconds of both."""
    asked.found.clear()
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = MultiTaskGPRegressor().fit(X, y)
    seconds = time.process_time() - begin
    said = [str(of.message) for of in caught if of.category is SeveralKernelsWarning]
    told = [message for message in said if "seem to repeat" in message]
    return model, told, sum(of for _, of in asked.found), seconds


def named(message):
    """The model that a message names."""
    told = message.split("Try ")[1].split(", with Columns")[0]
    return eval(told, KNOWN | {"MultiTaskGPRegressor": MultiTaskGPRegressor})


def error(model, X, y):
    return np.sqrt(np.mean((model.predict(X) - y) ** 2))


def repeats(kind, seed, asked):
    """What is told of a draw with a period, and forecasts by it."""
    rng = np.random.default_rng(seed)
    n_tasks = int(rng.integers(2, 9))
    x, f, noise = kind(rng, n_tasks)
    X, y = table(rng, n_tasks, x, f, noise)
    last = x[int((1.0 - AHEAD) * len(x)) - 1]
    past, future = X[:, 0] <= last, X[:, 0] > last
    of_last = np.repeat(y[:, x == last].ravel(), (x > last).sum())
    y = y.ravel()
    model, told, *seconds = fit(X[past], y[past], asked)
    if not told:
        return False, False, np.nan, np.nan, np.nan, *seconds
    period = asked.found[0][0].kernel.periodicity
    better = named(told[0]).fit(X[past], y[past])
    low, high = better.predict_interval(X[future])
    of = X[future], y[future]
    scale = np.sqrt(np.mean((of_last - of[1]) ** 2))
    held = np.mean((low <= of[1]) & (of[1] <= high))
    right = abs(period / PERIODS[kind] - 1.0) < RIGHT
    errors = error(model, *of) / scale, error(better, *of) / scale
    return True, right, *errors, held, *seconds


def report(name, draws):
    """A line."""
    told, right, default, of_named, held, asked, seconds = np.array(draws, float).T
    line = f"{name:24}{told.sum():4.0f} of {len(draws):<4}"
    if right.any():
        errors = [np.exp(np.nanmean(np.log(of))) for of in (default, of_named)]
        line += f"{right.sum():6.0f}{errors[0]:9.2f}{errors[1]:7.2f}"
        line += f"{np.nanmean(held):7.2f}"
    else:
        line += " " * 29
    print(f"{line}{asked.mean():9.2f}{seconds.mean():7.2f}", flush=True)


def main():
    """Draw, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10)
    n_draws = parser.parse_args().draws
    asked = Asked(other_models.function_that_repeats)
    other_models.function_that_repeats = asked
    names = f"{'told':>11}{'right':>8}{'default':>9}{'named':>7}{'held':>7}"
    print(f"{'':24}{names}  seconds")
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for kind in PERIODS:
            draws = [repeats(kind, seed, asked) for seed in range(n_draws)]
            report(kind.__name__, draws)
        for kind in NONE:
            draws = []
            for seed in range(n_draws):
                rng = np.random.default_rng([seed, len(kind)])
                n_tasks = int(rng.integers(2, 9))
                X, y = table(rng, n_tasks, *without(kind, rng, n_tasks))
                _, told, *seconds = fit(X, y.ravel(), asked)
                draws.append((bool(told), False, *[np.nan] * 3, *seconds))
            report(kind, draws)


if __name__ == "__main__":
    main()
