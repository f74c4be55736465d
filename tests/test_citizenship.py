"""What scikit-learn users do with regressors, done with those of the package."""

import contextlib
import io
import pickle
import subprocess
import sys

import joblib
import numpy as np
import pandas as pd
import pytest
import sklearn
from samples import draw
from scipy.sparse import csr_array, csr_matrix
from scipy.stats import loguniform
from sklearn.base import clone
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.ensemble import BaggingRegressor, StackingRegressor
from sklearn.exceptions import (
    ConvergenceWarning,
    NotFittedError,
    UnsetMetadataPassedError,
)
from sklearn.gaussian_process.kernels import RBF, Matern
from sklearn.inspection import partial_dependence, permutation_importance
from sklearn.model_selection import (
    GridSearchCV,
    RandomizedSearchCV,
    cross_validate,
    learning_curve,
)
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils import estimator_html_repr
from threadpoolctl import threadpool_limits

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators.estimator import DOCUMENTATION
from skmtgp._numerics.parallel import SMALL
from skmtgp.model_selection import TaskStratifiedKFold

QUICK = {"max_iter": 3}
ESTIMATORS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(**QUICK),
    "sparse": MultiTaskGPRegressor(inference="sparse", n_inducing=10, **QUICK),
    "IndependentGP": IndependentGP(**QUICK),
    "PooledGP": PooledGP(**QUICK),
    "SingleTaskGP": SingleTaskGP(**QUICK),
    "BayesianLinearRegression": BayesianLinearRegression(),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
}
GPS = {k: v for k, v in ESTIMATORS.items() if k != "BayesianLinearRegression"}

X, Y = draw(per_task=8, n_outputs=2)
BY_TASK = np.argsort(X[:, -1], kind="stable")
X, Y = X[BY_TASK], Y[BY_TASK]  # as data are recorded: task after task
y = Y[:, 0]
TASKS = X[:, -1].astype(int)
CV = TaskStratifiedKFold(2)
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def frame(labels=("u", "v", "w"), dtype=None):
    table = pd.DataFrame(X[:, :2], columns=["a", "b"])
    return table.assign(load=pd.Series(np.array(labels)[TASKS], dtype=dtype))


FRAME = frame()


def contained(container):
    """The same table in a container; an array has no place for names of tasks."""
    if container == "array":
        return X
    if container == "polars":
        return pytest.importorskip("polars").DataFrame(FRAME.to_dict("list"))
    return FRAME if container == "pandas" else FRAME.to_numpy()


def cube(values):
    return values**3


def tasks_of(model):
    """The tasks that a fitted regressor knows."""
    return getattr(model, "best_estimator_", model).tasks_.tolist()


def spreads(model, table=X):
    """Everything that is predicted of a table."""
    mean, std = model.predict(table, return_std=True)
    cov = model.predict(table, return_cov=True)[1]
    return mean, std, cov.diagonal()


def assert_same_bits(found, expected):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.fixture(params=ESTIMATORS.values(), ids=ESTIMATORS)
def estimator(request):
    return clone(request.param)


@pytest.fixture(scope="module", params=ESTIMATORS.values(), ids=ESTIMATORS)
def fitted(request):
    """Fitted to two outputs of tasks with names; not to be changed."""
    return clone(request.param).fit(FRAME, Y)


def scaled(estimator, columns=("a", "b"), **options):
    """Features are scaled; the task is passed through and ends up last."""
    scaler = ColumnTransformer([("scale", StandardScaler(), list(columns))], **options)
    return Pipeline([("features", scaler), ("model", estimator)])


