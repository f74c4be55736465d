"""A robot as Pinocchio knows it: its joints, and what its torques are linear in."""

import os
from numbers import Integral
from pathlib import Path

import numpy as np

from skmtgp._data.joints import check_order, warn_of_degrees

# Inertial parameters of a link about the origin of its joint, in Pinocchio's order
INERTIAL = ["m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz"]

SLIDING = "JointModelP"  # PX, PY, PZ or PrismaticUnaligned; planar ones are refused


def import_pinocchio():
    """Pinocchio, or an ImportError that names the extra that brings it."""
    try:
        import pinocchio
    except ImportError as error:
        raise ImportError(
            "skmtgp.robot needs Pinocchio, which is not installed: "
            'pip install "skmtgp[robot]".'
        ) from error
    return pinocchio


class Dynamics:
    """The regressor of a robot's torques: what they are linear in.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        File of a URDF, its text, or the model itself.

    Attributes
    ----------
    n_joints : int
        Number of joints J, of one degree of freedom each.
    names : list of str
        Their names.
    links : list of str
        Names of the ten parameters of each link, such as ``"m(joint1)"``, of shape
        (10 J,). A link has the name of the joint that moves it.
    nominal : ndarray of shape (10 J,)
        Their values in the model.
    sizes : ndarray of shape (10 J,)
        How large each is in a link of that mass and extent.
    slides : list of bool
        Whether each joint slides.
    """

    def __init__(self, model):
        self._pin = import_pinocchio()
        self._model = _read(self._pin, model)
        _check(self._model)
        self.n_joints = self._model.nv
        self.names = list(self._model.names)[1:]
        self.links = [f"{of}({joint})" for joint in self.names for of in INERTIAL]
        inertias = list(self._model.inertias)[1:]
        self.nominal = np.concatenate([i.toDynamicParameters() for i in inertias])
        self.sizes = np.concatenate([_sizes(inertia) for inertia in inertias])
        joints = list(self._model.joints)[1:]
        self._turns_freely = [joint.nq == 2 for joint in joints]
        self.slides = [joint.shortname().startswith(SLIDING) for joint in joints]

    def __getstate__(self):
        """The model as text, so that skops saves it, too."""
        state = {name: value for name, value in vars(self).items() if name != "_pin"}
        return state | {"_model": self._model.saveToString()}

    def __setstate__(self, state):
        pin = import_pinocchio()
        model = pin.Model()
        model.loadFromString(state["_model"])
        vars(self).update(state, _pin=pin, _model=model)

    def position_of(self, joint):
        """Position from 0 of a joint that is given by it, or by its name."""
        if isinstance(joint, str):
            if joint not in self.names:
                raise ValueError(
                    f"joint={joint!r} is none of the model's: {self.names}."
                )
            return self.names.index(joint)
        if isinstance(joint, (bool, np.bool_)) or not isinstance(joint, Integral):
            raise TypeError(
                f"joint={joint!r} must be the position (int, from 0) or the name (str) "
                f"of a joint, not {type(joint).__name__}."
            )
        if not -self.n_joints <= joint < self.n_joints:
            raise ValueError(
                f"joint={joint} is out of range: the model has {self.n_joints} joints, "
                f"{self.names}, counted from 0."
            )
        return int(joint) % self.n_joints

    def states(self, x):
        """Positions, velocities and accelerations, of shape (n_samples, J) each.

        Raises
        ------
        ValueError
            If x has not three columns for each joint.
        """
        if x.shape[1] != 3 * self.n_joints:
            J = self.n_joints
            raise ValueError(
                f"X has {x.shape[1] + 1} columns, but the model has {J} joints, "
                f"{self.names}, and needs {3 * J + 1}: positions q1..q{J} (rad), "
                f"velocities qd1..qd{J} (rad/s), accelerations qdd1..qdd{J} (rad/s^2) "
                "and the task column."
            )
        return np.split(x, 3, axis=1)

    def check_states(self, x, names):
        """Check the columns of states in training, which have such names.

        Raises
        ------
        ValueError
            If x has not three columns for each joint, or names say that their order is
            another one.

        Warns
        -----
        AngleUnitWarning
            If positions look like degrees.
        """
        check_order(names)
        self.check_positions(self.states(x)[0], names)

    def check_positions(self, q, names, known=None):
        """Say where positions look like degrees, see `warn_of_degrees`."""
        turns = [not slides for slides in self.slides]
        warn_of_degrees(q, turns, names[: self.n_joints], known)

    def regressor(self, x, joints, columns):
        """Some columns of the regressor of some joints' torques.

        Parameters
        ----------
        x : ndarray of shape (n_samples, 3 J)
            Positions (rad or m), velocities and accelerations.
        joints : sequence of int
            Whose torques.
        columns : sequence of int
            Which of the 10 J parameters.

        Returns
        -------
        regressor : ndarray of shape (n_samples, n_joints_given, n_columns)
            Torque for one unit of each parameter, rotors and friction not counted.
        """
        q, qd, qdd = map(np.ascontiguousarray, self.states(x))
        model, data = self._model, self._model.createData()
        of_row, values = (
            np.ix_(joints, columns),
            np.empty((len(x), len(joints), len(columns))),
        )
        rows = zip(self._configurations(q), qd, qdd, strict=True)
        for i, state in enumerate(rows):
            whole = self._pin.computeJointTorqueRegressor(model, data, *state)
            values[i] = whole[of_row]
        return values

    def regressor_at(self, x):
        """The regressor of all joints' torques for one state, of shape (J, 10 J)."""
        q, qd, qdd = x.reshape(3, self.n_joints)
        state = self._configurations(q[None])[0], qd, qdd
        data = self._model.createData()  # of this call: threads may predict, too
        return self._pin.computeJointTorqueRegressor(self._model, data, *state)

    def random_states(self, n_samples, random_state=0):
        """States at random, in no unit's or limit's particular range."""
        rng = np.random.RandomState(random_state)
        q = rng.uniform(-np.pi, np.pi, (n_samples, self.n_joints))
        return np.hstack([q, rng.standard_normal((n_samples, 2 * self.n_joints))])

    def _configurations(self, q):
        """As Pinocchio has them: cosine and sine of joints that turn without end."""
        if not any(self._turns_freely):
            return q
        parts = [
            part
            for position, free in zip(q.T, self._turns_freely, strict=True)
            for part in ((np.cos(position), np.sin(position)) if free else (position,))
        ]
        return np.column_stack(parts)


