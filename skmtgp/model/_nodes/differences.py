"""Differences of inputs, in length-scales and in tiles, without cancellation."""

from copy import copy
from functools import cached_property

import numpy as np
from scipy.spatial.distance import cdist

NARROW = 1e4  # |z|^2 of which the rounding, 3 eps |z|^2, is harmless: less than 1e-11
NEAR = 1e-2  # distance / |z| at which it is harmless even relative to its square
FAR = 1e300  # squares: larger ones count as that
MANY = 2**14  # pairs at a time
NONE = np.arange(0)


class Differences:
    """z - z' for tiles of two sets of rows, z = x / l.

    Their squares, |z|^2 + |z'|^2 - 2 z . z', are one product of matrices, the fastest
    way by far. Its rounding is relative to |z|^2, not to the distance: harmless for
    features that are not too many length-scales wide. Of the others x - x' comes first,
    which is exact for inputs close to each other; x / l and x' / l are rounded already.

    Parameters
    ----------
    X : ndarray of shape (n_samples, n_features)
        Both sets of rows. `against` puts others in place of the first.
    length_scale : float or ndarray of shape (n_features,)
        l.
    steep : bool, default=False
        Whether the kernel's slope by the square has a pole at zero. Rounding of small
        squares then shows, and they are computed pair by pair.

    Attributes
    ----------
    narrow, wide : slice or ndarray of shape (n_narrow,), ndarray of shape (n_wide,)
        Features whose squares are products, and the others.
    groups : sequence of ndarray
        Wide features that share a length-scale.
    left, right : ndarray of shape (n_samples, n_narrow + 2)
        -1/2 |z - z'|^2 = z . z' - |z|^2 / 2 - |z'|^2 / 2 as one product of rows.
    across : ndarray of shape (n_narrow + 2, n_samples)
        The second, column after column: the product of a tile takes a fifth less.
    near : float
        Distance below which pairs are computed one by one.
    """

    def __init__(self, X, length_scale, *, steep=False):
        self.sets, self.l = (X, X), length_scale
        # there is less to cancel in centred rows; half the time of X.mean
        self.center = np.add.reduce(X, axis=0) / len(X)
        self.narrow, self.wide, self.groups = slice(None), NONE, ()
        self.left = self._factor(X)
        if not self._largest_square() <= NARROW:  # it may be nan
            self._set_wide()
        self.near = NEAR * np.sqrt(self._largest_square()) if steep else 0.0
        self.right = self.left.copy()
        self.right[:, -2], self.right[:, -1] = 1.0, self.left[:, -2]
        self.across = self.right.T.copy()

    def _set_wide(self):
        """Leave no more features to products than are narrow together."""
        X = self.sets[1]
        self.narrow, self.wide = _split(self._centred(X))
        if len(self.wide):  # a group of them for each length-scale
            self.groups = self.wide[:, None] if np.ndim(self.l) else self.wide[None]
        self.l = np.where(np.greater(self.l, 0.0), self.l, np.nan)  # exp(theta) was 0
        self.left = self._factor(X)

    def _centred(self, X):
        return (X - self.center) / self.l

    def _factor(self, X):
        z = self._centred(X)
        if len(self.wide):
            z = z[:, self.narrow]
        factor, half = np.empty((len(z), z.shape[1] + 2)), np.einsum("id,id->i", z, z)
        factor[:, :-2], factor[:, -1] = z, 1.0
        half *= -0.5
        np.maximum(half, -FAR, out=factor[:, -2])
        return factor

    def _largest_square(self):
        return -2.0 * self.left[:, -2].min()

    def against(self, Z):
        """The same between rows of Z and of X.

        Where z' is narrow, the rounding of a large |z|^2 is relative to the distance.
        """
        other = copy(self)
        other.sets, other.left = (Z, self.sets[1]), self._factor(Z)
        return other

    @cached_property
    def zeros(self):
        """As many as there are columns."""
        return np.zeros(len(self.sets[1]))

    @cached_property
    def squares(self):
        """z'^2 of the columns' narrow features."""
        return np.square(self.right[:, :-2])

    def exponents(self, rows, cols):
        """-1/2 |z - z'|^2 of a tile.

        Returns
        -------
        e : ndarray of shape (n_rows, n_columns)
            The tile.
        near : ndarray of shape (n_near,)
            Positions in the tile of the pairs that are near.
        """
        e = np.matmul(self.left[rows], self.across[:, cols])
        if not e.max() <= 0.0:  # which takes a third of the time of the minimum
            np.minimum(e, self.zeros[cols], out=e)  # twice as long with a scalar
        if len(self.wide):
            e -= self._half_squares(rows, cols, self.wide)
        if self.sets[0] is self.sets[1] and rows.start == cols.start:
            e.flat[:: e.shape[1] + 1] = 0.0
        if not self.near:
            return e, NONE
        near = np.flatnonzero(e > -0.5 * self.near**2)
        for pairs, apart in self._of_pairs(near, rows, cols):
            e.flat[pairs] = -0.5 * np.square(apart).sum(axis=1)
        return e, near

    @property
    def are_products(self):
        """Whether all squares of differences are products of matrices."""
        return not (self.near or len(self.wide))

    def exponents_within(self, places):
        """-1/2 |z - z'|^2 between the rows of each part, if all are products.

        Parameters
        ----------
        places : ndarray of shape (n_parts, size)
            Rows.

        Returns
        -------
        e : ndarray of shape (n_parts, size, size)
        """
        e = np.matmul(self.left[places], self.right[places].swapaxes(1, 2))
        np.minimum(e, 0.0, out=e)
        np.einsum("kii->ki", e)[...] = 0.0
        return e

    def contract_within(self, V, places):
        """The sum over all parts of V (z - z')^2, as `contract`."""
        z, VZ = self.left[places, :-2], V @ self.right[places, :-1]
        both = (VZ[..., -1] + V.sum(axis=1)).ravel()
        sums = both @ self.squares[places].reshape(len(both), -1)
        sums -= 2.0 * np.einsum("kid,kid->d", z, VZ[..., :-1])
        return sums

    def _half_squares(self, rows, cols, features):
        """Half the sum over some features of (z - z')^2, for all pairs."""
        # in units of a power of two, to divide by which is exact: no square overflows
        scales = np.broadcast_to(self.l, self.sets[1].shape[1])[features]
        mantissa, exponent = np.frexp(scales)
        of_tile = zip(self.sets, (rows, cols), strict=True)
        pair = (np.ldexp(X[of][:, features], -exponent) for X, of in of_tile)
        squares = cdist(*pair, "sqeuclidean", w=0.5 / mantissa**2)
        return np.minimum(squares, FAR, out=squares)

    def _of_pairs(self, near, rows, cols):
        """Some of the pairs at a time, and their z - z', (n_pairs, n_features)."""
        Z, X = self.sets
        for a in range(0, len(near), MANY):
            pairs = near[a : a + MANY]
            i, j = np.divmod(pairs, cols.stop - cols.start)
            yield pairs, (Z[rows][i] - X[cols][j]) / self.l

    def contract(self, V, near, rows, cols):
        """Sum over a tile of V (z - z')^2.

        Parameters
        ----------
        V : ndarray of shape (n_rows, n_columns)
            Weights; overwritten.
        near : ndarray of shape (n_near,)
            Positions of the pairs that are near.
        rows, cols : slice
            The tile.

        Returns
        -------
        sums : ndarray of shape (n_features,)
            By feature; of features that share a length-scale only the total counts.
        """
        sums, of_near = np.zeros(self.sets[1].shape[1]), 0.0
        for features in self.groups:
            halves = self._half_squares(rows, cols, features)
            sums[features[0]] = 2.0 * np.vdot(V, halves)
        for pairs, apart in self._of_pairs(near, rows, cols):
            of_near = of_near + V.flat[pairs] @ np.square(apart[:, self.narrow])
            V.flat[pairs] = 0.0
        # sum_ij V_ij (z_i - z_j)^2 = z^2' V 1 + 1' V z^2 - 2 z' V z for each feature
        zi, VZ = self.left[rows, :-2], V @ self.right[cols, :-1]  # last, its row sums
        of_columns = self.left[rows, -1] @ V  # of ones; faster than V.sum
        of_narrow = VZ[:, -1] @ np.square(zi) + of_columns @ self.squares[cols]
        of_narrow -= 2.0 * np.einsum("id,id->d", zi, VZ[:, :-1])
        sums[self.narrow] = of_narrow + of_near
        return sums

    def contract_rows(self, V, near, rows, cols):
        """sum_j V_ij (z'_j - z_i) for each row i, of shape (n_rows, n_features).

        The parameters are those of `contract`.
        """
        (Z, X), sums = self.sets, np.empty((len(V), self.sets[1].shape[1]))
        scales = np.broadcast_to(self.l, X.shape[1])
        for d in self.wide:
            apart = np.subtract.outer(Z[rows, d], X[cols, d]) / -scales[d]
            sums[:, d] = np.einsum("ij,ij->i", V, apart)
        of_near = np.zeros_like(sums)
        for pairs, apart in self._of_pairs(near, rows, cols):
            weighed = V.flat[pairs][:, None] * apart
            np.subtract.at(of_near, pairs // V.shape[1], weighed)
            V.flat[pairs] = 0.0
        VZ = V @ self.right[cols, :-1]
        of_narrow = VZ[:, :-1] - VZ[:, -1:] * self.left[rows, :-2]
        sums[:, self.narrow] = of_narrow + of_near[:, self.narrow]
        return sums


def _split(z):
    """As many features as are narrow together, and the others."""
    with np.errstate(over="ignore"):
        reach = np.square(z).max(axis=0)
    order = np.argsort(reach)
    n_narrow = np.searchsorted(np.cumsum(reach[order]), NARROW, side="right")
    return np.sort(order[:n_narrow]), np.sort(order[n_narrow:])


def append(X, *columns):
    """X with further columns, each given as an array or a number."""
    appended = np.empty((*X.shape[:-1], X.shape[-1] + len(columns)))
    appended[..., : X.shape[-1]] = X
    for k, column in enumerate(columns, start=X.shape[-1]):
        appended[..., k] = column
    return appended
