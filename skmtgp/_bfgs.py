"""Minimisation within bounds by a dense quasi-Newton method.

Likelihoods of noise-free data are curved valleys with condition numbers far above
10^6, where limited memory stalls. There are rarely more than a few hundred parameters,
so the full matrix costs nothing beside one evaluation.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

ARMIJO, CURVATURE = 1e-4, 0.9
LONGEST_STEP = 3.0
PATIENCE = 20
MAX_LINE_SEARCH = 20


class Optimum(NamedTuple):
    """Where a minimisation ended.

    Attributes
    ----------
    x : ndarray of shape (n_parameters,)
        The best point.
    value : float
        Its value.
    n_iter : int
        Accepted steps.
    n_evaluations : int
        Calls of the objective.
    converged : bool
        Whether no more gain was expected, rather than the budget spent.
    """

    x: np.ndarray
    value: float
    n_iter: int
    n_evaluations: int
    converged: bool


def minimize(fun, x, lower, upper, *, metric=None, max_iter, tol, report=None):
    """Minimise a smooth function within bounds by BFGS steps on the free parameters.

    Parameters
    ----------
    fun : callable
        x -> (value, gradient). A value that is not finite is a rejected step.
    x : ndarray of shape (n_parameters,)
        Starting point.
    lower, upper : ndarray of shape (n_parameters,)
        Bounds.
    metric : ndarray of shape (n_parameters, n_parameters), default=None
        First guess of the Hessian, positive definite. None is a multiple of I.
    max_iter : int
        Most iterations.
    tol : float
        Stop when, for several iterations, neither the model expects a step to gain
        more than this nor the steps did.
    report : callable, default=None
        Called after each iteration with the iteration's number and the value.

    Returns
    -------
    optimum : Optimum
        The best point found.
    """
    return _BFGS(fun, x, lower, upper, metric).run(max_iter, tol, report)


class _BFGS:
    def __init__(self, fun, x, lower, upper, metric):
        self.fun, self.lower, self.upper = fun, lower, upper
        self.n_evaluations = 0
        self.x = np.clip(x, lower, upper)
        self.f, self.g = self._evaluate(self.x)
        self.B, self.guessed = metric, metric is None

    def run(self, max_iter, tol, report):
        n_iter = still = 0
        converged = max_iter > 0 and np.isfinite(self.f) and not len(self.x)
        while n_iter < max_iter and np.isfinite(self.f) and not converged:
            direction, expected_gain = self._direction()
            step = self._line_search(direction)
            if step is None:
                if self.guessed or expected_gain < tol:
                    converged = expected_gain < tol
                    break
                self.B, self.guessed = None, True  # the model of the Hessian is lost
                continue
            n_iter += 1
            gain = self.f - step[1]
            self._update(*step)
            still = still + 1 if max(gain, expected_gain) < tol else 0
            converged = still >= PATIENCE
            if report is not None:
                report(n_iter, self.f)
        return Optimum(self.x, self.f, n_iter, self.n_evaluations, converged)

    def _evaluate(self, x):
        self.n_evaluations += 1
        f, g = self.fun(x)
        return (f, g) if np.isfinite(f) and np.isfinite(g).all() else (np.inf, g)

    def _direction(self):
        """Quasi-Newton step of the parameters not held at a bound; its gain."""
        x, g = self.x, self.g
        held = ((x <= self.lower) & (g > 0.0)) | ((x >= self.upper) & (g < 0.0))
        free = np.flatnonzero(~held)
        direction = np.zeros_like(x)
        if not free.size:
            return direction, 0.0
        try:
            if self.B is None:
                raise LinAlgError
            B = cho_factor(self.B[np.ix_(free, free)])
            direction[free] = -cho_solve(B, g[free])
        except LinAlgError:
            norm = np.linalg.norm(g[free])
            self.B, self.guessed = np.eye(len(x)) * max(norm, 1e-300), True
            direction[free] = -g[free] / max(norm, 1e-300)
        expected_gain = -0.5 * (g @ direction)
        longest = np.abs(direction).max()
        return direction * min(1.0, LONGEST_STEP / max(longest, 1e-300)), expected_gain

    def _line_search(self, direction):
        """A point of sufficient decrease (Armijo) and, if it can be, curvature."""
        slope = self.g @ direction
        if slope >= 0.0:
            return None
        low, high, f_low, slope_low, step, best = 0.0, np.inf, self.f, slope, 1.0, None
        for _ in range(MAX_LINE_SEARCH):
            x = np.clip(self.x + step * direction, self.lower, self.upper)
            f, g = self._evaluate(x)
            if not f <= self.f + ARMIJO * (self.g @ (x - self.x)):
                high = step
                step = low + _shrink(step - low, f_low, slope_low, f)
                continue
            best = x, f, g
            if g @ direction >= CURVATURE * slope or self._clipped(step, direction):
                break
            low, f_low, slope_low = step, f, g @ direction
            step = 2.5 * step if np.isinf(high) else 0.5 * (low + high)
        return best

    def _clipped(self, step, direction):
        target = self.x + step * direction
        return bool(((target < self.lower) | (target > self.upper)).any())

    def _update(self, x, f, g):
        """BFGS update of the Hessian where the curvature along the step is positive."""
        s, y = x - self.x, g - self.g
        self.x, self.f, self.g = x, f, g
        curvature = s @ y
        if curvature <= 0.0:
            return
        if self.guessed:
            self.B, self.guessed = np.eye(len(x)) * (y @ y) / curvature, False
        Bs = self.B @ s
        if curvature >= 1e-8 * (s @ Bs):
            self.B = self.B + np.outer(y, y) / curvature - np.outer(Bs, Bs) / (s @ Bs)


def _shrink(width, f, slope, f_end):
    """A shorter step, from the parabola through the interval's data."""
    if not np.isfinite(f_end):
        return 0.1 * width
    curvature = 2.0 * (f_end - f - width * slope)
    step = -slope * width**2 / curvature if curvature > 0.0 else 0.5 * width
    return float(np.clip(step, 0.1 * width, 0.5 * width))
