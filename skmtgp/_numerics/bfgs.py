"""Minimisation within bounds by a quasi-Newton method.

Likelihoods of noise-free data are curved valleys with condition numbers far above
10^6, where limited memory stalls. There are rarely more than a few hundred parameters,
so the full matrix costs nothing beside one evaluation. Thousands of parameters are left
to limited memory.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from skmtgp._numerics.parallel import limit_threads

ARMIJO, CURVATURE = 1e-4, 0.9
LONGEST_STEP = 3.0
GROWTH = 1.5  # of the trial step over the last accepted one, up to 1
PATIENCE = 20  # iterations that gain less than the tolerance,
CERTAIN, NOTHING = 3, 0.01  # or so few, where less than that part of it is expected
MAX_LINE_SEARCH = 20
SHORT = 1e-3  # a step, of the one that was asked: far shorter
MOST_DENSE = 1000  # parameters
MEMORY = 50  # steps that limited memory keeps


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
        Whether no more gain was expected.
    stalled : bool
        Whether more gain was expected but no step brought any, or the starting point
        has no finite value. If neither, the budget was spent.
    """

    x: np.ndarray
    value: float
    n_iter: int
    n_evaluations: int
    converged: bool
    stalled: bool


def minimize(
    fun,
    x,
    lower,
    upper,
    *,
    metric=None,
    max_iter,
    tol,
    patience=PATIENCE,
    rounding=0.0,
    report=None,
):
    """Minimise a smooth function within bounds by BFGS steps on the free parameters.

    Parameters
    ----------
    fun : callable
        x -> (value, gradient). A value that is not finite is a rejected step.
    x : ndarray of shape (n_parameters,)
        Starting point.
    lower, upper : ndarray of shape (n_parameters,)
        Bounds.
    metric : callable, default=None
        x -> a first guess of the Hessian at x, positive definite and of shape
        (n_parameters, n_parameters). None is a multiple of I. Limited memory does not
        ask for it.
    max_iter : int
        Most iterations.
    tol : float
        Stop when, for several iterations, neither the model expects a step to gain
        more than this nor the steps did.
    patience : int, default=20
        For how many iterations, unless the model is certain.
    rounding : float, default=0.0
        Error of the values, much less than `tol`: a step may lose as much.
    report : callable, default=None
        Called after each iteration with its number, the point and the value. It ends
        if that returns True.

    Returns
    -------
    optimum : Optimum
        The best point found.
    """
    hessian = DenseHessian(metric) if len(x) <= MOST_DENSE else LimitedMemory()
    bfgs = _BFGS(fun, x, lower, upper, hessian, rounding)
    return bfgs.run(max_iter, tol, patience, report)


class DenseHessian:
    """The model of the Hessian: a full matrix with BFGS updates.

    Parameters
    ----------
    metric : callable or None
        See :func:`minimize`.
    """

    def __init__(self, metric=None):
        self.metric = metric

    def restart(self, x, g):
        """Forget all steps."""
        self.fresh = True
        guess = np.eye(len(x)) * max(np.linalg.norm(g), 1e-300)
        self.B = guess if self.metric is None else self.metric(x)

    def newton_step(self, g, free):
        """- H^{-1} g of the free parameters, the others being held."""
        B = self.B if len(free) == len(g) else self.B[np.ix_(free, free)]
        return -_solve(B, g[free])

    def update(self, s, y):
        """Learn from a step s that changed the gradient by y; s @ y is positive."""
        curvature = s @ y
        if self.fresh and self.metric is None:
            self.B = np.eye(len(s)) * (y @ y) / curvature
        self.fresh = False
        Bs = self.B @ s
        if curvature >= 1e-8 * (s @ Bs):
            self.B = self.B + np.outer(y, y) / curvature - np.outer(Bs, Bs) / (s @ Bs)


class LimitedMemory:
    """The model of the Hessian: the last few steps (L-BFGS)."""

    def restart(self, x, g):
        """Forget all steps."""
        self.fresh, self.steps = True, deque(maxlen=MEMORY)
        self.scale = max(np.linalg.norm(g), 1e-300)

    def newton_step(self, g, free):
        """- H^{-1} g of the free parameters, by Nocedal's two loops."""
        if len(free) == len(g):
            free = slice(None)  # no copies of the steps
        q = g[free].copy()
        pairs = [(s[free], y[free]) for s, y in self.steps]
        pairs = [(s, y, s @ y) for s, y in pairs if s @ y > 1e-12 * (y @ y)]
        weights = []
        for s, y, curvature in reversed(pairs):
            weights.append((s @ q) / curvature)
            q -= weights[-1] * y
        q /= self.scale
        for (s, y, curvature), weight in zip(pairs, reversed(weights), strict=True):
            q += (weight - (y @ q) / curvature) * s
        return -q

    def update(self, s, y):
        """Learn from a step s that changed the gradient by y; s @ y is positive."""
        self.fresh = False
        self.steps.append((s, y))
        self.scale = (y @ y) / (s @ y)


