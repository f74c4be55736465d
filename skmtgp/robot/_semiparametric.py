"""Rigid bodies with friction, and a Gaussian process of what they leave."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from numbers import Integral
from operator import itemgetter
from typing import Any, Literal, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_new_task
from skmtgp._estimators.doubts import warn_of_duration
from skmtgp._estimators.estimator import public
from skmtgp._estimators.predicting import JOINTLY, check_joint
from skmtgp._numerics.linalg import draw_normal
from skmtgp._numerics.parallel import limit_threads, run
from skmtgp._support.sklearn_compat import StrOptions
from skmtgp._support.warnings import warn
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.robot._regressor import BLIND, RigidBodyRegressor
from skmtgp.robot._rest import (
    NONE,
    Features,
    check_rest,
    choose,
    foresee,
    log_det,
    whiten,
)
from skmtgp.robot._solving import SMALLEST, evidence, join, power_of, solve

# Of learning what is left and, given that, links and friction anew: the first rest is
# that of least squares, which has taken a part of it for links. More than two changed
# errors by less than they differ between draws.
N_ROUNDS = 2
REST = "friction", "neighbours", "friction+neighbours"
STARTS = "", "from the model's links, "
PARTS = "links", "friction", "load", "process"
ROUNDING = 1e-20  # power of what is left relative to that of the torque
CHUNK = 500  # rows of predictions at a time: columns of all tasks' loads are many


def chunks(n):
    """Slices of so many rows."""
    return [slice(begin, begin + CHUNK) for begin in range(0, n, CHUNK)]


class SemiparametricRegressor(RigidBodyRegressor):
    r"""Torques of a robot: rigid bodies, friction, and a process for the rest.

    .. math::
        \tau_j = \Phi_j(q, \dot q, \ddot q)^T \beta
        + \Psi_j(q, \dot q, \ddot q)^T \delta_m + g_j^m(z_j) + e_j

    The first two terms are those of :class:`RigidBodyRegressor`: the base parameters
    beta of links and friction, which all joints and tasks share, and the load delta_m
    of each task m. The third is a Gaussian process of a few features z_j of joint j,

    .. math::
        \mathrm{cov}(g_j^m(z), g_j^{m'}(z')) = K^{\rho j}_{mm'} k_j(z, z')

    with its own task covariance. k_j is a squared exponential, an exponential or the
    sum of both, times a factor of the joint's direction. A criterion decides for each
    joint whether it has such a process. All three terms have a joint normal
    distribution: what the process explains, the links do not.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        The robot: file of a URDF, its text, or a Pinocchio model. Its J joints have one
        degree of freedom each, and are in the order of the columns of X. Only the
        positions of joints and links matter, not their masses.
    friction : str, sequence of str or None, default=("viscous", "asymmetric", "rotor")
        Torques of each joint besides those of rigid bodies, see
        :class:`RigidBodyFeatures`.
    rest : str, sequence of str or None
        What the process of a joint depends on. By default it is one of the first,
        the second and their sum, whichever is best for the joint, or none of them.

        - "friction": the joint's speed and the torque of the rigid bodies along it, for
          effects of bearings and gears. It changes its sign with the direction. With
          asymmetric friction it may also differ by direction, where that is better; if
          `estimator` has a kernel, it always may.
        - "neighbours": errors that rows have in common if their states are near each
          other and the joint moves in the same direction. They are rough, and end
          where the training rows end.
        - "friction+neighbours": the sum of both.
        - "states": positions, velocities and accelerations of all joints.

        None means rigid bodies alone.
    criterion : {"bic", "loo"}, default="bic"
        How the best is chosen. "bic" is the marginal likelihood of what rigid bodies
        leave, minus half the logarithm of the number of rows for each hyperparameter.
        "loo" is the density of each row given all others.
    estimator : MultiTaskGPRegressor, default=None
        Settings of the process: its K^rho, its kernel if it has one, and how it is
        learned. A kernel must suit all words of `rest`. Its levels, units and
        `target_transform` are ignored, and its hyperparameters are those of the mode.
        None is ``MultiTaskGPRegressor(rank=rank, shared=True, noise="shared")`` with
        the better rank of 0 and 1: a function that all tasks share and, with rank 1,
        one that each has in its own amount.
    prior : {"evidence", "nominal"} or None, default="evidence"
        Prior of links, friction and loads, see :class:`RigidBodyRegressor`.
    joint : int, str or None, default=None
        Position from 0, or name, of the joint whose torque is y. None means that y has
        a column for each joint. All joints together tell much more about the links.
    empty_task : int or str, default=None
        Label of the task without a load. None means that loads are relative to their
        mean over all tasks, which counts as a part of the last link.
    task_feature : int or str, default=-1
        Position or name of the task column. The other columns are, from left to right,
        positions q1..qJ (rad, or m where a joint slides), velocities and accelerations.
    n_jobs : int, default=None
        Number of joints whose processes are learned at the same time, see
        :term:`n_jobs`.
    verbose : int, default=0
        With 1, learning prints a line for each joint and round, with
        ``prior="nominal"`` from either start. Lines go to the logger "skmtgp"; without
        handlers they are printed.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted. Tasks that joined by `add_task` are last.
    parameters_ : DataFrame of shape (n_parameters, 2)
        Value and standard deviation ("value", "std") of each base parameter of the
        links (kg, kg m, kg m^2) and of friction.
    load_parameters_ : DataFrame of shape (n_tasks, n_load)
        Mass, first moments and inertia of each task's load, see
        :class:`RigidBodyRegressor`.
    load_covariance_ : ndarray of shape (n_tasks, n_load, n_load)
        Their covariance. Variances are infinite for what the data do not show.
    results_ : DataFrame of n_joints * n_candidates rows
        Columns joint, rest ("none" or a word of `rest`), log_marginal_likelihood of
        what rigid bodies leave, n_hyperparameters, bic, with `criterion` "loo" also
        loo, and chosen.
    estimators_ : list of n_joints MultiTaskGPRegressor or None
        Process of each joint. Its tasks are positions in `tasks_`, and its targets are
        what rigid bodies leave.
    noise_variance_ : float or ndarray of shape (n_joints,)
        Noise variance of each joint, in squared units of y. If tasks have their own
        noise, it is their mean.
    y_train_ : ndarray of the shape of y
        Targets in training.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    make_semiparametric_regressor : A function that makes this model.
    RigidBodyRegressor : The first two terms alone.
    skmtgp.MultiTaskGPRegressor : Needs no model of the robot.

    Notes
    -----
    The parts are related between tasks in different ways. Links and friction are the
    same for all loads, a load adds ten numbers, and the relation of the rest must be
    learned. A single K^rho for a sum of kernels would let all links vary by task as
    much as the load does.

    Learning has two rounds. In the first, the process learns its hyperparameters from
    what least squares leaves. Links, friction and loads are then estimated again, by
    generalised least squares with the covariance of the process. This gives the means
    and variances of a joint normal distribution (Rasmussen and Williams (2006), section
    2.7). In the second round the process learns from what these leave. The variances
    treat its hyperparameters, and features that depend on rigid bodies, as known.
    Candidates are compared by quick searches, those of ``learning="staged"``. What is
    best in the second round is then learned as `estimator` says.

    Rows of a recording are neighbours in time, and so are their states. What a model
    does not know of a robot, such as vibrations of its gears, they have in common. If
    errors were independent, links and friction would be fitted to these. "neighbours"
    is therefore an exponential kernel of all states, of one length-scale. Where the
    joint turns back, friction jumps, and so may what is not known of it: states on both
    sides are no neighbours. A long length-scale leaves more to these errors, and
    intervals that grow with the distance from the rows. It is at most ten times the
    size of the states: with a longer one, errors in common would be almost constant in
    each direction, and take the place of Coulomb friction.

    The process of "friction" at the velocity v and the torque t of the rigid bodies is

    .. math:: g(v, t) = s \, h(|v|, s t), \qquad s = \mathrm{sgn}(v)

    with a function h that depends on s, too, if `friction` has "asymmetric" and the
    criterion is better with it. A direction that no training row has is thus the other
    one turned.

    With ``prior="nominal"`` learning begins twice: with what least squares leaves, and
    with what the model's own links leave. The likelier result is kept. Links that begin
    at the likeliest values without a process have already taken its part.

    The features of "friction" and "states" are limited to the range of the training
    rows. Outside, the process keeps its value at the edge, where a squared exponential
    would fall back to 0. Errors that neighbours have in common do fall back to 0.

    `sample_y` draws links, friction and loads, which all joints have in common. What no
    row shows of them it does not draw: there `predict` has infinite deviations.

    Memory grows with the square of the number of samples, time with its cube for each
    joint.

    References
    ----------
    .. [1] D. Nguyen-Tuong, J. Peters, "Using model knowledge for learning inverse
       dynamics", ICRA 2010, 2677-2682.
    .. [2] C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine
       Learning", MIT Press, 2006.

    Examples
    --------
    A robot whose joints stick before they move, which no formula here has:

    >>> import numpy as np
    >>> from skmtgp.datasets import make_puma560, puma560_urdf
    >>> from skmtgp.robot import RigidBodyRegressor, SemiparametricRegressor
    >>> puma = make_puma560(n_samples=20, n_loads=2, stribeck=0.5)
    >>> X, y = puma.data, puma.target[:, 2]
    >>> rows = np.random.default_rng(0).permutation(len(X))
    >>> train, test = rows[:200], rows[200:]
    >>> model = SemiparametricRegressor(puma560_urdf(), joint=2)
    >>> model = model.fit(X[train], y[train])
    >>> "friction" in model.summary()["rest"].iloc[0]
    True
    >>> rigid = RigidBodyRegressor(puma560_urdf(), joint=2).fit(X[train], y[train])
    >>> left, more = (1 - m.score(X[test], y[test]) for m in (model, rigid))
    >>> bool(left < 0.1 * more)
    True
    """

    _parameter_constraints = {
        **RigidBodyRegressor._parameter_constraints,
        "criterion": [StrOptions({"bic", "loo"})],
        "estimator": [MultiTaskGPRegressor, None],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
    }

    def __init__(
        self,
        model: Any,
        *,
        friction: str | Sequence[str] | None = ("viscous", "asymmetric", "rotor"),
        rest: str | Sequence[str] | None = REST,
        criterion: Literal["bic", "loo"] = "bic",
        estimator: MultiTaskGPRegressor | None = None,
        prior: Literal["evidence", "nominal"] | None = "evidence",
        joint: int | str | None = None,
        empty_task: int | str | None = None,
        task_feature: int | str = -1,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        super().__init__(
            model,
            friction=friction,
            prior=prior,
            joint=joint,
            empty_task=empty_task,
            task_feature=task_feature,
        )
        self.rest = rest
        self.criterion = criterion
        self.estimator = estimator
        self.n_jobs = n_jobs
        self.verbose = verbose

    def _fit(self, x, codes, tasks, y, progress):
        kinds = check_rest(self.rest)
        super()._fit(x, codes, tasks, y, progress)
        self._rows_in_training = x, codes, self.y_train_.reshape(len(y), -1)
        starts = self._starts()
        self._foretell(len(y), len(starts), kinds)
        learned = [
            self._learned_from(start, kinds, f"{name}round", progress)
            for name, start in zip(STARTS, starts, strict=False)
        ]
        _, attributes, told = min(learned, key=itemgetter(0))
        vars(self).update(attributes)
        for category, message in told:
            warn(message, category)

    def _foretell(self, n_rows, n_starts, kinds):
        """Say before learning begins if it will take minutes."""
        n_joints, n_models = len(self._joint_names()), len(self._relations())
        n_searches = sum(len(self._laws(kind)) for kind in kinds) * N_ROUNDS
        n_quick = n_searches + (N_ROUNDS - 1) * (n_models - 1)
        with limit_threads(n_rows):
            seconds = foresee(n_rows, n_quick, n_models) if kinds else 0.0
        learning = "Learning what rigid bodies leave will take"
        less = "rest='friction', a larger n_jobs or fewer rows"
        warn_of_duration(learning, n_starts * n_joints * seconds, less)

    def _starts(self):
        """Coefficients to begin with: the likeliest, and those with the model's links.

        Where all is left to links and noise, links take for theirs what a process
        would explain. The description's own leave it to the process.
        """
        if self.prior != "nominal":
            return [self._coef]
        x, codes, Y = self._rows_in_training
        design, n = self._whole(x, codes), self._columns.n_links
        matrix, known = self._matrix[:, n:], Y - design @ self._centre
        groups = [group - n for group in self._groups[1:]]
        if not matrix.shape[1]:
            return [self._coef, self._centre]
        method = partial(evidence, groups=groups)
        found = solve(design @ matrix, known, method)[0]
        return [self._coef, self._centre + matrix @ found.coef]

    def _learned_from(self, start, kinds, name, progress):
        """Deviance, attributes and warnings of what is learned from such links."""
        model = copy(self)
        model._coef = start
        for k in range(1, N_ROUNDS + 1):
            stage = f"{name} {k} of {N_ROUNDS}"
            describe = partial(model._describe, stage)
            report = progress(stage, len(model._joint_names()), describe)
            told = model._learn_rests(kinds, report, thoroughly=k == N_ROUNDS)
            model._settle()
        return model._deviance(), vars(model), told

    def _deviance(self):
        """-2 log evidence of all torques and, as in BIC, a price of the processes."""
        n = len(self._rows_in_training[0])
        chosen = [row["n_hyperparameters"] for row in self._table if row["chosen"]]
        sizes = [log_det(factor, n) for factor in self._factors]
        return np.log(n) * sum(chosen) + sum(sizes) - 2.0 * self._evidence

    def _learn_rests(self, kinds, report, *, thoroughly):
        """Learn the process of each joint; give the warnings of those chosen."""
        x, codes, Y = self._rows_in_training
        left, self._known = Y - super()._means(x, codes), self._coef
        link, told, self._rests, self._table = self._link(x, codes), [], [], []
        power = power_of(Y)
        something = np.square(left).mean(axis=0) > ROUNDING * power
        learn = partial(choose, thoroughly=thoroughly)
        options = codes, self._relations(), self.criterion
        jobs = []
        for i, is_left in enumerate(something):
            make = partial(self._features, i, x, link[:, i])
            jobs.append((kinds if is_left else [], make, left[:, i], *options))
        found = run(learn, jobs, n_jobs=self.n_jobs, report=report)
        for i, name in enumerate(self._joint_names()):
            rest, table, warnings = found[i]
            if rest.name == NONE:
                variance = np.sum(np.square(left[:, i])) / max(self._freedom[i], 1.0)
                rest = rest._replace(noise=max(variance, SMALLEST * power[i]))
            self._table += [{"joint": name, **row} for row in table]
            self._rests.append(rest)
            told += [(kind, f"Rest of {name!r}: {text}") for kind, text in warnings]
        return told

    def _describe(self, stage, i, found):
        """What to say of the process of a joint."""
        names, (rest, table, _) = self._joint_names(), found
        [value] = [row["log_marginal_likelihood"] for row in table if row["chosen"]]
        place = f"{names[i]} ({i + 1} of {len(names)}), {stage}"
        return f"{place}: rest {rest.name}, log likelihood {value:.1f}"

    def _joint_names(self):
        return [self._columns.dynamics.names[j] for j in self._columns.joints]

    def _features(self, i, x, link, kind):
        """What the rest of a joint may depend on, and the values of each in training.

        With asymmetric friction its process may differ by direction, or not.
        """
        dynamics, joint = self._columns.dynamics, self._columns.joints[i]
        found = [
            Features(kind, dynamics, joint, x, link, asymmetric=of)
            for of in self._laws(kind)
        ]
        return [(features, features(x, link)) for features in found]

    def _laws(self, kind):
        """Whether friction differs by direction: what a kind may do."""
        asymmetric = "asymmetric" in self._columns.words
        both = asymmetric and "friction" in kind and self._chooses_kernels()
        return [True, False] if both else [asymmetric]

    def _chooses_kernels(self):
        return self.estimator is None or self.estimator.kernel is None

    def _relations(self):
        """Models of what is left, which relate the tasks in different ways."""
        if self.estimator is not None:
            return [self.estimator]
        return [
            MultiTaskGPRegressor(rank=rank, shared=True, noise="shared")
            for rank in ((0, 1) if len(self.tasks_) > 1 else (0,))
        ]

    def _link(self, features, codes):
        """Torques of links and loads without friction, as they were when learned."""
        coef = self._known.copy()
        coef[self._columns.n_links : len(self._scale[0])] = 0.0
        link = np.empty((len(features), len(self._columns.joints)))
        for rows, own, A in self._rows(features, codes):
            link[rows] = A @ coef[own]
        return link

    def _inputs(self, features, codes):
        """What the process of each joint depends on; None where there is none."""
        link = self._link(features, codes)
        return [
            None if rest.name == NONE else (rest.features(features, link[:, i]), codes)
            for i, rest in enumerate(self._rests)
        ]

    def _settle(self):
        """The posterior of all parameters, given the processes and all rows."""
        x, codes, Y = self._rows_in_training
        self._trained = self._inputs(x, codes)
        self._factors = [
            rest.factor(rows) if rows else float(np.sqrt(rest.noise))
            for rest, rows in zip(self._rests, self._trained, strict=True)
        ]
        design = self._whole(x, codes)
        joints = list(enumerate(self._factors))
        self._whitened = [whiten(L, design[:, i]) for i, L in joints]
        targets = [whiten(L, Y[:, i]) for i, L in joints]
        A, b = np.concatenate(self._whitened), np.concatenate(targets)
        self._noise_variances = np.array([np.mean(rest.noise) for rest in self._rests])
        start = self._precision
        if len(start) != self._matrix.shape[1]:
            start = None
        found = self._method()(A @ self._matrix, b - A @ self._centre, start)
        self._evidence = found.log_evidence
        self._keep(found)
        self._left = [
            target - W @ self._coef
            for target, W in zip(targets, self._whitened, strict=True)
        ]

    @property
    def results_(self) -> pd.DataFrame:
        """Table of the candidates of each joint, computed anew."""
        check_is_fitted(self)
        return pd.DataFrame(self._table)

    @property
    def estimators_(self) -> list[MultiTaskGPRegressor | None]:
        """The process of each joint."""
        check_is_fitted(self)
        return [rest.model for rest in self._rests]

    @public
    def summary(self) -> pd.DataFrame:
        """Return how large each part of the torque is, as a table of the joints.

        Returns
        -------
        summary : DataFrame of n_joints rows
            The names of the joints are the index. The columns are

            - links: root mean square of the torque of the links over the training rows,
              in units of y;
            - friction, load, process: the same for these parts;
            - noise: standard deviation of the noise;
            - rest: what the process depends on, or "none";
            - gain: by how many nats `criterion` prefers the process to none.

        Raises
        ------
        NotFittedError
            If the model was not fitted.
        """
        check_is_fitted(self)
        x, codes, _ = self._rows_in_training
        n_links, n = self._columns.n_links, len(self._scale[0])
        parts = np.split(self._whole(x, codes) * self._coef, [n_links, n], axis=2)
        parts = [*(part.sum(axis=2) for part in parts), self._processes(x, codes)]
        sizes = [np.sqrt(np.square(part).mean(axis=0)) for part in parts]
        columns = dict(zip(PARTS, sizes, strict=True))
        index = pd.Index(self._joint_names(), name="joint")
        table = self.results_.set_index("joint")
        none, best = table[table["rest"] == NONE], table[table["chosen"]]
        columns["noise"] = np.sqrt(self._noise_variances)
        columns["rest"] = best["rest"].to_numpy()
        columns["gain"] = 0.5 * (none[self.criterion] - best[self.criterion]).to_numpy()
        return pd.DataFrame(columns, index=index)

    @public
    def add_task(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn the load of a new task, and how its rest is related to the others.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs of the new task, with its label. A few samples are enough.
        y : array-like of the other dimensions of the training targets
            Torques of the new task.

        Returns
        -------
        model : SemiparametricRegressor
            A new fitted model, which also knows the new task, as the last one. The
            present model does not change.

        Raises
        ------
        TypeError, ValueError
            If the task is already known, or X or y cannot be used.

        Notes
        -----
        Kernels, noise and the relations of the known tasks stay as they are. The new
        rows also change the posterior of links and friction.
        """
        check_is_fitted(self)
        x, label, Y = check_new_task(self, X, y)
        model, code = copy(self), np.full(len(x), len(self.tasks_))
        with limit_threads(self._side):
            model._join_load(x, Y)
            model.tasks_ = np.append(self.tasks_, label)
            model._join_rests(x, code, Y)
            old = self._rows_in_training
            model._rows_in_training = tuple(
                map(np.concatenate, zip(old, (x, code, Y), strict=True))
            )
            model._settle()
        return model

    def _join_load(self, x, Y):
        """Append the load that rigid bodies alone give a new task."""
        columns, load = self._columns.of(x)
        columns, load = columns / self._scale[0], load / self._scale[1]
        left = Y - columns @ self._coef[: columns.shape[2]]
        *others, loads = self._groups
        mean, root, precision = self._population(self.prior and "tasks")
        if len(loads) and precision:  # that of all loads, which is learned again
            known = self._precision[loads].min()
            root, precision = np.sqrt(known) * root, known
        rest = left - load @ mean
        new = (
            mean + root @ join(load @ root, rest, self._noise_variances, precision).coef
        )
        self._known = np.append(self._known, new)
        self._coef = np.append(self._coef, new)
        self._centre = np.append(self._centre, mean)
        own = self._matrix.shape[1] + np.arange(len(new))
        self._groups = [*others, np.append(loads, own)]
        self._matrix = block_diag(self._matrix, root)

    def _join_rests(self, x, code, Y):
        """Relate the new task's processes to those of the others."""
        inputs, left = self._inputs(x, code), Y - super()._means(x, code)
        self._rests = [
            rest.joined(rows, of_joint)
            for rest, rows, of_joint in zip(self._rests, inputs, left.T, strict=True)
        ]

    @property
    def _side(self):
        return len(self._rows_in_training[0])

    def _means(self, features, codes):
        return super()._means(features, codes) + self._processes(features, codes)

    def _processes(self, features, codes):
        """Means of the processes."""
        means = np.zeros((len(features), len(self._rests)))
        for rows in chunks(len(features)):
            for i, _, V in self._explained(features[rows], codes[rows]):
                means[rows, i] = V.T @ self._left[i]
        return means

    def _explained(self, features, codes):
        """Whitened covariances with the training rows, where there is a process."""
        inputs = self._inputs(features, codes)
        for i, rows in enumerate(inputs):
            if rows:
                K = self._rests[i].covariance(self._trained[i], rows)
                yield i, rows, whiten(self._factors[i], K)

    def _noise(self, codes):
        return np.column_stack([rest.noise_of(codes) for rest in self._rests])

    def _unknown(self, features, codes):
        """What predictions are linear in of the parameters, and process variances."""
        design = self._whole(features, codes)
        variances = np.zeros(design.shape[:2])
        for i, rows, V in self._explained(features, codes):
            design[:, i] -= V.T @ self._whitened[i]
            prior = self._rests[i].variance(rows)
            variances[:, i] = np.maximum(prior - np.square(V).sum(axis=0), 0.0)
        return design, variances

    def _variances(self, features, codes, include_noise):
        variances = float(include_noise) * self._noise(codes)
        for rows in chunks(len(features)):
            design, of_process = self._unknown(features[rows], codes[rows])
            spread = np.square(design @ self._factor).sum(axis=2)
            unseen = (np.abs(design @ self._blind) > BLIND).any(axis=2)
            variances[rows] += of_process + spread + np.where(unseen, np.inf, 0.0)
        return variances

    def _covariances(self, features, codes, include_noise):
        design, _ = self._unknown(features, codes)
        design = design @ self._factor
        covariances = np.einsum("njp,mjp->nmj", design, design)
        for i, rows, V in self._explained(features, codes):
            covariances[:, :, i] += self._rests[i].covariance(rows, rows) - V.T @ V
        same = np.arange(len(features))
        covariances[same, same] = self._variances(features, codes, include_noise)
        return covariances

    def _draws(self, features, codes, n_draws, rng):
        """Draws of the parameters, and of what each process leaves beside them."""
        if any(rest.name != NONE for rest in self._rests):
            check_joint(self, len(features), *JOINTLY, at_once=1)
        design, _ = self._unknown(features, codes)
        z = rng.standard_normal((self._factor.shape[1], n_draws))
        draws = self._means(features, codes)[..., None] + design @ (self._factor @ z)
        for i, rows, V in self._explained(features, codes):
            left = self._rests[i].covariance(rows, rows) - V.T @ V
            draws[:, i] += draw_normal(np.zeros(len(left)), left, n_draws, rng)
        return draws, np.sqrt(self._noise(codes))[..., None]


