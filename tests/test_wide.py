"""Tables with a column for each task: stacked, unstacked, learned and predicted."""

import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.ensemble import RandomForestRegressor
from sklearn.exceptions import NotFittedError
from sklearn.metrics import r2_score
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OneHotEncoder, StandardScaler

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    WideRegressor,
    metrics,
    stack_tasks,
    unstack_tasks,
)
from skmtgp.metrics import (
    make_coverage_scorer,
    make_normalized_mse_scorer,
    make_standardized_log_loss_scorer,
)
from skmtgp.preprocessing import InverseDynamicsFeatures

RNG = np.random.default_rng(0)
X = RNG.uniform(0.0, 6.0, (12, 2))
Y = np.sin(X[:, :1]) * [1.0, 2.0, -1.0] + 0.1 * RNG.standard_normal((12, 3))
GAPS = Y.copy()
GAPS[[0, 3, 4], [0, 0, 2]] = np.nan
NEW = RNG.uniform(0.0, 6.0, (4, 2))
FRAME = pd.DataFrame(X, columns=["a", "b"], index=[f"row{i}" for i in range(12)])
WIDE = pd.DataFrame(GAPS, columns=["zinc", "lead", "tin"], index=FRAME.index)
TABLE = FRAME.join(WIDE)
QUICK = MultiTaskGPRegressor(rank=1, learning="staged")


def stacked(x, codes):
    return np.column_stack([np.tile(x, (len(codes), 1)), np.repeat(codes, len(x))])


@pytest.fixture(scope="module")
def fitted():
    return WideRegressor(QUICK).fit(X, GAPS)


# stack_tasks and unstack_tasks


def test_one_task_comes_after_another():
    long, y = stack_tasks(TABLE, ["zinc", "lead", "tin"])
    assert long.columns.tolist() == ["a", "b", "task"]
    assert long["task"].tolist() == ["zinc"] * 10 + ["lead"] * 12 + ["tin"] * 11
    assert y.index.equals(long.index)
    row = y[long["task"] == "tin"]["row5"]
    assert row == GAPS[5, 2]
    assert long.loc["row5", "a"].unique().tolist() == [X[5, 0]]


def test_there_and_back():
    long, y = stack_tasks(TABLE, ["zinc", "lead", "tin"])
    back = unstack_tasks(long, y)
    pd.testing.assert_frame_equal(back.loc[WIDE.index], WIDE)


@given(
    st.lists(
        st.lists(st.sampled_from([np.nan, 0.0, 1.5, -2.0]), min_size=2, max_size=2),
        min_size=1,
        max_size=6,
    )
)
def test_there_and_back_with_any_gaps(rows):
    table = pd.DataFrame(rows, columns=["u", "v"]).assign(x=np.arange(len(rows)))
    if table[["u", "v"]].isna().all().any():
        with pytest.raises(ValueError, match="has no value"):
            stack_tasks(table, ["u", "v"])
        return
    long, y = stack_tasks(table, ["u", "v"])
    seen = table[["u", "v"]].dropna(how="all")
    pd.testing.assert_frame_equal(
        unstack_tasks(long, y).reindex(seen.index), seen, check_dtype=False
    )


def test_another_name_and_numbers_as_names():
    table = pd.DataFrame({"task": [1.0, 2.0], 7: [3, 4], 8: [None, 5]})
    long, y = stack_tasks(table, [7, 8], task="output")
    assert long["output"].tolist() == [7, 7, 8]
    assert y.tolist() == [3.0, 4.0, 5.0]
    wide = unstack_tasks(long, y, task_feature="output")
    assert wide.columns.tolist() == [7, 8]


def test_frames_of_polars():
    polars = pytest.importorskip("polars")
    long, y = stack_tasks(polars.DataFrame(TABLE.to_dict("list")), ["zinc", "lead"])
    expected, expected_y = stack_tasks(
        TABLE.drop(columns="tin").reset_index(drop=True), ["zinc", "lead"]
    )
    pd.testing.assert_frame_equal(long.drop(columns="tin"), expected)
    np.testing.assert_array_equal(y, expected_y)


