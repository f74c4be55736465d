r"""The staged heuristic of the paper's section 3.

1. theta^x is learned with K_0^rho = I and with K_0^rho = 1 1^T, relaxed.
2. K_1^rho is computed from either, section 3.2.
3. All parameters are learned from K_1^rho and sigma_0^2, or less noise if step 1 would
   have taken fast functions for it. Each start is *annealed*, k^x relaxed and the noise
   held up at first. The best mode is *shaken*.

Stages 1 and 2 do not depend on the rank.
"""

from dataclasses import replace
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.parallel import limit_threads, run
from skmtgp.learning.climbing import annealed, climb, refine, shake
from skmtgp.learning.faster import with_faster
from skmtgp.learning.nesting import embedded, has_columns_more, with_columns
from skmtgp.learning.problem import Mode, best_of
from skmtgp.learning.tuning import TUNING
from skmtgp.model.task_covariance import low_rank


def learn_fixed(problem):
    """Learn theta^x and sigma^2 with K^rho fixed: the models iGP and pGP.

    From theta_0^x, relaxed, with the noise free and with the noise held up at first;
    the better mode counts.
    """
    coarse = problem.coarse_to_fine()[0]
    theta = problem.theta(K_rho=1.1 * np.eye(problem.prior.n_tasks))  # kappa is 0.1
    relaxed = with_faster(coarse, theta, climb(coarse, theta, relaxed=True))
    direct = relaxed.then(climb(coarse, relaxed.theta))
    modes = [direct, annealed(coarse, theta).mode]
    return refine(problem, best_of(modes, doubt=problem.tuning.doubt))


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
    log_level : float, default=None
        Logarithm of the levels' variance. None is where it begins.
    is_noisy : bool, default=False
        Whether step 1 has taken more than a little for noise.
    log_noise_found : ndarray of shape (n_noise,), default=None
        Logarithm of the noise variance that step 1 found.
    """

    kernel_theta: np.ndarray
    K_rho: np.ndarray
    mode: Mode | None = None
    log_noise: np.ndarray | None = None
    log_level: float | None = None
    is_noisy: bool = False
    log_noise_found: np.ndarray | None = None

    def theta(self, problem):
        """All parameters of the problem's model."""
        return problem.theta(
            kernel=self.kernel_theta,
            K_rho=self.K_rho,
            log_noise=self.log_noise,
            log_level=self.log_level,
        )


def first_stage(problem, *, relaxed=True):
    """Steps 1 and 2 of section 3, with K_0^rho as the problem has it."""
    theta = problem.theta()
    slow = climb(problem, theta, relaxed=relaxed)
    mode = with_faster(problem, theta, slow) if relaxed else slow
    likelihood, prior = problem.likelihood(), problem.prior
    with limit_threads(likelihood.side):
        posterior = likelihood.posterior(mode.theta)
        K_rho = augmented_task_covariance(problem.data, posterior)
    kernel, level = prior.values(mode.theta).kernel, prior.log_level_at(mode.theta)
    noisy = problem.is_noisy(mode, beyond=0.1)
    found = prior.log_noise_at(mode.theta)
    log_noise = found if mode.value > slow.value else None
    return Start(kernel, K_rho, mode, log_noise, level, noisy, found)


def first_without_levels(problem):
    """The same of the model without levels, which begin as small as can be.

    K_1^rho has then what tasks differ in by constants, too.
    """
    prior = problem.prior
    start = first_stage(replace(problem, prior=prior.without_levels))
    return start._replace(log_level=prior.log_level_bounds[0])


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
    T_aug = posterior.mean_of_tasks(X, np.arange(data.n_tasks)) - posterior.levels
    y = posterior.without_trend(data.y, data.X, data.tasks)
    kernel, y = posterior.kernel, y - posterior.levels[data.tasks]
    del posterior  # its factor takes as much memory as K_x
    cells, cell = np.unique(row * data.n_tasks + data.tasks, return_inverse=True)
    T_aug.flat[cells] = np.bincount(cell, y) / np.bincount(cell)  # t^m(x_i)
    eta_squared = np.square(T_aug).mean()  # tr(T_aug^T T_aug) / (M N)
    K_x = kernel(X)
    # Where there is nothing to explain, or next to nothing, K_x alone is singular.
    floor = TUNING.singular * np.diagonal(K_x).mean() + np.finfo(np.float64).tiny
    K_x[np.diag_indices_from(K_x)] += max(eta_squared, floor)
    return T_aug.T @ np.linalg.solve(K_x, T_aug) / len(X)


