"""Whether a kernel is a covariance of the inputs: before it is learned, and after."""

from contextlib import contextmanager
from functools import lru_cache
from numbers import Real

import numpy as np
from sklearn.gaussian_process.kernels import (
    Exponentiation,
    ExpSineSquared,
    Kernel,
    Matern,
    Product,
    Sum,
    WhiteKernel,
)
from sklearn.utils.random import sample_without_replacement

from skmtgp._numerics.linalg import DOUBLE, INDEFINITE
from skmtgp._numerics.parallel import limit_threads
from skmtgp.kernels import Columns, Spherical
from skmtgp.model._nodes import UnknownNode, compile_kernel, is_foreign
from skmtgp.model.several import terms_of

SAMPLED = 200  # rows whose covariance is looked at
DIFFERENTIATED = 40  # of them, whose gradient is
AT_BOUND = 1e-6  # of a hyperparameter: rounding of one that was learned
CONTRADICTION = 1e-6  # of a value: less is rounding, or single precision
WRONG = 1e-2, 1e-4  # of a derivative, of the values: less may be differences
SMOOTH = 1e-2, 1e-10  # of a change, of the values: how much a line may bend
STEP = 1e-5  # of theta, for differences
CLOSED_NU = (0.5, 1.5, 2.5, np.inf)  # of Matern, with a formula of their own
LEAST_NU, MOST_NU = 0.3, 15.0  # of scikit-learn's other formula, see `_check_nu`


