"""skmtgp's fits to the paper's whole training set, by inducing inputs.

``python benchmarks/peers/sparse_fits.py`` learns 14 loads x 4000 samples, joint by
joint, through the public interface, and measures the errors on the whole interpolation
and extrapolation sets. The data have no noise: how far its variance may fall is
``--noise-floor``, by default that of the estimators. ``--search`` learns all ranks in
one `RankSearchIC`, as exact inference in the paper's experiments, each rank with a row
of its own; else each is learned alone. Each fit has a process of its own, whose memory
is measured before the test sets are read; what is there is not measured again.
``--short`` takes seconds, and its results are in benchmarks/.short.
"""

import argparse
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from adapter import peak_mib
from problem import NOISE
from results import RESULTS, Table, commit, write_machine
from run import command_line
from sklearn.pipeline import make_pipeline
from skmtgp_adapter import PAPER
from threadpoolctl import threadpool_limits

import skmtgp
from skmtgp import MultiTaskGPRegressor, RankSearchIC, make_inverse_dynamics_regressor
from skmtgp.datasets import fetch_puma560
from skmtgp.metrics import normalized_mean_squared_error

LOADS = range(1, 15)
TEST_SETS = "interpolation", "extrapolation"
SHORT = {"n_per_load": 20, "m": [20], "joints": [4], "max_iter": 20, "test_rows": 200}


def fit(key, arguments):
    """One fit: of each rank what all took, what it found, its errors."""
    threadpool_limits(arguments.threads)
    X, y = rows("train", key, arguments.n_per_load)
    ranks = key["ranks"]
    model = MultiTaskGPRegressor(
        rank=ranks[-1],
        inference="sparse",
        n_inducing=key["m"],
        n_exact=key["n_exact"],
        noise_variance_bounds=(key["noise_floor"], NOISE[1]),
        max_iter=arguments.max_iter,
        **PAPER,
    )
    if len(ranks) > 1:
        model = RankSearchIC(model, ranks=ranks, keep_estimators=True)
    wall, processor = time.perf_counter(), time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pipeline = make_inverse_dynamics_regressor(model).fit(X, y)
    spent = {
        "wall_seconds": time.perf_counter() - wall,
        "processor_seconds": time.process_time() - processor,
        "peak_mib": peak_mib(),
        "warned": sorted({warning.category.__name__ for warning in caught}),
    }
    features, fitted = pipeline
    models = fitted.estimators_ if len(ranks) > 1 else [fitted]
    return [
        {"rank": rank}
        | spent
        | facts(model)
        | errors(make_pipeline(features, model), key, arguments.test_rows)
        for rank, model in zip(ranks, models, strict=True)
    ]


def rows(subset, key, n_per_load):
    """Inputs with the load, and the torque of the joint."""
    X, torque = fetch_puma560(
        subset=subset,
        n_per_load=n_per_load,
        loads=LOADS,
        random_state=key["draw"],
        return_X_y=True,
    )
    return X, torque[:, key["joint"] - 1].copy()


def facts(model):
    """What a fit found; the bound and the noise variance are of the scaled targets."""
    scale, n = model.y_scale_, len(model.y_train_)
    return {
        "bound": float(model.log_marginal_likelihood_value_ + n * np.log(scale)),
        "noise": float(model.noise_variance_ / scale**2),
        "n_inducing": len(model.inducing_inputs_),
        "n_iter": int(model.n_iter_),
        "n_evaluations": int(model.n_evaluations_),
        "n_hyperparameters": model.n_hyperparameters_,
    }


def errors(model, key, test_rows):
    """Error on each test set, averaged over loads."""
    found = {}
    for subset in TEST_SETS:
        X, y = rows(subset, key, test_rows)
        blocks = np.array_split(X, len(LOADS))
        mean = np.concatenate([model.predict(block) for block in blocks])
        error = normalized_mean_squared_error(y, mean, tasks=X[:, -1])
        found[f"nmse_{subset}"] = float(error)
    return found


def alone(function, *arguments):
    """Call a function in a process of its own."""
    options = {"mp_context": get_context("spawn"), "max_tasks_per_child": 1}
    with ProcessPoolExecutor(1, **options) as pool:
        return pool.submit(function, *arguments).result()


def parse():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--joints", nargs="+", type=int, default=range(1, 7))
    add("--n-per-load", type=int, default=4000)
    add("--m", nargs="+", type=int, default=[500, 1000, 1500], help="inducing inputs")
    add("--rank", nargs="+", type=int, default=[5])
    add("--search", action="store_true", help="all ranks together, by RankSearchIC")
    add("--n-exact", nargs="+", type=int, default=[1100], help="rows learned exactly")
    add("--draw", type=int, default=0)
    add("--noise-floor", nargs="+", type=float, default=[NOISE[0]], help="variance")
    add("--threads", type=int, default=1)
    add("--max-iter", type=int, default=2000)
    add("--test-rows", type=int, help="of each load; all if not given")
    add("--results", type=Path, default=RESULTS)
    add("--beside", default="nothing", help="what else runs on the machine, to be told")
    add("--redo", action="store_true", help="measure again what is there")
    add("--short", action="store_true", help="a tiny fit, into benchmarks/.short")
    arguments = parser.parse_args()
    if arguments.short:
        vars(arguments).update(SHORT, results=RESULTS.parent / ".short", redo=True)
    return arguments


def main():
    """Measure what is missing."""
    arguments = parse()
    command = " ".join(["python benchmarks/peers/sparse_fits.py", *command_line()])
    told = {"threads": arguments.threads, "beside": arguments.beside}
    write_machine(arguments.results, command, **told)
    packages = ("numpy", "scipy", "scikit-learn")
    versions = {"skmtgp": skmtgp.__version__} | {p: version(p) for p in packages}
    table = Table("sparse_fits", arguments.results)
    n = len(LOADS) * arguments.n_per_load
    together = sorted(arguments.rank)
    keys = [
        {"n": n, "m": m, "n_exact": n_exact, "ranks": ranks, "joint": joint}
        | {"draw": arguments.draw, "noise_floor": floor}
        for floor in arguments.noise_floor
        for m in arguments.m
        for n_exact in arguments.n_exact
        for ranks in ([together] if arguments.search else [[r] for r in together])
        for joint in arguments.joints
    ]
    for key in keys:
        last = table.key({**key, "rank": key["ranks"][-1]})
        if last in table.rows and not arguments.redo:
            continue
        for report in alone(fit, key, arguments):
            row = {**key, **report, **told}
            row |= {"versions": versions, "commit": commit(), "command": command}
            print(table.append(row), flush=True)


if __name__ == "__main__":
    main()
