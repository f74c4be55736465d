r"""Targets and the columns of a trend side by side, in sparse inference.

With the covariance V of the bound and a basis Q of the trend's columns, the restricted
bound of :mod:`skmtgp.inference.flat`, V in place of K, and its gradient need

.. math::
    V^{-1} [y - Q b, Q M^{-1/2}], \quad M = Q^T V^{-1} Q, \quad b = M^{-1} Q^T V^{-1} y

alone: G of the gradient is A A^T - V^{-1} with these columns A, as it is alpha alpha^T
- V^{-1} without a trend. So all sums over the rows are of several columns of targets,
Y = [y, Q], which are solved for at once. They are *turned* twice, multiplied by a small
matrix: from the first pass b and M are known well enough for columns that are nearly
[y - Q b, Q M^{-1/2}]; their residuals in the second say the rest, with all digits.
"""

from typing import NamedTuple

import numpy as np

from skmtgp._numerics.linalg import Cholesky
from skmtgp.exceptions import NotPositiveDefiniteError

ROUNDING = 1e-14  # of a number that products are differences of


class Columns:
    """What makes the columns of targets of rows.

    Parameters
    ----------
    maps : ndarray of shape (n_sets, 1 + n_trend, n_columns)
        What y and the columns of the trend are multiplied by, in the rows of each task
        if these have coefficients of their own.

    Attributes
    ----------
    rank : int
        Independent columns of the trend.
    """

    def __init__(self, maps):
        self.maps, self.rank = maps, maps.shape[2] - 1

    @classmethod
    def of_rows(cls, trend, H, tasks):
        """[y, Q] with an orthonormal Q of the columns at all rows.

        Parameters
        ----------
        trend : Trend
            Its coefficients.
        H : ndarray of shape (n_samples, n_trend)
            Its columns, `Trend.own_rows`.
        tasks : ndarray of shape (n_samples,)
            Tasks.
        """
        basis = trend.basis_of(H, tasks)
        n_sets, n_trend = trend.slopes.shape
        maps = np.zeros((n_sets, 1 + n_trend, 1 + basis.rank))
        maps[:, 0, 0] = 1.0
        of_basis = basis.coefficients(np.eye(basis.rank))
        maps[:, 1:, 1:] = of_basis.reshape(n_sets, n_trend, basis.rank)
        return cls(maps)

    @property
    def of_columns(self):
        """What makes the columns of Q of the trend's, (n_coefficients, rank)."""
        return self.maps[:, 1:, 1:].reshape(-1, self.rank)

    @property
    def of_targets(self):
        """What is taken off the targets, in coefficients, (n_coefficients,)."""
        return -self.maps[:, 1:, 0].ravel()

    def turned(self, turn):
        """The same with columns that are multiplied by an (n_columns, n_columns)."""
        return Columns(self.maps @ turn)

    def turn_to(self, other):
        """What makes another's columns of these; None if they tell something else.

        Both are of all coefficients of one trend, at other rows.
        """
        one, two = self.of_columns, other.of_columns
        if one.shape != two.shape or len(one) > self.rank:
            return None
        size = np.linalg.norm(one, axis=1, keepdims=True)
        return _turn(np.zeros(self.rank), np.linalg.solve(one / size, two / size))

    def of(self, tasks, targets):
        """Those of some rows, from y and the trend's columns side by side.

        Parameters
        ----------
        tasks : ndarray of shape (n_samples,)
            Tasks.
        targets : ndarray of shape (n_samples, 1 + n_trend)
            y and H.

        Returns
        -------
        columns : ndarray of shape (n_samples, n_columns)
        """
        if len(self.maps) == 1:
            return targets @ self.maps[0]
        found = np.empty((len(targets), self.maps.shape[2]))
        for task in np.unique(tasks):
            rows = tasks == task
            found[rows] = targets[rows] @ self.maps[task]
        return found

    def of_blocks(self, blocks):
        """X, tasks and the columns of each block of rows."""
        for X, tasks, targets in blocks:
            yield X, tasks, self.of(tasks, targets)


class Means(NamedTuple):
    """What rows would tell, were the columns Q M^{-1/2} the targets.

    Attributes
    ----------
    V : ndarray of shape (rank, n_latent, n_inducing)
        Mean weights of the latent functions.
    omega : ndarray of shape (rank, n_tasks, n_features)
        Those of the tasks.
    levels : ndarray of shape (rank, n_tasks)
        Mean levels.
    """

    V: np.ndarray
    omega: np.ndarray
    levels: np.ndarray

    def at(self, phi, tasks):
        """Mean of f for features in columns and their tasks, (rank, n_samples)."""
        found = self.levels[:, tasks]
        for task in np.unique(tasks):
            rows = tasks == task
            found[:, rows] += self.omega[:, task] @ phi[:, rows]
        return found

    def with_unseen(self, omega):
        """The same with tasks without data, of these weights."""
        levels = np.zeros(omega.shape[:2])
        return Means(
            self.V,
            np.concatenate([self.omega, omega], axis=1),
            np.concatenate([self.levels, levels], axis=1),
        )


def _turn(b, root):
    """What makes [y - Q b, Q root] of [y, Q], of shape (n_columns, n_columns)."""
    turn = np.eye(1 + len(b))
    turn[1:, 0], turn[1:, 1:] = -b, root
    return turn


def whitening(products, sizes):
    """What makes [y, Q] nearly [y - Q b, Q M^{-1/2}].

    Parameters
    ----------
    products : ndarray of shape (n_columns, n_columns)
        Y^T V^{-1} Y, of which rounding may have left little.
    sizes : ndarray of shape (n_columns,)
        What its diagonal is a difference of.

    Returns
    -------
    turn : ndarray of shape (n_columns, n_columns)
    log_det : float
        log|M|, as far as `turn` has it right.

    Raises
    ------
    NotPositiveDefiniteError
        If the products are not finite.
    """
    M, of_y = products[1:, 1:], products[1:, 0]
    if not (np.isfinite(products).all() and sizes[1:].all()):
        raise NotPositiveDefiniteError("columns of the trend are not finite")
    length = np.sqrt(np.maximum(np.diagonal(M), ROUNDING * sizes[1:]))
    values, vectors = np.linalg.eigh(M / length / length[:, None])
    values = np.maximum(values, ROUNDING * len(M))
    root = vectors / np.sqrt(values) / length[:, None]
    log_det = 2.0 * np.log(length).sum() + np.log(values).sum()
    return _turn(root @ (root.T @ of_y), root), log_det


def unexplained(products):
    """What columns, nearly those that are wanted, leave of the targets.

    Parameters
    ----------
    products : ndarray of shape (n_columns, n_columns)
        Y^T V^{-1} Y with all digits; nearly the identity, but for the first element.

    Returns
    -------
    fit : float
        y^T P y.
    log_det : float
        Of the columns' part.
    turn : ndarray of shape (n_columns, n_columns)
        What makes them those that are wanted.
    """
    M, of_y = products[1:, 1:], products[1:, 0]
    cholesky = Cholesky(np.array(M, order="F"))
    half = cholesky.half_solve(of_y)
    root = cholesky.half_solve(np.eye(len(M))).T
    turn = _turn(root @ half, root)
    return products[0, 0] - half @ half, cholesky.log_det(), turn
