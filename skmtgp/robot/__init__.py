"""Robots whose links and joints are known: physics in features, models and kernels.

It needs Pinocchio, which the extra ``skmtgp[robot]`` brings, when it is used; not when
it is imported.
"""

from skmtgp.robot._features import RigidBodyFeatures
from skmtgp.robot._regressor import RigidBodyRegressor
from skmtgp.robot._semiparametric import (
    SemiparametricRegressor,
    make_semiparametric_regressor,
)

__all__ = [
    "RigidBodyFeatures",
    "RigidBodyRegressor",
    "SemiparametricRegressor",
    "make_semiparametric_regressor",
]
