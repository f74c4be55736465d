r"""The staged heuristic of the paper's section 3.

1. theta^x is learned with K_0^rho = I and with K_0^rho = 1 1^T, relaxed.
2. K_1^rho is computed from either, section 3.2.
3. All parameters are learned from K_1^rho and sigma_0^2. Each start is *annealed*, k^x
   relaxed and the noise held up at first. The best mode is *shaken*.

Stages 1 and 2 do not depend on the rank.
"""

from itertools import islice
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.parallel import limit_threads, run
from skmtgp.learning.climbing import DOUBT, annealed, climb, refine, shake
from skmtgp.learning.problem import Mode, best_of
from skmtgp.model.task_covariance import low_rank

SHAKES = 3
SINGULAR = 1e-12  # of the mean diagonal


def learn_fixed(data, settings, form):
    """Learn theta^x and sigma^2 with K^rho fixed: the models iGP and pGP.

    From theta_0^x, relaxed, with the noise free and with the noise held up at first;
    the better mode counts.
    """
    kappa = form.parameters(1.1 * np.eye(data.n_tasks))  # 0.1, if it is learned
    theta = np.concatenate([settings.kernel.theta, kappa, settings.log_noise])
    coarse = data.levels()[0]
    relaxed = climb(coarse, settings, form, theta, relaxed=True)
    direct = relaxed.then(climb(coarse, settings, form, relaxed.theta))
    modes = [direct, annealed(coarse, settings, form, theta)]
    return refine(data, settings, form, best_of(modes, doubt=DOUBT))


class Start(NamedTuple):
    """Where step 3 begins.

    Attributes
    ----------
    kernel_theta : ndarray of shape (n_dims,)
        theta_1^x.
    K_rho : ndarray of shape (n_tasks, n_tasks)
        K_1^rho before its rank is constrained.
    mode : Mode, default=None
        What step 1 found, if it comes from there.
    log_noise : ndarray of shape (n_noise,), default=None
        Logarithm of the noise variance. None is that of sigma_0^2.
    """

    kernel_theta: np.ndarray
    K_rho: np.ndarray
    mode: Mode | None = None
    log_noise: np.ndarray | None = None

    def theta(self, settings, form):
        """All parameters of the model of this form."""
        rho = form.parameters(self.K_rho, settings.truncation)
        log_noise = settings.log_noise if self.log_noise is None else self.log_noise
        return np.concatenate([self.kernel_theta, rho, log_noise])


def first_stage(data, settings, form, *, relaxed=True):
    """Steps 1 and 2 of section 3, with K_0^rho of the given form."""
    theta = np.concatenate([settings.kernel.theta, settings.log_noise])
    mode = climb(data, settings, form, theta, relaxed=relaxed)
    likelihood = settings.likelihood(data, form)
    with limit_threads(likelihood.side):
        K_rho = augmented_task_covariance(data, likelihood.posterior(mode.theta))
    return Start(settings.split(mode.theta)[0], K_rho, mode)


def augmented_task_covariance(data, posterior):
    r"""K_aug^rho of section 3.2: eq. 7, augmented and regularised.

    .. math:: K_{aug}^\rho
        = N^{-1} T_{aug}^T (K_1^x + \eta^2 I)^{-1} T_{aug}

    Parameters
    ----------
    data : Data
        Observations.
    posterior : Posterior
        The GP with (theta_1^x, K_0^rho, sigma_1^2).

    Returns
    -------
    K_rho : ndarray of shape (n_tasks, n_tasks)
        Positive semi-definite.
    """
    X, row = np.unique(data.X, axis=0, return_inverse=True)
    row = row.reshape(-1)
    T_aug = posterior.mean_of_tasks(X, np.arange(data.n_tasks))
    kernel = posterior.kernel
    del posterior  # its factor takes as much memory as K_x
    cells, cell = np.unique(row * data.n_tasks + data.tasks, return_inverse=True)
    observed = np.bincount(cell, data.y) / np.bincount(cell)
    T_aug.flat[cells] = observed  # t^m(x_i)
    eta_squared = np.square(T_aug).mean()  # tr(T_aug^T T_aug) / (M N)
    K_x = kernel(X)
    # Where there is nothing to explain, or next to nothing, K_x alone is singular.
    floor = SINGULAR * np.diagonal(K_x).mean() + np.finfo(np.float64).tiny
    K_x[np.diag_indices_from(K_x)] += max(eta_squared, floor)
    return T_aug.T @ np.linalg.solve(K_x, T_aug) / len(X)


