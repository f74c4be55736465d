import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from multitask_models import PAPER
from samples import draw, log_densities
from scipy.stats import norm
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    model_selection,
)
from skmtgp.learning import ranks

MODEL = MultiTaskGPRegressor(**PAPER, max_iter=3)
STAGED = clone(MODEL).set_params(learning="staged")
CRITERIA = ("bic", "aic", "hqc")
CHOSEN = {"bic": 1, "aic": 3, "hqc": 2, "loo": 4, "laplace": 3}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(scope="module", params=[None, 2], ids=["one output", "two outputs"])
def data(request):
    return draw(n_tasks=4, per_task=8, n_outputs=request.param)


@pytest.fixture(scope="module")
def search(data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return RankSearchIC(MODEL, ranks=(1, 2, 3, 4)).fit(*data)


def likelihoods(search):
    """Without the times, which differ."""
    return search.results_.drop(columns=["model", "fit_time"])


@pytest.mark.parametrize(
    ("params", "d_j", "of_tasks"),
    [
        ({}, 2, 1),  # a length-scale for each feature, and the noise
        ({"kernel": ConstantKernel(2.0) * RBF([1.0, 1.0])}, 3, 1),
        ({"kernel": ConstantKernel(2.0, "fixed") * RBF(1.0)}, 1, 1),
        ({"diagonal": True, "noise": "per_task"}, 2, 8),
        ({"noise_variance_bounds": "fixed"}, 2, 0),
        ({"task_levels": True}, 2, 2),
        ({"task_levels": True, "normalize_y": "per_task"}, 2, 2),
    ],
)
def test_criteria_are_those_of_eq_8(data, params, d_j, of_tasks):
    X, y = data
    model = clone(STAGED).set_params(max_iter=0, **params)
    search = RankSearchIC(model, ranks=(1, 2, 3, 4))
    found = search.fit(X, y).results_
    n, J, M = y.size, y.size // len(y), 4
    for i, r in enumerate(found["rank"]):
        each = d_j + r * (2 * M + 1 - r) / 2 + of_tasks
        assert found["n_hyperparameters"][i] == J * each
        deviance = -2.0 * found["log_marginal_likelihood"][i]
        assert found["bic"][i] == pytest.approx(deviance + J * each * np.log(n))
        assert found["aic"][i] == pytest.approx(deviance + 2 * J * each)
        hannan_quinn = 2 * J * each * np.log(np.log(n))
        assert found["hqc"][i] == pytest.approx(deviance + hannan_quinn)


def test_results_are_a_table(search, data):
    table = search.results_
    columns = ["rank", "model", "log_marginal_likelihood", "n_hyperparameters"]
    columns += [*CRITERIA, *({search.criterion_} - set(CRITERIA))]
    of_outputs = [f"output{j}_log_marginal_likelihood" for j in (0, 1)]
    columns += ["fit_time", *(of_outputs if data[1].ndim > 1 else []), "chosen"]
    assert table.columns.tolist() == columns
    if data[1].ndim > 1:
        total = table[of_outputs].sum(axis=1)
        np.testing.assert_allclose(total, table["log_marginal_likelihood"], rtol=1e-12)
        best = table[table["rank"] == search.best_rank_].iloc[0]
        values = search.best_estimator_.log_marginal_likelihoods_
        np.testing.assert_allclose(best[of_outputs].tolist(), values, rtol=1e-9)
    assert table["rank"].tolist() == [1, 2, 3, 4]
    assert (table["fit_time"] > 0.0).all()
    assert table["rank"][table["chosen"]].tolist() == [search.best_rank_]


def test_best_estimator_is_that_of_the_results(search, data):
    best = search.best_estimator_
    i = search.results_["rank"].tolist().index(search.best_rank_)
    value = search.results_["log_marginal_likelihood"][i]
    assert best.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-10)
    assert best.n_hyperparameters_ == search.results_["n_hyperparameters"][i]
    assert best.rank == best.rank_ == search.best_rank_
    assert sum(log_densities(best, *data)) == pytest.approx(value)


