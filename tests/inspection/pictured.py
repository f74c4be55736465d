"""All estimators, and small tables to draw; what pictures say."""

import numpy as np
import pandas as pd
from samples import draw

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)

X, Y = draw(per_task=6, n_outputs=2)
y = Y[:, 0]
TASKS = X[:, -1].astype(int)
NAMES = np.array(["u", "v", "w"])
FRAME = pd.DataFrame({"load": NAMES[TASKS], "a": X[:, 0], "b": X[:, 1]})
QUICK = {"max_iter": 3}
MODELS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2, **QUICK),
    "IndependentGP": IndependentGP(**QUICK),
    "PooledGP": PooledGP(**QUICK),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1, 2)),
    "SingleTaskGP": SingleTaskGP(**QUICK),
    "BayesianLinearRegression": BayesianLinearRegression(),
}


def texts(labels):
    return [label.get_text() for label in labels]


def line_spacing(axis):
    """Distance of neighbouring labels over the size of their letters."""
    axis.axes.figure.draw_without_rendering()
    labels = axis.get_ticklabels()
    ends = axis.axes.transData.transform([(k, k) for k in axis.get_ticklocs()[:2]])
    pixels = np.abs(np.diff(ends, axis=0))[0, 0 if axis.axis_name == "x" else 1]
    return 72.0 * pixels / axis.axes.figure.dpi / labels[0].get_fontsize()
