"""What the Gaussian process regressors share: fitting, storing, predicting."""

import warnings
from abc import ABCMeta, abstractmethod
from dataclasses import replace
from numbers import Integral, Real
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import Kernel
from sklearn.utils.validation import check_is_fitted

from skmtgp._dask import is_dask
from skmtgp._estimator import Estimator
from skmtgp._linalg import RESOLVED
from skmtgp._memory import check_memory, check_sparse_memory
from skmtgp._partitions import check_partitions
from skmtgp._posterior import PosteriorMixin
from skmtgp._progress import fitting
from skmtgp._sklearn_compat import Interval, StrOptions, fit_context, with_callbacks
from skmtgp._tasks import complete_design
from skmtgp._training import (
    Training,
    check_kernel,
    check_theta,
    check_training,
    default_kernel,
)
from skmtgp.exceptions import PrecisionWarning
from skmtgp.inference.choice import choose

BLOCK_SIZE = 2**22  # elements of the cross-covariance held at a time for the variance


class BaseMultiTaskGP(PosteriorMixin, Estimator, metaclass=ABCMeta):
    """Base of the Gaussian process regressors with a task column."""

    _parameter_constraints = {
        "kernel": [Kernel, None],
        "task_feature": [Integral, str],
        "noise": [StrOptions({"shared", "per_task"})],
        "noise_variance": [Interval(Real, 0.0, None, closed="neither")],
        "noise_variance_bounds": ["array-like", StrOptions({"fixed"})],
        "normalize_y": ["boolean"],
        "inference": [StrOptions({"auto", "dense", "kronecker", "sparse"})],
        "n_inducing": [Interval(Integral, 1, None, closed="left")],
        "max_iter": [Interval(Integral, 0, None, closed="left")],
        "tol": [Interval(Real, 0.0, None, closed="neither")],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
    }

    @abstractmethod
    def _learn(self, pairs, progress):
        """The form of K^rho and the mode of each output, from its data and settings."""

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn the hyperparameters by maximising the marginal likelihood.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`. Sparse inference
            takes Dask arrays and dataframes, whose rows stay where they are.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. Outputs are learned separately. In the partitions of X if that is
            a Dask collection.

        Returns
        -------
        self : object
            Fitted estimator.

        Raises
        ------
        ValueError
            If a parameter, a feature, a label or a target cannot be used. The estimator
            is then as it was before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            training = self._read(X, y)
            pairs = self._pairs(training)
            form, modes = self._learn(pairs, progress)
            self._store(training, likelihoods(pairs, form, modes), modes)
        return self

    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        r"""Predict each training sample from all the others.

        No model is fitted again: what the fitted one keeps is enough.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the uncertainty is that of the observation that was left out, f
            plus noise, rather than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Mean of f at each training sample given the others, in the units of y and
            in the order of the rows that `fit` was given. Where `add_task` was used,
            the rows of the new task come last.
        y_std : ndarray of the shape of y_mean
            Its standard deviation.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Notes
        -----
        Rasmussen and Williams (2006), eqs. 5.10 to 5.12: with the covariance K of the
        targets, of which `y_mean_` is taken off, the targets left out are normal with

        .. math::
            \mu_i = y_i - \frac{[K^{-1} y]_i}{[K^{-1}]_{ii}}, \quad
            \sigma_i^2 = \frac{1}{[K^{-1}]_{ii}}.

        f has the same mean and the variance :math:`\sigma_i^2` less that of the noise,
        0 where rounding makes that negative. If a JitterWarning said that something was
        added to the diagonal of K, that counts as noise. For each output dense
        inference inverts the triangular factor of K in a copy, which takes n x n
        numbers for a while.

        The hyperparameters are kept, and so are `y_mean_` and `y_scale_`: all of them
        have seen the sample that is left out, so that these predictions are somewhat
        better than those of new samples, the more so the fewer samples there are. The
        only sample of a task is predicted from the other tasks, as far as the task
        covariance relates them; where it does not, that is the prior, whose mean is
        `y_mean_`, or 0 without `normalize_y`.

        Scores come from :mod:`skmtgp.metrics`, averaged within tasks and then over
        tasks. The log loss and the coverage are about observations, so they need
        ``include_noise=True``; the trivial model of the log loss, the mean and variance
        of y, has seen each sample too. The nMSE needs two samples or more of each task.

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
        0.03 -2.1 0.92
        """
        check_is_fitted(self)
        order = self._training().order(self.inference_)  # the posteriors' samples
        shape = len(self.tasks_train_), len(self._posteriors)
        residual, variance = np.empty((2, *shape))
        for j, posterior in enumerate(self._posteriors):
            found = posterior.leave_one_out(include_noise)
            residual[order, j], variance[order, j] = found
        mean = self.y_train_.reshape(residual.shape) - residual * self._scales
        return self._join(mean), self._join(np.sqrt(variance) * self._scales)

    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, NDArray[np.float64]]:
        """Log marginal likelihood of the training targets, in their own units.

        Parameters
        ----------
        theta : array-like of shape (n_theta,), default=None
            Parameters, as in the attribute `theta_`. None is the learned ones.
        eval_gradient : bool, default=False
            Whether to return the gradient too.

        Returns
        -------
        log_likelihood : float
            Summed over the outputs; minus infinity where the covariance of the targets
            cannot be factorised.
        gradient : ndarray of shape (n_theta,)
            Its gradient. Only if `eval_gradient`.
        """
        check_is_fitted(self)
        if theta is None and not eval_gradient:
            return self.log_marginal_likelihood_value_
        self._check_rows()
        parts = np.split(check_theta(theta, self.theta_), len(self._likelihoods))
        change_of_units = -self._n_samples * np.log(self._scales).sum()
        results = []
        for likelihood, part in zip(self._likelihoods, parts, strict=True):
            evaluate = likelihood.value_and_grad if eval_gradient else likelihood.value
            with np.errstate(all="ignore"):  # far from any data
                results.append(evaluate(part))
            likelihood.release()
        if not eval_gradient:
            return float(np.sum(results) + change_of_units)
        values, gradients = zip(*results, strict=True)
        return float(np.sum(values) + change_of_units), np.concatenate(gradients)

    def _default_kernel(self, features):
        return default_kernel(features)

    def _learns_amplitude(self):
        """Whether the model can scale itself to the targets."""
        return True

    def _rank(self, n_tasks):
        """How many latent functions the tasks share."""
        return 1

    def _read(self, X, y):
        """The training data, checked, encoded and scaled."""
        if is_dask(X, y) and self.inference == "sparse":
            return self._scale(*check_partitions(self, X, y))
        features, labels, Y = check_training(self, X, y)
        tasks, codes = np.unique(labels, return_inverse=True)
        return self._scale(features, codes, tasks, Y)

    def _scale(self, features, codes, tasks, Y):
        single_output, Y = Y.ndim == 1, Y.reshape(len(Y), -1)
        mean, scale = np.zeros(Y.shape[1]), np.ones(Y.shape[1])
        if self.normalize_y:
            mean, spread = (np.asarray(of(axis=0)) for of in (Y.mean, Y.std))
        else:  # where the model has an amplitude, only the path of learning changes
            spread = np.sqrt(np.asarray(np.square(Y).mean(axis=0)))
            spread *= self._learns_amplitude()
        varies = spread > RESOLVED * np.abs(mean)
        scale[varies] = spread[varies]
        return Training(features, codes, tasks, Y, mean, scale, single_output)

    def _training(self):
        """The data that the model was fitted to."""
        self._check_rows()
        return Training(
            self.X_train_,
            self.tasks_train_,
            self.tasks_,
            self.y_train_.reshape(len(self.y_train_), -1),
            self._centres,
            self._scales,
            self._single_output,
        )

    def _check_rows(self):
        if not hasattr(self, "X_train_"):
            raise ValueError(
                f"This needs the training rows, but the {type(self).__name__} was "
                "fitted to Dask collections, whose rows it does not keep. Fit it to "
                "arrays, or to a part of the rows that fits in memory."
            )

    def _kernel(self, training):
        """k^x with its starting values."""
        kernel = self.kernel
        if kernel is None:
            kernel = self._default_kernel(training.features)
        check_kernel(kernel, training.features)
        return kernel

    def _pairs(self, training, n_models=1):
        """Data and settings of each output, of which so many models are to be kept."""
        kernel, (n, n_outputs) = self._kernel(training), training.Y.shape
        data = training.features, training.codes, training.tasks
        method = choose(self.inference, kernel, *data)
        n_tasks, n_factors = len(training.tasks), n_outputs * n_models
        if method == "sparse":
            n_inducing = min(n, self.n_inducing)
            check_sparse_memory(n_inducing, n_tasks, self._rank(n_tasks), n_factors)
        else:
            check_memory(
                n // n_tasks if method == "kronecker" else n, n_factors, method
            )
        n_noise = n_tasks if self.noise == "per_task" else 1
        pairs = training.pairs(
            kernel,
            self.noise_variance,
            self._check_noise_bounds(),
            n_noise,
            method,
            max_iter=self.max_iter,
            tol=self.tol,
            verbose=self.verbose,
            n_inducing=self.n_inducing,
        )
        return list(pairs)

    def _check_noise_bounds(self):
        bounds = self.noise_variance_bounds
        if isinstance(bounds, str):
            return bounds
        bounds = np.asarray(bounds, dtype=np.float64)
        if bounds.shape != (2,) or not 0.0 < bounds[0] <= bounds[1] < np.inf:
            raise ValueError(
                f"noise_variance_bounds={self.noise_variance_bounds!r} must be a pair "
                "of positive numbers, the smaller one first, or 'fixed'."
            )
        if not bounds[0] <= self.noise_variance <= bounds[1]:
            raise ValueError(
                f"noise_variance={self.noise_variance} is outside "
                f"noise_variance_bounds={self.noise_variance_bounds!r}: it is where "
                "learning starts. Give one between them."
            )
        return bounds

    def _store(self, training, likelihoods, modes):
        """Set the fitted attributes, in the target's own units."""
        self._likelihoods, self.inference_ = likelihoods, likelihoods[0].inference
        self._posteriors = [
            likelihood.posterior(mode.theta)
            for likelihood, mode in zip(likelihoods, modes, strict=True)
        ]
        self._centres, self._scales = training.y_mean, training.y_scale
        self._single_output = training.single_output
        self.tasks_, self._n_samples = training.tasks, len(training.features)
        self._store_rows(training)
        self.theta_ = np.concatenate([mode.theta for mode in modes])
        vars(self).pop("inducing_inputs_", None)
        if self.inference_ == "sparse":
            Z = [likelihood.Z for likelihood in likelihoods]
            self.inducing_inputs_ = Z[0] if training.single_output else Z
        self._store_parameters(modes)
        self._store_summary(modes)
        self.n_hyperparameters_ = sum(self._count(o) for o in likelihoods)

    def _store_rows(self, training):
        """Keep the rows, unless they lie in Dask's partitions."""
        if is_dask(training.features):
            for name in ("X_train_", "tasks_train_", "y_train_", "complete_"):
                vars(self).pop(name, None)
            for likelihood in self._likelihoods:
                likelihood.forget_rows()
            return
        self.X_train_, self.tasks_train_ = training.features, training.codes
        self.y_train_ = training.Y[:, 0] if training.single_output else training.Y
        self.complete_ = complete_design(self.X_train_, self.tasks_train_) is not None

    def _store_parameters(self, modes):
        square, L = np.square(self._scales), self._likelihoods
        form = L[0].task_covariance
        parts = [o.split(mode.theta) for o, mode in zip(L, modes, strict=True)]
        kernels = [posterior.kernel for posterior in self._posteriors]
        rho = [form.matrix(p[1]) * s for p, s in zip(parts, square, strict=True)]
        factor = [
            form.factor(p[1]) * s for p, s in zip(parts, self._scales, strict=True)
        ]
        noise = [np.exp(p[2]) * s for p, s in zip(parts, square, strict=True)]
        noise = np.array(noise if self.noise == "per_task" else [n[0] for n in noise])
        single = self._single_output
        self.kernel_ = kernels[0] if single else kernels
        self.task_covariance_ = rho[0] if single else np.array(rho)
        self.task_factor_ = factor[0] if single else np.array(factor)
        self.noise_variance_ = noise[0] if single else noise
        self.y_mean_ = float(self._centres[0]) if single else self._centres
        scales = self._scales if self.normalize_y else np.ones_like(self._scales)
        self.y_scale_ = float(scales[0]) if single else scales

    def _store_summary(self, modes):
        values = np.array([posterior.log_likelihood for posterior in self._posteriors])
        self.log_marginal_likelihoods_ = values - self._n_samples * np.log(self._scales)
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )
        self.n_iter_ = max(mode.n_iter for mode in modes)
        self.n_evaluations_ = sum(mode.n_evaluations for mode in modes)
        _warn_of_unfinished(modes, self.max_iter)

    def _count(self, likelihood):
        """Number of hyperparameters of an output as eq. 8 counts them."""
        noise_is_fixed = isinstance(self.noise_variance_bounds, str)
        return (
            likelihood.kernel.n_dims
            + likelihood.task_covariance.n_free
            + (0 if noise_is_fixed else likelihood.n_noise)
        )

    def _means(self, features, codes):
        means = np.stack([p.mean(features, codes) for p in self._posteriors], axis=1)
        return means * self._scales + self._centres

    def _variances(self, features, codes, include_noise):
        variances = np.empty((len(features), len(self._posteriors)))
        for rows in _blocks(len(features), self._n_samples):
            for j, posterior in enumerate(self._posteriors):
                variances[rows, j] = posterior.variance(features[rows], codes[rows])
        variances *= np.square(self._scales)
        return variances + (self._noise(codes) if include_noise else 0.0)

    def _covariances(self, features, codes, include_noise):
        covariances = [p.covariance(features, codes) for p in self._posteriors]
        covariances = np.stack(covariances, axis=2) * np.square(self._scales)
        if include_noise:
            rows = np.arange(len(features))
            covariances[rows, rows] += self._noise(codes)
        return covariances

    def _noise(self, codes):
        """Noise variances, of shape (n_samples, n_outputs)."""
        noise = np.asarray(self.noise_variance_).reshape(len(self._posteriors), -1)
        per_task = noise.shape[1] > 1
        return noise.T[codes] if per_task else np.repeat(noise.T, len(codes), axis=0)


def likelihoods(pairs, form, modes):
    """The likelihood of each output that its mode maximises."""
    return [
        settings.likelihood(replace(data, Z=mode.Z), form)
        for (data, settings), mode in zip(pairs, modes, strict=True)
    ]


def _blocks(n_samples, n_train):
    """Slices of the samples for which the cross-covariance is not too large."""
    size = max(1, BLOCK_SIZE // max(1, n_train))
    return [slice(a, a + size) for a in range(0, n_samples, size)]


def _warn_of_unfinished(modes, max_iter):
    """Say where learning ended before the likelihood stopped growing."""
    stalled = [j + 1 for j, mode in enumerate(modes) if mode.stalled]
    if stalled:
        warnings.warn(
            f"Learning of output {stalled} ended for lack of digits: the prior "
            "variance is so much larger than the noise variance that the likelihood "
            "cannot be resolved further. The model is the best one found; a larger "
            "lower bound in noise_variance_bounds avoids this.",
            PrecisionWarning,
        )
    unfinished = [j + 1 for j, m in enumerate(modes) if not (m.converged or m.stalled)]
    if unfinished and max_iter > 0:
        warnings.warn(
            f"The likelihood of output {unfinished} was still growing after "
            f"max_iter={max_iter} iterations. Increase max_iter, or tol.",
            ConvergenceWarning,
        )