@pytest.mark.parametrize(("criterion", "chosen"), CHOSEN.items())
def test_criterion_chooses(data, monkeypatch, criterion, chosen):
    def disagreeing(training, of_forms, modes, *_, **__):
        ranks = np.array([of[0].prior.task_covariance.rank for of in of_forms])
        return {c: np.abs(ranks - r) for c, r in CHOSEN.items()}

    monkeypatch.setattr(model_selection, "tabulate", disagreeing)
    model = clone(STAGED).set_params(max_iter=0)
    search = RankSearchIC(model, ranks=(1, 2, 3, 4), criterion=criterion).fit(*data)
    assert search.best_rank_ == search.best_estimator_.rank_ == chosen


def test_what_could_not_be_computed_is_not_chosen(data, monkeypatch):
    monkeypatch.setattr(
        model_selection, "tabulate", lambda *_, **__: {"bic": np.array([np.nan, 2.0])}
    )
    model = clone(STAGED).set_params(max_iter=0)
    assert RankSearchIC(model, ranks=(1, 2)).fit(*data).best_rank_ == 2


def test_parameters_of_the_estimator_are_checked_first(data):
    with pytest.raises(ValueError, match="'verbose' parameter of MultiTaskGPRegressor"):
        RankSearchIC(clone(MODEL).set_params(verbose="yes")).fit(*data)


def related(rank, M=4, per_task=16):
    """Nearly noise-free data of the model itself."""
    rng = np.random.default_rng(0)
    tasks, x = np.repeat(np.arange(M), per_task), rng.uniform(0.0, 6.0, M * per_task)
    K = RBF(1.0)(x[:, None]) + 1e-10 * np.eye(len(x))
    latent = np.linalg.cholesky(K) @ rng.standard_normal((len(x), rank))
    y = np.einsum("nr,nr->n", latent, rng.standard_normal((M, rank))[tasks])
    y += 1e-2 * rng.standard_normal(len(y))
    return np.column_stack([x, tasks]), y


@pytest.mark.filterwarnings("error")
def test_bic_finds_the_rank_of_the_data():
    model = MultiTaskGPRegressor(normalize_y=False)
    search = RankSearchIC(model, ranks=(1, 2, 3, 4)).fit(*related(2, per_task=24))
    assert search.best_rank_ == 2


def test_likelihoods_do_not_fall_as_the_rank_grows(search):
    values = search.results_["log_marginal_likelihood"].to_numpy()
    assert (np.diff(values) >= -1e-9 * np.abs(values[1:])).all()
    assert values[-1] > values[0] + 1.0


def test_one_rank_is_learned_as_by_the_estimator(data):
    alone = clone(MODEL).set_params(rank=2).fit(*data)
    (value,) = (
        RankSearchIC(MODEL, ranks=[2]).fit(*data).results_["log_marginal_likelihood"]
    )
    assert alone.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-9)


def test_ranks_are_merged_and_sorted(search, data):
    other = RankSearchIC(MODEL, ranks=[9, 3, 1, 3, 2, 4, 10]).fit(*data)
    for name, values in likelihoods(search).items():
        np.testing.assert_array_equal(other.results_[name], values, err_msg=name)


def test_default_ranks_are_capped():
    model = clone(MODEL).set_params(max_iter=0)
    search = RankSearchIC(model, simpler=False).fit(*draw(n_tasks=3))
    assert search.results_["rank"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("per_task", "most"), [(12, 3), (10, 2), (6, 2), (5, 1), (2, 1), (1, 0)]
)
def test_default_ranks_leave_rows_for_each_parameter(per_task, most):
    """Four; three are enough for rank 2, which has 15 of 8 tasks; two for rank 1."""
    model = clone(MODEL).set_params(max_iter=0)
    search = RankSearchIC(model, simpler=False)
    found = search.fit(*draw(n_tasks=8, per_task=per_task)).results_["rank"]
    assert found.tolist() == [*range(most + 1)]


def test_rank_of_the_estimator_does_not_matter(search, data):
    model = clone(MODEL).set_params(rank=99)
    other = RankSearchIC(model, ranks=(1, 2, 3, 4)).fit(*data)
    assert other.best_rank_ == search.best_rank_
    assert model.rank == 99
    assert not hasattr(model, "rank_")


def test_two_jobs_find_what_one_does(search, data):
    other = RankSearchIC(MODEL, ranks=(1, 2, 3, 4), n_jobs=2).fit(*data)
    for name, values in likelihoods(search).items():
        np.testing.assert_allclose(other.results_[name], values, rtol=1e-6)