def _read(pin, model):
    """The model of a URDF; one that is given stays as it is."""
    if isinstance(model, pin.Model):
        return model
    if not isinstance(model, (str, os.PathLike)):
        raise TypeError(
            f"model={model!r} must be the path of a URDF, its text or a "
            f"pinocchio.Model, not {type(model).__name__}."
        )
    is_text = isinstance(model, str) and model.lstrip().startswith("<")
    if not is_text and not Path(model).is_file():
        raise FileNotFoundError(f"model={str(model)!r}: there is no such URDF.")
    build = pin.buildModelFromXML if is_text else pin.buildModelFromUrdf
    try:
        return build(str(model))
    except ValueError as error:
        given = f"{str(model)[:30]!r}{'...' * (len(str(model)) > 30)}"
        raise ValueError(
            f"model={given} cannot be read as a URDF: {error} The lines above, from "
            "the parser, say where it is wrong. A file of xacro must be expanded first."
        ) from error


def _sizes(inertia):
    """How large the ten parameters of a link are, by its mass and its extent."""
    m, *_, xx, _, yy, _, _, zz = inertia.toDynamicParameters()
    extent = np.sqrt(max(xx + yy + zz, 0.0) / (2.0 * m)) if m > 0.0 else 0.0
    return m * extent ** np.repeat([0, 1, 2], [1, 3, 6])


def _check(model):
    """Raise a ValueError where a joint has not one degree of freedom."""
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv != 1:
            raise ValueError(
                f"Joint {name!r} of the model has {joint.nv} degrees of freedom; only "
                "joints of one can be used. Fix it with pinocchio.buildReducedModel."
            )
    if not model.nv:
        raise ValueError("The model has no joint that moves.")
