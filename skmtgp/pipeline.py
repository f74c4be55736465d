"""Pipelines: the paper's model of a robot; what joins; intervals and densities."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from types import NoneType
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_stream
from skmtgp._data.known import ARGUMENTS, refuse_orders
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._support.pipelines import at_the_end, instead_of
from skmtgp.kernels import (
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.linear import BayesianLinearRegression
from skmtgp.model_selection import RankSearchIC
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.preprocessing import InverseDynamicsFeatures
from skmtgp.robot import (
    RigidBodyRegressor,
    SemiparametricRegressor,
    make_semiparametric_regressor,
)
from skmtgp.single_task import SingleTaskGP

__all__ = [
    "add_task",
    "log_predictive_density",
    "make_inverse_dynamics_regressor",
    "partial_fit",
    "predict_interval",
]

Model = TypeVar("Model", bound=BaseEstimator)
# The kernels of inverse dynamics, and what stands for a joint's position in each
ANGLES = {
    "paper": "radians",
    "geometric": "trigonometric",
    "trigonometric": "trigonometric",
}
RIGID = "rigid-body"


def add_task(
    model: Model,
    X: ArrayLike,
    y: ArrayLike,
    *,
    prior: Literal["tasks"] | None = "tasks",
    alpha: ArrayLike | None = None,
    sample_weight: ArrayLike | None = None,
    repeat_variance: ArrayLike | None = None,
) -> Model:
    """Return a fitted model with one more task, from a few samples of it.

    This calls the model's own method ``add_task``. For a Pipeline, the data first pass
    its transformers, which stay as they were fitted.

    Parameters
    ----------
    model : MultiTaskGPRegressor, RankSearchIC, or Pipeline that ends with one
        Fitted. A model of :mod:`skmtgp.robot` works, too.
    X : array-like of shape (n_samples, n_features)
        Inputs of the new task, with its label, as `model` takes them.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Its targets.
    prior : {"tasks"} or None, default="tasks"
        "tasks" lets the known tasks say where the new one lies among them. None is
        maximum likelihood. See :meth:`MultiTaskGPRegressor.add_task` and
        :meth:`skmtgp.robot.RigidBodyRegressor.add_task`. A SemiparametricRegressor has
        a prior of its own, and ignores it.
    alpha, sample_weight, repeat_variance : array-like, default=None
        What is known of the noise of these rows, see
        :meth:`MultiTaskGPRegressor.add_task`. Models of :mod:`skmtgp.robot` take none.

    Returns
    -------
    model : same type as `model`
        A new fitted model, which knows the new task too. The one passed stays as it is.

    Raises
    ------
    TypeError
        If the model cannot add a task, or takes nothing that is known of the noise.
    ValueError
        If the task is already known, or if X, y or what is known of the noise cannot be
        used.

    Notes
    -----
    Section 3.3 of Chai, Williams, Klanke and Vijayakumar (2008).

    Examples
    --------
    A robot that knows three loads meets another:

    >>> from skmtgp import MultiTaskGPRegressor, add_task
    >>> from skmtgp import make_inverse_dynamics_regressor
    >>> from skmtgp.datasets import load_puma560
    >>> X, y = load_puma560(n_per_load=5, loads=[1, 2, 3], return_X_y=True)
    >>> model = MultiTaskGPRegressor(rank=1, max_iter=20, noise_variance_bounds="fixed")
    >>> model = make_inverse_dynamics_regressor(model).fit(X, y[:, 0])
    >>> X_new, y_new = load_puma560(n_per_load=2, loads=[9], return_X_y=True)
    >>> add_task(model, X_new, y_new[:, 0])[-1].tasks_
    array([1, 2, 3, 9])
    """
    known = _known(X, y, (alpha, sample_weight, repeat_variance))
    if isinstance(model, Pipeline):
        extended = copy(model)
        X = model[:-1].transform(X) if len(model) > 1 else X
        name, last = model.steps[-1]
        last = add_task(last, X, y, prior=prior, **known)
        extended.steps = [*model.steps[:-1], (name, last)]
        return extended
    if isinstance(model, SemiparametricRegressor):
        return model.add_task(X, y, **known)
    if not isinstance(model, (MultiTaskGPRegressor, RankSearchIC, RigidBodyRegressor)):
        raise TypeError(
            "The model must be a MultiTaskGPRegressor, a RankSearchIC or a Pipeline "
            f"that ends with one of them; {type(model).__name__} is none."
            f"{instead_of(model)}"
        )
    return model.add_task(X, y, prior=prior, **known)


def _known(X, y, given):
    """What is known of the noise of rows, by name, before X loses its labels."""
    refuse_orders(X, y, given)
    named = zip(ARGUMENTS, given, strict=True)
    return {name: of for name, of in named if of is not None}


def partial_fit(
    model: Model,
    X: ArrayLike,
    y: ArrayLike,
    *,
    max_rows: int | None = None,
    alpha: ArrayLike | None = None,
    sample_weight: ArrayLike | None = None,
    repeat_variance: ArrayLike | None = None,
) -> Model:
    """Add rows to a model, which may be the last step of a Pipeline.

    This calls the model's own method ``partial_fit``. For a Pipeline, the data first
    pass its transformers. The first call fits all steps. From then on the transformers
    stay as they are.

    Parameters
    ----------
    model : estimator, or Pipeline that ends with one
        A MultiTaskGPRegressor, IndependentGP, PooledGP or RankSearchIC. It is changed
        in place, and so are predictors that were compiled from it.
    X : array-like of shape (n_samples, n_features)
        Inputs, with the task labels, as `model` takes them.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Targets.
    max_rows : int, default=None
        Number of rows to keep, see :meth:`MultiTaskGPRegressor.partial_fit`.
    alpha, sample_weight, repeat_variance : array-like, default=None
        What is known of the noise of these rows, see
        :meth:`MultiTaskGPRegressor.partial_fit`.

    Returns
    -------
    model : same type as `model`
        The model that was passed, fitted.

    Raises
    ------
    TypeError
        If the model has no ``partial_fit``, or X or y is a Dask collection.
    ValueError
        If X, y or what is known of the noise cannot be used, see
        :meth:`MultiTaskGPRegressor.partial_fit`. A fitted model is then as it was
        before.

    Examples
    --------
    >>> from skmtgp import PooledGP, make_inverse_dynamics_regressor, partial_fit
    >>> from skmtgp.datasets import load_puma560
    >>> X, y = load_puma560(n_per_load=8, loads=[1, 2], return_X_y=True)
    >>> model = make_inverse_dynamics_regressor(PooledGP(max_iter=0))
    >>> for rows in (slice(0, 12), slice(12, 14), slice(14, 16)):
    ...     model = partial_fit(model, X[rows], y[rows, 0])
    >>> model[-1].y_train_.shape
    (16,)
    """
    check_stream(X, y, max_rows)
    known = _known(X, y, (alpha, sample_weight, repeat_variance))
    last = model
    while isinstance(last, Pipeline):
        last = last.steps[-1][1]
    if not isinstance(last, (BaseMultiTaskGP, RankSearchIC)):
        raise TypeError(
            "The model must be a MultiTaskGPRegressor, IndependentGP, PooledGP or "
            "RankSearchIC, or a Pipeline that ends with one of them, not a "
            f"{type(last).__name__}.{instead_of(last)}"
        )
    if last is model:
        return model.partial_fit(X, y, max_rows=max_rows, **known)
    first, is_fitted = model[:-1], hasattr(last, "tasks_")
    if len(first):
        X = first.transform(X) if is_fitted else first.fit_transform(X, y)
    partial_fit(model.steps[-1][1], X, y, max_rows=max_rows, **known)
    model.steps = [*first.steps, model.steps[-1]]  # with a memory, fitted clones
    return model


def predict_interval(
    model: BaseEstimator,
    X: ArrayLike,
    level: float = 0.95,
    include_noise: bool = True,
    *,
    alpha: ArrayLike | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predict intervals by a model, which may be the last step of a Pipeline.

    The model's own method ``predict_interval``, after the transformers of a Pipeline
    and inside of a search: scikit-learn's have no such method.

    Parameters
    ----------
    model : estimator, or Pipeline or search that ends with one
        Fitted: any model of the package.
    X : array-like of shape (n_samples, n_features)
        Inputs, with the task labels, as `model` takes them.
    level : float, default=0.95
        Probability that the interval holds an observation.
    include_noise : bool, default=True
        Whether the interval is that of a new observation, or that of f. The noise is
        the learned one, and `alpha` if you give it here: that of `fit` is not in new
        rows.
    alpha : array-like, default=None
        Known noise variance of each new observation, in squared units of y, see
        :meth:`MultiTaskGPRegressor.predict_interval`.

    Returns
    -------
    lower, upper : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Its ends, in the units of y.

    Raises
    ------
    TypeError
        If the model has no intervals.
    ValueError
        If `level` is not in [0, 1), or X or `alpha` cannot be used, see
        :meth:`MultiTaskGPRegressor.predict_interval`.

    Examples
    --------
    >>> from sklearn.compose import make_column_transformer
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import StandardScaler
    >>> from skmtgp import MultiTaskGPRegressor, predict_interval
    >>> from skmtgp.datasets import make_sites
    >>> X, y = make_sites()
    >>> scaled = make_column_transformer(
    ...     (StandardScaler(), ["hour"]), remainder="passthrough"
    ... )
    >>> model = make_pipeline(scaled, MultiTaskGPRegressor(rank=1)).fit(X, y)
    >>> lower, upper = predict_interval(model, X)
    >>> bool(((lower <= y) & (y <= upper)).mean() > 0.9)
    True
    """
    refuse_orders(X, None, (alpha, None, None))
    model, X = _able_to("predict_interval", "intervals", model, X)
    return model.predict_interval(X, level, include_noise, alpha=alpha)


