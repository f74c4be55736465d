"""Time of fits to 139 tasks of few rows, on one thread.

``python benchmarks/many_tasks.py`` draws tasks that share two functions of some inputs,
with levels and much noise, and prints seconds of the processor, evaluations and
likelihoods of a dense fit of rank 2 to 1200 rows and of a RankSearchIC of inducing
inputs on 11,500 rows. ``--only dense`` or ``--only sparse`` does one of them.
"""

import argparse
import time
import warnings

import numpy as np
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, RankSearchIC

N_TASKS, N_INPUTS, NOISE = 139, 8, 0.8
SPARSE = {"inference": "sparse", "n_inducing": 200}
CASES = {  # rows, model, goal in seconds
    "dense": (1200, MultiTaskGPRegressor(rank=2), 25),
    "sparse": (11_500, RankSearchIC(MultiTaskGPRegressor(**SPARSE)), 90),
}


def draw(n, seed=0):
    """Rows with the task last, and targets: levels, one function, a little of another.

    Free: inputs are normal, the functions are waves along random directions, levels
    have a deviation of 0.3, loadings of 1 and 0.3.
    """
    rng = np.random.default_rng(seed)
    task, x = np.arange(n) % N_TASKS, rng.standard_normal((n, N_INPUTS))
    directions = rng.standard_normal((2, N_INPUTS)) / np.sqrt(N_INPUTS)
    functions = np.sqrt(2.0) * np.sin(x @ directions.T + [0.0, 1.0])
    loadings = np.array([1.0, 0.3]) * rng.standard_normal((N_TASKS, 2)) + [1.0, 0.0]
    levels = 0.3 * rng.standard_normal(N_TASKS)
    f = levels[task] + (loadings[task] * functions).sum(axis=1)
    return np.column_stack([x, task]), f + NOISE * rng.standard_normal(n)


def main():
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=CASES, nargs="+", default=list(CASES))
    parser.add_argument("--seeds", type=int, default=1)
    arguments = parser.parse_args()
    print("case    rows  seed  processor s  goal  evaluations  log likelihood  rank")
    for case in arguments.only:
        n, model, goal = CASES[case]
        for seed in range(arguments.seeds):
            X, y = draw(n, seed)
            begin = time.process_time()
            with threadpool_limits(1), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                model.fit(X, y)
            seconds = time.process_time() - begin
            best = getattr(model, "best_estimator_", model)
            print(
                f"{case:6} {n:5d} {seed:5d} {seconds:12.1f} {goal:5d} "
                f"{best.n_evaluations_:12d} "
                f"{best.log_marginal_likelihood_value_:15.2f} "
                f"{np.shape(best.task_factor_)[-1]:5d}",
                flush=True,
            )


if __name__ == "__main__":
    main()
