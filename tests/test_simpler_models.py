"""Candidates of RankSearchIC beside the ranks, and diagonals of one variance."""

import pickle
import warnings

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from samples import log_densities
from scipy.stats import norm
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
    single_task,
)
from skmtgp._estimators import doubts
from skmtgp._estimators.fitted import evidence_of
from skmtgp.exceptions import LongFitWarning, UnidentifiedNoiseWarning
from skmtgp.inspection import (
    RankSelectionDisplay,
    TaskCovarianceDisplay,
    TransferDisplay,
)
from skmtgp.learning import forecast

SIMPLE = {"noise": "shared", "normalize_y": "shared"}
SEARCH = RankSearchIC(MultiTaskGPRegressor(**SIMPLE))
COMPOUND = {"rank": 0, "shared": True, "diagonal": "equal"}
NAMES = ["independent", "compound symmetry", "shared", "rank 1", "rank 2", "rank 3"]


def related(shared, own, lengths=(1.0,) * 4, per_task=15, seed=0):
    """Tasks of variances `shared` and `own`, with little noise."""
    rng = np.random.default_rng(seed)
    M = len(lengths)
    tasks = np.repeat(np.arange(M), per_task)
    x, y = rng.uniform(0.0, 6.0, len(tasks)), 0.05 * rng.standard_normal(len(tasks))

    def function(x, length):
        K = RBF(length)(x[:, None]) + 1e-9 * np.eye(len(x))
        return np.linalg.cholesky(K) @ rng.standard_normal(len(x))

    y += np.sqrt(shared) * function(x, 1.0)
    for m, length in enumerate(lengths):
        rows = tasks == m
        y[rows] += np.sqrt(own) * function(x[rows], length) + m
    return np.column_stack([x, tasks]), y


DATA = {
    "independent": related(0.0, 1.0),
    "compound symmetry": related(1.0, 0.1, per_task=20),
    "shared": related(1.0, 0.0),
    "single tasks": related(0.0, 1.0, [0.3, 4.0, 0.3, 4.0], per_task=20),
}
GRID = np.column_stack([np.linspace(0.5, 5.5, 8), np.repeat([0, 1, 2, 3], 2)])


@pytest.fixture(autouse=True)
def close_figures():
    """Drawn without a window, and closed."""
    matplotlib.use("Agg")
    yield
    plt.close("all")


FEW = {"ranks": (0, 1), "simpler": True}
ASKED = {"independent": FEW, "shared": FEW}  # for the others all that are by default


@pytest.fixture(scope="module", params=DATA)
def searched(request):
    X, y = DATA[request.param]
    search = clone(SEARCH).set_params(keep_estimators=True)
    search.set_params(**ASKED.get(request.param, {}))
    return request.param, search.fit(X, y)


