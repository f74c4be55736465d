"""Controllers of the robot: feed-forward torques of a model, and a soft spring.

In each period a controller must return the torque of the reference in time (`torque`).
Then it gets the measurement (`observe`). Processing that may take longer: the
controller returns a job, a function without arguments. Its result is installed
(`install`) when the time that it took has passed.
"""

import copy

import numpy as np
import pinocchio as pin
from plant import CONTROL, torques
from sklearn.pipeline import Pipeline

from skmtgp import DescriptorTracker, add_task, compile_predictor, partial_fit

STIFFNESS = np.array([400.0, 400.0, 250.0, 40.0, 40.0, 20.0])  # N m/rad
SLOW = 2e-3  # rad/s; friction has no one value where a joint sticks
DAMPING = np.array([60.0, 60.0, 35.0, 4.0, 4.0, 2.0])  # N m s/rad


class Controller:
    """A soft spring and damper alone, which know nothing of the robot."""

    def torque(self, ahead):
        """Feed-forward torque of a state of the reference."""
        return np.zeros(6)

    def spring(self, q, qd, robot):
        """What pulls the robot back to the reference."""
        return STIFFNESS * (q - robot.q) + DAMPING * (qd - robot.qd)

    def picked_up(self, load):
        """The load has changed; only those that are told by the user may look."""

    def observe(self, state, torque):
        """A state that was measured, of shape (18,), and the torque that made it."""

    def install(self, result):
        """Take over what a job has found."""


class RigidBodies(Controller):
    """The true equations of the robot and of a load that does not change."""

    def __init__(self, load=None):
        self.load = load

    def torque(self, ahead):
        """Feed-forward torque of a state of the reference."""
        return torques(ahead, self.load)[0]


class Exact(RigidBodies):
    """The same, and it is told each load."""

    def picked_up(self, load):
        """The load has changed."""
        self.load = load


class Nearest(Controller):
    """The learned model of the known load that is nearest in mass; it is told which."""

    def __init__(self, predictor, loads, task):
        self.predictor, self.loads, self.task = predictor, loads, task

    def torque(self, ahead):
        """Feed-forward torque of a state of the reference."""
        return self.predictor(ahead, self.task)

    def picked_up(self, load):
        """The load has changed."""
        distances = np.abs(self.loads[:, 0] - load[0])
        self.task = self.predictor.tasks[int(distances.argmin())]


class Switching(Nearest):
    """MMST: switch to the model whose predictions err least, here and now.

    Narendra and Balakrishnan (1997). Errors of earlier measurements fade.
    """

    def __init__(self, predictor, deviations, task, fading=0.98):
        super().__init__(predictor, None, task)
        self.deviations, self.fading, self.errors = deviations, fading, 0.0

    def picked_up(self, load):
        """The load has changed."""
        pass

    def observe(self, state, torque):
        """What was measured, and the torque that made it."""
        off = (self.predictor.predict_tasks(state) - torque) / self.deviations
        self.errors = self.fading * self.errors + np.square(off).sum(axis=1)
        self.task = self.predictor.tasks[int(self.errors.argmin())]


class Weighted(Switching):
    """MOSAIC: a mean of the models' torques by their responsibilities.

    Haruno, Wolpert and Kawato (2001). `spread` is the deviation that a right model's
    errors have, relative to that of the torque.
    """

    def __init__(self, predictor, deviations, task, fading=0.98, spread=0.01):
        super().__init__(predictor, deviations, task, fading)
        self.spread = spread
        self.weights = np.equal(predictor.tasks, task).astype(float)

    def torque(self, ahead):
        """Feed-forward torque of a state of the reference."""
        return self.weights @ self.predictor.predict_tasks(ahead)

    def observe(self, state, torque):
        """What was measured, and the torque that made it."""
        super().observe(state, torque)
        off = -0.5 * (self.errors - self.errors.min()) * (1 - self.fading)
        weights = np.exp(off / self.spread**2)
        self.weights = weights / weights.sum()


class Tracking(Controller):
    """A model that is linear in the load's ten parameters, which it finds by itself.

    Each period what was measured is an equation for each joint, except those whose
    friction has no one value.

    Parameters
    ----------
    predictor : CompiledPredictor, Regression or LeastSquares
        What is linear in the load: it has `by_descriptors` and `descriptors`.
    load : ndarray of shape (10,)
        What it carries at first.
    deviations : ndarray of shape (6,)
        Deviation of each joint's torque.
    noise : float
        Share of these that a sample may be off.
    """

    def __init__(self, predictor, load, deviations, *, noise=0.003):
        self.predictor = predictor
        self.tracker = DescriptorTracker(predictor, noise * deviations, load)

    def torque(self, ahead):
        """That of the load as it is known now."""
        constants, slopes = self.predictor.by_descriptors(ahead)
        return constants + slopes @ self.tracker.descriptors

    def observe(self, state, torque):
        """Solve for the load."""
        torque = np.where(_without_a_value(state), np.nan, torque)
        self.tracker.update(state, torque)


