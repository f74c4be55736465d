"""The population of the tasks' rows of F, from which another task's is taken."""

import numpy as np

from skmtgp.model.several import unseen_of
from skmtgp.model.task_covariance import LowRank

LEAST_FREEDOM = 3  # fewer degrees tell no variance of another row
ROUNDING = 1e-12  # of the longest axis: a shorter one is none
# On the covariance of rows of F, of their mean square: that of few rows is singular.
RIDGE = 1e-7


def factors_of(prior, theta):
    """F of each term as it is learned, a list."""
    pairs = zip(prior.terms, prior.theta_of_terms(theta), strict=True)
    return [form.columns(rho) for (_, form), (_, rho) in pairs]


def deviations(factor):
    """What rows of F differ by: axes whose squares add up to their covariance.

    Parameters
    ----------
    factor : ndarray of shape (n_tasks, rank)
        F.

    Returns
    -------
    axes : ndarray of shape (n_axes, rank)
        A, no more than there are tasks: A^T A is the covariance of the rows.
    """
    centred = factor - factor.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    return sizes[:, None] * axes / np.sqrt(len(factor))


def mean_square(factor):
    """Of the rows of F; 1 if they are zero, and there is nothing to be like."""
    moment = np.square(factor).sum(axis=1).mean()
    return moment if moment >= np.finfo(float).tiny else 1.0


def scale_of_rows(factor):
    """A lower triangular S, and S S^T is the covariance of the rows of F.

    Parameters
    ----------
    factor : ndarray of shape (n_tasks, rank)
        F.

    Returns
    -------
    scale : ndarray of shape (rank, rank)
    """
    axes = deviations(factor)
    covariance = axes.T @ axes
    covariance[np.diag_indices(len(covariance))] += RIDGE * mean_square(factor)
    return np.linalg.cholesky(covariance)


def leeway_of_another(factor):
    r"""Axes of what a further row may differ by from the mean of the rows.

    Let rows be normal, and v any sum of the columns. That of a further row, less the
    mean of the n that are known, has Student's t distribution with n - 1 degrees of
    freedom :math:`\nu`. Its variance is :math:`(n + 1) / (n - 1) \, \nu / (\nu - 2)`
    times theirs around their mean. Less than three degrees of freedom tell no variance,
    and count as three. A single task tells nothing of what tasks differ by: then this
    is as large as its row.
    """
    n = len(factor)
    if n == 1:
        return factor
    freedom = max(n - 1, LEAST_FREEDOM)
    variance = (n + 1) / (n - 1) * freedom / (freedom - 2)
    return np.sqrt(variance) * deviations(factor)


def scale_of_open_row(factor):
    r"""A lower triangular S, and S S^T is the covariance of a row of F beside others.

    n / (n + 1) of it is that of a further row, see `leeway_of_another`, and 1 / (n + 1)
    is as large, and alike in all directions: few rows tell little of what rows may be.

    Parameters
    ----------
    factor : ndarray of shape (n_others, rank)
        The other rows; the rank is not 0.

    Returns
    -------
    scale : ndarray of shape (rank, rank)
    """
    (n, rank), axes = factor.shape, leeway_of_another(factor)
    covariance = n / (n + 1) * axes.T @ axes
    alike = np.square(axes).sum() / ((n + 1) * rank)
    covariance[np.diag_indices(rank)] += alike + RIDGE * mean_square(factor)
    return np.linalg.cholesky(covariance)


def another_task(prior, theta, described=None):
    """What is known of a task without data.

    Parameters
    ----------
    prior : Prior
        Of the tasks with data.
    theta : ndarray of shape (n_theta,)
        Parameters.
    described : ndarray of shape (n_unseen, n_rows), default=None
        What is known of each, see :class:`~skmtgp.model.described.Described`.

    Returns
    -------
    known : list of (loadings, own)
        Of each term, see :meth:`WithShared.unseen`.
    axes : list of ndarray of shape (n_axes, n_common)
        Of each term what loadings may differ by, see `leeway_of_another`. Terms differ
        together, as those of the known tasks do.
    """
    terms = [
        (form, rho)
        for (_, form), (_, rho) in zip(
            prior.terms, prior.theta_of_terms(theta), strict=True
        )
    ]
    known = [unseen_of(form, rho, described) for form, rho in terms]
    factors = [_drawn(form, rho) for form, rho in terms]
    ends = np.cumsum([F.shape[1] for F in factors])
    axes = leeway_of_another(np.hstack(factors))
    lengths = np.linalg.norm(axes, axis=1)
    axes = axes[lengths > ROUNDING * lengths.max(initial=0.0)]
    of_terms = np.split(axes, ends[:-1], axis=1)
    return known, [
        _behind(part, loadings)
        for part, (loadings, _) in zip(of_terms, known, strict=True)
    ]


def _drawn(form, rho):
    """The rows of F of a term that are those of a population; no columns of others."""
    inner = form
    while hasattr(inner, "form"):
        inner = inner.form
    if isinstance(inner, LowRank):
        return form.columns(rho)
    return np.zeros((form.n_tasks, 0))


def _behind(axes, loadings):
    """Axes of all loadings, of which those of the population come last."""
    whole = np.zeros((len(axes), loadings.shape[1]))
    whole[:, loadings.shape[1] - axes.shape[1] :] = axes
    return whole
