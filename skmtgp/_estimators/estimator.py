"""The base of all estimators."""

import inspect
from collections.abc import Callable
from contextlib import contextmanager
from functools import wraps
from typing import ClassVar, TypeVar

from sklearn.base import BaseEstimator

from skmtgp._numerics.parallel import ONE_THREAD
from skmtgp._support import progress
from skmtgp._support.followers import as_it_is
from skmtgp._support.sklearn_compat import CallbackSupportMixin, InvalidParameterError
from skmtgp._support.versions import with_versions, without_versions

DOCUMENTATION = "https://skmtgp.readthedocs.io/en/stable"

Method = TypeVar("Method", bound=Callable)


class Estimator(CallbackSupportMixin, BaseEstimator):
    """Estimator that takes callbacks and whose HTML links to its documentation."""

    _parameter_hints: ClassVar[dict[str, str]] = {  # what to give, for errors
        "task_feature": "It is one column. Where several tell the task, join them in "
        "one, such as X['site'] + ' ' + X['machine'] of strings."
    }

    _call_hints: ClassVar[dict[str, str]] = {}  # instead of arguments there are not

    _doc_link_module = "skmtgp"
    _doc_link_template = DOCUMENTATION + "/api/{estimator_name}.html"

    def _validate_params(self):
        """As scikit-learn does it; errors also say what to give."""
        try:
            super()._validate_params()
        except InvalidParameterError as error:
            for name, hint in self._parameter_hints.items():
                if str(error).startswith(f"The {name!r} parameter of "):
                    raise InvalidParameterError(f"{error} {hint}") from None
            raise

    def __getstate__(self):
        return with_versions(super().__getstate__())

    def __setstate__(self, state):
        """As it was saved; parameters that are newer have their defaults."""
        state = without_versions(state, type(self).__name__)
        super().__setstate__(self._defaults() | state)

    @classmethod
    def _defaults(cls):
        """Parameters that have a default."""
        parameters = inspect.signature(cls).parameters.values()
        return {of.name: of.default for of in parameters if of.default is not of.empty}


@contextmanager
def fitting(estimator, X, y, *, verbose=0):
    """Context of a fit, see `progress.fitting`, whose exceptions leave no limit."""
    told = progress.fitting(estimator, X, y, verbose=verbose)
    with ONE_THREAD.unwinding(), told as report:
        yield report


def public(method: Method) -> Method:
    """A method whose calls are refused in the name of the estimator's own class.

    Python names the class that has the method, which may be a private base. Exceptions
    leave no limit of threads.
    """
    signature = inspect.signature(method)

    @wraps(method)
    def call(self, *args, **kwargs):
        try:
            signature.bind(self, *args, **kwargs)
        except TypeError as error:
            known = ", ".join(list(signature.parameters)[1:])
            name, hints = f"{type(self).__name__}.{method.__name__}()", self._call_hints
            hint = next((f" {hints[key]}" for key in kwargs if key in hints), "")
            raise TypeError(f"{name} {error}. It takes {known}.{hint}") from None
        with ONE_THREAD.unwinding():
            return method(self, *args, **kwargs)

    return call


def steady(method: Method) -> Method:
    """A public method that sees one state, whatever the estimator learns meanwhile.

    Another thread may call `partial_fit`, which replaces all attributes at once.
    """

    @public
    @wraps(method)
    def call(self, *args, **kwargs):
        return method(as_it_is(self), *args, **kwargs)

    return call
