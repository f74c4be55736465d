"""Features of inverse dynamics from positions, velocities and accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import TransformerMixin
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.dask import refuse_dask
from skmtgp._data.descriptors import locate_descriptors
from skmtgp._data.joints import (
    STANDSTILL,
    check_angles,
    check_joints,
    check_order,
    columns_of_positions,
    ends_of,
    warn_of_degrees,
)
from skmtgp._data.labels import FIRST_INEXACT
from skmtgp._data.task_column import locate, locate_task_column, read_table, split_table
from skmtgp._estimators.estimator import Estimator, fitting
from skmtgp._support.sklearn_compat import (
    check_feature_names_in,
    wants_pandas,
    with_callbacks,
)

__all__ = ["InverseDynamicsFeatures"]

BY_PARTITIONS = (
    "Fit the features to rows in memory, X.get_partition(0).compute() say, and map "
    "them over the partitions, X.map_partitions(features.transform, meta=...): a "
    "regressor with inference='sparse' takes what comes of it."
)


class InverseDynamicsFeatures(TransformerMixin, Estimator):
    r"""Standardised states, signs of the velocities, and the task.

    The states x = (q, qd, qdd) of a robot with J joints are scaled to zero mean and
    unit variance on the training data. The signs sgn(qd) of the velocities are added,
    because Coulomb friction depends on them. The task becomes the last column.

    With ``angles="trigonometric"``, the position of each joint that turns is replaced
    by its cosine and its sine. Nothing is shifted then, so zero remains zero. Cosines
    and sines are not scaled, and velocities and accelerations are divided by their root
    mean square. Torques of rigid bodies are polynomials in these features.

    Parameters
    ----------
    n_joints : int, default=None
        Number of joints J. None takes it from the number of columns, 3 J + 1.
    angles : {"radians", "trigonometric"}, default="radians"
        How the position of a joint that turns is represented: by itself, standardised,
        or by its cosine and its sine.
    joint_types : sequence of str, default=None
        "revolute" (or "R") for each joint that turns, "prismatic" (or "P") for each
        that slides, such as ``"RRPRRR"``. None means that all turn. It only matters to
        trigonometric angles: the position of a joint that slides is standardised.
    task_feature : int or str, default=-1
        Position or name of the task column.
    task_descriptors : sequence of int or str, default=None
        Positions or names of columns that describe the tasks, such as the mass of a
        load. They are passed on unchanged, before the task. The other columns are, from
        left to right, positions q1..qJ (rad), velocities qd1..qdJ (rad/s) and
        accelerations qdd1..qddJ (rad/s^2).

    Attributes
    ----------
    n_joints_ : int
        Number of joints J.
    mean_ : ndarray of shape (n_states,)
        What is subtracted from each column of x, in its own units: the mean of the
        training data, or 0 with trigonometric angles. n_states is 3 J, and with
        trigonometric angles one more for each joint that turns.
    scale_ : ndarray of shape (n_states,)
        What each column of x is divided by, in its own units. It is the standard
        deviation of the training data. With trigonometric angles it is the root mean
        square, and 1 for cosines and sines. Where it would be 0 it is 1.
    n_features_in_ : int
        Number of columns in `fit`, 3 J + 1 plus the descriptors.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns in `fit`, if they had names.

    See Also
    --------
    skmtgp.kernels.inverse_dynamics_kernel : The paper's kernel on these features.
    skmtgp.kernels.geometric_inverse_dynamics_kernel : A polynomial kernel on them, for
        trigonometric angles.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6. A velocity of at most 1e-9
    rad/s counts as standstill, whose sign is 0. Otherwise a joint at rest would get the
    sign, and the friction, of a rounding error. Signs are those of the velocities
    before scaling, and are not scaled.

    Examples
    --------
    Two samples of a robot with one joint, which carries loads 1 and 2:

    >>> import numpy as np
    >>> from skmtgp.preprocessing import InverseDynamicsFeatures
    >>> X = np.array([[0.1, -2.0, 5.0, 1], [0.3, 0.0, 9.0, 2]])
    >>> InverseDynamicsFeatures().fit_transform(X)
    array([[-1., -1., -1., -1.,  1.],
           [ 1.,  1.,  1.,  0.,  2.]])

    The same with the cosine and the sine of the position, and zero where it was:

    >>> InverseDynamicsFeatures(angles="trigonometric").fit_transform(X).round(2)
    array([[ 1.  ,  0.1 , -1.41,  0.69, -1.  ,  1.  ],
           [ 0.96,  0.3 ,  0.  ,  1.24,  0.  ,  2.  ]])
    """

    def __init__(
        self,
        n_joints: int | None = None,
        *,
        angles: Literal["radians", "trigonometric"] = "radians",
        joint_types: Sequence[str] | None = None,
        task_feature: int | str = -1,
        task_descriptors: Sequence[int | str] | None = None,
    ) -> None:
        self.n_joints = n_joints
        self.angles = angles
        self.joint_types = joint_types
        self.task_feature = task_feature
        self.task_descriptors = task_descriptors

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
            If `n_joints`, `joint_types` or `task_feature` has a wrong type, or if X is
            a Dask collection.
        ValueError
            If X does not have 3 J + 1 columns or has no column `task_feature`. If
            `angles` or `joint_types` are not valid, a number is missing or infinite, or
            a task label is missing or fractional. The transformer is then as it was
            before.

        Warns
        -----
        AngleUnitWarning
            If positions look like degrees.
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
        self._descriptors = self._locate_descriptors()
        self.n_joints_ = self._count_joints(n_features)
        names = np.delete(locate(self)[1], self._descriptors)
        check_order(names)
        self._revolute = self._turning()
        x, n = self._split(table)[0], self.n_joints_
        warn_of_degrees(x[:, :n], check_joints(self.joint_types, n), names[:n])
        self._ends = ends_of(x[:, :n])
        self.mean_, self.scale_ = self._units(self._states(x))

    def _locate_descriptors(self):
        """Where they are among the columns without the task's."""
        if self.task_descriptors is None:
            return np.array([], dtype=int)
        return locate_descriptors(
            self.task_descriptors,
            self._task_position,
            self.n_features_in_,
            getattr(self, "feature_names_in_", None),
        )

    def _turning(self):
        """Of each joint, whether its cosine and its sine stand for its position."""
        check_angles(self.angles)
        revolute = check_joints(self.joint_types, self.n_joints_)
        return revolute if self.angles == "trigonometric" else [False] * self.n_joints_

    def _states(self, x):
        """The states, with cosines and sines of joints that turn."""
        positions = [
            function(q) if function else q
            for q, turns in zip(x.T, self._revolute, strict=False)
            for function in ((np.cos, np.sin) if turns else (None,))
        ]
        return np.column_stack([*positions, x[:, self.n_joints_ :]])

    def _units(self, states):
        """What is taken off each column of the states, and what it is divided by."""
        scaler = StandardScaler().fit(states)
        if self.angles == "radians":
            return scaler.mean_, scaler.scale_
        positions = columns_of_positions(self._revolute)
        slides = [c for of_joint in positions for c in of_joint if len(of_joint) == 1]
        mean, scale = np.zeros_like(scaler.mean_), np.sqrt(np.square(states).mean(0))
        scale[: positions[-1][-1] + 1] = 1.0
        mean[slides], scale[slides] = scaler.mean_[slides], scaler.scale_[slides]
        return mean, np.where(scale > 0.0, scale, 1.0)

    def transform(self, X: ArrayLike) -> NDArray[Any] | pd.DataFrame:
        """Standardise the states, add the signs, move the task to the end.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions (rad), velocities (rad/s), accelerations (rad/s^2) and the task.

        Returns
        -------
        features : ndarray or DataFrame of shape (n_samples, n_features_out)
            The scaled states, the J signs -1, 0 or 1, the descriptors and the task:
            n_states + J + n_descriptors + 1 columns. The states are 3 J columns. With
            trigonometric angles, the cosine and the sine of a joint that turns take the
            place of its position. An array has float64 if the labels are numbers, else
            objects. A frame (after ``set_output(transform="pandas")``) has the labels
            as they were.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If X has other columns than in `fit`, or for the reasons of `fit`.

        Warns
        -----
        AngleUnitWarning
            If positions look like degrees, and those of `fit` did not.
        """
        check_is_fitted(self)
        refuse_dask("X", X, BY_PARTITIONS)
        x, described, labels = self._split(read_table(self, X, reset=False))
        self._warn_of_degrees(x[:, : self.n_joints_])
        velocities = x[:, self.n_joints_ : 2 * self.n_joints_]
        signs = np.where(np.abs(velocities) <= STANDSTILL, 0.0, np.sign(velocities))
        scaled = (self._states(x) - self.mean_) / self.scale_
        features = np.column_stack([scaled, signs, described])
        names = self.get_feature_names_out() if wants_pandas(self) else None
        return join_labels(features, labels, X, self._task_position, names)

    _ends = None  # of positions in `fit`

    def _warn_of_degrees(self, positions):
        """Say where new states look like degrees, beside those of `fit`."""
        names = np.delete(locate(self)[1], self._descriptors)[: self.n_joints_]
        turns = check_joints(self.joint_types, self.n_joints_)
        warn_of_degrees(positions, turns, names, self._ends)

    def _compile(self, label):
        """The same of one state without its task, see `compile_predictor`."""
        check_is_fitted(self)
        return OneState(self._revolute, self.n_joints_, self.mean_, self.scale_)

    def get_feature_names_out(
        self, input_features: ArrayLike | None = None
    ) -> NDArray[np.object_]:
        """Names of the columns of the output.

        Parameters
        ----------
        input_features : array-like of str, default=None
            Names of the columns of the input. None means those of `fit`, or x0, x1, ...
            if they had no names.

        Returns
        -------
        names : ndarray of shape (n_features_out,)
            Names of the states, ``"cos(q1)"`` and ``"sin(q1)"`` for trigonometric
            angles, ``"sgn(qd1)"`` for a velocity ``"qd1"``, and the names of the
            descriptors and of the task column.

        Raises
        ------
        ValueError
            If `input_features` differ from those of `fit`.
        """
        check_is_fitted(self)
        names = check_feature_names_in(self, input_features)
        others = np.delete(names, self._task_position)
        states = np.delete(others, self._descriptors)
        described = others[self._descriptors]
        positions = [
            form.format(name)
            for name, turns in zip(states, self._revolute, strict=False)
            for form in (("cos({})", "sin({})") if turns else ("{}",))
        ]
        others = states[self.n_joints_ :]
        signs = [f"sgn({name})" for name in others[: self.n_joints_]]
        task = names[self._task_position]
        names = [*positions, *others, *signs, *described, task]
        return np.array(names, dtype=object)

    def _count_joints(self, n_features):
        n_states = n_features - 1 - len(self._descriptors)
        if self.n_joints is None:
            n_joints, rest = divmod(n_states, 3)
            expected = "J joints need 3 J + 1"
        else:
            n_joints, rest = self.n_joints, n_states - 3 * self._given_joints()
            expected = f"n_joints={n_joints} needs {3 * n_joints + 1}"
        if rest:
            beside = " beside the task_descriptors" * bool(len(self._descriptors))
            raise ValueError(
                f"X has {n_states + 1} columns{beside}, but {expected}: positions "
                "q1..qJ (rad), velocities qd1..qdJ (rad/s), accelerations qdd1..qddJ "
                "(rad/s^2) and the task column."
            )
        return int(n_joints)

    def _given_joints(self):
        if isinstance(self.n_joints, bool) or not isinstance(self.n_joints, Integral):
            raise TypeError(f"n_joints={self.n_joints!r} must be None or an integer.")
        if self.n_joints < 1:
            raise ValueError(f"n_joints={self.n_joints} must be at least 1.")
        return self.n_joints

    def _split(self, table):
        """The states and the descriptors, as float64, and the labels."""
        features, labels = split_table(table, self._task_position, self)
        columns = self._descriptors
        return np.delete(features, columns, axis=1), features[:, columns], labels

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.categorical = True
        tags.input_tags.string = True
        return tags


