"""The regressor of a joint's torque as features."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import TransformerMixin
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.dask import refuse_dask
from skmtgp._data.task_column import locate, locate_task_column, read_table, split_table
from skmtgp._estimators.estimator import Estimator, fitting
from skmtgp._support.sklearn_compat import (
    check_feature_names_in,
    wants_pandas,
    with_callbacks,
)
from skmtgp.preprocessing import BY_PARTITIONS, join_labels
from skmtgp.robot._columns import Columns, check_friction
from skmtgp.robot._dynamics import Dynamics


class RigidBodyFeatures(TransformerMixin, Estimator):
    r"""Features in which the torque of a joint is linear, and the task.

    The torque of a joint of a rigid robot is linear in the inertial parameters of its
    links: ten for each link, its mass, first moments and inertia. Torques do not
    determine all of them. The features are a largest set of independent columns of that
    regressor, and columns of friction. The coefficient of such a column is called a
    *base parameter*. It stands for a sum of inertial parameters.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        The robot: file of a URDF, its text, or a Pinocchio model. Its J joints have one
        degree of freedom each, and are in the order of the columns of X. Only the
        positions of joints and links matter, not their masses.
    joint : int or str
        Joint whose torque is modelled: position from 0, or name in the model.
    friction : str, sequence of str or None, default=("viscous", "asymmetric", "rotor")
        Torques besides those of rigid bodies, with a column for each. None means no
        friction.

        - "viscous": the velocity.
        - "coulomb": the sign of the velocity.
        - "asymmetric": 1 for positive velocities and -1 for negative ones, in two
          columns.
        - "offset": 1.
        - "rotor": the acceleration, for the inertia of a motor that turns with the
          joint.

        Columns that depend on earlier ones are left out, such as that of a rotor that
        turns like a link.
    task_feature : int or str, default=-1
        Position or name of the task column. The other columns are, from left to right,
        positions q1..qJ (rad, or m where a joint slides), velocities and accelerations.

    Attributes
    ----------
    n_joints_ : int
        Number of joints J.
    joint_names_ : list of str
        Their names in the model.
    nominal_ : ndarray of shape (n_columns,)
        Base parameters by the masses and inertias of the model; 0 for friction. With
        them the features give the torque of the model.
    n_features_in_ : int
        Number of columns in `fit`, 3 J + 1.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns in `fit`, if they had names.

    See Also
    --------
    RigidBodyRegressor : Least squares on these features, of all joints.
    skmtgp.preprocessing.InverseDynamicsFeatures : Without a model of the robot.

    Notes
    -----
    The columns are chosen at random states, always the same ones, and do not depend on
    the data. The choice goes from the first link to the last. A column is left out if
    its projection on the earlier ones leaves at most 1e-4 of its norm. If the data do
    not excite all columns, some coefficients remain undetermined.

    A velocity of at most 1e-9 counts as standstill, where Coulomb friction is 0.

    References
    ----------
    .. [1] M. Gautier, "Numerical calculation of the base inertial parameters of
       robots", Journal of Robotic Systems 8(4), 485-506, 1991.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets import puma560_urdf
    >>> from skmtgp.robot import RigidBodyFeatures
    >>> features = RigidBodyFeatures(puma560_urdf(), joint=5, friction="viscous")
    >>> X = np.column_stack([np.full((2, 18), 0.5), ["empty", "full"]])
    >>> features.fit_transform(X).shape
    (2, 9)
    >>> features.get_feature_names_out()[[0, -2, -1]]
    array(['mc_x(joint6)', 'viscous(joint6)', 'x18'], dtype=object)
    """

    def __init__(
        self,
        model: Any,
        *,
        joint: int | str,
        friction: str | Sequence[str] | None = ("viscous", "asymmetric", "rotor"),
        task_feature: int | str = -1,
    ) -> None:
        self.model = model
        self.joint = joint
        self.friction = friction
        self.task_feature = task_feature

    @with_callbacks
    def fit(self, X: ArrayLike, y: Any = None) -> Self:
        """Choose the columns, which do not depend on the data.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions, velocities, accelerations and the task (int, str, bool or
            category).
        y : None
            Ignored.

        Returns
        -------
        self : RigidBodyFeatures
            Fitted.

        Raises
        ------
        ImportError
            If Pinocchio is not installed.
        TypeError
            If a parameter has a wrong type, or if X is a Dask collection.
        ValueError
            If the model cannot be read or has joints with several degrees of freedom.
            If X does not have 3 J + 1 columns or has no column `task_feature`. If
            `joint` or a word of `friction` is not known, a number is missing or
            infinite, or a task label is missing or fractional. The transformer is then
            as it was before.
        FileNotFoundError
            If there is no such file.
        """
        with fitting(self, X, y):
            self._fit(X)
        return self

    def _fit(self, X):
        refuse_dask("X", X, BY_PARTITIONS)
        dynamics, words = Dynamics(self.model), check_friction(self.friction)
        joint = dynamics.position_of(self.joint)
        table = read_table(self, X, reset=True)
        self._task_position = locate_task_column(
            self.task_feature,
            self.n_features_in_,
            getattr(self, "feature_names_in_", None),
        )
        x = split_table(table, self._task_position, self)[0]
        dynamics.check_states(x, locate(self)[1])
        self._columns = Columns(dynamics, words, [joint])
        self.nominal_ = self._columns.nominal
        self.n_joints_, self.joint_names_ = dynamics.n_joints, dynamics.names

    def transform(self, X: ArrayLike) -> NDArray[Any] | pd.DataFrame:
        """Columns of the torque of the joint, and the task.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions, velocities, accelerations and the task.

        Returns
        -------
        features : ndarray or DataFrame of shape (n_samples, n_columns + 1)
            Torque (N m, or N if the joint slides) for one unit of each base parameter
            of links (kg, kg m, kg m^2) and of friction, and the task. An array has
            float64 if the labels are numbers, else objects. A frame (after
            ``set_output(transform="pandas")``) has the labels as they were.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If X has other columns than in `fit`, or for the reasons of `fit`.

        Notes
        -----
        Pinocchio processes the rows one by one, about 100,000 rows of six joints per
        second.
        """
        check_is_fitted(self)
        refuse_dask("X", X, BY_PARTITIONS)
        table = read_table(self, X, reset=False)
        x, labels = split_table(table, self._task_position, self)
        features = self._columns.of(x)[0][:, 0]
        frame = wants_pandas(self)
        names = self.get_feature_names_out() if frame else None
        return join_labels(features, labels, X, self._task_position, names)

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
        names : ndarray of shape (n_columns + 1,)
            A parameter has the name of the joint that moves the link, such as
            ``"mc_x(joint6)"`` and ``"viscous(joint6)"``. "m" is a mass, "mc_x" a first
            moment and "I_xy" an inertia, about the origin of the joint's frame and in
            its axes. The last name is that of the task column.

        Raises
        ------
        ValueError
            If `input_features` differ from those of `fit`.
        """
        check_is_fitted(self)
        names = check_feature_names_in(self, input_features)
        task = names[self._task_position]
        return np.array([*self._columns.names, task], dtype=object)

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.categorical = True
        tags.input_tags.string = True
        return tags
