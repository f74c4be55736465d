"""What holds for any data: symmetries and inequalities of the models."""

import numpy as np
import pytest
import textbook
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from samples import split
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP

examples = settings(max_examples=30, deadline=None, derandomize=True)
KERNEL = ConstantKernel(2.0) * RBF([0.8, 1.5])
# Sums in another order; covariances here have condition numbers up to about 1e5.
CLOSE = 1e-7


@st.composite
def problems(draw, max_tasks=4):
    """Unbalanced data of at least two samples a task, in no order, and new inputs."""
    counts = draw(st.lists(st.integers(2, 7), min_size=1, max_size=max_tasks))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    tasks = rng.permutation(np.repeat(np.arange(len(counts)), counts))
    X = np.column_stack([rng.normal(size=(len(tasks), 2)), tasks])
    slopes, offsets = rng.normal(size=(2, len(counts)))
    y = slopes[tasks] * np.sin(X[:, 0]) + offsets[tasks] * X[:, 1]
    y += 0.1 * rng.standard_normal(len(y))
    Z = np.column_stack([rng.normal(size=(12, 2)), np.arange(12) % len(counts)])
    return X, y, Z


@st.composite
def models(draw):
    """Each kind of model, not learned, with its options."""
    kind = draw(st.sampled_from([MultiTaskGPRegressor, IndependentGP, PooledGP]))
    model = kind(
        kernel=draw(st.sampled_from([None, KERNEL])),
        noise=draw(st.sampled_from(["shared", "per_task"])),
        diagonal=draw(st.booleans()),
        noise_variance=draw(st.sampled_from([1e-4, 1e-2, 1.0])),
        max_iter=0,
    )
    if kind is MultiTaskGPRegressor:
        model.set_params(rank=draw(st.sampled_from([1, None])))
    return model


def predictions(model, Z):
    """Mean and covariance of f, one above the other."""
    return np.vstack(model.predict(Z, return_cov=True))


def assert_close(found, expected):
    atol = CLOSE * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=CLOSE, atol=atol)


@examples
@given(problems(), models(), st.permutations(["d", "a", "c", "b"]))
def test_labels_of_tasks_do_not_matter(problem, model, names):
    X, y, Z = problem

    def rename(X):
        named = X.astype(object)
        named[:, -1] = [names[m] for m in split(X)[1]]
        return named

    expected = clone(model).fit(X, y)
    found = model.fit(rename(X), y)
    assert_close(predictions(found, rename(Z)), predictions(expected, Z))
    value = expected.log_marginal_likelihood_value_
    assert found.log_marginal_likelihood_value_ == pytest.approx(value, CLOSE)


@examples
@given(problems(), models(), st.randoms(use_true_random=False))
def test_order_of_rows_does_not_matter(problem, model, random):
    X, y, Z = problem
    order = random.sample(range(len(X)), len(X))
    expected = clone(model).fit(X, y)
    found = model.fit(X[order], y[order])
    assert_close(predictions(found, Z), predictions(expected, Z))
    value = expected.log_marginal_likelihood_value_
    assert found.log_marginal_likelihood_value_ == pytest.approx(value, CLOSE)


@examples
@given(problems(), models(), st.floats(-6, 6), st.booleans(), st.floats(-100, 100))
def test_units_of_the_target_do_not_matter(problem, model, power, negative, shift):
    X, y, Z = problem
    unit = (-1.0 if negative else 1.0) * 10.0**power
    expected = clone(model).fit(X, y)
    found = model.fit(X, unit * (y + shift))
    (mean, cov), (other, other_cov) = (
        m.predict(Z, return_cov=True) for m in (expected, found)
    )
    assert_close(other / unit - shift + 100.0, mean + 100.0)
    assert_close(other_cov / unit**2, cov)
    value = expected.log_marginal_likelihood_value_ - len(y) * np.log(abs(unit))
    assert found.log_marginal_likelihood_value_ == pytest.approx(value, CLOSE, CLOSE)


