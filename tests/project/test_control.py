"""The robot of the control example moves as the equations of the data say."""

import functools
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pinocchio")
sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "control"))
plant = pytest.importorskip("plant")
controllers = pytest.importorskip("controllers")
run = pytest.importorskip("run")
sys.path.pop(0)

from skmtgp import (  # noqa: E402
    MultiTaskGPRegressor,
    add_task,
    compile_predictor,
    partial_fit,
)
from skmtgp.datasets import load_puma560  # noqa: E402
from skmtgp.datasets._robot import inverse_dynamics  # noqa: E402

LOAD = load_puma560(n_per_load=1).loads.iloc[14, -10:].to_numpy(float)
REFERENCE = plant.Reference(4, 4)


@pytest.fixture(autouse=True, scope="module")
def made_once():
    """The paths, which are searched for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plant, "Reference", functools.cache(plant.Reference))
        yield


def torque_of(states):
    parts = np.split(np.atleast_2d(states), 3, axis=1)
    return inverse_dynamics(*map(np.ascontiguousarray, parts), LOAD)


def follow(n, controller):
    """Errors of some periods, and what was measured."""
    robot = plant.Puma(REFERENCE.q[0], REFERENCE.qd[0], LOAD)
    errors, measured = [], []
    for k in range(n):
        spring = controller.spring(REFERENCE.q[k], REFERENCE.qd[k], robot)
        torque = controller.torque(REFERENCE.ahead[k]) + spring
        q, qd = robot.q, robot.qd
        robot.step(torque)
        rate = plant.CONTROL * (robot.qd - qd)
        middle = 0.5 * (q + robot.q), 0.5 * (qd + robot.qd), rate
        measured.append((np.concatenate(middle), torque))
        errors.append(REFERENCE.q[k + 1] - robot.q)
    return np.array(errors), measured


def test_the_exact_torques_keep_it_on_its_path():
    exact, _ = follow(300, controllers.Exact(LOAD))
    assert np.abs(exact).max() < 3e-4
    alone, _ = follow(300, controllers.Controller())
    assert np.abs(alone).max() > 100 * np.abs(exact).max()


def test_what_is_measured_obeys_the_equations():
    _, measured = follow(200, controllers.Exact(LOAD))
    errors = [torque_of(state)[0] - torque for state, torque in measured]
    size = np.abs([torque for _, torque in measured]).max(axis=0)
    assert (np.median(np.abs(errors), axis=0) < 1e-3 * size).all()


def test_friction_holds_it():
    """At rest, by the torque of gravity and a little more, no joint moves."""
    rest = np.concatenate([REFERENCE.q[0], np.zeros(12)])
    robot = plant.Puma(rest[:6], np.zeros(6), LOAD)
    for _ in range(50):
        robot.step(torque_of(rest)[0] + 0.3 * plant.LARGEST)
    np.testing.assert_allclose(robot.q, rest[:6], atol=1e-12)
    for _ in range(50):
        robot.step(torque_of(rest)[0] + 2.0 * plant.LARGEST)
    assert (robot.q[:3] > rest[:3] + 1e-4).all()


def test_a_load_changes_what_a_torque_does():
    robot = plant.Puma(REFERENCE.q[0], np.zeros(6), None)
    held = torque_of(np.concatenate([REFERENCE.q[0], np.zeros(12)]))[0]
    robot.carry(LOAD)
    robot.step(held)
    assert np.abs(robot.qd).max() < 1e-10
    robot.carry(None)
    for _ in range(20):
        robot.step(held)
    assert np.abs(robot.qd).max() > 1e-2


def test_a_joint_that_turns_back_or_stands_still_tells_nothing():
    state = np.concatenate([np.zeros(6), np.full(6, 0.5), np.zeros(6)])
    assert not controllers._without_a_value(state).any()
    state[6], state[12] = 1e-3, -10.0  # before the period it moved the other way
    state[8] = 0.0
    assert np.flatnonzero(controllers._without_a_value(state)).tolist() == [0, 2]


def test_a_load_is_tracked_though_a_joint_stands_still():
    light = Equations.descriptors.iloc[0].to_numpy(float)
    controller = controllers.Tracking(Equations(), light, np.full(6, 10.0))
    for state in REFERENCE.ahead[[300, 600, 900]].copy():
        state[[10, 16]] = 0.0  # the fifth joint, whose torque could be any
        torque = torque_of(state)[0] + 7.0 * np.eye(6)[4]
        controller.observe(state, torque)
    assert controller.tracker.descriptors[0] == pytest.approx(LOAD[0], abs=0.03)


def test_a_task_that_joins_is_that_of_each_joints_pipeline():
    """And what is learned counts only when it is installed."""
    rng = np.random.default_rng(0)
    states, factors = rng.standard_normal((12, 18)), (1.0, 0.5, 0.2)
    X = np.vstack([np.column_stack([states, np.full(12, m)]) for m in range(3)])
    y = np.vstack([plant.torques(states, factor * LOAD) for factor in factors])[:, 1:3]
    model = MultiTaskGPRegressor(rank=1, max_iter=0, learning="staged")
    make = functools.partial(run.make_model, model, kernel="geometric")
    models = {j: make().fit(X, y[:, j]) for j in range(2)}
    controller = controllers.Joining(compile_predictor(models), models, np.ones(2), 1)
    new, y = np.column_stack([states[:5], np.full(5, controller.NEW)]), 1.5 * y[:5]
    samples = list(zip(states[:5], y, strict=True))
    controller.samples = samples[:4]
    controller.install(controller._joined())
    controller.samples = samples
    after, _ = controller._joined()
    for j, of in models.items():
        expected = add_task(of, new[:4], y[:4, j])
        found = controller.models[j].predict(new)
        np.testing.assert_allclose(found, expected.predict(new), rtol=1e-9)
        more = partial_fit(expected, new[4:], y[4:, j]).predict(new)
        np.testing.assert_allclose(after[j].predict(new), more, rtol=1e-9)
        assert not np.allclose(more, found, rtol=1e-9)


class Equations:
    """What the equations of the data sets say, as a linear function of the load."""

    outputs = range(6)
    descriptors = load_puma560(n_per_load=1).loads.iloc[:14, -10:]

    def by_descriptors(self, x):
        load = self.descriptors.mean().to_numpy()
        around = plant.torques(x, load)[0]
        other = [plant.torques(x, load + step)[0] for step in np.eye(10)]
        slopes = np.transpose(other) - around[:, None]
        return around - slopes @ load, slopes


def test_a_load_is_tracked():
    """With the true equations the first sample after the pick-up is enough."""
    light = Equations.descriptors.iloc[0].to_numpy(float)
    deviations = np.array([20.0, 20.0, 10.0, 2.0, 2.0, 1.0])
    controller = controllers.Tracking(Equations(), light, deviations)
    robot, errors = plant.Puma(REFERENCE.q[900], REFERENCE.qd[900], light), []
    for k in range(900, 960):
        if k == 910:
            robot.carry(LOAD)
        spring = controller.spring(REFERENCE.q[k], REFERENCE.qd[k], robot)
        torque = controller.torque(REFERENCE.ahead[k]) + spring
        q, qd = robot.q, robot.qd
        robot.step(torque)
        rate = plant.CONTROL * (robot.qd - qd)
        middle = 0.5 * (q + robot.q), 0.5 * (qd + robot.qd), rate
        controller.observe(np.concatenate(middle), torque)
        errors.append(np.linalg.norm(REFERENCE.q[k + 1] - robot.q))
    assert controller.tracker.n_changes >= 1
    assert controller.tracker.descriptors[0] == pytest.approx(LOAD[0], abs=0.03)
    assert max(errors) < 1e-3


def test_models_of_loads_are_a_linear_function_of_the_load():
    class Models:
        outputs = range(6)

        def predict_tasks(self, x):
            loads = Equations.descriptors.to_numpy(float)
            return np.array([plant.torques(x, load)[0] for load in loads])

    regression = controllers.Regression(Models(), Equations.descriptors)
    state = REFERENCE.ahead[700]
    constants, slopes = regression.by_descriptors(state)
    np.testing.assert_allclose(
        constants + slopes @ LOAD, torque_of(state)[0], rtol=1e-6
    )


@pytest.mark.long
def test_links_by_least_squares_are_a_linear_function_of_the_load():
    rigid = run.least_squares(Equations.descriptors.to_numpy(float), n_shaken=100)
    constants, slopes = rigid.by_descriptors(REFERENCE.ahead[700])
    torque = torque_of(REFERENCE.ahead[700])[0]
    np.testing.assert_allclose(constants + slopes @ LOAD, torque, rtol=1e-8)


@pytest.mark.long
def test_training_states_shake_about_the_paths():
    states = plant.training_states(20, 200, np.random.default_rng(0))
    steady, shaken = (np.abs(part[:, 12:]).mean() for part in np.split(states, [20]))
    assert shaken > 5 * steady
    assert np.abs(states).max() < 10
