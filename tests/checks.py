"""scikit-learn's own checks of estimators."""

from inspect import signature

import sklearn
from sklearn.utils.estimator_checks import parametrize_with_checks


def checks_of(estimators):
    """One case of ``test(estimator, check)`` for each estimator and check."""
    return parametrize_with_checks(estimators, expected_failed_checks=_failing)


REPEATS = "sample_weight counts repeats, from 1 on: rows of zero weight are left out"
SPARSE = "inference='sparse' refuses sample_weight"
OF_WEIGHTS = (
    "check_sample_weights_pandas_series",
    "check_sample_weights_not_an_array",
    "check_sample_weights_list",
    "check_sample_weights_shape",
    "check_sample_weights_not_overwritten",
)


def _failing(estimator):
    failing = {}
    if sklearn.__version__.startswith("1.6."):
        reason = "scikit-learn 1.6 subtracts a float from its own integers in place"
        failing["check_positive_only_tag_during_fit"] = reason
    if "sample_weight" in signature(estimator.fit).parameters:
        failing["check_sample_weight_equivalence_on_dense_data"] = REPEATS
        if getattr(estimator, "inference", None) == "sparse":
            failing |= dict.fromkeys(OF_WEIGHTS, SPARSE)
    return failing
