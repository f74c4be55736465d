"""The models of real_data.py: skmtgp's, scikit-learn's, and those of other packages.

``MODELS[name](part, inputs)`` learns one output of a set, from standardised features,
and gives the mean and standard deviation of y for each list of inputs. Where tasks have
units of their own, all but skmtgp's models, which see to it, get targets that are
standardised task by task; elsewhere one mean and scale are taken off all of them.
"""

import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import GridSearchCV, KFold, cross_val_predict

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.kernels import Columns

PEERS = Path(__file__).parent / "peers"
FEW_TASKS = 12  # the largest number with full rank, and a length-scale of each column
ALPHAS = np.logspace(-3, 4, 22)
BOOSTING = {
    "learning_rate": [0.03, 0.1],
    "max_leaf_nodes": [4, 16],
    "min_samples_leaf": [3, 15],
}
KEEP = {"task_feature": "task"}


class LeftOut(Exception):
    """A package that is not here."""


class Learned:
    """Seconds of the processor, and a prediction for each list of inputs."""

    def __init__(self, predictions, seconds, **notes):
        self.predictions, self.seconds, self.notes = predictions, seconds, notes


def few(part):
    """Whether the tasks are few."""
    return part.train.X["task"].nunique() <= FEW_TASKS


def ours(make, part, inputs, settings):
    """One of skmtgp's estimators."""
    begin = time.process_time()
    model = make(part).fit(*part.train)
    found = [model.predict(X, return_std=True, include_noise=True) for X in inputs]
    seconds = time.process_time() - begin
    return Learned(found, seconds, **told(model))


def told(model):
    """Rank, likelihood and what draws are worth, where a fitted model has them."""
    model = getattr(model, "best_estimator_", model)
    names = {
        "rank_": "rank",
        "log_marginal_likelihood_value_": "likelihood",
        "effective_sample_size_": "ess",
        "r_hat_": "r_hat",
    }
    notes = {to: getattr(model, name, None) for name, to in names.items()}
    return {name: float(v) for name, v in notes.items() if np.size(v) == 1 and v}


def default(part):
    """As shipped."""
    return MultiTaskGPRegressor(**KEEP)


def noisy(part):
    """The same with a noise variance of at least a hundredth of the targets'."""
    return MultiTaskGPRegressor(noise_variance_bounds=(1e-2, 1e3), **KEEP)


def squared_exponential(part):
    """The same with the squared exponential, whatever the data say."""
    return MultiTaskGPRegressor("rbf", **KEEP)


def with_priors(hyperparameters, **options):
    """A maker of the defaults with weak priors of the hyperparameters."""
    options = {"hyperparameters": hyperparameters, **KEEP, **options}
    return lambda part: MultiTaskGPRegressor(**options)


def search(part):
    """The rank by BIC."""
    return RankSearchIC(MultiTaskGPRegressor(**KEEP))


class Scaled:
    """Targets of mean zero and deviation one: of each task, or of all.

    Parameters
    ----------
    part : Part
        Whose training targets they are.
    """

    def __init__(self, part):
        labels = part.train.X["task"]
        self.labels = sorted(labels.unique())
        groups = labels if part.own_units else pd.Series("all", index=labels.index)
        by = pd.Series(part.train.y, index=labels.index).groupby(groups.to_numpy())
        self.own, self.means, self.scales = part.own_units, by.mean(), by.std()
        self.y = (part.train.y - self._of(self.means, labels)) / self._of(
            self.scales, labels
        )

    def _of(self, values, labels):
        return values[labels].to_numpy() if self.own else values["all"]

    def codes(self, X):
        """Number of the task of each row."""
        return np.searchsorted(self.labels, X["task"].to_numpy(str))

    def back(self, X, mean, std):
        """Predictions in the unit of the targets."""
        scale = self._of(self.scales, X["task"])
        return self._of(self.means, X["task"]) + scale * mean, scale * std


def by_hand(learn, part, inputs, settings):
    """A model of scaled targets: ``learn(X, codes, y, part)`` gives a predictor."""
    scaled = Scaled(part)
    begin = time.process_time()
    values = part.train.X.drop(columns="task").to_numpy()
    predict = learn(values, scaled.codes(part.train.X), scaled.y, part)
    found = [
        scaled.back(X, *predict(X.drop(columns="task").to_numpy(), scaled.codes(X)))
        for X in inputs
    ]
    return Learned(found, time.process_time() - begin)


def gaussian_process(smooth, n_restarts):
    """Amplitude, kernel and white noise, learned from several starts."""
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * smooth + WhiteKernel(0.1, (1e-8, 1e1))
    return GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=n_restarts, random_state=0
    )


def kernels(d):
    """A squared exponential of d features of deviation 1, and rougher kernels."""
    options = np.full(d, np.sqrt(d)), (1e-2, 1e4)
    return [RBF(*options), *(Matern(*options, nu=nu) for nu in (2.5, 1.5, 0.5))]


def likeliest(kernels, n_restarts, X, y):
    """scikit-learn's GPR with the likeliest of some kernels."""
    models = [gaussian_process(kernel, n_restarts).fit(X, y) for kernel in kernels]
    return max(models, key=lambda model: model.log_marginal_likelihood_value_)


def each_task(X, codes, y, part):
    """scikit-learn's GPR of each task."""
    models = {}
    for task in np.unique(codes):
        rows = codes == task
        models[task] = likeliest(kernels(X.shape[1]), 3, X[rows], y[rows])

    def predict(X, codes):
        mean, std = np.empty((2, len(X)))
        for task, model in models.items():
            rows = codes == task
            if rows.any():
                mean[rows], std[rows] = model.predict(X[rows], return_std=True)
        return mean, std

    return predict


