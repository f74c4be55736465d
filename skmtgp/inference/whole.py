"""K of few rows, which is one tile: filled and contracted by fewer, larger calls."""

import numpy as np

MOST_TASKS = 24  # of more tasks sums by task are not products with a matrix of ones


class Whole:
    """Sums over all pairs of rows, of which each call of numpy takes all at once.

    What is below the diagonal is computed and not used: with some hundred rows that
    takes less time than to leave it out.

    Parameters
    ----------
    tasks : ndarray of shape (n_rows,)
        Task of each row, ascending.
    n_tasks : int
        All of them, also those without rows.

    Attributes
    ----------
    rows : slice
        All rows.
    upper : ndarray of shape (n_rows, n_rows)
        One in the upper triangle and on the diagonal, zero below.
    of_tasks : ndarray of shape (n_rows, n_tasks)
        One where a row is of a task, zero elsewhere.
    same : ndarray of shape (n_rows, n_rows)
        One between rows of the same task, zero elsewhere.
    """

    def __init__(self, tasks, n_tasks):
        self.tasks, n = np.asarray(tasks), len(tasks)
        self.rows, self.upper = slice(0, n), np.triu(np.ones((n, n)))
        self.of_tasks = np.equal.outer(self.tasks, np.arange(n_tasks)).astype(float)
        self.same = self.of_tasks @ self.of_tasks.T

    def fill(self, bound, K_rho, level, K, new):
        """Put the covariance without noise in K.

        Parameters
        ----------
        bound : BoundSeveral
            k^x of each term.
        K_rho : ndarray of shape (n_terms, n_tasks, n_tasks)
            K^rho of each term.
        level : float
            The levels' variance.
        K : ndarray of shape (n_rows, n_rows)
            Where it is put: both triangles.
        new : callable
            Gives arrays that last until the gradient.

        Returns
        -------
        kept : tuple
            Values of k^x, their tapes and K^rho between the rows, each a sequence of
            the terms': what `contract` takes.
        """
        K_x, tapes = bound.block(self.rows, self.rows, new)
        W = [of.take(self.tasks, axis=1).take(self.tasks, axis=0) for of in K_rho]
        np.multiply(K_x[0], W[0], out=K)
        for of_term, between in zip(K_x[1:], W[1:], strict=True):
            K += between * of_term
        if level:
            K += level * self.same
        return K_x, tapes, W

    def contract(self, bound, kept, G, *, levels):
        """Gradients by the kernel's theta, K^rho of each term and the levels' variance.

        Parameters
        ----------
        bound, kept
            See `fill`.
        G : ndarray of shape (n_rows, n_rows)
            K^{-1} - alpha alpha^T with half the diagonal; below it is anything finite.
            Overwritten.
        levels : bool
            Whether there are levels.

        Returns
        -------
        d_kernel : ndarray of shape (n_dims,)
        D : ndarray of shape (n_terms, n_tasks, n_tasks)
        d_level : float
        """
        (K_x, tapes, W), ones = kept, self.of_tasks
        G *= self.upper
        d_level = -float(np.vdot(G, self.same)) if levels else 0.0
        D = [ones.T @ ((G * of_term) @ ones) for of_term in K_x]
        D = -0.5 * np.array([of + of.T for of in D])
        for weights in W:
            weights *= G
        return -bound.contract(W, tapes, self.rows, self.rows), D, d_level
