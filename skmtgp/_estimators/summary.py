"""What was learned of each task, as frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from skmtgp._estimators.estimator import steady
from skmtgp._numerics.linalg import correlation


class SummaryMixin:
    """Tables of a fitted model: the tasks, and how they are related."""

    @property
    def task_correlation_(self) -> pd.DataFrame:
        """Correlations of the tasks' functions, without their levels.

        They are the correlations of `task_covariance_`, with the task labels as index
        and columns. With several outputs ``task_correlation_.loc[j]`` is that of output
        j, with several terms ``task_correlation_.loc[q]`` is that of term q, and with
        both ``task_correlation_.loc[(j, q)]``.

        At rank 0 they follow from the form of the model, and are no estimate for a
        pair: 0 of independent tasks, 1 of one function of all tasks, and one number
        for all pairs by compound symmetry. If tasks have functions of their own,
        correlate the predicted curves instead, by `np.corrcoef` of `predict` at the
        same inputs for each task. Or give a `rank` of 2 or more.
        """
        check_is_fitted(self)
        n_outputs, n_tasks = len(self._posteriors), len(self.tasks_)
        of_outputs = np.reshape(
            self.task_covariance_, (n_outputs, -1, n_tasks, n_tasks)
        )
        return self._by_output([self._of_terms(of) for of in of_outputs])

    def _of_terms(self, K_rhos):
        """Correlations of each term, one below the other if there are several."""
        frames = [self._frame(correlation(K), self._tasks()) for K in K_rhos]
        if len(frames) == 1:
            return frames[0]
        return pd.concat(dict(enumerate(frames)), names=["term"])

    @property
    def task_descriptors_(self) -> pd.DataFrame:
        """Descriptors of the tasks, with their labels as index.

        It exists only after a fit with `task_descriptors`.
        """
        descriptors = getattr(self, "_descriptors", None)
        if descriptors is None:  # a frame cannot be kept by skops
            raise AttributeError(
                f"{type(self).__name__!r} object has no attribute 'task_descriptors_': "
                "it was not fitted with task_descriptors"
            )
        return self._frame(descriptors.table, descriptors.names)

    @steady
    def summary(self) -> pd.DataFrame:
        """Return what was learned of each task, as a table in units of y.

        With `target_transform` the table is in units of the transformed targets.

        Returns
        -------
        summary : DataFrame of n_tasks rows
            The task labels are the index. With several outputs the tables follow each
            other, and ``summary().loc[j]`` is that of output j. The columns are

            - rows: number of samples;
            - level: `y_mean_` plus the level of the task, `task_level_`;
            - level_std: its standard deviation given the data;
            - noise_std: standard deviation of the noise;
            - explained: share of the variance of the task's targets that the model
              explains when they are left out, 1 minus the nMSE of `loo_predict`. Below
              0 the mean of the task would be better. NaN if the targets do not vary, or
              for Dask collections;
            - closest: the task with the largest absolute correlation with this task,
              the first one of equals. None if no task has any correlation with it;
            - correlation: that correlation, see `task_correlation_`.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Notes
        -----
        With rank 1 and no functions of each task's own every correlation is -1 or 1,
        whatever the rows say. At rank 0 the form of the model fixes them, too, see
        `task_correlation_`: "closest" says nothing then.
        :class:`~skmtgp.inspection.TransferDisplay` says whether a task gains from the
        others.

        Where functions are smooth over all inputs, they can hold what the tasks differ
        by, and the learned variance of the levels is then almost 0: all tasks have the
        same level, with a small deviation. To compare tasks, predict all of them at the
        same inputs.

        The column "explained" needs `loo_predict`, which takes about a third of a
        decomposition of the covariance of all samples for each output.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import MultiTaskGPRegressor
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 6, 60), np.repeat([0, 1, 2], 20)
        >>> y = 5 * task + np.array([1, -2, 0.5])[task] * np.sin(x)
        >>> y += 0.1 * rng.standard_normal(60)
        >>> model = MultiTaskGPRegressor(rank=1).fit(np.column_stack([x, task]), y)
        >>> model.summary()[["rows", "level", "noise_std", "closest"]].round(1)
              rows  level  noise_std closest
        task
        0       20    0.0        0.1       1
        1       20    5.0        0.1       0
        2       20   10.0        0.1       0
        """
        check_is_fitted(self)
        n_tasks = len(self.tasks_)
        columns = {
            "level": np.reshape(self.task_level_, (-1, n_tasks)),
            "level_std": np.reshape(self.task_level_std_, (-1, n_tasks)),
            "noise_std": np.sqrt(self._noises_learned(np.arange(n_tasks)).mean(0)).T,
            "explained": self._explained(),
        }
        frames = []
        for j, R in enumerate(self._related()):
            of_output = {name: values[j] for name, values in columns.items()}
            values = {"rows": self._n_rows, **of_output, **self._closest(R)}
            frames.append(pd.DataFrame(values, index=self._tasks()))
        return self._by_output(frames)

    def _related(self):
        """Correlations of the tasks' functions for each output, of all terms."""
        return [correlation(self._covariance_of_tasks(p)) for p in self._posteriors]

    def _covariance_of_tasks(self, posterior):
        """K^rho; of several terms their sum, each by its usual variance over x."""
        if posterior.K_rho.ndim == 2:
            return posterior.K_rho
        rows = getattr(self, "X_train_", None)  # fits to Dask collections keep none
        rows = self._likelihoods[0].inputs if rows is None else rows
        return sum(K * k.diag(rows).mean() for k, K in posterior.terms)

    def _tasks(self):
        return pd.Index(self.tasks_, name="task")

    def _frame(self, values, columns):
        return pd.DataFrame(values, index=self._tasks(), columns=columns)

    def _by_output(self, frames):
        """One frame, with the outputs as its first index if y had two dimensions."""
        if self._single_output:
            return frames[0]
        return pd.concat(dict(enumerate(frames)), names=["output"])

    def _closest(self, R):
        """The other task of the largest correlation with each, and that."""
        rows, others = np.arange(len(R)), R - np.eye(len(R))
        found = np.abs(others).round(9).argmax(axis=1)  # of equal ones the first
        value = others[rows, found]
        names = np.where(value == 0.0, None, self.tasks_.astype(object)[found])
        return {"closest": names, "correlation": value}

    def _explained(self):
        """One less the nMSE of each task's samples given the others."""
        n_outputs, n_tasks = len(self._posteriors), len(self.tasks_)
        if not hasattr(self, "X_train_"):
            return np.full((n_outputs, n_tasks), np.nan)
        Y = self.y_train_.reshape(-1, n_outputs)
        error = np.square(Y - self._leave_out(include_noise=False)[0])
        error, around = (
            pd.DataFrame(of).groupby(self.tasks_train_) for of in (error, Y)
        )
        variance = around.var(ddof=0).where(around.nunique() > 1)
        return 1.0 - (error.mean() / variance).to_numpy().T
