"""The paper's model of a robot, from joint states to torques, in one Pipeline."""

from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from skmtgp._base import BaseMultiTaskGP
from skmtgp.baselines import SingleTaskGP
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model_selection import RankSearchIC
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.preprocessing import InverseDynamicsFeatures

__all__ = ["make_inverse_dynamics_regressor"]


def make_inverse_dynamics_regressor(
    estimator: BaseEstimator | None = None,
    *,
    n_joints: int = 6,
    task_feature: int | str = -1,
) -> Pipeline:
    """Pipeline of the inverse dynamics features, the paper's kernel and a model.

    Parameters
    ----------
    estimator : estimator, default=None
        The model: MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP, or a
        RankSearchIC of one of the first. None is ``RankSearchIC()``, the paper's
        mGP-BIC. It is cloned; where its kernel is None it gets
        :func:`~skmtgp.kernels.inverse_dynamics_kernel`, and its own `task_feature`
        becomes -1, where the features put the load.
    n_joints : int, default=6
        Number of joints J.
    task_feature : int or str, default=-1
        Position or name of the column with the load.

    Returns
    -------
    pipeline : Pipeline
        Of the steps "features" and "regressor". It is fitted on X of shape (n_samples,
        3 J + 1): positions in rad, velocities in rad/s, accelerations in rad/s^2 and
        the load; and on torques y in N m, of shape (n_samples,) or (n_samples,
        n_outputs).

    Raises
    ------
    TypeError
        If `estimator` is none of these.

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
    """
    regressor = RankSearchIC() if estimator is None else clone(estimator)
    _set_kernel(regressor, inverse_dynamics_kernel(n_joints))
    features = InverseDynamicsFeatures(n_joints, task_feature=task_feature)
    return Pipeline([("features", features), ("regressor", regressor)])


def _set_kernel(regressor, kernel):
    """Give the model its kernel where it has none; features put the task last."""
    if isinstance(regressor, RankSearchIC):
        if regressor.estimator is None:
            regressor.set_params(estimator=MultiTaskGPRegressor())
        regressor = regressor.estimator
    if not isinstance(regressor, (BaseMultiTaskGP, SingleTaskGP)):
        raise TypeError(
            f"estimator={regressor!r} must be a MultiTaskGPRegressor, IndependentGP, "
            "PooledGP, SingleTaskGP or RankSearchIC."
        )
    if regressor.kernel is None:
        regressor.set_params(kernel=kernel)
    regressor.set_params(task_feature=-1)