class Regression:
    """Models that were learned of one load each, as a linear function of the load.

    Petkos and Vijayakumar (2007): where the equations are linear in the load's
    parameters, models of known loads tell the function.

    Parameters
    ----------
    predictor : CompiledPredictor
        Of models that know each load.
    descriptors : DataFrame of shape (n_loads, 10)
        The loads.
    """

    def __init__(self, predictor, descriptors):
        self.predictor, self.descriptors = predictor, descriptors
        self.outputs, table = predictor.outputs, descriptors.to_numpy(dtype=float)
        self._scale = table.std(axis=0)
        ones = np.ones((len(table), 1))
        self._solve = np.linalg.pinv(np.hstack([ones, table / self._scale]))

    def by_descriptors(self, x):
        """Constants and slopes of the torques."""
        constants, *slopes = self._solve @ self.predictor.predict_tasks(x)
        return constants, np.transpose(slopes) / self._scale


class LeastSquares:
    """Links by least squares on Pinocchio's regressor, linear in the load.

    What a roboticist does who has the robot's description: the load's columns of the
    regressor are those of the last link.

    Parameters
    ----------
    regressor : RigidBodyRegressor
        Fitted to known loads.
    robot : pinocchio.Model
        The description that it was fitted with.
    descriptors : DataFrame of shape (n_loads, 10)
        The loads.
    """

    def __init__(self, regressor, robot, descriptors):
        self.regressor, self.robot, self._data = regressor, robot, robot.createData()
        self.descriptors, self.outputs = descriptors, range(robot.nv)
        self._task, self._load = descriptors.index[0], descriptors.iloc[0].to_numpy()

    def by_descriptors(self, x):
        """Constants and slopes of the torques."""
        columns = pin.computeJointTorqueRegressor(
            self.robot, self._data, *np.split(x, 3)
        )
        slopes = columns[:, -len(self._load) :]
        known = self.regressor.predict([[*x, self._task]])[0]
        return known - slopes @ self._load, slopes


class Joining(Nearest):
    """A model of tasks without descriptors, which a new one joins.

    Where the torque that was applied is not what the model says of the measured state,
    the load must be another one. Samples of it, of which each comes later than the one
    before, join the model: the first four by `add_task`, which learns how the new task
    is related to the others, more of them by `partial_fit`.
    """

    FIRST, MOST, NEW = 4, 60, 99
    GROWTH, LONGEST = 1.5, 200  # of the periods between two samples

    def __init__(self, predictor, models, deviations, task, *, doubt=0.05):
        super().__init__(predictor, None, task)
        self.models, self.deviations, self.doubt = models, deviations, doubt
        self._rehearse()
        self.samples, self.waits, self.gap, self.busy = [], 0, 1.0, False

    def _rehearse(self):
        """Join once before the arm moves: what Python does once takes time."""
        states = 0.1 * np.random.default_rng(0).standard_normal((self.FIRST, 18))
        self.samples = [(state, self.predictor(state, self.task)) for state in states]
        self._joined()

    def picked_up(self, load):
        """The load has changed."""

    def observe(self, state, torque):
        """Wait for a sample that tells, and let it join."""
        self.waits -= 1
        full = len(self.samples) >= self.MOST
        if self.waits > 0 or self.busy or full or _without_a_value(state).any():
            return None
        off = np.abs(self.predictor(state, self.task) - torque)
        if not self.samples and not (off > self.doubt * self.deviations).any():
            return None
        self.samples.append((state, torque))
        self.gap = min(self.GROWTH * self.gap, self.LONGEST)
        self.waits = round(self.gap)
        self.busy = len(self.samples) >= self.FIRST
        return self._joined if self.busy else None

    def _joined(self):
        """Models that know the samples, and what they predict."""
        first = self.task != self.NEW
        X, y = map(np.array, zip(*self.samples[0 if first else -1 :], strict=True))
        X, models = np.column_stack([X, np.full(len(X), self.NEW)]), {}
        features = next(iter(self.models.values()))[:-1]  # the same for all joints
        X = features.transform(X)
        for (name, model), target in zip(self.models.items(), y.T, strict=True):
            if first:
                last = add_task(model[-1], X, target)
            else:  # a copy: what is learned counts when its time has passed
                last = partial_fit(copy.copy(model[-1]), X, target)
            models[name] = Pipeline([*model.steps[:-1], (model.steps[-1][0], last)])
        return models, compile_predictor(models, self.NEW, follow=False)

    def install(self, result):
        """Take over models that know more."""
        self.models, self.predictor = result
        self.task, self.busy = self.NEW, False


def _without_a_value(state):
    """Which joints turned back, or stood still, where friction has no one value."""
    _, qd, qdd = np.split(state, 3)
    half = 0.5 * qdd / CONTROL
    slowest = np.minimum(np.abs(qd - half), np.abs(qd + half))
    return ((qd - half) * (qd + half) <= 0.0) | (slowest < SLOW)