def second_stage(jobs, *, shakes=SHAKES, n_jobs=None, reporters=None):
    """Step 3 of section 3, from each start; the best modes.

    Parameters
    ----------
    jobs : list of (Data, Settings, LowRank, list of Start)
        Observations, settings, form of K^rho and each (theta_1^x, K_1^rho), which is
        followed with sigma_0^2.
    shakes : int, default=SHAKES
        How often the best mode of a job is shaken.
    n_jobs : int, default=None
        Processes, to which all starts of all jobs are shared out.
    reporters : pair of callables, default=None
        Give, when a part begins, what to call with a position and a mode: of each
        start of the jobs, and of each job.

    Returns
    -------
    modes : list of Mode
        The best one of each job, with what was spent on all.
    """
    of_starts, of_jobs = reporters or (lambda: None, lambda: None)
    found = from_each_start(_follow, jobs, n_jobs=n_jobs, report=of_starts())
    best = [
        (*job[:3], best_of(modes, doubt=DOUBT), shakes)
        for job, modes in zip(jobs, found, strict=True)
    ]
    return run(shake, best, n_jobs=n_jobs, report=of_jobs())


def _follow(data, settings, form, start):
    return annealed(data, settings, form, start.theta(settings, form))


def from_each_start(function, jobs, *, n_jobs=None, report=None):
    """``function(data, settings, form, start)``, with each of several starts.

    Parameters
    ----------
    function : callable
        Gives a Mode.
    jobs : list of (Data, Settings, form, list of starts)
        Observations, settings, form of K^rho and starts.
    n_jobs : int, default=None
        Processes.
    report : callable, default=None
        Called with the position of each start and its mode.

    Returns
    -------
    modes : list of list of Mode
        Of each job, from each of its starts.
    """
    starts = [(*job[:3], start) for job in jobs for start in job[3]]
    modes = iter(run(function, starts, n_jobs=n_jobs, report=report))
    return [list(islice(modes, len(job[3]))) for job in jobs]


def add_diagonal(data, settings, form, simpler):
    """The mode of a model, as one with a diagonal that does not matter, learned on.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    form : WithDiagonal
        Form of K^rho.
    simpler : Mode
        A mode of the model of ``form.form``.

    Returns
    -------
    mode : Mode
        Not worse than with the smallest diagonal.
    """
    kernel, rho, noise = settings.split(simpler.theta)
    smallest = form.bounds(settings.scale)[-form.n_kappa :, 0]
    theta = np.concatenate([kernel, rho, smallest, noise])
    value = settings.likelihood(data, form).value(theta)
    raised = climb(data, settings, form, settings.with_noise(theta, form))
    simplest = simpler._replace(theta=theta, value=value)
    return best_of([simplest, simpler.led_to(raised)])


def with_starts(mode, starts):
    """The mode, with what was spent on its starts, which all ranks share."""
    first = [start.mode for start in starts if start.mode]
    return mode._replace(
        n_evaluations=mode.n_evaluations + sum(m.n_evaluations for m in first),
        seconds=mode.seconds + sum(m.seconds for m in first),
    )


def full_rank_start(data, settings, start):
    """A start whose K_1^rho, before its rank is constrained, is a full-rank fit's.

    The fit is relaxed and begins with K^rho = I. It takes as long as several ranks.
    """
    form = low_rank(data.n_tasks, data.n_tasks)
    theta = start._replace(K_rho=np.eye(data.n_tasks)).theta(settings, form)
    mode = climb(data, settings, form, theta, relaxed=True)
    kernel, rho, _ = settings.split(mode.theta)
    return Start(kernel, form.matrix(rho), mode)


def perturbed(start, seed):
    """A random start near another: log parameters moved, tasks mixed."""
    rng = np.random.default_rng(seed)
    theta = start.kernel_theta + rng.standard_normal(len(start.kernel_theta))
    mixing = rng.standard_normal(start.K_rho.shape)
    mixing = np.eye(len(mixing)) + 0.3 * mixing
    return Start(theta, mixing @ start.K_rho @ mixing.T)
