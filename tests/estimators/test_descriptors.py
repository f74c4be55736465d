"""Tasks with descriptors, by the estimators."""

import pickle

import numpy as np
import pandas as pd
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from strategies import examples

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.exceptions import DescriptorWarning
from skmtgp.inspection import KernelRelevanceDisplay, TaskCovarianceDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
M, N, NOISE = 7, 90, 0.05
AGE = np.array([0.3, 4.0, 9.1, 6.0, 2.2, 7.7, 5.1])
SIZE = np.array([1.2, 1.9, 1.0, 1.4, 1.7, 1.1, 1.5])
COLUMNS = ["x", "age", "size", "machine"]
PLAIN = {"normalize_y": "shared", "noise": "shared", "task_descriptors": [1, 2]}
QUICK = PLAIN | {"kernel": RBF(1.0), "learning": "staged", "max_iter": 20}
CASES = {
    "rank 2": {"rank": 2},
    "rank 1, shared": {"rank": 1, "shared": True, "task_levels": False},
    "rank 3, diagonal": {"rank": 3, "diagonal": True},
    "per task": {"rank": 2, "noise": "per_task"},
    "equal": {"rank": 1, "diagonal": "equal"},
}
ENGINES = {
    "dense": {},
    "kronecker": {"inference": "kronecker"},
    "sparse": {"inference": "sparse", "n_inducing": 25},
}
every_case = pytest.mark.parametrize("options", CASES.values(), ids=CASES)
each = examples(15)


def f(x, age, size):
    return (1.0 + 0.3 * age) * np.sin(x) + size * np.cos(x)


