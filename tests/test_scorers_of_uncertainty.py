"""Scorers of the log loss and of the coverage."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn.base import clone
from sklearn.model_selection import StratifiedKFold, cross_val_score
from sklearn.pipeline import make_pipeline

from skmtgp import BayesianLinearRegression, IndependentGP
from skmtgp.metrics import (
    coverage,
    make_coverage_scorer,
    make_standardized_log_loss_scorer,
    mean_standardized_log_loss,
)

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(scope="module")
def case():
    """A fitted model, its frame and targets."""
    rng = np.random.default_rng(1)
    task = np.repeat(["a", "b"], 30)
    frame = pd.DataFrame({"x": rng.normal(size=60), "load": task})
    y = frame["x"].to_numpy() + rng.normal(size=60) * np.where(task == "a", 1, 3)
    return BayesianLinearRegression(task_feature="load").fit(frame, y), frame, y


class TestScorersOfUncertainty:
    def test_log_loss(self, case):
        model, X, y = case
        X, y_new = X[:40], y[:40]
        gain = model.log_predictive_density(X, y_new)
        gain -= norm.logpdf(y_new, y.mean(), y.std())
        expected = 0.5 * (gain[:30].mean() + gain[30:].mean())
        found = make_standardized_log_loss_scorer(y, "load")(model, X, y_new)
        assert found == pytest.approx(expected, rel=1e-12)

    @pytest.mark.parametrize("level", [0.5, 0.95])
    def test_coverage(self, case, level):
        model, X, y = case
        lower, upper = model.predict_interval(X, level)
        share = ((lower <= y) & (y <= upper)).mean()  # of tasks of equally many rows
        found = make_coverage_scorer(level, "load")(model, X, y)
        assert found == pytest.approx(-abs(share - level), rel=1e-12)
        assert -0.3 < found <= 0.0

    def test_without_densities_and_intervals_they_are_those_of_a_normal(self, case):
        model, X, y = case

        class Normal:
            predict = model.predict

        mean, std = model.predict(X, return_std=True, include_noise=True)
        options = {"tasks": X["load"]}
        loss = mean_standardized_log_loss(y, mean, std, y_train=y, **options)
        found = make_standardized_log_loss_scorer(y, "load")(Normal(), X, y)
        assert found == pytest.approx(-loss, rel=1e-12)
        share = coverage(y, mean, std, level=0.5, **options)
        found = make_coverage_scorer(0.5, "load")(Normal(), X, y)
        assert found == pytest.approx(-abs(share - 0.5), rel=1e-12)

    @pytest.mark.parametrize("in_pipeline", [False, True])
    def test_transformed_targets(self, case, in_pipeline):
        """Scores are of the predictive distribution of y, not of a normal one."""
        _, X, logs = case
        y = np.exp(logs)
        options = {"task_feature": "load", "max_iter": 5}
        model = IndependentGP(target_transform=(np.log, np.exp), **options).fit(X, y)
        mean, std = (
            IndependentGP(**options)
            .fit(X, logs)
            .predict(X, return_std=True, include_noise=True)
        )
        gain = norm.logpdf(logs, mean, std) - logs - norm.logpdf(y, y.mean(), y.std())
        share = (np.abs(logs - mean) <= std * norm.ppf(0.75)).mean()
        scored = make_pipeline("passthrough", model) if in_pipeline else model
        found = make_standardized_log_loss_scorer(y, "load")(scored, X, y)
        assert found == pytest.approx(gain.mean(), rel=1e-6)
        found = make_coverage_scorer(0.5, "load")(scored, X, y)
        assert found == pytest.approx(-abs(share - 0.5), rel=1e-12)

    def test_infinite_densities_are_refused(self, case):
        """Of values that have a probability of their own, as 0 has of a root."""
        _, X, y = case
        y = np.where(np.arange(60) % 9, np.square(y), 0.0)
        roots = {"target_transform": (np.sqrt, np.square), "task_feature": "load"}
        model = IndependentGP(max_iter=0, **roots).fit(X, y)
        with pytest.raises(
            ValueError, match=r"density of y = 0\.0 is infinite: .* end"
        ):
            make_standardized_log_loss_scorer(y, "load")(model, X, y)
        assert np.isfinite(make_coverage_scorer(0.9, "load")(model, X, y))

    @pytest.mark.parametrize("kind", ["log loss", "coverage"])
    def test_in_cross_validation_and_pickled(self, case, kind):
        model, X, y = case
        scorer = {
            "log loss": make_standardized_log_loss_scorer(y, "load"),
            "coverage": make_coverage_scorer(task_feature="load"),
        }[kind]
        scorer = pickle.loads(pickle.dumps(scorer))
        cv = list(StratifiedKFold(3, shuffle=True, random_state=0).split(X, X["load"]))
        scores = cross_val_score(model, X, y, scoring=scorer, cv=cv)
        for (train, test), score in zip(cv, scores, strict=True):
            alone = clone(model).fit(X.iloc[train], y[train])
            assert score == pytest.approx(scorer(alone, X.iloc[test], y[test]))
