"""One climb of the marginal likelihood, from a starting point to a mode."""

from time import perf_counter

import numpy as np

from skmtgp._numerics.bfgs import minimize
from skmtgp.learning.problem import Mode, best_of


def climb(problem, theta, *, relaxed=False, held=None):
    """Maximise the log marginal likelihood from theta.

    Parameters
    ----------
    problem : Problem
        What to learn.
    theta : ndarray of shape (n_theta,)
        Starting point.
    relaxed : bool, default=False
        Whether a wide quadratic penalty holds the logarithms of the parameters of k^x
        near their starting values. Otherwise those that do not matter yet, while the
        noise is large, are switched off, and a logarithm at minus infinity has no
        gradient that would bring them back.
    held : {"up", "down"}, default=None
        Whether the noise variance is held up, see `Problem.log_held`, or down, where
        it begins.

    Returns
    -------
    mode : Mode
        Its value is without the penalty.
    """
    likelihood, budget = problem.likelihood(), problem.budget
    penalise = _penalty(problem, relaxed)
    lower, upper = _bounds(problem, theta, held)
    tol = max(budget.tol, problem.tuning.relaxed_tol) if relaxed else budget.tol
    begin = perf_counter()
    best = minimize(
        _objective(likelihood, penalise),
        np.clip(theta, lower, upper),
        lower,
        upper,
        metric=_metric(likelihood),
        max_iter=budget.max_iter,
        tol=tol,
        report=_reporter(problem),
    )
    value, seconds = penalise(best.x)[0] - best.value, perf_counter() - begin
    data = problem.data
    mode = Mode(best.x, value, *best[2:], seconds, len(data), data.Z)
    _report_end(problem, mode)
    return mode


def _bounds(problem, theta, held):
    """The bounds of theta while the noise variance is held."""
    lower, upper = problem.prior.bounds()
    if held == "up":
        lower[problem.prior.unexplained] = problem.log_held
    elif held == "down":
        lowest = np.maximum(theta, lower)
        upper = np.where(problem.prior.unexplained, lowest, upper)
    return lower, upper


def _objective(likelihood, penalise):
    """What is minimised, with its gradient."""

    def objective(theta):
        value, gradient = likelihood.value_and_grad(theta)
        penalty, slope = penalise(theta)
        return penalty - value, slope - gradient

    return objective


def _metric(likelihood):
    """The first guess of its Hessian: Fisher information, made definite."""

    def metric(theta):
        return information_or_zero(likelihood, theta) + np.eye(len(theta))

    return metric


def _penalty(problem, relaxed):
    """What holds the parameters of k^x near their start if relaxed, and its slope."""
    start, of_kernel = problem.prior.kernel.theta, problem.prior.of_kernel

    def penalise(theta):
        away = np.zeros_like(theta)
        if relaxed:
            away[of_kernel] = theta[of_kernel] - start
        slope = problem.tuning.relaxed**-2 * away
        return 0.5 * (away @ slope), slope

    return penalise


def information_or_zero(likelihood, theta):
    """Fisher information of theta; zero where K of its rows is singular."""
    try:
        information = likelihood.fisher_information(theta)
    except np.linalg.LinAlgError:  # the gradient alone points the way
        return np.zeros((len(theta), len(theta)))
    return information if np.isfinite(information).all() else np.zeros_like(information)


def annealed(problem, theta):
    """Climb relaxed and with the noise held up, then on from there without.

    While the noise is held up the landscape has few modes, and most starts lead to the
    same one.
    """
    return held_first("up", problem, theta)


def held_first(held, problem, theta):
    """Climb relaxed and with the noise held "up" or "down", then on without."""
    before = climb(problem, theta, relaxed=True, held=held)
    return before.then(climb(problem, before.theta))


def refine(problem, mode):
    """Learn with more and more of the rows, from a mode of the coarsest level.

    The noise variance that a few rows asked for is too small for more of them. The
    second level anneals once more, for a better mode; later ones only climb.
    """
    way = annealed
    for finer in problem.coarse_to_fine()[1:]:
        mode = mode.then(way(finer, problem.with_noise(mode.theta)))
        way = climb
    return mode


def shake(problem, mode, times):
    """Change the noise of a mode and climb again, several times; the best of all.

    This leaves poor modes of data without noise: with more noise than it wants, the
    likelihood is smooth enough to choose other features. Of noisy data it is lowered.
    """
    modes = [mode]
    for _ in range(times):
        theta = problem.with_noise(mode.theta)
        if (theta == mode.theta).all():  # the data are noisy
            modes += _lowered(problem, mode)
            break
        mode = mode.led_to(climb(problem, theta))
        modes.append(mode)
    return best_of(modes, doubt=problem.tuning.doubt)


def _lowered(problem, mode):
    """Modes to which lower noise leads, each from the best before.

    What varies little, beside other things that vary much, may have been taken for
    noise. While that is held down, k^x has to explain it.
    """
    lowest, modes = problem.prior.bounds()[0], [mode]
    for factor in problem.tuning.lowered:
        best = max(modes, key=lambda mode: mode.value)
        lower = np.maximum(best.theta + np.log(factor), lowest)
        theta = np.where(problem.prior.unexplained, lower, best.theta)
        if (theta < best.theta).any():  # it is not fixed
            modes.append(best.led_to(held_first("down", problem, theta)))
    return modes[1:]


def _reporter(problem):
    """What prints a line every so many iterations, or None."""
    if problem.budget.verbose < 2:
        return None

    def report(n_iter, x, value):
        if n_iter % problem.tuning.report_every == 0:
            _say(problem, n_iter, -value, x)

    return report


def _report_end(problem, mode):
    if problem.budget.verbose >= 2:
        why = "no more gain" if mode.converged else "budget spent"
        why = "no digits left" if mode.stalled else why
        _say(problem, mode.n_iter, mode.value, mode.theta, f": {why}")


def _say(problem, n_iter, value, theta, why=""):
    prior = problem.prior
    noise = np.exp(prior.log_noise_at(theta).min()) / prior.scale**2
    print(
        f"[skmtgp] {problem.name}, {prior}, {len(problem.data)} rows, iteration "
        f"{n_iter}: log marginal likelihood {value:.2f}, noise variance {noise:.1e} of "
        f"the target's{why}",
        flush=True,
    )
