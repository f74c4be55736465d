"""Whether latent functions have kernels of their own, as where they vary on two scales.

The model of one kernel and rank r is that of two equal ones and ranks r - 1 and 1. Any
direction in the space of the latent functions may be that of the second: from the
likeliest, with length-scales that are longer or shorter, both are learned on.
"""

from dataclasses import replace
from operator import itemgetter

import numpy as np
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Dense
from skmtgp.learning.climbing import climb
from skmtgp.model.task_covariance import LowRank

# What is asked: of more rows, or functions, it would take long. Of complete data
# learning takes little, and the question as long as elsewhere.
MOST_ROWS, MOST_COMPLETE, MOST_RANK = 600, 200, 4
MOST_STEPS = 300  # of the climb: valleys without noise may be endless
ANGLES = 6  # in half a turn
SCALES = np.log([0.5, 2.0])  # by which length-scales of the second differ


def gain_of_own_kernels(problem, mode):
    """Nats of BIC that a kernel of its own for one latent function gains.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.

    Returns
    -------
    gain : float
        Minus infinity where it is not asked: K^rho is not of rank two to four, or has
        functions of another kind beside these, k^x has no length-scales alone, or rows
        are many.
    """
    if not _can_be_asked(problem):
        return -np.inf
    prior, data = problem.prior, problem.data
    [(kernel, form)] = prior.terms
    forms = LowRank(form.n_tasks, form.rank - 1), LowRank(form.n_tasks, 1)
    both = replace(problem, prior=prior.with_terms([(kernel, of) for of in forms]))
    steps = min(MOST_STEPS, problem.budget.max_iter)
    budget = replace(problem.budget, max_iter=steps, verbose=0)
    both = replace(both, engine=Dense(), budget=budget)
    price = both.prior.n_hyperparameters - prior.n_hyperparameters
    gain = both.log_likelihood(split(both, problem, mode))
    gain -= problem.log_likelihood(mode)
    return float(gain - 0.5 * price * np.log(len(data)))


def split(both, problem, mode):
    """The mode of two kernels that one leads to.

    Parameters
    ----------
    both : Problem
        With two terms of the same kind, the second of rank one.
    problem : Problem
        With one term, of the rank of both.
    mode : Mode
        Its mode.

    Returns
    -------
    mode : Mode
        Of both.
    """
    with limit_threads(len(both.data)):
        return climb(both, _likeliest_start(both, problem, mode))


def _can_be_asked(problem):
    data, prior = problem.data, problem.prior
    most = MOST_ROWS if data.design is None else MOST_COMPLETE
    if not problem.engine.exact or len(data) > most or data.Q is not None:
        return False
    if prior.n_terms > 1 or prior.trend or data.known:
        return False
    if type(prior.kernel) not in (RBF, Matern) or not prior.kernel.n_dims:
        return False
    form = prior.task_covariance
    return type(form) is LowRank and 1 < form.rank <= MOST_RANK


def _likeliest_start(both, problem, mode):
    """The best of some directions and length-scales of the second term."""
    likelihood, prior = both.likelihood(), problem.prior
    [(kernel, factor)] = prior.theta_of_terms(mode.theta)
    F = factor.reshape(problem.data.n_tasks, -1)
    is_scale = prior.n_length_scales[prior.of_kernel] > 0
    found = []
    for u in _directions(F):
        rest = F @ np.linalg.svd(u[:, None])[0][:, 1:]
        for scale in SCALES:
            terms = (kernel, rest.ravel()), (kernel + scale * is_scale, F @ u)
            theta = both.prior.with_theta_of_terms(mode.theta, terms)
            theta = np.clip(theta, *both.prior.bounds())
            found.append((likelihood.value(theta), theta))
    return max(found, key=itemgetter(0))[1]


def _directions(F):
    """Unit vectors among the columns of a factor: of each two some angles."""
    n, axes = F.shape[1], np.linalg.svd(F, full_matrices=False)[2]
    for j in range(n):
        for i in range(j):
            for angle in np.pi * np.arange(ANGLES) / ANGLES:
                yield np.cos(angle) * axes[i] + np.sin(angle) * axes[j]
