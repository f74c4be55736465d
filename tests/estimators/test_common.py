"""scikit-learn's own checks of its estimators."""

import pytest
from checks import checks_of
from sklearn.base import clone
from sklearn.utils.estimator_checks import check_regressors_train

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
)

QUICK = {"max_iter": 2}  # how tables are taken does not depend on what is learned
FIRST = {"task_feature": 0, **QUICK}
SPARSE = {"inference": "sparse", "n_inducing": 10, **FIRST}
ALONE = [MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP]
STAGED = MultiTaskGPRegressor(learning="staged", **QUICK)
LAST_COLUMN = [
    MultiTaskGPRegressor("matern", rank=1, **QUICK),
    *(cls(**QUICK) for cls in ALONE[1:]),
    RankSearchIC(STAGED, ranks=(1, 2)),
    *(BayesianLinearRegression(pooled=pooled) for pooled in (False, True)),
    WideRegressor(MultiTaskGPRegressor(rank=1, **QUICK)),
    MultiTaskGPRegressor(rank=1, trend="constant", **QUICK),
]
# Here each way to learn and to infer once, whichever the estimator.
FIRST_COLUMN = [
    MultiTaskGPRegressor(learning="staged", **FIRST),
    MultiTaskGPRegressor(learning="simultaneous", **SPARSE),
    RankSearchIC(clone(STAGED).set_params(task_feature=0), ranks=(1, 2)),
    BayesianLinearRegression(task_feature=0),
]
SIMPLER_AND_SPARSE = [
    IndependentGP(**SPARSE),
    PooledGP(inducing_inputs="optimised", **SPARSE),
    SingleTaskGP(inducing_inputs="k-means", **SPARSE),
]
# Irises of one petal width are of one species, and its number is the target.
pytestmark = [
    pytest.mark.filterwarnings("ignore:Task:skmtgp.exceptions.ConstantTargetWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    # targets that are sorted
    pytest.mark.filterwarnings(
        "ignore:Task:skmtgp.exceptions.CorrelatedResidualsWarning"
    ),
    pytest.mark.filterwarnings("ignore:.*inducing:skmtgp.exceptions.JitterWarning"),
]


@checks_of(LAST_COLUMN)
def test_task_in_the_last_column(estimator, check):
    check(estimator)


@checks_of(FIRST_COLUMN)
def test_task_in_the_first_column(estimator, check):
    check(estimator)


@pytest.mark.long
@checks_of(SIMPLER_AND_SPARSE)
def test_inducing_inputs_of_simpler_models(estimator, check):
    check(estimator)


@pytest.mark.long
@pytest.mark.parametrize("estimator", [*(cls() for cls in ALONE), RankSearchIC()])
def test_defaults_learn(estimator):
    check_regressors_train(type(estimator).__name__, estimator)
