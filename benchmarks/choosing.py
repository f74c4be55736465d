r"""Criteria that choose among the candidates of RankSearchIC, side by side.

``python benchmarks/choosing.py`` draws problems of eight tasks of 5, 10 and 20 rows
(true rank 1 and 2) and of three tasks of 10 and 20 rows (true rank 3), by
ordinary_data.py; ``--classes`` takes classes of it instead. All candidates are fitted
once. Each criterion then chooses: how often the true rank, and how well what it has
chosen predicts. "density" is the log density of new observations a row, less that of
the best candidate in hindsight; the rows of a table are medians over the draws.

"laplace" is the evidence by Laplace's method. The prior of the logarithms of
hyperparameters is normal around where learning starts, with deviation `WIDE`; that of
the factor of K^rho has deviation 1 / sqrt(rank) in the targets' deviations. Rotations
of the factor do not change the likelihood: the integral along them is their volume,

.. math:: \mathrm{vol}\,O(r)\,\prod_{i<j} \sqrt{s_i^2 + s_j^2}

with the singular values s of the factor, and Laplace's method is left to the other
directions. Curvature below the prior's (the likelihood is flat, or the mode is at a
bound) counts as the prior's.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from zlib import crc32

import numpy as np
import pandas as pd
from ordinary_data import BASE, CLASSES, draw, problem, split
from ordinary_models import is_right
from scipy.linalg import eigvalsh
from scipy.special import gammaln
from threadpoolctl import threadpool_limits

from skmtgp import RankSearchIC, SingleTaskGP

SETTINGS = {
    f"{M} tasks of {rows}, rank {rank}": {"n_tasks": M, "rows": rows, "rank": rank}
    for M, sizes, ranks in [(8, (5, 10, 20), (1, 2)), (3, (10, 20), (3,))]
    for rank in ranks
    for rows in sizes
}
CRITERIA = "bic", "aic", "hqc", "loo", "laplace"
WIDE = 3.0  # deviation of the logarithms of hyperparameters
STEP = 1e-4  # of a difference of gradients


def problem_of(name, seed):
    """A draw of a setting, or of a class of the suite."""
    if name in CLASSES:
        return problem(name, seed)
    rng = np.random.default_rng([crc32(name.encode()), seed])
    settings = {**BASE, **SETTINGS[name], "n_inputs": int(rng.integers(1, 3))}
    return draw(rng, **settings)


def evidence(model):
    """The log evidence of a fitted model, in units of y."""
    if isinstance(model, SingleTaskGP):
        return sum(map(evidence, model.estimators_))
    (likelihood,), theta = model._likelihoods, model.theta_
    prior = likelihood.prior
    mean, deviation, F = _prior(prior, theta)
    precision = deviation**-2.0
    log_prior = -0.5 * np.sum(((theta - mean) / deviation) ** 2)
    log_prior -= np.log(deviation).sum() + 0.5 * len(theta) * np.log(2.0 * np.pi)
    tangents, log_volume = _orbit(prior, theta, F)
    rest = np.linalg.svd(tangents)[0][:, tangents.shape[1] :]
    own = rest.T @ (precision[:, None] * rest)
    values = eigvalsh(rest.T @ _hessian(likelihood, theta) @ rest, own)
    log_det = np.linalg.slogdet(own)[1] + np.log1p(np.maximum(values, 0.0)).sum()
    gained = 0.5 * rest.shape[1] * np.log(2.0 * np.pi) - 0.5 * log_det
    value = model.log_marginal_likelihood_value_
    return value + log_prior + gained + log_volume


def _prior(prior, theta):
    """Mean and deviation of each parameter, and the factor of K^rho."""
    mean, deviation = prior.theta(), np.full(len(theta), WIDE)
    form = prior.task_covariance
    rank = getattr(form, "rank", 0)
    begin = prior.kernel.n_dims
    of_factor = slice(begin, begin + form.n_tasks * rank)
    mean[of_factor], deviation[of_factor] = 0.0, 1.0 / np.sqrt(max(rank, 1))
    return mean, deviation, theta[of_factor].reshape(form.n_tasks, rank)


def _orbit(prior, theta, F):
    """Directions of rotations of the factor, and the log volume of all rotations."""
    rank, begin = F.shape[1], prior.kernel.n_dims
    tangents, sizes = [], np.linalg.svd(F, compute_uv=False)
    for i in range(rank):
        for j in range(i):
            tangent = np.zeros((len(F), rank))
            tangent[:, i], tangent[:, j] = F[:, j], -F[:, i]
            tangents.append(np.zeros(len(theta)))
            tangents[-1][begin : begin + F.size] = tangent.ravel()
    speeds = [np.hypot(sizes[i], sizes[j]) for i in range(rank) for j in range(i)]
    k = np.arange(rank)  # spheres of dimension 0, which are two points, to rank - 1
    spheres = np.log(2.0) + 0.5 * (k + 1) * np.log(np.pi) - gammaln(0.5 * (k + 1))
    columns = np.array(tangents).reshape(-1, len(theta)).T
    return columns, spheres.sum() + np.log(np.maximum(speeds, 1e-12)).sum()


def _hessian(likelihood, theta):
    """Of minus the log likelihood, by differences of gradients."""

    def slope(at):
        return -likelihood.value_and_grad(at)[1]

    steps = STEP * np.eye(len(theta))
    H = [(slope(theta + step) - slope(theta - step)) / (2.0 * STEP) for step in steps]
    return 0.5 * (np.array(H) + np.transpose(H))


def measured(job):
    """A frame of the candidates of a problem: criteria, and how they predict."""
    name, seed = job
    drawn = problem_of(name, seed)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = RankSearchIC(criterion="loo", keep_estimators=True)
        search.fit(drawn.X, drawn.y)
        table = search.results_.assign(setting=name, seed=seed)
        table["laplace"] = [-2.0 * evidence(model) for model in search.estimators_]
        found = [predicted(model, drawn) for model in search.estimators_]
    table["density"], table["error"] = zip(*found, strict=True)
    table["right"] = [is_right(of, drawn) for of in table["model"]]
    return table


def predicted(model, drawn):
    """Log density of new observations a row, and the error of f over its size."""
    mean, std = model.predict(drawn.X_test, return_std=True, include_noise=True)
    tasks, f = split(drawn.X_test)[1], drawn.f_test
    squares = np.square(f - mean)
    expected = squares + np.square(drawn.truth.noise[tasks])
    density = -0.5 * (expected / std**2 + np.log(2.0 * np.pi * std**2))
    size = drawn.truth.size(drawn.X.shape[1] - 1)[tasks]
    return float(density.mean()), float((squares / size).mean())


def choices(table, criterion):
    """What a criterion has chosen of each problem, over the best in hindsight."""
    groups = table.groupby(["setting", "seed"], sort=False)
    chosen = table.loc[groups[criterion].idxmin()].set_index(["setting", "seed"])
    chosen["density"] -= groups["density"].max()
    chosen["error"] /= groups["error"].min()
    return chosen.reset_index()


def report(table):
    """Print a table for each measure: settings by criteria."""
    found = {name: choices(table, name) for name in CRITERIA}
    for title, column, how in [
        ("True model chosen, %", "right", lambda of: 100.0 * of.astype(float).mean()),
        (
            "Log density of new rows less the best candidate's, median",
            "density",
            "median",
        ),
        ("The same, mean", "density", "mean"),
        ("Error over the best candidate's, median", "error", "median"),
    ]:
        by = {
            name: of.groupby("setting", sort=False)[column].agg(how)
            for name, of in found.items()
        }
        print(f"\n{title}\n")
        frame = pd.DataFrame(by)
        frame.loc["ALL"] = {name: of[column].agg(how) for name, of in found.items()}
        print(frame.to_string(float_format="{:.3g}".format))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=None)
    parser.add_argument("--seeds", type=int, default=40, help="draws of each")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", help="a table of all candidates, csv")
    arguments = parser.parse_args()
    names = arguments.classes or list(SETTINGS)
    jobs = [(name, seed) for name in names for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        table = pd.concat(list(pool.map(measured, jobs)), ignore_index=True)
    if arguments.output:
        table.to_csv(arguments.output, index=False)
    report(table)


if __name__ == "__main__":
    main()
