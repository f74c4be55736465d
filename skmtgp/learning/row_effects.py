r"""Whether rows have effects of their own, common to all tasks, that inputs hide.

Where tasks are observed at the same inputs, as in a table with a column for each, each
target is predicted twice: from all others, those of its row too, and from other rows
alone. A kernel takes effects of rows for a very rough function. Then the rest of a row
tells much of a target, and other rows tell little. Both is so of functions that are
rough in truth, too. So a model is learned that has a second kernel, by which a row is
related to itself alone: is it likelier, and better at rows that are left out?
"""

from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import pdist
from sklearn.gaussian_process.kernels import RBF

from skmtgp._data.complete import design_of
from skmtgp._numerics.linalg import RESOLVED
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.left_out import errors_left_out
from skmtgp.learning.climbing import climb
from skmtgp.learning.own_kernels import is_of_one_smooth_kernel, with_terms
from skmtgp.model.task_covariance import LowRank, leading_eigenvectors

MOST_ROWS, FEWEST = 600, 10  # rows, of which inputs: of more it would take long
MOST_STEPS = 50  # of the climb: the gain is clear before
TELLING = 0.5  # of the mean squared error is left where the rest of a row is known
BETTER = 0.9  # of it at rows that are left out, with the second kernel
NEAR = 0.1  # of the least distance of two inputs
LITTLE = 0.1  # of the variance of functions, that tasks have of their own at first
SHARES = 0.5, 0.9  # of the variance that effects of rows may have
SCALES = np.log([1.0, 4.0, 16.0, 64.0])  # by which functions may be slower


class RowEffects(NamedTuple):
    """What a kernel of effects of rows gains.

    Attributes
    ----------
    gain : float
        Nats of BIC.
    ratio : float
        Mean squared error at rows that are left out, over that without it.
    straight : bool
        Whether the other kernel is linear.
    length_scale : float
        Of that kernel.
    ranks : list of int
        Of both kernels.
    """

    gain: float
    ratio: float
    straight: bool
    length_scale: float
    ranks: list

    @property
    def clear(self):
        """Whether rows that are left out are predicted better."""
        return self.ratio < BETTER


def effects_of_rows(problem, mode, smooth, linear):
    """What a kernel of effects of rows gains, where it may.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.
    smooth, linear : Kernel
        Of what inputs tell, where learning of it begins: linear where straight lines of
        each task predict rows that are left out better than the mode does.

    Returns
    -------
    effects : RowEffects or None
        None where it is not asked: most tasks are not observed at the same inputs, rows
        are few or many, or k^x or K^rho are not as those of `gain_of_own_kernels`. Nor
        where the rest of a row does not halve the mean squared error.
    """
    rows = _rows(problem) if is_of_one_smooth_kernel(problem) else None
    if rows is None:
        return None
    alone = errors_left_out(problem, mode.theta, np.arange(len(rows)))
    whole = np.square(errors_left_out(problem, mode.theta, rows)).mean()
    if np.square(alone).mean() > TELLING * whole:
        return None
    straight = np.square(_errors_of_lines(problem.data)).mean() < whole
    both = _with_effects(problem, linear if straight else smooth)
    with limit_threads(len(rows)):
        found = climb(both, _likeliest_start(both, problem, mode))
    price = both.prior.n_hyperparameters - problem.prior.n_hyperparameters
    gain = both.log_likelihood(found) - problem.log_likelihood(mode)
    better = np.square(errors_left_out(both, found.theta, rows)).mean()
    return RowEffects(
        gain=float(gain - 0.5 * price * np.log(len(rows))),
        ratio=float(better / whole),
        straight=bool(straight),
        length_scale=both.prior.terms[1][0].length_scale,
        ranks=[form.rank for _, form in both.prior.terms],
    )


def _rows(problem):
    """Which input each row has; None where it is not asked."""
    data = problem.data
    if len(data) > MOST_ROWS:
        return None
    design = design_of(data.X, data.tasks) if data.design is None else data.design
    if design is None or len(design) < FEWEST:
        return None
    rows = np.empty(len(data), dtype=int)
    inputs, tasks = np.nonzero(design >= 0)
    rows[design[inputs, tasks]] = inputs
    return rows


def _errors_of_lines(data):
    """Errors of least squares of each task, of rows that are left out."""
    errors = np.empty(len(data))
    for task in range(data.n_tasks):
        own = data.tasks == task
        X, y = data.X[own], data.y[own]
        A = np.column_stack([np.ones(len(X)), X - X.mean(axis=0)])
        size = np.linalg.norm(A, axis=0)
        A /= np.where(size > 0.0, size, 1.0)
        U, values, _ = np.linalg.svd(A, full_matrices=False)
        U = U[:, values > RESOLVED * values[0]]
        rest = 1.0 - np.square(U).sum(axis=1)
        errors[own] = (y - U @ (U.T @ y)) / np.maximum(rest, RESOLVED)
    return errors


def _with_effects(problem, kernel):
    """The problem with a second kernel, by which rows are related to themselves."""
    [(_, form)] = problem.prior.terms
    n_tasks, rank = form.n_tasks, max(2, form.rank)
    of_rows = RBF(_separation(problem.data.X), "fixed")
    terms = [(kernel, LowRank(n_tasks, rank)), (of_rows, LowRank(n_tasks, 1))]
    return with_terms(problem, terms, MOST_STEPS)


def _separation(X):
    """A length-scale by which no two inputs are related, unless they are equal.

    It has two digits.
    """
    distances = pdist(np.unique(X, axis=0))
    return float(f"{NEAR * distances.min():.1e}")


def _likeliest_start(both, problem, mode):
    """The best of some shares of effects of rows, and length-scales of the others."""
    [(kernel, _)] = problem.prior.theta_of_terms(mode.theta)
    (began, form), _ = both.prior.terms
    K_rho, value = problem.prior.K_rho_at(mode.theta), both.likelihood().value
    own = LITTLE * np.trace(K_rho) / len(K_rho) * np.eye(len(K_rho))  # no column is 0
    F = leading_eigenvectors(K_rho + own, form.rank).ravel()
    f = leading_eigenvectors(K_rho, 1).ravel()
    found = []
    slower = [began.theta]
    if len(kernel) == len(began.theta):  # they are length-scales, of the same columns
        slower += [kernel + scale for scale in SCALES]
    for share, theta_x in product(SHARES, slower):
        terms = (theta_x, np.sqrt(1.0 - share) * F), (np.empty(0), np.sqrt(share) * f)
        theta = both.prior.with_theta_of_terms(mode.theta, terms)
        theta = np.clip(theta, *both.prior.bounds())
        found.append((value(theta), theta))
    return max(found, key=itemgetter(0))[1]
