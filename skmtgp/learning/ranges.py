"""Length-scales at which learning begins, where those given would lead nowhere.

If the given length-scales are far shorter than any distance, no two rows are related.
The likelihood is then flat, and no climb leaves the place: coordinates in metres and a
kernel with length-scales of 1. A spherical covariance ends at its range, and its
likelihood has modes at ranges that are far too long. In both cases the likelihood says,
over a grid of ranges, where to begin.

That of a spherical covariance bends wherever a pair of rows comes within the range: it
has modes close to each other, some a few nats apart. So other ranges are looked at once
more from the mode that was found.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.distance import cdist
from sklearn.utils import gen_batches

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.progress import say
from skmtgp.kernels import Spherical
from skmtgp.learning.climbing import climb
from skmtgp.learning.summarised import exact_part
from skmtgp.learning.telling import about, in_words
from skmtgp.model.kernel_check import sample_rows
from skmtgp.model.task_covariance import ones

AT_ONCE = 5000  # rows


def begun_in_sight(problem):
    """The problem with length-scales from which learning finds its way.

    Parameters
    ----------
    problem : Problem
        What is to be learned.

    Returns
    -------
    problem : Problem
        As it was, unless no two rows are related where it begins, or its kernel is
        spherical.
    """
    kernel, tuning = problem.prior.kernel, problem.tuning
    scales = problem.prior.of_length_scales[problem.prior.of_kernel]
    if not scales.any() or not problem.budget.max_iter:
        return problem
    kernels, X = problem.prior.kernels, problem.data.X
    if not (_has_spherical(kernels) or _is_blind(kernels, X, tuning)):
        return problem
    coarse = exact_part([problem], [problem.prior.task_covariance])[0]
    coarse = coarse.coarse_to_fine()[0]
    thetas = [kernel.theta, *_others(coarse, scales)]
    with limit_threads(len(coarse.data)):
        values = [_best_value(coarse, theta) for theta in thetas]
    best = int(np.argmax(values))
    if values[best] < values[0] + tuning.doubt:
        return problem
    if problem.budget.verbose:
        times = f"{np.exp((thetas[best] - thetas[0])[scales].max()):.3g} times"
        say(f"{about(problem)}length-scales begin at {times} those of the kernel")
    begun = kernel.clone_with_theta(thetas[best])
    return replace(problem, prior=replace(problem.prior, kernel=begun))


def along_ranges(problem, mode):
    """The better of a mode and of what is found from other spherical ranges.

    Parameters
    ----------
    problem : Problem
        What was learned.
    mode : Mode
        What was found.

    Returns
    -------
    mode : Mode
        As it was, unless a kernel is spherical, and the rows are few.
    """
    few = problem.engine.exact and len(problem.data) <= problem.tuning.bent
    spherical = _has_spherical(problem.prior.kernels)
    if not (few and spherical and problem.budget.max_iter):
        return mode
    likelihood = problem.likelihood()
    with limit_threads(likelihood.side):
        starts = [
            start
            for direction in _directions(problem)
            for start in _peaks(problem, likelihood, mode, direction)
        ]
    found = [mode.led_to(climb(problem, start)) for start in starts]
    best = max(found, key=lambda of: of.value, default=mode)
    if best.value <= mode.value:
        return mode.counting(found)
    if problem.budget.verbose:
        value = in_words(problem, best.theta, best.value)
        say(f"{about(problem)}{value} at another range")
    return best.counting([of for of in [mode, *found] if of is not best])


def _directions(problem):
    """Steps of theta by one: of all ranges together, and of each of several."""
    scales = problem.prior.of_length_scales.astype(np.float64)
    each = np.diag(scales)[scales > 0.0]
    return [scales, *each] if len(each) > 1 else each


def _peaks(problem, likelihood, mode, direction):
    """Where to climb: the best two maxima along a direction, but the mode itself."""
    tuning = problem.tuning
    steps = np.linspace(-tuning.around, tuning.around, tuning.n_around)
    found = [_likeliest(problem, likelihood, mode.theta + h * direction) for h in steps]
    values = np.array([-np.inf, *(value for value, _ in found), -np.inf])
    here, before, after = values[1:-1], values[:-2], values[2:]
    is_peak = (here >= before) & (here >= after) & (np.abs(steps) > tuning.near)
    peaks = np.flatnonzero(is_peak & (here > mode.value - tuning.doubt))
    best = sorted(peaks, key=lambda k: -here[k])[:2]
    return [found[k][1] for k in best]


def _likeliest(problem, likelihood, theta):
    """The best likelihood with several noise variances, and theta there."""
    lower, upper = problem.prior.bounds()
    noise = problem.prior.unexplained
    moved = [
        np.clip(theta + shift * noise, lower, upper) for shift in problem.tuning.shifts
    ]
    values = list(map(likelihood.value, moved))
    return max(values), moved[int(np.argmax(values))]


def _has_spherical(kernels):
    """Whether a kernel, or that of a term, has a spherical part."""
    parts = [
        part for kernel in kernels for part in (kernel, *kernel.get_params().values())
    ]
    return any(isinstance(part, Spherical) for part in parts)


def _is_blind(kernels, X, tuning):
    """Whether most rows have no other that any of the terms relates to them."""
    if is_dask(X):  # which would be computed for this
        return False
    some = sample_rows(X)
    related = np.zeros(len(some), dtype=bool)
    for rows in gen_batches(len(X), AT_ONCE):
        for kernel in kernels:
            related |= _relates(kernel, some, X[rows], tuning)
        if related.mean() >= 0.5:
            return False
    return True


def _relates(kernel, some, X, tuning):
    """Whether the kernel relates any other row to each of some."""
    with np.errstate(all="ignore"):
        K = np.abs(kernel(some, X))
        K[cdist(some, X) == 0.0] = 0.0
        variances = np.multiply.outer(kernel.diag(some), kernel.diag(X))
        return (tuning.unrelated * np.sqrt(variances) < K).any(axis=1)


def _others(problem, scales):
    """Theta with length-scales from the shortest that relate most rows on."""
    prior, X, tuning = problem.prior, problem.data.X, problem.tuning
    kernel = prior.kernel

    def moved(step):
        theta = kernel.theta + np.log(2.0) * step * scales
        return np.clip(theta, *kernel.bounds.reshape(-1, 2).T)

    def is_blind(step):
        there = replace(prior, kernel=kernel.clone_with_theta(moved(step)))
        return _is_blind(there.kernels, X, tuning)

    shortest, most = 0, tuning.most_doublings
    while shortest > -most and not is_blind(shortest - 1):
        shortest -= 1
    while shortest < most and is_blind(shortest):
        shortest += 1
    return [moved(shortest + step) for step in range(tuning.doublings)]


def _best_value(problem, theta):
    """The best likelihood of independent tasks and of one function, by the noise.

    Not by one as large as levels are, beside which no function counts.
    """
    prior, forms = problem.prior, [problem.prior.task_covariance]
    if prior.n_terms == 1 and prior.n_tasks > 1:
        forms.append(ones(prior.n_tasks))
    size = min(prior.scale, prior.within)
    less = prior.log_noise + 2.0 * np.log(size / prior.scale)
    more = np.log(problem.tuning.much_noise * size**2)
    noises = set(np.clip([less, more], *prior.log_noise_bounds).tolist())
    values = []
    for form, log_noise in product(forms, noises):
        of_form = problem.with_form(form)
        start = of_form.theta(kernel=theta, log_noise=log_noise)
        with np.errstate(all="ignore"):
            values.append(of_form.likelihood().value(start))
    return max(values)
