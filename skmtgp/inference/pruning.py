"""Which rows tell least of the functions, given all the others."""

import numpy as np

from skmtgp._numerics.updates import UpdatedCholesky

TINY = np.finfo(np.float64).tiny


def least_informative(posteriors, n_rows):
    r"""The rows that go first, one after another, each given those that are left.

    What a target tells of f, given the others, is the mutual information
    :math:`-\tfrac12 \log(\sigma_i^2 [K^{-1}]_{ii})`: half the logarithm of how much
    larger its variance given the others is than its noise. It does not depend on the
    targets.

    Parameters
    ----------
    posteriors : list of n_outputs DensePosterior
        Of the same rows. What the outputs tell is added.
    n_rows : int
        How many rows are to go.

    Returns
    -------
    rows : ndarray of shape (n_rows,)
        Of the posteriors. The last row of a task is never among them.

    Notes
    -----
    O(n^2) a row and output, once [K^{-1}]_ii is there, which takes O(n^3) where it is
    not kept.
    """
    tasks, parts = posteriors[0].tasks, list(map(Redundancy, posteriors))
    left, rows = np.bincount(tasks), []
    for _ in range(n_rows):
        told = np.sum([part.information() for part in parts], axis=0)
        told[rows], told[left[tasks] == 1] = np.inf, np.inf
        row = int(np.argmin(told))
        rows.append(row)
        left[tasks[row]] -= 1
        for part in parts:
            part.drop(row)
    return np.array(rows, dtype=int)


class Redundancy:
    """What each row tells, given the others that are left.

    Parameters
    ----------
    posterior : DensePosterior
        Of all rows.
    """

    def __init__(self, posterior):
        self.cholesky = UpdatedCholesky.of(posterior.cholesky)
        self.noise = posterior.noise + posterior.jitter
        self.precision = self.cholesky.kept_diagonal().copy()
        self.dropped = []

    def information(self):
        """In nats; infinite or nan where rows are dropped already."""
        share = np.clip(self.noise * self.precision, TINY, 1.0)
        return -0.5 * np.log(share)

    def drop(self, row):
        """Leave a row out: K^{-1} is less by a matrix of rank 1."""
        unit = np.zeros(len(self.precision))
        unit[row] = 1.0
        column = self.cholesky.solve(unit)
        for other in self.dropped:
            column -= other[row] * other
        column /= np.sqrt(max(column[row], TINY))
        self.precision -= np.square(column)
        self.dropped.append(column)