class TestPipelines:
    @pytest.mark.parametrize("table", [X, FRAME], ids=["array", "frame"])
    def test_task_is_passed_through(self, estimator, table):
        columns = ["a", "b"] if table is FRAME else [0, 1]
        model = scaled(estimator, columns, remainder="passthrough").fit(table, y)
        by_hand = np.column_stack([StandardScaler().fit_transform(X[:, :2]), TASKS])
        expected = clone(estimator).fit(by_hand, y)
        np.testing.assert_allclose(model.predict(table), expected.predict(by_hand))
        labels = table["load"] if table is FRAME else TASKS
        assert tasks_of(model[-1]) == np.unique(labels).tolist()

    def test_task_that_is_dropped_is_missed(self, estimator):
        message = r"fractional numbers .* remainder='passthrough'"
        with pytest.raises(ValueError, match=message):
            scaled(estimator).fit(FRAME, y)

    @pytest.mark.parametrize("container", ["pandas", "polars"])
    def test_names_of_features(self, estimator, container):
        table = contained(container)
        options = {"remainder": "passthrough", "verbose_feature_names_out": False}
        named = "estimator__" * isinstance(estimator, RankSearchIC) + "task_feature"
        estimator.set_params(**{named: "load"})
        model = scaled(estimator, "b", **options).set_output(transform=container)
        model.fit(table[["load", "a", "b"]], y)
        names = ["b", "load", "a"]
        assert model[:-1].get_feature_names_out().tolist() == names
        assert model[-1].feature_names_in_.tolist() == names
        assert model.feature_names_in_.tolist() == ["load", "a", "b"]
        assert tasks_of(model[-1]) == ["u", "v", "w"]

    @pytest.mark.parametrize("option", ["return_std", "return_cov"])
    def test_options_of_predict(self, estimator, option):
        model = scaled(estimator, remainder="passthrough").fit(FRAME, Y)
        options = {option: True, "include_noise": True}
        found = model.predict(FRAME, **options)
        expected = model[-1].predict(model[:-1].transform(FRAME), **options)
        assert_same_bits(found, expected)

    @pytest.mark.parametrize("option", ["return_std", "return_cov"])
    def test_options_of_predict_as_routed_metadata(self, estimator, option):
        options = {option: True, "include_noise": True}
        with sklearn.config_context(enable_metadata_routing=True):
            model = scaled(estimator, remainder="passthrough").fit(FRAME, y)
            with pytest.raises(UnsetMetadataPassedError, match=option):
                model.predict(FRAME, **options)
            model[-1].set_predict_request(**dict.fromkeys(options, True))
            found = model.predict(FRAME, **options)
        expected = model[-1].predict(model[:-1].transform(FRAME), **options)
        assert_same_bits(found, expected)


def parameters(name):
    """Of an estimator, with values to choose from."""
    kernels = {"kernel": [RBF([1.0, 1.0]), Matern(2.0)]}
    return {
        "MultiTaskGPRegressor": {"rank": [1, 2], **kernels},
        "BayesianLinearRegression": {"weight_variance": [1e-4, 1e8]},
        "RankSearchIC": {
            "criterion": ["bic", "aic"],
            **{f"estimator__{key}": value for key, value in kernels.items()},
        },
    }.get(name, kernels)


