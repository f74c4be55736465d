"""Training data as the estimators learn from them: sorted, scaled, one output each."""

from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import RBF

from skmtgp._data.checks import deviation_of, largest_of
from skmtgp._data.dask import held
from skmtgp._data.labels import sorted_tasks
from skmtgp._numerics.linalg import RESOLVED
from skmtgp.learning.problem import Data, Settings

AS_THEY_ARE = slice(None)


def default_kernel(features):
    """A squared exponential scaled to the features.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        Training inputs.

    Returns
    -------
    kernel : RBF
        Length-scales start at the square root of n_features times the standard
        deviation of their feature, between a hundredth and a thousand times that.
    """
    deviation, rounding = deviation_of(features), RESOLVED * largest_of(features)
    scale = np.where(deviation > rounding, deviation, 1.0) * np.sqrt(features.shape[1])
    return RBF(scale, np.outer(scale, [1e-2, 1e3]))


class Training(NamedTuple):
    """Training data, checked.

    The rows may be in Dask arrays.

    Attributes
    ----------
    features : ndarray of shape (n_samples, n_features - 1)
        X without the task column.
    codes : ndarray of shape (n_samples,)
        Position in `tasks` of each row's task.
    tasks : ndarray of shape (n_tasks,)
        Labels.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.
    y_mean, y_scale : ndarray of shape (n_outputs,)
        Y is taken off this mean and divided by this scale.
    single_output : bool
        Whether y was one-dimensional.
    """

    features: np.ndarray
    codes: np.ndarray
    tasks: np.ndarray
    Y: np.ndarray
    y_mean: np.ndarray
    y_scale: np.ndarray
    single_output: bool

    def order(self, inference):
        """The rows as inference takes them: sorted by task, or all as they are."""
        if inference == "sparse":
            return AS_THEY_ARE
        return np.argsort(self.codes, kind="stable")

    def data(self, inference):
        """The data of each output, scaled."""
        order, complete = self.order(inference), inference == "kronecker"
        X, tasks, Y = self.features, self.codes, (self.Y - self.y_mean) / self.y_scale
        if order is not AS_THEY_ARE:  # views of X would be pickled beside it
            X, tasks, Y = X[order], tasks[order], Y[order]
        n_tasks = len(self.tasks)
        return [Data(X, tasks, held(y), n_tasks, complete) for y in Y.T]

    def pairs(
        self, kernel, noise_variance, noise_bounds, n_noise, inference, **options
    ):
        """The data and the settings of each output."""
        n_outputs = self.Y.shape[1]
        for j, data in enumerate(self.data(inference), start=1):
            scale = float(data.y.std()) or 1.0
            fixed = isinstance(noise_bounds, str)
            bounds = (noise_variance,) * 2 if fixed else noise_bounds
            settings = Settings(
                kernel=kernel,
                scale=float(np.sqrt(np.square(data.y).mean())) or 1.0,
                log_noise=np.full(n_noise, np.log(noise_variance * scale**2)),
                log_noise_bounds=tuple(np.log(np.multiply(bounds, scale**2))),
                name=f"output {j} of {n_outputs}" if n_outputs > 1 else "the output",
                inference=inference,
                **options,
            )
            yield data, settings

    def with_task(self, features, label, Y):
        """The data of one more task put below the others'.

        Parameters
        ----------
        features : ndarray of shape (n_new, n_features - 1)
            Its inputs.
        label : str, int or bool
            Its label.
        Y : ndarray of shape (n_new, n_outputs)
            Its targets.

        Returns
        -------
        training : Training
            The same mean and scale of the targets.
        position : int
            Where the task is among the tasks.
        """
        tasks = sorted_tasks([*self.tasks.tolist(), label])
        position = tasks.tolist().index(label)
        codes = self.codes + (self.codes >= position)
        training = self._replace(
            features=np.vstack([self.features, features]),
            codes=np.append(codes, np.full(len(features), position)),
            tasks=tasks,
            Y=np.vstack([self.Y, Y]),
        )
        return training, position