@pytest.mark.parametrize(
    ("table", "columns", "error", "match"),
    [
        (X, ["a"], TypeError, "must be a DataFrame with named columns, not ndarray"),
        (TABLE, "zinc", TypeError, "columns='zinc' must be a sequence of names"),
        (TABLE, ["iron"], ValueError, "has 'iron', which is not a column"),
        (TABLE, ["tin", "tin"], ValueError, "has 'tin' twice"),
        (TABLE, [], ValueError, "must name one column or more"),
        (TABLE, list(TABLE), ValueError, "leave one or more as features"),
        (TABLE.assign(task=1), ["tin"], ValueError, "already has a column 'task'"),
        (TABLE.assign(tin=np.nan), ["tin"], ValueError, "'tin' of frame has no value"),
        (
            TABLE.assign(tin=np.inf),
            ["tin"],
            ValueError,
            "infinity in column 'tin'",
        ),
        (TABLE.assign(tin="much"), ["tin"], ValueError, "'tin'.*'much'"),
    ],
)
def test_tables_that_cannot_be_stacked(table, columns, error, match):
    with pytest.raises(error, match=match):
        stack_tasks(table, columns)


LONG, LONG_Y = stack_tasks(TABLE, ["zinc", "lead"])


@pytest.mark.parametrize(
    ("table", "values", "column", "error", "match"),
    [
        (X, LONG_Y, "task", TypeError, "must be a DataFrame, not ndarray"),
        (LONG, LONG_Y, "site", ValueError, "task_feature='site' is not a column"),
        (LONG, LONG_Y[:3], "task", ValueError, r"shape \(22,\).*not \(3,\)"),
        (
            LONG.reset_index(drop=True).set_axis([0] * 22),
            LONG_Y,
            "task",
            ValueError,
            "Task 'zinc' has several rows with the index 0",
        ),
    ],
)
def test_rows_that_cannot_be_unstacked(table, values, column, error, match):
    with pytest.raises(error, match=match):
        unstack_tasks(table, values, task_feature=column)


# WideRegressor


def test_it_is_the_model_of_the_stacked_rows(fitted):
    long, y = stack_tasks(TABLE, ["zinc", "lead", "tin"])
    codes = pd.Categorical(long["task"], ["zinc", "lead", "tin"]).codes
    model = clone(QUICK).fit(np.column_stack([long[["a", "b"]], codes]), y)
    mean, std = model.predict(stacked(NEW, [0, 1, 2]), return_std=True)
    found = fitted.predict(NEW, return_std=True)
    for of, expected in zip(found, (mean, std), strict=True):
        np.testing.assert_array_equal(of, expected.reshape(3, 4).T)


def test_frames_have_names(fitted):
    model = WideRegressor(QUICK).fit(FRAME, WIDE)
    assert model.outputs_.tolist() == ["zinc", "lead", "tin"]
    assert model.estimator_.tasks_.tolist() == ["lead", "tin", "zinc"]
    assert model.feature_names_in_.tolist() == ["a", "b"]
    table = pd.DataFrame(NEW, columns=["a", "b"])
    np.testing.assert_allclose(model.predict(table), fitted.predict(NEW), rtol=1e-6)
    assert WideRegressor(QUICK).fit(X, WIDE).outputs_.tolist() == list(WIDE)


def test_the_task_column_has_the_name_that_the_model_asks_for():
    named = clone(QUICK).set_params(task_feature="metal")
    model = WideRegressor(named, task="metal").fit(FRAME, WIDE)
    assert model.estimator_.feature_names_in_.tolist() == ["a", "b", "metal"]


def test_complete_data_take_the_fast_way():
    assert WideRegressor(QUICK).fit(X, Y).estimator_.inference_ == "kronecker"
    few = np.where(np.arange(Y.size).reshape(Y.shape) % 20, Y, np.nan)
    assert WideRegressor(QUICK).fit(X, few).estimator_.inference_ == "kronecker"
    many = np.where(np.arange(Y.size).reshape(Y.shape) % 7, Y, np.nan)
    assert WideRegressor(QUICK).fit(X, many).estimator_.inference_ == "dense"


