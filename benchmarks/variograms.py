"""Variograms by likelihood: what a fit reaches, and ordinary kriging beside PyKrige's.

- "drawn": places on a square and a field with a spherical variogram. How far the fit's
  log likelihood is from the best of a grid of ranges, from several starts.
- "jura": the metals of the Jura (Goovaerts 1997), each alone, the file jura/jura.csv of
  the folder ``--data``. Mean absolute errors of ordinary kriging at the 100 validation
  sites. PyKrige fits its variogram by least squares, with its defaults, in its own
  environment (``make bench-envs``).
"""

import argparse
import json
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.gaussian_process.kernels import Matern

from skmtgp import MultiTaskGPRegressor
from skmtgp.exceptions import UnidentifiedNoiseWarning
from skmtgp.kernels import Spherical

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / "benchmarks" / ".envs" / "pykrige" / "bin" / "python"
METALS, N_TRAIN = ["Cd", "Ni", "Zn"], 259
STARTS, GRID = [0.01, 1.0, 10.0, 1000.0], np.geomspace(0.3, 14.0, 30)
KERNELS = {"exponential": Matern(nu=0.5), "spherical": Spherical()}
PEER = """
import json, sys
import numpy as np
from pykrige.ok import OrdinaryKriging
x, y, z, new_x, new_y = map(np.array, json.load(sys.stdin))
for model in ("exponential", "spherical"):
    kriging = OrdinaryKriging(x, y, z, variogram_model=model)
    print(json.dumps(np.asarray(kriging.execute("points", new_x, new_y)[0]).tolist()))
"""


def fit(kernel, at, values):
    """Ordinary kriging of one variable."""
    X = np.column_stack([at, np.zeros(len(at))])
    return MultiTaskGPRegressor(kernel, rank=1, trend="constant").fit(X, values)


def drawn(n_sets):
    """Print how far below the best of a grid the fits are, in nats."""
    gaps = {start: [] for start in STARTS}
    for seed in range(n_sets):
        rng = np.random.default_rng(seed)
        at = rng.uniform(0.0, 10.0, (100, 2))
        K = Spherical(3.0)(at) + 0.2 * np.eye(100)
        values = rng.multivariate_normal(np.zeros(100), K)
        grid = [fit(Spherical(a, "fixed"), at, values) for a in GRID]
        best = max(of.log_marginal_likelihood_value_ for of in grid)
        for start, of_start in gaps.items():
            found = fit(Spherical(start), at, values).log_marginal_likelihood_value_
            of_start.append(best - found)
    print(f"{n_sets} drawn sets: nats below the best of {len(GRID)} ranges")
    print(f"{'start':>8}{'median':>8}{'worst':>8}")
    for start, of_start in gaps.items():
        print(f"{start:8}{np.median(of_start):8.2f}{max(of_start):8.2f}")


def jura(folder, python):
    """Print errors of kriging each metal alone."""
    table = pd.read_csv(folder / "jura" / "jura.csv")
    places = table[["X", "Y"]].to_numpy()
    print("mean absolute errors, ppm")
    print(f"{'':6}{'':14}{'likelihood':>12}{'PyKrige':>10}")
    for metal in METALS:
        values = table[metal].to_numpy()[:N_TRAIN]
        truth = table[metal].to_numpy()[N_TRAIN:]
        peers = pykrige(python, places[:N_TRAIN], values, places[N_TRAIN:])
        for (name, kernel), peer in zip(KERNELS.items(), peers, strict=True):
            model = fit(kernel, places[:N_TRAIN], values)
            new = np.column_stack([places[N_TRAIN:], np.zeros(len(truth))])
            errors = [np.abs(of - truth).mean() for of in (model.predict(new), peer)]
            print(f"{metal:6}{name:14}{errors[0]:12.3f}{errors[1]:10.3f}", flush=True)


def pykrige(python, at, values, new):
    """Its predictions by both variograms; NaN where it is not installed."""
    if not python.exists():
        return [np.full(len(new), np.nan)] * len(KERNELS)
    given = json.dumps([of.tolist() for of in (*at.T, values, *new.T)])
    command = [python, "-W", "ignore", "-c", PEER]
    options = {"input": given, "stdout": subprocess.PIPE, "text": True, "check": True}
    run = subprocess.run(command, **options)
    return [np.array(json.loads(line)) for line in run.stdout.splitlines()]


def main():
    """Print both parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=20, help="drawn sets")
    parser.add_argument("--data", type=Path, help="folder with jura/jura.csv")
    parser.add_argument("--python", type=Path, default=PYTHON, help="with PyKrige")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # of fits at ranges far too short
    warnings.simplefilter("ignore", UnidentifiedNoiseWarning)
    if arguments.sets:
        drawn(arguments.sets)
    if arguments.data:
        jura(arguments.data, arguments.python)


if __name__ == "__main__":
    main()
