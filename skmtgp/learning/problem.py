"""What is learned: the prior and the data of an output, how, and the modes found."""

from dataclasses import dataclass, field, replace
from math import ceil, log
from typing import NamedTuple

import numpy as np

from skmtgp._data.data import Data
from skmtgp._data.known import noise_of
from skmtgp._numerics.bfgs import PATIENCE
from skmtgp.inference.engine import Engine, check_kept
from skmtgp.learning.ambiguity import rivals_of
from skmtgp.learning.penalised import (
    AlikeNoise,
    Penalised,
    SomeNoise,
    of_equal_targets,
    told,
)
from skmtgp.learning.tuning import TUNING, Tuning
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.prior import Prior

# Rows for a hyperparameter to tell that there is no noise, and to tell it if step 1 of
# learning, which has few hyperparameters, finds none.
ROWS_EACH, NEARLY_EACH = 3, 2.5
THE_OUTPUT = "the output"  # the name where there is one


@dataclass(frozen=True)
class Budget:
    """For how long to learn, and what to say meanwhile.

    Attributes
    ----------
    max_iter : int
        Most iterations of each climb.
    tol : float
        Gain in nats under which a climb ends.
    patience : int, default=20
        Iterations that gain less before it does.
    truncation : {"eigen", "cholesky"}, default="eigen"
        How K_aug^rho gets the rank of the model, section 3.2.
    verbose : int, default=0
        Whether to print how far a climb is, after some seconds; 2 or more prints lines
        during each.
    begun : float, default=0.0
        When the fit began, in seconds as of `time.time`.
    pace : float, default=0.0
        Seconds that one likelihood takes, over the cube of its rows. 0 is unknown.
    only_begins : bool, default=False
        Whether all rows are learned from afterwards, beginning at what is learned now.
    """

    max_iter: int
    tol: float
    patience: int = PATIENCE
    truncation: str = "eigen"
    verbose: int = 0
    begun: float = 0.0
    pace: float = 0.0
    only_begins: bool = False


