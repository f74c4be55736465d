"""The regressor of a joint's torque as features."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import TransformerMixin
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import locate
from skmtgp._data.dask import refuse_dask
from skmtgp._data.joints import check_order
from skmtgp._data.task_column import locate_task_column, read_table, split_table
from skmtgp._estimators.estimator import Estimator
from skmtgp._support.progress import fitting
from skmtgp._support.sklearn_compat import (
    check_feature_names_in,
    wants_pandas,
    with_callbacks,
)
from skmtgp.preprocessing import BY_PARTITIONS, join_labels
from skmtgp.robot._columns import Columns, check_friction
from skmtgp.robot._dynamics import Dynamics


class RigidBodyFeatures(TransformerMixin, Estimator):
    r"""What the torque of a joint is linear in, and the task.

    The torque of a joint of a rigid robot is linear in the inertial parameters of its
    links: mass, first moments and inertia, ten of each. Not all of them can be told
    apart by torques; the features are a largest set of columns of that regressor, of
    which none depends on others, and columns of friction. A coefficient of such a
    column, a *base parameter*, stands for a sum of parameters.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        The robot: file of a URDF, its text, or a Pinocchio model. Its J joints have one
        degree of freedom each and are, in its order, those of the columns of X. Only
        where joints and links are matters, not what they weigh.
    joint : int or str
        Position from 0, or name in the model, of the joint whose torque it is.
    friction : str, sequence of str or None, default=("viscous", "asymmetric", "rotor")
        Torques beside those of rigid bodies, a column for each; None: none. "viscous"
        is the velocity; "coulomb" its sign; "asymmetric" is 1 where it is positive, and
        -1 where it is negative, in a column of their own; "offset" is 1; "rotor", the
        inertia of a motor that turns with the joint, is the acceleration. Columns that
        depend on those before them are left out, as for a rotor that turns like a link.
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
        The base parameters that the masses and inertias of the model have; 0 for
        friction. With them the features give the torque of the model.
    n_features_in_ : int
        Number of columns seen in `fit`, 3 J + 1.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns seen in `fit`, if they had any.

    See Also
    --------
    RigidBodyRegressor : Least squares on these features, of all joints.
    skmtgp.preprocessing.InverseDynamicsFeatures : Without a model of the robot.

    Notes
    -----
    The columns are found at random states, the same ones each time, without regard to
    the data: from the first link to the last a column is left out if 1e-4 of its norm
    or less is left when its projection on those before it is taken off. Data that do
    not excite all of them leave some coefficients open.

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
        """Find the columns, which do not depend on the data.

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
            If a parameter is of another type, or X a Dask collection.
        ValueError
            If the model cannot be read or has joints of several degrees of freedom, if
            X has not 3 J + 1 columns or none `task_feature`, if `joint` or a word of
            `friction` is none, if a number is missing or infinite, or if a task label
            is missing or fractional. The transformer is then as it was before.
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
        check_order(locate(self)[1])
        dynamics.states(split_table(table, self._task_position, self)[0])
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
            Torque (N m, or N where the joint slides) for one unit of each base
            parameter of links (kg, kg m, kg m^2) and of friction, and the task. As an
            array, float64 where the labels are numbers, else object. As a frame (after
            ``set_output(transform="pandas")``), with the labels as they were.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If X has other columns than in `fit`, or as for `fit`.

        Notes
        -----
        Pinocchio takes the rows one after another, about 100,000 of six joints in a
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
            Names of the columns of the input; None takes those seen in `fit`, or x0,
            x1, ... where there were none.

        Returns
        -------
        names : ndarray of shape (n_columns + 1,)
            A parameter with the name of the joint that moves the link in the model,
            such as ``"mc_x(joint6)"`` and ``"viscous(joint6)"``, and the name of the
            task column. "m" is a mass, "mc_x" a first moment, "I_xy" an inertia, about
            the origin of the joint's frame and in its axes.

        Raises
        ------
        ValueError
            If `input_features` are not those seen in `fit`.
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
