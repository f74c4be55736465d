"""Least squares with a noise variance for each joint, and its Bayesian form."""

from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import RESOLVED

N_ROUNDS = 50  # of weights and coefficients, most often fewer than ten
CHANGE = 1e-3  # relative, of a noise variance that need not be learned again
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
    precision : float
        Of the prior of each coefficient; 0 for least squares.
    """

    coef: np.ndarray
    factor: np.ndarray
    blind: np.ndarray
    precision: float

    @property
    def covariance(self):
        """The factor times its transpose, of shape (n_columns, n_columns)."""
        return self.factor @ self.factor.T


def least_squares(A, b, precision=0.0):
    """Posterior under a normal prior of a given precision; the noise has variance 1.

    Without a prior it is the shortest solution of those that fit best.
    """
    U, s, V, blind = _decompose(A)
    factor = V / np.sqrt(s**2 + precision)
    if precision:
        factor = np.hstack([factor, blind / np.sqrt(precision)])
        blind = blind[:, :0]
    coef = V @ (s * (U.T @ b) / (s**2 + precision))
    return Solution(coef, factor, blind, precision)


def evidence(A, b):
    """The posterior under the normal prior that makes the data likeliest.

    MacKay's fixed point: the number of coefficients that the data determine is the
    precision of the prior times the sum of their squares.
    """
    U, s, _, _ = _decompose(A)
    shown, precision = s * (U.T @ b), 1.0
    for _ in range(N_ROUNDS * 20):
        before = precision
        size = np.sum(np.square(shown / (s**2 + precision)))
        precision = np.sum(s**2 / (s**2 + precision)) / max(size, SMALLEST)
        if abs(precision - before) <= 1e-8 * before:
            break
    return least_squares(A, b, precision)


def _decompose(A):
    """Singular vectors and values that are no rounding errors, and the null space."""
    U, s, Vt = np.linalg.svd(A, full_matrices=A.shape[0] < A.shape[1])
    n = int((s > RESOLVED * max(A.shape) * s.max(initial=0.0)).sum())
    return U[:, :n], s[:n], Vt[:n].T, Vt[n:].T


METHODS = {None: least_squares, "evidence": evidence, "nominal": evidence}


def solve(A, Y, method):
    """Coefficients, and a noise variance of each joint, by which its rows weigh.

    Parameters
    ----------
    A : ndarray of shape (n_samples, n_joints, n_columns)
        What the torques are linear in.
    Y : ndarray of shape (n_samples, n_joints)
        Torques.
    method : callable
        `least_squares` or `evidence`.

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
    noise = power
    for _ in range(N_ROUNDS):
        before = noise
        solution = method(*weigh(A, Y, noise))
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
