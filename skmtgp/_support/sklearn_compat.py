"""What is private or new in scikit-learn, in one place."""

from collections.abc import Callable
from typing import TypeVar

from sklearn.base import _fit_context
from sklearn.utils._param_validation import (
    HasMethods,
    Interval,
    InvalidParameterError,
    StrOptions,
)
from sklearn.utils._set_output import _get_output_config
from sklearn.utils.validation import _check_feature_names_in as check_feature_names_in

try:
    from sklearn.callback import CallbackSupportMixin
    from sklearn.callback import with_callbacks as _with_callbacks
except ImportError:  # before scikit-learn 1.9

    class CallbackSupportMixin:  # type: ignore[no-redef]
        """Callbacks do not exist."""

    def _with_callbacks(method):
        """Callbacks do not exist."""
        return method


__all__ = [
    "CallbackSupportMixin",
    "HasMethods",
    "Interval",
    "InvalidParameterError",
    "StrOptions",
    "begin_callbacks",
    "check_feature_names_in",
    "fit_context",
    "wants_pandas",
    "with_callbacks",
]

Method = TypeVar("Method", bound=Callable)
# These keep the hints of what they decorate.
fit_context: Callable[..., Callable[[Method], Method]] = _fit_context
with_callbacks: Callable[[Method], Method] = _with_callbacks


def wants_pandas(transformer):
    """Whether ``set_output`` or the configuration asks for frames of pandas."""
    return _get_output_config("transform", transformer)["dense"] == "pandas"


def begin_callbacks(estimator, X, y):
    """Tell the estimator's callbacks that its fit begins; their context, or None."""
    if not getattr(estimator, "_skl_callbacks", None):
        return None
    context = estimator._init_callback_context(max_subtasks=None)
    context.call_on_fit_task_begin(estimator=estimator, X=X, y=y)
    return context
