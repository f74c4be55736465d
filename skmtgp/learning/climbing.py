"""One climb of the marginal likelihood, from a starting point to a mode."""

from time import perf_counter
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.agreement import Rivals
from skmtgp.learning.problem import Mode, best_of
from skmtgp.learning.telling import Teller


def climb(
    problem,
    theta,
    *,
    relaxed=False,
    held=None,
    known=(),
    least=-np.inf,
    noisy=False,
    futile=None,
):
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
        it begins, for some iterations.
    known : sequence of Mode
        Where others of its kind ended. It ends where it is about to end there, too, or
        cannot hope to come as far.
    least : float, default=-inf
        What it must reach to be of use. It ends where it cannot hope for that.
    noisy : bool, default=False
        Whether the data are known to have noise, so that it soon shows.
    futile : callable, default=None
        Called with theta after some of the iterations; where it is true the climb ends.

    Returns
    -------
    mode : Mode
        Its value is without the penalty.
    """
    likelihood, budget = problem.likelihood(), problem.budget
    penalise = _penalty(problem, relaxed)
    lower, upper = _bounds(problem, theta, held)
    tol = max(budget.tol, problem.tuning.relaxed_tol) if relaxed else budget.tol
    exactly = budget.tol < problem.tuning.single_tol
    learned = likelihood if exactly else likelihood.in_single()
    begin, teller = perf_counter(), Teller(problem)
    rivals = Rivals(problem, known, least, noisy=noisy)
    teller.begin()
    with limit_threads(likelihood.side):  # else each evaluation does, which takes time
        best = minimize(
            teller.told(_objective(learned, penalise)),
            np.clip(theta, lower, upper),
            lower,
            upper,
            metric=_metric(likelihood),
            max_iter=_most_iterations(problem, held),
            tol=tol,
            patience=problem.tuning.relaxed_patience if relaxed else budget.patience,
            rounding=0.1 * problem.tuning.single_tol if learned.single else 0.0,
            report=_watch(problem, rivals, futile, penalise, teller),
        )
    value, data = penalise(best.x)[0] - best.value, problem.data
    if learned.single:
        value = likelihood.value(best.x)
    seconds = perf_counter() - begin
    mode = Mode(best.x, value, *best[2:], seconds, len(data), data.Z)
    teller.end(mode)
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


def _most_iterations(problem, held):
    most, tuning = problem.budget.max_iter, problem.tuning
    return min(most, tuning.held_down) if held == "down" else most


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
    start, of_kernel = problem.prior.kernel_theta, problem.prior.of_kernel

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


class Ascent(NamedTuple):
    """Two climbs, one after the other.

    Attributes
    ----------
    held : Mode
        Where the first one ended: relaxed, with the noise held.
    mode : Mode
        Where the second one ended, with what was spent on both.
    """

    held: Mode
    mode: Mode


def annealed(problem, theta, known=()):
    """Climb relaxed and with the noise held up, then on from there without.

    While the noise is held up the landscape has few modes, and most starts lead to the
    same one. From there the way is known.

    Parameters
    ----------
    problem : Problem
        What to learn.
    theta : ndarray of shape (n_theta,)
        Starting point.
    known : sequence of Ascent
        From other starts.

    Returns
    -------
    ascent : Ascent
        Without the second climb if the first one ended where another did, or far
        below.
    """
    before = [ascent.held for ascent in known]
    held = climb(problem, theta, relaxed=True, held="up", known=before)
    best = max((mode.value for mode in before), default=-np.inf)
    if held.value < best - problem.tuning.poorer or Rivals(problem, before).near(
        held.theta, held.value
    ):
        return Ascent(held, held)
    ends = [ascent.mode for ascent in known]
    return Ascent(held, held.then(climb(problem, held.theta, known=ends)))


def lowered_first(problem, theta, known=()):
    """Climb relaxed and with the noise held down for a while, then on without.

    What varies little, beside other things that vary much, may have been taken for
    noise. While that is held down, k^x has to explain it.

    Parameters
    ----------
    problem, theta
        See :func:`climb`.
    known : sequence of Mode
        At which the second climb may end.

    Returns
    -------
    mode : Mode
    """
    before = climb(problem, theta, relaxed=True, held="down")
    return before.then(climb(problem, before.theta, known=known))


def refine(problem, mode):
    """Learn with more and more of the rows, from a mode of the coarsest level.

    The noise variance that a few rows asked for is too small for more of them. The
    second level anneals once more, for a better mode; later ones only climb. Levels
    that vanished could not come back, so noisy data try them anew.
    """
    for k, finer in enumerate(problem.coarse_to_fine()[1:]):
        theta = problem.with_noise(mode.theta)
        found = mode.then(climb(finer, theta) if k else annealed(finer, theta).mode)
        if problem.noisy and not k and problem.prior.levels_vanish(mode.theta):
            anew = problem.prior.with_usual_levels(theta)
            found = best_of([found, mode.led_to(annealed(finer, anew).mode)])
        mode = shake(finer, found, 1) if _ended_early(finer, found) else found
    return mode


def _ended_early(problem, mode):
    """Whether no step was possible at a mode where one should gain much."""
    if not mode.stalled:
        return False
    likelihood, theta = problem.likelihood(), mode.theta
    with limit_threads(likelihood.side):
        slope, metric = likelihood.value_and_grad(theta)[1], _metric(likelihood)(theta)
    lower, upper = problem.prior.bounds()
    held = ((theta <= lower) & (slope < 0.0)) | ((theta >= upper) & (slope > 0.0))
    slope, metric = slope[~held], metric[np.ix_(~held, ~held)]
    gain = 0.5 * slope @ np.linalg.solve(metric, slope)
    return bool(gain > problem.tuning.doubt)


def shake(problem, mode, times):
    """Raise the noise of a mode and climb again, until that gains little; the best.

    This leaves poor modes of data without noise: with more noise than it wants, the
    likelihood is smooth enough to choose other features.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        The best so far.
    times : int
        At most.

    Returns
    -------
    mode : Mode
        Not worse.
    """
    modes = [mode]
    for _ in range(times):
        theta = problem.with_noise(mode.theta)
        if (theta == mode.theta).all():  # the data are noisy
            break
        mode = mode.led_to(climb(problem, theta, known=modes))
        modes.append(mode)
        if mode.value < modes[-2].value + problem.tuning.doubt:
            break
    return best_of(modes, doubt=problem.tuning.doubt)


def lower(problem, mode):
    """Modes to which lower noise leads, each from the best before.

    Parameters
    ----------
    problem : Problem
        What to learn.
    mode : Mode
        Of noisy data.

    Returns
    -------
    modes : list of Mode
        None if the noise is fixed.
    """
    lowest, modes = problem.prior.bounds()[0], [mode]
    for factor in problem.tuning.lowered:
        best = max(modes, key=lambda mode: mode.value)
        lower = np.maximum(best.theta + np.log(factor), lowest)
        theta = np.where(problem.prior.unexplained, lower, best.theta)
        if (theta < best.theta).any():
            modes.append(best.led_to(lowered_first(problem, theta, [best])))
    return modes[1:]


def _watch(problem, rivals, futile, penalise, teller):
    """What is called after each iteration: it may print, and may end the climb."""
    every = problem.tuning.look_every

    def watch(n_iter, x, value):
        teller.iterated(n_iter, x, -value)
        if rivals.settle(n_iter, x, penalise(x)[0] - value):
            return True
        return futile is not None and n_iter % every == 0 and futile(x)

    return watch
