"""Tasks that are known, and one that joins."""

import numpy as np
from multitask_models import PAPER
from samples import draw
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor

PLACES = {"first": -5, "middle": 3, "last": 8}
OLD = [0, 2, 4]  # labels; the drawn tasks are 0, 1 and 2, and 3 is new


def split(n_outputs=None, place="last", n_new=4):
    """Samples of the old tasks, and some of a new one."""
    X, y = draw(n_tasks=4, per_task=8, n_outputs=n_outputs)
    labels = np.array([*OLD, PLACES[place]])
    new = X[:, -1] == 3
    X[:, -1] = labels[X[:, -1].astype(int)]
    return X[~new], y[~new], X[new][:n_new], y[new][:n_new]


def learner(**params):
    """From one start: what is known already need not be the best mode."""
    options = PAPER | {"max_iter": 20, "learning": "staged"} | params
    return MultiTaskGPRegressor(RBF([1.0, 1.0]), **options)


def fitted(X, y, **params):
    """A fitted learner; "staged" takes full rank where it is given none."""
    return learner(**params).fit(X, y)
