"""The conjugate posterior of linear regression."""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from skmtgp._linalg import RESOLVED


class LinearPosterior:
    """Normal-inverse-gamma posterior of one regression.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Covariates without the constant.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.
    has_intercept : bool
        Whether a constant is one of the covariates.
    weight_variance : float
        Prior variance v of the weights relative to that of the noise.
    noise_shape, noise_rate : float
        Of the prior of the noise variance.
    """

    def __init__(
        self, features, Y, *, has_intercept, weight_variance, noise_shape, noise_rate
    ):
        self.has_intercept = has_intercept
        self.centre = np.zeros(features.shape[1])
        if self.has_intercept:
            self.centre = features.mean(axis=0)
        design = self._design(features)
        n, p = design.shape
        prior = self._root_of_prior(design, weight_variance)
        rows = np.block([[design, Y], [prior, np.zeros((p, Y.shape[1]))]])
        R = np.linalg.qr(rows, mode="r")
        self.root = R[:p, :p]  # V_n^{-1} = root^T root
        self.weights = solve_triangular(self.root, R[:p, p:])
        self.shape = noise_shape + 0.5 * n
        self.rate = noise_rate + 0.5 * np.square(R[p:, p:]).sum(axis=0)
        log_det = 2.0 * np.log(np.abs(np.diagonal(self.root))).sum()  # of V_n^{-1}
        self.log_evidence = (  # log density of Y, of shape (n_outputs,)
            gammaln(self.shape)
            - gammaln(noise_shape)
            + noise_shape * np.log(noise_rate)
            - self.shape * np.log(self.rate)
            - 0.5 * (log_det + p * np.log(weight_variance))
            - 0.5 * n * np.log(2.0 * np.pi)
        )

    def _design(self, features):
        """Covariates in columns, the constant last.

        They are centred: features far from zero are nearly collinear with the constant.
        """
        centred = features - self.centre
        if not self.has_intercept:
            return centred
        return np.column_stack([centred, np.ones(len(features))])

    def _root_of_prior(self, design, weight_variance):
        """A matrix B with B^T B = V_0^{-1}, for the weights of the centred covariates.

        The constant's weight is then the intercept plus centre @ coef.
        """
        B = np.eye(design.shape[1])
        if self.has_intercept:
            B[-1, :-1] = -self.centre
        B /= np.sqrt(weight_variance)
        # A prior that is flat beyond the digits of the data would leave the pivots of
        # collinear covariates to rounding.
        floor = RESOLVED * np.linalg.norm(design, axis=0)
        np.fill_diagonal(B, np.maximum(np.diagonal(B), floor))
        return B

    @property
    def coef(self):
        """Of shape (n_features, n_outputs)."""
        return self.weights[: len(self.centre)]

    @property
    def intercept(self):
        """Of shape (n_outputs,)."""
        if not self.has_intercept:
            return np.zeros(self.weights.shape[1])
        return self.weights[-1] - self.centre @ self.coef

    @property
    def noise_variance(self):
        """Posterior mean of sigma^2, of shape (n_outputs,)."""
        if self.shape <= 1.0:
            return np.full_like(self.rate, np.inf)
        return self.rate / (self.shape - 1.0)

    def mean(self, features):
        """Of f, of shape (n_samples, n_outputs)."""
        return self._design(features) @ self.weights

    def variances(self, features):
        """Of f in units of sigma^2, of shape (n_samples,)."""
        return np.square(self._half(features)).sum(axis=0)

    def covariances(self, features):
        """Of f in units of sigma^2, of shape (n_samples, n_samples)."""
        half = self._half(features)
        return half.T @ half

    def _half(self, features):
        """A matrix H with H^T H = X V_n X^T."""
        return solve_triangular(self.root, self._design(features).T, trans="T")

    def draw(self, features, n_draws, rng):
        """Draws of f and of sigma.

        Parameters
        ----------
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
        size = *self.weights.shape, n_draws
        precision = rng.gamma(self.shape, size=size[1:]) / self.rate[:, None]
        normal = rng.standard_normal(size) / np.sqrt(precision)
        deviation = solve_triangular(self.root, normal.reshape(size[0], -1))
        weights = self.weights[..., None] + deviation.reshape(size)
        draws = np.tensordot(self._design(features), weights, 1)
        return draws, 1.0 / np.sqrt(precision)
