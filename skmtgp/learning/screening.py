r"""Whether tasks want units, and noise variances, of their own.

A small model is asked, before anything large is learned: tasks that tell each other
nothing but k^x, with an amplitude and a level each (K^rho = diag(kappa)), learned from
a few hundred rows. K^rho takes up the units of the functions, here as in the model that
is learned later; what is left of a unit is that of the noise and of the levels. The
candidates' likelihoods of y in its own units are compared with their parameters
counted, as in eq. 8.

Data that speak for nothing but common units are not asked at length:

- :func:`differ_in_size` compares the tasks' deviations alone;
- :func:`differ_in_noise` foresees from one fit with shared noise what noise for each
  task would gain. Where the fit took noise for large functions, it does so from another
  one, :func:`as_large`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from skmtgp._data.dask import map_parts
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.posterior import noise_is_told
from skmtgp.learning.climbing import climb
from skmtgp.learning.faster import with_faster
from skmtgp.learning.problem import best_of
from skmtgp.model.task_covariance import WithDiagonal, low_rank


def differ_in_size(scales, counts):
    """Whether the deviations of tasks' targets differ by more than chance.

    Parameters
    ----------
    scales : ndarray of shape (n_outputs, n_tasks)
        Deviations.
    counts : ndarray of shape (n_tasks,)
        Numbers of rows.

    Returns
    -------
    differ : bool
        Whether normal targets, independent of each other, would be likelier by more
        than two parameters a task are worth.
    """
    squares, n = np.square(scales), counts.sum()
    pooled = squares @ counts / n
    gain = 0.5 * np.log(pooled[:, None] / squares) @ counts
    return bool(gain.sum() > len(scales) * len(counts) * np.log(n))


def screen(problem, known=()):
    """The mode of a problem's coarsest data, from the tasks' variances.

    Parameters
    ----------
    problem : Problem
        With K^rho = diag(kappa), or fixed.
    known : sequence of Mode
        Others of the coarsest data.

    Returns
    -------
    problem : Problem
        Of the coarsest data.
    mode : Mode
    """
    problem = problem.coarse_to_fine()[0]
    data = problem.data
    squares = _of_tasks(data, np.square(data.y))
    variances = squares / np.maximum(_of_tasks(data, np.ones(len(data))), 1.0)
    theta = problem.theta(K_rho=np.diag(variances))
    mode = best_of([*known, climb(problem, theta, relaxed=True, known=known)])
    return problem, with_faster(problem, theta, mode)


def as_large(problem, mode):
    """The mode whose functions are as large in all tasks: the rest of each is noise.

    Parameters
    ----------
    problem : Problem
        Of the coarsest data.
    mode : Mode
        Its mode.

    Returns
    -------
    mode : Mode
        Of the same problem; None where K^rho is not diag(kappa).
    """
    prior, form = problem.prior, problem.prior.task_covariance
    if prior.n_terms > 1 or not form.n_own or form.n_kappa or form.shared:
        return None
    equal = problem.with_form(WithDiagonal(form.form, equal=True))
    of_mode = equal.prior.task_covariance.parameters(prior.K_rho_at(mode.theta))
    theta = equal.prior.with_rho(mode.theta, of_mode)
    start = np.where(equal.prior.of_noise, np.maximum(theta, prior.log_noise), theta)
    equal, found = screen(equal, known=[climb(equal, start, relaxed=True)])
    rho = form.parameters(equal.prior.K_rho_at(found.theta))
    theta = prior.with_rho(found.theta, rho)
    value = problem.likelihood().value(theta)
    return mode.then(found._replace(theta=theta, value=value))


def _of_tasks(data, of_rows):
    """Sums over the rows of each task."""
    return np.bincount(data.tasks, of_rows, data.n_tasks)


def differ_in_noise(problem, mode):
    r"""Whether noise for each task would gain more than its parameters are worth.

    At the mode with shared noise, a variance r times as large for a task gains about
    :math:`\tfrac12 \nu (r - 1 - \log r)` where r is its squared residuals over those
    expected, and :math:`\nu` the degrees of freedom that its rows leave to the noise.
    Noise that is the same for all gains about half a nat for each task by chance.

    Parameters
    ----------
    problem : Problem
        With shared noise.
    mode : Mode
        Its mode.

    Returns
    -------
    differ : bool
    """
    freedom, squares = _left_to_noise(problem, mode)
    told = freedom > 1e-3
    ratio = np.maximum(squares[told] / freedom[told], 1e-10)
    gain = 0.5 * freedom[told] @ (ratio - 1.0 - np.log(ratio))
    by_chance = 0.5 * told.sum() + np.sqrt(2.0 * told.sum())
    return bool(gain > max(0.25 * price_of_tasks(problem.data), by_chance))


def leaves_noise(problem, mode):
    """Whether each task's rows leave more than one degree of freedom to the noise."""
    return bool((_left_to_noise(problem, mode)[0] > 1.0).all())


