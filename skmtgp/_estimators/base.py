"""What the Gaussian process regressors share: reading, fitting, storing."""

from __future__ import annotations

from abc import ABCMeta, abstractmethod
from dataclasses import replace
from numbers import Integral, Real
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._data.checks import (
    FEW_ROWS,
    check_training,
    warn_of_constants,
    warn_of_noise,
)
from skmtgp._data.complete import is_complete
from skmtgp._data.dask import is_dask
from skmtgp._data.partitions import check_partitions
from skmtgp._estimators.estimator import public
from skmtgp._estimators.fitted import FittedGP
from skmtgp._estimators.training import Training, default_kernel
from skmtgp._numerics.linalg import RESOLVED
from skmtgp._numerics.memory import check_memory, check_sparse_memory
from skmtgp._numerics.parallel import at_a_time, limit_threads
from skmtgp._support.guide import INFERENCE
from skmtgp._support.progress import fitting
from skmtgp._support.sklearn_compat import (
    Interval,
    StrOptions,
    fit_context,
    with_callbacks,
)
from skmtgp._support.warnings import warn
from skmtgp.exceptions import IncompleteDataWarning, PrecisionWarning
from skmtgp.inference.choice import choose, depends_on_inputs_only, why_dense
from skmtgp.inference.inducing import check_differentiable
from skmtgp.inference.memory import TileMemory
from skmtgp.inference.posterior import noise_is_told
from skmtgp.model.kernel_check import check_covariance, check_kernel, sample_rows

MANY = 5000  # rows, whose dense inference takes long


class BaseMultiTaskGP(FittedGP, metaclass=ABCMeta):
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
        "inducing_inputs": [StrOptions({"greedy", "k-means", "optimised"})],
        "n_exact": [Interval(Integral, 1, None, closed="left")],
        "max_iter": [Interval(Integral, 0, None, closed="left")],
        "tol": [Interval(Real, 0.0, None, closed="neither")],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
    }

    @abstractmethod
    def _learn(self, pairs, progress):
        """The form of K^rho and the mode of each output, from its data and settings."""

    @public
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
            If a parameter, a feature, a label or a target cannot be used, or if the
            kernel is no covariance of the features. The estimator is then as it was
            before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            training = self._read(X, y)
            pairs = self._pairs(training)
            with limit_threads(side(pairs)):
                form, modes = self._learn(pairs, progress)
                self._store(training, likelihoods(pairs, form, modes), modes)
                self._warn_of_noise(modes)
        return self

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
        return self._scale(*check_training(self, X, y))

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
        if len(Y) > FEW_ROWS:
            same = np.asarray(Y.min(axis=0) == Y.max(axis=0))
            warn_of_constants(same & ~varies)
        return Training(features, codes, tasks, Y, mean, scale, single_output)

    def _kernel(self, training):
        """k^x with its starting values."""
        kernel = self.kernel
        if kernel is None:
            kernel = self._default_kernel(training.features)
        check_kernel(kernel, training.features)
        return clone(kernel)  # the user may change theirs

    def _n_climbs(self, n_ranks):
        """How many climbs over all rows an output has that do not wait for others."""
        return n_ranks

    def _pairs(self, training, n_ranks=1, n_kept=1):
        """Data and settings of each output, for models of so many ranks."""
        kernel = self._kernel(training)
        data = training.features, training.codes, training.tasks
        method, n_tasks = choose(self.inference, kernel, *data), len(training.tasks)
        if method == "sparse":
            self._check_sparse(training, kernel, n_ranks, n_kept)
        else:
            self._check_exact(training, kernel, method, n_ranks, n_kept)
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
            inducing_inputs=self.inducing_inputs,
            n_exact=self.n_exact,
        )
        return list(pairs)

    def _check_exact(self, training, kernel, method, n_ranks, n_kept):
        """Whether memory suffices, and whether the data deserve a faster method."""
        n, n_outputs = training.Y.shape
        by_auto = self.inference == "auto" and method == "dense"
        why = why_dense(kernel, training.features, training.codes) if by_auto else ""
        n_tasks = len(training.tasks)
        check_memory(
            n // n_tasks if method == "kronecker" else n,
            n_outputs * n_kept,
            method,
            tiles=TileMemory(kernel, training.features[:1]),
            n_tasks=n_tasks,
            n_parameters=n_tasks * self._rank(n_tasks),
            n_climbs=at_a_time(self.n_jobs, n_outputs * self._n_climbs(n_ranks)),
            why=why,
        )
        if why and n > MANY:
            warn(
                f"{why} As it is, inference is dense, of {n} samples. {INFERENCE}",
                IncompleteDataWarning,
            )

    def _check_sparse(self, training, kernel, n_ranks, n_kept):
        """Whether memory suffices, and the kernel for moving inducing inputs."""
        (n, n_outputs), n_tasks = training.Y.shape, len(training.tasks)
        x = np.asarray(training.features[:1])
        check_sparse_memory(
            min(n, self.n_inducing),
            n_tasks,
            self._rank(n_tasks),
            n_outputs * n_kept,
            n_rows=n,
            tiles=TileMemory(kernel, x),
            n_climbs=at_a_time(self.n_jobs, n_outputs),
            n_exact=min(n, self.n_exact),
            n_exact_climbs=at_a_time(self.n_jobs, n_outputs * self._n_climbs(n_ranks)),
        )
        if self.inducing_inputs == "optimised":
            check_differentiable(kernel, x)

    def _check_noise_bounds(self):
        bounds = self.noise_variance_bounds
        if isinstance(bounds, str):
            return bounds
        bounds = np.asarray(bounds, dtype=object)
        if not _is_range(bounds):
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
        return bounds.astype(np.float64)

    def _store(self, training, likelihoods, modes):
        """Set the fitted attributes, in the target's own units."""
        X = sample_rows(training.features)
        for likelihood, mode in zip(likelihoods, modes, strict=True):
            learned = likelihood.split(mode.theta)[0]
            check_covariance(likelihood.kernel.clone_with_theta(learned), X)
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
        Y = np.array(training.Y)  # otherwise y itself, which the user may change
        self.y_train_ = Y[:, 0] if training.single_output else Y
        self.complete_ = is_complete(self.X_train_, self.tasks_train_)

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

    def _warn_of_noise(self, modes):
        """Say which noise variances the rows do not tell, where they were learned."""
        is_fixed = isinstance(self.noise_variance_bounds, str)
        if is_fixed or self.inference_ == "sparse":
            return
        kernel = self._likelihoods[0].kernel
        if not depends_on_inputs_only(kernel, self.X_train_):  # it may have the noise
            return
        told = [
            noise_is_told(*output) | (not mode.converged)
            for *output, mode in zip(
                self._likelihoods, self._posteriors, modes, strict=True
            )
        ]
        tasks = self.tasks_ if self.noise == "per_task" else None
        warn_of_noise(np.array(told), tasks)

    def _count(self, likelihood):
        """Number of hyperparameters of an output as eq. 8 counts them."""
        noise_is_fixed = isinstance(self.noise_variance_bounds, str)
        return (
            likelihood.kernel.n_dims
            + likelihood.task_covariance.n_free
            + (0 if noise_is_fixed else likelihood.n_noise)
        )