def test_intervals_draws_and_noise(fitted):
    lower, upper = fitted.predict_interval(NEW, level=0.5)
    mean, std = fitted.predict(NEW, return_std=True, include_noise=True)
    np.testing.assert_allclose(upper - lower, 2 * 0.6744897501960817 * std)
    np.testing.assert_allclose((upper + lower) / 2, mean)
    draws = fitted.sample_y(NEW, 2000, random_state=0)
    assert draws.shape == (4, 3, 2000)
    np.testing.assert_allclose(draws.mean(axis=2), fitted.predict(NEW), atol=0.1)


def test_leaving_one_out(fitted):
    mean, std = fitted.loo_predict(include_noise=True)
    assert mean.shape == std.shape == GAPS.shape
    np.testing.assert_array_equal(np.isnan(mean), np.isnan(GAPS))
    model, gaps = fitted.estimator_, np.isnan(GAPS)
    alone = model.loo_predict(include_noise=True)
    for found, expected in zip((mean, std), alone, strict=True):
        np.testing.assert_array_equal(found.T[~gaps.T], expected)
    single = WideRegressor(QUICK).fit(X, Y[:, 0])
    assert single.loo_predict()[1].shape == (12,)
    piped = WideRegressor(make_pipeline(clone(QUICK))).fit(X, GAPS)
    np.testing.assert_allclose(piped.loo_predict(include_noise=True)[0], mean)


def test_leaving_one_out_of_other_models():
    with pytest.raises(NotFittedError):
        WideRegressor().loo_predict()
    forest = WideRegressor(RandomForestRegressor(3, random_state=0)).fit(X, GAPS)
    with pytest.raises(TypeError, match=r"Forest.* has no loo_predict: set `est"):
        forest.loo_predict()


def test_score_leaves_gaps_out(fitted):
    mean = fitted.predict(X)
    expected = [
        r2_score(true[~np.isnan(true)], found[~np.isnan(true)])
        for true, found in zip(GAPS.T, mean.T, strict=True)
    ]
    assert fitted.score(X, GAPS) == pytest.approx(np.mean(expected))
    weight = np.r_[np.ones(6), np.zeros(6)]
    half = fitted.score(X[:6], GAPS[:6])
    assert fitted.score(X, GAPS, sample_weight=weight) == pytest.approx(half)


def test_columns_without_a_value_are_left_out_of_the_score(fitted):
    """As there are in a fold of the rows."""
    empty = GAPS.copy()
    empty[:, 1] = np.nan
    mean, seen = fitted.predict(X), ~np.isnan(GAPS)
    parts = [
        r2_score(
            GAPS[seen[:, j], j], mean[seen[:, j], j], sample_weight=X[seen[:, j], 0]
        )
        for j in (0, 2)
    ]
    score = fitted.score(X, empty, sample_weight=X[:, 0])
    assert score == pytest.approx(np.mean(parts), rel=1e-12)
    with pytest.raises(ValueError, match="No column of y has two values"):
        fitted.score(X, np.full(Y.shape, np.nan))


def test_scores_are_of_the_columns_of_fit(fitted):
    named = WideRegressor(QUICK).fit(FRAME, WIDE)
    assert named.score(FRAME, GAPS) == named.score(FRAME, WIDE)
    assert fitted.score(X, WIDE) == fitted.score(X, GAPS)  # without names in fit
    for other in (WIDE[["lead", "zinc", "tin"]], WIDE.add_suffix("_ppm")):
        with pytest.raises(
            ValueError, match=r"fitted to \['zinc', 'lead', 'tin'\]. Giv"
        ):
            named.score(FRAME, other)
    with pytest.raises(ValueError, match=r"y has 2 columns, .* was fitted to 3"):
        fitted.score(X, GAPS[:, :2])


