"""Sums over the rows, which are all that sparse inference sees of them.

Two passes over the rows, block by block: :func:`sum_features` goes forward,
:func:`sum_gradients` backward. The sums of disjoint sets of rows add up to those of
all, so that the sets may lie on different machines.

Targets y may have several columns, see :mod:`skmtgp.inference.restricted`. What is
linear in them then has an axis of columns first, what is quadratic two.
"""

from dataclasses import dataclass, replace

import numpy as np

WINDOW = 16  # blocks whose rows are sorted by task


class Sums:
    """Sums that add up, field by field."""

    def __add__(self, other):
        names = vars(self)
        added = {name: getattr(self, name) + getattr(other, name) for name in names}
        return type(self)(**added)

    def __sizeof__(self):  # Dask asks
        return sum(field.nbytes for field in vars(self).values())


@dataclass
class FeatureSums(Sums):
    """Sums over the rows of each task.

    Attributes
    ----------
    S : ndarray of shape (n_tasks, n_features, n_features)
        sum_i phi_i phi_i^T.
    s : ndarray of shape ([n_columns,] n_tasks, n_features)
        sum_i phi_i y_i.
    rest : ndarray of shape (n_tasks, n_terms)
        sum_i k^x(x_i, x_i) - |phi_i|^2 of each term.
    n : ndarray of shape (n_tasks,)
        Numbers of rows.
    phi : ndarray of shape (n_tasks, n_features)
        sum_i phi_i.
    y : ndarray of shape ([n_columns,] n_tasks)
        sum_i y_i.
    squares : ndarray of shape ([n_columns, n_columns,] n_tasks)
        sum_i y_i y_i.
    """

    S: np.ndarray
    s: np.ndarray
    rest: np.ndarray
    n: np.ndarray
    phi: np.ndarray
    y: np.ndarray
    squares: np.ndarray

    def turned(self, turn):
        """The same of other columns of targets, which a matrix makes of these."""
        s, y = (np.tensordot(turn.T, of, 1) for of in (self.s, self.y))
        squares = np.einsum("ka,klm,lb->abm", turn, self.squares, turn)
        return replace(self, s=s, y=y, squares=squares)


@dataclass
class ResidualSums(Sums):
    """Sums of e_i = y_i - c_m - omega_m . phi_i over the rows of each task.

    Attributes
    ----------
    squares : ndarray of shape ([n_columns, n_columns,] n_tasks)
        sum_i e_i^2.
    errors : ndarray of shape ([n_columns,] n_tasks, n_features)
        sum_i phi_i e_i.
    error : ndarray of shape ([n_columns,] n_tasks)
        sum_i e_i.
    """

    squares: np.ndarray
    errors: np.ndarray
    error: np.ndarray


@dataclass
class GradientSums(ResidualSums):
    """The same with the gradient.

    Attributes
    ----------
    theta : ndarray of shape (n_theta,)
        Gradient by the kernels' theta, but for K_ZZ's part.
    Z : ndarray of shape (n_inducing, n_inputs)
        The same by the inducing inputs, if it was asked for.
    """

    theta: np.ndarray
    Z: np.ndarray


def blocks(X, tasks, y, size):
    """X, tasks and y of at most `size` rows at a time."""
    for a in range(0, len(y), size):
        rows = slice(a, a + size)
        features, targets = (np.asarray(part[rows], dtype=float) for part in (X, y))
        yield features, np.asarray(tasks[rows]), targets


def blocks_by_task(X, tasks, y, size):
    """The same, of few tasks each, in an order of their own.

    Sums of each task are large where there are many tasks: a block of all of them would
    add a few rows to each.
    """
    for features, codes, targets in blocks(X, tasks, y, WINDOW * size):
        order = np.argsort(codes, kind="stable")
        for a in range(0, len(order), size):
            rows = order[a : a + size]
            yield features[rows], codes[rows], targets[rows]


def sum_blocks(function, options, size, columns, arguments, X, tasks, y):
    """``function(*arguments, blocks, **options)``, a function below, of some rows."""
    rows = blocks_by_task(X, tasks, y, size)
    rows = rows if columns is None else columns.of_blocks(rows)
    return function(*arguments, rows, **options)


def sum_features(features, n_tasks, blocks, n_columns=()):
    """The forward pass over some rows.

    Parameters
    ----------
    features : Features
        At the parameters.
    n_tasks : int
        Number of tasks M.
    blocks : iterable of (ndarray, ndarray, ndarray)
        X, tasks and y of some rows at a time.
    n_columns : tuple of int, default=()
        Columns of y, if it has several.

    Returns
    -------
    sums : FeatureSums
        Those of several sets of rows add up to those of all.
    """
    p, n_terms = len(features), len(features.terms)
    sums = FeatureSums(
        S=np.zeros((n_tasks, p, p)),
        s=np.zeros((*n_columns, n_tasks, p)),
        rest=np.zeros((n_tasks, n_terms)),
        n=np.zeros(n_tasks),
        phi=np.zeros((n_tasks, p)),
        y=np.zeros((*n_columns, n_tasks)),
        squares=np.zeros((*n_columns * 2, n_tasks)),
    )
    for block in blocks:
        _add_features(sums, features, *block)
    return sums


