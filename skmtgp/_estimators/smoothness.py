"""How smooth k^x is where the user does not say: ever rougher or smoother kernels."""

from dataclasses import replace
from functools import partial

from skmtgp._estimators.named_kernels import SMOOTHNESS
from skmtgp._estimators.posing import kernels_of
from skmtgp._numerics.parallel import run
from skmtgp.learning.screening import with_kernel


def rougher(model, training, found, n_jobs=None):
    """Kernels that are ever less smooth, as long as that is likelier.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameter `kernel` says whether to ask.
    training : Training
        With the name of k^x.
    found : list of (Problem, Mode)
        Of each output, with this k^x.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    names : list of str
        Of k^x, from the first to the one to take.
    found : list of (Problem, Mode)
        With the last. What was tried in vain counts as spent.
    """
    names, least = [training.kernel], found[0][0].tuning.likelier
    for name in _kernels(model, training)[1]:
        kernel = as_named(model, training, name)
        change = partial(with_kernel, kernel=kernel, gain=least)
        others = run(change, found, n_jobs=n_jobs)
        if log_likelihood(others) < log_likelihood(found) + least:
            return names, counting(found, others)
        names, found = [*names, name], others
    return names, found


def smoother(model, training, found, n_jobs=None):
    """The same of ever smoother ones, unless they are less likely."""
    names, least = [training.kernel], log_likelihood(found)
    least -= found[0][0].tuning.likelier
    for name in _kernels(model, training)[0]:
        kernel = as_named(model, training, name)
        others = run(partial(with_kernel, kernel=kernel), found, n_jobs=n_jobs)
        if log_likelihood(others) < least:
            return names, counting(found, others)
        names, found = [*names, name], others
    return names, found


def as_named(model, training, name):
    """k^x of a name with its starting values."""
    return kernels_of(model, replace(training, kernel=name))[0]


def _kernels(model, training):
    """Names of what k^x may be instead: ever smoother, and ever less smooth."""
    if model._kernels() != [None] or model.max_iter == 0:
        return [], []
    k = SMOOTHNESS.index(training.kernel)
    return SMOOTHNESS[:k][::-1], SMOOTHNESS[k + 1 :]


def log_likelihood(found):
    """Log likelihood, summed over the outputs."""
    return sum(mode.value for _, mode in found)


def counting(found, others):
    """What was found, with what the others took on from there."""
    pairs = zip(found, others, strict=True)
    return [(problem, mode.spending(other)) for (problem, mode), (_, other) in pairs]
