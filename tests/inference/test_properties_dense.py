"""What holds for any data and any parameters: the engines."""

import building
import numpy as np
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from sklearn.gaussian_process.kernels import ConstantKernel
from strategies import (
    DIGITS,
    NOISE,
    WIDE,
    Model,
    assert_gradient,
    engines,
    examples,
    kernels,
    permuted,
    rounding,
    seeds,
    tables,
)

from skmtgp.inference.border import BorderLikelihood
from skmtgp.model.task_covariance import FixedTaskCovariance, low_rank

each = examples(50)


def covariance(model):
    """K of the targets, both triangles."""
    lower = np.tril(model.likelihood().covariance(model.theta))
    return lower + np.tril(lower, -1).T


def noise(model):
    return np.exp(model.theta[-model.n_noise :])


def allowed(model):
    """The errors that rounding justifies."""
    prior = model.prior_variance()
    return rounding(covariance(model), noise(model), model.table.y, prior)


def smallest_eigenvalue(A):
    """Of the symmetric part: the other is of rounding."""
    return np.linalg.eigvalsh(0.5 * (A + A.T))[0]


@each
@given(engines())
def test_covariances_are_positive_semidefinite(model):
    K, f = covariance(model), model.posterior().covariance(*model.places)
    eps = DIGITS * np.trace(K)
    assert smallest_eigenvalue(K) >= noise(model).min() - eps
    assert smallest_eigenvalue(f) >= -len(f) * allowed(model).cov
    K_rho = model.posterior().K_rho
    assert smallest_eigenvalue(K_rho) >= -DIGITS * np.trace(K_rho)


@each
@given(engines())
def test_gradient_is_the_finite_difference(model):
    likelihood, theta = model.likelihood(), model.theta
    gradient = likelihood.value_and_grad(theta)[1]
    assert_gradient(gradient, likelihood.value, theta, allowed(model).value)


@st.composite
def novel_tasks(draw):
    """A border, its row, and K and y of all samples, those of the novel task last."""
    table, rng = draw(tables()).sorted(), np.random.default_rng(draw(seeds))
    M, own = int(table.tasks.max()) + 1, draw(st.booleans())
    F, row = rng.standard_normal((M, 2)), rng.standard_normal(2 + own)
    kernel = ConstantKernel(table.unit**2, WIDE) * draw(kernels(table.spread))
    noise = draw(st.sampled_from(NOISE)) * table.unit**2
    theta = np.concatenate([kernel.theta, F.ravel(), [np.log(noise)]])
    model = Model(table, kernel, low_rank(M, 2), theta, 1)
    y = table.unit * rng.standard_normal(len(table.Z))
    border = BorderLikelihood(model.posterior(), F, table.Z, y, noise, own)
    F = np.vstack([np.column_stack([F, np.zeros((M, int(own)))]), row])
    X, tasks = np.vstack([table.F, table.Z]), np.append(table.tasks, [M] * len(y))
    K = textbook.covariance(kernel, F @ F.T, noise, X, tasks)
    return model, border, row, K, np.append(table.y, y)


@each
@given(novel_tasks())
def test_border_is_what_a_novel_task_adds(novel):
    model, border, row, K, y = novel
    value, gradient = border.value_and_grad(row)
    expected = textbook.log_marginal_likelihood(K, y)
    expected -= model.likelihood().value(model.theta)
    lost = rounding(K, noise(model), y, 0.0).value
    assert value == pytest.approx(expected, abs=lost, rel=0.0)
    assert_gradient(gradient, border.value, row, lost)


@each
@given(engines(), st.randoms(use_true_random=False))
def test_order_of_features_does_not_matter(model, random):
    order = random.sample(range(len(model.table.spread)), len(model.table.spread))
    kernel, table = permuted(model.kernel, order), model.table
    F, Z = table.F[:, order], table.Z[:, order]
    theta = np.append(kernel.theta, model.theta[kernel.n_dims :])
    other = model._replace(kernel=kernel, table=table._replace(F=F, Z=Z), theta=theta)
    assert_alike(other, model)


def assert_alike(found, expected):
    """The same likelihood and predictions."""
    atol = allowed(expected)
    (a, p), (b, q) = ((m.posterior(), m.places) for m in (found, expected))
    assert a.log_likelihood == pytest.approx(b.log_likelihood, abs=atol.value, rel=0)
    np.testing.assert_allclose(a.mean(*p), b.mean(*q), rtol=0.0, atol=atol.mean)
    covariances = a.covariance(*p), b.covariance(*q)
    np.testing.assert_allclose(*covariances, rtol=0.0, atol=atol.cov)


@each
@given(engines(levels=False), st.randoms(use_true_random=False))
def test_tasks_with_equal_columns_are_one(model, random):
    """Some rows of a task, and some places, are handed to its twin."""
    K_rho, table = model.posterior().K_rho, model.table
    M = len(K_rho)
    task = random.randrange(M)

    def share(tasks):
        twins = [random.random() < 0.5 for _ in tasks]
        return np.where((tasks == task) & twins, M, tasks)

    of = np.append(np.arange(M), task)
    kernel, _, log_noise = building.parts(model.likelihood(), model.theta)
    log_noise = log_noise[of] if model.n_noise > 1 else log_noise
    twins = table._replace(tasks=share(table.tasks), tasks_of_Z=share(table.tasks_of_Z))
    form = FixedTaskCovariance(K_rho[np.ix_(of, of)])
    theta = np.append(kernel, log_noise)
    assert_alike(
        Model(twins.sorted(), model.kernel, form, theta, len(log_noise)), model
    )


@each
@given(engines())
def test_variance_is_between_zero_and_the_priors(model):
    variance = model.posterior().variance(*model.places)
    assert (variance >= 0.0).all()
    assert (variance <= model.prior_variance()).all()
    assert (variance < model.prior_variance()).any()


@each
@given(engines(), st.randoms(use_true_random=False))
def test_more_rows_never_raise_the_variance(model, random):
    n = len(model.table.y)
    some = sorted(random.sample(range(n), random.randint(1, n)))
    variance = [model.posterior(r).variance(*model.places) for r in (some, slice(n))]
    assert (variance[1] <= variance[0] + allowed(model).cov).all()
