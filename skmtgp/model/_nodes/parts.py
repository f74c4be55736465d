"""Rows in parts that are related to themselves alone, such as those of each task."""

from functools import cached_property

import numpy as np


class Parts:
    """Consecutive rows in parts, whose matrices are stacked, those of few rows padded.

    Parameters
    ----------
    codes : ndarray of shape (n_rows,)
        The part of each row, ascending; parts without rows are left out.

    Attributes
    ----------
    codes : ndarray of shape (n_parts,)
        The parts that have rows.
    slices : list of slice
        Where the rows of each are.
    counts : ndarray of shape (n_parts,)
        How many it has.
    shape : tuple of (n_parts, size, size)
        Of stacked matrices.
    places : ndarray of shape (n_parts, size)
        The rows of each, then its first row as often as there is nothing.
    """

    def __init__(self, codes):
        self.codes, starts = np.unique(codes, return_index=True)
        self.counts = np.diff([*starts.tolist(), len(codes)])
        self.slices = [
            slice(start, start + count)
            for start, count in zip(starts.tolist(), self.counts.tolist(), strict=True)
        ]
        size = int(self.counts.max())
        self.shape = len(starts), size, size
        within = np.arange(size)
        self.there = within < self.counts[:, None]
        self.places = starts[:, None] + np.where(self.there, within, 0)

    @cached_property
    def upper(self):
        """One in the upper triangles, the diagonals included; zero where nothing is."""
        there = self.there[:, :, None] & self.there[:, None, :]
        return there * np.triu(np.ones(self.shape[1:]))

    @cached_property
    def halves(self):
        """The same with one half on the diagonals."""
        return self.upper * (1.0 - 0.5 * np.eye(self.shape[1]))

    def zeros(self):
        """Stacked matrices of zeros."""
        return np.zeros(self.shape)

    def stacked(self, matrices):
        """The blocks of matrices of all rows, of shape (..., n_parts, size, size)."""
        rows, columns = self.places[:, :, None], self.places[:, None]
        return matrices[..., rows, columns]

    def padded(self, of_rows, rest):
        """Numbers of the rows, stacked, of shape (n_parts, size)."""
        stacked = np.full(self.shape[:2], rest)
        stacked[self.there] = of_rows
        return stacked
