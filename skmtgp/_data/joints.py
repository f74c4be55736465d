"""The joints of a robot: which turn, which slide, and where their features are."""

import re
from itertools import accumulate

import numpy as np

from skmtgp._support.warnings import warn
from skmtgp.exceptions import AngleUnitWarning

TURNS = 8.0 * np.pi  # rad; in degrees most joints move more than that
FAR_TURNS = 32.0 * np.pi  # no joint of a robot winds up so far; more than 100 degrees
STANDSTILL = 1e-9  # rad/s; slower than this a velocity is rounding noise of either sign
KINDS = {"revolute": True, "R": True, "prismatic": False, "P": False}
WORDS = {  # how columns of positions, velocities and accelerations are called
    **dict.fromkeys(("q", "pos", "position", "angle", "theta"), 0),
    **dict.fromkeys(("qd", "dq", "qdot", "vel", "velocity"), 1),
    **dict.fromkeys(("qdd", "ddq", "qddot", "acc", "acceleration"), 2),
}


def are_revolute(joint_types):
    """Whether each joint turns.

    Parameters
    ----------
    joint_types : sequence of str
        "revolute" or "R", "prismatic" or "P", for each joint.

    Returns
    -------
    revolute : list of bool
        False for a joint that slides.

    Raises
    ------
    TypeError
        If `joint_types` is no sequence.
    ValueError
        If it is empty, or a joint is neither.
    """
    try:
        kinds = list(joint_types)
    except TypeError:
        raise TypeError(
            f"joint_types={joint_types!r} must be a sequence with 'revolute' (or 'R') "
            "or 'prismatic' (or 'P') for each joint."
        ) from None
    if not kinds:
        raise ValueError("joint_types is empty: give the type of each joint.")
    for i, kind in enumerate(kinds):
        if not isinstance(kind, str) or kind not in KINDS:
            raise ValueError(
                f"joint_types={joint_types!r} has {kind!r} for joint {i + 1}; it must "
                "be 'revolute' (or 'R') or 'prismatic' (or 'P')."
            )
    return [KINDS[kind] for kind in kinds]


def columns_of_positions(revolute):
    """Where the position of each joint is among trigonometric features.

    Parameters
    ----------
    revolute : sequence of bool
        Whether each joint turns.

    Returns
    -------
    columns : list of list of int
        Two columns, cosine and sine, of a joint that turns; one of a joint that slides.
    """
    ends = list(accumulate(1 + turns for turns in revolute))
    return [list(range(b - 1 - r, b)) for b, r in zip(ends, revolute, strict=True)]


def check_joints(joint_types, n_joints):
    """Whether each of some joints turns.

    Parameters
    ----------
    joint_types : sequence of str or None
        See :func:`are_revolute`; None: all turn.
    n_joints : int
        How many there are.

    Returns
    -------
    revolute : list of bool
        Of length `n_joints`.

    Raises
    ------
    TypeError, ValueError
        If `joint_types` are not the types of so many joints.
    """
    if joint_types is None:
        return [True] * n_joints
    revolute = are_revolute(joint_types)
    if len(revolute) != n_joints:
        raise ValueError(
            f"joint_types={joint_types!r} are those of {len(revolute)} joints, but "
            f"there are {n_joints}."
        )
    return revolute


def check_angles(angles):
    """Raise a ValueError if `angles` is neither "radians" nor "trigonometric"."""
    if angles not in ("radians", "trigonometric"):
        raise ValueError(f"angles={angles!r} must be 'radians' or 'trigonometric'.")


def ends_of(positions):
    """The least and the largest position of each joint, of shape (2, n_joints)."""
    return np.array([positions.min(axis=0), positions.max(axis=0)])


def warn_of_degrees(positions, revolute, names, known=None):
    """Say where joints that turn move so far that angles may be in degrees.

    Continuous joints may wind up for some turns: few of them, and not far, say nothing.

    Parameters
    ----------
    positions : ndarray of shape (n_samples, n_joints)
        Of all joints.
    revolute : sequence of bool
        Which of them turn.
    names : sequence
        Of the columns of the positions.
    known : ndarray of shape (2, n_joints), default=None
        Ends of the positions in training, if these are those of new states. If they
        looked like degrees themselves, `fit` has said so.
    """
    if known is not None:
        if _look_like_degrees(np.ptp(known, axis=0), revolute).any():
            return
        positions = np.concatenate([known, positions])
    spans = np.where(revolute, np.ptp(positions, axis=0), 0.0)
    wide = _look_like_degrees(spans, revolute)
    if not wide.any():
        return
    j, new = int(spans.argmax()), "" if known is None else " with those in training"
    of = ", ".join(
        repr(name) for name, is_wide in zip(names, wide, strict=True) if is_wide
    )
    turns = f"{spans[j]:.4g}, which is {spans[j] / (2.0 * np.pi):.1f} turns"
    warn(
        f"Positions of joints must be in radians, but those of columns {of} span{new} "
        f"up to {turns}. If they are in degrees, convert positions, velocities and "
        "accelerations by np.deg2rad. If joints do turn so often, ignore this warning; "
        "InverseDynamicsFeatures then needs angles='trigonometric'.",
        AngleUnitWarning,
    )


def _look_like_degrees(spans, revolute):
    """Which joints move so far that angles may be in degrees; none if few do."""
    spans = np.where(revolute, spans, 0.0)
    wide = spans > TURNS
    many = 2 * wide.sum() >= np.sum(revolute) > 0
    return wide & (many or (spans > FAR_TURNS).any())


def check_order(names):
    """Raise a ValueError where names say that columns are not in the order q, qd, qdd.

    Parameters
    ----------
    names : sequence
        Of the columns of the states, such as "q1", "vel_2" or "joint3_acc". Others say
        nothing.
    """
    found = [_meaning(name) for name in names]
    if None in found or len(set(found)) < len(found):
        return
    joints = [joint for kind, joint in found if kind == 0]
    wanted = [(kind, joint) for kind in range(3) for joint in joints]
    if found == wanted or sorted(found) != sorted(wanted):
        return
    ordered = [names[found.index(one)] for one in wanted]
    raise ValueError(
        f"X has the columns {list(names)}, in this order, but must have the positions "
        "of all joints first, then all velocities, then all accelerations. Reorder "
        f"them, X[{ordered} + others] for example."
    )


def check_torques(names, columns):
    """Raise a ValueError where names say that torques have another order than joints.

    Parameters
    ----------
    names : sequence
        Of the columns of the states, such as "q1".
    columns : sequence
        Of the columns of the torques, such as "tau1". Others say nothing.
    """
    found = [_meaning(name) for name in names]
    joints = [of[1] for of in found if of is not None and of[0] == 0]
    given = [_number(name) for name in columns]
    if given == joints or None in given or sorted(given) != sorted(joints):
        return
    ordered = [columns[given.index(joint)] for joint in joints]
    raise ValueError(
        f"y has the columns {list(columns)}, but X has the joints in the order "
        f"{joints}. Reorder them, y[{ordered}] for example."
    )


def _number(name):
    """The only number in a name, or None."""
    numbers = re.findall(r"\d+", name) if isinstance(name, str) else []
    return int(numbers[0]) if len(numbers) == 1 else None


def _meaning(name):
    """Kind of a column, 0 to 2, and the number of its joint; or None."""
    if not isinstance(name, str):
        return None
    kind = WORDS.get(re.sub(r"[\d\W_]+|joint", "", name.lower()))
    number = _number(name)
    return None if kind is None or number is None else (kind, number)