class TestChoice:
    def test_finds_the_model_of_the_data(self, searched):
        name, search = searched
        assert search.best_model_ == name
        assert search.best_rank_ == 0
        table = search.results_
        names = table["model"].tolist()
        own = [of for of in names if of.endswith(" and diagonal")]
        assert len(own) <= 1  # of the best rank, if the data are noisy
        ranks = NAMES[:4] if name in ASKED else [*NAMES, "rank 4"]
        assert names == [*ranks, *own, "single tasks"]
        assert table["model"][table["chosen"]].tolist() == [name]

    def test_likelihoods_are_those_of_y(self, searched):
        name, search = searched
        values = search.results_["log_marginal_likelihood"]
        for model, value in zip(search.estimators_, values, strict=True):
            assert model.log_marginal_likelihood_value_ == pytest.approx(value)
            alone = getattr(model, "estimators_", None)
            if alone is None:
                assert sum(log_densities(model, *DATA[name])) == pytest.approx(value)
            else:
                found = [
                    sum(
                        log_densities(
                            of, np.c_[of.X_train_, 0 * of.y_train_], of.y_train_
                        )
                    )
                    for of in alone
                ]
                assert sum(found) == pytest.approx(value)

    def test_parameters_are_counted(self, searched):
        _, search = searched
        counts = search.results_.set_index("model")["n_hyperparameters"]
        common = 3  # a length-scale, levels, noise
        assert counts["independent"] == counts["shared"] == common + 1
        assert counts["compound symmetry"] == common + 2
        assert counts["single tasks"] == 4 * 3  # amplitude, length-scale, noise

    def test_larger_models_are_not_below_their_parts(self, searched):
        _, search = searched
        values = search.results_.set_index("model")["log_marginal_likelihood"]
        least = max(values["independent"], values["shared"])
        assert values["compound symmetry"] > least - 0.1

    def test_methods_and_properties(self, searched):
        name, search = searched
        X, y = DATA[name]
        best = search.best_estimator_
        mean, std = search.predict(GRID, return_std=True)
        np.testing.assert_array_equal(mean, best.predict(GRID))
        cov = search.predict(GRID, return_cov=True)[1]
        np.testing.assert_allclose(np.diagonal(cov), std**2, rtol=1e-6, atol=1e-10)
        assert search.sample_y(GRID, 3).shape == (8, 3)
        assert search.loo_predict()[0].shape == y.shape
        assert search.score(X, y) > 0.9
        assert search.tasks_.tolist() == [0, 1, 2, 3]
        assert search.n_features_in_ == 2
        theta = best.theta_
        value, gradient = search.log_marginal_likelihood(theta, eval_gradient=True)
        assert value == pytest.approx(best.log_marginal_likelihood_value_)
        assert gradient.shape == theta.shape
        again = pickle.loads(pickle.dumps(search))
        np.testing.assert_array_equal(again.predict(GRID), mean)
        assert again.best_model_ == name

    def test_a_task_that_joins(self, searched):
        name, search = searched
        rows = np.array([[1.0, 9], [3.0, 9]])
        if name == "single tasks":
            with pytest.raises(TypeError, match=r"single tasks.* simpler=False"):
                search.add_task(rows, [1.0, 2.0])
            return
        extended = search.add_task(rows, [1.0, 2.0])
        assert extended.tasks_.tolist() == [0, 1, 2, 3, 9]
        np.testing.assert_allclose(extended.predict(GRID), search.predict(GRID), 0.2)
        if name != "shared":  # where it can but have another level
            near = extended.predict([[1.01, 9], [2.99, 9]])
            np.testing.assert_allclose(near, [1.0, 2.0], atol=0.1)

    def test_a_task_that_was_not_seen(self, searched):
        name, search = searched
        if name in ("shared", "compound symmetry"):
            _, std = search.predict([[1.0, 9]], return_std=True)
            assert std > search.predict([[1.0, 0]], return_std=True)[1]
        else:
            with pytest.raises(ValueError, match="9"):
                search.predict([[1.0, 9]])

    def test_summary(self, searched):
        name, search = searched
        table = search.summary()
        assert table.index.tolist() == [0, 1, 2, 3]
        related = name not in ("independent", "single tasks")
        assert (table["correlation"] > 0.0).all() == related

    def test_pictures(self, searched):
        name, search = searched
        display = RankSelectionDisplay.from_estimator(search)
        names = [tick.get_text() for tick in display.ax_.get_xticklabels()]
        assert names == search.results_["model"].tolist()
        assert display.chosen_.get_label() == f"{name}, chosen"
        assert set(display.chosen_.get_xdata()) == {names.index(name)}
        for of in (TransferDisplay, TaskCovarianceDisplay):
            if name == "single tasks":
                with pytest.raises(TypeError, match="SingleTaskGP has no"):
                    of.from_estimator(search)
            else:
                of.from_estimator(search)

    def test_transfer_tells_related_tasks(self, searched):
        name, search = searched
        if name == "single tasks":
            return
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnidentifiedNoiseWarning)
            display = TransferDisplay.from_estimator(search)
        assert display.transfer["related"].all() == (name != "independent")
        assert display.transfer["related"].any() == (name != "independent")


