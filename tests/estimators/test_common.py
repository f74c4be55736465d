"""scikit-learn's own checks of its estimators."""

import pytest
from checks import checks_of

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)

ALONE = [MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP]
DEFAULT = [cls() for cls in (*ALONE, RankSearchIC)]
LINEAR = [BayesianLinearRegression(pooled=pooled) for pooled in (False, True)]
# How the first column is cut does not depend on how long learning lasts.
QUICK = {"task_feature": 0, "max_iter": 10}
FIRST = [cls(**QUICK) for cls in ALONE]
FIRST += [
    MultiTaskGPRegressor(learning=learning, **QUICK)
    for learning in ("staged", "simultaneous")
]
FIRST += [cls(inference="sparse", n_inducing=10, **QUICK) for cls in ALONE]
FIRST += [
    PooledGP(inference="sparse", n_inducing=10, inducing_inputs=choice, **QUICK)
    for choice in ("k-means", "optimised")
]
SEARCH = RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2))
# Irises of one petal width are of one species, and its number is the target.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Task:skmtgp.exceptions.ConstantTargetWarning"
)


@checks_of([*DEFAULT, *LINEAR])
def test_task_in_the_last_column(estimator, check):
    check(estimator)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@checks_of([*FIRST, SEARCH, BayesianLinearRegression(task_feature=0)])
def test_task_in_the_first_column(estimator, check):
    check(estimator)