class TestSearches:
    @pytest.mark.parametrize("name", ESTIMATORS)
    def test_grid_search(self, name):
        grid = parameters(name)
        search = GridSearchCV(ESTIMATORS[name], grid, cv=CV, error_score="raise")
        search.fit(FRAME, y)
        assert len(search.cv_results_["params"]) == np.prod([*map(len, grid.values())])
        for key, value in search.best_params_.items():
            assert search.best_estimator_.get_params()[key] == value
        assert search.best_score_ == search.cv_results_["mean_test_score"].max()
        assert search.predict(FRAME).shape == y.shape
        assert grid == parameters(name)  # learning leaves kernels as they were

    @pytest.mark.parametrize("name", ESTIMATORS)
    def test_grid_search_of_a_pipeline(self, name):
        grid = {f"model__{key}": value for key, value in parameters(name).items()}
        grid["features__scale"] = [StandardScaler(), "passthrough"]
        model = scaled(ESTIMATORS[name], remainder="passthrough")
        search = GridSearchCV(model, grid, cv=CV, error_score="raise").fit(FRAME, y)
        assert tasks_of(search.best_estimator_[-1]) == ["u", "v", "w"]
        assert np.isfinite(search.cv_results_["mean_test_score"]).all()

    @pytest.mark.parametrize("name", GPS)
    def test_randomized_search_in_parameters_of_the_kernel(self, name):
        nested = "model__" + "estimator__" * (name == "RankSearchIC")
        model = scaled(clone(GPS[name]), remainder="passthrough")
        model.set_params(**{f"{nested}kernel": RBF(1.0, "fixed")})
        wanted = {
            f"{nested}kernel__length_scale": loguniform(0.1, 10.0),
            f"{nested}noise_variance": loguniform(1e-4, 1.0),
        }
        search = RandomizedSearchCV(
            model, wanted, n_iter=3, cv=CV, random_state=0, error_score="raise"
        )
        search.fit(FRAME, y)
        scores = search.cv_results_["mean_test_score"]
        assert len(set(scores.tolist())) == 3
        best = search.best_estimator_.get_params()
        assert {key: best[key] for key in wanted} == search.best_params_

    def test_cross_validate(self, estimator):
        found = cross_validate(
            estimator,
            FRAME,
            Y,
            cv=CV,
            scoring=("r2", "neg_mean_squared_error"),
            return_train_score=True,
            return_estimator=True,
            error_score="raise",
        )
        (train, test), _ = CV.split(FRAME)
        first = clone(estimator).fit(FRAME.iloc[train], Y[train])
        assert found["test_r2"][0] == first.score(FRAME.iloc[test], Y[test])
        assert [tasks_of(model) for model in found["estimator"]] == [
            ["u", "v", "w"]
        ] * 2
        assert np.isfinite(found["train_neg_mean_squared_error"]).all()

    def test_learning_curve(self, estimator):
        sizes, train, test = learning_curve(
            estimator, FRAME, y, cv=CV, train_sizes=[0.5, 1.0], error_score="raise"
        )
        assert sizes.tolist() == [6, 12]
        assert np.isfinite([train, test]).all()


class TestInspection:
    # scikit-learn makes an array of what is not a frame of pandas.
    @pytest.mark.filterwarnings("ignore:X does not have valid feature names")
    @pytest.mark.parametrize("container", ["array", "object", "pandas", "polars"])
    def test_permutation_importance(self, estimator, container):
        table = contained(container)
        estimator.fit(table, y)
        found = permutation_importance(estimator, table, y, n_repeats=3, random_state=0)
        assert found.importances.shape == (3, 3)
        assert found.importances_mean[:2].max() > 0.01

    # Polars frames are beyond scikit-learn's own partial_dependence.
    @pytest.mark.parametrize("container", ["array", "object", "pandas"])
    def test_partial_dependence(self, estimator, container):
        table = contained(container)
        estimator.fit(table, y)
        feature = "b" if container == "pandas" else 1
        found = partial_dependence(
            estimator, table, [feature], grid_resolution=4, kind="both"
        )
        at = found["grid_values"][0][2]
        moved = table.assign(b=at) if container == "pandas" else table.copy()
        if container != "pandas":
            moved[:, 1] = at
        expected = estimator.predict(moved)
        np.testing.assert_allclose(found["individual"][0, :, 2], expected)
        np.testing.assert_allclose(found["average"][0, 2], expected.mean())


class TestMetaEstimators:
    @pytest.mark.parametrize("container", ["array", "object", "pandas", "polars"])
    def test_bagging(self, estimator, container):
        # Rows are drawn whatever their task, so that a bag has some tasks more often
        # than others, and misses a task of k of the n rows with probability
        # (1 - k / n)^n: no more than about exp(-k).
        table = contained(container)
        bags = BaggingRegressor(estimator, 3, random_state=0).fit(table, y)
        array = contained("array" if container == "array" else "object")
        parts = [model.predict(array) for model in bags.estimators_]
        np.testing.assert_allclose(bags.predict(table), np.mean(parts, axis=0))
        assert all(len(tasks_of(model)) == 3 for model in bags.estimators_)

    def test_bag_without_a_task(self, estimator):
        bags = BaggingRegressor(estimator, 2, max_samples=2, random_state=0).fit(X, y)
        message = r"Unknown tasks? .*: the model knows .* samples of every task"
        with pytest.raises(ValueError, match=message):
            bags.predict(X)

    def test_transformed_target(self, estimator):
        model = TransformedTargetRegressor(estimator, func=np.cbrt, inverse_func=cube)
        found = model.fit(FRAME, Y).predict(FRAME)
        expected = clone(estimator).fit(FRAME, np.cbrt(Y)).predict(FRAME) ** 3
        np.testing.assert_allclose(found, expected, rtol=1e-9)

    def test_stacking(self, estimator):
        parts = [("one", estimator), ("other", BayesianLinearRegression())]
        stack = StackingRegressor(parts, cv=CV).fit(FRAME, y)
        np.testing.assert_array_equal(
            stack.transform(FRAME)[:, 0], clone(estimator).fit(FRAME, y).predict(FRAME)
        )
        assert stack.score(FRAME, y) > 0.5

    def test_multi_output(self, estimator):
        found = MultiOutputRegressor(estimator).fit(FRAME, Y).predict(FRAME)
        expected = [clone(estimator).fit(FRAME, t).predict(FRAME) for t in Y.T]
        np.testing.assert_array_equal(found, np.transpose(expected))


