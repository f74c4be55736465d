"""The models of grouped.py: mean, deviation or None, and what was chosen."""

from functools import partial

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import RidgeCV
from sklearn.preprocessing import StandardScaler

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC

DEFAULT, SEARCH = FITTED = "MultiTaskGPRegressor", "RankSearchIC"
CHOSEN = "rank", "shared", "diagonal", "noise", "normalize_y"
MANY = 12  # tasks, above which they share a length-scale
PENALTIES = np.logspace(-3, 3, 19)


def ours(make, train, y, test):
    """A model of this package."""
    model = make().fit(train, y)
    mean, std = model.predict(test, return_std=True, include_noise=True)
    return mean, std, chosen_by(model)


def chosen_by(model):
    """What a default chose, as far as the model has it."""
    best = getattr(model, "best_estimator_", model)
    found = {}
    for name in CHOSEN:
        value = getattr(best, f"{name}_", None)
        if value is not None:
            found[name] = value if isinstance(value, str) else str(value)
    if hasattr(model, "best_model_"):
        found["model"] = model.best_model_
    return found


def default(params, *rows):
    """MultiTaskGPRegressor, with its defaults but for these parameters."""
    return ours(partial(MultiTaskGPRegressor, task_feature="task", **params), *rows)


def search(params, *rows):
    """RankSearchIC of the same."""
    estimator = MultiTaskGPRegressor(task_feature="task", **params)
    return ours(partial(RankSearchIC, estimator), *rows)


def independent(_, *rows):
    """IndependentGP, with no parameters."""
    return ours(partial(IndependentGP, task_feature="task"), *rows)


def pooled(_, *rows):
    """PooledGP, with no parameters."""
    return ours(partial(PooledGP, task_feature="task"), *rows)


class SomeRBF(RBF):
    """An RBF of the columns from `first` to before `last`."""

    def __init__(self, length_scale, length_scale_bounds, first=0, last=None):
        super().__init__(length_scale, length_scale_bounds)
        self.first, self.last = first, last

    def __call__(self, X, Y=None, eval_gradient=False):
        """The covariances."""
        of = np.s_[:, self.first : self.last]
        return super().__call__(X[of], None if Y is None else Y[of], eval_gradient)


def gpr(smooth):
    """A Gaussian process of scikit-learn."""
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * smooth + WhiteKernel(0.1, (1e-6, 1e2))
    return GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0
    )


def of_each_task(_, train, y, test):
    """One for each task."""
    A, B = scaled(train, test)
    tasks, new = train["task"].to_numpy(), test["task"].to_numpy()
    mean, std = np.zeros((2, len(B)))
    for task in np.unique(new):
        model = gpr(RBF(np.ones(A.shape[1]), (1e-3, 1e4)))
        model.fit(A[tasks == task], y[tasks == task])
        of = new == task
        mean[of], std[of] = model.predict(B[of], return_std=True)
    return mean, std, {}


def of_dummies(_, train, y, test):
    """One whose inputs are also the tasks, one-hot."""
    d, n_tasks = train.shape[1] - 1, train["task"].nunique()
    if n_tasks <= MANY:
        smooth = RBF(np.ones(d + n_tasks), (1e-3, 1e4))
    else:
        smooth = SomeRBF(np.ones(d), (1e-3, 1e4), last=d)
        smooth *= SomeRBF(1.0, (1e-2, 1e4), first=d)
    A, B = map(np.hstack, zip(scaled(train, test), dummies(train, test), strict=True))
    return *gpr(smooth).fit(A, y).predict(B, return_std=True), {}


def ridge(_, train, y, test, *, slopes=False):
    """Ridge regression with a level, or also slopes, of each task."""
    parts = []
    for X, tasks in zip(scaled(train, test), dummies(train, test), strict=True):
        products = X[:, :, None] * tasks[:, None, :] if slopes else X[:, :0]
        parts.append(np.hstack([X, tasks, products.reshape(len(X), -1)]))
    return RidgeCV(PENALTIES).fit(parts[0], y).predict(parts[1]), None, {}


def boosted(_, train, y, test):
    """Trees with the task as a category; groups are small, and so are leaves."""
    names = np.unique(train["task"])
    A, B = (
        np.column_stack([X, np.searchsorted(names, rows["task"])])
        for X, rows in zip(scaled(train, test), (train, test), strict=True)
    )
    model = HistGradientBoostingRegressor(
        min_samples_leaf=5, categorical_features=[A.shape[1] - 1], random_state=0
    )
    return model.fit(A, y).predict(B), None, {}


def scaled(train, test):
    """Standardised inputs."""
    A, B = (rows.drop(columns="task").to_numpy(float) for rows in (train, test))
    scaler = StandardScaler().fit(A)
    return scaler.transform(A), scaler.transform(B)


def dummies(train, test):
    """A column for each task."""
    names = np.unique(train["task"])
    return [
        (rows["task"].to_numpy()[:, None] == names).astype(float)
        for rows in (train, test)
    ]


GPS = {
    DEFAULT: default,
    SEARCH: search,
    "IndependentGP": independent,
    "PooledGP": pooled,
    "GPR, one-hot tasks": of_dummies,
    "GPR of each task": of_each_task,
}
MODELS = GPS | {
    "ridge, dummies": ridge,
    "ridge, slopes": partial(ridge, slopes=True),
    "boosted trees": boosted,
}
