r"""Maximising the marginal likelihood.

The staged heuristic of the paper's section 3, with what it takes to find good modes:

1. theta^x is learned with K_0^rho = I and with K_0^rho = 1 1^T, *relaxed*: a wide
   quadratic penalty in the log domain holds it near its start. Without it, features
   that do not matter yet are switched off while the noise is still large, and a
   logarithm at minus infinity has no gradient that would bring them back.
2. K_1^rho is computed from either, section 3.2.
3. All parameters are learned from K_1^rho and sigma_0^2, by a dense quasi-Newton method
   that starts from the Fisher information. Each of the starts is followed to its end.

Stages 1 and 2 do not depend on the rank. Models are nested in the rank: where a rank
ends below a lower one, it is learned again from the lower one's mode.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._bfgs import minimize
from skmtgp._parallel import printer, run
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.task_covariance import identity, low_rank, ones

RELAXED = 5.0  # standard deviation of the log parameters of k^x in stage 1
RELAXED_TOL = 0.1  # nats


@dataclass(frozen=True)
class Data:
    """The observations of one output.

    Attributes
    ----------
    X : ndarray of shape (n_samples, n_features)
        Inputs, sorted by task.
    tasks : ndarray of shape (n_samples,)
        Tasks, 0 to n_tasks - 1.
    y : ndarray of shape (n_samples,)
        Targets.
    n_tasks : int
        Number of tasks M.
    """

    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray
    n_tasks: int


@dataclass(frozen=True)
class Settings:
    """What is learned, from where, and for how long.

    Attributes
    ----------
    kernel : Kernel
        k^x with the starting values theta_0^x.
    scale : float
        Root mean square of the targets.
    log_noise : ndarray of shape (n_noise,)
        Logarithm of sigma_0^2, shared or for each task.
    log_noise_bounds : pair of floats
        Logarithms of its bounds.
    max_iter : int
        Most iterations of each maximisation.
    tol : float
        Gain in nats under which a maximisation ends.
    """

    kernel: Kernel
    scale: float
    log_noise: np.ndarray
    log_noise_bounds: tuple
    max_iter: int
    tol: float

    def likelihood(self, data, form):
        """The objective for a form of K^rho."""
        n_noise = len(self.log_noise)
        return DenseLikelihood(
            self.kernel, form, data.X, data.tasks, data.y, n_noise=n_noise
        )

    def bounds(self, form):
        """Lower and upper bounds of theta, of shape (2, n_theta)."""
        noise = np.tile(self.log_noise_bounds, (len(self.log_noise), 1))
        kernel = self.kernel.bounds.reshape(-1, 2)
        return np.concatenate([kernel, form.bounds(self.scale), noise]).T


class Mode(NamedTuple):
    """A local maximum of the log marginal likelihood.

    Attributes
    ----------
    theta : ndarray of shape (n_theta,)
        Parameters.
    value : float
        Log marginal likelihood.
    n_iter : int
        Iterations of the maximisation that ended here.
    n_evaluations : int
        Likelihoods and gradients that it took.
    converged : bool
        Whether it ended by its tolerance.
    stalled : bool
        Whether it ended for lack of digits: more gain was expected, no step gained.
    seconds : float
        Time that was spent on it and on the modes that it was preferred to.
    """

    theta: np.ndarray
    value: float
    n_iter: int
    n_evaluations: int
    converged: bool
    stalled: bool
    seconds: float


def climb(data, settings, form, theta, relaxed=None):
    """Maximise the log marginal likelihood from theta.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    form : FixedTaskCovariance or LowRank
        Form of K^rho.
    theta : ndarray of shape (n_theta,)
        Starting point.
    relaxed : float, default=None
        Standard deviation of the penalty that holds the parameters of k^x near their
        starting values. None is no penalty.

    Returns
    -------
    mode : Mode
        Its value is without the penalty.
    """
    likelihood = settings.likelihood(data, form)
    lower, upper = settings.bounds(form)
    theta = np.clip(theta, lower, upper)
    precision = np.zeros(len(theta))
    if relaxed is not None:
        precision[: likelihood.node.n_dims] = relaxed**-2
    centre = np.zeros(len(theta))
    centre[: likelihood.node.n_dims] = settings.kernel.theta

    def metric(theta):
        return likelihood.fisher_information(theta) + np.eye(len(theta))

    def objective(theta):
        value, gradient = likelihood.value_and_grad(theta)
        away = theta - centre
        penalty = precision * away
        return 0.5 * (away @ penalty) - value, penalty - gradient

    begin = perf_counter()
    best = minimize(
        objective,
        theta,
        lower,
        upper,
        metric=metric,
        max_iter=settings.max_iter,
        tol=settings.tol if relaxed is None else RELAXED_TOL,
    )
    away = best.x - centre
    value = 0.5 * (precision * away) @ away - best.value
    seconds = perf_counter() - begin
    return Mode(best.x, value, *best[2:], seconds)


def best_of(modes):
    """The best mode, with the time of all."""
    best = max(modes, key=lambda mode: mode.value)
    return best._replace(seconds=sum(mode.seconds for mode in modes))


def learn_fixed(data, settings, form):
    """Learn theta^x and sigma^2 with K^rho fixed: the models iGP and pGP."""
    kappa = form.parameters(1.1 * np.eye(data.n_tasks))  # 0.1, if it is learned
    theta = np.concatenate([settings.kernel.theta, kappa, settings.log_noise])
    relaxed = climb(data, settings, form, theta, RELAXED)
    return climb(data, settings, form, relaxed.theta)


class Start(NamedTuple):
    """Where step 3 begins: theta_1^x and K_1^rho before its rank is constrained."""

    kernel_theta: np.ndarray
    K_rho: np.ndarray


def first_stage(data, settings, form):
    """Steps 1 and 2 of section 3, with K_0^rho of the given form."""
    theta = np.concatenate([settings.kernel.theta, settings.log_noise])
    mode = climb(data, settings, form, theta, RELAXED)
    likelihood = settings.likelihood(data, form)
    K_rho = augmented_task_covariance(data, likelihood.posterior(mode.theta))
    return Start(likelihood.split(mode.theta)[0], K_rho)


def augmented_task_covariance(data, posterior):
    r"""K_aug^rho of section 3.2.

    .. math:: K_{aug}^\rho
        = N^{-1} T_{aug}^T (K_1^x + \eta^2 I)^{-1} T_{aug}

    Parameters
    ----------
    data : Data
        Observations.
    posterior : DensePosterior
        The GP with (theta_1^x, K_0^rho, sigma_1^2).

    Returns
    -------
    K_rho : ndarray of shape (n_tasks, n_tasks)
        Positive semi-definite.
    """
    X, row = np.unique(data.X, axis=0, return_inverse=True)
    row = row.reshape(-1)
    T_aug = posterior.mean_of_tasks(X, np.arange(data.n_tasks))
    observed, count = np.zeros_like(T_aug), np.zeros_like(T_aug)
    np.add.at(observed, (row, data.tasks), data.y)
    np.add.at(count, (row, data.tasks), 1.0)
    np.divide(observed, count, out=T_aug, where=count > 0.0)
    eta_squared = np.square(T_aug).mean()  # tr(T_aug^T T_aug) / (M N)
    K_x = posterior.kernel(X)
    K_x[np.diag_indices_from(K_x)] += eta_squared
    return T_aug.T @ np.linalg.solve(K_x, T_aug) / len(X)


def second_stage(data, settings, form, starts):
    """Step 3 of section 3 from each (theta_1^x, K_1^rho) and sigma_0^2; the best."""
    modes = []
    for start in starts:
        rho = form.parameters(start.K_rho)
        theta = np.concatenate([start.kernel_theta, rho, settings.log_noise])
        mode = climb(data, settings, form, theta)
        modes.append(reheat(data, settings, form, mode) if mode.stalled else mode)
    return best_of(modes)


def reheat(data, settings, form, mode):
    """Learn again from a mode, with sigma_0^2 for its noise and k^x relaxed.

    Where the prior variance has grown to 1e14 times the noise variance, neither the
    likelihood nor its gradient has the digits to go on. With the noise back at its
    start there is a way out, as a rule to a better mode.
    """
    theta = np.concatenate([mode.theta[: -len(settings.log_noise)], settings.log_noise])
    relaxed = climb(data, settings, form, theta, RELAXED)
    again = climb(data, settings, form, relaxed.theta)
    return best_of([mode, again])


def full_rank_start(data, settings, start):
    """A start whose K_1^rho, before its rank is constrained, is a full-rank fit's.

    The fit is relaxed and begins with K^rho = I. It takes as long as several ranks.
    """
    form = low_rank(data.n_tasks, data.n_tasks)
    rho = form.parameters(np.eye(data.n_tasks))
    theta = np.concatenate([start.kernel_theta, rho, settings.log_noise])
    mode = climb(data, settings, form, theta, RELAXED)
    kernel, rho, _ = settings.likelihood(data, form).split(mode.theta)
    return Start(kernel, form.matrix(rho))


def perturbed(start, seed):
    """A random start near another: log parameters moved, tasks mixed."""
    rng = np.random.default_rng(seed)
    theta = start.kernel_theta + rng.standard_normal(len(start.kernel_theta))
    mixing = rng.standard_normal(start.K_rho.shape)
    mixing = np.eye(len(mixing)) + 0.3 * mixing
    return Start(theta, mixing @ start.K_rho @ mixing.T)


def nest(data, settings, forms, modes):
    """Learn a rank again from a lower one's mode where it ended below it.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    forms : list of LowRank
        Forms of K^rho of ascending rank.
    modes : list of Mode
        The mode of each.

    Returns
    -------
    modes : list of Mode
        Their values do not fall as the rank grows.
    """
    modes = list(modes)
    for k in range(1, len(forms)):
        if modes[k].value < modes[k - 1].value:
            embedded, grown = _embed(data, settings, forms[k - 1 : k + 1], modes[k - 1])
            regrown = climb(data, settings, forms[k], grown)
            lower = modes[k - 1]._replace(theta=embedded, seconds=0.0)
            modes[k] = best_of([modes[k], regrown, lower])
    return modes


def _embed(data, settings, forms, mode):
    """A mode as one of the next rank: with empty columns, and with better ones.

    The best new columns are along the leading eigenvectors of dL / dK^rho; their
    length is the best of a few.
    """
    lower, higher = forms
    kernel, rho, noise = settings.likelihood(data, lower).split(mode.theta)
    D = settings.likelihood(data, lower).task_gradient(mode.theta)
    added = higher.rank - lower.rank
    columns = np.linalg.eigh(D)[1][:, -added:]
    size = np.sqrt(np.trace(lower.matrix(rho)))

    def with_columns(length):
        grown = lower.grown(rho, length * columns)
        return np.concatenate([kernel, grown, noise])

    likelihood = settings.likelihood(data, higher)
    candidates = [with_columns(size * 10.0**-k) for k in range(1, 9)]
    return with_columns(0.0), max(candidates, key=likelihood.value)


def learn_ranks(pairs, forms, *, seeds=(), n_jobs=None, verbose=0):
    """Learn models of several ranks for several outputs.

    Parameters
    ----------
    pairs : list of (Data, Settings)
        For each output.
    forms : list of LowRank
        Forms of K^rho of ascending rank.
    seeds : sequence of int, default=()
        One for each additional start: the first of them truncates a full-rank fit, the
        others are perturbed with these seeds.
    n_jobs : int, default=None
        Processes.
    verbose : int, default=0
        Whether to print a line for each rank and output.

    Returns
    -------
    modes : list of list of Mode
        The best mode found, for each output and form.
    """
    n, starts = len(forms), _starts(pairs, seeds, n_jobs)
    jobs = [
        (*pair, form, of_output)
        for pair, of_output in zip(pairs, starts, strict=True)
        for form in forms
    ]

    def describe(i, mode):
        j, k = divmod(i, n)
        return (
            f"output {j + 1} of {len(pairs)}, rank {forms[k].rank}: log marginal "
            f"likelihood {mode.value:.2f} (scaled) after {mode.n_iter} iterations"
        )

    modes = run(second_stage, jobs, n_jobs=n_jobs, report=printer(verbose, describe))
    jobs = [(*pair, forms, modes[n * j : n * j + n]) for j, pair in enumerate(pairs)]
    return run(nest, jobs, n_jobs=n_jobs)


def _starts(pairs, seeds, n_jobs):
    """Where step 3 begins, a list for each output; the same for all ranks."""
    M = pairs[0][0].n_tasks
    fixed = [identity(M), ones(M)][: min(M, 2)]
    jobs = [(*pair, form) for pair in pairs for form in fixed]
    starts = run(first_stage, jobs, n_jobs=n_jobs)
    starts = [starts[j : j + len(fixed)] for j in range(0, len(starts), len(fixed))]
    if seeds:
        jobs = [(*pair, of[0]) for pair, of in zip(pairs, starts, strict=True)]
        full_rank = run(full_rank_start, jobs, n_jobs=n_jobs)
        for of_output, start in zip(starts, full_rank, strict=True):
            random = [perturbed(of_output[0], seed) for seed in seeds[1:]]
            of_output.extend([start, *random])
    return starts
