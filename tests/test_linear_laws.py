"""Bayesian linear regression against explicit matrices and scipy's distributions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import split
from sklearn.base import clone

from skmtgp import BayesianLinearRegression

examples = settings(max_examples=20, deadline=None, derandomize=True)


@st.composite
def problems(draw):
    """Unbalanced data, at times of one sample a task, in no order; and a model."""
    counts = draw(st.lists(st.integers(1, 6), min_size=1, max_size=4))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    tasks = rng.permutation(np.repeat(np.arange(len(counts)), counts))
    X = np.column_stack([rng.normal(size=(len(tasks), 2)), tasks])
    Z = np.column_stack([rng.normal(size=(8, 2)), np.arange(8) % len(counts)])
    model = BayesianLinearRegression(
        pooled=draw(st.booleans()),
        fit_intercept=draw(st.booleans()),
        weight_variance=draw(st.sampled_from([1e-2, 1.0, 1e4])),
        noise_shape=draw(st.sampled_from([0.6, 5.0])),
        noise_rate=draw(st.sampled_from([1e-3, 1.0])),
    )
    return X, rng.normal(size=(len(tasks), 2)), Z, model


def assert_same(found, expected, Z, *, Z_found=None, unit=1.0):
    """Predictions in units of that of the expected model."""
    new = Z if Z_found is None else Z_found
    for noisy in (False, True):
        mean, cov = found.predict(new, return_cov=True, include_noise=noisy)
        other, other_cov = expected.predict(Z, return_cov=True, include_noise=noisy)
        np.testing.assert_allclose(mean / unit, other, rtol=1e-7, atol=1e-7)
        atol = 1e-9 * other_cov.max()
        np.testing.assert_allclose(cov / unit**2, other_cov, rtol=1e-7, atol=atol)


@examples
@given(problems(), st.permutations(["d", "a", "c", "b"]))
def test_labels_of_tasks_do_not_matter(problem, names):
    X, Y, Z, model = problem

    def rename(X):
        named = X.astype(object)
        named[:, -1] = [names[m] for m in split(X)[1]]
        return named

    expected = clone(model).fit(X, Y)
    found = model.fit(rename(X), Y)
    assert_same(found, expected, Z, Z_found=rename(Z))
    values = expected.log_marginal_likelihoods_
    np.testing.assert_allclose(found.log_marginal_likelihoods_, values, rtol=1e-9)


@examples
@given(problems(), st.randoms(use_true_random=False))
def test_order_of_rows_does_not_matter(problem, random):
    X, Y, Z, model = problem
    order = random.sample(range(len(X)), len(X))
    expected = clone(model).fit(X, Y)
    found = model.fit(X[order], Y[order])
    assert_same(found, expected, Z)
    values = expected.log_marginal_likelihoods_
    np.testing.assert_allclose(found.log_marginal_likelihoods_, values, rtol=1e-7)


@examples
@given(problems(), st.floats(-6, 6), st.booleans())
def test_noise_rate_has_the_units_of_the_squared_target(problem, power, negative):
    X, Y, Z, model = problem
    unit = (-1.0 if negative else 1.0) * 10.0**power
    expected = clone(model).fit(X, Y)
    found = model.set_params(noise_rate=unit**2 * model.noise_rate).fit(X, unit * Y)
    assert_same(found, expected, Z, unit=unit)
    np.testing.assert_allclose(
        found.noise_variance_ / unit**2, expected.noise_variance_, rtol=1e-7
    )
    values = expected.log_marginal_likelihoods_ - len(Y) * np.log(abs(unit))
    close = {"rtol": 1e-7, "atol": 1e-7}
    np.testing.assert_allclose(found.log_marginal_likelihoods_, values, **close)