class TestContainers:
    """Labels of every type, in test_inputs.py, but for what is not a model's own."""

    @pytest.mark.parametrize(
        ("labels", "dtype"),
        [
            ([0, 1, 2], None),
            (["u", "v", "w"], object),
            (["u", "v", "w"], "category"),
            ([False, True, True], None),
            ([0, 1, 2], "Int64"),
            (["u", "v", "w"], "string"),
            ([False, True, True], "boolean"),
        ],
        ids=str,
    )
    def test_labels_in_a_pipeline(self, estimator, labels, dtype):
        table = frame(labels, dtype)
        model = scaled(estimator, remainder="passthrough").fit(table, y)
        assert tasks_of(model[-1]) == sorted(set(labels))
        codes = np.unique(labels, return_inverse=True)[1][TASKS]
        array = np.column_stack([X[:, :2], codes])
        expected = scaled(clone(estimator), [0, 1], remainder="passthrough")
        expected = expected.fit(array, y).predict(array)
        np.testing.assert_allclose(model.predict(table), expected, rtol=1e-9)

    @pytest.mark.parametrize("container", ["object", "polars"])
    def test_other_tables(self, fitted, container):
        model = clone(fitted).fit(contained(container), Y)
        assert tasks_of(model) == ["u", "v", "w"]
        assert_same_bits(spreads(model, contained(container)), spreads(fitted, FRAME))

    @pytest.mark.parametrize("kind", [csr_array, csr_matrix, "frame"])
    def test_sparse_input_is_refused(self, estimator, kind):
        if kind == "frame":
            sparse = pd.DataFrame.sparse.from_spmatrix(csr_matrix(X))
        else:
            sparse = kind(X)
        message = r"Sparse data was passed for X, but dense data is required.*toarray"
        with pytest.raises(TypeError, match=message):
            estimator.fit(sparse, y)
        with pytest.raises(NotFittedError):
            estimator.predict(X)
        with pytest.raises(TypeError, match=message):
            estimator.fit(X, y).predict(sparse)


KERNELS = "sklearn.gaussian_process.kernels."
TERMS, EXPRESSIONS = "skmtgp.model._nodes.terms.", "skmtgp.model._nodes.expressions."
POSTERIOR = {
    f"{KERNELS}Hyperparameter",
    f"{KERNELS}RBF",
    f"{TERMS}BoundStationary",
    f"{TERMS}StationaryNode",
    f"{TERMS}_rbf",
    "skmtgp.model._nodes.differences.Differences",
    "skmtgp._numerics.linalg.Cholesky",
    "skmtgp.inference.dense.DenseLikelihood",
    "skmtgp.inference.dense.DensePosterior",
}
LOW_RANK = {
    *POSTERIOR,
    "skmtgp.multitask.MultiTaskGPRegressor",
    "skmtgp.model.task_covariance.LowRank",
}
FIXED = {
    *POSTERIOR,
    f"{KERNELS}ConstantKernel",
    f"{KERNELS}Product",
    f"{TERMS}BoundConstant",
    f"{EXPRESSIONS}BoundProduct",
    f"{TERMS}ConstantNode",
    f"{EXPRESSIONS}JoinedNode",
    "skmtgp.model.task_covariance.FixedTaskCovariance",
}
DENSE = {
    "skmtgp.inference.dense.DenseLikelihood",
    "skmtgp.inference.dense.DensePosterior",
}
BY_INDUCING_INPUTS = {
    "skmtgp.inference.features.Features",
    "skmtgp.inference.sparse.SparseBound",
    "skmtgp.inference.sparse_posterior.SparsePosterior",
    "skmtgp.inference.weights.Covariances",
}
# What skops must be told to trust, for each estimator with its default kernel; another
# kernel adds itself and its node in skmtgp.model._nodes.
TRUSTED = {
    "MultiTaskGPRegressor": LOW_RANK,
    "IndependentGP": {*FIXED, "skmtgp.baselines.IndependentGP"},
    "PooledGP": {*FIXED, "skmtgp.baselines.PooledGP"},
    "SingleTaskGP": {
        *FIXED,
        "skmtgp.baselines.PooledGP",
        "skmtgp.single_task.SingleTaskGP",
    },
    "BayesianLinearRegression": {
        "skmtgp.linear.BayesianLinearRegression",
        "skmtgp.inference.linear.LinearPosterior",
    },
    "RankSearchIC": {*LOW_RANK, "skmtgp.model_selection.RankSearchIC"},
}


