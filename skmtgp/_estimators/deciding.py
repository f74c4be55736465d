"""In which units targets are learned, with which noise and how smooth a k^x."""

from dataclasses import replace
from functools import partial

import numpy as np
from sklearn.gaussian_process.kernels import Kernel, Sum

from skmtgp._data.dask import is_dask
from skmtgp._data.oddities import (
    warn_of_binary,
    warn_of_constant_tasks,
    warn_of_far_levels,
)
from skmtgp._data.overlap import share_overlapping
from skmtgp._estimators.least_noise import with_least_noise
from skmtgp._estimators.many_columns import with_alike_columns
from skmtgp._estimators.named_kernels import DEFAULT
from skmtgp._estimators.posing import pose
from skmtgp._estimators.smoothness import log_likelihood, rougher
from skmtgp._estimators.units import FAR, shared_units, units_of_tasks
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Dense
from skmtgp.learning.forecast import are_many
from skmtgp.learning.screening import (
    as_large,
    criterion,
    differ_in_noise,
    differ_in_size,
    price_of_tasks,
    score,
    screen,
    with_own_noise,
)
from skmtgp.learning.summarised import exact_part
from skmtgp.learning.tuning import TUNING

# Nats that noise of each task must gain, beside what its numbers are worth. A few rows
# that happen to be near the function gain some, and a variance that is too small costs
# far more than one that is too large (benchmarks/grouped.py). Less is enough with more
# than so many rows of a task.
SURE, FEW_ROWS = 8.0, 20.0
# Of where noise is held up: a deviation of 2 % of the functions'. With less of it, few
# rows have other modes than all.
BEYOND = np.log(50.0)
NOTHING = 1e-8  # variances of the targets
ROWS_OF_RANGES = 3000
# Rows of a task that tell how large its function is. Of fewer, with one noise, eq. 8
# charges too little for a unit that follows them.
ROWS_OF_SIZES = 8
ASKED = 2  # times as many rows: the small model is learned several times


def decide(model, training, progress=None, foretell=None):
    """The training data with the units, noise and k^x that are to be learned with.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters `normalize_y`, `noise` and `kernel` say which, or that the data
        do.
    training : Training
        Checked.
    progress : callable, default=None
        Is told what the data say, see `fitting`.
    foretell : callable, default=None
        Is called with problems of many rows before anything is compared. It says how
        long learning will take.

    Returns
    -------
    training : Training
        With `units`, `noise` and `kernel`.
    """
    # of two values a few rows are often equal
    constant = training.tasks[training.constants[:, ~training.binary].any(axis=1)]
    fixed = isinstance(model.noise_variance_bounds, str)
    told = None if fixed else model._some_noise()
    warn_of_constant_tasks(constant, told=told)
    warn_of_binary(training.binary)
    training = _decided(model, training, foretell)
    report = progress and "auto" in (model.normalize_y, model.noise)
    report = report and progress(
        "units", 1, lambda _, chosen: f"chosen from the data: {chosen}"
    )
    if report:
        report(0, training.chosen)
    return training


def _decided(model, training, foretell):
    noises = kinds_of_noise(model, training)
    with limit_threads(len(training.Y)):
        units = _units(model, training)
    training = replace(training, noise=noises[0])
    candidates = [training.with_units(of) for of in units]
    first = candidates[0]
    learn = partial(_learned_small, model)
    least = with_least_noise(model, first, partial(learn, first)).least_noise
    alike = with_alike_columns(model, first, learn).alike
    candidates = [replace(of, least_noise=least, alike=alike) for of in candidates]
    if len(candidates) == len(noises) == 1:  # k^x is asked when it is learned
        return candidates[0]
    if foretell is not None and _takes_long(model, candidates[0]):
        foretell(pose(model, candidates[0], told=False))
        candidates = [replace(of, foretold=True) for of in candidates]
    best, of_outputs = _in_best_units(model, candidates, noises)
    noisy = all(of.is_noisy(mode, beyond=BEYOND) for of, mode in of_outputs)
    return replace(best, noisy=noisy and not _adds_up(model._kernels()))


def for_own_noise(model, training):
    """The training data with the units and k^x that suit noise of each task.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters say what to ask.
    training : Training
        As decided for one noise.

    Returns
    -------
    training : Training
    """
    training = replace(training, noise="per_task", kernel=DEFAULT)
    candidates = [training.with_units(of) for of in _units(model, training)]
    return _in_best_units(model, candidates, ["per_task"])[0]


