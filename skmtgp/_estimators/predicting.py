"""What all estimators share: predictions from the posterior."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import RegressorMixin
from sklearn.utils import check_random_state, check_scalar
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_observed, check_test
from skmtgp._data.known import read_known, refuse_orders
from skmtgp._estimators.estimator import steady
from skmtgp._estimators.targets import AS_GIVEN
from skmtgp._numerics.linalg import draw_normal
from skmtgp._numerics.memory import check_available
from skmtgp._numerics.mixtures import log_density, quantiles
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.followers import as_it_is

MANY = 1000  # rows of one output: nobody asks whether fewer have enough memory
BESIDE = 6  # matrices between rows that come and go beside those of the outputs
JOINTLY = (
    "sample_y",
    "Draw fewer rows at a time. Only rows of one call are drawn jointly: where that "
    "does not matter, take predict(X, return_std=True).",
)
OF_DRAWS = 4  # arrays of draws that there are at the same time


class PosteriorMixin(RegressorMixin):
    """Regressor with a task column whose predictions have a covariance.

    What `_model` returns has `task_feature`, `tasks_`, `_single_output`, `_n_outputs`,
    `_side`, rows of the largest matrices that predictions are made with, `_target`, the
    way from what is learned to y, and, in units of the former,

    - ``_means(features, codes)``, of shape (n_samples, n_outputs);
    - ``_variances(features, codes, include_noise)``, of the same shape;
    - ``_covariances(features, codes, include_noise)``, of shape (n_samples, n_samples,
      n_outputs);
    - ``_draws(features, codes, n_draws, rng)``, of f, of shape (n_samples, n_outputs,
      n_draws), and the standard deviations of the noise around them, which broadcast
      to that shape. They come from `_means`, `_covariances` and ``_noise(codes)``, the
      noise variances of shape (n_samples, n_outputs), where the posterior is normal.
    """

    _target = AS_GIVEN

    def _model(self):
        """The estimator that holds the posterior."""
        return self

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
        return_std: Literal[True],
        return_cov: bool = False,
        include_noise: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def predict(
        self,
        X: ArrayLike,
        return_std: Literal[False] = False,
        return_cov: Literal[True] = ...,
        include_noise: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def predict(
        self,
        X: ArrayLike,
        return_std: bool = False,
        return_cov: bool = False,
        include_noise: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @steady
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
            Whether to return the standard deviation of each prediction, too.
        return_cov : bool, default=False
            Whether to return the covariance of the predictions of an output, too.
        include_noise : bool, default=False
            Whether the uncertainty is that of a new observation, f plus noise, rather
            than that of f. The noise is the learned one, even if `fit` had an `alpha`:
            if new rows have such noise, too, their deviation is
            ``np.sqrt(y_std**2 + alpha)``.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Predictive mean, in units of y. With `target_transform` it is the median.
        y_std : ndarray of the shape of y_mean
            Predictive standard deviation. Only if `return_std`.
        y_cov : ndarray of shape (n_samples, n_samples[, n_outputs])
            Predictive covariance. Only if `return_cov`.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If a task was not seen in fit and cannot be predicted. If both `return_std`
            and `return_cov` are set. If `return_cov` is set with a `target_transform`,
            or its inverse overflows.
        InsufficientMemoryError
            If `return_cov` is set and there is no memory for matrices between all rows.

        Notes
        -----
        Tasks that `fit` has not seen can be predicted by a PooledGP. A
        MultiTaskGPRegressor predicts them, if ``shared=True`` was set before fit, as
        draws from the population of the known tasks, and with `task_descriptors` by
        their descriptors. This needs `normalize_y_` other than "per_task", no levels
        that are hundreds of deviations apart, and no `trend_per_task`. A draw from the
        population has the mean of the known tasks' rows of the factor of
        `task_covariance_`. The uncertainty includes what these differ by, the variance
        of the levels, and the average of the diagonal if there is one.
        Known tasks have the descriptors of `fit`. If tasks have their own noise, a new
        one has the geometric mean of the noise variances, each counted as often as its
        task has rows.

        With `target_transform` the prediction is the inverse transform of the learned
        mean, as in scikit-learn's TransformedTargetRegressor. This is the median of f
        and of observations, not the mean. With sampled hyperparameters it is
        approximately the median. The standard deviation is that of f or of an
        observation in units of y, by quadrature. See :doc:`/guide/intervals`.
        """
        if return_std and return_cov:
            raise ValueError("Set return_std or return_cov, not both.")
        check_is_fitted(self)
        model = as_it_is(self._model())
        features, codes = check_test(model, X, unseen=model._knows_unseen())
        target, rows = model._target, (model, features, codes)
        if return_cov:
            check_joint(
                model,
                len(features),
                "predict(return_cov=True)",
                "Predict fewer rows at a time, or set return_std=True instead.",
            )
        mean = model._join(target.back(model._means(features, codes)))
        if return_std:
            with limit_threads(model._side):
                variances = target.variances(*rows, include_noise)
            return mean, model._join(np.sqrt(variances))
        if return_cov:
            with limit_threads(max(model._side, len(features))):
                covariances = target.covariances(*rows, include_noise)
            return mean, model._join(covariances)
        return mean

    @steady
    def predict_interval(
        self,
        X: ArrayLike,
        level: float = 0.95,
        include_noise: bool = True,
        *,
        alpha: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict the central interval that contains an observation, or f.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        level : float, default=0.95
            Probability of the interval. Equal probabilities lie below and above it. 0
            gives the median twice.
        include_noise : bool, default=True
            Whether the interval is that of a new observation, f plus noise, rather than
            that of f. The noise is the learned one, and `alpha` if you give it here:
            that of `fit` is not in new rows.
        alpha : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Known noise variance of each new observation, in squared units of y. It is
            added to the learned one, as in `fit`. A single number holds for all. None
            is 0, even if `fit` had an alpha: the interval is then too narrow for
            measurements like those. A BayesianLinearRegression takes none.

        Returns
        -------
        lower, upper : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Ends of the interval, in units of y.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If `level` is not in [0, 1), or if a task was not seen in fit and cannot be
            predicted, see `predict`. If `alpha` cannot be used, or is given without
            `include_noise`, or with a `target_transform`.

        Notes
        -----
        The ends are quantiles of the predictive distribution. It is normal, a mixture
        of normal distributions if hyperparameters are sampled, or Student's t for a
        BayesianLinearRegression. The inverse of `target_transform` is monotone, so it
        maps the ends to units of y. :doc:`/guide/intervals` says when intervals are
        right.
        """
        check_level(level)
        check_is_fitted(self)
        model = as_it_is(self._model())
        features, codes = check_test(model, X, unseen=model._knows_unseen())
        known = model._known_noise(alpha, X, None, len(features), include_noise)
        tails = 0.5 - 0.5 * level, 0.5 + 0.5 * level
        with limit_threads(model._side):
            ends = model._quantiles(features, codes, tails, include_noise, known)
        ends = np.sort(model._target.back(np.stack(ends)), axis=0)  # it may fall
        lower, upper = map(model._join, ends)
        return lower, upper

    @steady
    def log_predictive_density(
        self, X: ArrayLike, y: ArrayLike, *, alpha: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Return the log density of new observations, each by itself.

        The predictive distribution is that of `predict_interval`. Its log density tells
        how well rows fit to what was learned: low values are rows that the model did
        not expect. Their mean, with its sign changed, is the log loss.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Observations, in the form of the targets of `fit`.
        alpha : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Known noise variance of each observation, see `predict_interval`.

        Returns
        -------
        log_density : ndarray of the shape of y
            Natural logarithm of the density in units of y, f and noise together.

        Raises
        ------
        TypeError
            If X or y is a Dask collection.
        ValueError
            If y or `alpha` cannot be used, or if a task was not seen in fit and cannot
            be predicted, see `predict`.

        Notes
        -----
        The density is normal, a mixture of normal densities if hyperparameters are
        sampled, or Student's t for a BayesianLinearRegression. With `target_transform`
        it is multiplied by the slope of the transform. It is then -inf for values that
        the model cannot predict, such as 0 of a logarithm. It is inf for a value in
        which the inverse ends, such as 0 of a root: this has a probability of its own.

        Examples
        --------
        Do the measurements of today fit? One of them does not:

        >>> import numpy as np
        >>> from skmtgp import IndependentGP
        >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat([0, 1], 20)
        >>> noise = 0.1 * np.random.default_rng(0).standard_normal(40)
        >>> model = IndependentGP().fit(np.column_stack([x, task]), np.sin(x) + noise)
        >>> X_today = [[1.0, 0], [2.0, 0], [3.0, 1]]
        >>> y_today = [0.9, 0.2, 0.2]
        >>> model.log_predictive_density(X_today, y_today) > -5
        array([ True, False,  True])
        """
        check_is_fitted(self)
        model = as_it_is(self._model())
        features, codes = check_test(model, X, unseen=model._knows_unseen())
        shape = () if model._single_output else (model._n_outputs,)
        Y = check_observed(model, X, y, shape)
        known = model._known_noise(alpha, X, y, len(Y))
        Z, log_slopes = model._target.with_slopes(Y)
        with limit_threads(model._side):
            found = model._log_density(features, codes, Z, known)
        return model._join(found + log_slopes)

    @steady
    def sample_y(
        self,
        X: ArrayLike,
        n_samples: int = 1,
        random_state: np.random.RandomState | int | None = 0,
        include_noise: bool = False,
    ) -> NDArray[np.float64]:
        """Draw f, or new observations, from the posterior.

        Parameters
        ----------
        X : array-like of shape (n_samples_X, n_features)
            Inputs, with the task labels in column `task_feature`.
        n_samples : int, default=1
            Number of draws.
        random_state : int, RandomState instance or None, default=0
            Source of randomness.
        include_noise : bool, default=False
            Whether to draw new observations: the same draws of f, plus noise.

        Returns
        -------
        y_samples : ndarray of shape (n_samples_X[, n_outputs], n_samples)
            Draws, in units of y.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If a task was not seen in fit and cannot be predicted, see `predict`.
        InsufficientMemoryError
            If there is no memory for matrices between all rows, or for the draws.

        Notes
        -----
        Draws come from a Cholesky factor of the covariance of all rows. For that 1e-12
        of each variance is added to it, or up to 1e-7 where less is not enough. Draws
        have that much noise of their own, at most a 3000th of the standard deviation.
        If that is not enough, they come from eigenvectors, which take many times as
        long.
        """
        check_scalar(n_samples, "n_samples", Integral, min_val=0)
        rng = check_random_state(random_state)
        check_is_fitted(self)
        model = as_it_is(self._model())
        features, codes = check_test(model, X, unseen=model._knows_unseen())
        _check_draws(len(features), model._n_outputs, n_samples)
        with limit_threads(max(model._side, len(features))):
            draws, noise_std = model._draws(features, codes, n_samples, rng)
        if include_noise:
            draws += noise_std * rng.standard_normal(draws.shape)
        draws = model._target.back(draws.swapaxes(1, 2)).swapaxes(1, 2)
        return draws[:, 0] if model._single_output else draws

    def _draws(self, features, codes, n_draws, rng):
        """Draws of f and the standard deviations of the noise around them."""
        check_joint(self, len(features), *JOINTLY)
        means = self._means(features, codes)
        covariances = self._covariances(features, codes, include_noise=False)
        outputs = zip(means.T, np.moveaxis(covariances, 2, 0), strict=True)
        with limit_threads(len(features)):
            draws = [draw_normal(*moments, n_draws, rng) for moments in outputs]
        return np.stack(draws, axis=1), np.sqrt(self._noise(codes))[..., None]

    def _known_noise(self, alpha, X, y, n, include_noise=True):
        """Known noise variances of new rows, (n_samples, n_outputs); 0 without any."""
        if alpha is None:
            return 0.0
        if not include_noise:
            raise ValueError(
                "alpha is the noise of new observations, and include_noise=False asks "
                "for f, which has none. Leave one of them out."
            )
        refuse_orders(X, y, (alpha, None, None))
        known = read_known(alpha, None, None, (n, self._n_outputs))
        known.refuse_transform(getattr(self, "target_transformer_", None))
        return known.variance

    def _quantiles(self, features, codes, probabilities, include_noise, known):
        """Quantiles of f or of observations, of shape (n_samples, n_outputs) each."""
        means, variances = self._components(features, codes, include_noise)
        deviations = np.sqrt(variances + known)
        return [quantiles(means, deviations, p) for p in probabilities]

    def _log_density(self, features, codes, values, known):
        """That of observations of what is learned, of shape (n_samples, n_outputs)."""
        means, variances = self._components(features, codes, include_noise=True)
        return log_density(means, np.sqrt(variances + known), values)

    def _components(self, features, codes, include_noise):
        """Means and variances of the normals that are mixed, (1, n_samples, ...)."""
        means = self._means(features, codes)
        return means[None], self._variances(features, codes, include_noise)[None]

    def _store_target(self, target):
        """Keep the way back to y, of transformed targets; others need none."""
        for name in ("_target", "target_transformer_"):
            vars(self).pop(name, None)
        if target is not AS_GIVEN:
            fitted = [column.transformer for column in target.columns]
            self.target_transformer_ = fitted[0] if self._single_output else fitted
            self._target = target

    def _knows_unseen(self):
        """Whether it can predict a task that it never saw."""
        return False

    def _join(self, values):
        """Without the axis of the outputs where y was one-dimensional."""
        return values[..., 0] if self._single_output else values

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.categorical = True
        tags.target_tags.multi_output = True
        return tags


def check_joint(model, n, what, advice, at_once=None):
    """Raise an InsufficientMemoryError where n rows cannot have covariances.

    Those of as many outputs are held `at_once`, of all by default.
    """
    n_matrices = (at_once or model._n_outputs) + BESIDE
    if n**2 * n_matrices > MANY**2 * (1 + BESIDE):
        n_columns = n * n_matrices + 2 * model._side
        check_available(8.0 * n * n_columns, f"{what} of {n} rows", advice)


def _check_draws(n, n_outputs, n_draws):
    """The same of draws, also of models that draw without covariances."""
    size = n * n_outputs * n_draws
    if size > MANY**2:
        what = f"sample_y of {n} rows with n_samples={n_draws}"
        advice = "Take fewer draws at a time, with another random_state for each time."
        check_available(8.0 * OF_DRAWS * size, what, advice)


def check_level(level):
    """Raise a ValueError where it is not one probability."""
    is_number = isinstance(level, Real) or getattr(level, "shape", None) == ()
    if not is_number or not 0.0 <= level < 1.0:
        raise ValueError(f"level={level!r} must be one number in [0, 1), such as 0.95.")
