"""How often intervals hold, by the mode of the hyperparameters and by draws of them.

``python benchmarks/intervals.py`` draws data from the model itself: a squared
exponential of length-scale 1 on [0, 8], K^rho = F F^T with normal F of rank 1 to 3,
noise of deviation 0.2; 3 and 8 tasks of 5, 10, 20 and 50 rows, 20 test points each. The
model is fitted at the true rank and at the one that RankSearchIC chooses, and predicts
by the mode of its hyperparameters, by Laplace's method and by draws of them (``--by``
takes some of these; "seconds" are those of the processor for a fit). Draws of
RankSearchIC are of all ranks that are likely. "y" and "f" are shares of 95 %
intervals that hold new observations and the function, "density" is the mean log density
of new observations, "mse" the mean squared error of f, all averaged over the draws of a
cell. "times" is how many times a fit's likelihoods sampling took, "ess" the effective
sample size of the hyperparameter for which it is least, "rhat" the largest R-hat;
medians.

``--decisions`` fits nothing. It counts which units, noise and kernel the defaults take
for these data, whose tasks share all of them.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from time import process_time

import numpy as np
import pandas as pd
from scipy.special import logsumexp
from scipy.stats import norm
from sklearn.base import clone
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.reading import read

N_TEST, NOISE, RANGE = 20, 0.2, 8.0
FITS = TRUE, CHOSEN = "true rank", "chosen rank"
EARLIER = "BIC's rank"  # as files of before 2026-11-25 have it
EDGES = 0, 2, 4, 8, 12, 16, 24, 32, 100  # of rows a hyperparameter


def draw(n_tasks, n_rows, rank, seed):
    """Training and test rows: X, y and, of the latter, f."""
    return draw_with_factor(n_tasks, n_rows, rank, seed)[:-1]


def draw_with_factor(n_tasks, n_rows, rank, seed):
    """The same, and F."""
    rng = np.random.default_rng([n_tasks, n_rows, rank, seed])
    F = rng.standard_normal((n_tasks, rank)) / np.sqrt(rank)
    n = n_rows + N_TEST
    x, task = rng.uniform(0.0, RANGE, n_tasks * n), np.repeat(np.arange(n_tasks), n)
    K = (F @ F.T)[np.ix_(task, task)] * np.exp(-0.5 * (x[:, None] - x) ** 2)
    values, vectors = np.linalg.eigh(K)
    f = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(x)))
    y, X = f + NOISE * rng.standard_normal(len(x)), np.column_stack([x, task])
    trained = np.tile(np.arange(n) < n_rows, n_tasks)
    return X[trained], y[trained], X[~trained], y[~trained], f[~trained], F


def measured(model, X, y, f):
    """Coverage of y and f, log density and squared error."""
    found, rows = {}, (X[:, :-1], X[:, -1].astype(int))
    for name, target, include_noise in (("y", y, True), ("f", f, False)):
        means, variances = (
            of[..., 0] for of in model._components(*rows, include_noise)
        )
        deviations = np.sqrt(np.maximum(variances, np.finfo(float).tiny))
        below = norm.cdf(target, means, deviations).mean(axis=0)
        found[name] = np.mean((below >= 0.025) & (below <= 0.975))
        if include_noise:
            densities = norm.logpdf(target, means, deviations)
            density = logsumexp(densities, axis=0) - np.log(len(means))
            found["density"] = density.mean()
    found["mse"] = np.mean((model.predict(X) - f) ** 2)
    return found


def fitted(way, rank, X, y, **options):
    """The model at the true rank, or at the one that is chosen."""
    if way == TRUE:
        return MultiTaskGPRegressor(rank=rank, **options).fit(X, y)
    model = MultiTaskGPRegressor(**options)
    return RankSearchIC(model, simpler=False).fit(X, y).best_estimator_


def by_mode(mode, *_):
    """The model as it was fitted."""
    return mode, {}


def by_laplace(mode, way, X, y, _):
    """The same, whose intervals count what is open around the mode."""
    begin = process_time()
    model = clone(mode).set_params(hyperparameters="laplace").fit(X, y)
    return model, {"seconds": process_time() - begin}


def by_draws(mode, way, X, y, n_draws):
    """The same by draws of its hyperparameters."""
    options = {"hyperparameters": "sampled", "n_draws": n_draws}
    model = fitted(way, mode.rank_, X, y, **options)
    return model, {
        "times": model.n_evaluations_ / mode.n_evaluations_ - 1.0,
        "ess": model.effective_sample_size_,
        "rhat": model.r_hat_,
    }


WAYS = {"mode": by_mode, "laplace": by_laplace, "sampled": by_draws}


def compared(fits, names, n_draws, job):
    """Rows of the table: the ways to predict of one data set, at each rank."""
    n_tasks, n_rows, rank, seed = job
    X, y, *test = draw(*job)
    rows = []
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for way in fits:
            begin = process_time()
            mode = fitted(way, rank, X, y)
            seconds = process_time() - begin
            found = {}
            for name in names:
                model, told = WAYS[name](mode, way, X, y, n_draws)
                found[name] = told | measured(model, *test)
            found.get("mode", {}).setdefault("seconds", seconds)
            for name, values in found.items():
                cell = {"tasks": n_tasks, "rows": n_rows, "rank": rank, "seed": seed}
                count = mode._likelihoods[0].prior.n_hyperparameters
                cell["rows a hyperparameter"] = len(y) / count
                rows.append({**cell, "fit": way, "by": name, **values})
    return rows


def decided(job):
    """Whether units are of each task, the noise, and the kernel that are taken."""
    X, y, *_ = draw(*job)
    model = MultiTaskGPRegressor()
    taken = decide(model, read(model, X, y))
    return {
        "tasks": job[0],
        "rows": job[1],
        "units": taken.units.name,
        "noise": taken.noise,
        "kernel": taken.kernel,
    }


def main():
    """Run the cells and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", type=int, nargs="+", default=[3, 8])
    parser.add_argument("--rows", type=int, nargs="+", default=[5, 10, 20, 50])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--seeds", type=int, default=40, help="draws of each cell")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    of_fits = {"choices": FITS, "default": list(FITS), "help": "whose rank is fitted"}
    parser.add_argument("--fits", nargs="+", **of_fits)
    parser.add_argument("--n-draws", type=int, default=100, help="of hyperparameters")
    parser.add_argument("--by", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", help="file of the rows, one JSON object each")
    parser.add_argument("--report", help="such a file, whose table is printed alone")
    parser.add_argument(
        "--decisions", action="store_true", help="what the defaults decide, alone"
    )
    parser.add_argument(
        "--before", help="an earlier one, to hold the draws of --report to"
    )
    args = parser.parse_args()
    if args.before and not args.report:
        parser.error("--before is held against the rows of --report")
    if args.before:
        return compare(
            *(pd.read_json(f, lines=True) for f in (args.before, args.report))
        )
    if args.report:
        return report(pd.read_json(args.report, lines=True))
    seeds = range(args.first, args.first + args.seeds)
    jobs = list(product(args.tasks, args.rows, args.ranks, seeds))
    jobs.sort(key=lambda job: job[3])  # a part of a run has every cell
    if args.decisions:
        with threadpool_limits(1):
            taken = pd.DataFrame([decided(job) for job in jobs])
        print(taken.groupby(list(taken)).size().to_string())
        return
    rows = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for found in pool.map(
            partial(compared, args.fits, args.by, args.n_draws), jobs
        ):
            rows += found
            if args.output:
                pd.DataFrame(found).to_json(
                    args.output, orient="records", lines=True, mode="a"
                )
    report(pd.DataFrame(rows))


def compare(before, now):
    """Print the shares and densities of the same data sets, before and now."""
    names, cells = ["y", "f", "density", "mse"], ["fit", "tasks", "rows"]
    both = before.replace(EARLIER, CHOSEN).merge(
        now, on=[*cells, "rank", "seed", "by"], suffixes=(" before", "")
    )
    both = both[both["by"] == "sampled"]
    columns = [f"{name}{when}" for name in names for when in (" before", "")]
    table = both.groupby(cells)[columns].mean()
    table["draws"] = both.groupby(cells).size()
    print(table.round(3).to_string())
    change = both[names] - both[[f"{name} before" for name in names]].to_numpy()
    change = change.groupby(both["fit"])
    print("\nMean change of a data set, and its standard error\n")
    found = {"change": change.mean(), "error": change.sem()}
    print(pd.concat(found, axis=1).stack().unstack(0).round(3).to_string())


def report(rows):
    """Print the table of the cells, and one over the ranks."""
    cells = rows.groupby(["fit", "tasks", "rows", "rank", "by"])
    table = cells[["y", "f", "density", "mse"]].mean()
    of_cells = [name for name in ("seconds", "times", "ess", "rhat") if name in rows]
    table[of_cells] = cells[of_cells].median()
    table[["y error", "f error"]] = cells[["y", "f"]].sem()
    table["draws"] = cells.size()
    print(table.round(3).to_string(na_rep="-"))
    ways = ["fit", "tasks", "rows", "by"]
    over_ranks, held = rows.groupby(ways), table[["y", "f"]]
    table = held.groupby(ways).mean()  # ranks count alike, whatever their draws
    table[["median density", "median mse"]] = over_ranks[["density", "mse"]].median()
    print("\nOver the ranks\n")
    print(table.round(3).to_string())
    few = pd.cut(rows["rows a hyperparameter"], EDGES, right=False)
    few = rows.groupby(["fit", few, "by"], observed=True)
    table = few[["y", "f"]].mean()
    table[["median density", "median mse"]] = few[["density", "mse"]].median()
    table["fits"] = few.size()
    print("\nBy rows a hyperparameter, of any data set\n")
    print(table.round(3).to_string())


if __name__ == "__main__":
    main()