class TestWhichCandidates:
    @pytest.mark.parametrize(
        ("params", "simpler"),
        [
            ({"ranks": (1, 2)}, False),
            ({"ranks": (1, 2), "simpler": True}, True),
            ({"simpler": False}, False),
            ({"estimator__inference": "sparse", "estimator__n_exact": 30}, False),
        ],
    )
    def test_ranks_that_are_given_are_all(self, params, simpler):
        X, y = related(1.0, 0.0, [1.0] * 2, per_task=12)
        params = {"estimator__max_iter": 1, **params}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = clone(SEARCH).set_params(**params).fit(X, y)
        assert ("independent" in search.results_["model"].tolist()) == simpler

    def test_ranks_that_are_given_are_learned_as_ever(self):
        X, y = DATA["compound symmetry"]
        alone = clone(SEARCH).set_params(ranks=(1, 2)).fit(X, y).results_
        beside = clone(SEARCH).set_params(ranks=(1, 2), simpler=True).fit(X, y).results_
        found = beside.set_index("model").loc[["rank 1", "rank 2"]]
        for name in ("log_marginal_likelihood", "bic"):
            np.testing.assert_allclose(found[name], alone[name], rtol=1e-10)

    def test_one_task_has_no_simpler_models(self):
        X, y = related(1.0, 0.0, [1.0], per_task=12)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = clone(SEARCH).set_params(estimator__max_iter=1).fit(X, y)
        assert search.results_["model"].tolist() == ["shared", "rank 1"]

    @pytest.mark.parametrize(("per_task", "told"), [(5, False), (6, True)])
    def test_few_rows_do_not_tell_tasks_alone(self, per_task, told):
        X, y = related(1.0, 0.0, per_task=per_task)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = clone(SEARCH).set_params(estimator__max_iter=1).fit(X, y)
        assert ("single tasks" in search.results_["model"].tolist()) == told

    def test_an_estimator_with_an_equal_diagonal_is_there_once(self):
        X, y = DATA["shared"]
        search = clone(SEARCH).set_params(estimator__diagonal="equal", simpler=True)
        search.set_params(ranks=(0, 1), estimator__max_iter=1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = search.fit(X, y).results_["model"].tolist()
        names = ["independent", "compound symmetry", "rank 1 and equal diagonal"]
        assert found == [*names, "single tasks"]

    def test_a_diagonal_of_the_estimator_is_that_of_the_ranks(self):
        X, y = DATA["compound symmetry"]
        search = clone(SEARCH).set_params(estimator__diagonal=True)
        search.set_params(ranks=(0, 1), simpler=True).fit(X, y)
        table = search.results_.set_index("model")["log_marginal_likelihood"]
        assert table.index.tolist() == [
            "independent",
            "compound symmetry",
            "shared and diagonal",
            "rank 1 and diagonal",
            "single tasks",
        ]
        assert table["shared and diagonal"] >= table["compound symmetry"] - 1e-6

    def test_unknown(self):
        with pytest.raises(ValueError, match="'simpler' parameter of RankSearchIC"):
            RankSearchIC(simpler="never").fit(*DATA["shared"])


class TestSingleTasks:
    def test_criteria_count_the_parameters_of_all_tasks(self):
        X, y = DATA["single tasks"]
        X, y = X[:-5], y[:-5]  # tasks of 20 and of 15 rows
        search = clone(SEARCH).set_params(criterion="loo", keep_estimators=True, **FEW)
        row = search.fit(X, y).results_.iloc[-1]
        model = search.estimators_[-1]
        deviance, log_n = -2.0 * row["log_marginal_likelihood"], np.log(75)
        assert row["bic"] == pytest.approx(deviance + 12 * log_n)
        assert row["aic"] == pytest.approx(deviance + 12 * 2)
        assert row["hqc"] == pytest.approx(deviance + 24 * np.log(log_n))
        mean, std = model.loo_predict(include_noise=True)
        assert row["loo"] == pytest.approx(-2.0 * norm.logpdf(y, mean, std).sum())
        assert isinstance(model, SingleTaskGP)

    def test_several_outputs(self):
        X, y = DATA["single tasks"]
        search = clone(SEARCH).set_params(keep_estimators=True, **FEW)
        search.fit(X, np.column_stack([y, 10.0 * y + 3.0]))
        assert search.best_model_ == "single tasks"
        row = search.results_.iloc[-1]
        values = search.best_estimator_.log_marginal_likelihoods_
        for j in (0, 1):
            assert row[f"output{j}_log_marginal_likelihood"] == pytest.approx(values[j])
        assert row["n_hyperparameters"] == 24
        log_n = np.log(2 * len(y))
        assert row["bic"] == pytest.approx(-2.0 * values.sum() + 24 * log_n)
        assert search.predict(GRID).shape == (8, 2)

    def test_what_they_warn_of_is_said_if_they_are_chosen(self):
        rng = np.random.default_rng(0)
        X = np.column_stack([rng.uniform(0, 6, 24), np.repeat([0, 1], 12)])
        y = np.where(X[:, 1] == 0, np.sin(X[:, 0]), rng.standard_normal(24))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            search = clone(SEARCH).set_params(keep_estimators=False, **FEW).fit(X, y)
        told = [str(w.message) for w in caught if "Task" in str(w.message)]
        assert bool(told) <= (search.best_model_ == "single tasks")

    def test_that_they_take_long_is_not_said_when_they_are_done(self, monkeypatch):
        monkeypatch.setattr(single_task, "FEW", 10)
        monkeypatch.setattr(forecast, "FEW", 10)
        monkeypatch.setattr(doubts, "LONG", 0.0)
        X, y = DATA["single tasks"]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            search = clone(SEARCH).set_params(ranks=(0, 1), simpler=True).fit(X, y)
        assert search.best_model_ == "single tasks"
        told = [str(w.message) for w in caught if w.category is LongFitWarning]
        assert len(told) == 1
        assert told[0].startswith("Learning from 80 rows by dense")

    def test_not_fitted(self):
        for method in ("summary", "loo_predict"):
            with pytest.raises(NotFittedError):
                getattr(RankSearchIC(), method)()


@pytest.fixture(
    scope="module",
    params=[None, pytest.param(2, marks=pytest.mark.long)],
    ids=["one output", "two outputs"],
)
def laplace(request):
    X, y = DATA["compound symmetry"]
    y = y if request.param is None else np.column_stack([y, -y])
    search = clone(SEARCH).set_params(criterion="laplace", keep_estimators=True)
    return search.set_params(ranks=(0, 1), simpler=True).fit(X, y), y


class TestLaplace:
    def test_it_is_the_evidence_of_each_candidate(self, laplace):
        search, _ = laplace
        found = search.results_["laplace"]
        for value, model in zip(found, search.estimators_, strict=True):
            parts = getattr(model, "estimators_", [model])
            expected = -2.0 * sum(map(evidence_of, parts))
            if len(parts) > 1:  # their units, and how far apart their means are
                means = np.array([np.ravel(part.y_mean_) for part in parts])
                scales = np.array([np.ravel(part.y_scale_) for part in parts])
                apart = np.log(np.square(means.std(axis=0) / scales))
                expected += scales.size * np.log(20) + np.maximum(1 + apart, 0).sum()
            assert value == pytest.approx(expected, rel=1e-6)
        assert found.argmin() == search.results_["chosen"].argmax()
        assert search.best_model_ == "compound symmetry"

    def test_units_of_y_do_not_matter(self, laplace):
        search, y = laplace
        other = clone(search).fit(DATA["compound symmetry"][0], 8.0 * y)
        change = other.results_["laplace"] - search.results_["laplace"]
        np.testing.assert_allclose(change, 2.0 * y.size * np.log(8.0), rtol=1e-3)

    def test_it_chooses_by_default(self, searched):
        assert searched[1].criterion_ == "laplace"
        table = searched[1].results_
        assert table["laplace"].argmin() == table["chosen"].argmax()

    def test_only_if_asked(self):
        X, y = DATA["shared"]
        search = clone(SEARCH).set_params(criterion="bic", **FEW)
        assert "laplace" not in search.fit(X, y).results_
        assert search.criterion_ == "bic"

    def test_levels_that_vanish_are_not(self):
        """Tasks without levels, whose variance ends anywhere: the others decide."""
        rng = np.random.default_rng(9)
        tasks, x = np.repeat(np.arange(3), 12), rng.uniform(0.0, 6.0, 36)
        y = np.sin(x + 2.0 * tasks) + 0.1 * rng.standard_normal(36)
        search = clone(SEARCH).set_params(criterion="laplace", **FEW)
        table = search.fit(np.column_stack([x, tasks]), y).results_
        alike = table["laplace"][0], table["laplace"][1]
        assert abs(np.diff(alike)) < 6.0

    def test_noise_that_vanishes_is_paid_for(self):
        """Eight tasks of five rows, whose noise BIC lets a rank explain away."""
        rng = np.random.default_rng(7)
        tasks = np.repeat(np.arange(8), 5)
        x = rng.uniform(0.0, 6.0, 40)
        y = rng.standard_normal(8)[tasks] * np.sin(x) + 0.3 * rng.standard_normal(40)
        X = np.column_stack([x, tasks])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = clone(SEARCH).set_params(criterion="laplace").fit(X, y)
        assert search.best_estimator_.noise_variance_ > 1e-3


class TestEqualDiagonal:
    """`diagonal="equal"` of MultiTaskGPRegressor."""

    def test_independent_tasks_are_those_of_independent_gp(self):
        X, y = DATA["independent"]
        model = MultiTaskGPRegressor(rank=0, diagonal="equal", **SIMPLE).fit(X, y)
        other = IndependentGP(**SIMPLE).fit(X, y)
        value = other.log_marginal_likelihood_value_
        assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.1)
        assert model.n_hyperparameters_ == other.n_hyperparameters_
        np.testing.assert_allclose(model.predict(GRID), other.predict(GRID), atol=0.02)
        K = model.task_covariance_
        np.testing.assert_allclose(K, K[0, 0] * np.eye(4))

    def test_compound_symmetry(self):
        X, y = DATA["compound symmetry"]
        model = MultiTaskGPRegressor(**COMPOUND, **SIMPLE).fit(X, y)
        K = model.task_covariance_
        a, d = K[0, 1], K[0, 0] - K[0, 1]
        np.testing.assert_allclose(K, a + d * np.eye(4))
        assert 0.02 < d / a < 0.5
        assert sum(log_densities(model, X, y)) == pytest.approx(
            model.log_marginal_likelihood_value_
        )

    @pytest.mark.parametrize("rank", [0, 1])
    def test_sparse_inference_comes_near(self, rank):
        X, y = DATA["independent"]
        model = MultiTaskGPRegressor(rank=rank, diagonal="equal", **SIMPLE)
        exact = clone(model).fit(X, y)
        sparse = model.set_params(inference="sparse", n_inducing=40).fit(X, y)
        value = exact.log_marginal_likelihood_value_
        assert sparse.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.5)

    @pytest.mark.parametrize("inference", ["dense", "sparse"])
    def test_a_task_joins_independent_ones(self, inference):
        X, y = DATA["independent"]
        model = MultiTaskGPRegressor(
            rank=0, diagonal="equal", inference=inference, max_iter=20, **SIMPLE
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(X, y)
        extended = model.add_task([[1.0, 9]], [5.0])
        K = extended.task_covariance_
        np.testing.assert_allclose(K, K[0, 0] * np.eye(5))
        assert extended.predict([[1.0, 9]]) == pytest.approx([5.0], abs=0.5)

    def test_rank_0_needs_something(self):
        for params in ({}, {"diagonal": True}):
            model = MultiTaskGPRegressor(rank=0, **params)
            with pytest.raises(ValueError, match=r"shared=True.* diagonal='equal'"):
                model.fit(*DATA["shared"])

    @pytest.mark.parametrize("diagonal", ["own", 1.5])
    def test_unknown(self, diagonal):
        model = MultiTaskGPRegressor(diagonal=diagonal)
        with pytest.raises(ValueError, match="'diagonal' parameter"):
            model.fit(*DATA["shared"])


@pytest.mark.parametrize("params", [{}, {"diagonal": True}, {"diagonal": "equal"}])
def test_simultaneous_learning_of_one_function_starts_with_one(params):
    X, y = DATA["shared"]
    model = MultiTaskGPRegressor(rank=0, shared=True, random_state=0, **SIMPLE)
    model.set_params(**params)
    best = clone(model).fit(X, y).log_marginal_likelihood_value_
    model.set_params(learning="simultaneous", n_restarts_optimizer=2)
    found = model.fit(X, y).log_marginal_likelihood_value_
    assert found > best - 5.0


def test_default_of_many_tasks_of_few_rows():
    """Any two tasks are equally alike: the default has an equal diagonal, too."""
    rng, tasks = np.random.default_rng(0), np.repeat(np.arange(20), 5)
    x = rng.uniform(0.0, 6.0, 100)
    K = np.exp(-0.5 * np.subtract.outer(x, x) ** 2)
    K *= 1.0 + 0.5 * np.equal.outer(tasks, tasks)
    f = np.linalg.cholesky(K + 1e-9 * np.eye(100)) @ rng.standard_normal(100)
    y = f + rng.standard_normal(20)[tasks] + 0.1 * rng.standard_normal(100)
    X = np.column_stack([x, tasks])
    model = MultiTaskGPRegressor().fit(X, y)
    assert (model.rank_, model.diagonal_) == (0, "equal")
    same = MultiTaskGPRegressor(rank=0, shared=True, diagonal="equal").fit(X, y)
    assert same.diagonal_ == "equal"
    np.testing.assert_allclose(model.predict(X), same.predict(X), atol=1e-3)
    joined = model.add_task(np.array([[1.0, 20.0], [2.0, 20.0]]), [0.0, 1.0])
    assert joined.diagonal_ == "equal"
    plain = MultiTaskGPRegressor(rank=1, max_iter=0).fit(X, y)
    assert plain.diagonal_ is False
    assert plain.set_params(diagonal=True).fit(X, y).diagonal_ is True