def test_one_output_is_one_dimensional():
    model = WideRegressor(QUICK).fit(X, Y[:, 0])
    mean, std = model.predict(NEW, return_std=True)
    assert mean.shape == std.shape == (4,)
    assert model.sample_y(NEW, 5).shape == (4, 5)
    assert np.isfinite(model.score(X, Y[:, 0]))
    assert WideRegressor(QUICK).fit(X, Y[:, :1]).predict(NEW).shape == (4, 1)


def test_other_models_searches_and_grids():
    for model in (IndependentGP(), RankSearchIC(QUICK, ranks=(1, 2))):
        assert WideRegressor(model).fit(X, GAPS).predict(NEW).shape == (4, 3)
    forest = WideRegressor(RandomForestRegressor(3, random_state=0)).fit(X, GAPS)
    assert forest.predict(NEW).shape == (4, 3)
    grid = {"estimator__rank": [1, 2]}
    search = GridSearchCV(WideRegressor(QUICK), grid, cv=3).fit(X, Y)
    assert np.isfinite(search.best_score_)


def test_pipelines():
    states = RNG.uniform(-1.0, 1.0, (20, 6))
    torques = np.column_stack([np.sin(states[:, 0]), states[:, 2] + states[:, 4]])
    model = make_pipeline(InverseDynamicsFeatures(n_joints=2), clone(QUICK))
    wide = WideRegressor(model).fit(states, torques)
    assert wide.predict(states[:3]).shape == (3, 2)


def test_pickles(fitted):
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.predict(NEW), fitted.predict(NEW))


@pytest.mark.parametrize(
    ("x", "y", "match"),
    [
        (X, np.where([True, True, False], Y, np.nan), "Column 2 of y has no value"),
        (X, np.where(np.eye(12, 3), np.inf, Y), "inf"),
        (FRAME.assign(task=1), WIDE, "X already has a column 'task'"),
        (X[:5], Y, "inconsistent numbers of samples"),
        (X, Y[:, :, None], "y has 3 dimensions: give a column for each task"),
        (X, Y[:, :0], "y has no columns"),
        (X, WIDE.set_axis(["a", "b", "a"], axis=1), "y has the column 'a' twice"),
        (
            FRAME,
            WIDE.set_axis(pd.date_range("2020", periods=3), axis=1),
            r"The columns of y, .* cannot name the tasks. Name all of them by strings",
        ),
        (
            FRAME,
            WIDE.set_axis([["a", "a", "b"], [1, 2, 1]], axis=1),
            "cannot name the tasks. .* not tuple",
        ),
        (FRAME, WIDE.set_axis(["a", 1, 2.5], axis=1), "cannot name the tasks. .* mix"),
    ],
)
def test_what_cannot_be_fitted(x, y, match, fitted):
    before = dict(vars(fitted))
    with pytest.raises(ValueError, match=match):
        fitted.fit(x, y)
    assert vars(fitted) == before


def test_before_fit():
    with pytest.raises(NotFittedError):
        WideRegressor().predict(NEW)
    with pytest.raises(ValueError, match="estimator"):
        WideRegressor(estimator=3).fit(X, Y)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(3)))
def test_the_order_of_the_columns_does_not_matter(order):
    kept = MultiTaskGPRegressor(rank=1, max_iter=0, random_state=0)
    whole = WideRegressor(kept).fit(X, GAPS)
    other = WideRegressor(kept).fit(X, GAPS[:, order])
    np.testing.assert_allclose(other.predict(NEW), whole.predict(NEW)[:, order])


def test_text_is_encoded_before_it():
    table = FRAME.assign(site=["A", "B"] * 6)
    for of_X, name in (table, "'site'"), (table.to_numpy(), "2"):
        match = rf"column {name} holds .*'A'\. Encode it, .* task_feature={name}"
        with pytest.raises(ValueError, match=match):
            WideRegressor(QUICK).fit(of_X, WIDE.to_numpy())
    encoder = make_column_transformer(
        (OneHotEncoder(), ["site"]), remainder="passthrough", sparse_threshold=0
    )
    for model in (
        make_pipeline(encoder, WideRegressor(QUICK)),
        WideRegressor(make_pipeline(encoder, QUICK)),
    ):
        assert model.fit(table, WIDE.to_numpy()).predict(table).shape == WIDE.shape


