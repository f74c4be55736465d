r"""Weak priors of the hyperparameters, relative to the scales of the data.

Logarithms of length-scales, of other parameters of k^x and of variances are normal
around where learning starts, which is where the user, or the size of the data, puts it;
those of length-scales around half, and those of noise around three times that value.
Where each feature has its own length-scale, it may not be needed: with a probability
the logarithm is normal around a length-scale that is far longer.
The factor F of K^rho has a direction and an amplitude: the direction is uniform, so
that no rotation of F is preferred, and the logarithm of the amplitude, the root mean
square over tasks of the deviation :math:`\sqrt{K^\rho_{mm}}`, is normal around that of
the targets.
"""

from functools import cached_property

import numpy as np
from scipy.special import gammaln, ndtr, ndtri

# Deviations of logarithms, around the centres below. In 95 of 100 cases length-scales
# are within a factor of twenty, variances of fifty, so that noise may be more than the
# rest or almost none, and the amplitude within seven times the targets' deviation.
OF_KERNEL, OF_VARIANCE, OF_AMPLITUDE = 1.5, 2.0, 1.0
# Times where learning starts: it finds its way from smooth functions and little noise,
# but few rows by themselves take both to be so too easily (benchmarks/intervals.py).
SHORTER, NOISIER = 0.5, 3.0
# Of d features with a length-scale each, this share of d - 1 may not be needed. Their
# length-scales are longer, by two deviations, so that the sum of both densities has one
# top. Otherwise many features that tell nothing would make functions rough.
NOT_NEEDED, LONGER = 0.5, 2.0 * OF_KERNEL
SHARE = 0.3  # of the targets' variance, around which parts of K^rho are


class Hyperprior:
    """Weak prior of theta.

    Parameters
    ----------
    prior : Prior
        The model, whose starting values it is around.
    held : ndarray of bool of shape (n_theta,), default=False
        Which logarithms are not learned, beside those that the prior holds.

    Attributes
    ----------
    centre, precision : ndarray of shape (n_theta,)
        Of the logarithms; the precision is 0 where theta is a factor, or held.
    not_needed : ndarray of shape (n_theta,)
        Probability that the logarithm is around the centre plus `LONGER` instead.
    free : ndarray of bool of shape (n_theta,)
        Whether a parameter is learned.
    """

    def __init__(self, prior, held=False):
        self.prior = prior
        self.free = np.not_equal(*prior.bounds()) & ~np.asarray(held)
        self.centre = prior.centre(np.log(SHARE * prior.scale**2))
        self.centre[self.free & prior.of_length_scales] += np.log(SHORTER)
        self.centre[self.free & prior.of_noise] += np.log(NOISIER)
        width = np.where(prior.of_kernel, OF_KERNEL, OF_VARIANCE)
        logarithms = self.free & ~prior.of_factor
        self.precision = np.where(logarithms, width**-2.0, 0.0)
        others = 1.0 - 1.0 / np.maximum(prior.n_length_scales, 1)
        self.not_needed = NOT_NEEDED * others * logarithms

    @cached_property
    def log_constant(self):
        """Of the density with respect to logarithms and directions on the sphere."""
        logs = self.precision > 0.0
        root, ends = np.sqrt(self.precision[logs]), self.prior.bounds()[:, logs]
        away, share = ends - self.centre[logs], self.not_needed[logs]
        near, far = (
            np.diff(ndtr(root * of), axis=0)[0] for of in (away, away - LONGER)
        )
        inside = near + share * (far - near)
        constant = np.log(root / np.sqrt(2.0 * np.pi) / inside).sum()
        size = self.prior.of_factor.sum()
        if size:
            sphere = np.log(2.0) + 0.5 * size * np.log(np.pi) - gammaln(0.5 * size)
            constant -= sphere + np.log(OF_AMPLITUDE * np.sqrt(2.0 * np.pi))
        return float(constant)

    def log_density(self, theta):
        """Log density but for its constant, and its gradient.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        value : float
            At most zero. The density is with respect to the logarithms, that of the
            amplitude of F among them, and to the direction of F.
        gradient : ndarray of shape (n_theta,)
            Its gradient.
        """
        away = theta - self.centre
        gradient = -self.precision * away
        value = 0.5 * float(gradient @ away)
        of_longer, slope = self._longer(away)
        value, gradient = value + of_longer, gradient + slope
        of_factor = self.prior.of_factor
        if of_factor.any():
            square = float(np.square(theta[of_factor]).sum())
            if square < np.finfo(float).tiny:
                return -np.inf, np.full(len(theta), np.nan)
            log_amplitude = 0.5 * np.log(square) - np.log(self.unit)
            log_amplitude /= OF_AMPLITUDE
            value -= 0.5 * log_amplitude**2
            gradient[of_factor] = (
                -log_amplitude / OF_AMPLITUDE / square * theta[of_factor]
            )
        return value, gradient

    def _longer(self, away):
        """What features that may not be needed add to the log density, and its slope.

        It is the logarithm of a mixture of two normal densities over the first of them.
        """
        slope, mixed = np.zeros(len(away)), self.not_needed > 0.0
        share, precision = self.not_needed[mixed], self.precision[mixed]
        odds = np.log(share) + precision * LONGER * (away[mixed] - 0.5 * LONGER)
        both = np.logaddexp(np.log1p(-share), odds)
        slope[mixed] = precision * LONGER * np.exp(odds - both)
        return float(both.sum()), slope

    def information(self):
        """Its precision, of shape (n_theta, n_theta), but for that of F."""
        return np.diag(self.precision)

    @property
    def unit(self):
        """Frobenius norm of a factor whose tasks have the targets' deviation."""
        return self.prior.scale * self.prior.factor_unit

    def near(self, theta, deviations, among):
        """Theta with some logarithms no farther away than so many deviations.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.
        deviations : float
            Of the prior.
        among : ndarray of bool of shape (n_theta,)
            Which may be moved.

        Returns
        -------
        near : ndarray of shape (n_theta,)
        """
        moved = (self.precision > 0.0) & among
        reach = deviations / np.sqrt(self.precision[moved])
        near, centre = theta.copy(), self.centre[moved]
        farthest = centre + reach + LONGER * (self.not_needed[moved] > 0.0)
        near[moved] = np.clip(theta[moved], centre - reach, farthest)
        return np.clip(near, *self.prior.bounds())

    def draw(self, rng, share=1.0):
        """A draw of theta, within the bounds.

        Parameters
        ----------
        rng : RandomState
            Source of randomness.
        share : float, default=1.0
            Of the deviations, by which draws are nearer to the centre.

        Returns
        -------
        theta : ndarray of shape (n_theta,)
        """
        lower, upper = self.prior.bounds()
        theta, logs = self.centre.copy(), self.precision > 0.0
        deviation = share * self.precision[logs] ** -0.5
        centre, chance = self.centre[logs], self.not_needed[logs]
        mixed = chance > 0.0
        centre[mixed] += LONGER * (rng.uniform(size=mixed.sum()) < chance[mixed])
        ends = np.array([lower[logs], upper[logs]])
        least, most = ndtr((ends - centre) / deviation)
        drawn = centre + deviation * ndtri(rng.uniform(least, most))
        theta[logs] = np.clip(drawn, *ends)
        of_factor = self.prior.of_factor
        direction = rng.standard_normal(of_factor.sum())
        if direction.size:
            direction /= np.linalg.norm(direction)
            amplitude = np.exp(share * OF_AMPLITUDE * rng.standard_normal())
            theta[of_factor] = self.unit * amplitude * direction
        return theta