def second_stage(jobs, *, shakes, firsts=None, n_jobs=None, reporters=None):
    """Step 3 of section 3, from each start; the best modes.

    Parameters
    ----------
    jobs : list of (list of Problem, list of Start)
        What to learn: for each output the problems of ascending rank; and each
        (theta_1^x, K_1^rho), which is followed with sigma_0^2.
    shakes : int
        How often the best mode of a problem is shaken. One that is no better than a
        lower rank's is not.
    firsts : list of list of Ascent, default=None
        From the likeliest start of each job, if they are known already.
    n_jobs : int, default=None
        Processes, to which the starts of all jobs are shared out.
    reporters : pair of callables, default=None
        Give, when a part begins, what to call with a position and a mode: of each
        start of each problem of the jobs, and of each problem.

    Returns
    -------
    modes : list of Mode
        The best one of each problem, job by job, with what was spent on all.
    """
    of_starts, of_jobs = reporters or (lambda: None, lambda: None)
    best = []
    found = _followed(jobs, firsts, n_jobs, of_starts())
    for (problems, _), chains in zip(jobs, found, strict=True):
        value = -np.inf
        for problem, of_starts in zip(problems, zip(*chains, strict=True), strict=True):
            doubt = problem.tuning.doubt
            mode = best_of([ascent.mode for ascent in of_starts], doubt=doubt)
            gained = mode.value > value + doubt
            best.append((problem, mode, shakes if gained else 0))
            value = max(value, mode.value)
    return run(shake, best, n_jobs=n_jobs, report=of_jobs())


def _followed(jobs, firsts, n_jobs, report):
    """Ascents of each job's problems from its likeliest start, then from the others."""

    def say(i, ascents, n_others=0):
        for k, ascent in enumerate(ascents if report is not None else ()):
            job, start = divmod(i, n_others or 1)
            position = job * len(ascents) + k
            if n_others:  # after those of all first starts
                position = (len(jobs) * len(ascents)) + position * n_others + start
            report(position, ascent.mode)

    if firsts is None:
        of_likeliest = [(problems, likeliest(starts)) for problems, starts in jobs]
        firsts = run(_follow, of_likeliest, n_jobs=n_jobs, report=say)
    else:
        for i, ascents in enumerate(firsts):
            say(i, ascents)
    others = [
        (problems, start, known)
        for (problems, starts), known in zip(jobs, firsts, strict=True)
        for start in starts
        if start is not likeliest(starts)
    ]
    of_others = partial(say, n_others=len(jobs[0][1]) - 1)
    rest = iter(run(_follow, others, n_jobs=n_jobs, report=of_others))
    return [
        [ascents, *islice(rest, len(starts) - 1)]
        for ascents, (_, starts) in zip(firsts, jobs, strict=True)
    ]


def likeliest(starts):
    """The start whose step 1 reached most, section 3.1."""
    return max(starts, key=lambda start: start.mode.value if start.mode else -np.inf)


def _follow(problems, start, known=()):
    """Ascents from a start, of ascending ranks."""
    ascents, below = [], None
    for k, problem in enumerate(problems):
        ascent = follow(problem, start, below, known[k : k + 1])
        ascents.append(_no_lower(problem, start, ascent))
        below = problem, ascents[-1]
    return ascents


def _no_lower(problem, start, ascent):
    """The ascent, or one that ends no lower than where step 1 ended."""
    if start.log_noise_found is None:
        return ascent
    theta = start._replace(log_noise=start.log_noise_found).theta(problem)
    likelihood = problem.likelihood()
    with limit_threads(likelihood.side):
        value = likelihood.value(theta)
    if not value > ascent.mode.value:
        return ascent
    return ascent._replace(mode=ascent.mode.then(climb(problem, theta)))


