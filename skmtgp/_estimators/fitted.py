"""What a fitted Gaussian process regressor tells: predictions, likelihoods."""

from __future__ import annotations

from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_theta
from skmtgp._data.dask import is_dask
from skmtgp._estimators.conformal import ConformalMixin
from skmtgp._estimators.doubts import warn_of_noise
from skmtgp._estimators.estimator import Estimator, steady
from skmtgp._estimators.forms import lower_rank
from skmtgp._estimators.sampled import SampledMixin
from skmtgp._estimators.summary import SummaryMixin
from skmtgp._estimators.training import Training
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.guide import INFERENCE, PARALLEL
from skmtgp._support.progress import say
from skmtgp._support.warnings import warn
from skmtgp.exceptions import PrecisionWarning
from skmtgp.inference.leeway import times_of, widened
from skmtgp.inference.posterior import noise_is_told
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.forecast import is_large
from skmtgp.learning.jackknife import relearned, with_growth
from skmtgp.learning.laplace import with_leeway
from skmtgp.learning.screening import price
from skmtgp.learning.tuning import TUNING
from skmtgp.model.kernel_check import check_covariance, sample_rows
from skmtgp.model.several import Kernels

COEFFICIENTS = "coef_", "coef_std_", "trend_names_", "trend_mean_"

NO_NOISE = 1e-150  # below, a noise variance stands for none


