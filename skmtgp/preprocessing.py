"""Features of inverse dynamics from positions, velocities and accelerations."""

from __future__ import annotations

from numbers import Integral
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import TransformerMixin
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.dask import refuse_dask
from skmtgp._data.labels import FIRST_INEXACT
from skmtgp._data.task_column import locate_task_column, read_table, split_table
from skmtgp._estimators.estimator import Estimator
from skmtgp._support.progress import fitting
from skmtgp._support.sklearn_compat import (
    check_feature_names_in,
    wants_pandas,
    with_callbacks,
)

__all__ = ["InverseDynamicsFeatures"]

STANDSTILL = 1e-9  # rad/s; slower than this a velocity is rounding noise of either sign
BY_PARTITIONS = (
    "Fit the features to rows in memory, X.get_partition(0).compute() say, and map "
    "them over the partitions, X.map_partitions(features.transform, meta=...): a "
    "regressor with inference='sparse' takes what comes of it."
)


class InverseDynamicsFeatures(TransformerMixin, Estimator):
    r"""Standardised state, signs of the velocities and task, from state and task.

    The states x = (q, qd, qdd) of a robot with J joints are scaled to zero mean and
    unit variance on the training data. The signs sgn(qd) of the velocities, which
    Coulomb friction depends on, are added, and the task becomes the last column.

    Parameters
    ----------
    n_joints : int, default=None
        Number of joints J. None takes it from the number of columns, 3 J + 1.
    task_feature : int or str, default=-1
        Position or name of the task column. The other columns are, from left to right,
        positions q1..qJ (rad), velocities qd1..qdJ (rad/s) and accelerations
        qdd1..qddJ (rad/s^2).

    Attributes
    ----------
    n_joints_ : int
        Number of joints J.
    mean_ : ndarray of shape (3 * `n_joints_`,)
        Mean of each column of x in training, in its own units.
    scale_ : ndarray of shape (3 * `n_joints_`,)
        Standard deviation of each column of x in training, in its own units; 1 where
        the column is constant.
    n_features_in_ : int
        Number of columns seen in `fit`, 3 J + 1.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns seen in `fit`, if they had any.

    See Also
    --------
    skmtgp.kernels.inverse_dynamics_kernel : The kernel on these features.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6. A velocity of at most
    1e-9 rad/s counts as standstill, whose sign is 0: a joint at rest otherwise gets the
    sign of a rounding error, and friction with it. Signs are taken of the velocities
    themselves, not of the standardised ones, and are not scaled.

    Examples
    --------
    Two samples of a robot with one joint, which carries loads 1 and 2:

    >>> import numpy as np
    >>> from skmtgp.preprocessing import InverseDynamicsFeatures
    >>> X = np.array([[0.1, -2.0, 5.0, 1], [0.3, 0.0, 9.0, 2]])
    >>> InverseDynamicsFeatures().fit_transform(X)
    array([[-1., -1., -1., -1.,  1.],
           [ 1.,  1.,  1.,  0.,  2.]])
    """

    def __init__(
        self, n_joints: int | None = None, *, task_feature: int | str = -1
    ) -> None:
        self.n_joints = n_joints
        self.task_feature = task_feature

    @with_callbacks
    def fit(self, X: ArrayLike, y: Any = None) -> Self:
        """Learn the mean and the scale of each column of the states.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions (rad), velocities (rad/s), accelerations (rad/s^2) and the task
            (int, str, bool or category).
        y : None
            Ignored.

        Returns
        -------
        self : InverseDynamicsFeatures
            Fitted.

        Raises
        ------
        TypeError
            If `n_joints` or `task_feature` is of another type, or X a Dask collection.
        ValueError
            If X does not have 3 J + 1 columns or no column `task_feature`, if a number
            is missing or infinite, or if a task label is missing or fractional. The
            transformer is then as it was before.
        """
        with fitting(self, X, y):
            self._fit(X)
        return self

    def _fit(self, X):
        refuse_dask("X", X, BY_PARTITIONS)
        table = read_table(self, X, reset=True)
        n_features = self.n_features_in_
        self._task_position = locate_task_column(
            self.task_feature, n_features, getattr(self, "feature_names_in_", None)
        )
        self.n_joints_ = self._count_joints(n_features)
        scaler = StandardScaler().fit(self._split(table)[0])
        self.mean_, self.scale_ = scaler.mean_, scaler.scale_

    def transform(self, X: ArrayLike) -> NDArray[Any] | pd.DataFrame:
        """Standardise the states, add the signs, move the task to the end.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions (rad), velocities (rad/s), accelerations (rad/s^2) and the task.

        Returns
        -------
        features : ndarray or DataFrame of shape (n_samples, 4 * n_joints + 1)
            The 3 J standardised columns, the J signs -1, 0 or 1, and the task. As an
            array, float64 where the labels are numbers, else object. As a frame (after
            ``set_output(transform="pandas")``), with the labels as they were.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If X has other columns than in `fit`, or as for `fit`.
        """
        check_is_fitted(self)
        refuse_dask("X", X, BY_PARTITIONS)
        states, labels = self._split(read_table(self, X, reset=False))
        velocities = states[:, self.n_joints_ : 2 * self.n_joints_]
        signs = np.where(np.abs(velocities) <= STANDSTILL, 0.0, np.sign(velocities))
        features = np.column_stack([(states - self.mean_) / self.scale_, signs])
        if wants_pandas(self):
            return self._to_frame(features, labels, X)
        return np.column_stack([features, _as_column(labels)])

    def get_feature_names_out(
        self, input_features: ArrayLike | None = None
    ) -> NDArray[np.object_]:
        """Names of the columns of the output.

        Parameters
        ----------
        input_features : array-like of str, default=None
            Names of the columns of the input; None takes those seen in `fit`, or x0,
            x1, ... where there were none.

        Returns
        -------
        names : ndarray of shape (4 * n_joints + 1,)
            The names of the states, ``"sgn(qd1)"`` for a velocity ``"qd1"``, and the
            name of the task column.

        Raises
        ------
        ValueError
            If `input_features` are not those seen in `fit`.
        """
        check_is_fitted(self)
        names = check_feature_names_in(self, input_features)
        states = np.delete(names, self._task_position)
        velocities = states[self.n_joints_ : 2 * self.n_joints_]
        signs = [f"sgn({name})" for name in velocities]
        return np.array([*states, *signs, names[self._task_position]], dtype=object)

    def _count_joints(self, n_features):
        if self.n_joints is None:
            n_joints, rest = divmod(n_features - 1, 3)
            expected = "J joints need 3 J + 1"
        else:
            n_joints, rest = self.n_joints, n_features - 1 - 3 * self._given_joints()
            expected = f"n_joints={n_joints} needs {3 * n_joints + 1}"
        if rest:
            raise ValueError(
                f"X has {n_features} columns, but {expected}: positions q1..qJ (rad), "
                "velocities qd1..qdJ (rad/s), accelerations qdd1..qddJ (rad/s^2) and "
                "the task column."
            )
        return int(n_joints)

    def _given_joints(self):
        if isinstance(self.n_joints, bool) or not isinstance(self.n_joints, Integral):
            raise TypeError(f"n_joints={self.n_joints!r} must be None or an integer.")
        if self.n_joints < 1:
            raise ValueError(f"n_joints={self.n_joints} must be at least 1.")
        return self.n_joints

    def _split(self, table):
        """The states, as float64, and the labels."""
        return split_table(table, self._task_position, self)

    def _to_frame(self, features, labels, X):
        index = None
        if isinstance(X, pd.DataFrame):
            index, labels = X.index, X.iloc[:, self._task_position].array
        else:
            labels = labels.of_rows()
        *names, task = self.get_feature_names_out()
        frame = pd.DataFrame(features, columns=names, index=index)
        return frame.assign(**{task: labels})

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.categorical = True
        tags.input_tags.string = True
        return tags


def _as_column(labels):
    """The label of each row, as float64 where that is exact, else as an object."""
    tasks = labels.tasks
    if tasks.dtype.kind != "U":
        numbers = tasks.astype(np.float64)
        if (np.abs(numbers) < FIRST_INEXACT).all():
            return numbers[labels.codes]
    return tasks.astype(object)[labels.codes]
