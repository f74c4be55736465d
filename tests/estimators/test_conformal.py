"""Conformal intervals around our estimators, as the guide makes them.

Bands of coverage are wide, because a seeded data set has a coverage of its own. They
fail if a recipe is broken: with a quantile of the wrong rows, or of the wrong level.
"""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.compose import make_column_transformer
from sklearn.model_selection import GroupShuffleSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OrdinalEncoder

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.exceptions import RepeatedRowsWarning
from skmtgp.model_selection import TaskStratifiedGroupKFold, TaskStratifiedKFold

regression = pytest.importorskip("mapie.regression")
subsample = pytest.importorskip("mapie.subsample")
SITE = {"task_feature": "site"}
LEVEL = 0.9
# Noise with heavy tails has outliers.
pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.OutlierWarning")


def a_model():
    return MultiTaskGPRegressor(rank=1, learning="staged", **SITE)


def curve(x, site):
    return np.where(site == "a", 1.0, -1.0) * np.sin(x)


def draw(n, rng, b=1.0):
    """Rows with heavy-tailed noise, at site b so many times as much."""
    site, x = rng.choice(["a", "b"], n), rng.uniform(0.0, 6.0, n)
    noise = 0.1 * np.where(site == "b", b, 1.0) * rng.standard_t(2, n)
    return pd.DataFrame({"x": x, "site": site}), curve(x, site) + noise


def held(intervals, y, rows=...):
    """Share of these rows that intervals hold, MAPIE's or (lower, upper)."""
    lower, upper = intervals[..., 0].T if np.ndim(intervals) == 3 else intervals
    return np.mean(((lower <= y) & (y <= upper))[rows])


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    return *draw(60, rng), *draw(400, rng)


@pytest.mark.parametrize("method", ["plus", "base"])
def test_cross_conformal(data, method):
    X, y, X_test, y_test = data
    conformal = regression.CrossConformalRegressor(
        a_model(), LEVEL, method=method, cv=TaskStratifiedKFold(5, **SITE)
    )
    mean, intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)
    assert mean.shape == y_test.shape
    assert 0.85 < held(intervals, y_test) < 0.95


def test_cross_conformal_as_wide_as_the_model_says():
    """MAPIE's score of standardised residuals, where site b has four times the noise.

    Its other scores make intervals of the same width everywhere.
    """
    scores = pytest.importorskip("mapie.conformity_scores")
    if not hasattr(scores, "StdConformityScore"):
        pytest.skip("MAPIE 1.5 or later")
    rng = np.random.default_rng(0)
    (X, y), (X_test, y_test) = draw(120, rng, b=4.0), draw(1000, rng, b=4.0)
    conformal = regression.CrossConformalRegressor(
        MultiTaskGPRegressor(rank=1, noise="per_task", **SITE),
        LEVEL,
        conformity_score=scores.StdConformityScore(),
        cv=TaskStratifiedKFold(5, **SITE),
    )
    conformal.fit_conformalize(X, y, predict_params={"include_noise": True})
    _, intervals = conformal.predict_interval(X_test)
    assert 0.86 < held(intervals, y_test) < 0.94
    width = (intervals[:, 1] - intervals[:, 0]).ravel()
    at_b = X_test["site"] == "b"
    assert width[at_b].mean() > 2.0 * width[~at_b].mean()


def trajectories(n, rng, span=6.0):
    """Stretches of six rows that share an offset, and the number of each."""
    group = np.repeat(np.arange(n), 6)
    site = np.where(group % 2, "b", "a")
    x = rng.uniform(0.0, span, n)[group] + np.tile(np.linspace(0.0, 0.5, 6), n)
    offset, noise = rng.normal(0.0, 0.3, n)[group], rng.normal(0.0, 0.05, 6 * n)
    y = curve(6.0 * x / span, site) + offset + noise
    return pd.DataFrame({"x": x, "site": site}), y, group


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.CorrelatedResidualsWarning")
def test_groups_stay_together():
    """Intervals hold rows of trajectories that are new."""
    rng = np.random.default_rng(0)
    X, y, groups = trajectories(30, rng)
    X_test, y_test, _ = trajectories(200, rng)
    conformal = regression.CrossConformalRegressor(
        a_model(), LEVEL, cv=TaskStratifiedGroupKFold(4, **SITE)
    )
    conformal.fit_conformalize(X, y, groups=groups)
    assert 0.89 < held(conformal.predict_interval(X_test)[1], y_test) < 0.98


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.CorrelatedResidualsWarning")
def test_split_by_trajectory():
    """Rows of trajectories that the model knows have too small errors."""
    rng = np.random.default_rng(0)
    X, y, groups = trajectories(60, rng, span=60.0)
    X_test, y_test, _ = trajectories(300, rng, span=60.0)
    shares = []
    for of in groups, np.arange(len(y)):
        cv = GroupShuffleSplit(1, test_size=0.4, random_state=0)
        train, rest = next(cv.split(X, y, of))
        model = numbered().fit(X.iloc[train], y[train])
        split = regression.SplitConformalRegressor(model, LEVEL)
        split.conformalize(X.iloc[rest], y[rest])
        shares.append(held(split.predict_interval(X_test)[1], y_test))
    assert 0.85 < shares[0] < 0.98
    assert shares[1] < min(0.85, shares[0] - 0.1)


