"""One climb of the marginal likelihood, from a starting point to a mode."""

from functools import partial
from time import perf_counter

import numpy as np

from skmtgp._numerics.bfgs import minimize
from skmtgp.learning.problem import Mode, best_of

RELAXED = 5.0  # standard deviation of the log parameters of k^x
RELAXED_TOL = 0.3  # nats
DOUBT = 1.0  # nats
LOWERED = 1e-3, 1e-1  # noise variance of noisy data while it is held down, of a mode's
REPORT_EVERY = 100  # iterations


def climb(data, settings, form, theta, *, relaxed=False, held=None):
    """Maximise the log marginal likelihood from theta.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Kernel, bounds and budget.
    form : FixedTaskCovariance, LowRank or WithDiagonal
        Form of K^rho.
    theta : ndarray of shape (n_theta,)
        Starting point.
    relaxed : bool, default=False
        Whether a wide quadratic penalty holds the logarithms of the parameters of k^x
        near their starting values. Otherwise those that do not matter yet, while the
        noise is large, are switched off, and a logarithm at minus infinity has no
        gradient that would bring them back.
    held : {"up", "down"}, default=None
        Whether the noise variance is held up, see `Settings.log_held`, or down, where
        it begins.

    Returns
    -------
    mode : Mode
        Its value is without the penalty.
    """
    likelihood = settings.likelihood(data, form)
    penalise = partial(_penalty, settings.kernel.theta, relaxed)
    lower, upper = _bounds(settings, form, theta, held)
    begin = perf_counter()
    best = minimize(
        _objective(likelihood, penalise),
        np.clip(theta, lower, upper),
        lower,
        upper,
        metric=_metric(likelihood),
        max_iter=settings.max_iter,
        tol=max(settings.tol, RELAXED_TOL) if relaxed else settings.tol,
        report=_reporter(data, settings, form),
    )
    value = penalise(best.x)[0] - best.value
    mode = Mode(best.x, value, *best[2:], perf_counter() - begin, len(data.y), data.Z)
    _report_end(data, settings, form, mode)
    return mode


def _bounds(settings, form, theta, held):
    """The bounds of theta while the noise variance is held."""
    lower, upper = settings.bounds(form)
    tail = settings.tail(form)
    if held == "up":
        lower[tail] = settings.log_held
    elif held == "down":
        upper[tail] = np.maximum(theta[tail], lower[tail])
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


def _penalty(start, relaxed, theta):
    """What holds the parameters of k^x near their start if relaxed; its gradient."""
    away = np.zeros_like(theta)
    if relaxed:
        away[: len(start)] = theta[: len(start)] - start
    slope = RELAXED**-2 * away
    return 0.5 * (away @ slope), slope


def information_or_zero(likelihood, theta):
    """Fisher information of theta; zero where K of its rows is singular."""
    try:
        information = likelihood.fisher_information(theta)
    except np.linalg.LinAlgError:  # the gradient alone points the way
        return np.zeros((len(theta), len(theta)))
    return information if np.isfinite(information).all() else np.zeros_like(information)


def annealed(data, settings, form, theta):
    """Climb relaxed and with the noise held up, then on from there without.

    While the noise is held up the landscape has few modes, and most starts lead to the
    same one.
    """
    return held_first("up", data, settings, form, theta)


def held_first(held, data, settings, form, theta):
    """Climb relaxed and with the noise held "up" or "down", then on without."""
    before = climb(data, settings, form, theta, relaxed=True, held=held)
    return before.then(climb(data, settings, form, before.theta))


def refine(data, settings, form, mode):
    """Learn with more and more of the rows, from a mode of the coarsest level.

    The noise variance that a few rows asked for is too small for more of them. The
    second level anneals once more, for a better mode; later ones only climb.
    """
    way = annealed
    for level in data.levels()[1:]:
        theta = settings.with_noise(mode.theta, form)
        mode = mode.then(way(level, settings, form, theta))
        way = climb
    return mode


def shake(data, settings, form, mode, times):
    """Change the noise of a mode and climb again, several times; the best of all.

    This leaves poor modes of data without noise: with more noise than it wants, the
    likelihood is smooth enough to choose other features. Of noisy data it is lowered.
    """
    modes = [mode]
    for _ in range(times):
        theta = settings.with_noise(mode.theta, form)
        if (theta == mode.theta).all():  # the data are noisy
            modes += _lowered(data, settings, form, mode)
            break
        mode = mode.led_to(climb(data, settings, form, theta))
        modes.append(mode)
    return best_of(modes, doubt=DOUBT)


def _lowered(data, settings, form, mode):
    """Modes to which lower noise leads, each from the best before.

    What varies little, beside other things that vary much, may have been taken for
    noise. While that is held down, k^x has to explain it.
    """
    tail, modes = settings.tail(form), [mode]
    lowest = settings.bounds(form)[0, tail]
    for factor in LOWERED:
        best = max(modes, key=lambda mode: mode.value)
        theta = best.theta.copy()
        theta[tail] = np.maximum(theta[tail] + np.log(factor), lowest)
        if (theta < best.theta).any():  # it is not fixed
            other = held_first("down", data, settings, form, theta)
            modes.append(best.led_to(other))
    return modes[1:]


def _reporter(data, settings, form):
    """What prints a line every so many iterations, or None."""
    if settings.verbose < 2:
        return None

    def report(n_iter, x, value):
        if n_iter % REPORT_EVERY == 0:
            _say(data, settings, form, n_iter, -value, x)

    return report


def _report_end(data, settings, form, mode):
    if settings.verbose >= 2:
        why = "no more gain" if mode.converged else "budget spent"
        why = "no digits left" if mode.stalled else why
        _say(data, settings, form, mode.n_iter, mode.value, mode.theta, f": {why}")


def _say(data, settings, form, n_iter, value, theta, why=""):
    noise = np.exp(theta[-len(settings.log_noise) :].min()) / settings.scale**2
    print(
        f"[skmtgp] {settings.name}, {form}, {len(data.y)} rows, iteration {n_iter}: "
        f"log marginal likelihood {value:.2f}, noise variance {noise:.1e} of the "
        f"target's{why}",
        flush=True,
    )
