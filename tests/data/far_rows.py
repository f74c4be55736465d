"""The rows of Dask collections, and a model that is quick."""

import pytest
from sklearn.gaussian_process.kernels import RBF
from sparse_models import STAGED

from skmtgp import MultiTaskGPRegressor

da = pytest.importorskip("dask.array")

N, ROWS = 300, (50, 1, 99, 150)
QUICK = MultiTaskGPRegressor(RBF([1.0, 1.0]), **STAGED | {"max_iter": 3})


def on_dask(X, y, rows=ROWS):
    """The same as Dask arrays, y in other chunks."""
    X = da.from_array(X, chunks=(rows, X.shape[1]))
    return X, da.from_array(y, chunks=(100, *y.shape[1:]))
