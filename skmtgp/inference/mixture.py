"""The posterior of f where the hyperparameters are drawn: a mixture of normals."""

from copy import copy

import numpy as np

from skmtgp._numerics.mixtures import as_one, weights_left_out


class Mixture:
    """Posteriors of f at several draws of theta, each as likely as the others.

    Parameters
    ----------
    likelihood : Likelihood
        Where the data and the model's form come from.
    thetas : ndarray of shape (n_draws, n_theta)
        Draws of the parameters.

    Attributes
    ----------
    parts : list of n_draws Posterior
        Those of the draws.

    Notes
    -----
    Its methods are those of a Posterior. Variances are the mean of the parts'
    variances and the variance of their means.
    """

    def __init__(self, likelihood, thetas):
        self.parts = [likelihood.posterior(theta) for theta in thetas]

    def updated(self, update, likelihood, thetas):
        """The same of a likelihood that shares rows; this one stays as it is.

        Parameters
        ----------
        update : callable
            ``update(part, likelihood, theta)`` gives the posterior of each part.
        likelihood : Likelihood
            Of all rows.
        thetas : ndarray of shape (n_draws, n_theta)
            Draws of the parameters, as before but for those of tasks that have joined.

        Returns
        -------
        mixture : Mixture
        """
        mixture, parts = copy(self), zip(self.parts, thetas, strict=True)
        mixture.parts = [update(part, likelihood, theta) for part, theta in parts]
        return mixture

    def _of_parts(self, evaluate):
        """What the parts give, (n_draws, ...)."""
        return np.array([evaluate(part) for part in self.parts])

    def means(self, X, tasks):
        """Mean of f of each part, (n_draws, n_samples)."""
        return self._of_parts(lambda part: part.mean(X, tasks))

    def variances(self, X, tasks):
        """Variance of f of each part, (n_draws, n_samples)."""
        return self._of_parts(lambda part: part.variance(X, tasks))

    def mean(self, X, tasks):
        """Mean of f, of shape (n_samples,), for rows of X and their tasks."""
        return self.means(X, tasks).mean(axis=0)

    def summands(self, tasks):
        """What the means of these tasks are sums of, a list of Summand."""
        found = [summand for part in self.parts for summand in part.summands(tasks)]
        n = len(self.parts)
        return [
            of._replace(weights=of.weights / n, constants=of.constants / n)
            for of in found
        ]

    def trend_of(self, tasks):
        """The trend's part in the means of these tasks, see Posterior."""
        columns, *parts = zip(
            *(part.trend_of(tasks) for part in self.parts), strict=True
        )
        return columns[0], *(np.mean(of, axis=0) for of in parts)

    def variance(self, X, tasks):
        """Variance of f, of shape (n_samples,), for rows of X and their tasks."""
        return _variance(self.means(X, tasks), self.variances(X, tasks))

    def means_of_terms(self, X, tasks):
        """Means of the terms of f, and last of the level, (n_terms + 1, n_samples)."""
        return self._of_parts(lambda part: part.means_of_terms(X, tasks)).mean(axis=0)

    def covariance(self, X, tasks):
        """Covariance of f, of shape (n_samples, n_samples)."""
        means = self.means(X, tasks)
        away = (means - means.mean(axis=0)) / np.sqrt(len(means))
        total = away.T @ away
        for part in self.parts:
            of_part = part.covariance(X, tasks)
            of_part /= len(means)
            total += of_part
        return total

    def leave_one_out(self, include_noise=False):
        """Each training sample predicted from the others, see Posterior.

        The draws count by what they would have been likely without the sample.
        """
        found = self._of_parts(lambda part: part.leave_one_out(include_noise=True))
        residuals, variances = np.moveaxis(found, 1, 0)
        weights = weights_left_out(residuals, variances)
        if not include_noise:
            variances = self._of_parts(lambda part: part.leave_one_out()[1])
        return as_one(residuals, variances, weights)

    @property
    def levels(self):
        """Mean of the level of each task, (n_tasks,)."""
        return self._of_parts(lambda part: part.levels).mean(axis=0)

    def level_variances(self):
        """Variance of the level of each task, (n_tasks,)."""
        means = self._of_parts(lambda part: part.levels)
        return _variance(means, self._of_parts(lambda part: part.level_variances()))

    def coefficients_in_units(self):
        """Means and deviations of the trend's coefficients, (n_sets, n_trend) each."""
        found = self._of_parts(lambda part: part.coefficients_in_units())
        means, deviations = np.moveaxis(found, 1, 0)
        return means.mean(axis=0), np.sqrt(_variance(means, np.square(deviations)))

    def with_unseen(self, n_unseen, described=None):
        """The same that knows tasks without data, too; this one stays as it is."""
        mixture = copy(self)
        mixture.parts = [of.with_unseen(n_unseen, described) for of in self.parts]
        return mixture


def _variance(means, variances):
    """Of a mixture, from the means and variances of its parts."""
    return as_one(means, variances, 1.0)[1]
