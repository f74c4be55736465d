"""Models whose hyperparameters are drawn: predictions average over the draws."""

from __future__ import annotations

from functools import partial
from numbers import Real

import numpy as np
import pandas as pd
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.dask import is_dask
from skmtgp._estimators.doubts import warn_of_duration
from skmtgp._estimators.estimator import steady
from skmtgp._estimators.forms import lower_rank
from skmtgp._estimators.predicting import JOINTLY, check_joint
from skmtgp._estimators.units import deviation_within
from skmtgp._numerics.linalg import correlation, draw_normal
from skmtgp._numerics.mixtures import weights_left_out
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.progress import say
from skmtgp._support.warnings import warn
from skmtgp.exceptions import FixedCorrelationWarning, SamplingWarning
from skmtgp.inference.mixture import Mixture
from skmtgp.learning.sampling import N_CHAINS, THINNED, sample_hyperparameters

# To be warned of: effective draws of all chains, R-hat, and the share of trajectories
# that diverged. 25 draws tell a deviation to a seventh. Some trajectories diverge where
# a correlation between tasks is all but 1.
FEWEST, LARGEST, MOST_DIVERGENT = 25, 1.2, 0.05
# By "auto" they are drawn where rows are few for each hyperparameter, which is where
# intervals of the mode are too narrow (benchmarks/results/intervals_mode.txt), of as
# many rows in all as take seconds.
FEW_ROWS_EACH, MOST_ROWS = 16, 500
FIXED = 1e-9  # how near to 0, 1 or -1 a correlation is that cannot be another
CHAINS = "effective_sample_size_", "r_hat_", "n_divergences_"


def n_posteriors(estimator, n):
    """How many posteriors there are of n rows, at most: of the mode, and of others.

    The others are those of draws, or one at a time around the mode, of which only what
    means need is kept.
    """
    asked = estimator.hyperparameters
    if asked == "sampled" or (asked == "auto" and n <= MOST_ROWS):
        return 1 + estimator.n_draws
    return 2 if asked in ("laplace", "auto") else 1


def _n_told(problem, mode):
    """How many rows tell something: all, but for the share of their variance in noise.

    Rows that are nine tenths noise tell functions as little as a tenth of them would.
    """
    data, noise = problem.data, problem.prior.values(mode.theta).noise
    noise = np.broadcast_to(noise, data.n_tasks)[data.tasks].mean()
    whole = deviation_within(data.y, data.tasks, data.n_tasks) ** 2
    share = noise / whole if whole else 0.0  # there are not two rows a task
    return len(data) * max(0.0, 1.0 - share)