def _add_features(sums, features, X, tasks, y):
    """Add those of a block, whose memory is free then, to the sums."""
    X, tasks, y, parts = _by_task(X, tasks, y)
    tile = features.tile(X)
    for task, rows in parts:
        phi, targets = tile.phi[:, rows], y[rows]
        sums.S[task] += phi @ phi.T
        sums.s[..., task, :] += (phi @ targets).T
        sums.phi[task] += phi.sum(axis=1)
        sums.squares[..., task] += targets.T @ targets
    for of_term, rest in zip(sums.rest.T, tile.rest.T, strict=True):
        of_term += np.bincount(tasks, rest, len(sums.n))
    sums.n += np.bincount(tasks, minlength=len(sums.n))
    for of_column, targets in zip(*map(np.atleast_2d, (sums.y, y.T)), strict=True):
        of_column += np.bincount(tasks, targets, len(sums.n))


def sum_residuals(features, omega, levels, blocks):
    """The backward pass over some rows without the gradient.

    Parameters
    ----------
    features : Features
        At the parameters.
    omega : ndarray of shape ([n_columns,] n_tasks, n_features)
        Weights of the features.
    levels : ndarray of shape ([n_columns,] n_tasks)
        c_m.
    blocks : iterable of (ndarray, ndarray, ndarray)
        X, tasks and y of some rows at a time.

    Returns
    -------
    sums : ResidualSums
        Those of several sets of rows add up to those of all.
    """
    sums = ResidualSums(*_no_residuals(omega))
    for X, tasks, y in blocks:
        X, _, y, parts = _by_task(X, tasks, y)
        _add_residuals(sums, features.tile(X).phi, omega, levels, y, parts)
    return sums


def _no_residuals(omega):
    """Zeros of the shapes of `ResidualSums`."""
    *n_columns, n_tasks, _ = omega.shape
    shapes = (*n_columns * 2, n_tasks), omega.shape, (*n_columns, n_tasks)
    return [np.zeros(shape) for shape in shapes]


def _add_residuals(sums, phi, omega, levels, y, parts):
    """Add those of a block to the sums, and return the residuals."""
    error = np.empty(y.shape)
    for task, rows in parts:
        of_f = (omega[..., task, :] @ phi[:, rows]).T
        error[rows] = y[rows] - levels[..., task] - of_f
        sums.squares[..., task] += error[rows].T @ error[rows]
        sums.errors[..., task, :] += (phi[:, rows] @ error[rows]).T
        sums.error[..., task] += error[rows].sum(axis=0)
    return error


def sum_gradients(features, adjoint, blocks, *, inputs=False):
    """The backward pass over some rows.

    Parameters
    ----------
    features : Features
        At the parameters.
    adjoint : Adjoint
        What the gradient needs of all rows.
    blocks : iterable of (ndarray, ndarray, ndarray)
        X, tasks and y of some rows at a time.
    inputs : bool, default=False
        Whether the gradient by the inducing inputs is wanted too.

    Returns
    -------
    sums : GradientSums
        Those of several sets of rows add up to those of all.
    """
    of_residuals = _no_residuals(adjoint.omega)
    of_theta, of_Z = np.zeros(features.n_theta), np.zeros_like(features.Z)
    sums = GradientSums(*of_residuals, of_theta, of_Z)
    for block in blocks:
        _add_gradients(sums, features, adjoint, *block, inputs=inputs)
    return sums


def _add_gradients(sums, features, adjoint, X, tasks, y, *, inputs):
    """Add those of a block, whose memory is free then, to the sums."""
    X, tasks, y, parts = _by_task(X, tasks, y)
    tile, omega = features.tile(X), adjoint.omega
    error = _add_residuals(sums, tile.phi, omega, adjoint.levels, y, parts)
    alpha = error.T / adjoint.noise[tasks]
    phi_bar = np.empty_like(tile.phi)
    for task, rows in parts:
        np.matmul(adjoint.C[task], tile.phi[:, rows], out=phi_bar[:, rows])
        phi_bar[:, rows] += _outer(adjoint.along[..., task, :], alpha[..., rows])
        phi_bar[:, rows] += adjoint.with_level[task][:, None]
    K_bar = phi_bar if adjoint.of_kernel else features.pull_back(phi_bar)
    sums.theta += tile.contract(K_bar, adjoint.diagonal[tasks])
    if inputs:
        sums.Z += tile.contract_inputs(K_bar)


def _outer(a, b):
    """Outer product; of several columns, which come first, the sum of theirs."""
    return np.multiply.outer(a, b) if a.ndim == 1 else a.T @ b


def _by_task(X, tasks, y):
    """The rows sorted by task, and for each task that has any where they are."""
    order = np.argsort(tasks, kind="stable")
    tasks = tasks[order]
    present, starts = np.unique(tasks, return_index=True)
    stops = [*starts[1:], len(tasks)]
    parts = zip(present, map(slice, starts, stops), strict=True)
    return X[order], tasks, y[order], list(parts)
