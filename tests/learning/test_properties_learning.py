"""What holds for any data of models that were learned, or of borders that were."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from samples import log_densities
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from strategies import examples, tables

from skmtgp import MultiTaskGPRegressor, RankSearchIC

KERNEL = ConstantKernel(2.0) * RBF([0.8, 1.5])
TOL = 1e-2  # nats, the learner's default


def predictions(model, Z):
    """Mean and covariance of f, one above the other."""
    return np.vstack(model.predict(Z, return_cov=True))


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


@examples(3)
@given(tables(per_task=4, max_tasks=4, max_rows=24), st.booleans(), st.booleans())
def test_likelihood_does_not_fall_with_the_rank(table, diagonal, levels):
    M = len(np.unique(table.tasks))
    model = MultiTaskGPRegressor(
        diagonal=diagonal,
        task_levels=levels,
        normalize_y="shared",
        noise="shared",
        noise_variance_bounds=(1e-4, 10.0),
    )
    search = RankSearchIC(model, ranks=range(1, M + 1), keep_estimators=True)
    search.fit(table.X, table.y)
    of_modes = search.results_["log_marginal_likelihood"]
    of_models = [m.log_marginal_likelihood_value_ for m in search.estimators_]
    for values in (of_modes, of_models):
        assert (np.diff(values) >= -TOL).all()


@st.composite
def kinds(draw):
    """Of a model with or without levels, in any units."""
    return {
        "diagonal": draw(st.booleans()),
        "task_levels": draw(st.booleans()),
        "normalize_y": draw(st.sampled_from(["shared", "per_task"])),
        "noise": draw(st.sampled_from(["shared", "per_task"])),
        "max_iter": 0,
    }


@examples(6)
@given(problems(), kinds())
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_learning_raises_the_likelihood_that_the_attributes_have(problem, options):
    X, y, _ = problem
    model = MultiTaskGPRegressor(**options)
    start = clone(model).fit(X, y).log_marginal_likelihood_value_
    model.set_params(max_iter=5).fit(X, y)
    found = model.log_marginal_likelihood_value_
    assume(np.isfinite(start))
    assert found > start
    assert found == pytest.approx(log_densities(model, X, y)[0], 1e-6, 1e-6)


@st.composite
def extensions(draw):
    """A model that is not learned, and samples of a task that it does not know."""
    X, y, Z = draw(problems())
    rank = draw(st.sampled_from([1, None]))
    model = MultiTaskGPRegressor(KERNEL, rank=rank, **draw(kinds()))
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


@examples(15)
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


@examples(15)
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


@examples(15)
@given(extensions())
def test_what_is_added_is_a_model(extension):
    model, data, new, Z, options = extension
    extended = extend(model, data, new, options)
    K_rho = extended.task_covariance_
    assert np.linalg.eigvalsh(K_rho)[0] >= -1e-12 * np.trace(K_rho)
    Z = Z[Z[:, -1] == 9]
    level = np.ravel(extended.level_variance_)[-1]
    prior = K_rho[-1, -1] * extended.kernel_.diag(Z[:, :-1]) + level
    [posterior] = extended._posteriors  # the row of F counts as known
    variance = posterior.variance(Z[:, :-1], np.full(len(Z), len(K_rho) - 1))
    variance = variance * np.square(np.ravel(extended.y_scale_)[-1])
    assert (variance <= prior * (1.0 + 1e-12)).all()
    X = np.vstack([data[0], new[0]])
    X[:, -1] = np.searchsorted(extended.tasks_, X[:, -1])
    [expected] = log_densities(extended, X, np.append(data[1], new[1]))
    found = extended.log_marginal_likelihood_value_
    assert found == pytest.approx(expected, 1e-7, 1e-7)
