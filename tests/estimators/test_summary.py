"""Tables of what was learned of each task."""

import numpy as np
import pandas as pd
import pytest
from multitask_models import PAPER
from pandas.testing import assert_frame_equal
from samples import draw
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.metrics import normalized_mean_squared_error

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
NAMES = np.array(["v", "u", "w"])
COLUMNS = [
    "rows",
    "level",
    "level_std",
    "noise_std",
    "explained",
    "closest",
    "correlation",
]
MODELS = {
    "low rank": MultiTaskGPRegressor(rank=2, max_iter=3),
    "own noise": MultiTaskGPRegressor(rank=2, noise="per_task", max_iter=3),
    "own units": MultiTaskGPRegressor(rank=2, normalize_y="per_task", max_iter=3),
    "the paper's": MultiTaskGPRegressor(**PAPER, rank=2, max_iter=3),
    "independent": IndependentGP(max_iter=3),
    "pooled": PooledGP(max_iter=3),
    "sparse": MultiTaskGPRegressor(
        rank=1, inference="sparse", n_inducing=10, max_iter=3
    ),
}


def named(n_outputs=None):
    """Unequal tasks with names, which are not in the order of their sizes."""
    X, y = draw(n_outputs=n_outputs)
    keep = np.r_[2 : len(X)]
    frame = pd.DataFrame(X[keep, :2], columns=["a", "b"])
    return frame.assign(task=NAMES[X[keep, 2].astype(int)]), y[keep]


@pytest.fixture(scope="module", params=[None, 2], ids=["one output", "two outputs"])
def data(request):
    return named(request.param)


@pytest.fixture(scope="module", params=MODELS)
def model(request, data):
    X, y = data
    return clone(MODELS[request.param]).set_params(task_feature="task").fit(X, y)


def of_outputs(frame, model):
    """The part of each output, and the position of that."""
    if not isinstance(frame.index, pd.MultiIndex):
        return [(0, frame)]
    assert frame.index.names == ["output", "task"]
    return [(j, frame.loc[j]) for j in range(len(model.log_marginal_likelihoods_))]


def part(values, j, data):
    return np.asarray(values)[j] if data[1].ndim > 1 else values


def test_attributes_are_in_it(model, data):
    X, y = data
    summary = model.summary()
    assert isinstance(summary.index, pd.MultiIndex) == (y.ndim > 1)
    assert summary.columns.tolist() == COLUMNS
    for j, table in of_outputs(summary, model):
        assert table.index.tolist() == ["u", "v", "w"]
        assert table.index.name == "task"
        counts = X["task"].value_counts()
        assert table["rows"].tolist() == [counts[name] for name in "uvw"]
        np.testing.assert_array_equal(table["level"], part(model.task_level_, j, data))
        std = part(model.task_level_std_, j, data)
        np.testing.assert_array_equal(table["level_std"], std)
        noise = np.broadcast_to(part(model.noise_variance_, j, data), 3)
        np.testing.assert_allclose(table["noise_std"] ** 2, noise)


def test_explained_is_by_leaving_one_out(model, data):
    X, y = data
    mean, _ = model.loo_predict()
    for j, table in of_outputs(model.summary(), model):
        truth, found = y.reshape(len(y), -1)[:, j], mean.reshape(len(y), -1)[:, j]
        expected = [
            1.0 - normalized_mean_squared_error(truth[rows], found[rows])
            for rows in (X["task"] == name for name in "uvw")
        ]
        np.testing.assert_allclose(table["explained"], expected)


def test_correlations_are_those_of_the_task_covariance(model, data):
    found = model.task_correlation_
    for j, R in of_outputs(found, model):
        K = part(model.task_covariance_, j, data)
        scale = np.sqrt(np.diag(K))
        np.testing.assert_allclose(R, K / np.outer(scale, scale), atol=1e-12)
        assert R.index.tolist() == R.columns.tolist() == ["u", "v", "w"]
        assert R.index.name == R.columns.name == "task"
        assert (np.diag(R) == 1.0).all()