def draw(complete=False, seed=0):
    rng = np.random.default_rng(seed)
    task, x = np.arange(N) % M, rng.uniform(0.0, 6.0, N)
    if complete:
        x = np.repeat(rng.uniform(0.0, 6.0, N // M + 1), M)[:N]
        task, x = task[: N // M * M], x[: N // M * M]
    y = f(x, AGE[task], SIZE[task]) + NOISE * rng.standard_normal(len(x))
    return np.column_stack([x, AGE[task], SIZE[task], task]), y


X, y = draw()
NEW = np.array([[1.0, 5.0, 1.3, 50], [2.5, 5.0, 1.3, 50], [0.5, 8.0, 1.6, 9]])
BOTH = np.vstack([NEW, X[:3]])  # tasks that are new, and known ones


def book(model, X_new):
    """Mean and covariance of f by the plain formulae, from what the model tells."""
    K_rho = np.array(model.task_covariance_)
    table = model.task_descriptors_.to_numpy()
    labels = [*model.tasks_, *np.setdiff1d(X_new[:, -1], model.tasks_)]
    known = len(model.tasks_)
    form = model._likelihoods[0].prior.task_covariance
    rho = model._likelihoods[0].prior.values(model.theta_).rho
    # D B from the rows of the tasks that are known, by least squares
    F = form.latent(rho)[0]
    D = np.column_stack([np.ones(known), table])
    B = np.linalg.lstsq(D, F, rcond=None)[0]
    new = [X_new[X_new[:, -1] == label][0, 1:3] for label in labels[known:]]
    of_new = np.column_stack([np.ones(len(new)), new]) @ B
    all_F = np.vstack([F, of_new]) * model.y_scale_
    K = all_F @ all_F.T
    own = np.diagonal(K_rho).mean() - np.square(all_F[:known]).sum(1).mean()
    K[:known, :known] = K_rho
    unseen = np.arange(known, len(K))
    K[unseen, unseen] += max(own, 0.0)
    codes = np.searchsorted(labels[:known], model.tasks_)[model.tasks_train_]
    tasks = np.array([labels.index(label) for label in X_new[:, -1]])
    mean, cov = textbook.posterior(
        model.kernel_,
        K,
        model.noise_variance_,
        model.X_train_,
        codes,
        model.y_train_ - model.y_mean_,
        X_new[:, :1],
        tasks,
        model.level_variance_,
    )
    return mean + model.y_mean_, cov


@every_case
def test_by_the_book(options):
    model = MultiTaskGPRegressor(**QUICK | options).fit(X, y)
    mean, cov = model.predict(BOTH, return_cov=True)
    expected = book(model, BOTH)
    np.testing.assert_allclose(mean, expected[0], atol=1e-6)
    np.testing.assert_allclose(cov, expected[1], atol=1e-6)
    std = model.predict(BOTH, return_std=True)[1]
    np.testing.assert_allclose(std, np.sqrt(np.diagonal(expected[1])), atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_task_that_was_never_seen_is_predicted(engine):
    data = draw(complete=engine == "kronecker")
    model = MultiTaskGPRegressor(rank=3, **PLAIN, **ENGINES[engine]).fit(*data)
    assert model.inference_ == engine
    mean, std = model.predict(NEW, return_std=True)
    error = mean - f(NEW[:, 0], NEW[:, 1], NEW[:, 2])
    assert np.abs(error).max() < 0.15
    assert (np.abs(error) < 4.0 * std + 0.02).all()
    draws = model.sample_y(NEW, 300)
    np.testing.assert_allclose(draws.mean(axis=1), mean, atol=0.05)
    lower, upper = model.predict_interval(NEW, 0.9)
    assert ((lower < mean) & (mean < upper)).all()


def test_engines_agree():
    data = draw(complete=True)
    models = [
        MultiTaskGPRegressor(rank=2, **QUICK | {"max_iter": 0}, **engine).fit(*data)
        for engine in (*ENGINES.values(), {"inference": "dense"})
    ]
    found = [model.predict(BOTH, return_cov=True) for model in models]
    for mean, cov in found[1:]:
        np.testing.assert_allclose(mean, found[0][0], atol=1e-6)
        np.testing.assert_allclose(cov, found[0][1], atol=1e-6)


@every_case
def test_gradient(options):
    model = MultiTaskGPRegressor(**QUICK | options | {"max_iter": 3}).fit(X, y)
    theta = model.theta_ + 0.1
    found = model.log_marginal_likelihood(theta, eval_gradient=True)[1]
    expected = textbook.derivative(model.log_marginal_likelihood, theta)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-5)


def test_count_of_hyperparameters():
    model = MultiTaskGPRegressor(**QUICK | {"rank": 2, "max_iter": 0}).fit(X, y)
    assert model.n_hyperparameters_ == 1 + (3 * 2 - 1) + 1 + 1
    with_diagonal = clone(model).set_params(diagonal=True).fit(X, y)
    assert with_diagonal.n_hyperparameters_ == model.n_hyperparameters_ + M


def test_a_frame_with_names_is_the_same():
    frame = pd.DataFrame(X, columns=COLUMNS).astype({"machine": int})
    frame["machine"] = "m" + frame["machine"].astype(str)
    options = QUICK | {"rank": 2, "task_descriptors": ["age", "size"]}
    model = MultiTaskGPRegressor(**options).fit(frame[COLUMNS[::-1]].iloc[:, ::-1], y)
    other = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
    assert model.log_marginal_likelihood_value_ == pytest.approx(
        other.log_marginal_likelihood_value_
    )
    table = model.task_descriptors_
    assert table.columns.tolist() == ["age", "size"]
    assert table.loc["m3", "age"] == AGE[3]
    assert model.X_train_.shape == (N, 1)
    new = frame.iloc[:2].assign(machine="another")
    known = model.predict(frame.iloc[:2].assign(machine="m0", age=AGE[0], size=SIZE[0]))
    new = new.assign(age=AGE[0], size=SIZE[0])
    assert np.abs(model.predict(new) - known).max() < 0.2


def test_without_descriptors_an_unknown_label_is_an_error():
    model = MultiTaskGPRegressor(**QUICK | {"task_descriptors": None}).fit(X, y)
    with pytest.raises(ValueError, match=r"Unknown tasks 9, 50.*task_descriptors"):
        model.predict(NEW)
    assert not hasattr(model, "task_descriptors_")


def test_units_of_each_task_are_not_known_of_another():
    options = QUICK | {"normalize_y": "per_task"}
    model = MultiTaskGPRegressor(rank=1, **options).fit(X, y)
    with pytest.raises(ValueError, match="normalize_y_ must be 'shared'"):
        model.predict(NEW)
    large = y * np.exp(X[:, 3])  # "auto" would give each task its own
    options = PLAIN | {"normalize_y": "auto", "max_iter": 1, "rank": 1}
    assert MultiTaskGPRegressor(**options).fit(X, large).normalize_y_ == "shared"


def test_refused_columns():
    varies = X.copy()
    varies[3, 1] += 1.0
    model = MultiTaskGPRegressor(**QUICK)
    with pytest.raises(ValueError, match=r"descriptor 1 varies within task 3: .*6\.0"):
        model.fit(varies, y)
    for bad in (np.nan, np.inf):
        broken = X.copy()
        broken[3, 1] = bad
        with pytest.raises(ValueError, match=r"X contains|Input X"):
            model.fit(broken, y)
    model.fit(X, y)
    with pytest.raises(ValueError, match=r"descriptor 1 of task 0 is 1\.0, but was 0"):
        model.predict([[1.0, 1.0, SIZE[0], 0]])
    with pytest.raises(ValueError, match="varies within task 50"):
        model.predict([[1.0, 1.0, 1.0, 50], [1.0, 2.0, 1.0, 50]])
    for columns, match in [([3], "has the task column"), (["age"], "no column names")]:
        with pytest.raises(ValueError, match=match):
            MultiTaskGPRegressor(task_descriptors=columns).fit(X, y)
    with pytest.raises(ValueError, match="The 'task_descriptors' parameter"):
        MultiTaskGPRegressor(task_descriptors="age").fit(X, y)
    with pytest.raises(ValueError, match=r"rank=4 is above 1 . the number of descr"):
        MultiTaskGPRegressor(**QUICK, rank=4).fit(X, y)


def test_dask_is_refused():
    da = pytest.importorskip("dask.array")
    model = MultiTaskGPRegressor(**QUICK, inference="sparse")
    with pytest.raises(ValueError, match="task_descriptors needs the rows in memory"):
        model.fit(da.from_array(X, chunks=(30, 4)), da.from_array(y, chunks=30))


def test_descriptors_that_cannot_be_told_apart():
    few = X[:, 3] < 2
    with pytest.warns(DescriptorWarning, match="The 2 tasks do not tell"):
        model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X[few], y[few])
    assert np.isfinite(model.predict(NEW)).all()


@pytest.mark.parametrize("place", [-1, 3, 99])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_task_joins_without_anything_to_learn(engine, place):
    data = draw(complete=engine == "kronecker")
    options = QUICK | ENGINES[engine] | {"rank": 2, "task_levels": False}
    task = data[0][:, -1].astype(int)
    labels = np.arange(M) + (np.arange(M) >= place)
    table = np.column_stack([data[0][:, :3], labels[task]])
    model = MultiTaskGPRegressor(**options).fit(table, data[1])
    new = np.array([[1.0, 5.0, 1.3, place], [2.5, 5.0, 1.3, place]])
    y_new = f(new[:, 0], new[:, 1], new[:, 2])
    joined = model.add_task(new, y_new)
    np.testing.assert_array_equal(joined.theta_, model.theta_)
    assert joined.task_descriptors_.loc[place].tolist() == [5.0, 1.3]
    all_X, all_y = np.vstack([table, new]), np.append(data[1], y_new)
    expected = book(joined, NEW)
    assert joined.log_marginal_likelihood_value_ != pytest.approx(
        model.log_marginal_likelihood_value_
    )
    assert len(joined.X_train_) == len(all_X) == len(all_y)
    if engine != "sparse":  # whose inducing inputs are few
        mean, cov = joined.predict(NEW, return_cov=True)
        np.testing.assert_allclose(mean, expected[0], atol=1e-6)
        np.testing.assert_allclose(cov, expected[1], atol=1e-6)
    assert np.abs(joined.predict(new) - y_new).max() < 0.1


@pytest.mark.parametrize("engine", ENGINES)
def test_rows_that_join(engine):
    """Rows of known tasks, and of one that is new, in one call."""
    data = draw(complete=engine == "kronecker")
    options = QUICK | ENGINES[engine] | {"rank": 2, "task_levels": False}
    model = MultiTaskGPRegressor(**options).fit(*data)
    few = np.vstack([data[0][:2], [[1.0, 5.0, 1.3, 99]]])
    few[:2, 0] += 0.05
    more = f(few[:, 0], few[:, 1], few[:, 2])
    if engine == "kronecker":  # complete data no more
        model.set_params(inference="auto")
    joined = model.partial_fit(few, more)
    assert joined.X_train_.shape == (len(data[0]) + 3, 1)
    assert joined.task_descriptors_.loc[99].tolist() == [5.0, 1.3]
    expected = book(joined, NEW)
    mean, cov = joined.predict(NEW, return_cov=True)
    if engine != "sparse":  # whose inducing inputs are few
        np.testing.assert_allclose(mean, expected[0], atol=1e-6)
        np.testing.assert_allclose(cov, expected[1], atol=1e-6)
    assert np.abs(joined.predict(few) - more).max() < 0.1
    with pytest.raises(ValueError, match=r"descriptor 1 of task 0 is 1\.0, but was 0"):
        joined.partial_fit([[1.0, 1.0, SIZE[0], 0]], [0.0])


def test_a_task_that_joins_gets_the_mean_of_the_diagonal():
    options = QUICK | {"rank": 1, "diagonal": True, "task_levels": False}
    model = MultiTaskGPRegressor(**options).fit(X, y)
    new, y_new = NEW[:2], f(NEW[:2, 0], NEW[:2, 1], NEW[:2, 2])
    joined = model.add_task(new, y_new)
    kappa = [
        np.diagonal(of.task_covariance_ - of.task_factor_ @ of.task_factor_.T)
        for of in (model, joined)
    ]
    np.testing.assert_allclose(kappa[1][-1], kappa[0].mean(), rtol=1e-6)


def test_a_task_that_joins_needs_its_descriptors_constant():
    model = MultiTaskGPRegressor(rank=1, **QUICK).fit(X, y)
    with pytest.raises(ValueError, match="varies within task 50"):
        model.add_task([[1.0, 1.0, 1.0, 50], [2.0, 2.0, 1.0, 50]], [0.0, 0.0])


@pytest.mark.parametrize("hyperparameters", ["map", "sampled"])
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_hyperparameters(hyperparameters):
    options = PLAIN | {"rank": 2, "hyperparameters": hyperparameters, "n_draws": 8}
    model = MultiTaskGPRegressor(**options).fit(X, y)
    assert model.hyperparameters_ == hyperparameters
    mean, std = model.predict(NEW, return_std=True)
    assert np.abs(mean - f(NEW[:, 0], NEW[:, 1], NEW[:, 2])).max() < 0.4
    new, y_new = NEW[:2], f(NEW[:2, 0], NEW[:2, 1], NEW[:2, 2])
    joined = model.add_task(new, y_new)
    assert (joined.predict(new, return_std=True)[1] < std[:2]).all()


def test_rank_search_compares_ranks_up_to_one_more_than_descriptors():
    search = RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2, 3, 9))
    results = search.fit(X, y).results_
    assert results["rank"].tolist() == [1, 2, 3]
    assert (np.diff(results["log_marginal_likelihood"]) > -1e-6).all()
    d = results["n_hyperparameters"]
    assert np.diff(d).tolist() == [2, 1]  # 3 r - r (r - 1) / 2
    assert np.isfinite(search.predict(NEW)).all()


