"""In which units targets are learned, with which noise and how smooth a k^x."""

from dataclasses import replace
from functools import partial

import numpy as np

from skmtgp._data.checks import warn_of_constant_tasks
from skmtgp._estimators.named_kernels import DEFAULT, SMOOTHNESS
from skmtgp._estimators.posing import kernels_of, pose
from skmtgp._estimators.units import shared_units, units_of_tasks
from skmtgp._numerics.parallel import limit_threads, run
from skmtgp._support.progress import say
from skmtgp.learning.climbing import climb
from skmtgp.learning.nesting import nest
from skmtgp.learning.problem import Problem
from skmtgp.learning.screening import (
    as_large,
    by_likelihood,
    criterion,
    differ_in_noise,
    differ_in_size,
    hides_noise,
    leaves_noise,
    n_measured,
    price,
    price_of_tasks,
    score,
    screen,
    tells_noise,
    with_kernel,
    with_own_noise,
)
from skmtgp.learning.summarised import exact_part
from skmtgp.learning.weighing import evidences, is_weighed, may_be_weighed, summed

# Nats that noise of each task must gain, beside what its numbers are worth. A few rows
# that happen to be near the function gain some, and a variance that is too small costs
# far more than one that is too large (benchmarks/grouped.py). Less is enough with more
# than so many rows of a task.
SURE, FEW_ROWS = 8.0, 20.0
SURE_ANEW = 3.0  # the same where functions may have followed the noise of a task
NOTHING = 1e-8  # variances of the targets


