"""How often the default fit warns of correlated noise and of other modes.

- Independent noise: problems of ordinary.py, in every class in turn, with the rows
  shuffled and with those of each task sorted by its first input. A warning of
  correlated noise is a false alarm. One of another mode is right where the rows do not
  tell: printed is the error of the fits that it was given of, beside the others'.
- Correlated noise: the same rows, shuffled, and noise of which a half of the variance
  is correlated along them, by 0.9 from one to the next.
- With ``--data FOLDER``: currents of a UR10e's joints, 200 rows of each payload, from
  the whole trajectory in the order of time, as many in random order, and consecutive
  ones. See real_data_sets.py for the data.

``python benchmarks/doubts.py --draws 200 --data FOLDER``
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import ordinary_data
import pandas as pd
import real_data_sets
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.exceptions import AmbiguousFitWarning, CorrelatedResidualsWarning

ALONG = 0.9  # correlation from one row to the next
KINDS = {"correlated": CorrelatedResidualsWarning, "ambiguous": AmbiguousFitWarning}


def doubts(X, y, **options):
    """A fitted model, and which of the warnings it gave."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = MultiTaskGPRegressor(**options).fit(X, y)
    categories = [of.category for of in caught]
    return model, {name: kind in categories for name, kind in KINDS.items()}


def shuffled(problem, rng):
    """The rows in random order."""
    order = rng.permutation(len(problem.y))
    return problem.X[order], problem.y[order]


def in_order(problem, rng):
    """The rows of each task sorted by their first input."""
    order = np.lexsort([problem.X[:, 0], problem.X[:, -1]])
    return problem.X[order], problem.y[order]


def correlated(problem, rng):
    """Shuffled, with correlated noise of half the deviation of each task's targets."""
    X, y = shuffled(problem, rng)
    for task in np.unique(X[:, -1]):
        rows = X[:, -1] == task
        walk = np.sqrt(1.0 - ALONG**2) * rng.standard_normal(rows.sum())
        walk[0] /= np.sqrt(1.0 - ALONG**2)
        walk = lfilter([1.0], [1.0, -ALONG], walk)
        noise = (walk + rng.standard_normal(rows.sum())) / np.sqrt(2.0)
        y[rows] += 0.5 * y[rows].std() * noise
    return X, y


def drawn(design, n_draws):
    """A row of each problem."""
    names = list(ordinary_data.CLASSES)
    for i in range(n_draws):
        problem = ordinary_data.problem(names[i % len(names)], 1000 + i)
        X, y = design(problem, np.random.default_rng(i))
        model, said = doubts(X, y)
        error = np.square(model.predict(problem.X_test) - problem.f_test).mean()
        yield {**said, "error": error / problem.f_test.var()}


def currents(folder):
    """A row of each design and joint."""
    files = {"empty": "ur-20_01_31-unload", "loaded": "ur-20_01_31-load"}
    tables = [
        real_data_sets.recording(folder / "ur10e" / f"{name}.csv.gz", task)
        for task, name in files.items()
    ]
    rng, n = np.random.default_rng(0), real_data_sets.N_UR10E
    designs = {
        "in order": lambda size: np.linspace(0, size - 1, n).astype(int),
        "shuffled": lambda size: rng.permutation(np.linspace(0, size - 1, n)).astype(
            int
        ),
        "consecutive": lambda size: np.arange(500, 500 + n),
    }
    for design, rows in designs.items():
        chosen = [table.iloc[rows(len(table))] for table in tables]
        for joint in range(1, real_data_sets.N_JOINTS + 1):
            X, y = real_data_sets.one_joint(chosen, joint, friction=False)
            said = doubts(X, y, task_feature="task")[1]
            yield {"design": design, "joint": joint, **said}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    with threadpool_limits(1):
        for design in (shuffled, in_order, correlated):
            table = pd.DataFrame(drawn(design, options.draws))
            counts = ", ".join(f"{table[name].sum()} {name}" for name in KINDS)
            errors = table.groupby("ambiguous")["error"].median().to_dict()
            print(f"{design.__name__}: of {len(table)} fits {counts}", flush=True)
            print(f"  median nMSE, by whether ambiguous: {errors}", flush=True)
        if options.data:
            table = pd.DataFrame(currents(options.data))
            print(table.pivot(index="joint", columns="design", values="correlated"))
            print("ambiguous:", int(table["ambiguous"].sum()), "of", len(table))


if __name__ == "__main__":
    main()