def make_semiparametric_regressor(
    model: Any,
    *,
    joint: int | str | None = None,
    friction: str | Sequence[str] | None = ("viscous", "asymmetric", "rotor"),
    rest: str | Sequence[str] | None = REST,
    estimator: MultiTaskGPRegressor | None = None,
    prior: Literal["evidence", "nominal"] | None = "evidence",
    empty_task: int | str | None = None,
    task_feature: int | str = -1,
    n_jobs: int | None = None,
    verbose: int = 0,
) -> SemiparametricRegressor:
    """Make a model of a robot's torques: rigid bodies, friction, and the rest.

    Parameters
    ----------
    model : str, path or pinocchio.Model
        The robot: file of a URDF, its text, or a Pinocchio model.
    joint : int, str or None, default=None
        Position from 0, or name, of the joint whose torque is y. None means that y has
        a column for each joint. All joints together tell much more about the links.
    friction : str, sequence of str or None, default=("viscous", "asymmetric", "rotor")
        Friction law, see :class:`RigidBodyFeatures`.
    rest : str, sequence of str or None
        What the process depends on: "friction", "neighbours", their sum
        "friction+neighbours", or "states". The best of them is chosen for each joint.
        None means rigid bodies alone.
    estimator : MultiTaskGPRegressor, default=None
        Settings of the process: how tasks are related in it, and how it is learned.
    prior : {"evidence", "nominal"} or None, default="evidence"
        Prior of links, friction and loads, see :class:`RigidBodyRegressor`.
    empty_task : int or str, default=None
        Label of the task without a load.
    task_feature : int or str, default=-1
        Position or name of the task column.
    n_jobs : int, default=None
        Number of joints that are learned at the same time.
    verbose : int, default=0
        With 1, learning prints a line for each joint and round.

    Returns
    -------
    regressor : SemiparametricRegressor
        Not fitted. X has the shape (n_samples, 3 J + 1): positions, velocities,
        accelerations and the load. y has torques of shape (n_samples, J) or, with
        `joint`, (n_samples,).

    See Also
    --------
    SemiparametricRegressor : The model in detail.
    skmtgp.make_inverse_dynamics_regressor : Models without a robot description.

    Examples
    --------
    >>> from skmtgp.datasets import load_puma560, puma560_urdf
    >>> from skmtgp.robot import make_semiparametric_regressor
    >>> X, y = load_puma560(n_per_load=8, loads=[1, 8, 15], return_X_y=True)
    >>> model = make_semiparametric_regressor(puma560_urdf(), empty_task=1).fit(X, y)
    >>> model.load_parameters_["m"].round(2).tolist()  # of 0.2, 1.6 and 3 kg
    [0.0, 1.4, 2.8]
    """
    return SemiparametricRegressor(
        model,
        friction=friction,
        rest=rest,
        estimator=estimator,
        prior=prior,
        joint=joint,
        empty_task=empty_task,
        task_feature=task_feature,
        n_jobs=n_jobs,
        verbose=verbose,
    )