def test_methods_are_the_best_estimators(search, data):
    X, y = data
    best = search.best_estimator_
    np.testing.assert_array_equal(search.predict(X), best.predict(X))
    for options in ({"return_std": True}, {"return_cov": True}):
        options["include_noise"] = True
        for found, expected in zip(
            search.predict(X, **options), best.predict(X, **options), strict=True
        ):
            np.testing.assert_array_equal(found, expected)
    assert search.score(X, y) == best.score(X, y)
    for noise in (False, True):
        samples, expected = (
            m.sample_y(X[:3], 2, random_state=1, include_noise=noise)
            for m in (search, best)
        )
        np.testing.assert_array_equal(samples, expected)
    theta = best.theta_ + 0.1
    value, gradient = search.log_marginal_likelihood(theta, eval_gradient=True)
    expected = best.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == expected[0]
    np.testing.assert_array_equal(gradient, expected[1])
    assert search.log_marginal_likelihood() == best.log_marginal_likelihood()


def test_names_of_features_are_the_best_estimators():
    X, y = draw()
    table = pd.DataFrame(X, columns=["a", "b", "load"])
    search = RankSearchIC(clone(MODEL).set_params(max_iter=0), ranks=[1])
    assert not hasattr(search, "n_features_in_")
    assert not hasattr(search, "feature_names_in_")
    search.fit(table, y)
    assert search.n_features_in_ == 3
    assert search.feature_names_in_.tolist() == ["a", "b", "load"]
    assert not hasattr(search.fit(X, y), "feature_names_in_")


def test_verbosity(told, data):
    quiet = RankSearchIC(clone(MODEL).set_params(max_iter=0), ranks=(1, 2))
    quiet.fit(*data)
    assert told() == []
    clone(quiet).set_params(verbose=1).fit(*data)
    n_outputs = data[1].size // len(data[1])
    lines = told()
    starts = [line.split(" log ")[0] for line in lines]
    names = [f"output {j} of {n_outputs}" for j in range(1, n_outputs + 1)]
    names = [f"{name}, " for name in names] if n_outputs > 1 else [""]
    assert starts[:-1] == [f"{name}rank {r}:" for name in names for r in (1, 2)]
    assert all("best of 2 starts" in line for line in lines[:-1])
    assert lines[-1] == f"chosen by BIC: rank {quiet.best_rank_}"


def test_attributes_of_the_best_estimator_alone(search):
    for model in (search, clone(search), pickle.loads(pickle.dumps(search))):
        fitted = hasattr(model, "best_estimator_")
        where = "; see best_estimator_.task_covariance_" if fitted else ""
        with pytest.raises(AttributeError) as error:
            model.task_covariance_  # noqa: B018
        assert str(error.value) == (
            f"'RankSearchIC' object has no attribute 'task_covariance_'{where}"
        )
        assert not hasattr(model, "task_covariance_")
        with pytest.raises(AttributeError, match=r"no attribute 'covariance_'$"):
            model.covariance_  # noqa: B018
    with pytest.raises(NotFittedError):
        clone(search).tasks_  # noqa: B018


@pytest.mark.parametrize("method", ["predict", "sample_y"])
def test_methods_of_what_is_not_fitted(method):
    with pytest.raises(NotFittedError):
        getattr(RankSearchIC(), method)(draw()[0])


def test_likelihood_of_what_is_not_fitted():
    with pytest.raises(NotFittedError):
        RankSearchIC().log_marginal_likelihood()


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"ranks": []}, r"ranks=\[\] must be a sequence of one or more integers"),
        ({"ranks": [1.0, 2.0]}, "must be a sequence of one or more integers"),
        ({"ranks": [[1, 2]]}, "must be a sequence of one or more integers"),
        ({"ranks": [(1,), (1, 1)]}, "integers. Tuples are for .* a list of kernels"),
        ({"ranks": [1, (1, 1)]}, "integers. Tuples are for .* a list of kernels"),
        ({"ranks": [True]}, "must be a sequence of one or more integers"),
        ({"ranks": (2, -1)}, r"ranks=\(2, -1\) must be 0 or more"),
        ({"ranks": 2}, "'ranks' parameter of RankSearchIC must be an array-like"),
        ({"criterion": "dic"}, "'criterion' parameter .* must be a str among"),
        (
            {"estimator": PooledGP()},
            r"'estimator' parameter .*\.MultiTaskGPRegressor' or None",
        ),
        ({"estimator__noise": "each"}, "'noise' parameter of MultiTaskGPRegressor"),
        ({"estimator__noise_variance_bounds": (2, 1)}, "the smaller one first"),
    ],
)
def test_bad_parameters(params, match):
    search = RankSearchIC(clone(MODEL)).set_params(**params)
    with pytest.raises(ValueError, match=match):
        search.fit(*draw())