def decide(model, training, progress=None):
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

    Returns
    -------
    training : Training
        With `units`, `noise` and `kernel`.
    """
    constant = training.tasks[training.constant]
    warn_of_constant_tasks(constant, own_noise=model.noise == "per_task")
    training = _decided(model, training)
    report = progress and "auto" in (model.normalize_y, model.noise)
    report = report and progress(
        "units", 1, lambda _, chosen: f"chosen from the data: {chosen}"
    )
    if report:
        report(0, training.chosen)
    return training


def _decided(model, training):
    noises = _noises(model, training)
    with limit_threads(len(training.Y)):
        units = _units(model, training)
    training = replace(training, noise=noises[0])
    candidates = [training.with_units(of) for of in units]
    if len(candidates) == len(noises) == 1:  # k^x is asked when it is learned
        return candidates[0]
    with limit_threads(len(training.Y)):
        found = [_screened(model, candidate, noises) for candidate in candidates]
        scores = np.array([score for score, *_ in found])
        # noise of each task can take the place of units: then functions decide
        if len(found) > 1 and found[0][1].noise != noises[0]:
            scores += [_gain_as_large(*of) for _, *of in found]
    return found[int(np.argmax(scores))][1]


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
    asks = model.normalize_y == "auto" and n_tasks > 1 and model.max_iter > 0
    if not asks or training.descriptors is not None:  # of which units do not follow
        return [shared]
    if training.slopes and training.slopes.place(True) is None:
        return [shared]  # means of tasks would leave nothing of some columns
    of_tasks = units_of_tasks(training.unexplained(True), codes, n_tasks, known)
    asks = differ_in_size(of_tasks.scale, training.measured)
    return [shared, of_tasks] if asks else [shared]


def _noises(model, training):
    """Kinds of noise that may be taken."""
    if model.noise != "auto":
        return [model.noise]
    fixed = isinstance(model.noise_variance_bounds, str)
    if fixed or len(training.tasks) == 1 or model.max_iter == 0:
        return ["shared"]
    if training.constant.any():  # its own noise would vanish, and k^x follow it alone
        return ["shared"]
    return ["shared", "per_task"]


def _screened(model, training, noises):
    """The score of these units, and the training data with the best noise and k^x."""
    # how far apart levels are says nothing of units: they have the same prior in all
    small = training.without_levels() if model._has_levels() else training
    found = [screen(problem) for problem in _small(model, small)]
    candidates = [(training, found)]
    if len(noises) > 1 and (own := _own_noise(found)):
        candidates.append((replace(training, noise=noises[1]), own))
    # of either noise: what noise of each task explains is no roughness
    scored, among_units = [], []
    for candidate, found in candidates:
        kernels, found = _rougher(model, candidate, found)
        candidate = replace(candidate, kernel=kernels[-1])
        scored.append((_score(small, found), candidate, found))
        own = candidate.noise != noises[0]
        among_units.append(scored[-1][0] - own * _head_start(found))
    _, *best = max(scored, key=lambda of: of[0])
    return max(among_units), *best


def _gain_as_large(training, found):
    """Nats that are gained if functions are as large in all tasks, in these units.

    One amplitude then serves all tasks. In units of each task it is no number of its
    own, because all units can be multiplied by it.
    """
    gain = 0.0
    for problem, mode in found:
        data, large = problem.data, as_large(problem, mode)
        if large is not None:
            spared = price(data.n_tasks - 1, n_measured(data))
            if training.units.per_task:
                spared += price_of_tasks(data) / data.n_tasks
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
    if not (noisy and np.isfinite(_value(found))):
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
    is_sure = gain > _least_gain(problem for problem, _ in found)
    return own if is_sure and not any(_vanishes(*of) for of in own) else []


def _least_gain(problems):
    """Nats that noise of each task must gain, summed over the outputs."""
    data = [problem.data for problem in problems]
    shares = [FEW_ROWS * of.n_tasks / n_measured(of) for of in data]
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


def _rougher(model, training, found, n_jobs=None):
    """Names of k^x, ever less smooth as long as that is likelier, and the last modes.

    `found` has the problem and its mode of each output, with the k^x that the training
    data have: the first name. What was tried in vain counts as spent.
    """
    names, least = [training.kernel], found[0][0].tuning.rougher
    of_output = least if len(found) == 1 else 0.0  # others may gain what one lacks
    for name in _kernels(model, training)[1]:
        kernel = _kernel(model, training, name)
        change = partial(with_kernel, kernel=kernel, gain=of_output)
        others = run(change, found, n_jobs=n_jobs)
        if _value(others) < _value(found) + least:
            return names, _counting(found, others)
        names, found = [*names, name], others
    return names, found


def _smoother(model, training, found, n_jobs=None):
    """The same of ever smoother ones, unless they are less likely."""
    names, least = [training.kernel], _value(found) - found[0][0].tuning.rougher
    for name in _kernels(model, training)[0]:
        kernel = _kernel(model, training, name)
        others = run(partial(with_kernel, kernel=kernel), found, n_jobs=n_jobs)
        if _value(others) < least:
            return names, _counting(found, others)
        names, found = [*names, name], others
    return names, found


def _kernel(model, training, name):
    return kernels_of(model, replace(training, kernel=name))[0]


def _kernels(model, training):
    """Names of what k^x may be instead: ever smoother, and ever less smooth."""
    if model._kernels() != [None] or model.max_iter == 0:
        return [], []
    k = SMOOTHNESS.index(training.kernel)
    return SMOOTHNESS[:k][::-1], SMOOTHNESS[k + 1 :]


def _value(found):
    """Log likelihood, summed over the outputs."""
    return sum(mode.value for _, mode in found)


def _counting(found, others):
    """What was found, with what the others took on from there."""
    pairs = zip(found, others, strict=True)
    return [
        (
            problem,
            mode._replace(n_evaluations=other.n_evaluations, seconds=other.seconds),
        )
        for (problem, mode), (_, other) in pairs
    ]


def _small(model, training):
    """The problems of a model whose tasks tell each other nothing but k^x."""
    form = model._form_for_screening(len(training.tasks))
    problems = [of.with_form(form) for of in pose(model, training)]
    return exact_part(problems, [form])


def _score(training, found):
    """Summed over the outputs."""
    pairs = zip(found, training.units.scale, strict=True)
    return float(sum(score(*of, scale) for of, scale in pairs))


def decide_rest(model, training, problems, modes, learn):
    """What was learned, or the same with another k^x or noise if that is worth it.

    What the small model cannot tell from its functions, the large one may.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters `kernel` and `noise` say whether to ask.
    training : Training
        As decided so far.
    problems : list of list of Problem
        For each form of K^rho, ascending, and each output.
    modes : list of list of Mode
        Their modes.
    learn : callable
        ``learn(training)`` gives such problems and modes, of as many forms, learned
        from other units, noise and k^x.

    Returns
    -------
    training, problems, modes
        With the kernel and the noise that are chosen.
    """
    learned = all(mode.converged for of in modes for mode in of)
    if not (learned and problems[0][0].engine.exact):
        return training, problems, modes
    training, problems, modes = _with_kernel(model, training, problems, modes)
    return _with_noise(model, training, problems, modes, learn)


def _with_kernel(model, training, problems, modes):
    """The same with the k^x that is best for the best form of K^rho."""
    best, n_jobs = int(np.argmax(_criteria(problems, modes))), model.n_jobs
    found = list(zip(problems[best], modes[best], strict=True))
    names, found = _rougher(model, training, found, n_jobs)
    if len(names) == 1:
        names, found = _smoother(model, training, found, n_jobs)
    kernels = [_kernel(model, training, name) for name in names[1:]]
    change, known = partial(_through, kernels=kernels), [{best: of} for of in found]
    problems, modes = _of_forms(change, problems, modes, n_jobs, known)
    return replace(training, kernel=names[-1]), problems, modes


def _through(problem, mode, kernels):
    """The problem with the last of some k^x, learned by way of the others."""
    for kernel in kernels:
        problem, mode = with_kernel(problem, mode, kernel)
    return problem, mode


def _with_noise(model, training, problems, modes, learn):
    """The same with noise for each task if that is worth it."""
    if len(_noises(model, training)) == 1 or training.noise != "shared":
        return training, problems, modes
    before = _criteria(problems, modes)
    best = int(np.argmax(before))
    of_best = problems[best], modes[best]
    if any(map(hides_noise, *of_best)):
        other, *found = _anew(model, training, learn)
        if _tells_all(*found) and _gain(of_best, found, model.n_jobs) > SURE_ANEW:
            return other, found[0], _spent_too(found[1], modes)
        modes = _spent_too(modes, found[1])
    if all(map(leaves_noise, *of_best)) and any(map(differ_in_noise, *of_best)):
        least = before[best] + _least_gain(problems[best])
        found = _learned_on(problems, modes, least, model.n_jobs)
        if _is_taken(*found, least):
            return replace(training, noise="per_task"), *found
    return training, problems, modes


def _anew(model, training, learn):
    """What is learned with noise of each task from the start, and with which k^x."""
    training = replace(training, noise="per_task", kernel=DEFAULT)
    if model.verbose:
        say("functions may follow noise: learned anew with noise of each task")
    _, training, _ = _screened(model, training, ["per_task"])
    return _with_kernel(model, training, *learn(training))


def _gain(of_best, found, n_jobs):
    """Nats an output that the best of some forms is better by.

    By the evidence where it can be had: eq. 8 does not mind that functions follow rows.
    Where it cannot for lack of noise, by the likelihood: a density by which noise of
    tasks is alike has no say in whether one of them is exact.
    """
    best = int(np.argmax(_criteria(*found)))
    problems, modes = zip(of_best, [of[best] for of in found], strict=True)
    if may_be_weighed(problems) and is_weighed(problems, modes):
        values = evidences(problems, modes, n_jobs)
    elif all(map(Problem.is_noisy, *of_best)):
        values = _criteria(problems, modes)
    else:
        values = summed(by_likelihood, problems, modes)
    return (values[1] - values[0]) / len(problems[0])


def _spent_too(modes, others):
    """Modes of each form and output, with what was spent on others."""
    return [
        [mode.counting([other]) for mode, other in zip(*of, strict=True)]
        for of in zip(modes, others, strict=True)
    ]


def _learned_on(problems, modes, least, n_jobs):
    """What is learned on with noise of each task, as long as it may reach the least."""
    single = len(problems[0]) == 1  # of several outputs others may gain what one lacks
    change = partial(with_own_noise, least=least if single else -np.inf)
    found = _of_forms(change, problems, modes, n_jobs)
    if single and _is_taken(*found, least):  # others are compared with it now
        pairs = [(*of, *mode) for of, mode in zip(*found, strict=True)]
        ended = {k: pair for k, pair in enumerate(pairs) if _has_ended(*pair)}
        found = _of_forms(_to_the_end, *found, n_jobs, [ended])
    return found


def _is_taken(problems, modes, least):
    """Whether the best form with noise of each task gains enough, and rows tell it."""
    return _criteria(problems, modes).max() > least and _tells_all(problems, modes)


def _tells_all(problems, modes):
    """Whether the rows tell all noise variances of the best form."""
    best = int(np.argmax(_criteria(problems, modes)))
    return all(map(tells_noise, problems[best], modes[best]))


def _has_ended(problem, mode):
    """Whether a climb came to its end, or noise that follows rows has ended it."""
    return mode.converged or not tells_noise(problem, mode)


def _to_the_end(problem, mode):
    """A climb that seemed to have no hope, gone on with."""
    return problem, mode.then(climb(problem, mode.theta))


def _of_forms(change, problems, modes, n_jobs, known=None):
    """Problems and modes, each changed; values do not fall with the rank.

    `known` has, for each output, a problem and a mode of some forms that are changed.
    """
    known = [{}] * len(problems[0]) if known is None else known
    of_outputs = zip(zip(*problems, strict=True), zip(*modes, strict=True), strict=True)
    jobs = [
        (change, *map(list, of), k) for of, k in zip(of_outputs, known, strict=True)
    ]
    learned = run(_of_all_forms, jobs, n_jobs=n_jobs)
    return [list(zip(*of, strict=True)) for of in zip(*learned, strict=True)]


def _of_all_forms(change, problems, modes, known):
    pairs = enumerate(zip(problems, modes, strict=True))
    found = [known[k] if k in known else change(*of) for k, of in pairs]
    problems = [problem for problem, _ in found]
    return problems, nest(problems, [mode for _, mode in found])


def _criteria(problems, modes):
    """Of each form, summed over the outputs."""
    return np.array(
        [sum(map(criterion, *of)) for of in zip(problems, modes, strict=True)]
    )
