"""What holds for any data: Bayesian linear regression.

Labels of tasks, order of rows and units of the target are in test_linear.py.
"""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from sklearn.base import clone
from strategies import (
    DIGITS,
    assert_same_predictions,
    examples,
    linear_models,
    savers,
    tables,
)

each = examples(25)
orders = st.randoms(use_true_random=False)


def lost_digits(model, table):
    """Relative errors that rounding justifies, of the worst regression.

    A QR decomposition is of covariates rounded in units of their columns.
    """
    prior = np.eye(len(table.spread)) / np.sqrt(model.weight_variance)
    conditions = [1.0]
    for label in np.unique(table.tasks):
        rows = model.pooled | (table.tasks == label)
        covariates = np.vstack([table.F[rows], prior])
        if model.fit_intercept:
            constant = np.r_[np.ones(rows.sum()), 0.0 * table.spread]
            covariates = np.column_stack([covariates, constant])
        conditions.append(
            np.linalg.cond(covariates / np.linalg.norm(covariates, axis=0))
        )
    return DIGITS * len(table.y) * max(conditions)


def relative_variance(model, new):
    """In units of the noise variance."""
    codes = np.searchsorted(model.tasks_, new[:, -1])
    std = model.predict(new, return_std=True)[1]
    return std**2 / model.noise_variance_[codes]


@each
@given(tables(), linear_models(), orders)
def test_order_of_features_does_not_matter(table, model, random):
    p = len(table.spread)
    order = [*random.sample(range(p), p), p]
    expected = clone(model).fit(table.X, table.y)
    found = model.fit(table.X[:, order], table.y)
    lost = lost_digits(model, table)
    variance = relative_variance(expected, table.new)
    other = relative_variance(found, table.new[:, order])
    np.testing.assert_allclose(other, variance, rtol=lost)
    atol = lost * np.linalg.norm(table.y) * np.sqrt(1.0 + variance.max())
    mean = expected.predict(table.new)
    other = found.predict(table.new[:, order])
    np.testing.assert_allclose(other, mean, rtol=0.0, atol=atol)


@each
@given(tables(), linear_models())
def test_variance_is_between_zero_and_the_priors(table, model):
    variance = relative_variance(model.fit(table.X, table.y), table.new)
    prior = model.fit_intercept + np.square(table.Z).sum(axis=1)
    assert (variance >= 0.0).all()
    assert (variance <= model.weight_variance * prior * (1.0 + DIGITS)).all()


@each
@given(tables(), linear_models(), orders)
def test_more_rows_never_raise_the_variance(table, model, random):
    n = len(table.y)
    rows = random.sample(range(n), random.randint(1, n))
    few = clone(model).fit(table.X[rows], table.y[rows])
    new = table.new[np.isin(table.tasks_of_Z, few.tasks_)]
    assume(len(new))
    before = relative_variance(few, new)
    after = relative_variance(model.fit(table.X, table.y), new)
    assert (after <= before * (1.0 + lost_digits(model, table))).all()


@each
@given(tables(), linear_models(), st.lists(st.integers(0, 10)))
def test_predictions_in_blocks_are_those_at_once(table, model, cuts):
    model.fit(table.X, table.y)
    mean, std = model.predict(table.new, return_std=True)
    blocks = [b for b in np.split(table.new, sorted(cuts)) if len(b)]
    found = np.hstack([model.predict(b, return_std=True) for b in blocks])
    largest = np.abs(np.vstack([table.F, table.Z])).max(axis=0)
    terms = np.abs(model.coef_) @ largest + np.abs(model.intercept_)
    np.testing.assert_allclose(found[0], mean, rtol=0, atol=DIGITS * terms.max())
    np.testing.assert_allclose(found[1], std, rtol=lost_digits(model, table))


@each
@given(tables(), linear_models(), savers)
def test_what_was_saved_predicts_the_same(table, model, save):
    assert_same_predictions(save(model.fit(table.X, table.y)), model, table.new)