@examples
@given(problems(), models())
def test_variance_is_between_zero_and_the_priors(problem, model):
    X, y, Z = problem
    model.fit(X, y)
    z, tasks = split(Z)
    prior = model.task_covariance_[tasks, tasks] * model.kernel_.diag(z)
    variance = model.predict(Z, return_std=True)[1] ** 2
    assert (variance >= 0.0).all()
    assert (variance <= prior * (1.0 + 1e-12)).all()
    assert (variance < prior).any()
    far = Z + [1e3, 1e3, 0.0]
    if model.kernel is not None:
        np.testing.assert_allclose(model.predict(far, return_std=True)[1] ** 2, prior)


@examples
@given(problems(), st.sampled_from([IndependentGP, PooledGP]), st.integers(0, 10_000))
def test_data_never_raise_the_variance(problem, kind, seed):
    X, y, Z = problem
    task = int(Z[seed % len(Z), -1])  # the task that gets more samples
    x = np.random.default_rng(seed).normal(size=(3, 2))
    more = np.vstack([X, np.column_stack([x, np.full(3, task)])])

    def variance(X, y):
        relative = 0.01 / y.var()  # the noise is given relative to the target's
        model = kind(KERNEL, noise_variance=relative, normalize_y=False, max_iter=0)
        return model.fit(X, y).predict(Z, return_std=True)[1] ** 2

    before, after = variance(X, y), variance(more, np.append(y, [1.0, 2.0, 3.0]))
    assert (after <= before + 1e-9).all()
    told = (Z[:, -1] == task) | (kind is PooledGP)
    assert (after[told] < before[told]).any()
    np.testing.assert_allclose(after[~told], before[~told], rtol=1e-6, atol=1e-9)


@examples
@given(problems(max_tasks=2), models())
def test_a_task_and_its_copy_are_predicted_alike(problem, model):
    X, y, Z = problem
    copy, Z = X + [0.0, 0.0, 10.0], np.repeat(Z, 2, axis=0)
    Z[1::2, -1] += 10.0
    model.fit(np.vstack([X, copy]), np.append(y, y))
    mean, std = model.predict(Z, return_std=True)
    assert_close(mean[1::2], mean[::2])
    assert_close(std[1::2], std[::2])


@examples
@given(problems(max_tasks=2))
def test_an_independent_copy_doubles_the_likelihood(problem):
    X, y, Z = problem
    model = IndependentGP(KERNEL, max_iter=0)
    once = clone(model).fit(X, y)
    both = model.fit(np.vstack([X, X + [0.0, 0.0, 10.0]]), np.append(y, y))
    value = 2.0 * once.log_marginal_likelihood_value_
    assert both.log_marginal_likelihood_value_ == pytest.approx(value, CLOSE, CLOSE)
    assert_close(predictions(both, Z), predictions(once, Z))


@examples
@given(problems(), st.sampled_from([None, KERNEL]))
def test_pooled_tasks_are_one_task(problem, kernel):
    X, y, Z = problem
    one, Z_one = X * [1.0, 1.0, 0.0], Z * [1.0, 1.0, 0.0]
    pooled = PooledGP(kernel, max_iter=0).fit(X, y)
    for kind in (PooledGP, IndependentGP):
        alone = kind(kernel, max_iter=0).fit(one, y)
        assert_close(predictions(pooled, Z), predictions(alone, Z_one))


@settings(examples, max_examples=15)
@given(problems(), st.sampled_from(["shared", "per_task"]), st.booleans())
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_learning_raises_the_likelihood_that_the_attributes_have(
    problem, noise, diagonal
):
    X, y, _ = problem
    model = MultiTaskGPRegressor(noise=noise, diagonal=diagonal, max_iter=0)
    start = clone(model).fit(X, y).log_marginal_likelihood_value_
    model.set_params(max_iter=5).fit(X, y)
    found = model.log_marginal_likelihood_value_
    assume(np.isfinite(start))
    assert found > start
    K = textbook.covariance(
        model.kernel_, model.task_covariance_, model.noise_variance_, *split(X)
    )
    expected = textbook.log_marginal_likelihood(K, y - model.y_mean_)
    assert found == pytest.approx(expected, 1e-6, 1e-6)


