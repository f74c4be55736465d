"""What holds for any data: symmetries and inequalities of the models, not learned."""

import numpy as np
import pytest
import textbook
from hypothesis import assume, given
from hypothesis import strategies as st
from samples import outputs
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel
from strategies import (
    DIGITS,
    FIXED,
    Rounding,
    assert_gradient,
    assert_same_predictions,
    examples,
    permuted,
    problems,
    rounding,
    savers,
    seeds,
)

from skmtgp import IndependentGP, PooledGP, SingleTaskGP
from skmtgp._estimators.units import FEWEST

each = examples(15)
orders = st.randoms(use_true_random=False)


def alone(model):
    """The Gaussian processes in a fitted model, each of data of its own."""
    model = getattr(model, "best_estimator_", model)
    return getattr(model, "estimators_", [model])


def allowed(model, new):
    """The errors that rounding justifies."""
    found = []
    for gp in alone(model):
        [output] = outputs(gp)
        K = output.covariance(gp.X_train_, gp.tasks_train_)
        y = gp.y_train_ - textbook.of_rows(output.centre, gp.tasks_train_)
        diagonal = gp.kernel_.diag(new[:, :-1]).max()
        prior = output.K_rho.diagonal().max() * diagonal + np.max(output.level)
        of_rounding = rounding(K, output.noise, y, prior, np.abs(output.centre).max())
        # K_1^rho is computed from the targets, and rounded in their units
        cov = of_rounding.cov + DIGITS * np.square(y).mean() * diagonal
        found.append(of_rounding._replace(cov=cov))
    mean, cov, value = np.transpose(found)
    return Rounding(mean.max(), cov.max(), value.sum())


def prior_variance(model, new):
    """Of f."""
    Z, codes = new[:, :-1], np.searchsorted(model.tasks_, new[:, -1])
    variances = [
        np.multiply.outer(gp.task_covariance_.diagonal(), gp.kernel_.diag(Z))
        + np.reshape(gp.level_variance_, (-1, 1))
        for gp in alone(model)
    ]
    return np.vstack(variances)[codes, np.arange(len(Z))]


def log_likelihood(model):
    return getattr(model, "best_estimator_", model).log_marginal_likelihood_value_


def assert_alike(found, expected, new, new_found=None):
    """The same likelihood and predictions."""
    atol = allowed(expected, new)
    values = [log_likelihood(model) for model in (found, expected)]
    assert values[0] == pytest.approx(values[1], abs=atol.value, rel=0.0)
    mean, cov = expected.predict(new, return_cov=True)
    new = new if new_found is None else new_found
    other, other_cov = found.predict(new, return_cov=True)
    np.testing.assert_allclose(other, mean, rtol=0.0, atol=atol.mean)
    np.testing.assert_allclose(other_cov, cov, rtol=0.0, atol=atol.cov)


@each
@given(problems(), st.permutations("dachbgef"))
def test_labels_of_tasks_do_not_matter(problem, names):
    table, model = problem

    def rename(X):
        named = X.astype(object)
        named[:, -1] = [names[int(m)] for m in X[:, -1]]
        return named

    expected = clone(model).fit(table.X, table.y)
    found = model.fit(rename(table.X), table.y)
    assert_alike(found, expected, table.new, rename(table.new))


@each
@given(problems(), orders)
def test_order_of_rows_does_not_matter(problem, random):
    table, model = problem
    order = random.sample(range(len(table.y)), len(table.y))
    expected = clone(model).fit(table.X, table.y)
    found = model.fit(table.X[order], table.y[order])
    assert_alike(found, expected, table.new)


@each
@given(problems(), orders)
def test_order_of_features_does_not_matter(problem, random):
    """The task column goes with them."""
    table, model = problem
    p = len(table.spread)
    order = random.sample(range(p), p)
    task = random.randint(0, p)
    expected = clone(model).fit(table.X, table.y)

    def move(X):
        return np.insert(X[:, order], task, X[:, -1], axis=1)

    inner = getattr(model, "estimator", model).set_params(task_feature=task)
    if inner.kernel is not None:
        inner.set_params(kernel=permuted(inner.kernel, order))
    found = model.fit(move(table.X), table.y)
    assert_alike(found, expected, table.new, move(table.new))


