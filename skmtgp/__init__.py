"""Multi-task Gaussian processes with scikit-learn's interface."""

from skmtgp.baselines import IndependentGP, PooledGP, SingleTaskGP
from skmtgp.model_selection import RankSearchIC
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.pipeline import make_inverse_dynamics_regressor

__version__ = "0.1.0.dev0"

__all__ = [
    "IndependentGP",
    "MultiTaskGPRegressor",
    "PooledGP",
    "RankSearchIC",
    "SingleTaskGP",
    "make_inverse_dynamics_regressor",
]