def join_labels(features, labels, X, position, names=None):
    """Features with the tasks as the last column.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_columns)
        Numbers.
    labels : Labels
        The task of each row.
    X : array-like of shape (n_samples, n_features)
        Whose rows they are; a frame gives its index and the labels as they were.
    position : int
        Of the task column in X.
    names : ndarray of shape (n_columns + 1,), default=None
        Names of the columns, if a frame is wanted.

    Returns
    -------
    joined : ndarray or DataFrame of shape (n_samples, n_columns + 1)
        As an array, float64 where the labels are numbers, else object.
    """
    if names is None:
        return np.column_stack([features, _as_column(labels)])
    index = None
    if isinstance(X, pd.DataFrame):
        index, labels = X.index, X.iloc[:, position].array
    else:
        labels = labels.of_rows()
    *others, task = names
    frame = pd.DataFrame(features, columns=others, index=index)
    return frame.assign(**{task: labels})


class OneState:
    """The features of one state, a plain array in and out.

    Parameters
    ----------
    turns : sequence of bool
        Of each joint, whether its cosine and its sine stand for its position.
    n_joints : int
        Number of joints J.
    mean, scale : ndarray of shape (n_states,)
        What is taken off the states, and what they are divided by.
    """

    def __init__(self, turns, n_joints, mean, scale):
        self.n_joints, self.mean, self.scale = n_joints, mean, scale
        positions = columns_of_positions(turns)
        self.turning = np.flatnonzero(turns)
        self.cosines = np.array([positions[j][0] for j in self.turning], dtype=int)
        others = np.ones(len(mean), dtype=bool)
        others[self.cosines], others[self.cosines + 1] = False, False
        self.others = np.flatnonzero(others)
        self.kept = np.delete(np.arange(3 * n_joints), self.turning)

    def __call__(self, x):
        J, n = self.n_joints, len(self.mean)
        features = np.empty(n + J)
        features[self.others] = x[self.kept]
        if len(self.turning):
            angles = x[self.turning]
            features[self.cosines] = np.cos(angles)
            features[self.cosines + 1] = np.sin(angles)
        features[:n] -= self.mean
        features[:n] /= self.scale
        velocities = x[J : 2 * J]
        np.sign(velocities, out=features[n:])
        features[n:][np.abs(velocities) <= STANDSTILL] = 0.0
        return features


def _as_column(labels):
    """The label of each row, as float64 where that is exact, else as an object."""
    tasks = labels.tasks
    if tasks.dtype.kind != "U":
        numbers = tasks.astype(np.float64)
        if (np.abs(numbers) < FIRST_INEXACT).all():
            return numbers[labels.codes]
    return tasks.astype(object)[labels.codes]