def _is_range(bounds):
    """Whether these are two positive numbers, the smaller one first."""
    if bounds.shape != (2,) or not all(isinstance(bound, Real) for bound in bounds):
        return False
    return bool(0.0 < bounds[0] <= bounds[1] < np.inf)


def likelihoods(pairs, form, modes):
    """The likelihood of each output that its mode maximises."""
    return [
        settings.likelihood(replace(data, Z=mode.Z), form)
        for (data, settings), mode in zip(pairs, modes, strict=True)
    ]


def side(pairs):
    """Rows of the largest matrices that learning decomposes."""
    data, settings = pairs[0]
    n = len(data.y)
    rows = {
        "dense": n,
        "kronecker": n // data.n_tasks,
        "sparse": min(n, max(settings.n_exact, settings.n_inducing)),
    }
    return max(rows[settings.inference], data.n_tasks)


def _warn_of_unfinished(modes, max_iter):
    """Say where learning ended before the likelihood stopped growing."""
    stalled = [j + 1 for j, mode in enumerate(modes) if mode.stalled]
    if stalled:
        which = f" of output {stalled}" * (len(modes) > 1)
        warn(
            f"Learning{which} ended for lack of digits: the prior "
            "variance is so much larger than the noise variance that the likelihood "
            "cannot be resolved further. The model is the best one found; a larger "
            f"lower bound in noise_variance_bounds avoids this. {INFERENCE}",
            PrecisionWarning,
        )
    unfinished = [j + 1 for j, m in enumerate(modes) if not (m.converged or m.stalled)]
    if unfinished and max_iter > 0:
        which = f" of output {unfinished}" * (len(modes) > 1)
        warn(
            f"The likelihood{which} was still growing after "
            f"max_iter={max_iter} iterations. Increase max_iter, or tol.",
            ConvergenceWarning,
        )
