"""Estimators of otherwise complete data with missing cells: as by dense inference."""

import pickle

import numpy as np
import pytest
from pairs import in_pairs
from same_inputs import NEW, TARGETS, draw
from sklearn.base import clone
from test_complete_data import LEARNED, MODELS, close, every_model, told

from skmtgp import MultiTaskGPRegressor, WideRegressor
from skmtgp._estimators.relations import evidence_of_relations
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
Z = draw(4, seed=1)[0]


def hide(X, y, n_missing, seed=0):
    """All but some rows, drawn at random."""
    kept = np.random.default_rng(seed).permutation(len(X))[n_missing:]
    return X[kept], y[kept]


@every_model
@pytest.mark.parametrize(("n_missing", "inference"), [(3, "auto"), (9, "kronecker")])
def test_both_tell_the_same(estimator, params, n_outputs, n_missing, inference):
    X, y = hide(*draw(n_outputs=n_outputs), n_missing)
    model, dense = (
        estimator(inference=i, max_iter=0, **params).fit(X, y)
        for i in (inference, "dense")
    )
    assert (model.inference_, dense.inference_) == ("kronecker", "dense")
    assert model.complete_ is dense.complete_ is False
    close(told(model, Z), told(dense, Z))
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    assert vars(model).keys() == vars(dense).keys()


@pytest.mark.long
@every_model
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.AmbiguousFitWarning")  # 27 rows
def test_both_learn_the_same(estimator, params, n_outputs):
    X, y = hide(*draw(n_outputs=n_outputs), 3)
    model, dense = (
        estimator(inference=i, tol=1e-9, **params).fit(X, y) for i in ("auto", "dense")
    )
    values = [m.log_marginal_likelihood_value_ for m in (model, dense)]
    np.testing.assert_allclose(*values, rtol=1e-6)
    found, expected = model.predict(Z), dense.predict(Z)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3 * y.std())


def test_the_order_of_the_rows_does_not_matter():
    X, y = hide(*draw(), 3)
    order = np.random.default_rng(0).permutation(len(X))
    one, other = (
        MultiTaskGPRegressor(rank=2, max_iter=0).fit(*data)
        for data in [(X, y), (X[order], y[order])]
    )
    close(one.predict(Z, return_std=True), other.predict(Z, return_std=True))
    for a, b in zip(one.loo_predict(), other.loo_predict(), strict=True):
        np.testing.assert_allclose(a[order], b, rtol=1e-8)


def test_levels():
    X, y = hide(*draw(), 3)
    model, dense = (
        MultiTaskGPRegressor(task_levels=True, inference=i, max_iter=0).fit(X, y)
        for i in ("auto", "dense")
    )
    assert model.inference_ == "kronecker"
    close(told(model, Z), told(dense, Z))
    close(
        [model.task_level_, model.task_level_std_],
        [dense.task_level_, dense.task_level_std_],
    )


class TestAddTask:
    @pytest.fixture(params=LEARNED)
    def pair(self, request):
        """A model by Kronecker algebra and a dense one, at the starting values."""
        _, params, n_outputs = MODELS[request.param]
        model = MultiTaskGPRegressor(**{"learning": "staged", "max_iter": 0} | params)
        data = hide(*draw(n_outputs=n_outputs), 3)
        return [
            clone(model).set_params(inference=i).fit(*data) for i in ("auto", "dense")
        ]

    def join(self, pair, new, y):
        targets = y[:, None] * np.ones(pair[0].y_train_.shape[1:])
        targets = targets.reshape(len(y), *pair[0].y_train_.shape[1:])
        found, expected = (model.add_task(new, targets) for model in pair)
        assert (found.inference_, expected.inference_) == ("kronecker", "dense")
        close(told(found, Z), told(expected, Z), digits=7)
        return found, expected

    @in_pairs("pair", pair={name: name for name in LEARNED}, label={"-1": -1, "9": 9})
    def test_of_a_few_rows(self, pair, label):
        found, _ = self.join(pair, np.c_[NEW[:, :2], np.full(3, label)], TARGETS)
        assert isinstance(found._likelihoods[0], ExtendedLikelihood)

    def test_at_most_of_the_inputs(self, pair):
        X, y = draw()
        rows = np.flatnonzero(X[:, -1] == 2)[1:]
        found, _ = self.join(pair, X[rows] + [0.0, 0.0, 5.0], y[rows])
        assert isinstance(found._likelihoods[0], KroneckerLikelihood)

    def test_one_after_another(self, pair):
        pair = self.join(pair, NEW, TARGETS)
        found, _ = self.join(pair, NEW[:2] + [0.0, 0.1, 4.0], -TARGETS[:2])
        assert found._likelihoods[0].novel == [2, 4]


class TestPartialFit:
    def same(self, X, y, *batches):
        """Rows that join a model with gaps, by both ways of inference."""
        models = [
            MultiTaskGPRegressor(rank=1, inference=i, max_iter=0).fit(X, y)
            for i in ("auto", "dense")
        ]
        for rows in batches:
            models = [model.partial_fit(*rows) for model in models]
            close(told(models[0], Z), told(models[1], Z), digits=7)
        return models[0]

    def test_rows_that_close_gaps(self):
        X, y = draw()
        model = self.same(X[2:], y[2:], (X[:1], y[:1]), (X[1:2], y[1:2]))
        assert model.inference_ == "kronecker"
        assert model.complete_ is True

    def test_rows_that_leave_gaps(self):
        """And then too many for the default."""
        X, y = draw()
        more = np.array([[1.1, 0.4, 0.0], [1.1, 0.4, 2.0]])
        model = self.same(X, y, (more, np.ones(2)))
        assert (model.inference_, model.complete_) == ("kronecker", False)
        more = np.array([[1.2, 0.4, 0.0], [1.3, 0.4, 2.0], [1.4, 0.4, 2.0]])
        model = model.partial_fit(more, np.ones(3))
        assert model.inference_ == "dense"


def test_relations_are_worth_the_same():
    X, y = hide(*draw(), 3)
    found, expected = (
        evidence_of_relations(model.fit(X, y), 0)
        for i in ("auto", "dense")
        for model in [MultiTaskGPRegressor(rank=1, inference=i, max_iter=0)]
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_a_wide_table():
    """NaN here and there costs nothing but the cells."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-2.0, 2.0, (15, 2))
    Y = np.sin(x[:, :1]) * [1.0, -2.0, 0.5] + 0.1 * rng.standard_normal((15, 3))
    Y[[0, 4, 14], [0, 2, 1]] = np.nan
    found, expected = (
        WideRegressor(MultiTaskGPRegressor(rank=1, inference=i, tol=1e-8)).fit(x, Y)
        for i in ("auto", "dense")
    )
    assert found.estimator_.inference_ == "kronecker"
    np.testing.assert_allclose(found.predict(x), expected.predict(x), atol=1e-4)


@pytest.mark.parametrize("inference", ["auto", "kronecker"])
def test_a_task_with_one_row(inference):
    """Of few inputs it is a tenth of the cells, and more."""
    X, y = draw(20)
    kept = (X[:, -1] != 5) | (np.cumsum(X[:, -1] == 5) < 2)
    model, dense = (
        MultiTaskGPRegressor(rank=1, inference=i, max_iter=0).fit(X[kept], y[kept])
        for i in (inference, "dense")
    )
    assert model.inference_ == {"auto": "dense"}.get(inference, inference)
    close(told(model, Z), told(dense, Z))