class TestScorers:
    """Columns of y are the tasks, and gaps are left out."""

    @staticmethod
    def draw():
        rng = np.random.default_rng(0)
        X = pd.DataFrame({"depth": np.linspace(0.0, 6.0, 24)})
        f = np.sin(X["depth"].to_numpy())
        Y = np.column_stack([f, 2.0 * f + 5.0]) + 0.1 * rng.standard_normal((24, 2))
        Y = pd.DataFrame(Y, columns=["a", "b"])
        Y.iloc[[3, 9], 0] = np.nan
        return X, Y

    @pytest.mark.parametrize("in_pipeline", [False, True])
    def test_they_are_metrics_of_what_was_measured(self, in_pipeline):
        X, Y = self.draw()
        model = WideRegressor(MultiTaskGPRegressor("rbf", rank=1))
        model = make_pipeline(StandardScaler(), model) if in_pipeline else model
        model = model.fit(X, Y)
        seen = Y.notna().to_numpy()
        tasks = np.array(["a", "b"] * 24).reshape(24, 2)[seen]
        y = Y.to_numpy()[seen]
        found = model.predict(X, return_std=True, include_noise=True)
        mean, std = (of[seen] for of in found)
        nmse = make_normalized_mse_scorer()(model, X, Y)
        assert nmse == -metrics.normalized_mean_squared_error(y, mean, tasks=tasks)
        held = make_coverage_scorer(0.9)(model, X, Y)
        assert held == -abs(
            metrics.coverage(y, mean, std, level=0.9, tasks=tasks) - 0.9
        )
        options = {"y_train": y, "tasks": tasks}
        loss = make_standardized_log_loss_scorer(Y)(model, X, Y)
        assert loss == pytest.approx(
            -metrics.mean_standardized_log_loss(y, mean, std, **options)
        )

    def test_they_choose_among_models(self):
        X, Y = self.draw()
        search = GridSearchCV(
            WideRegressor(MultiTaskGPRegressor("rbf", learning="staged")),
            {"estimator__rank": [1, 2]},
            scoring=make_normalized_mse_scorer(y_var=Y.var(ddof=0)),
            cv=3,
        ).fit(X, Y)
        assert np.isfinite(search.cv_results_["mean_test_score"]).all()
        assert make_normalized_mse_scorer()(search, X, Y) > -0.1

    def test_columns_in_another_order_are_refused(self):
        X, Y = self.draw()
        model, score = WideRegressor(QUICK).fit(X, Y), make_normalized_mse_scorer()
        with pytest.raises(ValueError, match="Give them in this order"):
            score(model, X, Y[["b", "a"]])
        with pytest.raises(ValueError, match="columns"):
            score(model, X, Y.to_numpy().T)
        missing = Y.astype("Float64")
        assert score(model, X, missing) == pytest.approx(score(model, X, Y))
        with pytest.raises(NotFittedError):
            score(WideRegressor(QUICK), X, Y)


def test_a_task_column_of_another_name():
    model = MultiTaskGPRegressor(task_feature="site", max_iter=0)
    for asked in (model, RankSearchIC(model)):
        with pytest.raises(ValueError, match="Set task='site' of the WideRegressor"):
            WideRegressor(asked).fit(FRAME, WIDE)
    WideRegressor(model, task="site").fit(FRAME, WIDE)


def test_columns_of_one_value_are_left_out_of_the_score(fitted):
    one = GAPS.copy()
    one[1:, 1] = np.nan
    one[0, 1] = 1.0
    empty = one.copy()
    empty[:, 1] = np.nan
    assert fitted.score(X, one) == fitted.score(X, empty)


def test_rows_in_another_order_are_refused_by_the_score():
    named = WideRegressor(QUICK).fit(FRAME, WIDE)
    with pytest.raises(ValueError, match="order"):
        named.score(FRAME, WIDE.iloc[::-1])