class _BFGS:
    def __init__(self, fun, x, lower, upper, hessian, rounding):
        self.fun, self.lower, self.upper, self.hessian = fun, lower, upper, hessian
        self.rounding = rounding
        self.n_evaluations, self.step = 0, 1.0
        self.x = np.clip(x, lower, upper)
        self.f, self.g = self._evaluate(self.x)

    def run(self, max_iter, tol, patience, report):
        n_iter, still, stuck, nothing = 0, 0, False, max(NOTHING * tol, self.rounding)
        running = bool(len(self.x) and np.isfinite(self.f))
        expected_gain = np.inf if running else 0.0
        if running and max_iter:
            self._restart()
        while running and n_iter < max_iter and still < patience:
            direction, expected_gain = self._direction()
            if still >= CERTAIN and expected_gain < nothing:
                break
            step = self._line_search(direction)
            if step is not None and self._is_futile(step):
                step = None
            stuck = step is None and self.hessian.fresh
            if stuck:
                break
            if step is None:  # the model of the Hessian is lost
                self._restart()
                continue
            n_iter += 1
            gain = self.f - step[1]
            self._update(*step)
            still = still + 1 if max(gain, expected_gain) < tol else 0
            if report is not None and report(n_iter, self.x, self.f):
                break
        converged = bool(np.isfinite(self.f)) and (still > 0 or expected_gain < tol)
        stalled = not converged and (stuck or not np.isfinite(self.f))
        return Optimum(self.x, self.f, n_iter, self.n_evaluations, converged, stalled)

    def _evaluate(self, x):
        self.n_evaluations += 1
        f, g = self.fun(x)
        return (f, g) if np.isfinite(f) and np.isfinite(g).all() else (np.inf, g)

    def _restart(self):
        self.hessian.restart(self.x, self.g)
        self.step = 1.0

    def _direction(self):
        """Quasi-Newton step of the parameters not held at a bound; its gain."""
        held = self._outward(-self.g)
        direction = self._newton_step(held)
        while (leaving := self._outward(direction)).any():  # led there by the others
            held |= leaving
            direction = self._newton_step(held)
        expected_gain = -0.5 * (self.g @ direction)
        longest = np.abs(direction).max()
        return direction * min(1.0, LONGEST_STEP / max(longest, 1e-300)), expected_gain

    def _outward(self, step):
        """Whether a step takes a parameter that is at a bound beyond it."""
        below, above = self.x <= self.lower, self.x >= self.upper
        return (below & (step < 0.0)) | (above & (step > 0.0))

    def _newton_step(self, held):
        free = np.flatnonzero(~held)
        step = np.zeros_like(self.x)
        if free.size:
            with limit_threads(free.size):
                step[free] = self.hessian.newton_step(self.g, free)
        return step

    def _line_search(self, direction):
        """A point of sufficient decrease (Armijo) and, if it can be, curvature.

        The first trial is a little longer than the last accepted step: along a valley
        that narrows as the noise falls, the model of the Hessian lags behind, and unit
        steps would be too long again and again.
        """
        slope = self.g @ direction
        if slope >= 0.0:
            return None
        start = self.f + self.rounding
        low, high, f_low, slope_low, best = 0.0, np.inf, start, slope, None
        step = min(1.0, GROWTH * self.step)
        for _ in range(MAX_LINE_SEARCH):
            x = np.clip(self.x + step * direction, self.lower, self.upper)
            f, g = self._evaluate(x)
            # clipping can turn a descent direction into one of ascent
            enough = start + ARMIJO * min(self.g @ (x - self.x), 0.0)
            if not f < min(enough, f_low):
                high = step
                step = low + _shrink(step - low, f_low, slope_low, f)
                continue
            best, self.step = (x, f, g), step
            if g @ direction >= CURVATURE * slope or self._clipped(step, direction):
                break
            low, f_low, slope_low = step, f, g @ direction
            step = 2.5 * step if np.isinf(high) else 0.5 * (low + high)
        return best

    def _is_futile(self, step):
        """Whether a step was far shorter than asked, and its gain is rounding alone.

        With rounding any tiny step seems good enough, so that it would go on for ever.
        """
        return self.step < SHORT and abs(self.f - step[1]) < self.rounding

    def _clipped(self, step, direction):
        target = self.x + step * direction
        return bool(((target < self.lower) | (target > self.upper)).any())

    def _update(self, x, f, g):
        """Go there; the model learns from it where the curvature was positive."""
        s, y = x - self.x, g - self.g
        self.x, self.f, self.g = x, f, g
        if s @ y > 1e-300:  # a smaller one loses its digits to underflow
            with limit_threads(len(x)):
                self.hessian.update(s, y)


def _solve(B, g):
    """B^{-1} g, with B made positive definite where rounding has cost it that."""
    diagonal = np.diagonal(B)
    scale = np.sqrt(np.maximum(diagonal, max(1e-20 * diagonal.max(), 1e-200)))
    B = B / scale
    B /= scale[:, None]
    for shift in (0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6):
        # symmetric: columns may be rows
        shifted = B.T + shift * np.eye(len(B)) if shift else B.T.copy(order="F")
        factor, info = lapack.dpotrf(shifted, clean=0, overwrite_a=1)
        if info == 0:
            return lapack.dpotrs(factor, g / scale)[0] / scale
    return g / scale**2


def _shrink(width, f, slope, f_end):
    """A shorter step, from the parabola through the interval's data."""
    if not np.isfinite(f_end):
        return 0.1 * width
    curvature = 2.0 * (f_end - f - width * slope)
    step = -slope * width**2 / curvature if curvature > 0.0 else 0.5 * width
    return float(np.clip(step, 0.1 * width, 0.5 * width))