def check_kernel(kernel, features):
    """Raise a ValueError where the kernel is not one to learn for these features.

    Parameters
    ----------
    kernel : Kernel
        k^x with its starting values.
    features : ndarray or dask.array.Array of shape (n_samples, n_features)
        Training inputs. Some of the rows are looked at.
    """
    X = sample_rows(features)
    with _naming(kernel, X):
        parts = list(_parts(kernel, X[:: -(-len(X) // DIFFERENTIATED)]))
    _check_hyperparameters(kernel)
    _check_covariance(kernel, X, is_foreign(compile_kernel(kernel)))
    for part, of_part in parts:
        if type(compile_kernel(part)) is UnknownNode:
            _check_gradient(part, of_part)


def check_covariance(kernel, features, node=None):
    """Raise a ValueError where values are those of no covariance.

    Parameters
    ----------
    kernel : Kernel
        k^x.
    features : ndarray or dask.array.Array of shape (n_samples, n_features)
        Inputs. Some of the rows are looked at.
    node : Node, default=None
        The kernel's fast form. If all parts of it are known, they do not contradict
        each other.
    """
    foreign = node is None or is_foreign(node)
    for of_term in terms_of(kernel):
        _check_covariance(of_term, sample_rows(features), foreign)


def _check_covariance(kernel, X, foreign=True):
    K = _values(kernel, X)
    scale = np.abs(K).max()
    if foreign:
        _check_consistent(kernel, X, K, scale)
    if scale > 0.0:
        _check_definite(kernel, K / scale)


def _check_consistent(kernel, X, K, scale):
    """Raise a ValueError where values differ that have to be the same."""
    _check_diagonal(kernel, X, np.diagonal(K))
    _check_pairs(
        kernel, X, X, K, K.T, CONTRADICTION * scale, "k(x, x') = {} and k(x', x) = {}"
    )
    if len(X) > 1:
        left, right = X[::2], X[1::2]
        _check_pairs(
            kernel,
            left,
            right,
            K[::2, 1::2],
            _values(kernel, left, right),
            CONTRADICTION * scale,
            "{} among the rows of X, but {} between two sets of them",
        )


def depends_on_inputs_only(kernel, features):
    """Whether a kernel is a function of the inputs, without noise of its own."""
    parts = [kernel, *kernel.get_params().values()]
    if any(isinstance(part, WhiteKernel) for part in parts):
        return False
    x = features[:1]  # a user's kernel may have noise of its own
    return np.allclose(kernel(x), kernel(x, x), rtol=1e-9, atol=0.0)


def sample_rows(features, most=SAMPLED):
    """Some of the rows, drawn at random, in memory.

    Parameters
    ----------
    features : ndarray or dask.array.Array of shape (n_samples, n_features)
        Inputs.
    most : int, default=200
        How many.

    Returns
    -------
    X : ndarray of shape (n_sampled, n_features)
        All of them if they are few.
    """
    n = len(features)
    if n <= most:
        return np.asarray(features)
    return np.asarray(features[_drawn(n, most)], dtype=np.float64)


@lru_cache(maxsize=8)
def _drawn(n, most):
    """Positions of rows; the outputs of a robot, say, have as many."""
    return np.sort(sample_without_replacement(n, most, random_state=0))


@contextmanager
def _naming(kernel, X):
    """Context in which errors get the name of the kernel."""
    try:
        with np.errstate(all="ignore"):
            yield
    except Exception as e:  # whatever a user's kernel raises
        raise ValueError(
            f"kernel={_name(kernel)} cannot take X, which has {X.shape[1]} features "
            f"beside the task column: {e}"
        ) from e


def _parts(kernel, X):
    """What a kernel is made of, with the columns of X that each part sees.

    An error is raised where a part is no covariance of such inputs.
    """
    if type(kernel) is Columns:
        X = kernel.select(X)
        if not isinstance(kernel.kernel, Kernel):
            raise TypeError(f"Columns needs a kernel, but got {kernel.kernel!r}.")
    if type(kernel) in (Columns, Exponentiation, Product, Sum):
        inner = kernel.get_params(deep=False).values()
        for part in (part for part in inner if isinstance(part, Kernel)):
            yield from _parts(part, X)
        return
    if type(kernel) is ExpSineSquared and X.shape[1] > 1:
        raise ValueError(
            f"ExpSineSquared is positive semi-definite on one feature, not on "
            f"{X.shape[1]}. Give it one, as Columns(ExpSineSquared(), [0]) does, or "
            "multiply one of each feature."
        )
    if isinstance(kernel, Spherical) and X.shape[1] > 3:
        raise ValueError(
            "Spherical is positive semi-definite on up to three features, not on "
            f"{X.shape[1]}. Give it the coordinates, as Columns(Spherical(), [0, 1]) "
            "does."
        )
    if type(kernel) is Matern:
        _check_nu(kernel.nu)
    yield kernel, X


def _check_nu(nu):
    """Raise a ValueError where scikit-learn's formula for any nu fails.

    For two equal rows it takes a distance of eps = 2e-16 length-scales instead of 0.
    The covariance is then 1 - O(eps^(2 nu)), which is not 1 for a small nu. A large one
    makes factors under- and overflow for rows that are close.
    """
    if nu in CLOSED_NU or (isinstance(nu, Real) and LEAST_NU <= nu <= MOST_NU):
        return
    raise ValueError(
        f"Matern(nu={nu!r}) cannot be computed: nu must be 0.5, 1.5, 2.5, inf, or from "
        f"{LEAST_NU} to {MOST_NU:.0f}. Above, it is hardly another kernel than RBF()."
    )


def _check_hyperparameters(kernel):
    """Raise a ValueError where learning cannot start at the kernel's values."""
    params = kernel.get_params()
    for h in kernel.hyperparameters:
        must = _fault(params[h.name], h.bounds, fixed=h.fixed)
        if must:
            raise ValueError(f"The kernel's {h.name}={params[h.name]!r} must {must}.")


def _fault(value, bounds, *, fixed):
    """What a hyperparameter must be and is not; None where it can be used."""
    slack, bounds = 1.0 + AT_BOUND, np.asarray(bounds)  # learned, it may start another
    try:
        value = np.asarray(value, dtype=np.float64)
        if fixed:
            return "be a number" if np.isnan(value).any() else None
        lower, upper = bounds.astype(np.float64).T
        inside = (lower <= value * slack) & (value <= upper * slack)
        usable = np.all((lower > 0.0) & inside & np.isfinite(value))
    except (TypeError, ValueError):
        usable = False
    if usable:
        return None
    return (
        f"be positive and lie between its bounds, {bounds.tolist()}, which must be "
        "positive and ascending, or 'fixed'"
    )


def _values(kernel, X, *other):
    """``kernel(X, *other)``, finite and of the shape of a covariance."""
    with _naming(kernel, X):
        K = np.asarray(kernel(X, *other))
    Z = other[0] if other else X
    if K.shape != (len(X), len(Z)):
        raise ValueError(
            f"kernel of type {type(kernel).__name__} gives an array of shape {K.shape} "
            f"for {len(X)} and {len(Z)} samples; a covariance has shape "
            f"{(len(X), len(Z))}."
        )
    for i, j in np.argwhere(~np.isfinite(K))[:1]:
        raise ValueError(
            f"kernel={_name(kernel)} is {K[i, j]} between {_row(X, i)} and "
            f"{_row(Z, j)}, which are rows of X; a covariance is finite."
        )
    return K.astype(np.float64, copy=False)


def _check_diagonal(kernel, X, expected):
    """Raise a ValueError where `diag` is not the diagonal of the values."""
    with _naming(kernel, X):
        found = np.asarray(kernel.diag(X))
    if found.shape != expected.shape:
        raise ValueError(
            f"diag of kernel={_name(kernel)} gives an array of shape {found.shape} for "
            f"{len(X)} samples, not {expected.shape}."
        )
    least = np.finfo(np.float64).eps * np.abs(expected).max()
    close = CONTRADICTION * np.abs(expected) + least
    for (i,) in np.argwhere(~(np.abs(found - expected) <= close))[:1]:
        raise ValueError(
            f"kernel={_name(kernel)} contradicts itself: its diag is {found[i]:.6g} "
            f"and its value {expected[i]:.6g} for {_row(X, i)}, which is a row of X. "
            "Variances need both to be the same: mend the kernel's diag."
        )


def _check_pairs(kernel, X, Z, one, other, atol, what):
    """Raise a ValueError where values that have to be the same differ."""
    for i, j in np.argwhere(~(np.abs(one - other) <= atol))[:1]:
        values = what.format(f"{one[i, j]:.6g}", f"{other[i, j]:.6g}")
        raise ValueError(
            f"kernel={_name(kernel)} contradicts itself: {values}, for {_row(X, i)} "
            f"and {_row(Z, j)}, which are rows of X. A covariance is a symmetric "
            "function of two rows."
        )


def _check_definite(kernel, K):
    """Raise a ValueError where an eigenvalue is negative, beyond rounding."""
    with limit_threads(len(K)):
        if _is_definite(K):
            return
        values = np.linalg.eigvalsh(K)
    if values[0] < -INDEFINITE * values[-1]:
        raise ValueError(
            f"kernel={_name(kernel)} is not positive semi-definite, as a covariance "
            f"is: the smallest eigenvalue between {len(K)} rows of X is "
            f"{values[0]:.2g}, where the largest is {values[-1]:.2g}. Choose another "
            "kernel, or bounds of its hyperparameters within which it is a covariance; "
            "centre the features if it loses digits."
        )


def _is_definite(K):
    """Whether K surely has no eigenvalue that is negative beyond rounding.

    The largest is not below any element of the diagonal. A Cholesky decomposition takes
    a tenth of the time of all eigenvalues.
    """
    raised, most = K.copy(order="F"), np.diagonal(K).max()
    raised[np.diag_indices_from(raised)] += 0.5 * INDEFINITE * most
    return most > 0.0 and DOUBLE.potrf(raised, lower=1, overwrite_a=1)[1] == 0


def _check_gradient(kernel, X):
    """Raise a ValueError where the gradient by theta cannot be that of the values."""
    with _naming(kernel, X):
        K, gradient = map(np.asarray, kernel(X, eval_gradient=True))
    shape = len(X), len(X), kernel.n_dims
    if gradient.shape != shape:
        raise ValueError(
            f"The gradient of kernel={_name(kernel)} has shape {gradient.shape}, not "
            f"{shape}: for {len(X)} rows and {kernel.n_dims} free hyperparameters."
        )
    for *_, p in np.argwhere(~np.isfinite(gradient))[:1]:
        raise ValueError(
            f"The gradient of kernel={_name(kernel)} by theta[{p}] is not finite for "
            "rows of X. Mend its eval_gradient, or fix the hyperparameter."
        )
    if not type(kernel).__module__.startswith("sklearn."):  # some take differences
        _check_slope(kernel, X, K, gradient)


def _check_slope(kernel, X, K, gradient):
    """Raise a ValueError where differences of the values contradict the gradient.

    They are taken along one direction of theta, and tell nothing where a step bends the
    values, as where a period is short.
    """
    rng = np.random.default_rng(0)
    W, step = rng.standard_normal(K.shape), rng.standard_normal(kernel.n_dims)
    with _naming(kernel, X):
        ahead, behind = (
            kernel.clone_with_theta(kernel.theta + size * step)(X)
            for size in (STEP, -STEP)
        )
    size, change = np.abs(W * K).sum(), ahead - behind
    bend = np.abs(W * (ahead - 2.0 * K + behind)).sum()
    if bend > SMOOTH[0] * np.abs(W * change).sum() + SMOOTH[1] * size:
        return
    parts = np.einsum("ij,ijp->p", W, gradient) * step
    found, expected = parts.sum(), 0.5 * np.vdot(W, change) / STEP
    if abs(found - expected) > WRONG[0] * np.abs(parts).sum() + WRONG[1] * size:
        raise ValueError(
            f"The gradient of kernel={_name(kernel)} is not the derivative of its "
            f"values by theta, the logarithms of its hyperparameters: it is "
            f"{found:.4g} along a direction in which they change by {expected:.4g}. "
            "Mend its eval_gradient, or fix the hyperparameters."
        )


def _name(kernel):
    """A kernel for a message, even one that cannot be printed."""
    try:
        with np.errstate(all="ignore"):
            return repr(kernel)
    except (TypeError, ValueError):
        return type(kernel).__name__


def _row(X, i):
    """A row of X, for a message."""
    return np.array2string(X[i], precision=6, threshold=8)
