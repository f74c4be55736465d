"""Functions that may be straight lines."""

import building
import numpy as np
import pytest
from drawn import mode_at
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.learning import lines
from skmtgp.learning.lines import may_be_lines
from skmtgp.model.task_covariance import identity

M = 3
PLAIN, SCALED = RBF([1.0, 1.0]), ConstantKernel() * RBF(1.0)


def learned(curve=0.0, *, scale=8.0, kernel=PLAIN, seed=0):
    """A problem of planes and a curve, and a mode with noise of 0.1, the truth."""
    rng = np.random.default_rng(seed)
    tasks, x = np.repeat(np.arange(M), 40), rng.standard_normal((120, 2))
    y = (rng.standard_normal((M, 2))[tasks] * x).sum(axis=1) + tasks
    y += curve * x[:, 0] ** 2 + np.sqrt(0.1) * rng.standard_normal(len(y))
    problem = building.problem(kernel, identity(M), building.data(x, tasks, y, M))
    theta = problem.theta()
    theta[problem.prior.of_kernel] = np.log(scale)
    theta[problem.prior.of_noise] = np.log(0.1)
    return problem, mode_at(problem, theta)


@pytest.mark.parametrize("scale", [1.0, 8.0])
@pytest.mark.parametrize("kernel", [PLAIN, SCALED])
def test_length_scales_are_long(scale, kernel):
    assert may_be_lines(*learned(scale=scale, kernel=kernel)) == (scale > 2.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("curve", [0.0, 0.5])
def test_of_many_rows_planes_must_leave_noise(curve, seed, monkeypatch):
    assert may_be_lines(*learned(curve, seed=seed))
    monkeypatch.setattr(lines, "MANY", 100)
    assert may_be_lines(*learned(curve, seed=seed)) == (curve == 0.0)
