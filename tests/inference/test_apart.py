"""Tasks that share nothing: stacked matrices against one matrix of all rows."""

from itertools import product

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)

from skmtgp._data.data import Data
from skmtgp._data.known import Known
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.apart import ApartLikelihood, are_apart
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import Dense
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import identity, low_rank, ones

COUNTS = [7, 9, 0, 8, 9]
N_TASKS, N = len(COUNTS), sum(COUNTS)
TASKS = np.repeat(np.arange(N_TASKS), COUNTS)
KERNELS = {
    "rbf": RBF([1.0, 2.0]),
    "one length-scale": Matern(1.0, nu=2.5),
    "steep": Matern([1.0, 2.0], nu=0.5),
    "wide": RBF([1e-4, 1.0]),
    "several": RationalQuadratic() * ConstantKernel(2.0) + WhiteKernel(0.1),
}
FORMS = {
    "identity": identity(N_TASKS),
    "diagonal": low_rank(N_TASKS, 0, diagonal=True),
    "both": identity(N_TASKS, diagonal=True),
    "equal": low_rank(N_TASKS, 0, diagonal="equal"),
}


def pair(prior, *, known=False):
    """The likelihood of stacked matrices, and that of one."""
    rng = np.random.default_rng(0)
    X, y = rng.standard_normal((N, 2)), rng.standard_normal(N)
    counts = rng.integers(1, 4, N).astype(float)
    if known:
        known = Known(rng.uniform(0.0, 0.1, N), counts, rng.uniform(0.0, 0.1, N))
    data = X, TASKS, y, known or None
    return ApartLikelihood(prior, *data), DenseLikelihood(prior, *data)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("form", FORMS)
def test_is_the_same_as_one_matrix(kernel, form):
    rng = np.random.default_rng(1)
    for levels, n_noise, known in product([False, True], [1, N_TASKS], [False, True]):
        prior = Prior(KERNELS[kernel], FORMS[form], n_noise=n_noise, levels=levels)
        theta = prior.theta() + 0.3 * rng.standard_normal(prior.n_theta)
        stacked, one = pair(prior, known=known)
        value, gradient = one.value_and_grad(theta)
        found, slope = stacked.value_and_grad(theta)
        np.testing.assert_allclose([found, stacked.value(theta)], value, rtol=1e-10)
        np.testing.assert_allclose(slope, gradient, rtol=1e-8, atol=1e-8)
        told, information = (of.fisher_information(theta) for of in (stacked, one))
        scale = np.abs(information).max()
        np.testing.assert_allclose(told, information, rtol=1e-8, atol=1e-9 * scale)


def test_is_taken_where_tasks_share_nothing():
    rng = np.random.default_rng(0)
    data = Data(rng.standard_normal((N, 2)), TASKS, rng.standard_normal(N), N_TASKS)
    shared = ones(N_TASKS), low_rank(N_TASKS, 1), low_rank(N_TASKS, 0, shared=True)
    for forms, kind in (FORMS.values(), ApartLikelihood), (shared, DenseLikelihood):
        for form in forms:
            assert type(Dense().likelihood(Prior(RBF(), form), data)) is kind


def test_is_not_taken_if_one_task_has_nearly_all_rows():
    prior = Prior(RBF(), identity(2))
    assert are_apart(prior, np.repeat([0, 1], [30, 31]))
    assert not are_apart(prior, np.repeat([0, 1], [3, 31]))
    assert not are_apart(prior, np.zeros(5, dtype=int))


def test_a_covariance_that_is_not_definite_is_a_rejected_step():
    prior = Prior(RBF(), identity(N_TASKS), log_noise=-200.0)
    stacked, one = pair(prior)
    stacked.X[:] = one.X[:] = 0.0  # all rows are the same
    theta = prior.theta()
    assert stacked.value(theta) == -np.inf
    assert np.isnan(stacked.value_and_grad(theta)[1]).all()
    with pytest.raises(NotPositiveDefiniteError):
        stacked._evaluate(theta)
