"""Bayesian linear regression, which the paper begins its comparison with."""

from numbers import Integral, Real
from typing import Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular
from scipy.special import gammaln
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state, check_scalar
from sklearn.utils.validation import check_is_fitted

from skmtgp._base import PosteriorMixin
from skmtgp._sklearn_compat import Interval, fit_context
from skmtgp._training import check_test, check_training, unchanged_on_failure

__all__ = ["BayesianLinearRegression"]

RESOLVED = 10.0 * np.finfo(np.float64).eps  # of a column's norm, by QR


class _Posterior:
    """Normal-inverse-gamma posterior of one regression.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Covariates without the constant.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.
    model : BayesianLinearRegression
        Has the parameters of the prior.
    """

    def __init__(self, features, Y, model):
        self.has_intercept = model.fit_intercept
        self.centre = np.zeros(features.shape[1])
        if self.has_intercept:
            self.centre = features.mean(axis=0)
        design = self._design(features)
        n, p = design.shape
        prior = self._root_of_prior(design, model.weight_variance)
        rows = np.block([[design, Y], [prior, np.zeros((p, Y.shape[1]))]])
        R = np.linalg.qr(rows, mode="r")
        self.root = R[:p, :p]  # V_n^{-1} = root^T root
        self.weights = solve_triangular(self.root, R[:p, p:])
        self.shape = model.noise_shape + 0.5 * n
        self.rate = model.noise_rate + 0.5 * np.square(R[p:, p:]).sum(axis=0)
        self.log_evidence = self._log_evidence(n, model)

    def _log_evidence(self, n, model):
        """Log density of Y, of shape (n_outputs,)."""
        log_det = 2.0 * np.log(np.abs(np.diagonal(self.root))).sum()  # of V_n^{-1}
        return (
            gammaln(self.shape)
            - gammaln(model.noise_shape)
            + model.noise_shape * np.log(model.noise_rate)
            - self.shape * np.log(self.rate)
            - 0.5 * (log_det + len(self.root) * np.log(model.weight_variance))
            - 0.5 * n * np.log(2.0 * np.pi)
        )

    def _design(self, features):
        """Covariates in columns, the constant last.

        They are centred: features far from zero are nearly collinear with the constant.
        """
        centred = features - self.centre
        if not self.has_intercept:
            return centred
        return np.column_stack([centred, np.ones(len(features))])

    def _root_of_prior(self, design, weight_variance):
        """A matrix B with B^T B = V_0^{-1}, for the weights of the centred covariates.

        The constant's weight is then the intercept plus centre @ coef.
        """
        B = np.eye(design.shape[1])
        if self.has_intercept:
            B[-1, :-1] = -self.centre
        B /= np.sqrt(weight_variance)
        # A prior that is flat beyond the digits of the data would leave the pivots of
        # collinear covariates to rounding.
        floor = RESOLVED * np.linalg.norm(design, axis=0)
        np.fill_diagonal(B, np.maximum(np.diagonal(B), floor))
        return B

    @property
    def coef(self):
        """Of shape (n_features, n_outputs)."""
        return self.weights[: len(self.centre)]

    @property
    def intercept(self):
        """Of shape (n_outputs,)."""
        if not self.has_intercept:
            return np.zeros(self.weights.shape[1])
        return self.weights[-1] - self.centre @ self.coef

    @property
    def noise_variance(self):
        """Posterior mean of sigma^2, of shape (n_outputs,)."""
        if self.shape <= 1.0:
            return np.full_like(self.rate, np.inf)
        return self.rate / (self.shape - 1.0)

    def mean(self, features):
        """Of f, of shape (n_samples, n_outputs)."""
        return self._design(features) @ self.weights

    def variances(self, features):
        """Of f in units of sigma^2, of shape (n_samples,)."""
        return np.square(self._half(features)).sum(axis=0)

    def covariances(self, features):
        """Of f in units of sigma^2, of shape (n_samples, n_samples)."""
        half = self._half(features)
        return half.T @ half

    def _half(self, features):
        """A matrix H with H^T H = X V_n X^T."""
        return solve_triangular(self.root, self._design(features).T, trans="T")

    def draw(self, features, n_draws, rng):
        """Draws of f, of shape (n_samples, n_outputs, n_draws)."""
        size = *self.weights.shape, n_draws
        precision = rng.gamma(self.shape, size=size[1:]) / self.rate[:, None]
        normal = rng.standard_normal(size) / np.sqrt(precision)
        deviation = solve_triangular(self.root, normal.reshape(size[0], -1))
        weights = self.weights[..., None] + deviation.reshape(size)
        return np.tensordot(self._design(features), weights, 1)


