"""What intervals of the function hold where noise is larger than the function.

``python benchmarks/much_noise.py`` draws planes of 8 tasks at the same 48 inputs, three
features, with slopes around 1, 0.3 and 0.2, and noise of 1 and of 10 times their
variance. It fits ``MultiTaskGPRegressor("linear")`` with each way of hyperparameters,
and prints the share of 95 % intervals that hold the function at 200 new inputs, the
least of all draws, the error over the deviation of the truth, seconds of the processor,
and of how many draws of data hyperparameters were drawn.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

N_TASKS, N_ROWS, N_NEW = 8, 48, 200
SIGNALS, WAYS = (1.0, 0.1), ("mode", "laplace", "auto", "sampled")


def draw(signal, seed):
    """Training rows and targets, new rows and the function there."""
    rng = np.random.default_rng(seed)
    slopes = [1.0, 0.3, 0.2] + 0.4 * rng.standard_normal((N_TASKS, 3))
    x, z = (rng.standard_normal((n, 3)) for n in (N_ROWS, N_NEW))
    noise = np.sqrt(np.square(slopes).sum(axis=1) / signal)[:, None]
    y = slopes @ x.T + noise * rng.standard_normal((N_TASKS, N_ROWS))
    X, Z = (
        np.column_stack([np.tile(of, (N_TASKS, 1)), np.repeat(np.arange(N_TASKS), n)])
        for of, n in ((x, N_ROWS), (z, N_NEW))
    )
    return X, y.ravel(), Z, (slopes @ z.T).ravel()


def measured(way, X, y, Z, f):
    """A row of the table."""
    begin = time.process_time()
    model = MultiTaskGPRegressor("linear", hyperparameters=way, random_state=0)
    model.fit(X, y)
    seconds = time.process_time() - begin
    lower, upper = model.predict_interval(Z, 0.95, include_noise=False)
    return {
        "held": np.mean((lower <= f) & (f <= upper)),
        "error": np.sqrt(np.mean((model.predict(Z) - f) ** 2)) / f.std(),
        "seconds": seconds,
        "drawn": model.hyperparameters_ == "sampled",
    }


def main():
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=12)
    rows = []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for signal in SIGNALS:
            for seed in range(parser.parse_args().draws):
                data = draw(signal, seed)
                at = {"signal over noise": signal}
                rows += [at | {"way": way} | measured(way, *data) for way in WAYS]
    cells = pd.DataFrame(rows).groupby(["signal over noise", "way"], sort=False)
    table = cells[["held", "error", "seconds"]].mean()
    table.insert(1, "least", cells["held"].min())
    table["drawn"] = cells["drawn"].sum()
    print(table.round(2).to_string())


if __name__ == "__main__":
    main()