def test_rank_search_by_default_compares_models_that_can_predict_new_tasks():
    search = RankSearchIC(MultiTaskGPRegressor(**QUICK | {"max_iter": 5})).fit(X, y)
    assert "single tasks" not in search.results_["model"].tolist()
    assert search.best_rank_ >= 2
    assert np.isfinite(search.predict(NEW)).all()


def test_cross_validation_by_group_needs_no_samples_of_each_task():
    model = MultiTaskGPRegressor(rank=3, learning="staged", **PLAIN)
    groups = X[:, -1]
    scores = cross_val_score(model, X, y, cv=GroupKFold(3), groups=groups)
    assert scores.min() > 0.9
    grid = GridSearchCV(model, {"rank": [1, 3]}, cv=GroupKFold(2))
    assert grid.fit(X, y, groups=groups).best_params_ == {"rank": 3}


def test_pipelines_and_persistence():
    pipeline = make_pipeline(
        FunctionTransformer(), MultiTaskGPRegressor(rank=2, **QUICK)
    ).fit(X, y)
    again = pickle.loads(pickle.dumps(pipeline))
    np.testing.assert_array_equal(again.predict(NEW), pipeline.predict(NEW))
    assert clone(pipeline[-1]).task_descriptors == [1, 2]


def test_skops(tmp_path):
    io = pytest.importorskip("skops.io")
    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
    file = tmp_path / "model.skops"
    io.dump(model, file)
    types = set(io.get_untrusted_types(file=file))
    expected = {
        "skmtgp.model.described.Described",
        "skmtgp._data.descriptors.Descriptors",
    }
    assert {of for of in types if "descri" in of} == expected
    again = io.load(file, trusted=sorted(types))
    np.testing.assert_array_equal(again.predict(NEW), model.predict(NEW))


