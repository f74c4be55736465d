"""Least squares on the regressor of a robot: what is done without learning kernels."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from numbers import Integral
from typing import Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, helmert
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_new_task, check_training
from skmtgp._data.joints import check_torques, ends_of
from skmtgp._data.labels import rows_by_code
from skmtgp._data.task_column import locate
from skmtgp._estimators.doubts import warn_of_noise
from skmtgp._estimators.estimator import Estimator, fitting, public
from skmtgp._estimators.predicting import PosteriorMixin
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.sklearn_compat import StrOptions, fit_context, with_callbacks
from skmtgp.robot._columns import Columns, check_friction
from skmtgp.robot._dynamics import INERTIAL, Dynamics
from skmtgp.robot._one_state import Torques
from skmtgp.robot._solving import evidence, join, plain, solve, typical

BLIND = 1e-6  # share of a direction that the data do not show, above which it counts


class RigidBodyRegressor(PosteriorMixin, Estimator):
    r"""Torques of a robot by least squares, with one load for each task.

    .. math::
        \tau_j = \Phi_j(q, \dot q, \ddot q)^T \beta
        + \Psi_j(q, \dot q, \ddot q)^T \delta_m + e_j, \qquad
        e_j \sim \mathcal N(0, \sigma_j^2)

    All joints and tasks share beta, the base parameters of the links and of friction.
    Each task m has a load that is fixed to the last link, with the inertial parameters
    delta_m.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        The robot: file of a URDF, its text, or a Pinocchio model. Its J joints have one
        degree of freedom each, and are in the order of the columns of X. Only the
        positions of joints and links matter, not their masses.
    friction : str, sequence of str or None, default=("viscous", "asymmetric", "rotor")
        Torques of each joint besides those of rigid bodies, see
        :class:`RigidBodyFeatures`.
    prior : {"evidence", "nominal"} or None, default=None
        None is least squares. "evidence" is a normal prior around 0. Links, friction
        and loads have one variance each, in units of what a parameter typically
        contributes to the torques. What asymmetric friction differs by in the two
        directions has another one, unless "coulomb" or "offset" stands beside it. The
        variances are those that make the data likeliest. If they show no difference of
        directions, there is none. "nominal" is such a prior around the masses and
        inertias of the model, for links in units of each link's own mass and extent. It
        suits motion that does not show all of them. y must then be torques, and the
        model must have the masses and inertias of such a robot.
    joint : int, str or None, default=None
        Position from 0, or name, of the joint whose torque is y. None means that y has
        a column for each joint.
    empty_task : int or str, default=None
        Label of the task without a load. None means that loads are relative to their
        mean over all tasks, which counts as a part of the last link.
    task_feature : int or str, default=-1
        Position or name of the task column. The other columns are, from left to right,
        positions q1..qJ (rad, or m where a joint slides), velocities and accelerations.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    parameters_ : DataFrame of shape (n_parameters, 2)
        Value and standard deviation ("value", "std") of each base parameter of the
        links (kg, kg m, kg m^2) and of friction. See
        :meth:`RigidBodyFeatures.get_feature_names_out` for their names.
    load_parameters_ : DataFrame of shape (n_tasks, n_load)
        Mass "m" (kg), first moments "mc_x", ... (kg m) and inertia "I_xx", ... (kg m^2)
        of each task's load, about the origin and in the axes of the last joint's frame.
        The torque of a single joint does not determine all ten. Those left out are
        included in the others.
    load_covariance_ : ndarray of shape (n_tasks, n_load, n_load)
        Their covariance. Variances are infinite for what the data do not show; of a
        load that joined they are those of its prior.
    noise_variance_ : float or ndarray of shape (n_joints,)
        Noise variance of each joint, in squared units of y.
    y_train_ : ndarray of the shape of y
        Targets in training.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    RigidBodyFeatures : The features of one joint, for other models.
    skmtgp.MultiTaskGPRegressor : Needs no model of the robot.

    Notes
    -----
    Rows of a joint are weighted by the inverse of its noise variance. Noise variances
    and coefficients are learned in turn. A noise variance is the remaining sum of
    squares divided by the number of rows that the coefficients do not use up.

    If the data do not show a direction of the parameters, least squares takes the
    shortest of the solutions that fit equally well, in units of what each parameter
    typically contributes. Predictions that depend on such a direction have an infinite
    standard deviation.

    With ``prior="nominal"`` the ten inertial parameters of a link of mass m vary on
    their own, by a common factor times m, m r and m r^2, where r is the link's radius
    of gyration about the origin of its joint. The base parameters, which are sums of
    these, have the covariance that follows: a mass that the hand holds shows in all
    joints at once.

    The parameters need not be those of a physical body: a mass may be negative if the
    data say little about it.

    Memory and time are linear in the number of samples and quadratic in the number of
    parameters: n_load for each task and about ten for each joint.

    References
    ----------
    .. [1] C. H. An, C. G. Atkeson, J. M. Hollerbach, "Estimation of inertial parameters
       of rigid body links of manipulators", CDC 1985, 990-995.
    .. [2] C. G. Atkeson, C. H. An, J. M. Hollerbach, "Estimation of inertial parameters
       of manipulator loads and links", International Journal of Robotics Research
       5(3), 101-119, 1986.

    Examples
    --------
    >>> from skmtgp.datasets import load_puma560, puma560_urdf
    >>> from skmtgp.robot import RigidBodyRegressor
    >>> X, y = load_puma560(n_per_load=50, loads=[1, 8, 15], return_X_y=True)
    >>> model = RigidBodyRegressor(puma560_urdf(), empty_task=1).fit(X, y)
    >>> model.load_parameters_["m"].round(3).tolist()  # of 0.2, 1.6 and 3 kg
    [0.0, 1.4, 2.8]
    >>> X, y = load_puma560(
    ...     n_per_load=50, loads=[1, 8, 15], subset="extrapolation", return_X_y=True
    ... )
    >>> bool(abs(model.predict(X) - y).max() < 1e-8)
    True
    """

    _ends = None  # of positions in `fit`
    _parameter_constraints = {
        "prior": [StrOptions({"evidence", "nominal"}), None],
        "joint": [Integral, str, None],
        "empty_task": [Integral, str, None],
        "task_feature": [Integral, str],
    }

    verbose = 0  # it takes no time

    def __init__(
        self,
        model: Any,
        *,
        friction: str | Sequence[str] | None = ("viscous", "asymmetric", "rotor"),
        prior: Literal["evidence", "nominal"] | None = None,
        joint: int | str | None = None,
        empty_task: int | str | None = None,
        task_feature: int | str = -1,
    ) -> None:
        self.model = model
        self.friction = friction
        self.prior = prior
        self.joint = joint
        self.empty_task = empty_task
        self.task_feature = task_feature

    @public
    @with_callbacks
    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn the parameters of links, friction and loads, and the noise variances.

        Parameters
        ----------
        X : array-like of shape (n_samples, 3 * n_joints + 1)
            Positions, velocities, accelerations and the task.
        y : array-like of shape (n_samples, n_joints) or, with `joint`, (n_samples,)
            Torques in N m (N if a joint slides), or motor currents.

        Returns
        -------
        self : RigidBodyRegressor
            Fitted.

        Raises
        ------
        ImportError
            If Pinocchio is not installed.
        FileNotFoundError
            If there is no such model.
        TypeError, ValueError
            If a parameter, the model, a feature, a label or a target cannot be used.
            The estimator is then as it was before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            training = check_training(self, X, y)
            self._set_columns()
            names = locate(self)[1]
            self._columns.dynamics.check_states(training[0], names)
            check_torques(names, list(getattr(y, "columns", [])))
            with limit_threads(self.n_features_in_):
                self._fit(*training, progress)
        return self

    def _set_columns(self):
        dynamics, words = Dynamics(self.model), check_friction(self.friction)
        joints = range(dynamics.n_joints)
        if self.joint is not None:
            joints = [dynamics.position_of(self.joint)]
        self._columns = Columns(dynamics, words, joints)

    def _fit(self, x, codes, tasks, y, progress):
        y = np.array(y)  # otherwise y itself, which the user may change
        self.tasks_, self._single_output = tasks, y.ndim == 1
        self._ends = ends_of(self._columns.dynamics.states(x)[0])
        self.y_train_, Y = y, y.reshape(len(y), -1)
        self._check_outputs(Y)
        columns, load = self._columns.of(x)
        self._scale = typical(columns, Y), typical(load, Y)
        self._set_prior(tasks, columns, Y)
        design = self._whole(x, codes)
        solution, noise, self._freedom = solve(
            design @ self._matrix, Y - design @ self._centre, self._method()
        )
        warn_of_noise((self._freedom >= 1.0)[:, None])
        self._noise_variances = noise
        self._keep(solution)

    def _set_prior(self, tasks, columns, Y):
        """Set the coordinates in which coefficients have a prior around 0."""
        (scale, of_load), n_links = self._scale, self._columns.n_links
        links, friction = np.eye(n_links), [np.eye(len(scale) - n_links)]
        to_loads = np.kron(self._code(tasks), np.eye(len(of_load)))
        centre = np.zeros(len(scale) + len(to_loads))
        if self.prior is not None:
            friction = self._directions(columns, Y)
        if self.prior == "nominal":
            self._check_masses()
            links = self._columns.spread * scale[:n_links, None]
            centre[: len(scale)] = self._columns.nominal * scale
        blocks = links, np.hstack(friction), to_loads
        self._matrix, self._centre = block_diag(*blocks), centre
        sizes = [part.shape[1] for part in (links, *friction, to_loads)]
        every = np.arange(self._matrix.shape[1])
        self._groups = np.split(every, np.cumsum(sizes)[:-1])

    def _directions(self, columns, Y):
        """Friction of one direction, and of both, each in its typical units."""
        known, n = self._columns, self._columns.n_links
        both = columns @ block_diag(np.eye(n), known.both_ways)
        size = typical(both, Y)[n:]
        return known.one_way, self._scale[0][n:, None] * known.both_ways / size

    def _check_masses(self):
        if not self._columns.spread.any():
            raise ValueError(
                "prior='nominal' needs the masses of the links, and the model has "
                "none. Set prior='evidence'."
            )

    def _method(self):
        """How coefficients are found."""
        if self.prior is None:
            return plain
        return partial(evidence, groups=self._groups)

    def _check_outputs(self, Y):
        n, names = len(self._columns.joints), self._columns.dynamics.names
        if Y.shape[1] != n:
            expected = f"a column for each joint of the model, {names}"
            if self.joint is not None:
                expected = f"the torque of joint={self.joint!r} alone"
            advice = " Set joint to learn one of them." * (self.joint is None)
            raise ValueError(
                f"y has {Y.shape[1]} columns, but must have {expected}.{advice}"
            )

    def _code(self, tasks):
        """The load of each task, of shape (n_tasks, n_loads), of loads to learn."""
        if self.empty_task is None:  # their mean is 0
            n = len(tasks)
            return helmert(n).T if n > 1 else np.empty((1, 0))
        labels = tasks.tolist()
        if self.empty_task not in labels:
            raise ValueError(
                f"empty_task={self.empty_task!r} is none of the tasks, {labels[:5]}."
            )
        return np.delete(np.eye(len(tasks)), labels.index(self.empty_task), axis=1)

    def _keep(self, solution):
        """Set what is known of links, friction and the load of each task."""
        matrix, self._precision = self._matrix, solution.precision
        self._coef = self._centre + matrix @ solution.coef
        self._factor = matrix @ solution.factor
        self._blind = matrix @ solution.blind
        self._store()

    def _store(self):
        """Set the public attributes, in units of y."""
        n, r, n_tasks = *map(len, self._scale), len(self.tasks_)
        scale = np.concatenate([self._scale[0], np.tile(self._scale[1], n_tasks)])
        values = self._coef / scale
        factor = self._factor / scale[:, None]
        covariance = factor @ factor.T
        hidden = (np.abs(self._blind) > BLIND).any(axis=1)
        covariance[hidden, hidden] = np.inf
        std = np.sqrt(np.diagonal(covariance))
        self._parameters = np.column_stack([values[:n], std[:n]])
        self._loads = values[n:].reshape(n_tasks, r)
        blocks = covariance[n:, n:].reshape(n_tasks, r, n_tasks, r)
        same = np.arange(n_tasks)
        self.load_covariance_ = blocks[same, :, same]
        noise = self._noise_variances
        self.noise_variance_ = float(noise[0]) if self._single_output else noise

    @property
    def parameters_(self) -> pd.DataFrame:
        """What is known of links and friction, as a table that is made anew."""
        check_is_fitted(self)
        names = self._columns.names
        return pd.DataFrame(self._parameters.copy(), names, ["value", "std"])

    @property
    def load_parameters_(self) -> pd.DataFrame:
        """What is known of the loads of the tasks, as a table that is made anew."""
        check_is_fitted(self)
        names = [INERTIAL[j] for j in self._columns.load]
        tasks = pd.Index(self.tasks_, name="task")
        return pd.DataFrame(self._loads.copy(), tasks, names)

    @public
    def add_task(
        self, X: ArrayLike, y: ArrayLike, *, prior: Literal["tasks"] | None = "tasks"
    ) -> Self:
        """Learn the load of a new task; links, friction and noise stay as they are.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs of the new task, with its label. A few samples are enough.
        y : array-like of the other dimensions of the training targets
            Torques of the new task.
        prior : {"tasks"} or None, default="tasks"
            "tasks" is a normal prior with the mean and the covariance of the known
            loads, and with as much variance again in all directions as they have on
            average. Rows of a short motion show few of a load's ten numbers. The prior
            tells the others. None is least squares, whose torques may then be many
            times too large.

        Returns
        -------
        model : RigidBodyRegressor
            A new fitted model, which also knows the new task, as the last one. The
            present model does not change.

        Raises
        ------
        TypeError, ValueError
            If the task is already known, or X or y cannot be used, or `prior` is none
            of these.
        """
        if prior not in ("tasks", None):
            raise ValueError(f"prior={prior!r} must be 'tasks' or None.")
        check_is_fitted(self)
        x, label, Y = check_new_task(self, X, y)
        columns, load = self._columns.of(x)
        columns, load = columns / self._scale[0], load / self._scale[1]
        left = Y - columns @ self._coef[: columns.shape[2]]
        mean, root, precision = self._population(prior)
        rest = left - load @ mean
        new = join(load @ root, rest, self._noise_variances, precision)
        model = copy(self)
        model.tasks_ = np.append(self.tasks_, label)
        model._coef = np.append(self._coef, mean + root @ new.coef)
        model._factor = block_diag(self._factor, root @ new.factor)
        model._blind = block_diag(self._blind, root @ new.blind)
        model._store()
        return model

    def _population(self, prior):
        """Mean of a load, a root of its covariance, and precision in these units."""
        n, n_load = map(len, self._scale)
        mean, root = np.zeros(n_load), np.eye(n_load)
        if prior is None:
            return mean, root, 0.0
        known = self._coef[n:].reshape(-1, n_load)
        size = np.square(known).mean()
        if size == 0.0:  # no load is known: torques as large as the robot's
            return mean, root, 1.0
        covariance = np.atleast_2d(np.cov(known.T, bias=True)) + size * root
        return known.mean(axis=0), np.linalg.cholesky(covariance), 1.0

    def _compile(self, code):
        """Torques of one state of a task, as a function, see `compile_predictor`."""
        return Torques(self, code)

    @property
    def _side(self):
        return self.n_features_in_

    @property
    def _n_outputs(self):
        return len(self._noise_variances)

    def _rows(self, features, codes):
        """What predictions are linear in, a row for each sample and joint, by task.

        Yields the positions of a task's samples, those of its coefficients, and the
        columns of these, of shape (n_rows, n_joints, n_columns).
        """
        n, r = map(len, self._scale)
        for code, rows in zip(*rows_by_code(codes), strict=True):
            columns, load = self._columns.of(features[rows])
            parts = [columns / self._scale[0], load / self._scale[1]]
            own = np.r_[:n, n + code * r : n + (code + 1) * r]
            yield rows, own, np.concatenate(parts, axis=2)

    def _means(self, features, codes):
        dynamics = self._columns.dynamics
        q, names = dynamics.states(features)[0], locate(self)[1]
        dynamics.check_positions(q, names, self._ends)
        means = np.empty((len(features), len(self._noise_variances)))
        for rows, own, A in self._rows(features, codes):
            means[rows] = A @ self._coef[own]
        return means

    def _noise(self, codes):
        return np.tile(self._noise_variances, (len(codes), 1))

    def _variances(self, features, codes, include_noise):
        variances = float(include_noise) * self._noise(codes)
        for rows, own, A in self._rows(features, codes):
            variances[rows] += np.square(A @ self._factor[own]).sum(axis=2)
            unseen = (np.abs(A @ self._blind[own]) > BLIND).any(axis=2)
            variances[rows] += np.where(unseen, np.inf, 0.0)
        return variances

    def _covariances(self, features, codes, include_noise):
        A = self._whole(features, codes) @ self._factor
        covariances = np.einsum("njp,mjp->nmj", A, A)
        same = np.arange(len(features))
        covariances[same, same] = self._variances(features, codes, include_noise)
        return covariances

    def _draws(self, features, codes, n_draws, rng):
        """Draws of the parameters, which all joints and tasks have in common."""
        A = self._whole(features, codes)
        z = rng.standard_normal((self._factor.shape[1], n_draws))
        return A @ (self._coef[:, None] + self._factor @ z), np.sqrt(
            self._noise(codes)
        )[..., None]

    def _whole(self, features, codes):
        """Rows of the coefficients of all tasks."""
        n, r = map(len, self._scale)
        n_columns = n + r * len(self.tasks_)
        whole = np.zeros((len(features), len(self._columns.joints), n_columns))
        for rows, own, A in self._rows(features, codes):
            whole[rows[:, None], :, own] = A.swapaxes(1, 2)
        return whole
