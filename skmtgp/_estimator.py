"""The base of all estimators."""

from sklearn.base import BaseEstimator

from skmtgp._sklearn_compat import CallbackSupportMixin

DOCUMENTATION = "https://skmtgp.readthedocs.io/en/stable"


class Estimator(CallbackSupportMixin, BaseEstimator):
    """Estimator that takes callbacks and whose HTML links to its documentation."""

    _doc_link_module = "skmtgp"
    _doc_link_template = DOCUMENTATION + "/api/{estimator_name}.html"
