"""Kernels of inverse dynamics: by the book, and on robots with known torques."""

import numpy as np
import pytest

from skmtgp.datasets import puma560_urdf
from skmtgp.kernels import geometric_inverse_dynamics_kernel, inverse_dynamics_kernel
from skmtgp.preprocessing import InverseDynamicsFeatures

TYPES = ["revolute", "prismatic", "R"]
TRIGONOMETRIC = {"angles": "trigonometric", "joint_types": TYPES}
POSITIONS = [0, 1], [2], [3, 4]  # columns of TYPES
SPEEDS, ACCELERATIONS, SIGNS = [5, 6, 7], [8, 9, 10], [11, 12, 13]


def features(n=6, seed=0):
    u = np.random.default_rng(seed).standard_normal((n, 14))
    u[:, SIGNS] = np.sign(u[:, SPEEDS])
    return u


def moved(kernel, seed=0):
    rng = np.random.default_rng(seed)
    return kernel.clone_with_theta(rng.normal(0.0, 0.5, kernel.n_dims))


def by_the_book(theta, u, v):
    """The formula of the docstring, theta in its order: f, c, g, a, v, w."""
    values = iter(np.exp(theta))

    def dot(columns):
        return sum(next(values) * u[d] * v[d] for d in columns)

    friction = dot([*SPEEDS, *SIGNS])
    gravity = next(values) * np.prod([1.0 + dot(of_joint) for of_joint in POSITIONS])
    motion = dot(ACCELERATIONS) + dot(SPEEDS) ** 2
    mass = np.prod([1.0 + dot(of_joint) for of_joint in POSITIONS])
    return friction + gravity + motion * mass**2


def second_joint_by_the_book(theta, u, v):
    """The same of the middle joint: f, f_0, c, g, then a and v as in the Notes."""
    values = iter(np.exp(theta))

    def dot(columns):
        return sum(next(values) * u[d] * v[d] for d in columns)

    def line(of_joint):
        return 1.0 + next(values) * (u[of_joint] @ v[of_joint])

    friction = dot([SPEEDS[1], SIGNS[1]]) + next(values)
    gravity = next(values) * np.prod([line(of_joint) for of_joint in POSITIONS])
    motion = dot(ACCELERATIONS[1:]) + dot(SPEEDS[1:]) ** 2
    carrying = dot(ACCELERATIONS[:1])
    pairs = dot(SPEEDS[:1]) * dot([SPEEDS[0], SPEEDS[2]])
    carrying += pairs * line(POSITIONS[1])
    motion += carrying * line(POSITIONS[1])
    return friction + gravity + motion * line(POSITIONS[2]) ** 2


FORMULAS = {None: by_the_book, 1: second_joint_by_the_book}


@pytest.mark.parametrize("joint", FORMULAS)
def test_geometric_kernel_by_the_book(joint):
    kernel, u = moved(geometric_inverse_dynamics_kernel(TYPES, joint=joint)), features()
    expected = [[FORMULAS[joint](kernel.theta, a, b) for b in u] for a in u]
    np.testing.assert_allclose(kernel(u), expected, rtol=1e-12)
    np.testing.assert_allclose(kernel.diag(u), np.diagonal(expected), rtol=1e-12)


@pytest.mark.parametrize("joint", [None, 0, 1, 2])
def test_gradient_of_the_geometric_kernel(joint):
    kernel, u = moved(geometric_inverse_dynamics_kernel(TYPES, joint=joint)), features()
    _, gradient = kernel(u, eval_gradient=True)
    for p, step in enumerate(1e-5 * np.eye(kernel.n_dims)):
        ahead, behind = (
            kernel.clone_with_theta(kernel.theta + sign * step)(u) for sign in (1, -1)
        )
        found = (ahead - behind) / 2e-5
        scale = np.abs(ahead).max()
        np.testing.assert_allclose(gradient[..., p], found, atol=1e-9 * scale)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_where_a_joint_is_zero_does_not_matter(joint):
    types, zeros = "RPR", np.array([0.4, -1.3, 2.0, 0, 0, 0, 0, 0, 0, 0])
    transformer = InverseDynamicsFeatures(angles="trigonometric", joint_types=types)
    X = np.column_stack([np.random.default_rng(0).normal(size=(6, 9)), np.ones(6)])
    kernel = moved(geometric_inverse_dynamics_kernel(types, joint=joint))
    u, shifted = (transformer.fit_transform(x)[:, :-1] for x in (X, X + zeros))
    np.testing.assert_allclose(kernel(shifted), kernel(u), rtol=1e-12)


def test_trigonometric_kernel_is_the_papers_of_more_columns():
    kernel, u = inverse_dynamics_kernel(3, **TRIGONOMETRIC), features()
    assert kernel.n_dims == 14 + 1 + 1 + 11
    a, b = u[:2]
    expected = 1.0 + a @ b + np.exp(-0.5 * np.square((a - b)[:11]).sum() / np.exp(4.0))
    np.testing.assert_allclose(kernel(u)[0, 1], expected)


@pytest.mark.parametrize(
    "kernel",
    [
        geometric_inverse_dynamics_kernel("RRPR"),
        geometric_inverse_dynamics_kernel("RRPR", joint=2),
        inverse_dynamics_kernel(4, angles="trigonometric"),
    ],
)
def test_starts_within_the_bounds(kernel):
    lower, upper = kernel.bounds.T
    assert (lower < kernel.theta).all()
    assert (kernel.theta < upper).all()


