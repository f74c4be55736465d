"""What is learned: the observations of an output, the settings, the modes found."""

from dataclasses import dataclass, replace
from math import ceil, log
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._data.complete import complete_design
from skmtgp._data.drawing import draw_rows
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import SparseBound

EXACT = {
    "dense": DenseLikelihood,
    "kronecker": KroneckerLikelihood,
    "sparse": DenseLikelihood,
}
HELD = 1e-5  # noise variance while it is held up, in variances of the target
COARSE = 300  # rows, of complete data inputs, or
COARSE_PER_TASK = 20  # if that is more
REFINEMENT = 4.0  # most of them in a level for each of the coarser one


@dataclass(frozen=True)
class Data:
    """The observations of one output.

    Attributes
    ----------
    X : ndarray of shape (n_samples, n_features)
        Inputs, sorted by task. For sparse inference they may be in any order, on disk
        or, as `tasks` and `y`, in a Dask array.
    tasks : ndarray of shape (n_samples,)
        Tasks, 0 to n_tasks - 1.
    y : ndarray of shape (n_samples,)
        Targets.
    n_tasks : int
        Number of tasks M.
    complete : bool, default=False
        Whether parts of them are to be complete as they are: all tasks at the same
        inputs, once each.
    Z : ndarray of shape (n_inducing, n_features), default=None
        Inducing inputs, for a bound on the likelihood.
    """

    X: np.ndarray
    tasks: np.ndarray
    y: np.ndarray
    n_tasks: int
    complete: bool = False
    Z: np.ndarray | None = None

    def levels(self):
        """The data from coarse to fine: a few hundred of the rows, more, all.

        Of complete data it is a few hundred of the inputs.

        Returns
        -------
        levels : list of Data
            Each is part of the next; the last is `self`.
        """
        n, coarsest = len(self.y), max(COARSE, COARSE_PER_TASK * self.n_tasks)
        if self.complete:
            n, coarsest = n // self.n_tasks, COARSE
        if n < 2 * coarsest:
            return [self]
        steps = ceil(log(n / coarsest) / log(REFINEMENT))
        sizes = np.geomspace(coarsest, n, steps + 1)[:-1]
        return [*(self.thinned(int(size)) for size in sizes), self]

    def thinned(self, size):
        """About `size` of the rows, of each task its share and at least one.

        Of complete data it is as many inputs. What is left is drawn at random, but less
        is always part of more.
        """
        return self._part(self._inputs(size) if self.complete else self._rows(size))

    def drawn(self, size):
        """The same number of rows, whatever their order, and wherever they lie.

        They come into memory. Less is not part of more.
        """
        return self._part(draw_rows(self.tasks, self.n_tasks, size))

    def _part(self, rows):
        rows = np.sort(rows)
        tasks = np.asarray(self.tasks[rows])
        order = np.argsort(tasks, kind="stable")
        X, y = (np.asarray(of[rows], dtype=np.float64) for of in (self.X, self.y))
        return replace(self, X=X[order], tasks=tasks[order], y=y[order])

    def _rows(self, n_samples):
        n = len(self.tasks)
        order = np.random.default_rng(0).permutation(n)
        order = order[np.argsort(self.tasks[order], kind="stable")]
        of_task = np.unique(self.tasks, return_counts=True)[1]
        place = np.arange(n) - np.repeat(np.cumsum(of_task) - of_task, of_task)
        share = -(-of_task * n_samples // n)
        return order[place < np.repeat(share, of_task)]

    def _inputs(self, n_inputs):
        """The rows of some of the inputs."""
        rows = complete_design(self.X, self.tasks)
        order = np.random.default_rng(0).permutation(len(rows))
        return rows[order[:n_inputs]].ravel()


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
        Most iterations of each climb.
    tol : float
        Gain in nats under which a climb ends.
    truncation : {"eigen", "cholesky"}, default="eigen"
        How K_aug^rho gets the rank of the model, section 3.2.
    name : str, default="output"
        What is learned, for the lines that are printed.
    verbose : int, default=0
        2 or more prints lines during each climb.
    inference : {"dense", "kronecker", "sparse"}, default="dense"
        How the likelihood is computed. With "sparse" it is exact for data without
        inducing inputs.
    n_inducing : int, default=0
        Inducing inputs of sparse inference.
    inducing_inputs : {"greedy", "k-means", "optimised"}, default="greedy"
        Which they are.
    n_exact : int, default=0
        Rows that are learned from exactly before.
    """

    kernel: Kernel
    scale: float
    log_noise: np.ndarray
    log_noise_bounds: tuple
    max_iter: int
    tol: float
    truncation: str = "eigen"
    name: str = "output"
    verbose: int = 0
    inference: str = "dense"
    n_inducing: int = 0
    inducing_inputs: str = "greedy"
    n_exact: int = 0

    @property
    def log_held(self):
        """Logarithm of the noise variance under which it does not fall while held.

        Never above sigma_0^2, which holding thus leaves as it is.
        """
        held = min(np.log(HELD * self.scale**2), self.log_noise.min())
        return float(np.clip(held, *self.log_noise_bounds))

    def is_noisy(self, mode):
        """Whether the noise variances of a mode are above where they are held."""
        log_noise = mode.theta[-len(self.log_noise) :]
        return bool((log_noise >= self.log_held).all())

    def tail(self, form):
        """Where theta has variances of what is unexplained: kappa and the noise."""
        return slice(-len(self.log_noise) - form.n_kappa, None)

    def with_noise(self, theta, form):
        """Theta with kappa and the noise variance raised to where they are held."""
        theta, tail = theta.copy(), self.tail(form)
        theta[tail] = np.maximum(theta[tail], self.log_held)
        return theta

    def split(self, theta):
        """Theta's three parts: kernel, K^rho, log noise variances."""
        return np.split(theta, [self.kernel.n_dims, len(theta) - len(self.log_noise)])

    def likelihood(self, data, form):
        """The objective for a form of K^rho."""
        arguments = self.kernel, form, data.X, data.tasks, data.y
        n_noise = len(self.log_noise)
        if data.Z is not None:
            return SparseBound(*arguments, data.Z, n_noise)
        return EXACT[self.inference](*arguments, n_noise)

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
        Iterations on the way to it.
    n_evaluations : int
        Likelihoods with their gradients that were spent on it and on the modes that it
        was preferred to.
    converged : bool
        Whether the last climb ended by its tolerance.
    stalled : bool
        Whether it ended for lack of digits: more gain was expected, no step gained.
    seconds : float
        Time that was spent on the same.
    n_samples : int
        Rows that it was learned from.
    Z : ndarray of shape (n_inducing, n_features), default=None
        Inducing inputs, if its value is a bound.
    """

    theta: np.ndarray
    value: float
    n_iter: int
    n_evaluations: int
    converged: bool
    stalled: bool
    seconds: float
    n_samples: int
    Z: np.ndarray | None = None

    def led_to(self, later):
        """A later mode whose climb began at this one; what each took counts apart."""
        return later._replace(n_iter=self.n_iter + later.n_iter)

    def then(self, later):
        """A later mode that was reached by way of this one."""
        return later._replace(
            n_iter=self.n_iter + later.n_iter,
            n_evaluations=self.n_evaluations + later.n_evaluations,
            seconds=self.seconds + later.seconds,
        )


def best_of(modes, *, doubt=0.0):
    """The best mode, with what was spent on all.

    Parameters
    ----------
    modes : sequence of Mode
        Of the same model.
    doubt : float, default=0.0
        Nats by which a mode that stalled must be better than one that did not: its
        value lacks digits.
    """
    best = max(modes, key=lambda mode: mode.value - doubt * mode.stalled)
    return spent_on(best, modes)


def spent_on(mode, modes):
    """The mode, with what was spent on all of some modes."""
    return mode._replace(
        n_evaluations=sum(mode.n_evaluations for mode in modes),
        seconds=sum(mode.seconds for mode in modes),
    )
