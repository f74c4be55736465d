r"""Rows that lie farther from what all other rows say than noise explains.

With the inverse W of the covariance K of the targets and :math:`\alpha = W y`, all
other rows predict a target with the error :math:`\alpha_i / W_{ii}` and the variance
:math:`1 / W_{ii}`, as in Rasmussen and Williams (2006), section 5.4.2. If the model is
right, :math:`z_i = \alpha_i / \sqrt{W_{ii}}` is standard normal, and rarely beyond a
bound that grows with the number of rows.
"""

import numpy as np
import pandas as pd
from scipy.stats import norm

from skmtgp._numerics.parallel import limit_threads

# Rows that are asked: the inverse takes a second or less. Complete data are learned in
# little more.
LEAST, MOST, MOST_COMPLETE = 30, 2000, 500
FEWEST = 5  # rows of a task: fewer hardly tell how it is related
BY_CHANCE = 1e-3  # how often a right model has any such row
MEDIAN = norm.ppf(0.75)  # of the size of a standard normal variable
LITTLE = 1e-8  # of noise in what is left of a row: rounding, or the trend takes all


def unforeseen(problem, mode):
    """Rows that others do not foresee, and by how many standard deviations.

    Few or very many rows are not asked, nor is a mode with almost no noise: kernels
    seldom suit a function so exactly. Nor are tasks of few rows. Where most rows of a
    task are far off, as those of a noisier one, these are what is usual.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.

    Returns
    -------
    rows : ndarray of int of shape (n_found,)
        Positions in the data of the problem, the farthest first.
    sizes : ndarray of shape (n_found,)
        Of their errors, in standard deviations.
    """
    n, exact = len(problem.data), problem.engine.exact
    most = MOST if problem.data.design is None else MOST_COMPLETE
    if not (exact and LEAST <= n <= most and problem.is_noisy(mode)):
        return np.empty(0, dtype=int), np.empty(0)
    X, tasks, y, noise, K = problem.some(mode, np.arange(n))
    with limit_threads(n):
        W = problem.prior.precision(K, X, tasks)
        left = np.diagonal(W)
        z = np.abs(W @ y) / np.sqrt(np.where(left * noise > LITTLE, left, np.inf))
    of_tasks = pd.Series(z).groupby(tasks)
    usual = of_tasks.transform("median").to_numpy() / MEDIAN
    told = of_tasks.transform("size").to_numpy() >= FEWEST
    bound = norm.isf(0.5 * BY_CHANCE / n)
    rows = np.flatnonzero(told & (z > bound * np.maximum(usual, 1.0)))
    rows = rows[np.argsort(-z[rows])]
    return rows, z[rows]
