"""scikit-learn's own checks of its estimators."""

import pytest
from checks import checks_of
from sklearn.utils.estimator_checks import (
    check_regressors_train,
    check_sample_weight_equivalence_on_dense_data,
)

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
)

QUICK = {"max_iter": 1}  # how tables are taken does not depend on what is learned
FIRST = {"task_feature": 0, **QUICK}
SPARSE = {"inference": "sparse", "n_inducing": 10, **FIRST}
ALONE = [MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP]
SHARED = {"noise": "shared", "normalize_y": "shared"}
STAGED = {"rank": 1, "learning": "staged", **SHARED, **QUICK}
# Noise and units that are decided, a search over ranks, and each way to learn, to infer
# and to find the task once: whichever the estimator, they take tables by the same code.
LAST_COLUMN = [
    MultiTaskGPRegressor("matern", rank=1, **QUICK),
    SingleTaskGP(**QUICK),
    BayesianLinearRegression(pooled=False),
    WideRegressor(MultiTaskGPRegressor(**STAGED)),
]
ALIKE = [
    IndependentGP(**SHARED, **QUICK),
    PooledGP(**QUICK),
    BayesianLinearRegression(pooled=True),
    MultiTaskGPRegressor(trend="constant", **STAGED),
]
FIRST_COLUMN = [
    MultiTaskGPRegressor(learning="staged", **FIRST),
    MultiTaskGPRegressor(rank=1, learning="simultaneous", **SPARSE),
    RankSearchIC(
        MultiTaskGPRegressor(learning="staged", **SHARED, **FIRST), ranks=(1, 2)
    ),
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
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.RepeatedRowsWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.BinaryTargetWarning"),
    # targets that are sorted
    pytest.mark.filterwarnings(
        "ignore:Task:skmtgp.exceptions.CorrelatedResidualsWarning"
    ),
    pytest.mark.filterwarnings("ignore:.*inducing:skmtgp.exceptions.JitterWarning"),
]


@checks_of(LAST_COLUMN)
def test_task_in_the_last_column(estimator, check):
    check(estimator)


@pytest.mark.parametrize("cls", [*ALONE, RankSearchIC])
def test_one_check_has_no_labels_of_tasks(cls):
    """So it is expected to fail, as README and CONTRIBUTING say."""
    with pytest.raises(ValueError, match=r"Task labels must be .* fractional numbers"):
        check_sample_weight_equivalence_on_dense_data(cls.__name__, cls())


@pytest.mark.long
@checks_of(ALIKE)
def test_estimators_that_are_alike(estimator, check):
    check(estimator)


@pytest.mark.long
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
