"""Least squares with a noise variance for each joint, and its Bayesian form."""

from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import RESOLVED, svd

N_ROUNDS = 50  # of weights and coefficients, most often fewer than ten
CHANGE = 1e-3  # relative, of a noise variance that need not be learned again
SHRINK = 1e-4  # the same of the precision of a prior
N_STEPS = 100  # of that precision; one that grows without end changes nothing
NOTHING = 1e-10  # size of a column relative to the largest: rounding
SMALLEST = 1e-24  # noise variance relative to the power of the torque: rounding


class Solution(NamedTuple):
    """Coefficients and what is known of them.

    Attributes
    ----------
    coef : ndarray of shape (n_columns,)
        Least squares, or posterior mean.
    factor : ndarray of shape (n_columns, n_shown)
        Of the covariance of the coefficients, as far as the data show them. Without
        it a variance that is small by cancellation would have no digits, or no sign.
    blind : ndarray of shape (n_columns, n_blind)
        Directions that the data do not show, in which the coefficients are 0; none
        with a prior.
    precision : ndarray of shape (n_columns,)
        Of the prior of each coefficient; 0 for least squares.
    log_evidence : float
        Log density of the targets under that prior, up to their number times a
        constant; 0 for least squares.
    """

    coef: np.ndarray
    factor: np.ndarray
    blind: np.ndarray
    precision: np.ndarray
    log_evidence: float = 0.0

    @property
    def covariance(self):
        """The factor times its transpose, of shape (n_columns, n_columns)."""
        return self.factor @ self.factor.T


def least_squares(A, b, precision=0.0):
    """Posterior under a normal prior of given precisions; the noise has variance 1.

    Without a prior it is the shortest solution of those that fit best.
    """
    precision = np.broadcast_to(np.asarray(precision, np.float64), A.shape[1])
    if not precision.any():
        U, s, V, blind = _decompose(A)
        return Solution(V @ ((U.T @ b) / s), V / s, blind, precision)
    root = np.sqrt(precision)  # the coefficients' prior variance is then 1
    U, s, V, unseen = _decompose(A / root)
    coef = V @ (s * (U.T @ b) / (s**2 + 1.0))
    factor = np.hstack([V / np.sqrt(s**2 + 1.0), unseen])
    fit = np.sum(np.square(b - A @ (coef / root))) + coef @ coef
    value = -0.5 * (fit + np.log1p(s**2).sum())
    coef, factor = coef / root, factor / root[:, None]
    return Solution(coef, factor, unseen[:, :0], precision, value)


def plain(A, b, start):
    """Least squares, which start nowhere."""
    return least_squares(A, b)


def evidence(A, b, start=None, groups=None):
    """The posterior under the normal prior that makes the data likeliest.

    MacKay's fixed point: the number of coefficients of a group that the data determine
    is the precision of their prior times the sum of their squares.

    Parameters
    ----------
    A : ndarray of shape (n_rows, n_columns)
        What the targets are linear in; the noise has variance 1.
    b : ndarray of shape (n_rows,)
        Targets.
    start : ndarray of shape (n_columns,), default=None
        Precisions to begin with.
    groups : list of ndarray of int, default=None
        Columns whose coefficients have one prior variance; None: all of them.
    """
    groups = [np.arange(A.shape[1])] if groups is None else groups
    if len(A) > A.shape[1]:
        whole = np.linalg.qr(np.column_stack([A, b]), mode="r")
        A, b = whole[:, :-1], whole[:, -1]
    precision = np.ones(A.shape[1]) if start is None else start.copy()
    for _ in range(N_STEPS):
        before = precision.copy()
        shown, size = _shown(A, b, before)
        for group in groups:
            precision[group] = shown[group].sum() / max(size[group].sum(), SMALLEST)
        if (np.abs(precision - before) <= SHRINK * before).all():
            break
    return least_squares(A, b, precision)


def _shown(A, b, precision):
    """How far the data determine each coefficient, from 0 to 1, and its square."""
    root = np.sqrt(precision)
    U, s, V, _ = _decompose(A / root)
    coef = V @ (s * (U.T @ b) / (s**2 + 1.0)) / root
    return np.square(V) @ (s**2 / (s**2 + 1.0)), np.square(coef)


def _decompose(A):
    """Singular vectors and values that are no rounding errors, and the null space."""
    U, s, Vt = svd(A, full_matrices=A.shape[0] < A.shape[1])
    n = int((s > RESOLVED * max(A.shape) * s.max(initial=0.0)).sum())
    return U[:, :n], s[:n], Vt[:n].T, Vt[n:].T


def solve(A, Y, method):
    """Coefficients, and a noise variance of each joint, by which its rows weigh.

    Parameters
    ----------
    A : ndarray of shape (n_samples, n_joints, n_columns)
        What the torques are linear in.
    Y : ndarray of shape (n_samples, n_joints)
        Torques.
    method : callable
        `plain` or `evidence`.

    Returns
    -------
    solution : Solution
        Coefficients of the columns of A.
    noise : ndarray of shape (n_joints,)
        Variances.
    freedom : ndarray of shape (n_joints,)
        How many rows of each joint the coefficients do not use up.
    """
    n, power = len(Y), power_of(Y)
    A, Y = compress(A, Y)
    noise, precision = power, None
    for _ in range(N_ROUNDS):
        before = noise
        solution = method(*weigh(A, Y, noise), precision)
        precision = solution.precision
        spread = np.square(A @ solution.factor).sum(axis=(0, 2))
        freedom = n - spread / noise
        left = np.sum(np.square(Y - A @ solution.coef), axis=0)
        noise = np.maximum(left / np.maximum(freedom, 1.0), SMALLEST * power)
        if (np.abs(noise - before) <= CHANGE * before).all():
            break
    return solution, noise, freedom


def compress(A, Y):
    """Rows with the same sums of squares, at most one more than columns."""
    whole = np.concatenate([A, Y[:, :, None]], axis=2).swapaxes(0, 1)
    if whole.shape[1] > whole.shape[2]:
        whole = np.linalg.qr(whole, mode="r")
    whole = whole.swapaxes(0, 1)
    return whole[:, :, :-1], whole[:, :, -1]


def join(A, Y, noise, precision):
    """Coefficients of columns, where noise and prior are known."""
    return least_squares(*weigh(A, Y, noise), precision)


def weigh(A, Y, noise):
    """Rows of all joints, one after another, whose noise has variance 1."""
    root = np.sqrt(noise)
    return (A / root[:, None]).reshape(-1, A.shape[2]), (Y / root).ravel()


def power_of(Y):
    """Mean square of the torque of each joint; 1 where that is 0."""
    power = np.mean(np.square(Y), axis=0)
    return np.where(power > 0.0, power, 1.0)


def typical(A, Y):
    """Root mean square of each column, in units of the torque of its joint.

    That of a column of rounding errors, which data do not show, is 1.
    """
    size = np.sqrt(np.mean(np.square(A) / power_of(Y)[:, None], axis=(0, 1)))
    return np.where(size > NOTHING * size.max(initial=0.0), size, 1.0)
