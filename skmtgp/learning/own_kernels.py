"""Whether latent functions have kernels of their own, as where they vary on two scales.

The model of one kernel and rank r is that of two equal ones and ranks r - 1 and 1. Any
direction in the space of the latent functions may be that of the second: from the
likeliest, with length-scales that are longer or shorter, both are learned on. Another
form of few tasks, as with a diagonal, is that of the rank of its K^rho. One function
is two, the second of which is zero.
"""

from dataclasses import replace
from operator import itemgetter

import numpy as np
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Dense
from skmtgp.learning.climbing import annealed, climb
from skmtgp.model.task_covariance import Enlarged, LowRank, leading_eigenvectors

# What is asked: of more rows, or functions, it would take long. Of complete data
# learning takes little, and the question as long as elsewhere.
MOST_ROWS, MOST_COMPLETE, MOST_RANK = 600, 200, 4
MOST_FULL = 3  # rank of another form, of which nothing says that its rank is low
MOST_STEPS = 300  # of the climb: valleys without noise may be endless
NONE = 1e-12  # of the largest eigenvalue of K^rho, that is none
ANGLES = 6  # in half a turn
SCALES = np.log([0.5, 2.0])  # by which length-scales of the second differ


def gain_of_own_kernels(problem, mode, enough=np.inf, *, kernel=None):
    """Nats of BIC that a kernel of its own for one latent function gains.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    mode : Mode
        Its mode.
    enough : float, default=inf
        Once this much is gained, no better mode is looked for.
    kernel : Kernel, default=None
        That of each, with the parameters of the one that was learned. None is that one.

    Returns
    -------
    gain : float
        Minus infinity where it is not asked: K^rho is held, or of rank five or more, or
        there is noise and it is not of rank two or more alone, k^x has no length-scales
        alone, or rows are many.
    """
    if not _can_be_asked(problem) or _takes_long(problem, mode):
        return -np.inf
    both = _with_two_kernels(problem, mode, kernel)
    price = both.prior.n_hyperparameters - problem.prior.n_hyperparameters
    charged = 0.5 * price * np.log(len(problem.data)) + problem.log_likelihood(mode)
    gain = -np.inf
    with limit_threads(len(both.data)):
        for found in _climbs(both, problem, mode):
            gain = max(gain, both.log_likelihood(found) - charged)
            if gain > enough:
                break
    return float(gain)


def ranks_of_two(problem, mode):
    """The ranks of two kernels into which a mode of one is split.

    Parameters
    ----------
    problem : Problem
        Of an output, with one kernel.
    mode : Mode
        Its mode.

    Returns
    -------
    ranks : list of int
        That of the second is one.
    """
    return [_factor(problem, mode).shape[1] - 1, 1]


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


def _with_two_kernels(problem, mode, kernel=None):
    """The problem of two kernels of the same kind, in dense inference."""
    [(learned, form)] = problem.prior.terms
    kernel = learned if kernel is None else kernel
    ranks = ranks_of_two(problem, mode)
    terms = [(kernel, LowRank(form.n_tasks, rank)) for rank in ranks]
    return with_terms(problem, terms, MOST_STEPS)


def with_terms(problem, terms, most_steps):
    """The problem of other terms, to be learned quietly by dense inference.

    Parameters
    ----------
    problem : Problem
        Of an output, in memory.
    terms : list of (kernel, form)
        See `Prior.terms`.
    most_steps : int
        Most iterations of a climb, if the user does not want fewer.

    Returns
    -------
    problem : Problem
    """
    steps = min(most_steps, problem.budget.max_iter)
    return replace(
        problem,
        prior=problem.prior.with_terms(terms),
        engine=Dense(),
        budget=replace(problem.budget, max_iter=steps, verbose=0),
    )


def _climbs(both, problem, mode):
    """Modes of two kernels; without noise several, as many starts lead nowhere."""
    yield climb(both, _likeliest_start(both, problem, mode))
    if not problem.is_noisy(mode):
        start = _likeliest_start(both, problem, mode, noisy=True)
        yield annealed(both, start).mode
        yield climb(both, start)


def _can_be_asked(problem):
    return are_few(problem.data) and is_of_one_smooth_kernel(problem)


def are_few(data):
    """Whether rows are so few that another model is learned quickly."""
    return len(data) <= (MOST_ROWS if data.design is None else MOST_COMPLETE)


def is_of_one_kernel(problem):
    """Whether k^x and K^rho are learned, and nothing else but levels and noise is.

    Parameters
    ----------
    problem : Problem
        Of an output.

    Returns
    -------
    alone : bool
    """
    data, prior = problem.data, problem.prior
    if not problem.engine.exact or data.Q is not None:
        return False
    if prior.n_terms > 1 or prior.trend or data.known or not prior.kernel.n_dims:
        return False
    return prior.n_tasks > 1 and _is_learned(prior.task_covariance)


def is_of_one_smooth_kernel(problem):
    """Whether the same is true, and k^x has length-scales alone.

    Parameters
    ----------
    problem : Problem
        Of an output.

    Returns
    -------
    alone : bool
    """
    return type(problem.prior.kernel) in (RBF, Matern) and is_of_one_kernel(problem)


def _takes_long(problem, mode):
    """Whether K^rho has too many functions, or noise and another form than low rank.

    With noise hardly any other form has two kernels, and asking takes as long.
    """
    form = problem.prior.task_covariance
    if type(form) is LowRank and form.rank > 1:
        return form.rank > MOST_RANK
    return problem.is_noisy(mode) or sum(ranks_of_two(problem, mode)) > MOST_FULL


def _is_learned(form):
    """Whether it is of a factor that is learned, perhaps with something more."""
    while isinstance(form, Enlarged):
        form = form.form
    return type(form) is LowRank


def _factor(problem, mode):
    """F with F F^T = K^rho, of two columns or more, the second perhaps empty."""
    form, K_rho = problem.prior.task_covariance, problem.prior.K_rho_at(mode.theta)
    values = np.linalg.eigvalsh(K_rho)
    rank = (
        (values > NONE * values[-1]).sum() if form.shared or form.n_own else form.rank
    )
    return leading_eigenvectors(K_rho, max(2, int(rank)))


def _likeliest_start(both, problem, mode, *, noisy=False):
    """The best of some directions and length-scales of the second term."""
    likelihood, prior = both.likelihood(), problem.prior
    [(kernel, _)] = prior.theta_of_terms(mode.theta)
    F = _factor(problem, mode)
    is_scale = prior.n_length_scales[prior.of_kernel] > 0
    found = []
    for u in _directions(F):
        rest = F @ np.linalg.svd(u[:, None])[0][:, 1:]
        for scale in SCALES:
            terms = (kernel, rest.ravel()), (kernel + scale * is_scale, F @ u)
            theta = both.prior.with_theta_of_terms(mode.theta, terms)
            theta = both.with_noise(theta) if noisy else theta
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