def one_hot(X, codes, y, part):
    """scikit-learn's GPR with a column of each task.

    Few tasks have a length-scale each, many have one together.
    """
    d, n_tasks = X.shape[1], codes.max() + 1
    candidates = kernels(d + n_tasks)
    if not few(part):
        together = Columns(RBF(1.0, (1e-2, 1e4)), list(range(d, d + n_tasks)))
        candidates = [Columns(k, list(range(d))) * together for k in kernels(d)]
    model = likeliest(candidates, 2, wide(X, codes, n_tasks), y)
    return lambda X, codes: model.predict(wide(X, codes, n_tasks), return_std=True)


def wide(X, codes, n_tasks, slopes=False):
    """Features, a column of each task and, if asked, features of each task."""
    dummies = np.eye(n_tasks)[codes]
    own = [(dummies[:, :, None] * X[:, None, :]).reshape(len(X), -1)] if slopes else []
    return np.column_stack([X, dummies, *own])


def ridge(X, codes, y, part):
    """Ridge with a level of each task; with slopes of each, if that is better.

    Its penalty and these are chosen, and its errors measured, by leave-one-out.
    """
    n_tasks = codes.max() + 1
    models = {
        slopes: RidgeCV(ALPHAS, store_cv_results=True).fit(
            wide(X, codes, n_tasks, slopes), y
        )
        for slopes in (False, True)
    }
    slopes, model = max(models.items(), key=lambda item: item[1].best_score_)
    errors = model.cv_results_[:, np.flatnonzero(model.alphas == model.alpha_)[0]]
    deviation = deviations(errors, codes, part)

    def predict(X, codes):
        return model.predict(wide(X, codes, n_tasks, slopes)), deviation[codes]

    return predict


def deviations(squares, codes, part):
    """Deviation of errors: of each task where these have units, else of all."""
    n_tasks = codes.max() + 1
    if not part.own_units:
        return np.full(n_tasks, np.sqrt(squares.mean()))
    return np.sqrt(np.bincount(codes, squares) / np.bincount(codes))


def boosting(X, codes, y, part):
    """Trees with the task as a category; errors by cross-validation."""
    folds = KFold(5, shuffle=True, random_state=0)
    trees = HistGradientBoostingRegressor(
        categorical_features=[X.shape[1]], max_iter=200, random_state=0
    )
    rows = np.column_stack([X, codes])
    model = GridSearchCV(trees, BOOSTING, cv=folds).fit(rows, y).best_estimator_
    errors = y - cross_val_predict(model, rows, y, cv=folds)
    deviation = deviations(errors**2, codes, part)

    def predict(X, codes):
        return model.predict(np.column_stack([X, codes])), deviation[codes]

    return predict


def peer(package, model, part, inputs, settings):
    """Another package's model, in its own environment and process."""
    python = settings.envs / package / "bin" / "python"
    if not python.exists():
        raise LeftOut(f"{package} has no environment: make bench-envs")
    scaled = Scaled(part)

    def rows(X):
        return np.column_stack([X.drop(columns="task").to_numpy(), scaled.codes(X)])

    with tempfile.TemporaryDirectory() as folder:
        problem, result = Path(folder) / "problem.npz", Path(folder) / "result.npz"
        np.savez(
            problem,
            X=rows(part.train.X),
            y=scaled.y,
            X_test=rows(pd.concat(inputs)),
            n_tasks=len(scaled.labels),
            own_units=part.own_units,
        )
        command = [python, PEERS / f"{package}_tasks.py", problem, result]
        command += ["--model", model, "--budget", str(settings.budget)]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode:
            raise RuntimeError((run.stderr.strip().splitlines() or ["no word"])[-1])
        with np.load(result) as file:
            found = {name: file[name] for name in file.files}
    ends = np.cumsum([len(X) for X in inputs])[:-1]
    parts = zip(
        inputs, np.split(found["mean"], ends), np.split(found["std"], ends), strict=True
    )
    notes = {"shape": str(found["shape"]), "cut": int(found["cut"])}
    predictions = [scaled.back(*part) for part in parts]
    return Learned(predictions, float(found["seconds"]), **notes)


def baseline(estimator):
    """A maker of an estimator with its defaults."""
    return lambda part: estimator(**KEEP)


GOALS = ["MultiTaskGPRegressor", "RankSearchIC"]  # held against the best of all
MODELS = {
    "MultiTaskGPRegressor": partial(ours, default),
    "RankSearchIC": partial(ours, search),
    "default, noise >= 0.01": partial(ours, noisy),
    "default, rbf": partial(ours, squared_exponential),
    "default, map": partial(ours, with_priors("map")),
    "default, sampled": partial(ours, with_priors("sampled")),
    "default, 400 draws": partial(ours, with_priors("sampled", n_draws=400)),
    "IndependentGP": partial(ours, baseline(IndependentGP)),
    "PooledGP": partial(ours, baseline(PooledGP)),
    "SingleTaskGP": partial(ours, baseline(SingleTaskGP)),
    "GPR of each task": partial(by_hand, each_task),
    "GPR, one-hot tasks": partial(by_hand, one_hot),
    "ridge": partial(by_hand, ridge),
    "boosted trees": partial(by_hand, boosting),
    "GPy ICM": partial(peer, "gpy", "icm"),
    "GPy LMC": partial(peer, "gpy", "lmc"),
    "GPyTorch ICM": partial(peer, "gpytorch", "icm"),
    "GPyTorch LMC": partial(peer, "gpytorch", "lmc"),
}
WITH_TASKS = [name for name in MODELS if name.startswith("GPy") or "one-hot" in name]
