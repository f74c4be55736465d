"""Regressions of small data, and their covariates."""

import numpy as np
import pytest
from samples import draw, split

X, y = draw()
Y = draw(n_outputs=2)[1]
Z = draw(per_task=4, seed=1)[0]
POOLED = pytest.mark.parametrize("pooled", [False, True])
TARGETS = pytest.mark.parametrize("target", [y, Y], ids=["one output", "two outputs"])


def design(features, fit_intercept=True):
    ones = np.ones((len(features), int(fit_intercept)))
    return np.column_stack([features, ones])


def regressions(X, pooled):
    """Rows of each regression."""
    tasks = split(X)[1] * (not pooled)
    return [tasks == m for m in range(tasks.max() + 1)]