def _in_best_units(model, candidates, noises):
    """Of training data in several units the likeliest, see `screened`."""
    [first, *_] = candidates
    with limit_threads(len(first.Y)):
        found = [screened(model, candidate, noises) for candidate in candidates]
        scores = np.array([score for score, *_ in found])
        if len(found) > 1 and _compares_sizes(first, found, noises[0]):
            scores += [_gain_as_large(*of) for _, *of in found]
    return found[int(np.argmax(scores))][1:]


def _compares_sizes(training, found, shared):
    """Whether it counts in which units functions are as large in all tasks.

    Noise of each task can take the place of units. And where noise is as large as all
    functions in units of each, one unit explains both.
    """
    own = [candidate.noise != shared for _, candidate, _ in found]
    enough = len(training.Y) >= ROWS_OF_SIZES * len(training.tasks)
    return own[0] or (enough and not any(own))


def _adds_up(kernels):
    """Whether functions are sums, of which noise may hide one if rows are few."""
    parts = [
        part
        for kernel in kernels
        if isinstance(kernel, Kernel)
        for part in (kernel, *kernel.get_params().values())
    ]
    return len(kernels) > 1 or any(isinstance(part, Sum) for part in parts)


def _takes_long(model, training):
    """Whether the small model does, so that time is to be foretold before."""
    if not are_many(*training.Y.shape):
        return False
    few = _small(model, training)[0].coarse_to_fine()[0]
    return are_many(ASKED * len(few.data), training.Y.shape[1])


def _learned_small(model, training):
    """The problem and the mode of each output of the small model."""
    small = training.without_levels() if model._has_levels() else training
    with limit_threads(len(training.Y)):
        return [screen(problem) for problem in _small(model, small)]


def _units(model, training):
    """Units that may be taken; the first ones where there is nothing to decide."""
    codes, n_tasks, known = training.codes, len(training.tasks), training.known
    if model.normalize_y == "per_task" and n_tasks > 1:
        return [units_of_tasks(training.unexplained(True), codes, n_tasks, known)]
    Y = training.unexplained(False)
    centred = bool(model.normalize_y)
    # without an amplitude in the model a scale changes it; otherwise, the path
    scaled = centred or model._learns_amplitude()
    shared = shared_units(Y, centred=centred, scaled=scaled, known=known)
    if model._has_levels() and scaled:
        shared = shared.without_levels(Y, codes, n_tasks, known)
        shared = _without_far_levels(shared, training, centred)
    asks = model.normalize_y == "auto" and n_tasks > 1 and model.max_iter > 0
    if not asks or training.descriptors is not None:  # of which units do not follow
        return [shared]
    if training.slopes and training.slopes.place(True) is None:
        return [shared]  # means of tasks would leave nothing of some columns
    of_tasks = units_of_tasks(training.unexplained(True), codes, n_tasks, known)
    asks = differ_in_size(of_tasks.scale, training.measured)
    return [shared, of_tasks] if asks else [shared]


def _without_far_levels(shared, training, centred):
    """Shared units, with most of far levels taken off first.

    Not where tasks have descriptors, as these may tell a level; nor where tasks have
    inputs of their own, as a function may be what their means differ by.
    """
    of_tasks = training.codes, len(training.tasks), training.known
    far = shared.far_levels(training.Y, *of_tasks).max()
    if far <= FAR:
        return shared
    reason = _why_levels_stay(training, centred)
    if reason is None:
        return shared.without_far_levels(training.unexplained(True), *of_tasks)
    warn_of_far_levels(far, reason)
    return shared


def _why_levels_stay(training, centred):
    """Why far levels are not taken off; None if they are."""
    constant = training.slopes and training.slopes.place(True) is None
    reasons = {
        "normalize_y=False leaves the targets as they are": not centred,
        "tasks have descriptors": training.descriptors is not None,
        "the rows are Dask's": is_dask(training.Y),
        "the trend has a constant": constant,
    }
    told = next((why for why, holds in reasons.items() if holds), None)
    if told is None and _are_apart(training):
        return "tasks hardly overlap in an input, which may explain them"
    return told


def _are_apart(training):
    """Whether tasks were measured at inputs that hardly overlap."""
    rows = np.random.default_rng(0).permutation(len(training.codes))[:ROWS_OF_RANGES]
    share = share_overlapping(training.features[rows], training.codes[rows])
    return share < TUNING.overlapping


def kinds_of_noise(model, training):
    """Kinds of noise that may be taken."""
    if model.noise != "auto":
        return [model.noise]
    fixed = isinstance(model.noise_variance_bounds, str)
    if fixed or len(training.tasks) == 1 or model.max_iter == 0:
        return ["shared"]
    if training.constant.any():  # its own noise would vanish, and k^x follow it alone
        return ["shared"]
    if training.binary.any():  # so would that of a task with one step
        return ["shared"]
    return ["shared", "per_task"]