def ours(types):
    """Those of the package: a later skops may trust scikit-learn's by itself."""
    return {name for name in types if name.startswith("skmtgp.")}


ELSEWHERE = """
import sys, joblib
models, table = joblib.load(sys.argv[1])
found = {
    name: model.predict(table, return_std=True) for name, model in models.items()
}
joblib.dump(found, sys.argv[2])
"""


class TestPersistence:
    def test_pickle(self, fitted):
        again = pickle.loads(pickle.dumps(fitted))
        assert repr(again) == repr(fitted)
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    @pytest.mark.parametrize("compress", [0, 3])
    def test_joblib(self, fitted, compress, tmp_path):
        joblib.dump(fitted, tmp_path / "model", compress=compress)
        again = joblib.load(tmp_path / "model")
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    @pytest.mark.parametrize("as_pipeline", [False, True])
    def test_skops(self, fitted, as_pipeline):
        skops = pytest.importorskip("skops.io")
        data = skops.dumps(make_pipeline(fitted) if as_pipeline else fitted)
        trusted = TRUSTED[type(fitted).__name__]
        if getattr(fitted, "inference_", None) == "sparse":
            trusted = trusted - DENSE | BY_INDUCING_INPUTS
        found = set(skops.get_untrusted_types(data=data))
        assert found <= trusted
        assert ours(found) == ours(trusted)
        again = skops.loads(data, trusted=sorted(trusted))
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    def test_another_process_predicts_the_same_bits(self, tmp_path):
        models = {k: clone(v).fit(FRAME, Y) for k, v in ESTIMATORS.items()}
        paths = tmp_path / "models", tmp_path / "found"
        joblib.dump((models, FRAME), paths[0])
        command = [sys.executable, "-W", "error", "-c", ELSEWHERE, *map(str, paths)]
        subprocess.run(command, check=True, timeout=60)
        found = joblib.load(paths[1])
        for name, model in models.items():
            assert_same_bits(found[name], model.predict(FRAME, return_std=True))


SPREAD = {  # over what n_jobs spreads the work
    "outputs": MultiTaskGPRegressor(rank=2, **QUICK),
    "restarts": MultiTaskGPRegressor(n_restarts_optimizer=2, random_state=0, **QUICK),
    "outputs and ranks": ESTIMATORS["RankSearchIC"],
    "tasks": ESTIMATORS["SingleTaskGP"],
    "outputs, independent": ESTIMATORS["IndependentGP"],
    "outputs, pooled": ESTIMATORS["PooledGP"],
}


