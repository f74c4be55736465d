"""Pictures of fitted models, in scikit-learn's convention of displays.

A display has the data of a picture. ``plot`` draws them, several times if needed, and
keeps what it has drawn: ``ax_``, ``figure_`` and the artists. Drawing needs matplotlib:
``pip install "skmtgp[plot]"``.
"""

from skmtgp.inspection._coverage import CoverageDisplay
from skmtgp.inspection._drawing import COLORS as COLORS  # no function, no class
from skmtgp.inspection._drawing import color_of
from skmtgp.inspection._kernel_relevance import KernelRelevanceDisplay
from skmtgp.inspection._learning_curve import TaskLearningCurveDisplay
from skmtgp.inspection._rank_selection import RankSelectionDisplay
from skmtgp.inspection._residuals import TaskResidualsDisplay
from skmtgp.inspection._sills import variogram_table
from skmtgp.inspection._task_covariance import TaskCovarianceDisplay
from skmtgp.inspection._task_prediction import TaskPredictionDisplay
from skmtgp.inspection._trajectory import TrajectoryDisplay
from skmtgp.inspection._transfer import TransferDisplay
from skmtgp.inspection._variogram import VariogramDisplay

__all__ = [
    "CoverageDisplay",
    "KernelRelevanceDisplay",
    "RankSelectionDisplay",
    "TaskCovarianceDisplay",
    "TaskLearningCurveDisplay",
    "TaskPredictionDisplay",
    "TaskResidualsDisplay",
    "TrajectoryDisplay",
    "TransferDisplay",
    "VariogramDisplay",
    "color_of",
    "variogram_table",
]