def screened(model, training, noises):
    """What the small model says of noise and k^x, in the units of the training data.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters say what to ask.
    training : Training
        With units, and the first kind of noise.
    noises : list of str
        Kinds that may be taken.

    Returns
    -------
    score : float
        Of these units.
    training : Training
        With the best noise and k^x.
    found : list of (Problem, Mode)
        Of each output.
    """
    # how far apart levels are says nothing of units: they have the same prior in all
    small = training.without_levels() if model._has_levels() else training
    found = [screen(problem) for problem in _small(model, small)]
    candidates = [(training, found)]
    if len(noises) > 1 and (own := _own_noise(found)):
        candidates.append((replace(training, noise=noises[1]), own))
    # of either noise: what noise of each task explains is no roughness
    scored, among_units = [], []
    for candidate, found in candidates:
        kernels, found = rougher(model, candidate, found)
        candidate = replace(candidate, kernel=kernels[-1])
        scored.append((_score(small, found), candidate, found))
        own = candidate.noise != noises[0]
        among_units.append(scored[-1][0] - own * _head_start(found))
    _, *best = max(scored, key=lambda of: of[0])
    return max(among_units), *best


def _gain_as_large(training, found):
    """Nats that are gained if functions are as large in all tasks, in these units.

    One amplitude then serves all tasks, for one of each, which its rows alone tell. In
    units of each task it is no number of its own, because all units can be multiplied
    by it.
    """
    gain, own = 0.0, training.units.own_scales
    for problem, mode in found:
        data, large = problem.data, as_large(problem, mode)
        if large is not None:
            spared = price_of_tasks(data) * (1.0 if own else 1.0 - 1.0 / data.n_tasks)
            gain += max(0.0, spared - max(0.0, mode.value - large.value))
    return gain


def _head_start(found):
    """What noise of each task gains by chance over units of each task.

    Noise variances are learned, so each gains half a nat. And with units of each task
    the noise is one number more, which counts as one of these.
    """
    n_tasks = found[0][0].data.n_tasks
    return sum(0.5 * n_tasks + price_of_tasks(of.data) / n_tasks for of, _ in found)


def _own_noise(found):
    """What was found with noise of each task, if that may gain; else nothing.

    Where it seems not to, noise may have been taken for large functions. Then it is
    learned from functions that are as large in all tasks. Data without noise are not
    asked: what they gain is another mode. Nor are those whose covariance is singular
    wherever learning went.
    """
    noisy = all(problem.is_noisy(mode) for problem, mode in found)
    if not (noisy and np.isfinite(log_likelihood(found))):
        return []
    if any(differ_in_noise(*of) for of in found):
        own = [with_own_noise(*of) for of in found]
    else:
        large = [(problem, as_large(problem, mode)) for problem, mode in found]
        known = all(mode is not None for _, mode in large)
        if not (known and any(differ_in_noise(*of) for of in large)):
            return []
        own = [with_own_noise(*of) for of in large]
    gain = sum(criterion(*of) for of in own) - sum(criterion(*of) for of in found)
    is_sure = gain > least_gain(problem for problem, _ in found)
    return own if is_sure and not any(_vanishes(*of) for of in own) else []


def least_gain(problems):
    """Nats that noise of each task must gain, summed over the outputs."""
    data = [problem.data for problem in problems]
    shares = [FEW_ROWS * of.n_tasks / of.n_measured for of in data]
    return SURE * sum(min(1.0, share) for share in shares)


def _vanishes(problem, mode):
    """Whether nothing is left of a task: noise and function follow its one or two rows.

    Their likelihood has no bound then.
    """
    prior = problem.prior
    if prior.n_terms > 1:
        return False
    left = prior.values(mode.theta).noise + np.diagonal(prior.K_rho_at(mode.theta))
    return bool((left < NOTHING * prior.scale**2).any())


def _small(model, training):
    """The problems of a model whose tasks tell each other nothing but k^x.

    Tasks that are constant in an output are left out there, unless all are.
    """
    form = model._form_for_screening(len(training.tasks))
    posed = pose(model, training, told=False)
    problems = exact_part([of.with_form(form) for of in posed], [form])
    return [
        _without(problem, constant)
        for problem, constant in zip(problems, training.constants.T, strict=True)
    ]


def _without(problem, constant):
    """The problem without the rows of some tasks, unless these are none, or all."""
    if not constant.any() or constant.all():
        return problem
    return replace(problem, data=problem.data.of_tasks(~constant), engine=Dense())


def _score(training, found):
    """Summed over the outputs."""
    pairs = zip(found, training.units.scale, strict=True)
    return float(sum(score(*of, scale) for of, scale in pairs))
