"""Multi-task Gaussian processes with scikit-learn's interface."""

from skmtgp._support.versions import show_versions
from skmtgp.baselines import IndependentGP, PooledGP
from skmtgp.identification import TaskIdentifier
from skmtgp.linear import BayesianLinearRegression
from skmtgp.model_selection import RankSearchIC
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.pipeline import (
    add_task,
    log_predictive_density,
    make_inverse_dynamics_regressor,
    partial_fit,
    predict_interval,
)
from skmtgp.predictor import compile_predictor
from skmtgp.repeats import average_repeats
from skmtgp.single_task import SingleTaskGP
from skmtgp.tracking import DescriptorTracker
from skmtgp.wide import WideRegressor, stack_tasks, unstack_tasks

__version__ = "0.1.0"

__all__ = [
    "BayesianLinearRegression",
    "DescriptorTracker",
    "IndependentGP",
    "MultiTaskGPRegressor",
    "PooledGP",
    "RankSearchIC",
    "SingleTaskGP",
    "TaskIdentifier",
    "WideRegressor",
    "add_task",
    "average_repeats",
    "compile_predictor",
    "log_predictive_density",
    "make_inverse_dynamics_regressor",
    "partial_fit",
    "predict_interval",
    "show_versions",
    "stack_tasks",
    "unstack_tasks",
]
