"""Posteriors of likelihoods that share rows with others."""

import numpy as np
import pytest
from dense_models import FORMS, KERNELS, M
from pairs import in_pairs

from skmtgp._data.data import Data
from skmtgp._numerics.updates import UpdatedCholesky
from skmtgp.inference.engines import Dense, Sparse
from skmtgp.model.prior import Prior

RNG = np.random.default_rng(0)
X, Y = RNG.uniform(0.1, 2.0, (40, 4)), RNG.standard_normal(40)
TASKS = RNG.integers(0, M, 40)
TASKS[:M] = TASKS[20 : 20 + M] = np.arange(M)
Z, TASKS_Z = RNG.uniform(0.1, 2.0, (6, 4)), np.array([0, 3, 1, 1, 2, 0])


def likelihood(engine, prior, rows):
    """Of some rows, sorted by task, and those rows in that order."""
    rows = rows[np.argsort(TASKS[rows], kind="stable")]
    data = Data(X[rows], TASKS[rows], Y[rows], M, Z=X[:8])
    return engine.likelihood(prior, data), rows


def compare(found, expected, digits=9):
    for method in ("mean", "variance", "covariance"):
        a, b = (getattr(of, method)(Z, TASKS_Z) for of in (found, expected))
        atol = 10.0**-digits * np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=0.0, atol=atol)
    for a, b in zip(found.leave_one_out(), expected.leave_one_out(), strict=True):
        np.testing.assert_allclose(a, b, rtol=10.0**-digits, atol=10.0**-digits)
    np.testing.assert_allclose(found.level_variances(), expected.level_variances())
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-9)


@in_pairs(
    kernel=KERNELS,
    form=FORMS,
    n_noise={"shared": 1, "per task": M},
    levels={"no levels": False, "levels": True},
    rows={
        "come": np.arange(40),
        "go": np.arange(3, 30),
        "come and go": np.arange(7, 40),
        "stay": np.arange(30),
    },
)
def test_dense(kernel, form, n_noise, levels, rows):
    prior, engine = Prior(kernel, form, n_noise=n_noise, levels=levels), Dense()
    theta = prior.theta() + 0.1
    before, old = likelihood(engine, prior, np.arange(30))
    after, new = likelihood(engine, prior, rows)
    origin = np.array([np.append(np.flatnonzero(old == row), -1)[0] for row in new])
    posterior = before.posterior(theta)
    found = engine.updated(posterior, after, theta, origin)
    assert isinstance(found.cholesky, UpdatedCholesky)
    compare(found, after.posterior(theta))
    compare(posterior, before.posterior(theta))  # it stays as it is


@pytest.mark.parametrize("rows", [np.arange(40), np.arange(5, 30)], ids=["come", "go"])
@pytest.mark.parametrize("form", ["rank 1", "rank 2, diagonal", "identity"])
def test_sparse(form, rows):
    prior, engine = Prior(KERNELS["matern"], FORMS[form], levels=True), Sparse()
    theta = prior.theta() + 0.1
    before, old = likelihood(engine, prior, np.arange(30))
    after, new = likelihood(engine, prior, rows)
    origin = np.array([np.append(np.flatnonzero(old == row), -1)[0] for row in new])
    stays = np.arange(len(old))
    posterior = engine.updated(before.posterior(theta), before, theta, stays)
    found = engine.updated(posterior, after, theta, origin)
    compare(found, after.posterior(theta))


def test_a_factor_is_made_anew_when_as_many_rows_have_gone():
    prior, engine = Prior(KERNELS["rbf"], FORMS["rank 1"]), Dense()
    theta = prior.theta()
    before, old = likelihood(engine, prior, np.arange(40))
    after, new = likelihood(engine, prior, np.arange(25, 40))
    origin = np.searchsorted(old, new, sorter=np.argsort(old))
    origin = np.argsort(old)[origin]
    found = engine.updated(before.posterior(theta), after, theta, origin)
    assert not isinstance(found.cholesky, UpdatedCholesky)
    compare(found, after.posterior(theta))