@pytest.mark.filterwarnings("ignore:A worker stopped while some jobs were given")
class TestProcesses:
    @pytest.mark.parametrize("model", SPREAD.values(), ids=SPREAD)
    def test_same_bits_for_any_number(self, model):
        one, two = (clone(model).set_params(n_jobs=n).fit(FRAME, Y) for n in (1, 2))
        assert_same_bits(spreads(two, FRAME), spreads(one, FRAME))
        found, expected = (getattr(m, "best_estimator_", m) for m in (two, one))
        assert (
            found.log_marginal_likelihood_value_
            == expected.log_marginal_likelihood_value_
        )

    def test_same_bits_where_blas_may_have_threads(self):
        """From 600 samples on it may; other numbers of them would round differently."""
        large = pd.concat([FRAME] * -(-SMALL // len(FRAME)), ignore_index=True)
        targets = np.random.default_rng(0).normal(size=(len(large), 2))
        model = MultiTaskGPRegressor(rank=1, max_iter=2)
        with threadpool_limits(1), pytest.warns(ConvergenceWarning):
            one, two = (
                clone(model).set_params(n_jobs=n).fit(large, targets) for n in (1, 2)
            )
        assert_same_bits([one.theta_], [two.theta_])

    def test_the_context_sets_their_number(self):
        model = SPREAD["outputs"]
        expected = spreads(clone(model).fit(FRAME, Y), FRAME)
        with joblib.parallel_config("threading", n_jobs=2):
            found = spreads(clone(model).fit(FRAME, Y), FRAME)
        assert_same_bits(found, expected)

    def test_folds_side_by_side(self):
        found, expected = (
            cross_validate(SPREAD["tasks"], FRAME, y, cv=CV, n_jobs=n)["test_score"]
            for n in (2, 1)
        )
        np.testing.assert_array_equal(found, expected)


class TestInterface:
    def test_clone_of_a_fitted_model(self, fitted):
        before = pickle.dumps(fitted)
        copy = clone(fitted)
        assert repr(copy) == repr(fitted)
        with pytest.raises(NotFittedError):
            copy.predict(FRAME)
        assert_same_bits(spreads(copy.fit(FRAME, Y), FRAME), spreads(fitted, FRAME))
        assert pickle.dumps(fitted) == before

    def test_parameters(self, estimator):
        nested = "estimator__" * isinstance(estimator, RankSearchIC)
        name = f"{nested}task_feature"
        assert estimator.get_params()[name] == -1
        assert estimator.set_params(**{name: "load"}) is estimator
        assert estimator.get_params()[name] == "load"
        with pytest.raises(ValueError, match="Invalid parameter 'task' for estimator"):
            estimator.set_params(**{f"{nested}task": 0})

    def test_refit_with_other_parameters(self, estimator):
        nested = "estimator__" * isinstance(estimator, RankSearchIC)
        moved = clone(estimator).set_params(**{f"{nested}task_feature": 0})
        found = moved.fit(X[:, [2, 0, 1]], Y).predict(X[:, [2, 0, 1]])
        moved.set_params(**{f"{nested}task_feature": -1}).fit(FRAME, Y)
        assert_same_bits(spreads(moved, FRAME), spreads(estimator.fit(FRAME, Y), FRAME))
        np.testing.assert_allclose(found, moved.predict(FRAME), rtol=1e-9)

    def test_html(self, fitted):
        for model in (fitted, clone(fitted), make_pipeline(clone(fitted))):
            html = estimator_html_repr(model)
            name = type(fitted).__name__
            assert f'href="{DOCUMENTATION}/api/{name}.html"' in html

    def test_nothing_is_printed(self, estimator):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            estimator.fit(FRAME, Y).predict(FRAME)
        assert out.getvalue() == ""

    def test_other_names_of_features(self, fitted):
        renamed = FRAME.rename(columns={"b": "c"})
        with pytest.raises(ValueError, match=r"(?s)feature names should match.*- b"):
            fitted.predict(renamed)
        with pytest.raises(ValueError, match="must be in the same order"):
            fitted.predict(FRAME[["b", "a", "load"]])
        with pytest.warns(UserWarning, match="X does not have valid feature names"):
            found = fitted.predict(FRAME.to_numpy())
        np.testing.assert_array_equal(found, fitted.predict(FRAME))

    def test_names_of_an_array(self, estimator):
        assert not hasattr(estimator.fit(FRAME.to_numpy(), y), "feature_names_in_")
        with pytest.warns(UserWarning, match="X has feature names, but"):
            estimator.predict(FRAME)
        assert estimator.fit(FRAME, y).feature_names_in_.tolist() == ["a", "b", "load"]
        assert estimator.n_features_in_ == 3