def hides_noise(problem, mode):
    """Whether functions may have followed the noise of a task.

    Parameters
    ----------
    problem : Problem
        With shared noise.
    mode : Mode
        Its mode.

    Returns
    -------
    hides : bool
    """
    if problem.is_noisy(mode):
        return _follows_rows(problem, mode)
    return _hides_noisy_task(problem.coarse_to_fine()[0], mode)


def _follows_rows(problem, mode):
    """Whether functions leave little of a task's rows to the noise, more of others."""
    tuning, freedom = problem.tuning, _left_to_noise(problem, mode)[0]
    counts = _of_tasks(problem.data, np.ones(len(problem.data)))
    left = (freedom / np.maximum(counts, 1.0))[counts >= tuning.rough_rows]
    least = left.min(initial=1.0)
    return bool(least < min(tuning.rough, left.max(initial=0.0) / tuning.rougher_than))


def _hides_noisy_task(problem, mode):
    """Whether rank 1 with noise of each task is likelier than a mode without noise.

    It cannot follow the rows of two tasks: one is exact then, and another is not.
    """
    prior, theta = problem.prior, mode.theta
    if prior.n_terms > 1 or prior.n_tasks == 1:
        return False
    likelihood = problem.likelihood()
    known = by_likelihood(problem, mode._replace(value=likelihood.value(theta)))
    likelihood.release()
    simple = problem.with_form(low_rank(prior.n_tasks, 1))
    kernel, K_rho = prior.values(theta).kernel, prior.K_rho_at(theta)
    # of tasks that share nothing the first eigenvector is a task alone
    for start in (K_rho, np.full_like(K_rho, np.diagonal(K_rho).mean())):
        shared = climb(simple, simple.theta(kernel=kernel, K_rho=start))
        if by_likelihood(*with_own_noise(simple, shared)) > known:
            return True
    return False


def _left_to_noise(problem, mode):
    """Of each task: degrees of freedom, and squared residuals over the variance."""
    likelihood = problem.likelihood()
    with limit_threads(likelihood.side):
        posterior = likelihood.posterior(mode.theta)
        noise = posterior.noise + posterior.jitter
        freedom = noise * posterior.precision()
        squares = noise * np.square(posterior.alpha)
    known, counts = problem.data.known, problem.data.counts
    if known is not None:  # what repeats tell beside their means
        freedom = freedom + counts - 1.0
        squares = squares + known.spread / posterior.noise
    return _of_tasks(problem.data, freedom), _of_tasks(problem.data, squares)


def with_own_noise(problem, mode, *, least=None):
    """The problem with a noise variance for each task, learned on from a mode.

    Parameters
    ----------
    problem : Problem
        With shared noise.
    mode : Mode
        Its mode.
    least : float, default=None
        What eq. 8 must reach for it to be of use. Then the climb ends where it cannot
        hope for that, and where a variance has all but vanished by following the rows
        of its task, which `tells_noise` would refuse. None means to the end.

    Returns
    -------
    problem : Problem
        With noise for each task.
    mode : Mode
        Not worse than the one that is given.
    """
    prior, theta = problem.prior.with_own_noise(mode.theta)
    problem = replace(problem, prior=prior)
    vanished = prior.log_noise_at(theta).min() + np.log(problem.tuning.vanished)

    def follows_rows(theta):
        has_fallen = prior.log_noise_at(theta).min() < vanished
        return has_fallen and not tells_noise(problem, mode._replace(theta=theta))

    if least is None:
        return problem, mode.then(climb(problem, theta))
    least = least + mode.value - criterion(problem, mode)
    return problem, mode.then(climb(problem, theta, least=least, futile=follows_rows))