def test_a_search(data):
    X, y, X_test, y_test = data
    search = RankSearchIC(MultiTaskGPRegressor(**SITE), ranks=(0, 1), simpler=False)
    conformal = regression.CrossConformalRegressor(
        search, LEVEL, cv=TaskStratifiedKFold(3, **SITE)
    )
    _, intervals = conformal.fit_conformalize(X, y).predict_interval(X_test)
    assert 0.89 < held(intervals, y_test) < 0.97


def test_jackknife_after_subsamples(data):
    """No subsample has a row twice, so no model warns of it."""
    X, y, X_test, y_test = data
    conformal = regression.JackknifeAfterBootstrapRegressor(
        a_model(),
        LEVEL,
        resampling=subsample.Subsample(
            12, n_samples=0.6, replace=False, random_state=0
        ),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RepeatedRowsWarning)
        conformal.fit_conformalize(X, y)
    assert 0.85 < held(conformal.predict_interval(X_test)[1], y_test) < 0.96


@pytest.mark.filterwarnings(
    "ignore:WARNING. at least one point", "ignore:Mean of empty"
)
def test_bootstraps_have_rows_twice(data):
    """The guide says why it takes subsamples."""
    X, y, _, _ = data
    conformal = regression.JackknifeAfterBootstrapRegressor(
        a_model(), resampling=subsample.Subsample(2, random_state=0)
    )
    with pytest.warns(RepeatedRowsWarning):
        conformal.fit_conformalize(X, y)


def numbered():
    """Our model after an encoder that gives sites numbers, the last column."""
    encoder = make_column_transformer(
        ("passthrough", ["x"]), (OrdinalEncoder(), ["site"])
    )
    return make_pipeline(encoder, MultiTaskGPRegressor(rank=1, learning="staged"))


@pytest.fixture(scope="module")
def halves():
    """A fitted pipeline, rows to conformalise and new ones; site b is noisier."""
    rng = np.random.default_rng(0)
    model = numbered().fit(*draw(80, rng, b=4.0))
    return model, *draw(300, rng, b=4.0), *draw(1000, rng, b=4.0)


def test_split(halves):
    """One quantile of all rows is right for them, but wrong for each site."""
    model, X, y, X_test, y_test = halves
    split = regression.SplitConformalRegressor(model, LEVEL).conformalize(X, y)
    _, intervals = split.predict_interval(X_test)
    assert 0.86 < held(intervals, y_test) < 0.94
    assert held(intervals, y_test, X_test["site"] == "a") > 0.95
    assert held(intervals, y_test, X_test["site"] == "b") < 0.87


def test_split_by_site(halves):
    model, X, y, X_test, y_test = halves
    lower, upper = np.empty((2, len(X_test)))
    for site in X["site"].unique():
        split = regression.SplitConformalRegressor(model, LEVEL)
        rows, new = X["site"] == site, X_test["site"] == site
        split.conformalize(X[rows], y[rows])
        _, intervals = split.predict_interval(X_test[new])
        lower[new], upper[new] = intervals[..., 0].T
    for site in "ab":
        assert 0.85 < held((lower, upper), y_test, X_test["site"] == site) < 0.95


@pytest.mark.filterwarnings("ignore:X does not have valid feature names")
def test_split_refuses_names_of_sites(halves):
    """MAPIE asks for a row of zeros first; the guide says what to do."""
    _, X, y, _, _ = halves
    split = regression.SplitConformalRegressor(a_model().fit(X[:60], y[:60]))
    with pytest.raises(UserWarning, match="Unknown task 0"):
        split.conformalize(X[60:], y[60:])
