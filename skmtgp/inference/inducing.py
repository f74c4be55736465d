"""Choosing the inducing inputs of sparse inference."""

import numpy as np
from sklearn.cluster import KMeans
from sklearn.preprocessing import StandardScaler
from sklearn.utils import check_random_state
from sklearn.utils.random import sample_without_replacement
from threadpoolctl import threadpool_limits

from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.parallel import ONE_THREAD
from skmtgp.model._nodes import compile_kernel, contract_inputs
from skmtgp.model.several import terms_of

CANDIDATES = 20_000  # rows
RESOLVED = 1e-14  # of the largest variance: less is rounding


def greedy_variance(
    kernel, X, n_inducing, *, sizes=None, n_candidates=CANDIDATES, random_state=None
):
    """Rows of X, each the one with the largest variance given those before.

    The pivoted Cholesky decomposition of k^x(X, X), broken off after `n_inducing`
    columns: it shrinks the trace term of the bound greedily. It takes
    O(n_candidates n_inducing^2) and n_inducing x n_candidates numbers, for each term.

    Parameters
    ----------
    kernel : Kernel or Kernels
        k^x with the hyperparameters at which the variances are. Those of several terms
        are summed.
    X : array-like of shape (n_samples, n_features)
        Inputs, which may be memory-mapped or a Dask array.
    n_inducing : int
        How many are wanted.
    sizes : ndarray of shape (n_terms,), default=None
        What the variances of each term count. None is the same for all.
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
    kernels, chosen, least = terms_of(kernel), [], 0.0
    most = min(n_inducing, len(X))
    sizes = np.ones(len(kernels)) if sizes is None else sizes
    pivoted = [Pivoted(of, X, most) for of in kernels]
    while len(chosen) < most:
        left = sum(size * of.told() for size, of in zip(sizes, pivoted, strict=True))
        pivot = np.argmax(left)
        least = least or RESOLVED * left[pivot]
        if not left[pivot] > least:
            break
        for of in pivoted:
            of.add(pivot)
        chosen.append(pivot)
    return X[chosen]


class Pivoted:
    """The pivoted Cholesky decomposition of a kernel's covariance, row by row.

    Parameters
    ----------
    kernel : Kernel
        With its hyperparameters.
    X : ndarray of shape (n_samples, n_features)
        Inputs.
    most : int
        Most rows that are added.
    """

    def __init__(self, kernel, X, most):
        self.kernel, self.X = kernel, X
        self.left = np.array(kernel.diag(X), dtype=float)
        self.least = RESOLVED * self.left.max()
        self.factor, self.n_rows = np.empty((most, len(X))), 0

    def told(self):
        """The variances that are left, and 0 where they are rounding."""
        return np.where(self.left > self.least, self.left, 0.0)

    def add(self, pivot):
        """Take the variances given one more input, if it has any left."""
        if self.left[pivot] <= self.least:
            return
        before, row = self.factor[: self.n_rows], self.factor[self.n_rows]
        row[:] = self.kernel(self.X[pivot : pivot + 1], self.X)[0]
        row -= before[:, pivot] @ before
        row /= np.sqrt(self.left[pivot])
        self.left -= np.square(row)
        self.left[pivot] = 0.0
        self.n_rows += 1


def _candidates(n, n_candidates, random_state):
    if n <= n_candidates:
        return slice(None)
    rng = check_random_state(random_state)  # in memory of those that are drawn
    return np.sort(sample_without_replacement(n, n_candidates, random_state=rng))


def k_means(X, n_inducing, *, n_candidates=CANDIDATES, random_state=None):
    """Means of clusters of rows, in which every feature counts as much.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Inputs, which may be memory-mapped or a Dask array. The distances are between
        features divided by their standard deviations.
    n_inducing : int
        Number of clusters.
    n_candidates : int, default=20000
        If X has more rows, as many of them are drawn, and the others are not looked
        at.
    random_state : int, RandomState instance or None, default=None
        For that, and for where scikit-learn's KMeans begins.

    Returns
    -------
    Z : ndarray of shape (n_chosen, n_features)
        The means; the rows themselves where no more than that many differ.
    """
    rng = check_random_state(random_state)
    X = np.ascontiguousarray(X[_candidates(len(X), n_candidates, rng)], dtype=float)
    scaler = StandardScaler()
    scaled = scaler.fit_transform(X)
    _, different = np.unique(scaled, axis=0, return_index=True)
    if len(different) <= n_inducing:
        return X[np.sort(different)]
    clusters = KMeans(n_inducing, random_state=rng)
    with ONE_THREAD, threadpool_limits(1, user_api="openmp"):  # sums in one order
        clusters.fit(scaled)
    return scaler.inverse_transform(clusters.cluster_centers_)


def optimised(bound, theta, *, max_iter=100, tol=1e-2):
    """Inducing inputs that make the bound higher, theta staying as it is.

    Parameters
    ----------
    bound : SparseBound
        Its inducing inputs are where the search by quasi-Newton steps begins.
    theta : ndarray of shape (n_theta,)
        Parameters.
    max_iter : int, default=100
        Most iterations.
    tol : float, default=1e-2
        Gain in nats under which the search ends.

    Returns
    -------
    Z : ndarray of shape (n_inducing, n_features)
        The best that were met. Never worse than those of `bound`.
    n_evaluations : int
        Bounds with their gradients that it took.

    Raises
    ------
    ValueError
        If the kernel's derivative by its inputs is not known.
    """
    scale = bound.Z.std(axis=0)
    scale[scale == 0.0] = 1.0

    def moved(steps):
        return bound.Z + scale * steps.reshape(bound.Z.shape)

    def objective(steps):
        value, _, d_Z = bound.with_inducing(moved(steps)).value_and_grads(theta)
        return -value, -np.ravel(scale * d_Z)

    start, anywhere = np.zeros(bound.Z.size), np.full(bound.Z.size, np.inf)
    best = minimize(objective, start, -anywhere, anywhere, max_iter=max_iter, tol=tol)
    return moved(best.x), best.n_evaluations


def check_differentiable(kernel, x):
    """Raise a ValueError where the kernel's derivative by its inputs is not known.

    Parameters
    ----------
    kernel : Kernel or Kernels
        k^x.
    x : ndarray of shape (1, n_features)
        An input.
    """
    one = slice(0, 1)
    for of_term in terms_of(kernel):
        bound = compile_kernel(of_term).bind(of_term.theta, x)
        _, tape = bound.block(one, one)
        contract_inputs(bound, np.zeros((1, 1)), tape, one, one, x.shape[1])
