"""Whether all columns have one length-scale, where one of each is many for the rows.

Columns of a spectrum are alike: they have one unit, and none is to be left out. One
length-scale of each then follows noise, and predictions are too sure. But if a few of
many columns matter, only length-scales of their own can tell which. The evidence knows
both (benchmarks/columns.py); eq. 8 charges a length-scale that is not needed too much.
"""

from dataclasses import replace

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._data.statistics import deviation_of, varying
from skmtgp.learning.evidence import evidence_around

MANY = 0.25  # columns for each row; fewer are told by the rows
FEWEST = 10  # columns, with fewer of which little is gained
UNLIKE = 30.0  # times the least deviation of a column: they have units of their own
SURE = 3.0  # nats an output that one length-scale for all must gain


def with_alike_columns(model, training, learn):
    """The training data with one length-scale for all columns, if that is likelier.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Nothing is asked if the user gives a kernel, or if it is the paper's.
    training : Training
        With units.
    learn : callable
        ``learn(training)`` gives the problem and the mode of each output of a small
        model.

    Returns
    -------
    training : Training
        The same if there is nothing to ask, or little to gain.
    """
    of_paper = getattr(model, "learning", "annealed") != "annealed"
    if of_paper or model._kernels() != [None] or model.max_iter == 0:
        return training
    if not (
        columns_are_many(training.features, len(training.tasks))
        and are_alike(training.features)
    ):
        return training
    alike = replace(training, alike=True)
    gain = _evidence(learn(alike)) - _evidence(learn(training))
    return alike if gain > SURE * training.Y.shape[1] else training


def columns_are_many(features, n_tasks=1):
    """Whether columns are many for the rows. Tasks may share rows: they count once."""
    n, n_columns = features.shape
    if n_columns < FEWEST or is_dask(features) or n_columns <= MANY * n / n_tasks:
        return False
    return n_columns > MANY * len(np.unique(features, axis=0))


def are_alike(features):
    """Whether columns may have the same unit, by their deviations."""
    deviation = deviation_of(features)
    deviation = deviation[varying(features, deviation)]
    return len(deviation) > 0 and deviation.max() <= UNLIKE * deviation.min()


def _evidence(found):
    """Log evidence of a small model, summed over the outputs."""
    return sum(
        evidence_around(problem.likelihood_at(mode), mode.theta)
        for problem, mode in found
    )