class FittedGP(SampledMixin, SummaryMixin, ConformalMixin, Estimator):
    """Gaussian process regressor with a task column, as it is once it was fitted."""

    _descriptors = _known = None

    @property
    def _n_outputs(self):
        return len(self._predictive)

    @steady
    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        r"""Predict each training sample from all others.

        No model is fitted again, because the fitted one keeps all that is needed.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the uncertainty is that of the observation that was left out, f plus
            noise, rather than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Mean of f at each training sample given the others, in units of y and in the
            order of the rows in `fit`. Rows that joined later, by `add_task` or
            `partial_fit`, follow them, as in `y_train_`. With `target_transform` it is
            the median, as in `predict`.
        y_std : ndarray of the shape of y_mean
            Its standard deviation, without `variance_factor_`.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Warns
        -----
        NegativeVarianceWarning
            If a variance is negative, by more than rounding explains.

        Notes
        -----
        Rasmussen and Williams (2006), eqs. 5.10 to 5.12. Let K be the covariance of the
        targets y, from which `y_mean_` is subtracted. The targets left out are normal
        with

        .. math::
            \mu_i = y_i - \frac{[K^{-1} y]_i}{[K^{-1}]_{ii}}, \quad
            \sigma_i^2 = \frac{1}{[K^{-1}]_{ii}}.

        f has the same mean, and the variance :math:`\sigma_i^2` minus that of the
        noise, or 0 if rounding makes that negative. If a JitterWarning said that
        something was added to the diagonal of K, that counts as noise. Dense inference
        inverts a copy of the triangular factor of K for each output, which needs memory
        for n x n numbers.

        The hyperparameters, `y_mean_` and `y_scale_` stay as they are, although they
        were learned with the sample that is left out. So these predictions are somewhat
        better than those of new samples, the more so the fewer samples there are. Drawn
        hyperparameters count by what they are likely without the sample, by 1 over its
        density given the others (Gelfand, Dey and Chang 1992), at most by the square
        root of `n_draws` times the mean of that (Ionides 2008). The
        only sample of a task is predicted from the other tasks, as far as the task
        covariance relates them. Without any relation it gets the prior, with the mean
        `y_mean_`, or 0 without `normalize_y`.

        Compute scores with :mod:`skmtgp.metrics`, averaged within tasks and then over
        tasks. The log loss and the coverage are about observations, so they need
        ``include_noise=True``. The trivial model of the log loss, the mean and variance
        of y, has seen each sample, too. The nMSE needs at least two samples of each
        task.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import MultiTaskGPRegressor, metrics
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 6, 60), np.repeat(["a", "b", "c"], 20)
        >>> y = np.repeat([1.0, -2.0, 0.5], 20) * np.sin(x)
        >>> y += 0.1 * rng.standard_normal(60)
        >>> X = np.column_stack([x.astype(object), task])
        >>> model = MultiTaskGPRegressor(rank=1).fit(X, y)
        >>> mean, std = model.loo_predict(include_noise=True)
        >>> nmse = metrics.normalized_mean_squared_error(y, mean, tasks=task)
        >>> msll = metrics.mean_standardized_log_loss(
        ...     y, mean, std, y_train=y, tasks=task
        ... )
        >>> share = metrics.coverage(y, mean, std, level=0.9, tasks=task)
        >>> print(f"{nmse:.2f} {msll:.1f} {share:.2f}")
        0.03 -2.1 0.90
        """
        check_is_fitted(self)
        mean, std = self._target.left_out(self, include_noise)
        return self._join(mean), self._join(std)

    def _leave_out(self, include_noise, posteriors=None):
        """Means of f at training samples given the others, and standard deviations.

        Both have the shape (n_samples, n_outputs), in units of transformed targets.
        `posteriors` are those of a draw, if they are given.
        """
        posteriors = posteriors or self._predictive
        order = self._training().order(self._engine)  # the posteriors' samples
        shape = len(self.tasks_train_), len(posteriors)
        residual, variance = np.empty((2, *shape))
        for j, posterior in enumerate(posteriors):
            with limit_threads(self._side):
                found = posterior.leave_one_out(include_noise)
            residual[order, j], variance[order, j] = found
        scale = self._scales(self.tasks_train_)
        mean = self.y_train_.reshape(residual.shape) - residual * scale
        return mean, np.sqrt(variance) * scale

    def _relearned(self):
        """What residuals of left-out samples grow by if nothing is learned from them.

        An array (n_samples, n_outputs), in units of transformed targets. Draws of the
        hyperparameters are weighed instead, and models of several kernels stay.
        """
        outputs = list(zip(self._likelihoods, self._thetas(), strict=True))
        growth = np.zeros((len(self.tasks_train_), len(outputs)))
        if not self.n_iter_ or self._is_sampled() or outputs[0][0].prior.n_terms > 1:
            return growth
        order = self._training().order(self._engine)
        for of_output, output in zip(growth.T, outputs, strict=True):
            of_output[order] = relearned(*output)[0]
        return growth * self._scales(self.tasks_train_)

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: Literal[False] = False
    ) -> float: ...

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: Literal[True] = ...
    ) -> tuple[float, NDArray[np.float64]]: ...

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, NDArray[np.float64]]: ...

    @steady
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, NDArray[np.float64]]:
        """Log marginal likelihood of the training targets, in their own units.

        With `target_transform` it is that of the transformed targets.

        Parameters
        ----------
        theta : array-like of shape (n_theta,), default=None
            Parameters, as in the attribute `theta_`. None means the learned parameters.
        eval_gradient : bool, default=False
            Whether to return the gradient, too.

        Returns
        -------
        log_likelihood : float
            Sum over the outputs. It is minus infinity if the covariance of the targets
            cannot be factorised.
        gradient : ndarray of shape (n_theta,)
            Its gradient. Only if `eval_gradient`.
        """
        check_is_fitted(self)
        if theta is None and not eval_gradient:
            return self.log_marginal_likelihood_value_
        self._check_rows()
        parts = self._thetas(check_theta(theta, self.theta_))
        change_of_units = self._log_jacobian.sum()
        results = []
        for likelihood, part in zip(self._likelihoods, parts, strict=True):
            evaluate = likelihood.value_and_grad if eval_gradient else likelihood.value
            # far from any data there are none
            with np.errstate(all="ignore"), limit_threads(self._side):
                results.append(evaluate(part))
            likelihood.release()
        if not eval_gradient:
            return float(np.sum(results) + change_of_units)
        values, gradients = zip(*results, strict=True)
        return float(np.sum(values) + change_of_units), np.concatenate(gradients)

    def _thetas(self, theta=None):
        """Theta of each output, as learned if no other one is given."""
        theta = self.theta_ if theta is None else theta
        return np.split(theta, len(self._likelihoods))

    def _draws_of_outputs(self):
        """Draws of theta of each output, (n_draws, n_theta)."""
        return np.split(self.theta_samples_, len(self._likelihoods), axis=1)

    @property
    def _side(self):
        """Rows of the largest matrices that predictions are made with."""
        return max(likelihood.side for likelihood in self._likelihoods)

    def _training(self):
        """The data that the model was fitted to."""
        self._check_rows()
        return Training(
            features=self.X_train_,
            codes=self.tasks_train_,
            tasks=self.tasks_,
            Y=self.y_train_.reshape(len(self.y_train_), -1),
            single_output=self._single_output,
            units=self._units,
            noise=self.noise_,
            target=self._target,
            descriptors=self._descriptors,
            trends=self._trends(),
            known=self._known,
        )

    def _trends(self):
        """The trend of each output, in its units; None without one."""
        trends = [likelihood.prior.trend for likelihood in self._likelihoods]
        return None if trends[0] is None else trends

    def _check_rows(self):
        if not hasattr(self, "X_train_"):
            raise ValueError(
                f"This needs the training rows, but the {type(self).__name__} was "
                "fitted to Dask collections, whose rows it does not keep. Fit it to "
                f"arrays, or to a part of the rows that fits in memory. {PARALLEL}"
            )

    def _knows_unseen(self):
        """Whether what all tasks share, or descriptors, tell of another one."""
        told = self._shares() or self._descriptors is not None
        alike = self._likelihoods[0].prior.tells_unseen
        return told and alike and self._has_usual_centre()

    def _has_usual_centre(self):
        """Whether tasks without rows have the centre of the others."""
        return not self._units.own_centres

    def _shares(self):
        """Whether the user asked for a function that all tasks share alike."""
        return bool(np.any(getattr(self, "shared", False)))

    def _predicting(self, features, codes):
        """What predicts, with tasks that were never seen if there are any.

        Parameters
        ----------
        features : ndarray of shape (n_samples, n_features - 1)
            Columns of X without the task's.
        codes : ndarray of shape (n_samples,)
            Positions of the tasks; those that were never seen are beyond.

        Returns
        -------
        posteriors : list of n_outputs Posterior
        inputs : ndarray of shape (n_samples, n_inputs)
            Columns without the descriptors.
        """
        described = None
        if self._descriptors is not None:
            described = self._descriptors.unseen(features, codes)
            features = self._descriptors.inputs(features)
        return self._predictive_for(codes, described), features

    def _predictive_for(self, codes, described=None):
        """Posteriors that know these tasks; of unseen ones what is `described`."""
        n_unseen = max(0, codes.max(initial=0) + 1 - len(self.tasks_))
        if not n_unseen:
            return self._predictive
        return [of.with_unseen(n_unseen, described) for of in self._predictive]

    def _means(self, features, codes):
        posteriors, X = self._predicting(features, codes)
        means = np.stack([p.mean(X, codes) for p in posteriors], axis=1)
        return self._units.unscaled(means, codes)

    def _means_of_terms(self, features, codes):
        """Of each term, the level last, (n_samples, n_outputs, n_terms + 1)."""
        posteriors, X = self._predicting(features, codes)
        means = np.stack([p.means_of_terms(X, codes).T for p in posteriors], 1)
        means *= self._scales(codes)[..., None]
        means[..., -1] += self._units.of_rows(self._units.centre, codes)
        return means

    def _variances(self, features, codes, include_noise):
        posteriors, X = self._predicting(features, codes)
        variances = np.stack([p.variance(X, codes) for p in posteriors], axis=1)
        variances *= np.square(self._scales(codes))
        return variances + (self._noise(codes) if include_noise else 0.0)

    def _covariances(self, features, codes, include_noise):
        posteriors, X = self._predicting(features, codes)
        covariances = _together(posteriors, X, codes)
        scales = np.broadcast_to(self._scales(codes), (len(X), len(posteriors)))
        for of_row, scale in zip(covariances, scales, strict=True):
            of_row *= scale * scales
        if include_noise:
            rows = np.arange(len(features))
            covariances[rows, rows] += self._noise(codes)
        return covariances

    def _scales(self, codes):
        """What the targets were divided by, (n_samples or 1, n_outputs)."""
        return self._units.of_rows(self._units.scale, codes)

    def _noise(self, codes):
        """Noise variances, of shape (n_samples, n_outputs)."""
        return self._noises(codes).mean(axis=0)

    def _noises(self, codes):
        """Those of each draw of the hyperparameters, (n_draws, n_samples, n_outputs).

        They are larger than those learned where all variances are, see `OfAll`.
        """
        return self._noises_learned(codes) * self._factors(codes)

    def _factors(self, codes):
        """What variances are multiplied by, (n_samples or 1, n_outputs)."""
        return np.reshape(list(map(times_of, self._leeway)), (1, -1))

    def _noises_learned(self, codes):
        """The same as they were learned.

        A task that was never seen has the geometric mean of the others', each counted
        as often as it has rows.
        """
        noise = self._noise_variances
        if noise.shape[2] == 1:
            return np.repeat(noise.swapaxes(1, 2), len(codes), axis=1)
        with np.errstate(divide="ignore"):  # there may be none: alpha has it all
            logs = np.average(np.log(noise), axis=2, weights=self._n_rows)
        usual = np.exp(logs)[..., None]
        noise = np.concatenate([noise, usual], axis=2).swapaxes(1, 2)
        return noise[:, np.minimum(codes, noise.shape[1] - 1)]

    # what is kept of a fit

    def _store(self, training, problems, modes, lower=()):
        """Set the fitted attributes, in the target's own units.

        Draws of the hyperparameters are of this rank and of lower ones, whose problems
        and modes `lower` has.
        """
        if self.verbose and is_large(problems[0]):
            say(f"computing the posterior of {len(problems[0].data)} rows")
        modes = self._settled(problems, modes)
        way = self._way(training, problems[0], modes[0])
        if way == "laplace":
            if self.verbose:
                say("looking how much the rows leave open of the hyperparameters")
            modes = list(map(with_leeway, problems, modes))
        pairs = zip(problems, modes, strict=True)
        likelihoods = [problem.likelihood_at(mode) for problem, mode in pairs]
        posteriors = self._posteriors_at(training, likelihoods, modes)
        if way in ("mode", "map"):
            modes = self._opened(problems, modes, posteriors)
        if way != "sampled" and self._counts_learning():
            modes = list(map(with_growth, problems, modes, posteriors))
        learned = training, problems[0].engine, likelihoods, modes, posteriors
        self._store_learned(*learned)
        self.hyperparameters_ = way
        if way == "sampled":
            self._draw_hyperparameters([starts_of(*of_rank) for of_rank in lower])

    def _settled(self, problems, modes):
        """Modes as they are kept; a subclass may learn rows of small tasks again."""
        return modes

    def _opened(self, problems, modes, posteriors):
        """Modes with what is open of rows of F; a subclass may have such rows."""
        return modes

    def _counts_learning(self):
        """Whether variances count that hyperparameters were learned from few rows."""
        return True

    def _store_learned(self, training, engine, likelihoods, modes, posteriors):
        """Set them from likelihoods and posteriors that are there already."""
        thetas = [mode.theta for mode in modes]
        self._leeway = [mode.leeway for mode in modes]
        self._store_posteriors(training, engine, likelihoods, posteriors)
        self.theta_ = np.concatenate(thetas)
        self._store_parameters(thetas)
        self._store_modes(modes)

    def _posteriors_at(self, training, likelihoods, modes):
        """Posteriors, if the kernels as learned are covariances of the rows."""
        X = sample_rows(training.features)
        for likelihood, mode in zip(likelihoods, modes, strict=True):
            check_covariance(likelihood.prior.kernel_at(mode.theta), X)
        pairs = zip(likelihoods, modes, strict=True)
        return [likelihood.posterior(mode.theta) for likelihood, mode in pairs]

    def _store_posteriors(self, training, engine, likelihoods, posteriors):
        """Set what follows from the rows and the posterior of each output."""
        self._engine, self.inference_ = engine, engine.name
        self._likelihoods, self._posteriors = likelihoods, posteriors
        outputs = zip(posteriors, likelihoods, self._leeway, strict=True)
        self._predictive = [widened(*output) for output in outputs]
        factors = list(map(times_of, self._leeway))
        self.variance_factor_ = (
            factors[0] if training.single_output else np.array(factors)
        )
        self._forget_draws()
        self._units, self._single_output = training.units, training.single_output
        self._store_target(training.target)
        self.normalize_y_ = training.units.name if self.normalize_y else False
        self.noise_ = training.noise
        self._log_jacobian = training.log_jacobian()
        self.tasks_ = training.tasks
        self._descriptors, self._known = training.descriptors, training.known
        self._store_rows(training)
        for name in ("inducing_inputs_", *COEFFICIENTS):
            vars(self).pop(name, None)
        if not engine.exact:
            Z = [likelihood.inputs for likelihood in likelihoods]
            self.inducing_inputs_ = Z[0] if training.single_output else Z
        self._store_likelihoods()

    def _store_rows(self, training):
        """Keep the rows, unless they lie in Dask's partitions, and their numbers."""
        self._n_rows = np.asarray(training.counts)  # of each task
        if is_dask(training.features):
            for name in ("X_train_", "tasks_train_", "y_train_", "complete_"):
                vars(self).pop(name, None)
            for likelihood in self._likelihoods:
                likelihood.forget_rows()
            return
        self.X_train_, self.tasks_train_ = training.features, training.codes
        Y = np.array(training.Y)  # otherwise y itself, which the user may change
        self.y_train_ = Y[:, 0] if training.single_output else Y
        self.complete_ = training.design is not None and training.n_missing == 0

    def _store_parameters(self, thetas):
        outputs = zip(self._likelihoods, thetas, self._units.scale, strict=True)
        found = [
            likelihood.prior.in_units(theta, scale)
            for likelihood, theta, scale in outputs
        ]
        kernels, rho, factor, *variances = zip(*found, strict=True)
        level, noise = map(np.array, variances)
        noise = np.where(noise > NO_NOISE, noise, 0.0)
        kernels = [list(of) if isinstance(of, Kernels) else of for of in kernels]
        self.kernel_ = kernels[0] if self._single_output else kernels
        factor = list(factor) if isinstance(factor[0], list) else np.array(factor)
        self.task_factor_ = factor[0] if self._single_output else factor
        self.task_covariance_ = rho[0] if self._single_output else np.array(rho)
        self._noise_variances = noise[None]
        level = _of_all_tasks(level)
        noise = noise if self.noise_ == "per_task" else _of_all_tasks(noise)
        self.level_variance_, self.noise_variance_ = self._of_outputs(level, noise)
        centre, scale = map(_of_all_tasks, self._units)
        scale = scale if self.normalize_y else np.ones_like(scale)
        self.y_mean_, self.y_scale_ = self._of_outputs(centre, scale)
        self._store_levels()

    def _store_levels(self):
        """The level of each task, in units of y, and its deviation."""
        units = self._units
        levels = np.array([posterior.levels for posterior in self._predictive])
        variances = np.array([p.level_variances() for p in self._predictive])
        levels = levels * units.scale + units.centre
        if self._trends() is not None:
            self._store_coefficients()
        deviations = np.sqrt(variances) * units.scale
        self.task_level_, self.task_level_std_ = self._of_outputs(levels, deviations)

    def _store_coefficients(self):
        """The trend's coefficients, in units of y, and their deviations."""
        trend = self._likelihoods[0].prior.trend
        found = [of.coefficients_in_units() for of in self._predictive]
        found = map(np.array, zip(*found, strict=True))
        found = found if trend.per_task else (of[:, 0] for of in found)
        self.coef_, self.coef_std_ = self._of_outputs(*found)
        self.trend_names_ = np.array(trend.columns.names)
        self.trend_mean_ = trend.centre if len(trend.centre) > 1 else trend.centre[0]

    def _of_outputs(self, *arrays):
        """Arrays with an axis of the outputs first, without it if y had none."""
        if not self._single_output:
            return arrays
        return [of[0] if of.ndim > 1 else float(of[0]) for of in arrays]

    def _store_likelihoods(self):
        values = np.array([posterior.log_likelihood for posterior in self._posteriors])
        self.log_marginal_likelihoods_ = values + self._log_jacobian
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )
        self.n_hyperparameters_ = sum(
            likelihood.prior.n_hyperparameters for likelihood in self._likelihoods
        )

    def _store_modes(self, modes):
        """What learning took, and whether it has ended."""
        self.n_iter_ = max(mode.n_iter for mode in modes)
        self.n_evaluations_ = sum(mode.n_evaluations for mode in modes)
        _warn_of_unfinished(modes, self.max_iter)

    def _warn_of_noise(self, problems, modes):
        """Say which noise variances the rows do not tell, where they were learned."""
        is_fixed = isinstance(self.noise_variance_bounds, str)
        if is_fixed or not self._engine.exact:
            return
        prior = self._likelihoods[0].prior
        if not prior.depends_on_inputs_only(self.X_train_):  # they may have the noise
            return
        told = [
            noise_is_told(*output, problem.pull_of_noise(mode.theta))
            | (not mode.converged)
            for problem, mode, *output in zip(
                problems, modes, self._likelihoods, self._posteriors, strict=True
            )
        ]
        tasks = self.tasks_ if self.noise_ == "per_task" else None
        warn_of_noise(np.array(told), tasks, lower_rank(self))