@each
@given(problems(), st.floats(-6, 6), st.booleans(), st.floats(-100, 100))
def test_units_of_the_target_do_not_matter(problem, power, negative, shift):
    table, model = problem
    unit, shift = (-1.0 if negative else 1.0) * 10.0**power, shift * table.unit
    expected = clone(model).fit(table.X, table.y)
    found = model.fit(table.X, unit * (table.y + shift))
    atol = allowed(found, table.new)
    (mean, cov), (other, other_cov) = (
        m.predict(table.new, return_cov=True) for m in (expected, found)
    )
    np.testing.assert_allclose(other, unit * (mean + shift), rtol=0.0, atol=atol.mean)
    np.testing.assert_allclose(other_cov, unit**2 * cov, rtol=0.0, atol=atol.cov)
    value = log_likelihood(expected) - len(table.y) * np.log(abs(unit))
    assert log_likelihood(found) == pytest.approx(value, abs=atol.value, rel=0.0)


@each
@given(problems(per_task=0))
def test_covariances_are_positive_semidefinite(problem):
    table, model = problem
    cov = model.fit(table.X, table.y).predict(table.new, return_cov=True)[1]
    smallest = np.linalg.eigvalsh(0.5 * (cov + cov.T))[0]
    assert smallest >= -len(cov) * allowed(model, table.new).cov
    for gp in alone(model):
        K_rho = gp.task_covariance_
        assert np.linalg.eigvalsh(K_rho)[0] >= -DIGITS * np.trace(K_rho)


@each
@given(problems(per_task=0))
def test_variance_is_between_zero_and_the_priors(problem):
    table, model = problem
    model.fit(table.X, table.y)
    for X in (table.X, table.new):
        variance = model.predict(X, return_std=True)[1] ** 2
        prior = prior_variance(model, X)
        assert (variance >= 0.0).all()
        assert (variance <= prior * (1.0 + DIGITS)).all()
    if type(model) in FIXED:  # elsewhere there may be nothing to explain
        known = model.predict(table.X, return_std=True)[1] ** 2
        assert (known < prior_variance(model, table.X)).all()


@each
@given(problems(kinds=FIXED), seeds)
def test_more_rows_never_raise_the_variance(problem, seed):
    """The same targets elsewhere: their mean and variance stay, and so the noise."""
    table, model = problem
    assume(model.kernel is not None)  # whose lengths are the features'
    rows = np.unique(table.tasks, return_counts=True)[1]
    assume(model.normalize_y != "per_task" or rows.min() >= FEWEST)  # for a unit
    moved = np.random.default_rng(seed).normal(size=table.F.shape)
    moved = np.column_stack([table.F + table.spread * moved, table.tasks])
    more = np.vstack([table.X, moved]), np.append(table.y, table.y)
    before = clone(model).fit(table.X, table.y)
    variance = [
        m.predict(table.new, return_std=True)[1] ** 2
        for m in (before, model.fit(*more))
    ]
    assert (variance[1] <= variance[0] + allowed(model, table.new).cov).all()


@each
@given(problems())
def test_a_task_and_its_copy_are_predicted_alike(problem):
    table, model = problem
    step = np.append(np.zeros(len(table.spread)), 10.0)
    model.fit(np.vstack([table.X, table.X + step]), np.append(table.y, table.y))
    atol = allowed(model, table.new)
    (mean, cov), (other, other_cov) = (
        model.predict(Z, return_cov=True) for Z in (table.new, table.new + step)
    )
    np.testing.assert_allclose(other, mean, rtol=0.0, atol=atol.mean)
    np.testing.assert_allclose(other_cov, cov, rtol=0.0, atol=atol.cov)


@each
@given(problems(kinds=[IndependentGP, SingleTaskGP]))
def test_an_independent_copy_doubles_the_likelihood(problem):
    table, model = problem
    copy = table.X + np.append(np.zeros(len(table.spread)), 10.0)
    once = clone(model).fit(table.X, table.y)
    both = model.fit(np.vstack([table.X, copy]), np.append(table.y, table.y))
    atol = allowed(both, table.new)
    value = 2.0 * log_likelihood(once)
    assert log_likelihood(both) == pytest.approx(value, abs=atol.value, rel=0.0)
    mean, cov = once.predict(table.new, return_cov=True)
    other, other_cov = both.predict(table.new, return_cov=True)
    np.testing.assert_allclose(other, mean, rtol=0.0, atol=atol.mean)
    np.testing.assert_allclose(other_cov, cov, rtol=0.0, atol=atol.cov)


@each
@given(problems(kinds=[PooledGP], per_task=0), st.sampled_from(FIXED))
def test_pooled_tasks_are_one_task(problem, kind):
    table, model = problem
    model.set_params(noise="shared", diagonal=False)
    names = kind().get_params()
    params = {k: v for k, v in model.get_params(deep=False).items() if k in names}
    params |= {"task_levels": False} if "task_levels" in names else {}
    one = table._replace(tasks=0 * table.tasks, tasks_of_Z=0 * table.tasks_of_Z)
    expected = kind(**params).fit(one.X, one.y)
    assert_alike(model.fit(table.X, table.y), expected, one.new, table.new)


