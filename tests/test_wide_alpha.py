"""Known noise variances of tables with a column for each task."""

import dask.array as da
import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn import config_context
from sklearn.dummy import DummyRegressor
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import MultiTaskGPRegressor, RankSearchIC, WideRegressor, stack_tasks
from skmtgp.model_selection import TaskStratifiedKFold

RNG = np.random.default_rng(0)
X = RNG.uniform(0.0, 6.0, (15, 1))
ALPHA = RNG.uniform(0.01, 0.3, (15, 2))
Y = np.sin(X) * [1.0, 2.0] + np.sqrt(ALPHA) * RNG.standard_normal((15, 2))
Y[[0, 3, 4], [0, 0, 1]] = np.nan
FRAME = pd.DataFrame(X, columns=["depth"])
WIDE = pd.DataFrame(Y, columns=["zinc", "lead"])
KNOWN = pd.DataFrame(ALPHA, columns=WIDE.columns)
FOLDS = TaskStratifiedKFold(2, task_feature=-1)
PLAIN = MultiTaskGPRegressor(rank=1, max_iter=20)


@pytest.fixture(scope="module")
def expected():
    rows, y = stack_tasks(FRAME.join(WIDE), ["zinc", "lead"])
    alpha = [
        KNOWN.at[i, task] for i, task in zip(rows.index, rows["task"], strict=True)
    ]
    model = MultiTaskGPRegressor(rank=1, max_iter=20, task_feature="task")
    model = model.fit(rows, y, alpha=alpha)
    at = pd.concat([FRAME.assign(task=task) for task in ("zinc", "lead")])
    return model.predict(at).reshape(2, -1).T


def test_each_value_has_its_variance(expected):
    found = WideRegressor(PLAIN).fit(FRAME, WIDE, alpha=KNOWN).predict(FRAME)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    without = WideRegressor(PLAIN).fit(FRAME, WIDE).predict(FRAME)
    assert np.abs(found - without).max() > 1e-3


def test_it_may_be_nan_where_y_is(expected):
    gaps = np.where(np.isnan(Y), np.nan, ALPHA)
    found = WideRegressor(PLAIN).fit(X, Y, gaps).predict(X)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_number_and_a_single_column():
    one = WideRegressor(PLAIN).fit(X, Y, alpha=0.1).predict(X)
    other = WideRegressor(PLAIN).fit(X, Y, alpha=np.full(Y.shape, 0.1)).predict(X)
    np.testing.assert_allclose(one, other)
    y = np.sin(X[:, 0])
    single = WideRegressor(PLAIN).fit(X, y, alpha=ALPHA[:, 0])
    assert single.predict(X).shape == (15,)


@pytest.mark.parametrize(
    ("alpha", "match"),
    [
        (ALPHA[:, :1], r"alpha must be a number or of the shape of y, \(15, 2\)"),
        (ALPHA[:5], r"not \(5, 2\)"),
        (KNOWN[["lead", "zinc"]], r"Give alpha\[y.columns\]"),
        (KNOWN.iloc[::-1], "alpha has the index labels of X in another order"),
        (np.where(ALPHA[2, 1] == ALPHA, np.nan, ALPHA), "row 2 of column 'lead'"),
        (-ALPHA, "alpha"),
        ("much", "alpha"),
    ],
)
def test_what_cannot_be_a_variance(alpha, match):
    with pytest.raises(ValueError, match=match):
        WideRegressor(PLAIN).fit(FRAME, WIDE, alpha=alpha)


def test_rows_of_dask():
    with pytest.raises(TypeError, match="alpha"):
        WideRegressor(PLAIN).fit(X, Y, alpha=da.from_array(ALPHA))


def test_a_model_that_takes_none():
    with pytest.raises(TypeError, match="DummyRegressor takes no alpha in fit"):
        WideRegressor(DummyRegressor()).fit(X, Y, alpha=ALPHA)


def test_ends_of_pipelines_and_searches(expected):
    chain = make_pipeline(FunctionTransformer(), PLAIN)
    search = GridSearchCV(chain, {"multitaskgpregressor__max_iter": [20]}, cv=FOLDS)
    for inner in (chain, make_pipeline(chain), search):
        found = WideRegressor(inner).fit(X, Y, alpha=ALPHA).predict(X)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    ranks = WideRegressor(RankSearchIC(PLAIN, ranks=[1])).fit(X, Y, alpha=ALPHA)
    assert np.isfinite(ranks.predict(X)).all()


