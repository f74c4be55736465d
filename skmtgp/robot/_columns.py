"""What torques are linear in: base parameters of the links, and friction."""

from collections.abc import Iterable

import numpy as np

from skmtgp._data.joints import STANDSTILL

# What is left of a column of unit norm when earlier ones are taken off it is 1e-13 or
# less where it depends on them, and above 0.6 where it does not, on seven robots. A
# URDF may round a right angle, by 4e-6 say: data do not tell what shows by that alone.
INDEPENDENT = 1e-4


def _forward(qd, qdd):
    return (qd > STANDSTILL).astype(np.float64)


def _backward(qd, qdd):
    return -(qd < -STANDSTILL).astype(np.float64)


# The columns of each word, of the velocity and the acceleration of the joint
FRICTION = {
    "viscous": {"viscous": lambda qd, qdd: qd},
    "coulomb": {"coulomb": lambda qd, qdd: _forward(qd, qdd) + _backward(qd, qdd)},
    "asymmetric": {"coulomb+": _forward, "coulomb-": _backward},
    "offset": {"offset": lambda qd, qdd: np.ones_like(qd)},
    "rotor": {"rotor": lambda qd, qdd: qdd},
}


def check_friction(friction):
    """The words of a friction law.

    Parameters
    ----------
    friction : str, sequence of str or None
        "viscous", "coulomb", "asymmetric", "offset" or "rotor"; None: no friction.

    Returns
    -------
    words : list of str
        Without repetitions.

    Raises
    ------
    TypeError, ValueError
        If they are none of these.
    """
    return check_words("friction", friction, FRICTION)


def check_words(name, given, known):
    """Words of a parameter, each of which must be known.

    Parameters
    ----------
    name : str
        Of the parameter.
    given : str, sequence of str or None
        Its value.
    known : iterable of str
        All words.

    Returns
    -------
    words : list of str
        Without repetitions.
    """
    words = [] if given is None else given
    words = [words] if isinstance(words, str) else words
    if not isinstance(words, Iterable):
        raise TypeError(
            f"{name}={given!r} must be None, a word or a sequence of words."
        )
    words = list(dict.fromkeys(words))
    for word in words:
        if not isinstance(word, str) or word not in known:
            allowed = ", ".join(map(repr, known))
            raise ValueError(f"{name}={given!r} has {word!r}; it must be of {allowed}.")
    return words


def friction_columns(words, qd, qdd):
    """Torque of friction in a joint for one unit of each of its parameters.

    Parameters
    ----------
    words : list of str
        Friction law.
    qd, qdd : ndarray of shape (n_samples,)
        Velocity and acceleration of the joint.

    Returns
    -------
    columns : dict of str to ndarray of shape (n_samples,)
        By name.
    """
    functions = {name: f for word in words for name, f in FRICTION[word].items()}
    return {name: function(qd, qdd) for name, function in functions.items()}


def independent(columns):
    """Positions of columns that do not depend on those before them.

    Parameters
    ----------
    columns : ndarray of shape (n_rows, n_columns)
        More rows than columns.

    Returns
    -------
    kept : list of int
        Ascending.
    """
    norms = np.linalg.norm(columns, axis=0)
    basis, kept = np.empty((len(columns), 0)), []
    for j in np.flatnonzero(norms > INDEPENDENT * norms.max(initial=0.0)):
        left = columns[:, j] / norms[j]
        for _ in range(2):  # once more, for the rounding errors of the first time
            left = left - basis @ (basis.T @ left)
        size = np.linalg.norm(left)
        if size > INDEPENDENT:
            basis = np.column_stack([basis, left / size])
            kept.append(int(j))
    return kept


def _directions(names):
    """Of Columns: `one_way` and `both_ways`."""
    at, unit = {name: j for j, name in enumerate(names)}, np.eye(len(names))
    found = [(name.replace("coulomb+", "coulomb-", 1), j) for name, j in at.items()]
    pairs = [(j, at[other]) for other, j in found if at.get(other, j) != j]
    plus, minus = np.array(pairs, dtype=int).reshape(-1, 2).T
    both_ways = unit.copy()
    both_ways[minus, plus] = 1.0
    return unit[:, [*plus, *minus]], np.delete(both_ways, minus, axis=1)