@st.composite
def extensions(draw):
    """A model that is not learned, and samples of a task that it does not know."""
    X, y, Z = draw(problems())
    model = MultiTaskGPRegressor(
        KERNEL,
        rank=draw(st.sampled_from([1, None])),
        diagonal=draw(st.booleans()),
        noise=draw(st.sampled_from(["shared", "per_task"])),
        max_iter=0,
    )
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    X_new = np.column_stack([rng.normal(size=(5, 2)), np.full(5, 9.0)])
    y_new = np.sin(X_new[:, 0]) + 0.3 * X_new[:, 1] + 0.1 * rng.standard_normal(5)
    n = draw(st.integers(1, 5))
    options = {"prior": draw(st.sampled_from(["tasks", None]))}
    Z = np.vstack([Z, X_new + [0.1, 0.1, 0.0]])
    return model, (X, y), (X_new[:n], y_new[:n]), Z, options


def extend(model, data, new, options):
    """The border is learned, nothing else is."""
    return clone(model).fit(*data).set_params(max_iter=200).add_task(*new, **options)


def assert_alike(found, expected):
    """To 1e-4: the border is learned to a hundredth of a nat, from a few starts."""
    atol = 1e-4 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=atol)


@examples
@given(extensions(), st.randoms(use_true_random=False), st.sampled_from([-3, 1, 77]))
def test_order_and_label_of_what_is_added_do_not_matter(extension, random, label):
    model, (X, y), (X_new, y_new), Z, options = extension
    expected = predictions(extend(model, (X, y), (X_new, y_new), options), Z)
    order = random.sample(range(len(X_new)), len(X_new))

    def rename(X):
        """The labels of the others are even."""
        labels = np.where(X[:, -1] == 9, label, 2 * X[:, -1])
        return np.column_stack([X[:, :-1], labels])

    new = rename(X_new[order]), y_new[order]
    assert_alike(
        predictions(extend(model, (rename(X), y), new, options), rename(Z)), expected
    )


@examples
@given(extensions(), st.floats(-6, 6), st.booleans(), st.floats(-100, 100))
def test_units_of_what_is_added_do_not_matter(extension, power, negative, shift):
    model, (X, y), (X_new, y_new), Z, options = extension
    unit = (-1.0 if negative else 1.0) * 10.0**power
    mean, cov = extend(model, (X, y), (X_new, y_new), options).predict(
        Z, return_cov=True
    )
    scaled = [(X, unit * (y + shift)), (X_new, unit * (y_new + shift))]
    other, other_cov = extend(model, *scaled, options).predict(Z, return_cov=True)
    assert_alike(other / unit - shift, mean)
    assert_alike(other_cov / unit**2, cov)


@examples
@given(extensions())
def test_what_is_added_is_a_model(extension):
    model, data, new, Z, options = extension
    extended = extend(model, data, new, options)
    K_rho = extended.task_covariance_
    assert np.linalg.eigvalsh(K_rho)[0] >= -1e-12 * np.trace(K_rho)
    z = Z[Z[:, -1] == 9][:, :-1]
    prior = K_rho[-1, -1] * extended.kernel_.diag(z)
    Z = Z[Z[:, -1] == 9]
    variance = extended.predict(Z, return_std=True)[1] ** 2
    assert (variance <= prior * (1.0 + 1e-12)).all()
    x = np.vstack([data[0], new[0]])
    codes = np.searchsorted(extended.tasks_, x[:, -1])
    K = textbook.covariance(
        extended.kernel_, K_rho, extended.noise_variance_, x[:, :-1], codes
    )
    y = np.append(data[1], new[1]) - extended.y_mean_
    expected = textbook.log_marginal_likelihood(K, y)
    found = extended.log_marginal_likelihood_value_
    assert found == pytest.approx(expected, 1e-7, 1e-7)