def test_as_routed_metadata(expected):
    with config_context(enable_metadata_routing=True):
        chain = make_pipeline(
            FunctionTransformer(), PLAIN.__class__(rank=1, max_iter=20)
        )
        chain[-1].set_fit_request(alpha=True)
        outer = make_pipeline(
            FunctionTransformer(), WideRegressor(chain).set_fit_request(alpha=True)
        )
        found = outer.fit(X, Y, alpha=ALPHA).predict(X)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_covariance_is_had_otherwise():
    model = WideRegressor(PLAIN).fit(X, Y)
    with pytest.raises(TypeError, match="draw them together, by sample_y; or learn"):
        model.predict(X, return_cov=True)
    with pytest.raises(TypeError, match=r"include_noise\.$"):
        model.predict(X, of_what=True)


@pytest.fixture(scope="module")
def model():
    return WideRegressor(PLAIN).fit(FRAME, WIDE, alpha=KNOWN)


class TestPredictions:
    """`alpha` of new values, in the shape of Y."""

    NEW, AT = FRAME[:4], np.array([[0.5, 2.0], [0.0, 1.0], [1.0, 0.1], [3.0, 0.2]])
    VALUES = pd.DataFrame(Y[:4] + 0.3, columns=WIDE.columns)

    def of_f(self, model):
        """Means and variances of new values but for what is known."""
        mean, std = model.predict(self.NEW, return_std=True, include_noise=True)
        return mean, np.square(std)

    @pytest.mark.parametrize("named", [False, True])
    def test_intervals(self, model, named):
        mean, variance = self.of_f(model)
        alpha = pd.DataFrame(self.AT, columns=WIDE.columns) if named else self.AT
        ends = model.predict_interval(self.NEW, 0.9, alpha=alpha)
        for end, p in zip(ends, (0.05, 0.95), strict=True):
            expected = norm.ppf(p, mean, np.sqrt(variance + self.AT))
            np.testing.assert_allclose(end, expected, rtol=1e-8)
        one = model.predict_interval(self.NEW, 0.9, alpha=0.3)
        expected = norm.ppf(0.95, mean, np.sqrt(variance + 0.3))
        np.testing.assert_allclose(one[1], expected, rtol=1e-8)

    def test_densities(self, model):
        mean, variance = self.of_f(model)
        gaps = np.isnan(self.VALUES.to_numpy())
        assert gaps.any()
        alpha = np.where(gaps, np.nan, self.AT)
        found = model.log_predictive_density(self.NEW, self.VALUES, alpha=alpha)
        expected = norm.logpdf(self.VALUES, mean, np.sqrt(variance + self.AT))
        np.testing.assert_allclose(found, expected, rtol=1e-8)

    def test_of_a_single_column(self):
        y = np.sin(X[:, 0])
        model = WideRegressor(PLAIN).fit(X, y)
        mean, std = model.predict(X, return_std=True, include_noise=True)
        std = np.sqrt(std**2 + ALPHA[:, 0])
        lower, _ = model.predict_interval(X, alpha=ALPHA[:, 0])
        np.testing.assert_allclose(lower, norm.ppf(0.025, mean, std), rtol=1e-8)
        found = model.log_predictive_density(X, y, alpha=ALPHA[:, 0])
        np.testing.assert_allclose(found, norm.logpdf(y, mean, std), rtol=1e-8)

    @pytest.mark.parametrize(
        ("alpha", "match"),
        [
            (AT[:, :1], r"alpha must be a number or of the shape of y, \(4, 2\)"),
            (pd.DataFrame(AT, columns=["lead", "zinc"]), r"Give alpha\[y.columns\]"),
            (KNOWN[:4].iloc[::-1], "alpha has the index labels of X in another order"),
            (np.where(AT == 0.2, np.nan, AT), "row 3 of column 'lead'"),
            (-AT, "alpha has -"),
        ],
    )
    def test_what_cannot_be_a_variance(self, model, alpha, match):
        with pytest.raises(ValueError, match=match):
            model.predict_interval(self.NEW, alpha=alpha)
        with pytest.raises(ValueError, match=match):
            model.log_predictive_density(self.NEW, self.VALUES.fillna(0), alpha=alpha)

    def test_rows_of_dask(self, model):
        with pytest.raises(TypeError, match=r"alpha .*Stack the columns into rows"):
            model.predict_interval(self.NEW, alpha=da.from_array(self.AT))

    def test_f_has_no_noise(self, model):
        with pytest.raises(ValueError, match="include_noise=False asks for f"):
            model.predict_interval(self.NEW, include_noise=False, alpha=0.1)


def test_numbered_columns_of_alpha_in_another_order_are_refused():
    rng = np.random.default_rng(0)
    x, Y = rng.uniform(0.0, 4.0, (20, 1)), pd.DataFrame(rng.standard_normal((20, 3)))
    model = WideRegressor(MultiTaskGPRegressor(rank=1, max_iter=0)).fit(x, Y)
    alpha = pd.DataFrame(np.ones((20, 3)))
    model.predict_interval(x, alpha=alpha)
    with pytest.raises(ValueError, match="alpha has the columns"):
        model.predict_interval(x, alpha=alpha[[2, 1, 0]])