def follow(problem, start, below=None, known=()):
    """The ascent of a model from a start.

    While the noise of data without any is held up, all ranks but the lowest have all
    but the same mode: each begins where the one below it was.

    Parameters
    ----------
    problem : Problem
        What to learn.
    start : Start
        Where step 3 begins.
    below : (Problem, Ascent), default=None
        Of the next lower rank, from the same start.
    known : sequence of Ascent
        Of the same problem from other starts.

    Returns
    -------
    ascent : Ascent
    """
    if below is not None:
        lower, ascent = below
        held = not lower.is_noisy(ascent.held, beyond=0.1)
        if held and has_columns_more(lower, problem):
            return _follow_higher(lower, problem, ascent, known)
    return annealed(problem, start.theta(problem), known)


def _follow_higher(lower, problem, below, others):
    """An ascent from where a lower rank's was; it ends no lower."""
    ascent = annealed(problem, with_columns(lower, problem, below.held), others)
    same = embedded(lower, problem, below.mode)
    return ascent._replace(mode=best_of([ascent.mode, same]))


def from_each_start(function, jobs, *, n_jobs=None, report=None):
    """``function(problem, start)``, with each of several starts.

    Parameters
    ----------
    function : callable
        Gives a Mode.
    jobs : list of (Problem, list of starts)
        What to learn, and from where.
    n_jobs : int, default=None
        Processes.
    report : callable, default=None
        Called with the position of each start and its mode.

    Returns
    -------
    modes : list of list of Mode
        Of each job, from each of its starts.
    """
    starts = [(problem, start) for problem, of in jobs for start in of]
    modes = iter(run(function, starts, n_jobs=n_jobs, report=report))
    return [list(islice(modes, len(of))) for _, of in jobs]


def add_diagonal(problem, simpler):
    """The mode of a model, as one with a diagonal that does not matter, learned on.

    Parameters
    ----------
    problem : Problem
        With a diagonal.
    simpler : Mode
        A mode of the model without it.

    Returns
    -------
    mode : Mode
        Not worse than with the smallest diagonal.
    """
    prior = problem.prior
    without = prior.with_form(prior.task_covariance.form)
    rho = without.values(simpler.theta).rho
    rho = prior.task_covariance.with_smallest(rho, prior.scale)
    theta = prior.with_rho(simpler.theta, rho)
    value = problem.likelihood().value(theta)
    raised = climb(problem, problem.with_noise(theta))
    simplest = simpler._replace(theta=theta, value=value, rivals=())
    return best_of([simplest, simpler.led_to(raised)])


def with_starts(mode, starts):
    """The mode, with what was spent on its starts, which all ranks share."""
    return mode.counting([start.mode for start in starts if start.mode])


def full_rank_start(problem, start):
    """A start whose K_1^rho, before its rank is constrained, is a full-rank fit's.

    The fit is relaxed and begins with K^rho = I. It takes as long as several ranks, and
    with many tasks of few rows it would not end.
    """
    n_tasks, budget = problem.prior.n_tasks, problem.budget
    budget = replace(
        budget, max_iter=min(budget.max_iter, problem.tuning.full_rank_steps)
    )
    problem = replace(problem.with_form(low_rank(n_tasks, n_tasks)), budget=budget)
    theta = start._replace(K_rho=np.eye(n_tasks)).theta(problem)
    mode = climb(problem, theta, relaxed=True)
    kernel = problem.prior.values(mode.theta).kernel
    K_rho, level = (
        problem.prior.K_rho_at(mode.theta),
        problem.prior.log_level_at(mode.theta),
    )
    return Start(kernel, K_rho, mode, log_level=level)


def perturbed(start, seed):
    """A random start near another: log parameters moved, tasks mixed."""
    rng = np.random.default_rng(seed)
    theta = start.kernel_theta + rng.standard_normal(len(start.kernel_theta))
    mixing = rng.standard_normal(start.K_rho.shape)
    mixing = np.eye(len(mixing)) + 0.3 * mixing
    return Start(theta, mixing @ start.K_rho @ mixing.T, log_noise=start.log_noise)