class Columns:
    """What some joints' torques are linear in, without what depends on the rest.

    Parameters
    ----------
    dynamics : Dynamics
        The robot.
    words : list of str
        Friction law, the same for each joint.
    joints : list of int
        Whose torques.

    Attributes
    ----------
    names : list of str
        Of the base parameters of the links, then of friction, such as
        ``"mc_x(joint2)"`` and ``"viscous(joint2)"``.
    n_links : int
        How many of them are parameters of links.
    nominal : ndarray of shape (n_columns,)
        The values that the model gives them; friction 0.
    spread : ndarray of shape (n_links, n_links)
        Factor of the covariance of the links' parameters, if those of each link vary
        by as much as they are large.
    load : list of int
        Which of the ten parameters of a load in the last link can be told apart.
    one_way : ndarray of shape (n_friction, n_one_way)
        Coulomb friction of each direction alone, of joints that have both: what it has
        of each parameter.
    both_ways : ndarray of shape (n_friction, n_both_ways)
        The same of all friction, if it is alike in both directions.
    """

    def __init__(self, dynamics, words, joints):
        self.dynamics, self.words, self.joints = dynamics, words, list(joints)
        self._last = 10 * dynamics.n_joints - 10  # first parameter of the last link
        # More rows than columns, at random: what depends there depends everywhere.
        x = dynamics.random_states(50 + 20 * dynamics.n_joints)
        links = dynamics.regressor(x, self.joints, np.arange(self._last + 10))
        links = links.reshape(-1, self._last + 10)
        self._links, self.load = independent(links), independent(links[:, -10:])
        self.n_links = len(self._links)
        self._friction = self._names_of_friction(x, links[:, self._links])
        self.names = [dynamics.links[j] for j in self._links] + self._friction
        base = links[:, self._links]
        regrouped = np.linalg.lstsq(base, links, rcond=None)[0]
        nominal = regrouped @ dynamics.nominal
        self.nominal = np.concatenate([nominal, np.zeros(len(self._friction))])
        self.spread = np.linalg.qr((regrouped * dynamics.sizes).T, mode="r").T
        self.one_way, self.both_ways = _directions(self._friction)

    def _names_of_friction(self, x, base):
        """Parameters of friction that those of links do not stand for."""
        columns = self._friction_columns(x)
        flat = [values.ravel() for values in columns.values()]
        kept = independent(np.column_stack([base, *flat]))
        names = list(columns)
        return [names[j - self.n_links] for j in kept if j >= self.n_links]

    def _friction_columns(self, x):
        """By name, of shape (n_samples, n_joints_given)."""
        _, qd, qdd = self.dynamics.states(x)
        columns = {}
        for i, j in enumerate(self.joints):
            of_joint = friction_columns(self.words, qd[:, j], qdd[:, j])
            for name, values in of_joint.items():
                column = np.zeros((len(x), len(self.joints)))
                column[:, i] = values
                columns[f"{name}({self.dynamics.names[j]})"] = column
        return columns

    def of(self, x):
        """The columns at some states, and those of a load in the last link.

        Parameters
        ----------
        x : ndarray of shape (n_samples, 3 J)
            Positions, velocities and accelerations.

        Returns
        -------
        columns : ndarray of shape (n_samples, n_joints_given, n_columns)
            Torques for one unit of each parameter.
        load : ndarray of shape (n_samples, n_joints_given, n_load)
            The same of a load's.
        """
        load = [self._last + j for j in self.load]
        found = self.dynamics.regressor(x, self.joints, self._links + load)
        links, load = np.split(found, [self.n_links], axis=2)
        columns = self._friction_columns(x)
        friction = [columns[name][:, :, None] for name in self._friction]
        return np.concatenate([links, *friction], axis=2), load