def evidence_of(model):
    """The log evidence of a fitted model by Laplace's method, in units of y.

    As that of forms, it is at most some nats for each hyperparameter below eq. 8.
    """
    found = map(_evidence_at, model._likelihoods, model._thetas())
    return sum(found) + float(model._log_jacobian.sum())


def _evidence_at(likelihood, theta):
    n = len(likelihood.y) if likelihood.known is None else likelihood.known.counts.sum()
    k = likelihood.prior.n_hyperparameters
    eq_8 = likelihood.value(theta) - price(k, n)
    return max(evidence_around(likelihood, theta), eq_8 - TUNING.most_charged * k)


def _together(posteriors, X, codes):
    """Covariances of f of each output, (n_samples, n_samples, n_outputs)."""
    if len(posteriors) == 1:
        return posteriors[0].covariance(X, codes)[..., None]
    covariances = np.empty((len(X), len(X), len(posteriors)))
    for j, posterior in enumerate(posteriors):
        covariances[..., j] = posterior.covariance(X, codes)
    return covariances


def starts_of(problems, modes):
    """The likelihood of each output, and where it was learned."""
    pairs = zip(problems, modes, strict=True)
    return [(problem.likelihood_at(mode), mode.theta) for problem, mode in pairs]


def _of_all_tasks(array):
    """One number for each output where it is that of all tasks."""
    return array[:, 0] if array.shape[1] == 1 else array


def _warn_of_unfinished(modes, max_iter):
    """Say where learning ended before the likelihood stopped growing."""
    stalled = [j + 1 for j, mode in enumerate(modes) if mode.stalled]
    if stalled:
        which = f" of output {stalled}" * (len(modes) > 1)
        warn(
            f"Learning{which} ended for lack of digits: the prior variance is so much "
            "larger than the noise variance that the likelihood has too few correct "
            "digits to go on. The model is the best one found. A larger lower bound in "
            f"noise_variance_bounds avoids this. {INFERENCE}",
            PrecisionWarning,
        )
    unfinished = [j + 1 for j, m in enumerate(modes) if not (m.converged or m.stalled)]
    if unfinished and max_iter > 0:
        which = f" of output {unfinished}" * (len(modes) > 1)
        warn(
            f"The likelihood{which} was still growing after "
            f"max_iter={max_iter} iterations. Increase max_iter or tol.",
            ConvergenceWarning,
        )
