"""Whether all tasks share one more function, of a single input.

As all countries of a panel feel the shocks of a year, or all sensors the weather of an
hour. One kernel of all inputs cannot tell it: it relates rows only where all inputs are
near. So a second kernel of one input is added at the mode that was learned, once for
each, and from the likeliest both are learned on.
"""

from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Matern

from skmtgp._numerics.parallel import limit_threads
from skmtgp.kernels import Columns
from skmtgp.learning.climbing import climb
from skmtgp.learning.own_kernels import are_few, is_of_one_kernel, with_terms
from skmtgp.model.task_covariance import low_rank

MOST_STEPS = 50  # of the climb: the gain is clear before
FEWEST = 5  # values of an input
SCALES = 0.1, 0.5  # of the deviation of an input, where length-scales begin
SHARES = 0.3, 1.0  # of the noise, where the variance of the function begins
WIDE = np.array([1e-2, 1e3])  # bounds of the length-scale over a deviation


class CommonFunction(NamedTuple):
    """What one more function of one input gains.

    Attributes
    ----------
    gain : float
        Nats of BIC.
    feature : int
        Position of the input.
    kernel : Matern
        Of that input alone, as it was learned.
    """

    gain: float
    feature: int
    kernel: Matern


NOT_ASKED = CommonFunction(-np.inf, -1, None)


def common_function(problem, mode, enough=-np.inf):
    """What one more function gains that all tasks share, of the likeliest input.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.
    enough : float, default=-inf
        What must be gained to be of use: the climb ends where it cannot hope for that.

    Returns
    -------
    found : CommonFunction
        `NOT_ASKED` where rows are many, or without noise, K^rho or k^x are not learned
        alone, no input has enough values, or there is one input.
    """
    can_be_asked = are_few(problem.data) and is_of_one_kernel(problem)
    if not (can_be_asked and problem.is_noisy(mode)):
        return NOT_ASKED
    X = problem.data.X
    varies = X.std(axis=0) > 0.0  # perhaps not, of numbers that are tiny
    inputs = [j for j in np.flatnonzero(varies) if len(np.unique(X[:, j])) >= FEWEST]
    if not inputs or varies.sum() == 1:
        return NOT_ASKED
    with limit_threads(len(X)):
        starts = [(j, *_likeliest_start(problem, mode, j)) for j in inputs]
        feature, both, _, theta = max(starts, key=itemgetter(2))
        price = both.prior.n_hyperparameters - problem.prior.n_hyperparameters
        charged = 0.5 * price * np.log(len(X))
        least = mode.value + charged + enough
        found = climb(both, theta, least=least, noisy=True)
    gain = both.log_likelihood(found) - problem.log_likelihood(mode)
    _, of_input = both.prior.kernel_at(found.theta)
    gain = float(gain - charged)
    return CommonFunction(gain, int(feature), of_input.kernel)


def _likeliest_start(problem, mode, feature):
    """The problem with a second kernel, and the best of some starts with its value."""
    prior, deviation = problem.prior, problem.data.X[:, feature].std()
    kernel = Columns(Matern(deviation, deviation * WIDE, nu=1.5), [feature])
    shared = low_rank(prior.n_tasks, 0, shared=True)
    both = with_terms(problem, [*prior.terms, (kernel, shared)], MOST_STEPS)
    [of_first], value = prior.theta_of_terms(mode.theta), both.likelihood().value
    noise, found = prior.log_noise_at(mode.theta).mean(), []
    for scale, share in product(np.log(SCALES), np.log(SHARES)):
        of_second = kernel.theta + scale, np.array([noise + share])
        theta = both.prior.with_theta_of_terms(mode.theta, [of_first, of_second])
        theta = np.clip(theta, *both.prior.bounds())
        found.append((value(theta), theta))
    return both, *max(found, key=itemgetter(0))
