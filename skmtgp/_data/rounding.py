"""How targets are rounded, as those of a scale of whole numbers are."""

import numpy as np
import pandas as pd

FEW = 10  # rows, which may all be multiples of a number by chance
MOST_STEPS = 1e5  # of the range: more steps are as none
CLOSE = 1e-12  # of the largest: values so near are the same one, written differently
EXACT = 1e-4  # of a step: how near values are to its multiples
TIED = 0.1  # share of rows that have the value of another one, if it was rounded
UNIFORM = 1.0 / 12.0  # variance between the ends of a step
MOST = 0.25  # of the variance within tasks: most of a rare event is no rounding


def variance_of_rounding(features, codes, Y):
    """Variance of what rounding added to targets; zero where they are not rounded.

    Rounding to multiples of a step adds an error of a twelfth of its square. Rounded
    targets repeat within a task at other inputs. Integers that are exact may do so,
    too: of these it says what rounding would have added.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_inputs)
        Inputs.
    codes : ndarray of shape (n_samples,)
        Tasks.
    Y : ndarray of shape (n_samples, n_outputs)
        Targets.

    Returns
    -------
    variances : ndarray of shape (n_outputs,)
        In squared units of Y.
    """
    return np.array([_of_output(features, codes, y) for y in Y.T])


def step_of(y):
    """The number of which all differences are multiples; zero without one."""
    values = np.unique(y)
    between = np.diff(values)
    between = between[between > CLOSE * np.abs(values).max()]
    if len(y) < FEW or not len(between):
        return 0.0
    size = values[-1] - values[0]
    n_steps = np.round(size / between.min())  # which is the less exact of both
    if n_steps > MOST_STEPS:
        return 0.0
    step = size / n_steps
    steps = (values - values[0]) / step
    return float(step) if np.abs(steps - np.round(steps)).max() < EXACT else 0.0


def _of_output(features, codes, y):
    step = step_of(y)
    if step == 0.0:
        return 0.0
    whole = np.round((y - y.min()) / step)
    if _share_tied(features, codes, whole) < TIED:
        return 0.0
    within = y - pd.Series(y).groupby(codes).transform("mean").to_numpy()
    return min(UNIFORM * step**2, MOST * float(np.square(within).mean()))


def _share_tied(features, codes, values):
    """Share of the rows whose task has the same value at other inputs."""
    table = pd.DataFrame(features).assign(task=codes, value=values).drop_duplicates()
    return table.duplicated(["task", "value"], keep=False).mean()
