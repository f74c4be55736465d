"""How often intervals of a task hold that has joined a fitted model by a few rows.

``python benchmarks/joining.py`` draws six tasks as intervals.py does, of rank 2, fits
five of them with 20 rows each, by the mode of the hyperparameters, by Laplace's method
and by draws of them, and lets the sixth join by 2 to 10 rows with ``add_task``. "mode,
certain" is the mode without what the rows leave open of the sixth task. "mode, one by
one" joins by two rows, and gets the others one after another by ``partial_fit``.
Columns are those of intervals.py, over 20 test points of the sixth task, averaged over
the draws; "seconds" are the processor's of ``add_task``, and of all ``partial_fit``.
"""

import argparse
import time
import warnings

import numpy as np
import pandas as pd
from intervals import draw, measured
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor

N_TASKS, N_ROWS, RANK = 6, 20, 2


def rows_of(seed, few):
    """Rows of the table, of one data set."""
    X, y, *test = draw(N_TASKS, N_ROWS, RANK, seed)
    old, of_new = X[:, -1] < N_TASKS - 1, test[0][:, -1] == N_TASKS - 1
    new, test = np.flatnonzero(~old), [part[of_new] for part in test]
    for name in ("mode", "laplace", "sampled"):
        model = MultiTaskGPRegressor(rank=RANK, hyperparameters=name)
        model.fit(X[old], y[old])
        for n in few:
            begin = time.process_time()
            joined = model.add_task(X[new[:n]], y[new[:n]])
            seconds = time.process_time() - begin
            found = measured(joined, *test)
            yield {"rows": n, "by": name, "seconds": seconds, **found}
            if name == "mode":
                joined._predictive = joined._posteriors
                found = measured(joined, *test)
                yield {"rows": n, "by": "mode, certain", "seconds": seconds, **found}
                yield {"rows": n, **one_by_one(model, X[new[:n]], y[new[:n]], test)}


def one_by_one(model, X, y, test):
    """A row of the table: two rows join at once, the others follow."""
    begin = time.process_time()
    joined = model.add_task(X[:2], y[:2])
    for i in range(2, len(X)):
        joined.partial_fit(X[[i]], y[[i]])
    seconds = time.process_time() - begin
    return {"by": "mode, one by one", "seconds": seconds, **measured(joined, *test)}


def main():
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[2, 4, 6, 8, 10])
    parser.add_argument("--seeds", type=int, default=40, help="data sets")
    args = parser.parse_args()
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [row for seed in range(args.seeds) for row in rows_of(seed, args.rows)]
    cells = pd.DataFrame(rows).groupby(["rows", "by"])
    table = cells[["y", "f", "density", "mse", "seconds"]].mean()
    table.insert(3, "median density", cells["density"].median())
    print(table.round(3).to_string())
    print(f"\n{args.seeds} draws")


if __name__ == "__main__":
    main()
