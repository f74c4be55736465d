"""scikit-learn's own checks of estimators."""

import sklearn
from sklearn.utils.estimator_checks import parametrize_with_checks


def checks_of(estimators):
    """One case of ``test(estimator, check)`` for each estimator and check."""
    return parametrize_with_checks(estimators, expected_failed_checks=_failing)


def _failing(estimator):
    if not sklearn.__version__.startswith("1.6."):
        return {}
    reason = "scikit-learn 1.6 subtracts a float from its own integers in place"
    return {"check_positive_only_tag_during_fit": reason}
