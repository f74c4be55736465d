"""What the parameters say of each term K^rho x k^x: one value, or a list of them."""

from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._estimators.named_kernels import KERNELS

LISTS = list, tuple
OF_TERMS = "rank", "shared", "diagonal"


class Term(NamedTuple):
    """What the user asks for in one term.

    Attributes
    ----------
    kernel : Kernel, str or None
        k^x.
    rank : int or None
        Rank of K^rho.
    shared : bool
        Whether all tasks share a function alike.
    diagonal : bool or "equal"
        Which diagonal K^rho has.
    """

    kernel: Kernel | str | None
    rank: int | None
    shared: bool
    diagonal: Any


def terms_asked_for(model):
    """The terms that the parameters of a model ask for.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        `kernel` says how many there are; `rank`, `shared` and `diagonal` have a value
        for all of them, or one for each.

    Returns
    -------
    terms : list of Term

    Raises
    ------
    ValueError
        If a list has another length, or a value that cannot be.
    """
    kernels = model.kernel if isinstance(model.kernel, LISTS) else [model.kernel]
    if not len(kernels):
        raise ValueError(
            "kernel=[] has no kernel. Give one for each term, or None for the default."
        )
    for kernel in kernels:
        named = kernel is None or (isinstance(kernel, str) and kernel in KERNELS)
        if not (named or isinstance(kernel, Kernel)):
            names = ", ".join(map(repr, KERNELS))
            raise ValueError(
                f"kernel={model.kernel!r} has {kernel!r}. It must have kernels of "
                f"scikit-learn's kind, names of kernels ({names}), or None for the "
                "default."
            )
    values = [_for_each(model, name, len(kernels)) for name in OF_TERMS]
    return [Term(*of) for of in zip(kernels, *values, strict=True)]


def _for_each(model, name, n_terms):
    """The value of a parameter for each term."""
    value = getattr(model, name)
    if not isinstance(value, LISTS):
        return [value] * n_terms
    if not isinstance(model.kernel, LISTS):
        raise ValueError(
            f"{name}={value!r} has a value for each term, but kernel={model.kernel!r} "
            "is a single one. Give a list of kernels, in which None is the default."
        )
    if len(value) != n_terms:
        raise ValueError(
            f"{name}={value!r} has {len(value)} values, but kernel has {n_terms}: give "
            "one for each kernel, or one value for all."
        )
    for each in value:
        if not _IS[name](each):
            raise ValueError(
                f"{name}={value!r} has {each!r}, but must have {_MUST_BE[name]} for "
                "each kernel."
            )
    return list(value)


def _is_bool(value):
    return isinstance(value, bool | np.bool_)


def _is_rank(value):
    is_int = isinstance(value, Integral) and not _is_bool(value)
    return value is None or (is_int and value >= 0)


_IS = {
    "rank": _is_rank,
    "shared": _is_bool,
    "diagonal": lambda value: _is_bool(value) or value == "equal",
}
_MUST_BE = {
    "rank": "an integer of 0 or more, or None,",
    "shared": "True or False",
    "diagonal": "True, False or 'equal'",
}