class BayesianLinearRegression(PosteriorMixin, BaseEstimator):
    r"""Bayesian linear regression of its own for each task, LR.

    For each task and output, with the covariates x and the constant in the rows of D,

    .. math::
        y \sim \mathcal N(D \beta, \sigma^2 I), \qquad
        p(\beta, \sigma^2) = \mathcal N(\beta \mid 0, \sigma^2 v I)\,
        \mathcal{IG}(\sigma^2 \mid a_0, b_0)

    with the parameters of the prior given, not learned. Nothing is scaled: the prior is
    in the units of X and y.

    Parameters
    ----------
    pooled : bool, default=False
        Whether one regression is learned from the samples of all tasks, rather than one
        for each task.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    fit_intercept : bool, default=True
        Whether a constant is one of the covariates. Its weight has the same prior.
    weight_variance : float, default=1e8
        Prior variance v of the weights relative to the noise variance, in inverse
        squared units of the features.
    noise_shape : float, default=1.0
        Shape :math:`a_0` of the prior of the noise variance.
    noise_rate : float, default=1.0
        Rate (scale of the inverse-gamma density) :math:`b_0` of the prior of the noise
        variance, in squared units of y.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    coef_ : ndarray of shape ([n_outputs,] n_tasks, n_features - 1)
        Posterior mean of the weights, in units of y per unit of the feature; equal rows
        if `pooled`.
    intercept_ : ndarray of shape ([n_outputs,] n_tasks)
        Posterior mean of the constant's weight, in units of y; 0 without
        `fit_intercept`.
    noise_variance_ : ndarray of shape ([n_outputs,] n_tasks)
        Posterior mean of the noise variance, in squared units of y; infinite where
        `degrees_of_freedom_` is 2 or less.
    degrees_of_freedom_ : ndarray of shape (n_tasks,)
        Degrees of freedom of the Student-t predictions, 2 `noise_shape` plus the number
        of samples of the regression.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, the weights and the noise variances
        integrated out, summed over regressions and outputs.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_features_in_ : int
        Number of columns of X, the task column counted.
    feature_names_in_ : ndarray of shape (n_features_in_,)
        Their names, if X has any.

    See Also
    --------
    SingleTaskGP : A Gaussian process for each task.
    PooledGP : A Gaussian process for the samples of all tasks.
    sklearn.linear_model.BayesianRidge : Learns the parameters of its prior.

    Notes
    -----
    Section 6 of [1]_ has this model for each context and each joint, with covariates
    :math:`(x, \mathrm{sgn}(\dot q), 1)`, :math:`v = 10^8` and :math:`a_0 = b_0 = 1`, as
    here by default. The posterior has the form of the prior (section 7.6.3 of [2]_);
    after n samples

    .. math::
        V_n^{-1} &= D^T D + v^{-1} I, & \beta_n &= V_n D^T y, \\
        a_n &= a_0 + n / 2, &
        b_n &= b_0 + \tfrac12 (|y - D \beta_n|^2 + v^{-1} |\beta_n|^2).

    Then f at covariates x has a Student-t distribution with :math:`2 a_n` degrees of
    freedom, mean :math:`x^T \beta_n` and squared scale :math:`x^T V_n x\, b_n / a_n`;
    for an observation, 1 is added to :math:`x^T V_n x`. The mean depends neither on
    :math:`a_0` nor on :math:`b_0`. The evidence is

    .. math::
        \log p(y) = \log\frac{\Gamma(a_n)\, b_0^{a_0}}{\Gamma(a_0)\, b_n^{a_n}}
        + \tfrac12 \log\frac{|V_n|}{v^p} - \tfrac n2 \log 2\pi

    for p covariates. All is computed from a QR decomposition of D above the root of the
    prior's precision, so that covariates may be constant or collinear or more than
    samples. Time is linear in the number of samples.

    References
    ----------
    .. [1] K. M. A. Chai, C. K. I. Williams, S. Klanke and S. Vijayakumar, "Multi-task
       Gaussian Process Learning of Robot Inverse Dynamics", NIPS 21, 2008.
    .. [2] K. P. Murphy, "Machine Learning: A Probabilistic Perspective", MIT Press,
       2012.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import BayesianLinearRegression
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = 1.0 + x * np.where(task == "a", 2.0, -3.0)
    >>> model = BayesianLinearRegression().fit(X, y)
    >>> model.coef_.round(3)
    array([[ 2.],
           [-3.]])
    >>> mean, std = model.predict([[1.5, "a"], [1.5, "b"]], return_std=True)
    >>> mean.round(3)
    array([ 4. , -3.5])
    """

    _parameter_constraints = {
        "pooled": ["boolean"],
        "task_feature": [Integral, str],
        "fit_intercept": ["boolean"],
        "weight_variance": [Interval(Real, 0.0, None, closed="neither")],
        "noise_shape": [Interval(Real, 0.0, None, closed="neither")],
        "noise_rate": [Interval(Real, 0.0, None, closed="neither")],
    }

    def __init__(
        self,
        *,
        pooled: bool = False,
        task_feature: int | str = -1,
        fit_intercept: bool = True,
        weight_variance: float = 1e8,
        noise_shape: float = 1.0,
        noise_rate: float = 1.0,
    ) -> None:
        self.pooled = pooled
        self.task_feature = task_feature
        self.fit_intercept = fit_intercept
        self.weight_variance = weight_variance
        self.noise_shape = noise_shape
        self.noise_rate = noise_rate

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Compute the posterior of the weights and of the noise variance.

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

        Raises
        ------
        ValueError
            If a parameter, a feature, a label or a target cannot be used. The estimator
            is then as it was before.
        """
        with unchanged_on_failure(self):
            self._fit(*check_training(self, X, y))
        return self

    def _fit(self, features, labels, y):
        self.tasks_, codes = np.unique(labels, return_inverse=True)
        n_tasks = len(self.tasks_)
        self._single_output, Y = y.ndim == 1, y.reshape(len(y), -1)
        self._regressions = np.arange(n_tasks)  # which of them a task has
        if self.pooled:
            self._regressions = np.zeros(n_tasks, dtype=int)
        which = self._regressions[codes]
        self._posteriors = [
            _Posterior(features[which == r], Y[which == r], self)
            for r in range(which.max() + 1)
        ]
        self._store()

    def _store(self):
        """Set the fitted attributes."""
        of_tasks = [self._posteriors[r] for r in self._regressions]
        self.coef_ = self._outputs_first([p.coef for p in of_tasks])
        self.intercept_ = self._outputs_first([p.intercept for p in of_tasks])
        self.noise_variance_ = self._outputs_first([p.noise_variance for p in of_tasks])
        self.degrees_of_freedom_ = np.array([2.0 * p.shape for p in of_tasks])
        self.log_marginal_likelihoods_ = sum(p.log_evidence for p in self._posteriors)
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )

    def _outputs_first(self, values):
        """An array of what each task has, without an axis for a single output."""
        values = np.ascontiguousarray(np.moveaxis(np.array(values), -1, 0))
        return values[0] if self._single_output else values

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

        The distribution is Student's t with `degrees_of_freedom_` nu; its scale is the
        standard deviation times sqrt((nu - 2) / nu). Where nu is 2 or less (one sample
        of the task and a `noise_shape` of 0.5 or less) it has no finite variance, and
        the uncertainty is infinite.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        return_std : bool, default=False
            Whether to return the standard deviation of each prediction too.
        return_cov : bool, default=False
            Whether to return the covariance of the predictions of an output too; that
            of different tasks is zero, unless they are pooled.
        include_noise : bool, default=False
            Whether the uncertainty is that of a new observation, f plus noise, rather
            than that of f.

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
        if return_std and return_cov:
            raise ValueError("Set return_std or return_cov, not both.")
        check_is_fitted(self)
        features, codes = check_test(self, X)
        mean = self._means(features, codes)
        if return_std:
            return mean, np.sqrt(self._variances(features, codes, include_noise))
        if return_cov:
            return mean, self._covariances(features, codes, include_noise)
        return mean

    def sample_y(
        self,
        X: ArrayLike,
        n_samples: int = 1,
        random_state: np.random.RandomState | int | None = 0,
    ) -> NDArray[np.float64]:
        """Draw f from its posterior, which is Student's t.

        Each draw has weights and a noise variance of its own for each regression and
        output: its values lie on a plane.

        Parameters
        ----------
        X : array-like of shape (n_samples_X, n_features)
            Inputs, with the task labels in column `task_feature`.
        n_samples : int, default=1
            Number of draws.
        random_state : int, RandomState instance or None, default=0
            Source of randomness.

        Returns
        -------
        y_samples : ndarray of shape (n_samples_X[, n_outputs], n_samples)
            Draws.

        Raises
        ------
        ValueError
            If a task was not seen in fit.
        """
        check_is_fitted(self)
        check_scalar(n_samples, "n_samples", Integral, min_val=0)
        rng = check_random_state(random_state)
        features, codes = check_test(self, X)
        draws = np.empty((len(features), self._n_outputs, n_samples))
        for rows, posterior in self._parts(codes):
            draws[rows] = posterior.draw(features[rows], n_samples, rng)
        return draws[:, 0] if self._single_output else draws

    @property
    def _n_outputs(self):
        return len(self.log_marginal_likelihoods_)

    def _parts(self, codes):
        """The rows of each regression and its posterior."""
        which = self._regressions[codes]
        for r in np.unique(which):
            yield np.flatnonzero(which == r), self._posteriors[r]

    def _join(self, values):
        """Without the axis of the outputs where y was one-dimensional."""
        return values[..., 0] if self._single_output else values

    def _means(self, features, codes):
        means = np.empty((len(features), self._n_outputs))
        for rows, posterior in self._parts(codes):
            means[rows] = posterior.mean(features[rows])
        return self._join(means)

    def _variances(self, features, codes, include_noise):
        variances = np.empty((len(features), self._n_outputs))
        for rows, posterior in self._parts(codes):
            relative = posterior.variances(features[rows]) + float(include_noise)
            variances[rows] = _times(relative, posterior.noise_variance)
        return self._join(variances)

    def _covariances(self, features, codes, include_noise):
        n = len(features)
        covariances = np.zeros((n, n, self._n_outputs))
        for rows, posterior in self._parts(codes):
            relative = posterior.covariances(features[rows])
            relative[np.diag_indices_from(relative)] += float(include_noise)
            block = _times(relative, posterior.noise_variance)
            covariances[np.ix_(rows, rows)] = block
        return self._join(covariances)


def _times(relative, noise_variance):
    """Products of both, one more axis; zero stays so where the other is infinite."""
    relative = relative[..., None]
    products = np.zeros((*relative.shape[:-1], len(noise_variance)))
    return np.multiply(relative, noise_variance, out=products, where=relative != 0.0)
