"""Controllers of the robot: feed-forward torques of a model, and a soft spring.

Each period a controller is asked for the torque of the reference (`torque`), which has
to be there in time, and is then told what was measured (`observe`). What it does with
that may take longer: it gives a job, a function without arguments, whose result is
installed (`install`) when the time that it took has passed.
"""

import numpy as np
from plant import CONTROL

from skmtgp import TaskIdentifier
from skmtgp.datasets._robot import inverse_dynamics

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
        states = np.split(ahead[None], 3, axis=1)
        return inverse_dynamics(*map(np.ascontiguousarray, states), self.load)[0]


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


class Identifying(Controller):
    """The learned model of a load whose ten parameters it finds by itself.

    Where the torque that was applied is not what the model says of the measured state,
    the load must be another one. Then the load is estimated from samples, of which each
    comes later than the one before by a half as much again: the first ones hardly
    differ, and tell only what matters now.

    Parameters
    ----------
    predictor : CompiledPredictor
        Of models whose descriptors are the load's ten inertial parameters.
    models : list
        These models.
    loads : ndarray of shape (n_tasks, 10)
        Those that the models know.
    load : ndarray of shape (10,)
        What it carries at first.
    deviations : ndarray of shape (6,)
        Deviation of each joint's torque.
    noise : float
        Share of these that measurements may be off: what moves is no rigid body with
        ideal friction.
    doubt : float
        Share of these by which a prediction must be off, for another load.
    """

    GROWTH, LONGEST = 1.5, 50  # of the periods between two samples
    MOST = 10  # samples; earlier ones were further from the path
    ENOUGH = 40

    def __init__(
        self, predictor, models, loads, load, deviations, *, noise=0.003, doubt=0.05
    ):
        self.predictor, self.known, self.load = predictor, loads, load
        self.identifier = TaskIdentifier(models, noise=noise * deviations)
        self.deviations, self.doubt = deviations, doubt
        self.samples, self.waits, self.gap, self.n_seen = [], 0, 1.0, 0

    def torque(self, ahead):
        """That of the load as it is known now."""
        return self.predictor(ahead, descriptors=self.load)

    def observe(self, state, torque):
        """Wait for a sample that tells, and estimate the load from all of them."""
        self.waits -= 1
        if self.waits > 0 or _reverses(state):
            return None
        if self._known() and not self._surprised(state, torque):
            return None
        if self._known():  # another load than before
            self.samples, self.gap, self.n_seen = [], 1.0, 0
        self.samples = [*self.samples[1 - self.MOST :], (state, torque)]
        self.gap = min(self.GROWTH * self.gap, self.LONGEST)
        self.waits, self.n_seen = round(self.gap), self.n_seen + 1
        X, y = map(np.array, zip(*self.samples, strict=True))
        return lambda: self.identifier.estimate(X, y)[0].to_numpy()

    def _known(self):
        """Whether no more samples of the load are to come."""
        return not self.samples or self.n_seen >= self.ENOUGH

    def _surprised(self, state, torque):
        off = self.predictor(state, descriptors=self.load) - torque
        return (np.abs(off) > self.doubt * self.deviations).any()

    def install(self, result):
        """Take over another estimate of the load, if it says better what happens."""
        X, y = map(np.array, zip(*self.samples[-3:], strict=True))
        best = [self.load, result]
        errors = [self._errors(X, y, load) for load in best]
        self.load = best[int(np.argmin(errors))]

    def _errors(self, X, y, load):
        found = np.array([self.predictor(x, descriptors=load) for x in X])
        return np.square((found - y) / self.deviations).sum()


def _reverses(state):
    """Whether a joint turned back, or stood still, where friction has no one value."""
    _, qd, qdd = np.split(state, 3)
    half = 0.5 * qdd / CONTROL
    slowest = np.minimum(np.abs(qd - half), np.abs(qd + half))
    return ((qd - half) * (qd + half) <= 0.0).any() or (slowest < SLOW).any()
