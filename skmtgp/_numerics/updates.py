"""Cholesky factors of matrices that get more rows, or fewer.

A new row and column of K border its factor, which takes O(n^2); those that go leave a
factor with columns to spare, which a QR decomposition makes a triangle again, in O(n^2)
too. Borders cost no digits: they are what a decomposition of all rows would compute.
What goes adds an error of the size of rounding each time, so that a factor is better
made anew after as many rows as it has.
"""

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dtpqrt

from skmtgp._numerics.linalg import Cholesky, invert_triangle

PANEL = 32  # columns at a time, which is fastest


class UpdatedCholesky(Cholesky):
    """The factor of K whose rows are in an order of their own: K = F F^T.

    Parameters
    ----------
    factor : ndarray of shape (n, n), Fortran-ordered
        R, an upper triangle, whose diagonal may be negative; below it is anything.
    order : ndarray of shape (n,)
        The row of K that each column of R is: R^T R = K[order][:, order].
    n_dropped : int, default=0
        How many rows have gone since all were factorised.
    diagonal : ndarray of shape (n,), default=None
        That of K^{-1}, where it is known.

    Notes
    -----
    Its methods are those of a Cholesky, with F in the place of C, which is R^T with its
    rows in the order of K's. It cannot be inverted in place.
    """

    def __init__(self, factor, order, n_dropped=0, diagonal=None):
        self._factor, self.order = factor, order
        self.n_dropped, self.diagonal = n_dropped, diagonal

    @classmethod
    def of(cls, cholesky):
        """A factor in the order of K's rows, so that it can be updated."""
        if isinstance(cholesky, cls):
            return cholesky
        R = np.asfortranarray(cholesky.factor.T)
        return cls(R, np.arange(len(R)))

    def log_det(self):
        """Log-determinant of K."""
        return 2.0 * np.log(np.abs(np.diagonal(self.factor))).sum()

    def half_solve(self, b, *, transposed=False):
        """F^{-1} b, or F^{-T} b."""
        if not transposed:
            return self._solve_triangle(b[self.order], transposed=False)
        solved = self._solve_triangle(b, transposed=True)
        found = np.empty_like(solved)
        found[self.order] = solved
        return found

    def _solve_triangle(self, b, *, transposed):
        """R^{-T} b, or R^{-1} b, see `Cholesky.half_solve`."""
        if b.ndim == 1:
            return dtrsv(self.factor, b, lower=0, trans=not transposed)
        options = {"side": 1, "lower": 0, "trans_a": transposed}
        return dtrsm(1.0, self.factor, b.T, **options).T

    def invert(self):
        """Not possible: the rows are in another order."""
        raise NotImplementedError("an updated factor cannot be inverted in place")

    def inverse_diagonal(self):
        """Diagonal of K^{-1}, computed from the factor, which stays."""
        half = invert_triangle(np.array(self.factor.T, order="F"))
        found = np.empty(len(self.order))
        for j, row in enumerate(self.order):  # above the diagonal is anything
            found[row] = half[j:, j] @ half[j:, j]
        return found

    def kept_diagonal(self):
        """The same in O(n^3) once, and then kept up to date with the factor.

        It loses digits where rows go, slowly.
        """
        if self.diagonal is None:
            self.diagonal = self.inverse_diagonal()
        return self.diagonal

    def bordered(self, places, cross, corner):
        """The factor with more rows.

        Parameters
        ----------
        places : ndarray of shape (n_new,)
            Where the new rows are among all, ascending.
        cross : ndarray of shape (n, n_new)
            K between the rows so far and the new ones.
        corner : ndarray of shape (n_new, n_new)
            K between the new ones; only the lower triangle is read.

        Returns
        -------
        cholesky : UpdatedCholesky

        Raises
        ------
        NotPositiveDefiniteError
            If the larger matrix is not positive definite.
        """
        n, total = len(self.order), len(self.order) + len(places)
        half = self.half_solve(cross)
        own = Cholesky(np.asfortranarray(corner - half.T @ half))
        factor = np.empty((total, total), order="F")
        factor[:n, :n], factor[:n, n:], factor[n:, n:] = self.factor, half, own.factor.T
        others = np.delete(np.arange(total), places)
        diagonal = None
        if self.diagonal is not None:
            # of K^{-1} bordered: K^{-1} + P S^{-1} P^T and S^{-1}, with P = K^{-1} B
            P = own.half_solve(self.half_solve(half, transposed=True).T)
            diagonal = np.empty(total)
            diagonal[others] = self.diagonal + np.square(P).sum(axis=0)
            diagonal[places] = own.inverse_diagonal()
        order = np.append(others[self.order], places)
        return UpdatedCholesky(factor, order, self.n_dropped, diagonal)

    def without(self, rows):
        """The factor with fewer rows.

        Parameters
        ----------
        rows : ndarray of shape (n_dropped,)
            Those of K that go.

        Returns
        -------
        cholesky : UpdatedCholesky
        """
        goes = np.isin(self.order, rows)
        kept, dropped = np.flatnonzero(~goes), np.flatnonzero(goes)
        # K of the others is R^T R + B^T B: a triangle, and rows to spare
        B = np.where(kept > dropped[:, None], self.factor[np.ix_(dropped, kept)], 0.0)
        R = self.factor.T[np.ix_(kept, kept)].T
        options = {"overwrite_a": 1, "overwrite_b": 1}
        factor = dtpqrt(0, min(PANEL, len(kept)), R, B, **options)[0]
        order = self.order[kept]
        order = order - np.searchsorted(np.sort(rows), order)
        n_dropped, diagonal = self.n_dropped + len(rows), None
        if self.diagonal is not None:
            told = np.square(self.columns_of_inverse(rows)).sum(axis=1)
            diagonal = np.delete(self.diagonal - told, rows)
        return UpdatedCholesky(factor, order, n_dropped, diagonal)

    def columns_of_inverse(self, rows):
        """V of shape (n, n_rows), with V V^T what these rows give to K^{-1}.

        K^{-1} less V V^T is, in the other rows and columns, the inverse of K without
        these rows.
        """
        columns = self.solve(np.equal.outer(np.arange(len(self.order)), rows) * 1.0)
        own = Cholesky(np.asfortranarray(columns[rows]))
        return own.half_solve(columns.T).T
