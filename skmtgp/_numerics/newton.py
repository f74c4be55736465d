"""Minimisation within bounds by Newton's method, from several points at once.

It is for functions of a few parameters whose values cost less than the call of a
function in Python: all points are evaluated together, and each has its own step. What
is negative of a Hessian's eigenvalues is taken by its size, so that saddles repel.
"""

import numpy as np

from skmtgp._numerics.bfgs import ARMIJO, LONGEST_STEP, Optimum

POOR, GOOD = 0.25, 0.75  # parts of the expected gain: steps then get shorter, or longer
SHORTEST = 1e-12  # of steps, below which nothing is gained any more
NOTHING = 1e-4  # of the tolerance, below which no gain is expected
NEAR, CLOSE = 1.0, 0.1  # nats to where another is, and how near that is told and there
FLATTEST = 1e-14  # eigenvalues, relative to the largest
TINY = np.finfo(float).tiny  # or absolutely


def minimize_all(fun, X, lower, upper, *, max_iter, tol, followed=None):
    """Minimise a function from several starting points.

    Parameters
    ----------
    fun : callable
        ``fun(X)``, of points of shape (n_points, n_parameters), returns values of shape
        (n_points,), gradients (n_points, n_parameters) and Hessians (n_points,
        n_parameters, n_parameters). A value that is not finite is a rejected step.
    X : ndarray of shape (n_starts, n_parameters)
        Starting points.
    lower, upper : ndarray of shape (n_parameters,)
        Bounds.
    max_iter : int
        Most steps of each, rejected ones counted.
    tol : float
        See :func:`skmtgp._numerics.bfgs.minimize`; one ends where a step is expected to
        gain next to nothing of it.
    followed : int, default=None
        Of how many starts the search goes on: those with the lowest values, which come
        first. None is all of them, in their order.

    Returns
    -------
    optima : list of n_followed Optimum
        Where each ended. Starts that lead to where the best one is end on the way, and
        need not have converged.
    """
    search = _Newton(fun, np.clip(X, lower, upper), lower, upper, followed)
    search.run(max_iter, tol)
    return search.optima(tol)


class _Newton:
    def __init__(self, fun, X, lower, upper, followed=None):
        self.fun, self.lower, self.upper = fun, lower, upper
        self.X, (self.f, self.g, self.H) = X, fun(X)
        if followed is not None:
            best = np.argsort(self.f, kind="stable")[:followed]
            of_best = (of[best] for of in (X, self.f, self.g, self.H))
            self.X, self.f, self.g, self.H = of_best
        self.longest = np.full(len(self.X), LONGEST_STEP)
        self.n_iter, self.n_evaluations = np.zeros((2, len(self.X)), dtype=int)
        self.n_evaluations += 1
        self.gain = np.where(np.isfinite(self.f), np.inf, 0.0)  # that is expected

    def run(self, max_iter, tol):
        active = np.flatnonzero(np.isfinite(self.f)) if self.X.shape[1] else []
        for _ in range(max_iter):
            if not len(active):
                return
            steps = self._steps(active)
            going = self.gain[active] >= NOTHING * tol
            going &= ~self._follow_another(active)
            going &= self.longest[active] > SHORTEST
            active, steps = active[going], steps[going]
            if len(active):
                self._try(active, steps)

    def _steps(self, active):
        """Newton's, no longer along any eigenvector than the last ones have told."""
        X, g, H = self.X[active], self.g[active], self.H[active]  # copies
        low, high = self.lower >= X, self.upper <= X
        held = low & (g > 0.0) | high & (g < 0.0)
        if held.any():
            H[held[:, None] | held[..., None]] = 0.0
            g = np.where(held, 0.0, g)
        values, V = np.linalg.eigh(H)
        values = np.abs(values)
        flattest = FLATTEST * values.max(axis=1, keepdims=True)
        along = np.einsum("kp,kpq->kq", g, V)
        steps = -along / np.maximum(values, np.maximum(flattest, TINY))
        self.gain[active] = -0.5 * np.einsum("kq,kq->k", along, steps)
        longest = self.longest[active, None]
        steps = np.maximum(np.minimum(steps, longest), -longest)
        return np.einsum("kpq,kq->kp", V, steps)

    def _follow_another(self, active):
        """Which are on the way to where the best one is: they end where they are."""
        best = np.argmin(np.where(np.isfinite(self.f), self.f, np.inf))
        # what has little to gain may lie on a saddle, too
        if self.gain[best] > CLOSE or np.linalg.eigvalsh(self.H[best])[0] <= 0.0:
            return np.zeros(len(active), dtype=bool)
        away = self.X[active] - self.X[best]
        expected = 0.5 * np.einsum("kp,pq,kq->k", away, self.H[best], away)
        off = np.abs(self.f[active] - self.f[best] - expected)
        alike = (expected < NEAR) & (off <= CLOSE * expected)
        return alike & (active != best)

    def _try(self, active, steps):
        """Go where the function is lower; where it is not, shorten the next step."""
        X, g, H, f = (of[active] for of in (self.X, self.g, self.H, self.f))
        trial = np.maximum(np.minimum(X + steps, self.upper), self.lower)
        steps = trial - X
        slope = np.einsum("kp,kp->k", g, steps)
        expected = -slope - 0.5 * np.einsum("kp,kpq,kq->k", steps, H, steps)
        f_trial, g_trial, H_trial = self.fun(trial)
        self.n_evaluations[active] += 1
        finite = np.isfinite(H_trial).all(axis=(1, 2))
        taken = finite & (f_trial < f + ARMIJO * np.minimum(slope, 0.0))
        gained = np.where(taken, f - f_trial, -np.inf)
        length = np.abs(steps).max(axis=1)
        self._adapt(active, length, gained, expected)
        to = active[taken]
        self.X[to], self.f[to] = trial[taken], f_trial[taken]
        self.g[to], self.H[to] = g_trial[taken], H_trial[taken]
        self.n_iter[to] += 1

    def _adapt(self, active, length, gained, expected):
        """How long the next steps may be."""
        longest = self.longest[active]
        well = gained > GOOD * np.abs(expected)
        longest = np.where(well, np.maximum(longest, 2.0 * length), longest)
        poorly = gained < POOR * expected
        longest = np.where(poorly, POOR * length, longest)
        self.longest[active] = longest

    def optima(self, tol):
        """Where they are, and whether they converged."""
        finite = np.isfinite(self.f)
        converged = finite & (self.gain < tol)
        stalled = ~finite | (self.longest <= SHORTEST)
        columns = self.X, self.f.tolist(), self.n_iter.tolist()
        columns = *columns, self.n_evaluations.tolist(), converged.tolist()
        columns = *columns, (stalled & ~converged).tolist()
        return [Optimum(*of) for of in zip(*columns, strict=True)]
