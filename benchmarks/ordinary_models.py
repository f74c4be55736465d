"""The models of ordinary.py, one fit at a time, and the best modes of their choices."""

import resource
import signal
import time
import warnings
from collections import Counter
from contextlib import contextmanager

import numpy as np
from ordinary_data import HUNDREDS, problem, split
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
from skmtgp.learning.penalised import AlikeNoise

OF_THE_MODEL = ("noise_variance_bounds",)  # beside what is learned or chosen
NUDGE = 1e-2  # of the truth's parameters, off saddles
FAR = 1e100  # for a likelihood that cannot be computed
ROUNDS = 5  # of L-BFGS, each from where the one before has ended


def params_of(params, drawn):
    """Parameters of MultiTaskGPRegressor for a problem."""
    if params.get("rank") == "full":
        return {**params, "rank": len(drawn.truth.level)}
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
    return row | learned(estimator, params, drawn) | scores(estimator, drawn)


def learned(estimator, params, drawn):
    """Likelihood, size, and what was chosen: `config` is what "best" needs.

    "noise" is the deviation that was learned over the true one, the mean of logarithms.
    """
    of = getattr(estimator, "best_estimator_", estimator)
    row = {"lml": getattr(of, "log_marginal_likelihood_value_", None)}
    if isinstance(estimator, RankSearchIC):
        row["chose"] = estimator.best_model_
    elif isinstance(of, MultiTaskGPRegressor):
        row["chose"] = str(of._likelihoods[0].prior.task_covariance)
    if "chose" in row:
        row["right"] = is_right(row["chose"], drawn)
    if isinstance(of, MultiTaskGPRegressor):
        row["config"] = {
            **{key: params[key] for key in OF_THE_MODEL if key in params},
            "kernel": name_of(of.kernel_),
            "rank": of.rank_,
            "shared": of.shared_,
            "diagonal": of.diagonal_,
            "task_levels": of.task_levels,
            "normalize_y": of.normalize_y_,
            "noise": of.noise_,
        }
        row["objective"] = row["lml"] + log_density(of, of.theta_)[0]
        row["evaluations"] = int(of.n_evaluations_)
        row["hyperparameters"] = int(of.n_hyperparameters_)
        log_noise = 0.5 * np.log(of.noise_variance_) - np.log(drawn.truth.noise)
        row["noise"] = float(f"{np.exp(log_noise.mean()):.4g}")
    return row


def log_density(model, theta):
    """Of theta, which is learned together with the likelihood, and its gradient.

    It is that of the noise of each task, if each has its own. That of little noise is
    left out, which counts against the fits.
    """
    prior = model._likelihoods[0].prior
    return AlikeNoise(prior, model._noise_deviation()).log_density(theta)


def name_of(kernel):
    """The name that a smoothness has as a parameter."""
    return {0.5: "exponential", 1.5: "matern", 2.5: "matern52"}.get(
        getattr(kernel, "nu", None), "rbf"
    )


def is_right(name, drawn):
    """Whether the model of the problem was chosen; None if none is."""
    if drawn.rank is None:
        return None
    factor = drawn.truth.factor
    if drawn.rank == len(factor) > 1 and np.count_nonzero(factor) == len(factor):
        return name in ("independent", "single tasks", f"rank {drawn.rank}")
    if drawn.unrelated is not None and name == f"rank {drawn.rank - 1} and diagonal":
        return True  # the unrelated task has a function to itself
    return name == (f"rank {drawn.rank}" if drawn.rank else "shared")


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
        return row | {"objective": row["from_truth"], "failed": failed}
    value = model.log_marginal_likelihood_value_
    row["restarts"] = value + log_density(model, model.theta_)[0]
    row["evaluations"] = int(model.n_evaluations_)
    return row | {"objective": max(row["restarts"], row["from_truth"])}


def from_truth(drawn, params):
    """The objective that L-BFGS reaches from the truth's parameters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MultiTaskGPRegressor(**params, max_iter=0).fit(drawn.X, drawn.y)
        lower, upper = model._likelihoods[0].prior.bounds()
        theta = np.clip(true_theta(model, drawn), lower, upper)

        def objective(theta):
            value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
            if not (np.isfinite(value) and np.isfinite(gradient).all()):
                return FAR, np.zeros_like(theta)
            of_theta, slope = log_density(model, theta)
            return -value - of_theta, -gradient - slope

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
    theta[rho] += NUDGE * np.random.default_rng(0).standard_normal(rho.stop - begin)
    if model.task_levels:
        level = np.square(truth.level / scale).mean()
        theta[rho.stop] = np.log(max(level, NUDGE))  # a logarithm far down is stuck
    return theta
