"""Whether the logarithm that SkewedInputWarning names is better.

``python benchmarks/log_inputs.py --draws 10`` fits the default, to the input and to
its logarithm, of

- curves: concentrations of a drug in 24 patients, of five to eight samples each, at
  times from a quarter of an hour to a day, with errors of a tenth;
- doses: responses of eight drugs to 20 doses each, which saturate;
- along the logarithm: eight tasks of 20 rows, functions of two draws of a Gaussian
  process along the logarithm of a lognormal input;
- along the input: the same along the input itself, where the logarithm is worse.

"told" is how many fits warn. "error" is the geometric mean of the root mean squared
error with the logarithm over that without, of all fits, and "of those told" that of
those that warn. "seconds" is the share of the fit that the question takes.
"""

import argparse
import warnings
from functools import partial
from time import process_time
from unittest.mock import patch

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp._estimators import skew
from skmtgp.exceptions import SkewedInputWarning

TIMES = np.array([0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.0, 9.0, 12.0, 24.0])  # hours


def curves(rng):
    """Rows with the task last, their targets, test rows and their functions."""
    usual, spread = np.log([1.2, 0.12, 30.0]), [0.5, 0.3, 0.25]
    ka, ke, V = np.exp(usual[:, None] + np.multiply(spread, rng.normal(size=(24, 3))).T)

    def f(x, task):
        a, e = ka[task], ke[task]
        return 100.0 * a / (V[task] * (a - e)) * (np.exp(-e * x) - np.exp(-a * x))

    times = [rng.choice(TIMES, rng.integers(5, 9), replace=False) for _ in range(24)]
    x, task = np.concatenate(times), np.repeat(np.arange(24), list(map(len, times)))
    x_test = np.exp(rng.uniform(*np.log(TIMES[[0, -1]]), 240))
    test = np.arange(240) % 24
    y = f(x, task) * (1.0 + 0.1 * rng.standard_normal(len(x)))
    return x, task, y, x_test, test, f(x_test, test)


def doses(rng):
    """The same of drugs."""
    half, most = np.exp(rng.normal(1.0, 1.0, 8)), rng.uniform(0.5, 1.5, 8)
    x = np.exp(rng.uniform(np.log(0.1), np.log(100.0), 400))
    task = np.arange(400) % 8
    f = most[task] * x / (half[task] + x)
    return split(x, task, f, 0.03, rng)


def of_process(rng, change):
    """The same of a Gaussian process along a change of the input."""
    x, task = np.exp(rng.standard_normal(400)), np.arange(400) % 8
    z = change(x)
    K = np.exp(-0.5 * np.subtract.outer(z, z) ** 2) + 1e-8 * np.eye(400)
    functions = np.linalg.cholesky(K) @ rng.standard_normal((400, 2))
    f = (functions * rng.standard_normal((8, 2))[task]).sum(axis=1)
    return split(x, task, f, 0.1, rng)


def split(x, task, f, noise, rng, n=160):
    """The first rows with noise, and the others."""
    y = f + noise * rng.standard_normal(len(f))
    return x[:n], task[:n], y[:n], x[n:], task[n:], f[n:]


KINDS = {
    "curves": curves,
    "doses": doses,
    "along the logarithm": partial(of_process, change=np.log),
    "along the input": partial(of_process, change=np.asarray),
}


def row(x, task, y, x_test, test, f):
    """What one data set says."""
    errors, spent, gains = [], [], skew.gains_of_logarithms

    def timed(*args):
        begun = process_time()
        found = gains(*args)
        spent.append(process_time() - begun)
        return found

    for change in np.asarray, np.log:
        begun = process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with patch.object(skew, "gains_of_logarithms", timed):
                model = MultiTaskGPRegressor().fit(np.c_[change(x), task], y)
        left = model.predict(np.c_[change(x_test), test]) - f
        errors.append(np.sqrt(np.square(left).mean()))
        if len(errors) == 1:
            told = any(of.category is SkewedInputWarning for of in caught)
            share = sum(spent) / (process_time() - begun)
    return {"told": told, "error": errors[1] / errors[0], "seconds": share}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=10)
    n, lines = parser.parse_args().draws, []
    with threadpool_limits(1):
        for kind, draw in KINDS.items():
            sets = (draw(np.random.default_rng(seed)) for seed in range(n))
            found = pd.DataFrame([row(*of) for of in sets])
            told = found["told"]
            line = {"data": kind, "fits": n, "told": told.sum()}
            line["error"] = np.exp(np.log(found["error"]).mean())
            line["of those told"] = np.exp(np.log(found["error"][told]).mean())
            lines.append(line | {"seconds": found["seconds"].mean()})
    print(pd.DataFrame(lines).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
