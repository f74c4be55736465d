"""Exact inference with tasks that share nothing: a matrix of each task suffices.

K has no elements between tasks then. The matrices of all tasks are stacked, those of
tasks with fewer rows padded: a few calls do for all of them.
"""

from functools import cached_property

import numpy as np

from skmtgp._data.known import noise_of
from skmtgp._numerics.linalg import StackedCholesky
from skmtgp._numerics.parallel import limit_threads
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.likelihood import log_density
from skmtgp.inference.tiles import TiledLikelihood
from skmtgp.model._nodes import Parts
from skmtgp.model.task_covariance import OfTasks

LARGEST_SHARE = 0.75  # of the elements of K, beyond which stacked matrices spare little


def are_apart(prior, tasks):
    """Whether tasks share nothing, and K is far larger than its blocks, if padded.

    Parameters
    ----------
    prior : Prior
        The model.
    tasks : ndarray of shape (n_samples,)
        Task of each row, ascending.

    Returns
    -------
    apart : bool
    """
    if prior.trend is not None or prior.n_terms > 1:
        return False
    if not getattr(prior.task_covariance, "apart", False):
        return False
    counts = np.bincount(tasks)
    size = np.count_nonzero(counts) * float(counts.max(initial=0)) ** 2
    return bool(size <= LARGEST_SHARE * len(tasks) ** 2)


class ApartLikelihood(DenseLikelihood):
    """The likelihood of tasks that share nothing but hyperparameters.

    Parameters
    ----------
    prior, X, tasks, y, known
        See Likelihood.
    """

    @cached_property
    def stacked(self):
        """The rows of each task, and their targets, stacked."""
        parts = Parts(self.tasks)
        return parts, parts.padded(self.y, 0.0)

    def in_single(self):
        """See Likelihood: small matrices take little time as they are."""
        return self

    def _evaluate(self, theta):
        """The value; NotPositiveDefiniteError where K cannot be factorised."""
        with limit_threads(self.side):
            cholesky, *_, noise = self._factorised(theta)
            return self._solved(cholesky, noise)[0]

    def _evaluate_with_grad(self, theta):
        """The value and its gradient; NotPositiveDefiniteError where K fails."""
        with limit_threads(self.side):
            cholesky, *of_f, noise = self._factorised(theta)
            value, alpha = self._solved(cholesky, noise)
            G = cholesky.invert()
            G -= alpha[:, :, None] * alpha[:, None, :]
            G *= self.stacked[0].halves
            halves = np.einsum("kii->ki", G)[self.stacked[0].there]
            d_noise = self._by_noise(halves, noise)
            gradients = *self._contracted(G, *of_f), d_noise
        return value, self.prior.gradient(theta, *gradients)

    def _factorised(self, theta):
        """The factors of K, k^x, its values and tape, K^rho, and noise variances."""
        parts, _ = self.stacked
        bound, K_rho, level, noise = TiledLikelihood._bind(self, theta)
        K_x, tape = bound.blocks(parts)
        kappa = np.diagonal(K_rho)[parts.codes, None, None]
        K = kappa * K_x
        K += level
        K *= parts.upper
        np.einsum("kii->ki", K)[...] += parts.padded(self.noise_of_rows(noise), 1.0)
        return StackedCholesky(K), bound, K_x, tape, kappa, noise

    def _solved(self, cholesky, noise):
        """The log density of y, and K^{-1} y, stacked."""
        log_det, roots = cholesky.log_det(), cholesky.invert_factors()
        half = self.stacked[1][:, None] @ roots
        value = log_density(np.vdot(half, half), log_det, len(self.y))
        if self.known is not None:
            value += self.known.log_density(noise[self.noise_of_row])
        return float(value), (roots @ half.swapaxes(1, 2))[..., 0]

    def _contracted(self, G, bound, K_x, tape, kappa):
        """Gradients by the kernel's theta, K^rho and the levels' variance."""
        parts, D = self.stacked[0], np.zeros((self.prior.n_tasks,) * 2)
        D[parts.codes, parts.codes] = -np.einsum("kij,kij->k", G, K_x)
        d_level = -G.sum() if self.prior.levels else 0.0
        G *= kappa
        return -bound.contract_blocks(G, tape, parts), D, d_level

    def _information(self, theta, rows, of_rho):
        """See Likelihood."""
        try:
            return self._summed_information(theta, rows, of_rho)
        except NotPositiveDefiniteError:
            return super()._information(theta, rows, of_rho)

    def _summed_information(self, theta, rows, of_rho):
        """The sum over the tasks."""
        prior, values = self.prior, self.prior.values(theta)
        X, tasks, learned, known = self._some(rows, values.noise)
        parts, (of_rho,) = Parts(tasks), of_rho
        [(K_x, dK_x)] = prior.derivatives(theta, X, parts)
        kappa = np.diagonal(prior.K_rho_at(theta))[parts.codes]
        by_noise = learned if known is None else learned / known.counts
        there = parts.upper + parts.upper.swapaxes(1, 2) > 0.0
        of_noise = np.zeros(parts.shape)
        np.einsum("kii->ki", of_noise)[...] = parts.padded(by_noise, 0.0)
        bases = np.array([*dK_x, K_x, np.ones(parts.shape), of_noise]) * there
        K = (kappa[:, None, None] * K_x + values.level) * parts.upper
        np.einsum("kii->ki", K)[...] += parts.padded(noise_of(known, learned), 1.0)
        told = _told_of(_inverses(K), bases)
        weights = self._weights(parts.codes, kappa, of_rho, values.level, len(dK_x))
        right = (told @ weights.swapaxes(1, 2)).reshape(-1, prior.n_theta)
        return weights.swapaxes(0, 1).reshape(prior.n_theta, -1) @ right

    def _weights(self, codes, kappa, of_rho, level, n_dims):
        """Of the bases in the derivative of each task's K by each parameter.

        They are the derivatives of k^x by its theta, k^x, one, and the noise.
        """
        prior = self.prior
        weights, each = np.zeros((len(codes), prior.n_theta, n_dims + 3)), codes >= 0
        weights[:, np.arange(n_dims), np.arange(n_dims)] = kappa[:, None]
        at = n_dims
        for derivative in of_rho:
            if isinstance(derivative, OfTasks):
                places = n_dims + derivative.positions[codes]
                own = 2.0 * np.diagonal(derivative.half)[codes]
                weights[each, places, n_dims] = own
                at += len(derivative.positions)
            else:
                weights[:, at, n_dims] = np.diagonal(derivative)[codes]
                at += 1
        if prior.levels:
            weights[:, at, n_dims + 1] = level
        noise = prior.n_theta - prior.n_noise + codes * (prior.n_noise > 1)
        weights[each, noise, n_dims + 2] = 1.0
        return weights


def _inverses(K):
    """The inverses of stacked matrices, of which the upper triangles are given."""
    cholesky = StackedCholesky(K)
    cholesky.invert_factors()
    upper = cholesky.invert()
    inverses = upper + upper.swapaxes(1, 2)
    np.einsum("kii->ki", inverses)[...] *= 0.5
    return inverses


def _told_of(inverses, bases):
    """1/2 tr(K^{-1} A K^{-1} B) of each task's bases, (n_parts, n_bases, n_bases)."""
    scores = (inverses @ bases).swapaxes(0, 1)
    shape = *scores.shape[:2], -1
    transposed = scores.swapaxes(2, 3).reshape(shape)
    return 0.5 * scores.reshape(shape) @ transposed.swapaxes(1, 2)