def arm(q, qd, qdd):
    """Torque and force of a mass of 2 kg on an arm that turns and slides, friction."""
    m, g, inertia = 2.0, 9.81, 0.3
    turn = (inertia + m * q[:, 1] ** 2) * qdd[:, 0]
    turn += 2.0 * m * q[:, 1] * qd[:, 0] * qd[:, 1] + m * g * q[:, 1] * np.cos(q[:, 0])
    turn += 0.7 * np.sign(qd[:, 0]) + 0.1 * qd[:, 0]
    slide = m * qdd[:, 1] - m * q[:, 1] * qd[:, 0] ** 2 + m * g * np.sin(q[:, 0])
    return np.column_stack([turn, slide])


def arm_data(n, seed, reach, offset=0.0):
    rng = np.random.default_rng(seed)
    q, qd, qdd = reach * rng.uniform(-1.0, 1.0, (3, n, 2)) + offset
    return np.column_stack([q, qd, qdd, np.ones(n)]), arm(q, qd, qdd)


def test_rigid_bodies_are_known_everywhere_once_they_are_known():
    """Far from the samples, speeds that are not around zero in training."""
    (X, y), (X_far, y_far) = arm_data(300, 0, 1.0, 0.3), arm_data(50, 1, 4.0)
    transformer = InverseDynamicsFeatures(angles="trigonometric", joint_types="RP")
    u, far = transformer.fit_transform(X)[:, :-1], transformer.transform(X_far)[:, :-1]
    for joints in ([None, None], [0, 1]):
        for joint, of_joint, expected in zip(joints, y.T, y_far.T, strict=True):
            kernel = geometric_inverse_dynamics_kernel("RP", joint=joint)
            K = kernel(u) + 1e-9 * np.eye(len(u))
            found = kernel(far, u) @ np.linalg.solve(K, of_joint)
            assert np.square(found - expected).mean() < 1e-8 * expected.var()


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_polynomials_of_a_joint_hold_its_torque(joint):
    """Of three joints of the Puma 560, the others being locked; far states, too."""
    pin = pytest.importorskip("pinocchio")
    puma = pin.buildModelFromXML(puma560_urdf())
    robot = pin.buildReducedModel(puma, [4, 5, 6], np.arange(6.0))
    data, rng = robot.createData(), np.random.default_rng(joint)
    q, qd, qdd = rng.uniform(-3.0, 3.0, (3, 1000, 3))
    states = zip(q, qd, qdd, strict=True)
    y = np.array([pin.rnea(robot, data, *of)[joint] for of in states])
    X = np.column_stack([q, qd, qdd, np.ones(len(q))])
    u = InverseDynamicsFeatures(angles="trigonometric").fit_transform(X)[:, :-1]
    kernel = geometric_inverse_dynamics_kernel("RRR", joint=joint)
    K = kernel(u, u[:900])
    found = K[900:] @ np.linalg.solve(K[:900] + 1e-8 * np.eye(900), y[:900])
    assert np.square(found - y[900:]).mean() < 1e-10 * y.var()


def test_joints_that_turn_come_around():
    (X, _), kernel = arm_data(9, 0, 1.0), geometric_inverse_dynamics_kernel("RP")
    transformer = InverseDynamicsFeatures(angles="trigonometric", joint_types="RP")
    u = transformer.fit_transform(X)[:, :-1]
    X[:, 0] += 2.0 * np.pi
    around = transformer.transform(X)[:, :-1]
    np.testing.assert_allclose(kernel(around, u), kernel(u), rtol=1e-12)
    X[:, 1] += 2.0 * np.pi  # it slides, further
    assert abs(kernel(transformer.transform(X)[:, :-1], u) - kernel(u)).max() > 1.0


@pytest.mark.parametrize(
    ("joint_types", "error", "message"),
    [
        ("", ValueError, "joint_types is empty"),
        (["R", "turning"], ValueError, "'turning' for joint 2; it must be 'revolute'"),
        ("revolute", ValueError, "has 'r' for joint 1"),
        ([True], ValueError, "True for joint 1"),
        (6, TypeError, "joint_types=6 must be a sequence"),
    ],
)
def test_types_of_joints(joint_types, error, message):
    with pytest.raises(error, match=message):
        geometric_inverse_dynamics_kernel(joint_types)


@pytest.mark.parametrize("joint", [-1, 2, 1.0, "tau1", True])
def test_joints_that_there_are_not(joint):
    error = ValueError if joint in (-1, 2) else TypeError
    message = "from 0 to 1: there are 2" if joint in (-1, 2) else "None or an integer"
    with pytest.raises(error, match=message):
        geometric_inverse_dynamics_kernel("RR", joint=joint)


def test_arguments_of_the_trigonometric_kernel():
    with pytest.raises(ValueError, match="angles='degrees' must be 'radians' or"):
        inverse_dynamics_kernel(2, angles="degrees")
    with pytest.raises(
        ValueError, match="'RRR' are those of 3 joints, but there are 2"
    ):
        inverse_dynamics_kernel(2, angles="trigonometric", joint_types="RRR")
