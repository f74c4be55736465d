"""What tests of rigid bodies share: states, and torques that Pinocchio computes."""

import numpy as np


def states(n, n_joints=6, seed=0):
    """Positions, velocities, accelerations at random, and a task."""
    rng = np.random.default_rng(seed)
    return np.hstack([rng.normal(size=(n, 3 * n_joints)), np.ones((n, 1))])


def rnea(model, X):
    """Torques of a model of joints of which none turns without end."""
    import pinocchio as pin

    data = model.createData()
    rows = (np.split(row, 3) for row in X[:, :-1])
    return np.array([pin.rnea(model, data, *row) for row in rows])


def two_joints(first="revolute", second="prismatic"):
    """URDF of a small robot."""
    body = (
        '<inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/><inertia ixx="0.3" '
        'ixy="0.01" ixz="0.02" iyy="0.4" iyz="0.03" izz="0.5"/></inertial>'
    )
    limit = '<limit lower="-9" upper="9" effort="9" velocity="9"/>'
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>'
        '<origin xyz="0 0 0.5" rpy="0.4 0.2 0"/><axis xyz="0 1 0"/>' + limit
    )
    return (
        '<robot name="two"><link name="a"/>'
        f'<link name="b">{body}</link><link name="c">{body}</link>'
        + joint.format("shoulder", first, "a", "b")
        + "</joint>"
        + joint.format("slide", second, "b", "c")
        + "</joint></robot>"
    )
