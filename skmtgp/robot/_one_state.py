"""Torques of one state and one task, in the fewest steps: predictions that are due."""

import numpy as np

from skmtgp.model._nodes import compile_kernel, fold
from skmtgp.robot._columns import FRICTION
from skmtgp.robot._rest import NONE


class Torques:
    """The torques of a fitted robot that carries one load, a plain array in and out.

    Parameters
    ----------
    model : RigidBodyRegressor
        Fitted; a SemiparametricRegressor has processes, too.
    code : int
        Position of the task.
    """

    def __init__(self, model, code):
        columns = model._columns
        self.dynamics, self.joints = columns.dynamics, columns.joints
        self.bodies, friction = _parameters(model, model._coef, code)
        self.friction = _by_name(columns, friction)
        self.rests = [
            (i, rest.features, _process(model, i, code))
            for i, rest in enumerate(getattr(model, "_rests", ()))
            if rest.name != NONE
        ]
        if self.rests:  # which depend on torques as they were when they were learned
            self.known, _ = _parameters(model, model._known, code)

    def __call__(self, x):
        regressor = self.dynamics.regressor_at(x)[self.joints]
        torques = regressor @ self.bodies
        _, qd, qdd = x.reshape(3, -1)[:, self.joints]
        for word, name, weights in self.friction:
            torques += weights * FRICTION[word][name](qd, qdd)
        if self.rests:
            link = regressor @ self.known
            for i, features, process in self.rests:
                torques[i] += process(features(x[None], link[i : i + 1])[0])[0, 0]
        return torques


def _parameters(model, coef, code):
    """Of the links with the load, (10 J,), and of friction."""
    columns, (scale, of_load) = model._columns, model._scale
    n, r = len(scale), len(of_load)
    own = coef[:n] / scale
    load = coef[n + code * r : n + (code + 1) * r] / of_load
    bodies = np.zeros(10 * columns.dynamics.n_joints)
    bodies[columns._links] = own[: columns.n_links]
    bodies[columns._last + np.array(columns.load, dtype=int)] += load
    return bodies, own[columns.n_links :]


def _by_name(columns, values):
    """Of each part of friction its word, its name and the weight of each joint."""
    found = dict(zip(columns.names[columns.n_links :], values, strict=True))
    names = [columns.dynamics.names[j] for j in columns.joints]
    return [
        (word, name, np.array([found.get(f"{name}({joint})", 0.0) for joint in names]))
        for word in columns.words
        for name in FRICTION[word]
    ]


def _process(model, i, code):
    """Mean of the process of a joint, as a function of its features."""
    rest, (Z, tasks) = model._rests[i], model._trained[i]
    weights = model._factors[i].half_solve(model._left[i], transposed=True)
    B = rest.model.task_covariance_[tasks, code] * weights
    kernel = rest.model.kernel_
    return fold([compile_kernel(kernel).bind(kernel.theta, Z)], B[None, :, None])
