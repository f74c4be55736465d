"""The conjugate posteriors of linear regressions, all of them together."""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln
from sklearn.utils import gen_batches

from skmtgp._numerics.linalg import RESOLVED

BLOCK_SIZE = 2**20  # elements of the designs that are decomposed together


class LinearPosterior:
    """Normal-inverse-gamma posteriors of regressions with the same prior.

    Those with equally many samples are computed together: linear algebra on stacks of
    matrices, of which there are never more than the square root of twice the samples.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Covariates without the constant.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.
    which : ndarray of shape (n_samples,)
        The regression of each sample, from 0; each has one or more.
    has_intercept : bool
        Whether a constant is one of the covariates.
    weight_variance : float
        Prior variance v of the weights relative to that of the noise.
    noise_shape, noise_rate : float
        Of the prior of the noise variance.

    Attributes
    ----------
    centre : ndarray of shape (n_regressions, n_features)
        What the covariates are taken off.
    root : ndarray of shape (n_regressions, n_weights, n_weights)
        Upper triangular, V_n^{-1} = root^T root.
    weights : ndarray of shape (n_regressions, n_weights, n_outputs)
        Posterior means, of the centred covariates.
    shape : ndarray of shape (n_regressions,)
        a_n.
    rate : ndarray of shape (n_regressions, n_outputs)
        b_n.
    log_evidence : ndarray of shape (n_regressions, n_outputs)
        Log density of Y.
    """

    def __init__(
        self,
        features,
        Y,
        which,
        *,
        has_intercept,
        weight_variance,
        noise_shape,
        noise_rate,
    ):
        counts, d = np.bincount(which), features.shape[1]
        n, J, p = len(counts), Y.shape[1], d + has_intercept
        self.has_intercept = has_intercept
        self.centre, self.root = np.zeros((n, d)), np.empty((n, p, p))
        self.weights, self.rate = np.empty((n, p, J)), np.empty((n, J))
        self.shape = noise_shape + 0.5 * counts
        for some, rows in stacks(which, p + J):
            self._learn(some, features[rows], Y[rows], weight_variance)
        self.rate += noise_rate
        diagonals = np.diagonal(self.root, axis1=1, axis2=2)
        log_det = 2.0 * np.log(np.abs(diagonals)).sum(axis=1)  # of V_n^{-1}
        self.log_evidence = (
            noise_shape * np.log(noise_rate)
            - gammaln(noise_shape)
            - (self.shape[:, None] * np.log(self.rate))
        )
        self.log_evidence += (
            gammaln(self.shape)
            - 0.5 * (log_det + p * np.log(weight_variance))
            - 0.5 * counts * np.log(2.0 * np.pi)
        )[:, None]

    def _learn(self, some, features, Y, weight_variance):
        """The posteriors of some regressions, each with k samples in a row."""
        if self.has_intercept:
            self.centre[some] = features.mean(axis=1)
        design = self._design(some, features)
        n, k, p = design.shape
        rows = np.zeros((n, k + p, p + Y.shape[2]))
        rows[:, :k, :p], rows[:, :k, p:] = design, Y
        rows[:, k:, :p] = self._root_of_prior(some, design, weight_variance)
        R = np.linalg.qr(rows, mode="r")
        self.root[some] = R[:, :p, :p]
        # Upper triangular: no pivots are looked for, and back substitution is left.
        self.weights[some] = np.linalg.solve(R[:, :p, :p], R[:, :p, p:])
        self.rate[some] = 0.5 * np.square(R[:, p:, p:]).sum(axis=1)

    def _design(self, some, features):
        """Covariates in columns, the constant last, of shape (len(some), k, p).

        They are centred: features far from zero are nearly collinear with the constant.
        """
        centred = features - self.centre[some][:, None]
        if not self.has_intercept:
            return centred
        return np.concatenate([centred, np.ones((*centred.shape[:2], 1))], axis=2)

    def _root_of_prior(self, some, design, weight_variance):
        """Matrices B with B^T B = V_0^{-1}, for the weights of the centred covariates.

        The constant's weight is then the intercept plus centre @ coef.
        """
        n, _, p = design.shape
        B = np.tile(np.eye(p), (n, 1, 1))
        if self.has_intercept:
            B[:, -1, :-1] = -self.centre[some]
        B /= np.sqrt(weight_variance)
        # A prior that is flat beyond the digits of the data would leave the pivots of
        # collinear covariates to rounding.
        floor = RESOLVED * np.linalg.norm(design, axis=1)
        diagonal = np.arange(p)
        B[:, diagonal, diagonal] = np.maximum(B[:, diagonal, diagonal], floor)
        return B

    @property
    def coef(self):
        """Of shape (n_regressions, n_features, n_outputs)."""
        return self.weights[:, : self.centre.shape[1]]

    @property
    def intercept(self):
        """Of shape (n_regressions, n_outputs)."""
        if not self.has_intercept:
            return np.zeros_like(self.rate)
        return self.weights[:, -1] - np.einsum("rd,rdj->rj", self.centre, self.coef)

    @property
    def noise_variance(self):
        """Posterior mean of sigma^2, of shape (n_regressions, n_outputs)."""
        above, infinite = self.shape[:, None] - 1.0, np.full_like(self.rate, np.inf)
        return np.divide(self.rate, above, out=infinite, where=above > 0.0)

    def mean(self, features, which):
        """Of f, of shape (n_samples, n_outputs)."""
        means = np.empty((len(features), self.rate.shape[1]))
        for some, rows in self._stacks(which):
            means[rows] = self._design(some, features[rows]) @ self.weights[some]
        return means

    def variances(self, features, which):
        """Of f in units of sigma^2, of shape (n_samples,)."""
        variances = np.empty(len(features))
        for some, rows in self._stacks(which):
            variances[rows] = np.square(self._half(some, features[rows])).sum(axis=1)
        return variances

    def covariances(self, features, which):
        """Of f in units of sigma^2, those of some regressions at a time.

        Yields
        ------
        some : ndarray of shape (n_some,)
            Regressions that have equally many rows.
        rows : ndarray of shape (n_some, k)
            Their rows.
        covariances : ndarray of shape (n_some, k, k)
            Between the rows of each.
        """
        for some, rows in self._stacks(which):
            half = self._half(some, features[rows])
            yield some, rows, half.transpose(0, 2, 1) @ half

    def _stacks(self, which):
        return stacks(which, sum(self.weights.shape[1:]))

    def _half(self, some, features):
        """Matrices H with H^T H = X V_n X^T, their rows in the opposite order."""
        turned = self.root[some].transpose(0, 2, 1)[:, ::-1, ::-1]  # upper triangular
        design = self._design(some, features).transpose(0, 2, 1)
        return np.linalg.solve(turned, design[:, ::-1])

    def draw(self, r, features, n_draws, rng):
        """Draws of f and of sigma of one regression.

        Parameters
        ----------
        r : int
            Which of them.
        features : ndarray of shape (n_samples, n_features)
            Covariates without the constant.
        n_draws : int
            Number of draws.
        rng : RandomState
            Source of randomness.

        Returns
        -------
        draws : ndarray of shape (n_samples, n_outputs, n_draws)
            Draws of f.
        noise_std : ndarray of shape (n_outputs, n_draws)
            Standard deviation of the noise that was drawn with each.
        """
        size = *self.weights.shape[1:], n_draws
        precision = rng.gamma(self.shape[r], size=size[1:]) / self.rate[r, :, None]
        normal = rng.standard_normal(size) / np.sqrt(precision)
        deviation = solve_triangular(self.root[r], normal.reshape(size[0], -1))
        weights = self.weights[r, ..., None] + deviation.reshape(size)
        [design] = self._design([r], features[None])
        return np.tensordot(design, weights, 1), 1.0 / np.sqrt(precision)


def stacks(codes, width):
    """Rows of the codes that have equally many, to be computed together.

    Parameters
    ----------
    codes : ndarray of shape (n_samples,)
        Integers from 0.
    width : int
        Of what is computed of each row, which bounds how many rows come at a time.

    Yields
    ------
    some : ndarray of shape (n_some,)
        Codes that k rows have, ascending.
    rows : ndarray of shape (n_some, k)
        Positions of their rows.
    """
    order, counts = np.argsort(codes, kind="stable"), np.bincount(codes)
    starts = np.cumsum(counts) - counts
    for k in np.unique(counts[counts > 0]):
        equal = np.flatnonzero(counts == k)
        for batch in gen_batches(len(equal), max(1, BLOCK_SIZE // (k * width))):
            yield equal[batch], order[starts[equal[batch], None] + np.arange(k)]
