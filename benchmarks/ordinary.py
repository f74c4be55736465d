"""A suite of drawn problems with a known truth: what the learner finds of each.

``python benchmarks/ordinary.py --output FILE.jsonl`` fits ``MultiTaskGPRegressor()``
("default"), ``RankSearchIC()`` ("search") and the baselines to some draws of each class
of ordinary_data.py, looks for the best modes of what the first two chose ("best"), and
prints the report of ordinary_report.py. Each fit is a line of the file, written when it
is known; what is there is not run again. ``--report`` prints what files have.

- "best" is dear. It maximises the likelihood of the model that a fit chose (rank,
  units, noise) from 20 random restarts, and by L-BFGS from the truth's own parameters.
  The best known is the highest likelihood of the same model in all files, those of
  ``--also`` too.
- ``--params rank=2 noise=shared`` are parameters of MultiTaskGPRegressor, alone and in
  the search; ``rank=truth`` gives each problem its own. They are reported apart.
- A fit that takes longer than ``--limit`` seconds of the processor has failed. Failed
  fits are counted and named.

Seconds are the processor's, of one thread.
"""

import argparse
import json
import resource
import signal
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from ordinary_data import CLASSES, HUNDREDS, problem, split
from ordinary_report import report
from scipy.optimize import minimize
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.linear_model import RidgeCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.kernels import ARDLinear, Columns

FITTED = "default", "search"
PARTS = *FITTED, "baselines", "best"
OF_THE_MODEL = ("noise_variance_bounds",)  # beside what is learned or chosen
FAR = 1e100  # for a likelihood that cannot be computed
ROUNDS = 5  # of L-BFGS, each from where the one before has ended


class Results:
    """Rows of a file, one for each problem, model and settings; the last one counts.

    Parameters
    ----------
    path : Path or None
        To which rows are appended. None keeps them in memory alone.
    also : sequence of Path
        Files of other versions. Their baselines and best modes count as if they were in
        the file, their fits for the best known likelihoods alone.
    """

    def __init__(self, path, also=()):
        self.path, self.rows = path, {}
        for of in also:
            for row in _read(of):
                if row["model"] in FITTED:
                    row["model"] += f" of {of}"
                self.rows[self.key(row)] = row
        if path is not None and path.exists():
            self.rows |= {self.key(row): row for row in _read(path)}

    @staticmethod
    def key(row):
        """What identifies a row."""
        return row["problem"], row["model"], row["settings"]

    def append(self, row):
        """Add a row, to the file at once."""
        self.rows[self.key(row)] = row
        if self.path is not None:
            with self.path.open("a") as file:
                file.write(json.dumps(row) + "\n")