@dataclass(frozen=True)
class Problem:
    """One output, to be learned.

    Attributes
    ----------
    prior : Prior
        The model.
    data : Data
        Observations.
    engine : Engine
        How the likelihood is computed.
    budget : Budget
        For how long.
    name : str, default="the output"
        What is learned, for the lines that are printed.
    tuning : Tuning
        Constants.
    weak_priors : bool, default=False
        Whether theta has the priors of `Hyperprior`.
    log_little : float, default=-inf
        Logarithm of the noise variance below which less is unlikely, see `SomeNoise`.
    noise_rate : float, default=0.0
        How fast, see `wary`.
    spent : tuple of Mode, default=()
        What was learned to tell that, which counts.
    unbounded : bool, default=False
        Whether equal targets of a task are `told` that they say nothing of the noise.
    noise_deviation : float, default=inf
        How far apart the logarithms of tasks' noise variances are, see `AlikeNoise`.
    log_scales : ndarray of shape (1,) or (n_tasks,)
        Logarithms of what the targets were divided by, for the lines.
    noisy : bool, default=False
        Whether the targets are known to have noise, so that fewer rows tell the modes
        apart.
    """

    prior: Prior
    data: Data
    engine: Engine
    budget: Budget
    name: str = THE_OUTPUT
    tuning: Tuning = TUNING
    weak_priors: bool = False
    log_little: float = -np.inf
    noise_rate: float = 0.0
    spent: tuple = ()
    unbounded: bool = False
    noise_deviation: float = np.inf
    log_scales: np.ndarray = field(default_factory=lambda: np.zeros(1))
    noisy: bool = False

    def with_form(self, form):
        """The same with another form of K^rho."""
        return replace(self, prior=self.prior.with_form(form))

    def with_data(self, data):
        """The same of other data."""
        return replace(self, data=data)

    def wary(self, form):
        """The same; it expects noise if a form has few rows for a hyperparameter.

        Fewer than two can be explained without noise, also if there is some. In the
        evidence each hyperparameter costs half a nat for each factor of e that the
        noise variance is less, for the rows tell it to so many more digits.
        """
        size = self.prior.with_form(form).n_hyperparameters
        lacking = ROWS_EACH * size - self.data.n_measured
        return replace(self, noise_rate=0.5 * float(np.clip(lacking, 0.0, size)))

    def quickly(self):
        """The same, learned less exactly: to tell modes apart, not to keep them."""
        tuning = self.tuning
        tol = max(self.budget.tol, tuning.relaxed_tol)
        budget = replace(self.budget, tol=tol, patience=tuning.relaxed_patience)
        return replace(self, budget=budget)

    def likelihood(self):
        """What is maximised."""
        likelihood = self.engine.likelihood(self.prior, self.data)
        check_kept(self.engine, likelihood, self.data)
        likelihood = told(likelihood) if self.unbounded else likelihood
        for of_theta in self.densities():
            likelihood = Penalised(likelihood, of_theta)
        return likelihood

    def densities(self):
        """The densities of theta that count beside the likelihood."""
        found = [Hyperprior(self.prior)] if self.weak_priors else []
        if (of_little := self._of_little_noise()) is not None:
            found.append(of_little)
        if self.prior.n_noise > 1 and np.isfinite(self.noise_deviation):
            found.append(AlikeNoise(self.prior, self.noise_deviation))
        return found

    def is_nearly_sure(self, form):
        """Whether rows are nearly enough to tell a form that there is no noise."""
        size = self.prior.with_form(form).n_hyperparameters
        wary = self.noise_rate > 0.0 and self._of_little_noise() is not None
        return wary and self.data.n_measured >= NEARLY_EACH * size

    def _of_little_noise(self):
        """Its density; None where the noise has another prior, or is not learned."""
        other = self.weak_priors and not self.noise_rate
        fixed = other or self.prior.noise_is_fixed
        if fixed or not np.isfinite(self.log_little):
            return None
        known = 0.0 if self.data.known is None else self.data.known.variance.mean()
        return SomeNoise(self.prior, self.log_little, float(known), self.noise_rate)

    def of_little_noise(self, theta):
        """Log density of little noise, and its slopes by the log noise variances."""
        return self._of_noise(self._of_little_noise(), theta)

    def of_equal_targets(self, theta):
        """The same of `EqualTargets`."""
        density = of_equal_targets(self.prior, self.data) if self.unbounded else None
        return self._of_noise(density, theta)

    def pull_of_noise(self, theta):
        """Slopes of both by the logarithms of the noise variances."""
        return self.of_little_noise(theta)[1] + self.of_equal_targets(theta)[1]

    def _of_noise(self, density, theta):
        if density is None:
            return 0.0, np.zeros(self.prior.n_noise)
        value, gradient = density.log_density(theta)
        return value, gradient[self.prior.of_noise]

    def log_density(self, theta):
        """Sum of these densities."""
        return float(sum(of.log_density(theta)[0] for of in self.densities()))

    def log_likelihood(self, mode):
        """That of a mode, without the densities of theta that count in its value."""
        of_theta = self.log_density(mode.theta)
        if np.isfinite(of_theta):
            return mode.value - of_theta
        likelihood = self.likelihood_at(mode)  # not learned: F is zero
        return (told(likelihood) if self.unbounded else likelihood).value(mode.theta)

    def likelihood_at(self, mode):
        """The likelihood by the inducing inputs of a mode, if it has any."""
        return self.engine.likelihood(self.prior, replace(self.data, Z=mode.Z))

    def theta(self, **given):
        """Starting values of the prior's parameters, but for what is given."""
        return self.prior.theta(**given, truncation=self.budget.truncation)

    @property
    def log_held(self):
        """Logarithm of the noise variance under which it does not fall while held.

        Never above sigma_0^2, which holding thus leaves as it is.
        """
        scale = min(self.prior.scale, self.prior.within)  # of large levels the latter
        held = np.log(self.tuning.held * scale**2)
        held = min(held, self.prior.log_noise)
        return float(np.clip(held, *self.prior.log_noise_bounds))

    def some(self, mode, rows):
        """X, tasks, y, noise variances of some rows at a mode, and covariance of y."""
        X, tasks, y, known = self.data.some(rows)
        X = X.astype(float)
        noise = self.prior.values(mode.theta).noise
        noise = noise_of(known, np.broadcast_to(noise, self.data.n_tasks)[tasks])
        K = self.prior.covariance(mode.theta, X, tasks) + np.diag(noise)
        return X, tasks, y, noise, K

    def is_noisy(self, mode, *, beyond=0.0):
        """Whether the noise variances of a mode are above where they are held."""
        least = self.log_held + beyond
        return bool((self.prior.log_noise_at(mode.theta) >= least).all())

    def with_noise(self, theta):
        """Theta with kappa and the noise variance raised to where they are held."""
        raised = np.maximum(theta, self.log_held)
        return np.where(self.prior.unexplained, raised, theta)

    def coarse_to_fine(self):
        """The problem with a few hundred of the rows, with more, with all.

        Of complete data it is a few hundred of the inputs.

        Returns
        -------
        problems : list of Problem
            The data of each are part of the next's; the last is `self`.
        """
        data, n, coarsest = self.data, self.data.n_inputs, self._coarsest()
        if n < 2 * coarsest:
            return [self]
        steps = ceil(log(n / coarsest) / log(self.tuning.refinement))
        sizes = np.geomspace(coarsest, n, steps + 1)[:-1]
        return [*(self.with_data(data.thinned(int(size))) for size in sizes), self]

    def _coarsest(self):
        """Rows, of complete data inputs, of the coarsest level."""
        tuning, data = self.tuning, self.data
        coarsest = tuning.coarse
        if data.design is None:
            share = tuning.coarse_share * len(data) if self.noisy else coarsest
            told = tuning.coarse_per_dim * self.prior.node.n_dims
            coarsest = min(coarsest, max(share, told, tuning.least_coarse))
            coarsest = max(coarsest, tuning.coarse_per_task * data.n_tasks)
        return coarsest + 2 * self.prior.n_coefficients  # which explain as many rows


class Mode(NamedTuple):
    """A local maximum of the log marginal likelihood.

    Attributes
    ----------
    theta : ndarray of shape (n_theta,)
        Parameters.
    value : float
        Log marginal likelihood, with the densities of theta.
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
    rivals : tuple of Rival, default=()
        Nearly as good modes of the same model that it was preferred to.
    leeway : tuple of OfTheta or OfRow, default=()
        What is open of theta and of rows of F, see :mod:`skmtgp.inference.leeway` and
        :mod:`skmtgp.inference.open_rows`.
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
    rivals: tuple = ()
    leeway: tuple = ()

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

    def spending(self, later):
        """The same, with what was spent on a later mode that began at it in vain."""
        spent = {"n_evaluations": later.n_evaluations, "seconds": later.seconds}
        return self._replace(**spent)

    def counting(self, others):
        """The same, with what others took counted, too."""
        return self._replace(
            n_evaluations=self.n_evaluations + sum(of.n_evaluations for of in others),
            seconds=self.seconds + sum(of.seconds for of in others),
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
    """The mode, with what was spent on all of some modes, and its rivals among them."""
    return mode._replace(
        rivals=rivals_of(mode, modes),
        n_evaluations=sum(mode.n_evaluations for mode in modes),
        seconds=sum(mode.seconds for mode in modes),
    )