def of_one(table, rows, places):
    """What two lists of rows and places select."""
    kept = table._replace(F=table.F[rows], tasks=table.tasks[rows], y=table.y[rows])
    return kept._replace(Z=table.Z[places], tasks_of_Z=table.tasks_of_Z[places])


def parts(model, table):
    """The independent functions of a model: its GP, rows and places of each."""
    if isinstance(model, PooledGP):
        yield model, table
        return
    for m, label in enumerate(model.tasks_):
        gp = alone(model)[m] if isinstance(model, SingleTaskGP) else model
        yield gp, of_one(table, table.tasks == label, table.tasks_of_Z == label)


@each
@given(problems(kinds=FIXED, per_task=0))
def test_independent_functions_are_single_gps(problem):
    """As scikit-learn's with the same kernel, amplitude and noise."""
    table, model = problem
    if not isinstance(model, SingleTaskGP):
        model.set_params(diagonal=False)
    model.fit(table.X, table.y)
    atol, value = allowed(model, table.new), 0.0
    for gp, part in parts(model, table):
        [output] = outputs(gp)
        several = len(gp.tasks_) > 1
        codes = np.searchsorted(model.tasks_, part.tasks) if several else 0 * part.tasks
        noise, centre, level = (
            textbook.of_rows(of, codes)
            for of in (output.noise, output.centre, output.level)
        )
        amplitude = output.K_rho[codes[0], codes[0]]
        kernel = ConstantKernel(amplitude, "fixed") * gp.kernel_
        if level[0]:
            kernel += ConstantKernel(level[0], "fixed")
        other = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None)
        other.fit(part.F, part.y - centre)
        value += other.log_marginal_likelihood_value_
        if len(part.Z):
            mean, cov = model.predict(part.new, return_cov=True)
            expected, expected_cov = other.predict(part.Z, return_cov=True)
            expected += centre[0]
            np.testing.assert_allclose(mean, expected, rtol=0.0, atol=atol.mean)
            np.testing.assert_allclose(cov, expected_cov, rtol=0.0, atol=atol.cov)
    assert log_likelihood(model) == pytest.approx(value, abs=atol.value, rel=0.0)


@each
@given(problems(kinds=[SingleTaskGP], per_task=0))
def test_single_tasks_are_models_of_their_own(problem):
    table, model = problem
    model.fit(table.X, table.y)
    for label in np.unique(table.tasks_of_Z):
        part = of_one(table, table.tasks == label, table.tasks_of_Z == label)
        own = clone(model).fit(part.X, part.y)
        assert_same_predictions(model, own, part.new)


@each
@given(problems(per_task=0), st.lists(st.integers(0, 10)))
def test_predictions_in_blocks_are_those_at_once(problem, cuts):
    table, model = problem
    model.fit(table.X, table.y)
    atol = allowed(model, table.new)
    mean, std = model.predict(table.new, return_std=True)
    blocks = [b for b in np.split(table.new, sorted(cuts)) if len(b)]
    found = np.hstack([model.predict(block, return_std=True) for block in blocks])
    np.testing.assert_allclose(found[0], mean, rtol=0.0, atol=atol.mean)
    np.testing.assert_allclose(found[1] ** 2, std**2, rtol=0.0, atol=atol.cov)


@each
@given(problems(per_task=0), savers)
def test_what_was_saved_predicts_the_same(problem, save):
    table, model = problem
    again = save(model.fit(table.X, table.y))
    assert_same_predictions(again, model, table.new)


@each
@given(problems(per_task=0))
def test_gradient_is_the_finite_difference(problem):
    table, model = problem
    model = getattr(model.fit(table.X, table.y), "best_estimator_", model)
    assume(not isinstance(model, SingleTaskGP))  # has no theta
    value, lost = model.log_marginal_likelihood, allowed(model, table.new).value
    gradient = value(eval_gradient=True)[1]
    assert_gradient(gradient, value, model.theta_, lost)


@each
@given(problems(), st.floats(-30, 30))
def test_origin_of_the_features_does_not_matter(problem, offset):
    """Not that of a constant one either, whose deviation may be of rounding."""
    table, model = problem
    kernel = getattr(model, "estimator", model).kernel
    assume(kernel is None or kernel.is_stationary())
    step = np.append(offset * table.spread, 0.0)
    expected = clone(model).fit(table.X, table.y)
    found = model.fit(table.X + step, table.y)
    assert_alike(found, expected, table.new, table.new + step)
