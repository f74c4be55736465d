"""Robots with known links and joints: physics in features, models and kernels.

Using it needs Pinocchio, which the extra ``skmtgp[robot]`` installs. Importing it does
not.
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