def test_closest_task(model):
    summaries = of_outputs(model.summary(), model)
    relations = of_outputs(model.task_correlation_, model)
    for (_, table), (_, R) in zip(summaries, relations, strict=True):
        for name, row in table.iterrows():
            others = R.loc[name].drop(name)
            assert row["correlation"] == pytest.approx(
                others[row["closest"]] if row["closest"] else 0.0
            )
            assert abs(row["correlation"]) == pytest.approx(others.abs().max())
            assert (row["closest"] is None) == (others == 0.0).all()


def test_closest_tasks_of_fixed_forms():
    X, y = named()
    options = {"task_feature": "task", "max_iter": 0}
    alone = IndependentGP(**options).fit(X, y).summary()
    assert alone["closest"].tolist() == [None] * 3
    assert (alone["correlation"] == 0.0).all()
    together = PooledGP(**options).fit(X, y).summary()
    assert together["closest"].tolist() == ["v", "u", "u"]
    assert (together["correlation"] == 1.0).all()


def test_tasks_that_are_learned_alone(data):
    X, y = data
    model = SingleTaskGP(task_feature="task", max_iter=3).fit(X, y)
    assert model.summary().columns.tolist() == COLUMNS
    mean, _ = model.loo_predict()
    for j, table in of_outputs(model.summary(), model):
        assert table.index.tolist() == ["u", "v", "w"]
        assert table.index.name == "task"
        truth, found = y.reshape(len(y), -1)[:, j], mean.reshape(len(y), -1)[:, j]
        for name, alone in zip("uvw", model.estimators_, strict=True):
            row, rows = table.loc[name], X["task"] == name
            assert row["rows"] == rows.sum()
            assert row["level"] == pytest.approx(truth[rows].mean())
            noise = np.ravel(alone.noise_variance_)[j]
            assert row["noise_std"] == pytest.approx(np.sqrt(noise))
            nmse = normalized_mean_squared_error(truth[rows], found[rows])
            assert row["explained"] == pytest.approx(1.0 - nmse)
            assert (row["closest"], row["correlation"]) == (None, 0.0)
    with pytest.raises(NotFittedError):
        SingleTaskGP().summary()


def test_one_task():
    X, y = draw(n_tasks=1)
    summary = MultiTaskGPRegressor(max_iter=0).fit(X, y).summary()
    assert summary[["rows", "closest", "correlation"]].values.tolist() == [
        [10, None, 0.0]
    ]


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
def test_targets_that_do_not_vary():
    X, y = draw()
    y = np.where(X[:, -1] == 1, 3.0, y)
    summary = MultiTaskGPRegressor(rank=1, max_iter=3).fit(X, y).summary()
    assert summary["explained"].isna().tolist() == [False, True, False]


def test_a_task_that_joined():
    X, y = draw()
    model = MultiTaskGPRegressor(rank=1, max_iter=3).fit(X, y)
    extended = model.add_task(X[:4] * [1, 1, 0] - [0, 0, 1], 2.0 * y[:4])
    assert extended.summary()["rows"].to_dict() == {-1: 4, 0: 10, 1: 10, 2: 10}
    assert extended.task_correlation_.shape == (4, 4)
    assert model.summary()["rows"].tolist() == [10, 10, 10]


def test_search_has_that_of_the_best_model():
    X, y = draw()
    search = RankSearchIC(MultiTaskGPRegressor(max_iter=0), ranks=(1, 2)).fit(X, y)
    assert_frame_equal(search.summary(), search.best_estimator_.summary())


@pytest.mark.parametrize("kernel", [None, ["rbf", "linear"]])
def test_dask_rows(kernel):
    da = pytest.importorskip("dask.array")
    X, y = draw()
    model = MultiTaskGPRegressor(kernel, rank=1, inference="sparse", max_iter=0)
    found = clone(model).fit(da.from_array(X, chunks=9), da.from_array(y, chunks=9))
    here, expected = found.summary(), model.fit(X, y).summary()
    assert here["explained"].isna().all()
    assert_frame_equal(*(of.drop(columns="explained") for of in (here, expected)))


@pytest.mark.parametrize("model", [MultiTaskGPRegressor(), RankSearchIC(), PooledGP()])
def test_not_fitted(model):
    with pytest.raises(NotFittedError):
        model.summary()
    assert not hasattr(model, "task_correlation_")


def test_models_of_tasks_alone_have_no_relations():
    assert not hasattr(SingleTaskGP, "task_correlation_")