def test_failed_fit_changes_nothing(monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    X, y = draw()
    search = RankSearchIC(clone(MODEL).set_params(max_iter=0), ranks=(1, 2)).fit(X, y)
    before = dict(vars(search))
    monkeypatch.setattr(ranks, "second_stage", interrupt)
    with pytest.raises(KeyboardInterrupt):
        search.fit(np.insert(X, 0, 1.0, axis=1), y)
    assert vars(search).keys() == before.keys()
    assert all(vars(search)[name] is value for name, value in before.items())
    assert search.n_features_in_ == 3


@pytest.fixture(scope="module")
def kept(data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return RankSearchIC(STAGED, ranks=(1, 2, 4), keep_estimators=True).fit(*data)


class TestKeptEstimators:
    def test_one_for_each_rank(self, kept, data):
        names = ("rank", "log_marginal_likelihood", "n_hyperparameters", "bic")
        table = zip(*(kept.results_[name] for name in names), strict=True)
        n = data[1].size
        for model, (rank, value, count, bic) in zip(
            kept.estimators_, table, strict=True
        ):
            assert model.rank == model.rank_ == rank
            assert model.log_marginal_likelihood_value_ == pytest.approx(value)
            assert sum(log_densities(model, *data)) == pytest.approx(value)
            assert model.n_hyperparameters_ == count
            assert -2.0 * value + count * np.log(n) == pytest.approx(bic)
            assert (
                model.get_params() == clone(STAGED).set_params(rank=rank).get_params()
            )

    def test_the_best_is_one_of_them(self, kept):
        best = np.argmin(kept.results_[kept.criterion_])
        assert kept.best_estimator_ is kept.estimators_[best]
        assert len({id(model) for model in kept.estimators_}) == 3

    def test_they_are_those_that_are_not_kept(self, kept, data):
        plain = RankSearchIC(STAGED, ranks=(1, 2, 4)).fit(*data)
        assert not hasattr(plain, "estimators_")
        assert plain.best_rank_ == kept.best_rank_
        for name, values in likelihoods(plain).items():
            np.testing.assert_array_equal(kept.results_[name], values, err_msg=name)
        expected = plain.best_estimator_.theta_
        np.testing.assert_array_equal(kept.best_estimator_.theta_, expected)

    def test_a_fit_that_keeps_none_forgets_them(self, data):
        model = clone(STAGED).set_params(max_iter=0)
        search = RankSearchIC(model, ranks=(1, 2), keep_estimators=True).fit(*data)
        assert len(search.estimators_) == 2
        search.set_params(keep_estimators=False).fit(*data)
        assert not hasattr(search, "estimators_")

    def test_those_that_are_not_chosen_do_not_warn(self, data):
        search = RankSearchIC(MODEL, ranks=(1, 2, 3), keep_estimators=True)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ConvergenceWarning)
            search.fit(*data)
        told = [w for w in caught if w.category is ConvergenceWarning]
        assert len(told) == 1

    def test_weak_priors_are_no_part_of_the_likelihoods(self, data):
        model = clone(STAGED).set_params(hyperparameters="map")
        search = RankSearchIC(model, ranks=(1, 2), keep_estimators=True).fit(*data)
        found = [of.log_marginal_likelihood_value_ for of in search.estimators_]
        values = search.results_["log_marginal_likelihood"]
        np.testing.assert_allclose(values, found)

    def test_bad_value(self, data):
        with pytest.raises(ValueError, match=r"'keep_estimators' parameter .* must be"):
            RankSearchIC(MODEL, keep_estimators="all").fit(*data)


class TestAddTask:
    @pytest.fixture
    def new(self, data):
        """Samples of a task that the data do not have."""
        X, y = data
        return X[:5] * [1.0, 1.0, 0.0] + [0.0, 0.0, 9.0], 2.0 * y[:5]

    @pytest.mark.parametrize("prior", ["tasks", None])
    def test_is_the_best_models(self, search, data, new, prior):
        extended = search.add_task(*new, prior=prior)
        expected = search.best_estimator_.add_task(*new, prior=prior)
        assert type(extended) is RankSearchIC
        X = np.vstack([data[0], new[0]])
        np.testing.assert_array_equal(extended.predict(X), expected.predict(X))
        best = extended.best_estimator_
        assert best.tasks_.tolist() == [0, 1, 2, 3, 9]
        assert best.rank_ == extended.best_rank_ == search.best_rank_
        value = expected.log_marginal_likelihood()
        assert extended.log_marginal_likelihood() == value

    def test_the_prior_is_passed_on(self, search, new):
        X, y = new[0][:1], new[1][:1]
        informed, alone, default = (
            search.add_task(X, y, **options).best_estimator_.task_covariance_
            for options in ({"prior": "tasks"}, {"prior": None}, {})
        )
        np.testing.assert_array_equal(default, informed)
        assert not np.allclose(informed, alone)

    def test_results_are_those_of_the_search(self, search, new):
        extended = search.add_task(*new)
        pd.testing.assert_frame_equal(extended.results_, search.results_)

    def test_search_is_left_as_it_was(self, data, new):
        model = clone(STAGED).set_params(max_iter=0)
        search = RankSearchIC(model, ranks=(1, 2), keep_estimators=True).fit(*data)
        before = pickle.dumps(search)
        extended = search.add_task(*new)
        assert pickle.dumps(search) == before
        assert len(search.estimators_) == 2
        assert not hasattr(extended, "estimators_")  # of other tasks

    def test_errors(self, search, data, new):
        with pytest.raises(NotFittedError):
            RankSearchIC().add_task(*new)
        with pytest.raises(ValueError, match="Task 0 is known already"):
            search.add_task(new[0] * [1.0, 1.0, 0.0], new[1])
        with pytest.raises(ValueError, match="prior='x' must be 'tasks' or None"):
            search.add_task(*new, prior="x")


@pytest.mark.usefixtures("certain_theta")
class TestLeaveOneOut:
    @pytest.mark.parametrize(
        ("params", "complete"),
        [
            ({}, False),
            ({}, True),
            ({"inference": "sparse", "n_inducing": 12, "task_levels": True}, False),
            ({"normalize_y": "per_task", "noise": "per_task"}, False),
            ({"normalize_y": False}, False),
        ],
    )
    def test_is_that_of_the_predictions(self, data, params, complete):
        X, y = data
        if complete:
            X = np.column_stack([np.tile(X[:8, :2], (4, 1)), np.repeat(range(4), 8)])
        model = clone(MODEL).set_params(**params)
        search = RankSearchIC(
            model, ranks=(0, 1, 3), criterion="loo", keep_estimators=True
        ).fit(X, y)
        for loo, fitted in zip(search.results_["loo"], search.estimators_, strict=True):
            assert fitted.complete_ == complete
            density = norm.logpdf(y, *fitted.loo_predict(include_noise=True))
            assert loo == pytest.approx(-2.0 * density.sum(), rel=1e-9)
        assert search.results_["chosen"].argmax() == search.results_["loo"].argmin()
        assert (
            search.best_rank_
            == search.results_["rank"][search.results_["chosen"]].item()
        )

    def test_units_of_y_do_not_matter(self, data):
        X, y = data
        search = RankSearchIC(clone(STAGED).set_params(max_iter=0), criterion="loo")
        small, large = (clone(search).fit(X, of).results_["loo"] for of in (y, 8.0 * y))
        np.testing.assert_allclose(large - small, 2.0 * y.size * np.log(8.0))

    def test_only_if_asked(self, search):
        assert "loo" not in search.results_

    def test_it_prefers_the_rank_that_predicts(self):
        found = RankSearchIC(ranks=(0, 2), criterion="loo").fit(*related(2))
        assert found.best_rank_ == 2