def _read(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


# the models


def params_of(params, drawn):
    """Parameters of MultiTaskGPRegressor for a problem."""
    if params.get("rank") != "truth" or drawn.rank is None:
        return {key: value for key, value in params.items() if value != "truth"}
    return {**params, "rank": drawn.rank, "shared": drawn.rank == 0}


def with_dummies(X):
    """A column for each task before the column of the task."""
    tasks = split(X)[1]
    return np.column_stack([X[:, :-1], np.eye(tasks.max() + 1)[tasks], tasks])


class Ridge:
    """Ridge regression on the inputs and a dummy for each task."""

    def fit(self, X, y):
        """Choose the penalty by leave-one-out and learn."""
        model = RidgeCV(np.logspace(-2, 4, 25))
        self._model = make_pipeline(StandardScaler(), model)
        self._model.fit(with_dummies(X)[:, :-1], y)
        return self

    def predict(self, X):
        """Predict."""
        return self._model.predict(with_dummies(X)[:, :-1])


class Leveled:
    """PooledGP with a level of each task in its kernel."""

    def fit(self, X, y):
        """Learn."""
        d, n_tasks = X.shape[1] - 1, len(np.unique(X[:, -1]))
        smooth = ConstantKernel() * RBF(np.full(d, np.sqrt(d)), (1e-1, 1e4))
        level = ConstantKernel(0.1) * ARDLinear(
            1.0, 0.0, weights_bounds="fixed", bias_bounds="fixed"
        )
        kernel = Columns(smooth, list(range(d)))
        kernel += Columns(level, list(range(d, d + n_tasks)))
        self._model = PooledGP(kernel).fit(with_dummies(X), y)
        return self

    def predict(self, X, **options):
        """Predict."""
        return self._model.predict(with_dummies(X), **options)


class TrueParameters:
    """The Gaussian process that the problem was drawn from."""

    def __init__(self, drawn):
        self.drawn, self.log_marginal_likelihood_value_ = drawn, None

    def fit(self, X, y):
        """Predict the problem's own rows."""
        found = self.drawn.truth.posterior(X, y, self.drawn.X_test)
        self._mean, self._std, self.log_marginal_likelihood_value_ = found
        return self

    def predict(self, X, return_std, include_noise):
        """The predictions, whatever X is."""
        noise = self.drawn.truth.noise[split(X)[1]]
        return self._mean, np.hypot(self._std, noise)


class Without:
    """The default model of all tasks but the last, which is unrelated."""

    def fit(self, X, y):
        """Learn."""
        kept = X[:, -1] < X[:, -1].max()
        self._model = MultiTaskGPRegressor().fit(X[kept], y[kept])
        return self

    def predict(self, X, **options):
        """Predictions, NaN of the last task."""
        kept, mean = X[:, -1] < X[:, -1].max(), np.full((2, len(X)), np.nan)
        mean[:, kept] = self._model.predict(X[kept], **options)
        return mean


BASELINES = {
    "independent": IndependentGP,
    "pooled": PooledGP,
    "single": SingleTaskGP,
    "truth": TrueParameters,
    "ridge": Ridge,
    "leveled": Leveled,
    "without": Without,
}


def baselines_of(name):
    """What is fitted to problems of a class beside the models of tasks."""
    more = {name: ["ridge", "leveled"] for name in HUNDREDS}
    more["one-unrelated"] = ["without"]
    return ["independent", "pooled", "single", "truth", *more.get(name, [])]


def make(model, params, drawn):
    """An estimator by its name."""
    if model == "truth":
        return TrueParameters(drawn)
    if model in BASELINES:
        return BASELINES[model]()
    params = params_of(params, drawn)
    if model == "default":
        return MultiTaskGPRegressor(**params)
    params = {key: of for key, of in params.items() if key not in ("rank", "shared")}
    return RankSearchIC(MultiTaskGPRegressor(**params))


# one fit


def run(job):
    """The row of a job: problem, model, parameters and how it is to be run."""
    name, model, params, options = job
    row = {"problem": name, "model": model, "settings": settings_of(params)}
    measure = best if model == "best" else fitted
    begin = time.process_time()
    resource.setrlimit(resource.RLIMIT_AS, (int(options["memory"] * 2**30), -1))
    with threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with limited(options["limit"]):
                row |= measure(draw_of(name), model, params, options)
        except Exception as error:  # the suite goes on, and counts it
            row["failed"] = f"{type(error).__name__}: {error}"[:200]
    row.setdefault("seconds", round(time.process_time() - begin, 3))
    names = (warning.category.__name__ for warning in caught)
    return row | {"warnings": dict(Counter(names))}


def draw_of(name):
    """The problem called "class/seed"."""
    of, seed = name.split("/")
    return problem(of, int(seed))


def settings_of(params):
    """Parameters in words."""
    return " ".join(f"{k}={v}" for k, v in sorted(params.items())) or "as shipped"


@contextmanager
def limited(seconds):
    """Raise TimeoutError after so many seconds of the processor."""

    def stop(*_):
        raise TimeoutError(f"longer than {seconds:g} s")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def fitted(drawn, model, params, _):
    """What a fit learned, and its errors."""
    begin = time.process_time()
    estimator = make(model, params, drawn).fit(drawn.X, drawn.y)
    row = {"n": len(drawn.y), "true_rank": drawn.rank, "unrelated": drawn.unrelated}
    row["seconds"] = round(time.process_time() - begin, 3)
    return row | learned(estimator, params) | scores(estimator, drawn)


def learned(estimator, params):
    """Likelihood, size, and what was chosen: `config` is what "best" needs."""
    of = getattr(estimator, "best_estimator_", estimator)
    row = {"lml": getattr(of, "log_marginal_likelihood_value_", None)}
    if isinstance(of, MultiTaskGPRegressor):
        row["config"] = {
            **{key: params[key] for key in OF_THE_MODEL if key in params},
            "rank": of.rank_,
            "shared": of.shared,
            "diagonal": of.diagonal,
            "task_levels": of.task_levels,
            "normalize_y": of.normalize_y_,
            "noise": of.noise_,
        }
        row["evaluations"] = int(of.n_evaluations_)
        row["hyperparameters"] = int(of.n_hyperparameters_)
    return row


def scores(estimator, drawn):
    """NMSE of f of each task, and the probability of y in its 95 % interval.

    Errors are divided by the true variance of the task's function without its level.
    """
    tasks, n_tasks = split(drawn.X_test)[1], len(drawn.truth.level)
    size = drawn.truth.size(drawn.X.shape[1] - 1)
    if isinstance(estimator, Ridge):
        mean, std = estimator.predict(drawn.X_test), None
    else:
        mean, std = estimator.predict(drawn.X_test, return_std=True, include_noise=True)
    squares = np.square(mean - drawn.f_test) / size[tasks]
    counts = np.bincount(tasks, minlength=n_tasks)
    errors = np.bincount(tasks, squares, n_tasks) / counts
    row = {"errors": [None if np.isnan(e) else float(f"{e:.4g}") for e in errors]}
    if std is not None:
        ends = mean + np.outer([-1.0, 1.0], norm.ppf(0.975) * std)
        low, high = norm.cdf((ends - drawn.f_test) / drawn.truth.noise[tasks])
        row["coverage"] = round(float(np.nanmean(high - low)), 4)
    return row


# the best modes


def best(drawn, _, params, options):
    """The best of random restarts, and of a climb from the truth."""
    params = {key: value for key, value in params.items() if key != "restarts"}
    row = {"config": params, "from_truth": from_truth(drawn, params)}
    try:
        model = MultiTaskGPRegressor(
            **params, n_restarts_optimizer=options["restarts"], random_state=0
        ).fit(drawn.X, drawn.y)
    except Exception as error:
        failed = f"{type(error).__name__}: {error}"[:200]
        return row | {"lml": row["from_truth"], "failed": failed}
    row["restarts"] = model.log_marginal_likelihood_value_
    row["evaluations"] = int(model.n_evaluations_)
    return row | {"lml": max(row["restarts"], row["from_truth"])}


def from_truth(drawn, params):
    """The likelihood that L-BFGS reaches from the truth's parameters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MultiTaskGPRegressor(**params, max_iter=0).fit(drawn.X, drawn.y)
        lower, upper = model._likelihoods[0].prior.bounds()
        theta = np.clip(true_theta(model, drawn), lower, upper)

        def objective(theta):
            value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
            if not (np.isfinite(value) and np.isfinite(gradient).all()):
                return FAR, np.zeros_like(theta)
            return -value, -gradient

        value = np.inf
        for _ in range(ROUNDS):
            found = minimize(
                objective,
                theta,
                jac=True,
                method="L-BFGS-B",
                bounds=np.column_stack([lower, upper]),
                options={"maxiter": 1000, "maxfun": 1500, "maxcor": 50, "ftol": 1e-12},
            )
            gain, value, theta = value - found.fun, found.fun, found.x
            if gain < 1e-2:
                break
    return float(-value)


def true_theta(model, drawn):
    """Theta of a model that is nearest to the truth, moved a little off saddles."""
    truth, prior = drawn.truth, model._likelihoods[0].prior
    scale = np.broadcast_to(model._units.scale[0], truth.level.shape)
    factor = truth.factor / scale[:, None]
    lengths = np.log(np.minimum(truth.length_scales, 1e6))
    weights = np.square(factor).sum(axis=0)
    noise = np.log(np.square(truth.noise / scale))
    theta = prior.theta(
        kernel=weights @ lengths / weights.sum(),
        K_rho=factor @ factor.T,
        log_noise=noise if model.noise_ == "per_task" else noise.mean(),
    )
    begin = model.kernel_.n_dims
    rho = slice(begin, begin + prior.task_covariance.n_parameters)
    theta[rho] += 1e-3 * np.random.default_rng(0).standard_normal(rho.stop - begin)
    if model.task_levels:
        level = np.square(truth.level / scale).mean()
        theta[rho.stop] = np.log(level + np.finfo(float).tiny)
    return theta


# what is to be run


def problems_of(arguments):
    """Names of problems; the first seed of all classes comes first."""
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    return [f"{name}/{seed}" for seed in seeds for name in arguments.classes]


def fits_of(name, arguments):
    """Models that are fitted to a problem, and their parameters."""
    of_tasks = [model for model in FITTED if model in arguments.only]
    yield from ((model, arguments.params) for model in of_tasks)
    if "baselines" in arguments.only:
        yield from ((model, {}) for model in baselines_of(name.split("/")[0]))


def best_of(name, results, arguments):
    """What the fits to a problem have chosen, of which the best is to be known."""
    for model in FITTED:
        row = results.rows.get((name, model, settings_of(arguments.params)), {})
        if "config" in row and row["n"] <= arguments.most_rows:
            yield "best", {**row["config"], "restarts": arguments.restarts}


def missing(jobs, results, redo):
    """Jobs whose rows are not there, once each."""
    found = {}
    for name, model, params in jobs:
        key = name, model, settings_of(params)
        if redo or key not in results.rows:
            found[key] = name, model, params
    return list(found.values())


def work(jobs, results, arguments):
    """Run jobs, each row to the file when it is known."""
    options = {key: getattr(arguments, key) for key in ("limit", "memory", "restarts")}
    jobs = [(*job, options) for job in jobs]
    if arguments.jobs == 1:
        for job in jobs:
            keep(run(job), results)
        return
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for done in as_completed([pool.submit(run, job) for job in jobs]):
            keep(done.result(), results)


def keep(row, results):
    """Store a row, and say so."""
    results.append(row)
    told = row.get("failed", f"{row.get('lml') or np.nan:.2f} nats")
    name = f"{row['problem']} {row['model']} ({row['settings']})"
    print(f"{name}: {told}, {row['seconds']:.1f} s", flush=True)


def parameter(text):
    """A parameter's name and value."""
    name, value = text.split("=", 1)
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    parser.add_argument("--seeds", type=int, default=13, help="draws of each class")
    parser.add_argument("--first", type=int, default=0, help="first of them")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--params", nargs="+", type=parameter, default=[])
    parser.add_argument("--restarts", type=int, default=20)
    parser.add_argument(
        "--most-rows", type=int, default=1000, help="of which the best is looked for"
    )
    parser.add_argument("--limit", type=float, default=300.0, help="seconds of a fit")
    parser.add_argument("--memory", type=float, default=6.0, help="GiB of a fit")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--output", type=Path, help="to which rows are appended")
    parser.add_argument("--also", type=Path, nargs="+", default=[], help="more to read")
    parser.add_argument("--redo", action="store_true", help="also what is there")
    parser.add_argument("--report", action="store_true", help="run nothing")
    arguments = parser.parse_args()
    arguments.params = dict(arguments.params)
    results = Results(arguments.output, arguments.also)
    names = problems_of(arguments)
    if not arguments.report:
        fits = [(name, *of) for name in names for of in fits_of(name, arguments)]
        work(missing(fits, results, arguments.redo), results, arguments)
        if "best" in arguments.only:
            of = partial(best_of, results=results, arguments=arguments)
            modes = [(name, *found) for name in names for found in of(name)]
            work(missing(modes, results, arguments.redo), results, arguments)
    place = {name: k for k, name in enumerate(names)}
    rows = [row for row in results.rows.values() if row["problem"] in place]
    rows.sort(key=lambda row: place[row["problem"]])
    report(rows, settings_of(arguments.params))


if __name__ == "__main__":
    main()
