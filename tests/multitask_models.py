"""Multi-task models with each of the options."""

import functools

from samples import draw
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import MultiTaskGPRegressor

QUICK = {"max_iter": 5}
PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
SHARED = {"normalize_y": "shared", "noise": "shared"}
MODELS = {
    "full rank": PAPER | {"rank": 3},
    "rank 1": PAPER | {"rank": 1},
    "rank 2": PAPER | {"rank": 2},
    "diagonal": PAPER | {"rank": 2, "diagonal": True},
    "noise of each task": PAPER | {"rank": 2, "noise": "per_task"},
    "not normalised": PAPER | {"rank": 2, "normalize_y": False},
    "all": PAPER
    | {"rank": 3, "diagonal": True, "noise": "per_task", "normalize_y": False},
    "amplitude": PAPER | {"rank": 3, "kernel": ConstantKernel(2.0) * RBF([1.0, 3.0])},
    "levels": SHARED | {"rank": 1},
    "units of each task": {"rank": 3, "normalize_y": "per_task", "noise": "shared"},
    "compound symmetry": SHARED | {"rank": 0, "shared": True, "diagonal": "equal"},
    "defaults": {},
}


@functools.cache
def learned(name, n_outputs):
    """One of the models, of one output (None) or several; not to be changed.

    Only those without a rank of their own, and one more, are learned from all starts.
    """
    learning = "annealed" if name in ("defaults", "all") else "staged"
    model = MultiTaskGPRegressor(**MODELS[name], learning=learning, **QUICK)
    return model.fit(*draw(n_outputs=n_outputs))
