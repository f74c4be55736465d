"""skmtgp's fits to the paper's whole training set, by inducing inputs.

``python benchmarks/peers/sparse_fits.py`` learns 14 loads x 4000 samples, joint by
joint, through the public interface, and measures the errors on the whole interpolation
and extrapolation sets. The data have no noise: how far its variance may fall is
``--noise-floor``, by default that of the estimators. Each fit has a process of its own,
whose memory is measured before the test sets are read; what is there is not measured
again. ``--short`` takes seconds, and its results are in benchmarks/.short.
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
from threadpoolctl import threadpool_limits

import skmtgp
from skmtgp import MultiTaskGPRegressor, make_inverse_dynamics_regressor
from skmtgp.datasets import fetch_puma560
from skmtgp.metrics import normalized_mean_squared_error

LOADS = range(1, 15)
TEST_SETS = "interpolation", "extrapolation"
SHORT = {"n_per_load": 20, "m": [20], "joints": [4], "max_iter": 20, "test_rows": 200}


def fit(key, arguments):
    """One fit: what it took, what it found, its errors."""
    threadpool_limits(arguments.threads)
    X, y = rows("train", key, arguments.n_per_load)
    model = MultiTaskGPRegressor(
        rank=key["rank"],
        inference="sparse",
        n_inducing=key["m"],
        noise_variance_bounds=(key["noise_floor"], NOISE[1]),
        max_iter=arguments.max_iter,
    )
    wall, processor = time.perf_counter(), time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pipeline = make_inverse_dynamics_regressor(model).fit(X, y)
    report = {
        "wall_seconds": time.perf_counter() - wall,
        "processor_seconds": time.process_time() - processor,
        "peak_mib": peak_mib(),
        "warned": sorted({warning.category.__name__ for warning in caught}),
    }
    return report | facts(pipeline[-1]) | errors(pipeline, key, arguments.test_rows)


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
    keys = [
        {"n": n, "m": m, "rank": rank, "joint": joint, "draw": arguments.draw}
        | {"noise_floor": floor}
        for floor in arguments.noise_floor
        for m in arguments.m
        for rank in arguments.rank
        for joint in arguments.joints
    ]
    for key in keys:
        if table.key(key) in table.rows and not arguments.redo:
            continue
        report = alone(fit, key, arguments) | told
        report |= {"versions": versions, "commit": commit(), "command": command}
        print(table.append({**key, **report}), flush=True)


if __name__ == "__main__":
    main()
