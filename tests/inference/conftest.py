import building
import numpy as np
import pytest
from dense_models import M, draw
from sklearn.gaussian_process.kernels import ConstantKernel

from skmtgp.inference import tiles
from skmtgp.model.task_covariance import ones


@pytest.fixture
def tile(request, monkeypatch):
    monkeypatch.setattr(tiles, "TILE", request.param)


@pytest.fixture
def singular():
    """A likelihood and parameters at which K = 1 1^T in floating point."""
    X, tasks, y = draw()
    return building.dense(ConstantKernel(), ones(M), X, tasks, y), np.array([0, -50.0])
