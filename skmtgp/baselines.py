"""The models that the paper compares with: iGP, pGP and sGP."""

import warnings
from typing import Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.gaussian_process.kernels import ConstantKernel, Kernel
from sklearn.utils.validation import check_is_fitted

from skmtgp._base import BaseMultiTaskGP, PosteriorMixin
from skmtgp._parallel import printer, run
from skmtgp._sklearn_compat import fit_context
from skmtgp._training import (
    check_test,
    check_training,
    default_kernel,
    unchanged_on_failure,
)
from skmtgp.learning.stages import learn_fixed
from skmtgp.task_covariance import identity, ones


class _FixedTaskCovarianceGP(BaseMultiTaskGP):
    """A Gaussian process whose task covariance is fixed, but for a diagonal."""

    _parameter_constraints = {
        **BaseMultiTaskGP._parameter_constraints,
        "diagonal": ["boolean"],
    }

    def __init__(
        self,
        kernel: Kernel | None = None,
        *,
        diagonal: bool = False,
        task_feature: int | str = -1,
        noise: Literal["shared", "per_task"] = "shared",
        noise_variance: float = 1e-2,
        noise_variance_bounds: ArrayLike | Literal["fixed"] = (1e-10, 1e3),
        normalize_y: bool = True,
        inference: Literal["auto", "dense"] = "auto",
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.kernel = kernel
        self.diagonal = diagonal
        self.task_feature = task_feature
        self.noise = noise
        self.noise_variance = noise_variance
        self.noise_variance_bounds = noise_variance_bounds
        self.normalize_y = normalize_y
        self.inference = inference
        self.max_iter = max_iter
        self.tol = tol
        self.n_jobs = n_jobs
        self.verbose = verbose

    def _default_kernel(self, features):
        return ConstantKernel(1.0, (1e-3, 1e3)) * default_kernel(features)

    def _learns_amplitude(self):
        return self.kernel is None

    def _learn(self, training):
        form = self._form(len(training.tasks), self.diagonal)
        pairs = self._pairs(training)

        def describe(j, mode):
            return (
                f"{pairs[j][1].name}: log marginal likelihood {mode.value:.2f} "
                f"(scaled) after {mode.n_iter} iterations"
            )

        jobs = [(*pair, form) for pair in pairs]
        report = printer(self.verbose, describe)
        return form, run(learn_fixed, jobs, n_jobs=self.n_jobs, report=report)


class IndependentGP(_FixedTaskCovarianceGP):
    r"""Independent Gaussian processes of the tasks that share their kernel, iGP.

    The multi-task model of eq. 6 with :math:`K^\rho = I`: tasks tell each other nothing
    but the hyperparameters, which are learned from all of them.

    Parameters
    ----------
    kernel : Kernel, default=None
        Kernel over the columns of X without the task column, with its starting values
        and bounds. None is an amplitude times a squared exponential with one
        length-scale for each feature, started and bounded relative to the feature's
        standard deviation.
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, one variance for each
        task: how much more the functions of some tasks vary than those of others.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    noise : {"shared", "per_task"}, default="shared"
        Whether the tasks share one noise variance or have one each.
    noise_variance : float, default=1e-2
        Where learning starts, relative to the variance of the target.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the variance of the target.
    normalize_y : bool, default=True
        Whether to take each output off its mean and to divide it by its standard
        deviation before learning. The model's mean is zero otherwise.
    inference : {"auto", "dense"}, default="auto"
        How the likelihood is computed. "auto" is dense and exact.
    max_iter : int, default=2000
        Most iterations of each maximisation; 0 keeps the starting values.
    tol : float, default=1e-2
        Gain in the log likelihood, in nats, under which a maximisation ends.
    n_jobs : int, default=None
        Number of outputs learned at the same time, see :term:`n_jobs`.
    verbose : int, default=0
        1 prints a line for each of them, 2 more of them during each climb.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The kernel as learned.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        The identity (plus the diagonal) times the squared scale of y.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Its factor.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y.
    y_mean_, y_scale_ : float or ndarray of shape (n_outputs,)
        Mean and standard deviation that `normalize_y` uses.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over the outputs.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of the kernels, the diagonals and the noise.
    theta_ : ndarray of shape (n_theta,)
        Theta of the kernel, logarithms of the diagonal and of the noise variances of
        the scaled target, for each output. A target is scaled by `y_scale_`; without
        `normalize_y` it is scaled by its root mean square if the kernel is the default.
    n_iter_ : int
        Iterations on the way to the mode, of the output with most of them.
    n_evaluations_ : int
        Likelihoods and gradients that learning took, summed over the outputs.
    complete_ : bool
        Whether every task was observed at the same inputs, once each.
    X_train_ : ndarray of shape (n_samples, n_features - 1)
        Training inputs without the task column.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of each training sample's task.
    y_train_ : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Training targets.
    n_features_in_ : int
        Number of columns of X, the task column counted.
    feature_names_in_ : ndarray of shape (n_features_in_,)
        Their names, if X has any.

    See Also
    --------
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a collection of
    independent GPs for the contexts, but sharing kernel parameters".

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import IndependentGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
    >>> IndependentGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([ 0.997, -0.997])
    """

    _form = staticmethod(identity)


class PooledGP(_FixedTaskCovarianceGP):
    r"""One Gaussian process for the samples of all tasks, pGP.

    The multi-task model of eq. 6 with :math:`K^\rho = 1 1^T`: the tasks are taken to be
    one and the same function.

    Parameters
    ----------
    kernel : Kernel, default=None
        Kernel over the columns of X without the task column, with its starting values
        and bounds. None is an amplitude times a squared exponential with one
        length-scale for each feature, started and bounded relative to the feature's
        standard deviation.
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, one variance for each
        task: how much its function deviates from the common one.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    noise : {"shared", "per_task"}, default="shared"
        Whether the tasks share one noise variance or have one each.
    noise_variance : float, default=1e-2
        Where learning starts, relative to the variance of the target.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the variance of the target.
    normalize_y : bool, default=True
        Whether to take each output off its mean and to divide it by its standard
        deviation before learning. The model's mean is zero otherwise.
    inference : {"auto", "dense"}, default="auto"
        How the likelihood is computed. "auto" is dense and exact.
    max_iter : int, default=2000
        Most iterations of each maximisation; 0 keeps the starting values.
    tol : float, default=1e-2
        Gain in the log likelihood, in nats, under which a maximisation ends.
    n_jobs : int, default=None
        Number of outputs learned at the same time, see :term:`n_jobs`.
    verbose : int, default=0
        1 prints a line for each of them, 2 more of them during each climb.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The kernel as learned.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        The matrix of ones (plus the diagonal) times the squared scale of y.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Its factor.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y.
    y_mean_, y_scale_ : float or ndarray of shape (n_outputs,)
        Mean and standard deviation that `normalize_y` uses.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over the outputs.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of the kernels, the diagonals and the noise.
    theta_ : ndarray of shape (n_theta,)
        Theta of the kernel, logarithms of the diagonal and of the noise variances of
        the scaled target, for each output. A target is scaled by `y_scale_`; without
        `normalize_y` it is scaled by its root mean square if the kernel is the default.
    n_iter_ : int
        Iterations on the way to the mode, of the output with most of them.
    n_evaluations_ : int
        Likelihoods and gradients that learning took, summed over the outputs.
    complete_ : bool
        Whether every task was observed at the same inputs, once each.
    X_train_ : ndarray of shape (n_samples, n_features - 1)
        Training inputs without the task column.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of each training sample's task.
    y_train_ : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Training targets.
    n_features_in_ : int
        Number of columns of X, the task column counted.
    feature_names_in_ : ndarray of shape (n_features_in_,)
        Their names, if X has any.

    See Also
    --------
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a single GP for each
    joint that learns by pooling all training data from all the contexts".

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import PooledGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x)
    >>> PooledGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([0.997, 0.997])
    """

    _form = staticmethod(ones)


class SingleTaskGP(PosteriorMixin, BaseEstimator):
    """A Gaussian process of its own for each task, sGP.

    Each task and output has its own hyperparameters, learned from its samples alone.

    Parameters
    ----------
    kernel : Kernel, default=None
        Kernel over the columns of X without the task column, with its starting values
        and bounds. None is an amplitude times a squared exponential with one
        length-scale for each feature, started and bounded relative to the feature's
        standard deviation.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    noise_variance : float, default=1e-2
        Where learning starts, relative to the variance of the target.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the variance of the target.
    normalize_y : bool, default=True
        Whether to take each output off its mean and to divide it by its standard
        deviation before learning, for each task separately. The model's mean is zero
        otherwise.
    inference : {"auto", "dense"}, default="auto"
        How the likelihood is computed. "auto" is dense and exact.
    max_iter : int, default=2000
        Most iterations of each maximisation; 0 keeps the starting values.
    tol : float, default=1e-2
        Gain in the log likelihood, in nats, under which a maximisation ends.
    n_jobs : int, default=None
        Number of tasks learned at the same time, see :term:`n_jobs`.
    verbose : int, default=0
        Whether to print a line for each of them.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    estimators_ : list of n_tasks PooledGP
        The model of each task, fitted on features followed by a constant column.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of each training sample's task.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over tasks and outputs.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of all kernels and noises.
    n_iter_ : int
        Iterations on the way to the mode, of the output with most of them.
    n_evaluations_ : int
        Likelihoods and gradients that learning took, summed over tasks and outputs.
    n_features_in_ : int
        Number of columns of X, the task column counted.
    feature_names_in_ : ndarray of shape (n_features_in_,)
        Their names, if X has any.

    See Also
    --------
    IndependentGP : Tasks that share their kernel.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "for each context and each
    joint, we train ... a sGP model with the corresponding training data
    separately".

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import SingleTaskGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
    >>> SingleTaskGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([ 0.997, -0.997])
    """

    _parameter_constraints = {
        name: constraint
        for name, constraint in BaseMultiTaskGP._parameter_constraints.items()
        if name != "noise"
    }

    def __init__(
        self,
        kernel: Kernel | None = None,
        *,
        task_feature: int | str = -1,
        noise_variance: float = 1e-2,
        noise_variance_bounds: ArrayLike | Literal["fixed"] = (1e-10, 1e3),
        normalize_y: bool = True,
        inference: Literal["auto", "dense"] = "auto",
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.kernel = kernel
        self.task_feature = task_feature
        self.noise_variance = noise_variance
        self.noise_variance_bounds = noise_variance_bounds
        self.normalize_y = normalize_y
        self.inference = inference
        self.max_iter = max_iter
        self.tol = tol
        self.n_jobs = n_jobs
        self.verbose = verbose

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn the hyperparameters of each task.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. Outputs are learned separately.

        Returns
        -------
        self : object
            Fitted estimator.
        """
        with unchanged_on_failure(self):
            self._fit(*check_training(self, X, y))
        return self

    def _fit(self, features, labels, Y):
        self.tasks_, self.tasks_train_ = np.unique(labels, return_inverse=True)
        params = {**self.get_params(deep=False), "task_feature": -1, "n_jobs": None}
        alone = PooledGP(**params | {"verbose": 0})
        X = np.column_stack([features, np.zeros(len(features))])
        rows = [self.tasks_train_ == m for m in range(len(self.tasks_))]
        results = run(
            _fit_alone,
            [(alone, X[r], Y[r]) for r in rows],
            n_jobs=self.n_jobs,
            report=printer(self.verbose, self._describe),
        )
        self.estimators_ = fitted = [estimator for estimator, _ in results]
        for label, (_, caught) in zip(self.tasks_.tolist(), results, strict=True):
            for category, message in caught:
                warnings.warn(f"Task {label!r}: {message}", category)
        self.n_iter_ = max(e.n_iter_ for e in fitted)
        self.n_evaluations_ = sum(e.n_evaluations_ for e in fitted)
        self.n_hyperparameters_ = sum(e.n_hyperparameters_ for e in fitted)
        self.log_marginal_likelihoods_ = sum(
            e.log_marginal_likelihoods_ for e in fitted
        )
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )

    def _describe(self, m, result):
        estimator, _ = result
        return (
            f"task {m + 1} of {len(self.tasks_)} after {estimator.n_iter_} iterations"
        )

    @overload
    def predict(
        self,
        X: ArrayLike,
        return_std: Literal[False] = False,
        return_cov: Literal[False] = False,
        include_noise: bool = False,
    ) -> NDArray[np.float64]: ...

    @overload
    def predict(
        self,
        X: ArrayLike,
        return_std: bool = False,
        return_cov: bool = False,
        include_noise: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    def predict(
        self,
        X: ArrayLike,
        return_std: bool = False,
        return_cov: bool = False,
        include_noise: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict the mean of f and, if asked, its uncertainty.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        return_std : bool, default=False
            Whether to return the standard deviation of each prediction too.
        return_cov : bool, default=False
            Whether to return the covariance of the predictions of an output too; that
            of different tasks is zero.
        include_noise : bool, default=False
            Whether the uncertainty is that of a new observation rather than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Predictive mean, in the units of y.
        y_std : ndarray of the shape of y_mean
            Predictive standard deviation. Only if `return_std`.
        y_cov : ndarray of shape (n_samples, n_samples[, n_outputs])
            Predictive covariance. Only if `return_cov`.

        Raises
        ------
        ValueError
            If a task was not seen in fit.
        """
        check_is_fitted(self)
        features, codes = check_test(self, X)
        options = {"return_std": return_std, "return_cov": return_cov}
        return self._predict(
            features, codes, {**options, "include_noise": include_noise}
        )

    def _predict(self, features, codes, options):
        X = np.column_stack([features, np.zeros(len(features))])
        outputs = self.estimators_[0].y_train_.shape[1:]
        mean, spread = np.empty((len(X), *outputs)), np.empty((len(X), *outputs))
        if options["return_cov"]:
            spread = np.zeros((len(X), len(X), *outputs))
        for m in np.unique(codes):
            rows = np.flatnonzero(codes == m)
            result = self.estimators_[m].predict(X[rows], **options)
            if options["return_cov"]:
                mean[rows], spread[np.ix_(rows, rows)] = result
            elif options["return_std"]:
                mean[rows], spread[rows] = result
            else:
                mean[rows] = result
        uncertain = options["return_std"] or options["return_cov"]
        return (mean, spread) if uncertain else mean

    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict each training sample from all the others of its task.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the uncertainty is that of the observation that was left out, f
            plus noise, rather than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Mean of f at each training sample given the others, in the units of y and
            in the order of the rows that `fit` was given.
        y_std : ndarray of the shape of y_mean
            Its standard deviation.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Notes
        -----
        Rasmussen and Williams (2006), eqs. 5.10 to 5.12, for each task alone; see
        :meth:`MultiTaskGPRegressor.loo_predict`, also for scores. The hyperparameters,
        the mean and the scale of each task are kept, which have seen the sample that is
        left out.

        The only sample of a task gets the prior. With `normalize_y` the prior's mean is
        the task's `y_mean_`, which is that sample itself: its error is zero and tells
        nothing, and its `y_scale_` is 1, so that the standard deviation is the kernel's
        own. Leave such tasks out of scores. Without `normalize_y` the mean is 0.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import SingleTaskGP
        >>> from skmtgp.metrics import normalized_mean_squared_error
        >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
        >>> X = np.column_stack([x.astype(object), task])
        >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
        >>> mean, std = SingleTaskGP().fit(X, y).loo_predict()
        >>> normalized_mean_squared_error(y, mean, tasks=task) < 1e-4
        True
        """
        check_is_fitted(self)
        shape = len(self.tasks_train_), *self.estimators_[0].y_train_.shape[1:]
        mean, std = np.empty(shape), np.empty(shape)
        for m, estimator in enumerate(self.estimators_):
            rows = self.tasks_train_ == m
            mean[rows], std[rows] = estimator.loo_predict(include_noise)
        return mean, std


def _fit_alone(estimator, X, y):
    """A fitted clone, and what it warned of: the caller names the task."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fitted = clone(estimator).fit(X, y)
    return fitted, [(w.category, str(w.message)) for w in caught]
