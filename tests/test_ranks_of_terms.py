"""RankSearchIC over the ranks of several terms."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.inspection import RankSelectionDisplay

M = 3
QUICK = {"normalize_y": "shared", "noise": "shared"}
KERNELS = [RBF(2.0, (0.1, 100.0)), RBF(0.3, (0.01, 10.0))]
MODEL = MultiTaskGPRegressor(KERNELS, **QUICK)


def draw(n_terms, n=90):
    rng = np.random.default_rng(0)
    x, task = rng.uniform(0.0, 10.0, n), np.tile(np.arange(M), n // M)
    y = np.array([1.0, -2.0, 0.5])[task] * np.sin(0.6 * x)
    if n_terms == 2:
        y += np.array([0.6, 0.4, -0.7])[task] * np.sin(5.0 * x + 1.0)
    return np.column_stack([x, task]), y + 0.2 * rng.standard_normal(n)


@pytest.fixture(scope="module")
def search():
    ranks = [(2, 1), (1,), (1, 1), (1, 1)]
    return RankSearchIC(MODEL, ranks=ranks, keep_estimators=True).fit(*draw(2))


def test_table(search):
    table = search.results_
    assert table["rank"].tolist() == [(1,), (1, 1), (2, 1)]
    assert table["model"].tolist() == ["rank 1", "rank 1 + rank 1", "rank 2 + rank 1"]
    # kernels, factors, levels and noise
    free = [1 + M, 2 * (1 + M), 2 + M + (2 * M - 1)]
    assert table["n_hyperparameters"].tolist() == [count + 2 for count in free]
    assert (np.diff(table["log_marginal_likelihood"]) >= 0.0).all()
    assert table["chosen"].tolist() == [False, True, False]
    assert search.best_rank_ == (1, 1)
    assert search.best_model_ == "rank 1 + rank 1"
    for value, model in zip(
        table["log_marginal_likelihood"], search.estimators_, strict=True
    ):
        assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=1e-6)


def test_the_chosen_model_predicts(search):
    X, _ = draw(2)
    terms = search.predict_terms(X)
    np.testing.assert_allclose(terms.sum(axis=1), search.predict(X), rtol=1e-9)
    assert search.best_estimator_.rank_ == [1, 1]
    again = pickle.loads(pickle.dumps(search))
    np.testing.assert_array_equal(again.predict(X), search.predict(X))
    assert repr(clone(search)) == repr(search)


def test_terms_that_do_not_help_are_left_out():
    search = RankSearchIC(MODEL, ranks=[(1,), (1, 1), 2]).fit(*draw(1))
    assert search.results_["rank"].tolist() == [(1,), (1, 1), (2, 2)]
    assert search.best_rank_ == (1,)
    assert search.best_estimator_.task_covariance_.shape == (M, M)
    terms = search.predict_terms(draw(1)[0])
    assert terms.shape == (90, 2)


def test_usual_ranks():
    search = RankSearchIC(MODEL.set_params(max_iter=0)).fit(*draw(2))
    MODEL.set_params(max_iter=2000)
    expected = [(1,), (2,), (3,), (1, 1), (2, 2), (3, 3)]
    assert search.results_["rank"].tolist() == expected


def test_picture(search):
    pytest.importorskip("matplotlib")
    display = RankSelectionDisplay.from_estimator(search)
    labels = [text.get_text() for text in display.ax_.get_xticklabels()]
    assert labels == search.results_["model"].tolist()


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"ranks": [(1, 1, 1)]}, r"candidate \(1, 1, 1\).*each of the 2 kernels"),
        ({"ranks": [(1, -1)]}, r"candidate \(1, -1\).*rank of 0 or more"),
        ({"ranks": [()]}, r"has the candidate \(\)"),
        ({"ranks": []}, r"ranks=\[\] has no candidate"),
        ({"criterion": "laplace"}, "criterion='laplace' integrates .*'bic' or 'loo'"),
        ({"simpler": True}, "simpler=True adds candidates of one kernel"),
    ],
)
def test_refusals(params, match):
    with pytest.raises(ValueError, match=match):
        RankSearchIC(MODEL, **params).fit(*draw(1))


def test_leaving_one_out():
    search = RankSearchIC(MODEL, ranks=[(1,), (1, 1)], criterion="loo").fit(*draw(2))
    assert search.best_rank_ == (1, 1)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_table_of_several_terms_alone():
    """No candidate has one kernel."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0.0, 6.0, 24), np.repeat([0, 1], 12)])
    model = MultiTaskGPRegressor(["rbf", "linear"], max_iter=1, tol=1.0)
    search = RankSearchIC(model, ranks=[(1, 1), (2, 1)]).fit(X, np.sin(X[:, 0]))
    table = search.results_
    assert len(table) == 2
    expected = table["n_hyperparameters"] * np.log(24)
    np.testing.assert_allclose(
        table["bic"], expected - 2.0 * table["log_marginal_likelihood"]
    )


@pytest.mark.parametrize("criterion", ["auto", "bic"])
def test_few_rows_a_task(criterion):
    model = MultiTaskGPRegressor(KERNELS, max_iter=2, **QUICK)
    search = RankSearchIC(model, ranks=[(1,), (1, 1)], criterion=criterion)
    with pytest.warns(ConvergenceWarning):
        search.fit(*draw(2, n=12))
    assert search.criterion_ == "bic"
