"""Bayesian linear regression, which the paper begins its comparison with."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit
from scipy.stats import t as student_t

from skmtgp._data.checks import check_training
from skmtgp._data.labels import rows_by_code
from skmtgp._estimators.estimator import Estimator, fitting
from skmtgp._estimators.predicting import PosteriorMixin
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.sklearn_compat import Interval, fit_context, with_callbacks
from skmtgp.inference.linear import LinearPosterior

__all__ = ["BayesianLinearRegression"]


class BayesianLinearRegression(PosteriorMixin, Estimator):
    r"""Separate Bayesian linear regression for each task, LR.

    For each task and output, with the covariates x and the constant 1 in the rows of D,
    the model is

    .. math::
        y \sim \mathcal N(D \beta, \sigma^2 I), \qquad
        p(\beta, \sigma^2) = \mathcal N(\beta \mid 0, \sigma^2 v I)\,
        \mathcal{IG}(\sigma^2 \mid a_0, b_0)

    The parameters of the prior are given, not learned. Nothing is scaled, so the prior
    is in the units of X and y.

    Parameters
    ----------
    pooled : bool, default=False
        Whether to learn one regression from the samples of all tasks, instead of one
        for each task.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels, which are integers or
        strings.
    fit_intercept : bool, default=True
        Whether to add a constant to the covariates. Its weight has the same prior.
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
        Posterior mean of the weights, in units of y per unit of the feature. All rows
        are equal if `pooled`.
    intercept_ : ndarray of shape ([n_outputs,] n_tasks)
        Posterior mean of the constant's weight, in units of y. 0 without
        `fit_intercept`.
    noise_variance_ : ndarray of shape ([n_outputs,] n_tasks)
        Posterior mean of the noise variance, in squared units of y. It is infinite if
        `degrees_of_freedom_` is 2 or less.
    degrees_of_freedom_ : ndarray of shape (n_tasks,)
        Degrees of freedom of the Student-t predictions: 2 `noise_shape` plus the number
        of samples of the regression.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over regressions and outputs. The
        weights and the noise variances are integrated out.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    SingleTaskGP : A Gaussian process for each task.
    PooledGP : A Gaussian process for the samples of all tasks.
    sklearn.linear_model.BayesianRidge : Learns the parameters of its prior.

    Notes
    -----
    Section 6 of [1]_ has this model for each context and each joint, with covariates
    :math:`(x, \mathrm{sgn}(\dot q), 1)`. Its prior is the default here: :math:`v =
    10^8` and :math:`a_0 = b_0 = 1`. The posterior has the form of the prior (section
    7.6.3 of [2]_). After n samples

    .. math::
        V_n^{-1} &= D^T D + v^{-1} I, & \beta_n &= V_n D^T y, \\
        a_n &= a_0 + n / 2, &
        b_n &= b_0 + \tfrac12 (|y - D \beta_n|^2 + v^{-1} |\beta_n|^2).

    Then f at covariates x has a Student-t distribution with :math:`2 a_n` degrees of
    freedom, mean :math:`x^T \beta_n` and squared scale :math:`x^T V_n x\, b_n / a_n`.
    For an observation, 1 is added to :math:`x^T V_n x`. `predict` returns its standard
    deviation, the scale times :math:`\sqrt{a_n / (a_n - 1)}`. It is infinite if
    :math:`a_n \le 1`: for a task with one sample and an :math:`a_0` of 0.5 or less.
    Predictions by different regressions have no covariance. Each draw has its own
    weights and noise variance for each regression and output, so its values lie on a
    plane. The mean depends neither on :math:`a_0` nor on :math:`b_0`. The evidence is

    .. math::
        \log p(y) = \log\frac{\Gamma(a_n)\, b_0^{a_0}}{\Gamma(a_0)\, b_n^{a_n}}
        + \tfrac12 \log\frac{|V_n|}{v^p} - \tfrac n2 \log 2\pi

    for p covariates. A QR decomposition of D, with the square root of the prior's
    precision below it, gives all of this. So covariates may be constant or collinear,
    and there may be more of them than samples. Time is linear in the number of samples.

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

    @with_callbacks
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
        TypeError
            If X is sparse, or if a label, a feature or a target has a type that cannot
            be used, such as a label that is a tuple.
        ValueError
            If a parameter, a feature, a label or a target cannot be used. The estimator
            is then as it was before.
        """
        with fitting(self, X, y):
            training = check_training(self, X, y)
            with limit_threads(self._side):
                self._fit(*training)
        return self

    def _fit(self, features, codes, tasks, y):
        self.tasks_, n_tasks = tasks, len(tasks)
        self._single_output, Y = y.ndim == 1, y.reshape(len(y), -1)
        self._regressions = np.arange(n_tasks)  # which of them a task has
        if self.pooled:
            self._regressions = np.zeros(n_tasks, dtype=int)
        self._posterior = LinearPosterior(
            features,
            Y,
            self._regressions[codes],
            has_intercept=self.fit_intercept,
            weight_variance=self.weight_variance,
            noise_shape=self.noise_shape,
            noise_rate=self.noise_rate,
        )
        self._store(self._posterior)

    def _store(self, posterior):
        """Set the fitted attributes."""
        self.coef_ = self._outputs_first(posterior.coef)
        self.intercept_ = self._outputs_first(posterior.intercept)
        self.noise_variance_ = self._outputs_first(posterior.noise_variance)
        self.degrees_of_freedom_ = 2.0 * posterior.shape[self._regressions]
        self.log_marginal_likelihoods_ = posterior.log_evidence.sum(axis=0)
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )

    def _outputs_first(self, values):
        """What each task has of its regression, without an axis for a single output."""
        values = np.moveaxis(values[self._regressions], -1, 0)
        return np.ascontiguousarray(values)[0 if self._single_output else ...]

    @property
    def _side(self):
        return self.n_features_in_

    @property
    def _n_outputs(self):
        return len(self.log_marginal_likelihoods_)

    def _means(self, features, codes):
        with limit_threads(self._side):
            return self._posterior.mean(features, self._regressions[codes])

    def _variances(self, features, codes, include_noise):
        which, posterior = self._regressions[codes], self._posterior
        relative = posterior.variances(features, which) + float(include_noise)
        return _times(relative, posterior.noise_variance[which])

    def _covariances(self, features, codes, include_noise):
        n, which, posterior = len(features), self._regressions[codes], self._posterior
        covariances = np.zeros((n, n, self._n_outputs))
        noise_variance = posterior.noise_variance
        for some, rows, relative in posterior.covariances(features, which):
            relative += float(include_noise) * np.eye(rows.shape[1])
            blocks = _times(relative, noise_variance[some, None, None])
            covariances[rows[:, :, None], rows[:, None, :]] = blocks
        return covariances

    def _known_noise(self, alpha, X, y, n, include_noise=True):
        if alpha is not None:
            raise ValueError(
                "A BayesianLinearRegression takes no alpha: it integrates the noise "
                "variance out, and Student's t has no place for noise that is known. "
                "SingleTaskGP(kernel='linear') takes alpha, in fit too."
            )
        return 0.0

    def _quantiles(self, features, codes, probabilities, include_noise, known):
        degrees, means, scale = self._student(features, codes, include_noise)
        return [means + scale * stdtrit(degrees, p) for p in probabilities]

    def _log_density(self, features, codes, values, known):
        degrees, means, scale = self._student(features, codes, include_noise=True)
        return student_t.logpdf(values, degrees, means, scale)

    def _student(self, features, codes, include_noise):
        """Degrees of freedom, means and scales: noise variances are integrated out."""
        which, posterior = self._regressions[codes], self._posterior
        shape = posterior.shape[which][:, None]
        relative = posterior.variances(features, which) + float(include_noise)
        scale = np.sqrt(relative[:, None] * posterior.rate[which] / shape)
        return 2.0 * shape, self._means(features, codes), scale

    def _draws(self, features, codes, n_draws, rng):
        draws, noise_std = np.empty((2, len(features), self._n_outputs, n_draws))
        for r, rows in zip(*rows_by_code(self._regressions[codes]), strict=True):
            of_rows = self._posterior.draw(r, features[rows], n_draws, rng)
            draws[rows], noise_std[rows] = of_rows
        return draws, noise_std


def _times(relative, noise_variance):
    """Products of both, one more axis; zero stays so where the other is infinite."""
    relative = relative[..., None]
    shape = np.broadcast_shapes(relative.shape, noise_variance.shape)
    products = np.zeros(shape)
    return np.multiply(relative, noise_variance, out=products, where=relative != 0.0)