def log_predictive_density(
    model: BaseEstimator,
    X: ArrayLike,
    y: ArrayLike,
    *,
    alpha: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return log densities by a model, which may be the last step of a Pipeline.

    The model's own method ``log_predictive_density``, after the transformers of a
    Pipeline and inside of a search: scikit-learn's have no such method.

    Parameters
    ----------
    model : estimator, or Pipeline or search that ends with one
        Fitted: any model of the package.
    X : array-like of shape (n_samples, n_features)
        Inputs, with the task labels, as `model` takes them.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Observations.
    alpha : array-like, default=None
        Known noise variance of each observation, in squared units of y.

    Returns
    -------
    log_density : ndarray of the shape of y
        Natural logarithm of the density of each observation by itself, in units of y.

    Raises
    ------
    TypeError
        If the model has no densities.
    ValueError
        If X, y or `alpha` cannot be used, see
        :meth:`MultiTaskGPRegressor.log_predictive_density`.

    Examples
    --------
    >>> from sklearn.compose import make_column_transformer
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import StandardScaler
    >>> from skmtgp import MultiTaskGPRegressor, log_predictive_density
    >>> from skmtgp.datasets import make_sites
    >>> X, y = make_sites()
    >>> scaled = make_column_transformer(
    ...     (StandardScaler(), ["hour"]), remainder="passthrough"
    ... )
    >>> model = make_pipeline(scaled, MultiTaskGPRegressor(rank=1)).fit(X, y)
    >>> of_what_was = log_predictive_density(model, X, y).mean()
    >>> bool(of_what_was > log_predictive_density(model, X, y + 1).mean() + 1)
    True
    """
    refuse_orders(X, y, (alpha, None, None))
    model, X = _able_to("log_predictive_density", "densities", model, X)
    return model.log_predictive_density(X, y, alpha=alpha)


def _able_to(method, what, model, X):
    """The model at the end, which has the method, and X as it takes them."""
    model, X = at_the_end(model, X)
    if hasattr(model, method):
        return model, X
    check_is_fitted(model)  # of a search there is no best estimator yet
    advice = ""
    if isinstance(model, TransformedTargetRegressor):
        advice = (
            f" It has no {what}. Use the model that it wraps, with the functions or "
            "the transformer of y as its target_transform, such as (np.log, np.exp)."
        )
    raise TypeError(
        "The model must be one of skmtgp, or a Pipeline or search that ends with one, "
        f"not a {type(model).__name__}.{advice}"
    )


def make_inverse_dynamics_regressor(
    estimator: BaseEstimator | None = None,
    *,
    kernel: Literal["paper", "geometric", "trigonometric", "rigid-body"] = "paper",
    n_joints: int = 6,
    joint_types: Sequence[str] | None = None,
    robot: Any = None,
    joint: int | str | None = None,
    task_feature: int | str = -1,
    task_descriptors: Sequence[int | str] | None = None,
) -> Pipeline:
    """Make a pipeline of inverse dynamics features, a kernel and a model.

    Parameters
    ----------
    estimator : estimator, default=None
        The model: MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP,
        BayesianLinearRegression, or a RankSearchIC of the first. None is the paper's
        mGP-BIC: ``RankSearchIC(MultiTaskGPRegressor(task_levels=False,
        normalize_y="shared", noise="shared"), ranks=(2, 4, 5, 6, 8, 10),
        criterion="bic")``. The estimator is cloned and keeps its own settings, with two
        exceptions. If its kernel is None, it gets `kernel`. Its `task_feature` becomes
        -1, because the features put the load there.
    kernel : {"paper", "geometric", "trigonometric", "rigid-body"}, default="paper"
        Kernel and its features:

        - "paper" is :func:`~skmtgp.kernels.inverse_dynamics_kernel` of the joints'
          positions.
        - "trigonometric" is the same of their cosines and sines.
        - "geometric" is :func:`~skmtgp.kernels.geometric_inverse_dynamics_kernel`, a
          polynomial in cosines and sines. It extrapolates best if links and joints are
          rigid.
        - "rigid-body" is :func:`~skmtgp.robot.make_semiparametric_regressor` for a
          `robot` with a known description. Its `estimator`, a MultiTaskGPRegressor or
          None, learns what rigid bodies leave. It has no other features, and takes the
          torques of all joints at once.
    n_joints : int, default=6
        Number of joints J.
    joint_types : sequence of str, default=None
        "revolute" (or "R") or "prismatic" (or "P") for each joint. None means that all
        are revolute. It does not matter to the paper's kernel.
    robot : str, path or pinocchio.Model, default=None
        Only for "rigid-body": file of a URDF, its text, or a Pinocchio model. It
        defines the joints.
    joint : int, str or None, default=None
        Position from 0 of the joint whose torque is y, of one column. With "geometric"
        the kernel then leaves out most polynomials that this torque cannot have. None
        is a kernel for any joint, and y may have all of them. For "rigid-body" None
        means that y has all joints, and a joint may be a name. Other kernels have no
        `joint`.
    task_feature : int or str, default=-1
        Position or name of the column with the load.
    task_descriptors : sequence of int or str, default=None
        Positions or names of columns that describe the load, such as its mass. They are
        not features, but the `task_descriptors` of the model, which must be a
        MultiTaskGPRegressor or a RankSearchIC of one. None means those of the model.

    Returns
    -------
    pipeline : Pipeline
        Pipeline with the steps "features" and "regressor"; with "regressor" only for
        "rigid-body". It is fitted to X of shape (n_samples, 3 J + 1): positions in rad,
        velocities in rad/s, accelerations in rad/s^2 and the load, and also any
        descriptors. y are torques in N m, of shape (n_samples,) or (n_samples,
        n_outputs).

    Raises
    ------
    TypeError
        If `estimator` is none of these, if it does not take the given
        `task_descriptors`, if `joint_types` is not a sequence, or if `joint` is not an
        integer for "geometric".
    ValueError
        If `kernel` is none of these, if `n_joints` is not a positive integer, or if
        `joint_types` do not fit it. If `robot` is missing for "rigid-body", or `robot`
        or `joint` is given for a kernel that has none, or there is no such joint.

    Notes
    -----
    Section 6 of Chai, Williams, Klanke and Vijayakumar (2008).

    Examples
    --------
    >>> from skmtgp import PooledGP, make_inverse_dynamics_regressor
    >>> from skmtgp.datasets import load_puma560
    >>> X, y = load_puma560(n_per_load=4, loads=[1, 2], return_X_y=True)
    >>> model = make_inverse_dynamics_regressor(PooledGP(max_iter=10))
    >>> model[-1].max_iter
    10

    With polynomials of the cosines and sines of the joints' positions:

    >>> model = make_inverse_dynamics_regressor(PooledGP(), kernel="geometric")
    >>> model[0].angles, model[-1].kernel.n_dims
    ('trigonometric', 49)

    The same for the torque of the fifth joint:

    >>> model = make_inverse_dynamics_regressor(
    ...     PooledGP(), kernel="geometric", joint=4
    ... )
    >>> model[-1].kernel.n_dims
    36

    With a description of the robot, its URDF:

    >>> from skmtgp.datasets import puma560_urdf
    >>> model = make_inverse_dynamics_regressor(
    ...     kernel="rigid-body", robot=puma560_urdf()
    ... )
    >>> model[-1].rest
    ('friction', 'neighbours', 'friction+neighbours')

    A load that was never seen, from its mass:

    >>> from skmtgp import MultiTaskGPRegressor
    >>> X, y = load_puma560(
    ...     n_per_load=4, loads=[1, 8, 15], descriptors=["mass"], return_X_y=True
    ... )
    >>> model = make_inverse_dynamics_regressor(
    ...     MultiTaskGPRegressor(rank=2, max_iter=0), task_descriptors=[-2]
    ... )
    >>> seen = X[:, -1] != 8
    >>> model.fit(X[seen], y[seen, 1]).predict(X[~seen]).shape
    (4,)
    """
    if isinstance(kernel, str) and kernel == RIGID:
        if task_descriptors is not None:
            raise ValueError(
                f"task_descriptors={task_descriptors!r} cannot go with "
                f"kernel={RIGID!r}, which learns a load's parameters itself."
            )
        return _rigid_bodies(estimator, robot, joint, task_feature)
    if robot is not None:
        raise ValueError(f"robot={robot!r} needs kernel={RIGID!r}, not {kernel!r}.")
    regressor = _paper_model() if estimator is None else clone(estimator)
    model = _model_of(regressor)
    _set_kernel(model, _make_kernel(kernel, n_joints, joint_types, joint))
    if task_descriptors is None:
        task_descriptors = getattr(model, "task_descriptors", None)
    if task_descriptors is not None:
        _set_descriptors(model, len(task_descriptors))
    features = InverseDynamicsFeatures(
        n_joints,
        angles=ANGLES[kernel],
        joint_types=joint_types,
        task_feature=task_feature,
        task_descriptors=task_descriptors,
    )
    return Pipeline([("features", features), ("regressor", regressor)])


def _rigid_bodies(estimator, robot, joint, task_feature):
    """The model of a robot that is described."""
    if robot is None:
        raise ValueError(f"kernel={RIGID!r} needs robot, a URDF or a Pinocchio model.")
    if not isinstance(estimator, (MultiTaskGPRegressor, NoneType)):
        raise TypeError(
            f"estimator={estimator!r} must be a MultiTaskGPRegressor or None for "
            f"kernel={RIGID!r}: the model of what rigid bodies leave."
        )
    options = {"estimator": estimator, "joint": joint, "task_feature": task_feature}
    regressor = make_semiparametric_regressor(robot, **options)
    return Pipeline([("regressor", regressor)])


def _make_kernel(name, n_joints, joint_types, joint):
    """The kernel of a name, of so many joints."""
    if not isinstance(name, str) or name not in ANGLES:
        words = ", ".join(map(repr, [*ANGLES, RIGID]))
        raise ValueError(f"kernel={name!r} must be one of {words}.")
    options = {"angles": ANGLES[name], "joint_types": joint_types}
    kernel = inverse_dynamics_kernel(n_joints, **options)  # it checks them
    if name == "geometric":
        types = "R" * n_joints if joint_types is None else joint_types
        return geometric_inverse_dynamics_kernel(types, joint=joint)
    if joint is not None:
        raise ValueError(
            f"joint={joint!r} needs kernel='geometric' or {RIGID!r}, not {name!r}."
        )
    return kernel


def _paper_model():
    """mGP-BIC of section 6: one mean, one unit and one noise variance for all loads."""
    settings = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
    return RankSearchIC(
        MultiTaskGPRegressor(**settings), ranks=(2, 4, 5, 6, 8, 10), criterion="bic"
    )


def _model_of(regressor):
    """The model that has a kernel: of a search its estimator."""
    if not isinstance(regressor, RankSearchIC):
        return regressor
    if regressor.estimator is None:
        regressor.set_params(estimator=MultiTaskGPRegressor())
    return regressor.estimator


def _set_kernel(regressor, kernel):
    """Give the model its kernel where it lacks one; features put the task last."""
    linear = isinstance(regressor, BayesianLinearRegression)
    if not (linear or isinstance(regressor, (BaseMultiTaskGP, SingleTaskGP))):
        raise TypeError(
            f"estimator={regressor!r} must be a MultiTaskGPRegressor, IndependentGP, "
            "PooledGP, SingleTaskGP, BayesianLinearRegression or RankSearchIC."
        )
    if not linear and regressor.kernel is None:
        regressor.set_params(kernel=kernel)
    regressor.set_params(task_feature=-1)


def _set_descriptors(regressor, n_descriptors):
    """Tell the model where features put the descriptors: in front of the task."""
    if not isinstance(regressor, MultiTaskGPRegressor):
        raise TypeError(
            f"task_descriptors are for a MultiTaskGPRegressor, or a RankSearchIC of "
            f"one, not for {regressor!r}."
        )
    places = list(range(-1 - n_descriptors, -1))
    regressor.set_params(task_descriptors=places)
