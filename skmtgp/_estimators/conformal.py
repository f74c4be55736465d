"""Intervals whose width is that of errors of left-out rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_test
from skmtgp._data.labels import name_tasks, rows_by_code
from skmtgp._estimators.estimator import steady
from skmtgp._estimators.predicting import PosteriorMixin, check_level
from skmtgp._numerics.mixtures import as_one
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.followers import as_it_is

ROUNDING = 1e-9  # of numbers of rows: 0.95 * 20 rows are 19


class ConformalMixin(PosteriorMixin):
    """Regressor that predicts its training samples from the others without a fit.

    What `_model` returns has `tasks_train_`, `_errors_left_out` and `_factors`, too.
    """

    @steady
    def conformal_interval(
        self,
        X: ArrayLike,
        level: float = 0.95,
        *,
        by_task: bool = False,
        alpha: ArrayLike | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        r"""Predict an interval that is as wide as errors of left-out samples.

        The interval of `predict_interval` is as wide as the model says. This one is
        scaled so that it holds the training samples, each predicted from all others.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        level : float, default=0.95
            Share of new observations that intervals are to contain.
        by_task : bool, default=False
            Whether each task's intervals are scaled by its own errors, rather than by
            those of all tasks. Take it where noise differs more than the model knows.
            Each task then needs ``level / (1 - level)`` samples, 19 for 95 %.
        alpha : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Known noise variance of each new observation, see `predict_interval`.

        Returns
        -------
        lower, upper : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Ends of the interval, in units of y.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        TypeError
            If X is a Dask collection.
        ValueError
            If `level` is not in [0, 1), or if there are too few samples for it. If a
            task was not seen in fit and cannot be predicted, see `predict`, or if it
            was not and `by_task` is set. If `alpha` cannot be used, or is given with a
            `target_transform`, or if the inverse of that overflows. If the model was
            fitted to Dask collections, whose rows it does not keep.

        Warns
        -----
        NegativeVarianceWarning
            If a variance is negative, by more than rounding explains.

        Notes
        -----
        With the mean :math:`\mu_i` and the deviation :math:`\sigma_i` of an observation
        given all others, from :meth:`loo_predict`, each of n samples has the error
        :math:`|y_i - \mu_i| / \sigma_i`. Let q be the :math:`\lceil level (n + 1)
        \rceil`-th smallest of these. The interval is :math:`\mu \pm q \sigma` at each
        new input, without `variance_factor_`. With `target_transform` all this is about
        the transformed targets, and the ends are transformed back. A task of one sample
        is not counted if its mean was subtracted from it.

        The hyperparameters were learned from the samples, too. So these errors are too
        small where samples are few. Below 20 samples for each hyperparameter each is
        therefore what it would be without that: to first order in what the sample moves
        the mode, with its leverage. Drawn hyperparameters count by what they are
        likely without the sample instead. Of several kernels the errors stay.

        This is the jackknife with standardised errors, for exchangeable samples.
        Unlike the jackknife+, which needs all fits, it has no proven coverage. It is
        right if predictions hardly change with one sample less. The errors are of known
        tasks, and say nothing about how an unseen task differs: for such a task take
        `predict_interval`.

        Every call leaves out all samples. With few samples for each hyperparameter this
        takes two gradients of the likelihood for each and up to 33 posteriors, which is
        less than a fit. So ask for all rows at once.

        References
        ----------
        Barber, Candès, Ramdas and Tibshirani (2021), "Predictive inference with the
        jackknife+", Annals of Statistics 49(1). Gelfand, Dey and Chang (1992), "Model
        determination using predictive distributions", Bayesian Statistics 4, for draws.

        Examples
        --------
        The noise has heavy tails, so that the model's intervals for half of the
        observations are too wide:

        >>> import numpy as np
        >>> from skmtgp import IndependentGP
        >>> rng = np.random.default_rng(0)
        >>> def draw(n):
        ...     x, task = rng.uniform(0, 6, n), rng.integers(2, size=n)
        ...     y = np.sin(x + task) + 0.1 * rng.standard_t(2, n)
        ...     return np.column_stack([x, task]), y
        >>> (X, y), (X_new, y_new) = draw(200), draw(1000)
        >>> def held(lower, upper):
        ...     return round(float(np.mean((lower <= y_new) & (y_new <= upper))), 2)
        >>> model = IndependentGP().fit(X, y)
        >>> held(*model.predict_interval(X_new, 0.5))
        0.58
        >>> held(*model.conformal_interval(X_new, 0.5))
        0.47
        """
        check_level(level)
        check_is_fitted(self)
        model = as_it_is(self._model())
        unseen = model._knows_unseen() and not by_task
        features, codes = check_test(model, X, unseen=unseen)
        known = model._known_noise(alpha, X, None, len(features))
        widths = _widths(model, codes, level, by_task)
        with limit_threads(model._side):
            found = model._components(features, codes, include_noise=True)
        mean, variance = as_one(*found, 1.0)
        variance /= model._factors(codes)  # errors have been divided by what is without
        half = widths * np.sqrt(variance + known)
        ends = np.stack([mean - half, mean + half])
        lower, upper = np.sort(model._target.back(ends), axis=0)  # it may fall
        return model._join(lower), model._join(upper)

    def _errors_left_out(self):
        """Errors of training samples given the others, in standard deviations.

        They have the shape (n_samples, n_outputs). Of a task's only sample, which is
        the task's mean, it is 0 and says nothing: it is NaN.
        """
        mean, variance = as_one(*self._left_out(include_noise=True))
        residuals = self.y_train_.reshape(mean.shape) - mean
        errors = (residuals + self._relearned()) / np.sqrt(variance)
        if self._units.own_centres:
            alone = np.bincount(self.tasks_train_) == 1
            errors[alone[self.tasks_train_]] = np.nan
        return errors


def _widths(model, codes, level, by_task):
    """Half widths of the intervals of these tasks, in standard deviations."""
    errors = np.abs(model._errors_left_out())
    if not by_task:
        return _quantile(errors, level, "")
    widths = np.empty((len(codes), errors.shape[1]))
    train = dict(zip(*rows_by_code(model.tasks_train_), strict=True))
    for m, rows in zip(*rows_by_code(codes), strict=True):
        task = f" of {name_tasks(model.tasks_[[m]])}"
        widths[rows] = _quantile(errors[train[m]], level, task)
    return widths


def _quantile(errors, level, of_task):
    """The error that a share of `level` of n + 1 samples has at most, (n_outputs,)."""
    n = np.count_nonzero(~np.isnan(errors[:, 0]))
    rank = int(np.ceil(level * (n + 1) - ROUNDING))
    if rank > n:
        least = int(np.ceil(level / (1.0 - level) - ROUNDING))
        advice = "a lower level, or by_task=False" if of_task else "a lower level"
        raise ValueError(
            f"level={level} needs {least} left-out samples{of_task}, and there are "
            f"{n}. Give {advice}, or take predict_interval."
        )
    return np.sort(errors, axis=0)[rank - 1] if rank else np.zeros(errors.shape[1])
