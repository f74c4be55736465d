"""Every private import of scikit-learn, in one place."""

from collections.abc import Callable
from typing import TypeVar

from sklearn.base import _fit_context
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils._set_output import _get_output_config
from sklearn.utils.validation import _check_feature_names_in as check_feature_names_in

__all__ = [
    "Interval",
    "StrOptions",
    "check_feature_names_in",
    "fit_context",
    "wants_pandas",
]

Method = TypeVar("Method", bound=Callable)
fit_context: Callable[..., Callable[[Method], Method]] = _fit_context  # keeps the hints


def wants_pandas(transformer):
    """Whether ``set_output`` or the configuration asks for frames of pandas."""
    return _get_output_config("transform", transformer)["dense"] == "pandas"
