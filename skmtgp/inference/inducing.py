"""Choosing the inducing inputs of sparse inference."""

import numpy as np
from scipy.optimize import minimize
from sklearn.cluster import KMeans, MiniBatchKMeans
from sklearn.utils import check_random_state
from sklearn.utils.random import sample_without_replacement

CANDIDATES = 20_000  # rows
RESOLVED = 1e-13  # of the largest variance: less is rounding


def greedy_variance(
    kernel, X, n_inducing, *, n_candidates=CANDIDATES, random_state=None
):
    """Rows of X, each the one with the largest variance given those before.

    The pivoted Cholesky decomposition of k^x(X, X), broken off after `n_inducing`
    columns: it shrinks the trace term of the bound greedily. It takes
    O(n_candidates n_inducing^2) and n_inducing x n_candidates numbers.

    Parameters
    ----------
    kernel : Kernel
        k^x with the hyperparameters at which the variances are.
    X : array-like of shape (n_samples, n_features)
        Inputs, which may be memory-mapped or a Dask array.
    n_inducing : int
        How many are wanted.
    n_candidates : int, default=20000
        If X has more rows, as many of them are drawn, and the others are not looked
        at.
    random_state : int, RandomState instance or None, default=None
        For that.

    Returns
    -------
    Z : ndarray of shape (n_chosen, n_features)
        The rows, in the order of the choice; fewer than `n_inducing` where the other
        rows have no variance left in floating point.

    Notes
    -----
    Fine and Scheinberg, *Efficient SVM training using low-rank kernel representations*
    (JMLR 2001); for the bound, Burt, Rasmussen and van der Wilk, *Convergence of
    sparse variational inference in Gaussian processes regression* (JMLR 2020).
    """
    X = np.asarray(X[_candidates(len(X), n_candidates, random_state)], dtype=float)
    left = np.array(kernel.diag(X), dtype=float)
    least, chosen = RESOLVED * left.max(), []
    factor = np.empty((min(n_inducing, len(X)), len(X)))
    for j, row in enumerate(factor):
        pivot = np.argmax(left)
        if left[pivot] <= least:
            break
        row[:] = kernel(X[pivot : pivot + 1], X)[0]
        row -= factor[:j, pivot] @ factor[:j]
        row /= np.sqrt(left[pivot])
        left -= np.square(row)
        left[pivot] = 0.0
        chosen.append(pivot)
    return X[chosen]


def _candidates(n, n_candidates, random_state):
    if n <= n_candidates:
        return slice(None)
    rng = check_random_state(random_state)  # in memory of those that are drawn
    return np.sort(sample_without_replacement(n, n_candidates, random_state=rng))


def k_means(X, n_inducing, *, random_state=None):
    """Means of clusters of rows.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Inputs, which may be memory-mapped. Features whose length-scales differ much
        are better scaled before.
    n_inducing : int
        Number of clusters; at most n_samples are made.
    random_state : int, RandomState instance or None, default=None
        For scikit-learn's KMeans or, where X has more than 20000 rows,
        MiniBatchKMeans.

    Returns
    -------
    Z : ndarray of shape (n_chosen, n_features)
        The means, each once.
    """
    method = KMeans if len(X) <= CANDIDATES else MiniBatchKMeans
    clusters = method(min(n_inducing, len(X)), n_init=3, random_state=random_state)
    return np.unique(clusters.fit(X).cluster_centers_.astype(float), axis=0)


def optimised(bound, theta, *, max_iter=100):
    """Inducing inputs that make the bound higher, theta staying as it is.

    Parameters
    ----------
    bound : SparseBound
        Its inducing inputs are where the search by L-BFGS begins.
    theta : ndarray of shape (n_theta,)
        Parameters.
    max_iter : int, default=100
        Most iterations.

    Returns
    -------
    Z : ndarray of shape (n_inducing, n_features)
        The best that were met. Never worse than those of `bound`.

    Raises
    ------
    ValueError
        If the kernel's derivative by its inputs is not known.
    """
    scale = bound.Z.std(axis=0)
    scale[scale == 0.0] = 1.0
    best, best_Z = -np.inf, bound.Z

    def objective(flat):
        nonlocal best, best_Z
        Z = flat.reshape(bound.Z.shape) * scale
        value, _, d_Z = bound.with_inducing(Z).value_and_grads(theta)
        if value > best:
            best, best_Z = value, Z
        return -value / len(bound.y), -np.ravel(d_Z * scale) / len(bound.y)

    start = np.ravel(bound.Z / scale)
    minimize(
        objective, start, jac=True, method="L-BFGS-B", options={"maxiter": max_iter}
    )
    return best_Z