def with_kernel(problem, mode, kernel, *, gain=None):
    """The problem with another k^x of the same parameters, learned on from a mode.

    Parameters
    ----------
    problem : Problem
        With another one.
    mode : Mode
        Its mode.
    kernel : Kernel
        k^x with its starting values.
    gain : float, default=None
        Nats by which it must be better to be of use. Then the climb ends where it
        cannot hope for that, or has all but reached the mode that is known. None means
        to the end.

    Returns
    -------
    problem : Problem
        With that kernel.
    mode : Mode
        Its own, or what was reached.
    """
    problem = replace(problem, prior=replace(problem.prior, kernel=kernel))
    if gain is None:
        return problem, mode.then(climb(problem, mode.theta))
    least = -np.inf if mode.stalled else mode.value + gain  # else it lacks digits
    return problem, mode.then(climb(problem, mode.theta, known=[mode], least=least))


def tells_noise(problem, mode):
    """Whether the rows tell all noise variances: none vanished by following them."""
    likelihood = problem.likelihood()
    with limit_threads(likelihood.side):
        posterior = likelihood.posterior(mode.theta)
        return bool(noise_is_told(likelihood, posterior).all())


def price(n_parameters, n):
    """Nats that parameters are worth which n rows tell, by BIC."""
    return 0.5 * n_parameters * np.log(n)


def price_of_tasks(data):
    """Nats that a parameter for each task is worth: only its own rows tell it."""
    if data.known is None:
        each = partial(np.bincount, minlength=data.n_tasks)
        counts = sum(map_parts(each, data.tasks))
    else:
        counts = _of_tasks(data, data.counts)
    return 0.5 * np.log(np.maximum(counts, 1.0)).sum()


def criterion(problem, mode, times=1.0):
    """Likelihood less what hyperparameters are worth, eq. 8.

    A noise variance of a task is worth what its own rows tell. It is foreseen of so
    many times the rows, if each of them tells as much. Densities of theta count once.
    """
    prior, data = problem.prior, problem.data
    n_shared, of_tasks = prior.n_hyperparameters, 0.0
    if prior.n_noise > 1:
        n_shared, of_tasks = n_shared - prior.n_noise, price_of_tasks(data)
        of_tasks += price(prior.n_noise, times)
    of_theta = problem.log_density(mode.theta) if times != 1.0 else 0.0
    of_theta = of_theta if np.isfinite(of_theta) else 0.0  # not learned: F is zero
    likelihood = mode.value - of_theta
    prices = price(n_shared, times * data.n_measured) + of_tasks
    return times * likelihood + of_theta - prices


def by_likelihood(problem, mode):
    """Eq. 8 of the likelihood alone: no density of theta counts.

    `AlikeNoise` would say whether noise of tasks differs before the rows do.
    """
    return criterion(problem, mode._replace(value=problem.log_likelihood(mode)))


def score(problem, mode, scale):
    """The criterion of y in its own units, less what the units are worth.

    Parameters
    ----------
    problem : Problem
        Of the coarsest data.
    mode : Mode
        Its mode.
    scale : ndarray of shape (1,) or (n_tasks,)
        What the targets were divided by.

    Returns
    -------
    score : float
    """
    return criterion(problem, mode) + worth_of_units(problem, scale)


def worth_of_units(problem, scale):
    """Nats from a density in units to that of y, less what the units are worth."""
    data, trend = problem.data, problem.prior.trend
    scale = np.broadcast_to(scale, data.n_tasks)
    found = -(data.counts @ np.log(scale)[data.tasks])
    if trend is not None:
        found += trend.log_jacobian(data.X, data.tasks)
    if (scale == scale[0]).all():
        return found
    # a scale for each task, and a mean where it is not that of a prior
    return found - price_of_tasks(data) * (1 if problem.prior.levels else 2)