class SampledMixin:
    """Fitted model with draws of its hyperparameters, if they were asked for."""

    @steady
    def task_correlation_interval(
        self, level: float = 0.95
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return intervals of the tasks' correlations.

        If an interval does not contain zero, the two tasks are related, given the form
        of the task covariance, see Notes.

        Parameters
        ----------
        level : float, default=0.95
            Posterior probability of each interval, with equal probabilities below and
            above it.

        Returns
        -------
        lower, upper : DataFrame of n_tasks rows and columns
            Ends of the intervals, labelled as `task_correlation_`.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        ValueError
            If the model has no draws of its hyperparameters, or if `level` is not
            between 0 and 1.

        Warns
        -----
        FixedCorrelationWarning
            If the form of the task covariance fixes the correlations of all tasks.

        Notes
        -----
        The intervals are conditional on the form of the task covariance. Three forms
        fix all correlations: independent tasks have 0, rank 1 has -1 or 1, and one
        function of all tasks has 1. A `MultiTaskGPRegressor` with ``rank=2`` or more,
        or with ``diagonal=True``, learns them.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import MultiTaskGPRegressor
        >>> rng = np.random.default_rng(3)
        >>> x, task = rng.uniform(0, 6, 45), np.repeat([0, 1, 2], 15)
        >>> y = np.array([1, -2, 0.5])[task] * np.sin(x + 1.5 * (task == 2))
        >>> y += 0.1 * rng.standard_normal(45)
        >>> options = {"hyperparameters": "sampled", "n_draws": 60, "random_state": 3}
        >>> model = MultiTaskGPRegressor(rank=2, **options)
        >>> model = model.fit(np.column_stack([x, task]), y)
        >>> lower, upper = model.task_correlation_interval(0.9)
        >>> bool(upper.loc[0, 1] < 0), bool(lower.loc[0, 2] > 0)
        (True, False)
        """
        check_is_fitted(self)
        if not isinstance(level, Real) or not 0.0 < level < 1.0:
            raise ValueError(
                f"level={level!r} must be one number between 0 and 1, such as 0.95."
            )
        if not self._is_sampled():
            raise ValueError(self._without_draws())
        tails = 0.5 * (1.0 - level), 0.5 * (1.0 + level)
        outputs = zip(self._likelihoods, self._draws_of_outputs(), strict=True)
        drawn = [_correlations(likelihood.prior, of) for likelihood, of in outputs]
        _warn_of_fixed(drawn)
        found = [np.quantile(of, tails, axis=0) for of in drawn]
        lower, upper = (
            self._by_output([self._frame(R, self._tasks()) for R in of])
            for of in zip(*found, strict=True)
        )
        return lower, upper

    def _without_draws(self):
        """What to do where there are no draws."""
        needs = "task_correlation_interval needs draws of the hyperparameters, which "
        if any(of.prior.n_terms > 1 for of in self._likelihoods):
            needs += "models of several kernels do not have. Fit one kernel with "
            return f"{needs}hyperparameters='sampled'."
        model = f"this {type(self).__name__}"
        pairs = zip(self._likelihoods, self._thetas(), strict=True)
        modes = [_correlations(of.prior, theta[None]) for of, theta in pairs]
        if all(map(_are_fixed, modes)):
            model = "a MultiTaskGPRegressor with rank=2 or more, or diagonal=True,"
        needs += f"this {type(self).__name__} does not have. Fit {model} with "
        return f"{needs}hyperparameters='sampled' and max_iter above 0."

    def _is_sampled(self):
        return hasattr(self, "theta_samples_")

    def _draws(self, features, codes, n_draws, rng):
        """Draws of f, each by a draw of the hyperparameters, and of the noise."""
        if not self._is_sampled():
            return super()._draws(features, codes, n_draws, rng)
        check_joint(self, len(features), *JOINTLY, at_once=1)
        mixtures, features = self._predicting(features, codes)
        n = len(self.theta_samples_)
        which = rng.randint(n, size=n_draws)
        draws = np.empty((n_draws, len(features), len(mixtures)))
        for k in np.unique(which):
            rows = np.flatnonzero(which == k)
            for j, mixture in enumerate(mixtures):
                part = mixture.parts[k]
                moments = part.mean(features, codes), part.covariance(features, codes)
                with limit_threads(len(features)):
                    draws[rows, :, j] = draw_normal(*moments, len(rows), rng).T
        centre = self._units.of_rows(self._units.centre, codes)
        draws = draws * self._scales(codes) + centre
        noise = np.sqrt(self._noises(codes)[which])
        return np.moveaxis(draws, 0, 2), np.moveaxis(noise, 0, 2)

    def _components(self, features, codes, include_noise):
        """Means and variances of each draw, (n_draws, n_samples, n_outputs)."""
        if not self._is_sampled():
            return super()._components(features, codes, include_noise)
        mixtures, features = self._predicting(features, codes)
        scales = self._scales(codes)
        means = np.stack([of.means(features, codes) for of in mixtures], axis=2)
        variances = np.stack([of.variances(features, codes) for of in mixtures], axis=2)
        variances *= np.square(scales)
        if include_noise:
            variances += self._noises(codes)
        centre = self._units.of_rows(self._units.centre, codes)
        return means * scales + centre, variances

    def _left_out(self, include_noise):
        """Means and variances of training samples, each given the others, and weights.

        All have the shape (n_draws, n_samples, n_outputs). A mode counts as one draw.
        """
        parts = [self._predictive]
        if self._is_sampled():
            parts = list(zip(*(of.parts for of in self._predictive), strict=True))

        def by_parts(include_noise):
            found = [self._leave_out(include_noise, part) for part in parts]
            means, deviations = np.stack(found, axis=1)
            return means, np.square(deviations)

        if len(parts) == 1:
            means, variances = by_parts(include_noise)
            return means, variances, np.ones_like(means)
        means, variances = by_parts(include_noise=True)
        weights = weights_left_out(
            self.y_train_.reshape(means[0].shape) - means, variances
        )
        if not include_noise:
            variances = by_parts(include_noise=False)[1]
        return means, variances, weights

    # drawing

    def _way(self, training, problem, mode):
        """Which hyperparameters predict: what was asked for, where that can be."""
        asked, prior = self.hyperparameters, problem.prior
        if asked == "auto":
            asked = "laplace" if problem.engine.exact else "mode"
            few = len(training.Y) <= MOST_ROWS and not is_dask(training.features)
            most = FEW_ROWS_EACH * prior.n_hyperparameters
            if few and _n_told(problem, mode) <= most:
                asked = "sampled"
            asked = asked if prior.n_terms == 1 else "mode"
        return asked if self.max_iter or asked == "map" else "mode"

    def _draw_hyperparameters(self, lower=()):
        """Draw them at the learned mode, and predict by the draws from now on.

        For each lower rank that is likely, too, `lower` has the likelihood and the mode
        of each output.
        """
        rng = check_random_state(self.random_state or 0)
        seed, n = rng.randint(2**31 - 1), len(self._likelihoods)
        own = list(zip(self._likelihoods, self._thetas(), strict=True))
        samples = []
        for j, ranks in enumerate(zip(*lower, own, strict=True), start=1):
            name = f"output {j} of {n}" if n > 1 else "the output"
            sample = sample_hyperparameters(
                ranks,
                n_draws=self.n_draws,
                seed=[seed, j],
                n_jobs=self.n_jobs,
                tell=partial(self._tell_of_chains, name, n - j + 1),
            )
            _warn_of_sample(name, sample, self._what_helps_chains())
            samples.append(sample)
        self._store_draws([sample.theta for sample in samples])
        self.effective_sample_size_ = min(_least(sample) for sample in samples)
        self.r_hat_ = max(_largest(sample) for sample in samples)
        self.n_divergences_ = sum(sample.n_divergent for sample in samples)
        self.n_evaluations_ += sum(sample.n_evaluations for sample in samples)

    def _what_helps_chains(self):
        """In words, what may let chains move better."""
        exact = self._engine.exact or len(self.tasks_train_) > MOST_ROWS
        dense = "" if exact else "inference='dense', which so few rows allow"
        return dense, lower_rank(self), "narrower bounds of the kernel", "more rows"

    def _tell_of_chains(self, name, n_outputs, n_modes, seconds):
        """Say how long sampling takes; what reports its chains, or None."""
        sampling = f"Sampling the hyperparameters of {name} will take"
        warn_of_duration(sampling, seconds * n_outputs)
        if not self.verbose:
            return None
        modes = "one mode" if n_modes == 1 else f"{n_modes} modes"
        drawing = f"drawing hyperparameters of {name}"
        say(f"{drawing}: {N_CHAINS} chains from {modes}, about {seconds:.0f} s")
        return lambda k, _: say(f"{drawing}: chain {k + 1} of {N_CHAINS} is done")

    def _store_draws(self, thetas, mixtures=None):
        """Predict by draws of theta, (n_draws, n_theta) for each output.

        Unless their mixtures are given, they are made.
        """
        thetas = list(thetas)
        self.theta_samples_ = np.hstack(thetas)
        self._predictive = mixtures or [
            Mixture(likelihood, of_output)
            for likelihood, of_output in zip(self._likelihoods, thetas, strict=True)
        ]
        noises = [
            [likelihood.prior.in_units(theta, scale).noise_variance for theta in of]
            for likelihood, of, scale in zip(
                self._likelihoods, thetas, self._units.scale, strict=True
            )
        ]
        self._noise_variances = np.array(noises).swapaxes(0, 1)
        self._store_levels()

    def _chains_told(self):
        """What was told of the chains."""
        return {name: getattr(self, name) for name in CHAINS}

    def _forget_draws(self):
        """Predict by the mode."""
        for name in ("theta_samples_", *CHAINS):
            vars(self).pop(name, None)


def _warn_of_fixed(drawn):
    """Say where correlations are 0, 1 or -1 in all draws, as the form has them."""
    if _are_fixed(drawn):
        warn(
            "The form of the task covariance fixes all correlations of tasks: they are "
            "0 for independent tasks, 1 for one function, and -1 or 1 for rank 1. "
            "These intervals say nothing of the tasks. A MultiTaskGPRegressor with "
            "rank=2 or more, or with diagonal=True, learns correlations.",
            FixedCorrelationWarning,
        )


def _are_fixed(correlations):
    """Whether those of several tasks are 0, 1 or -1."""
    sizes = np.abs(correlations)
    return sizes.shape[-1] > 1 and (np.minimum(sizes, 1.0 - sizes) < FIXED).all()


def _correlations(prior, thetas):
    return np.array([correlation(prior.K_rho_at(theta)) for theta in thetas])


def _least(sample):
    return float(np.nanmin(sample.effective, initial=np.inf))


def _largest(sample):
    return float(np.nanmax(sample.r_hat, initial=1.0))


def _warn_of_sample(name, sample, helps):
    """Say that the chains did not mix, or their steps failed; and what may help."""
    least, largest = _least(sample), _largest(sample)
    diverged = sample.n_divergent / (THINNED * len(sample.theta))
    if least >= FEWEST and largest <= LARGEST and diverged <= MOST_DIVERGENT:
        return
    warn(
        f"The draws of the hyperparameters of {name} may not represent their "
        f"posterior: the smallest effective sample size is {least:.0f} ({FEWEST} or "
        f"more is good), the largest R-hat is {largest:.2f} ({LARGEST} or less is "
        f"good), and {diverged:.0%} of the trajectories diverged "
        f"({MOST_DIVERGENT:.0%} or less is good). Intervals may be too narrow. This "
        f"helps: {', '.join(filter(None, helps))}, or a larger n_draws, which makes "
        "the chains longer.",
        SamplingWarning,
    )