def test_refit_without_forgets_them():
    model = MultiTaskGPRegressor(rank=1, **QUICK).fit(X, y)
    model.set_params(task_descriptors=None).fit(X, y)
    assert not hasattr(model, "task_descriptors_")
    assert model.X_train_.shape == (N, 3)


def test_several_outputs_summary_and_pictures():
    Y = np.column_stack([y, np.cos(y)])
    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, Y)
    assert model.predict(NEW).shape == (3, 2)
    assert model.summary().shape[0] == 2 * M
    assert model.task_correlation_.shape == (2 * M, M)
    assert model.loo_predict()[0].shape == Y.shape
    pytest.importorskip("matplotlib")
    TaskCovarianceDisplay.from_estimator(model, output=1)
    relevance = KernelRelevanceDisplay.from_estimator(model, output=0)
    assert relevance.feature_names == ["x0"]


def likelihood(table, labels=None, y=y):
    order = np.arange(M) if labels is None else labels
    X_new = np.column_stack(
        [X[:, 0], table[X[:, 3].astype(int)], order[X[:, 3].astype(int)]]
    )
    p = table.shape[1]
    options = QUICK | {"rank": 2, "task_descriptors": list(range(1, 1 + p))}
    model = MultiTaskGPRegressor(**options | {"max_iter": 0}).fit(X_new, y)
    found = model.log_marginal_likelihood_value_
    return found, model.predict(X_new)


TABLE = np.column_stack([AGE, SIZE])


@given(
    st.permutations([0, 1]),
    st.lists(st.floats(0.1, 10.0), min_size=2, max_size=2),
    st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=2),
    st.sampled_from([-1.0, 1.0]),
)
@each
def test_order_and_units_of_descriptors_make_no_difference(order, a, b, sign):
    expected = likelihood(TABLE)
    found = likelihood((sign * np.array(a) * TABLE + b)[:, list(order)])
    assert found[0] == pytest.approx(expected[0], abs=1e-6)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-6)


@given(st.permutations(range(M)))
@each
def test_labels_of_tasks_make_no_difference(order):
    expected, found = likelihood(TABLE), likelihood(TABLE, np.array(order))
    assert found[0] == pytest.approx(expected[0], abs=1e-6)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-6)
