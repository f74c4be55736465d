"""Multi-task models with each of the options."""

import functools

from samples import draw
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import MultiTaskGPRegressor

QUICK = {"max_iter": 5}
MODELS = {
    "full rank": {},
    "rank 1": {"rank": 1},
    "rank 2": {"rank": 2},
    "diagonal": {"rank": 2, "diagonal": True},
    "noise of each task": {"rank": 2, "noise": "per_task"},
    "not normalised": {"rank": 2, "normalize_y": False},
    "all": {"diagonal": True, "noise": "per_task", "normalize_y": False},
    "amplitude": {"kernel": ConstantKernel(2.0) * RBF([1.0, 3.0])},
}


@functools.cache
def learned(name, n_outputs):
    """One of the models, of one output (None) or several; not to be changed."""
    return MultiTaskGPRegressor(**MODELS[name], **QUICK).fit(*draw(n_outputs=n_outputs))
