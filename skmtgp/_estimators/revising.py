"""What learning tells of noise and smoothness that the small model did not."""

from dataclasses import replace
from functools import partial

import numpy as np

from skmtgp._estimators.deciding import for_own_noise, kinds_of_noise, least_gain
from skmtgp._estimators.named_kernels import LINEAR
from skmtgp._estimators.smoothness import (
    as_named,
    counting,
    log_likelihood,
    rougher,
    smoother,
)
from skmtgp._numerics.parallel import run
from skmtgp._support.progress import say
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import is_weighed, may_be_weighed, weighed
from skmtgp.learning.lines import (
    as_lines,
    log_density_of_inputs,
    may_be_lines,
    may_hide_lines,
    sketched,
)
from skmtgp.learning.nesting import nest
from skmtgp.learning.problem import Problem
from skmtgp.learning.screening import (
    by_likelihood,
    criterion,
    differ_in_noise,
    hides_noise,
    leaves_noise,
    tells_noise,
    with_kernel,
    with_own_noise,
    worth_of_units,
)
from skmtgp.learning.weighing import (
    best_of_forms,
    evidences,
    is_apart,
    summed,
)

# Nats that noise of each task must gain where functions may have followed it.
SURE_ANEW = 3.0
FEW_ROWS = 5  # for each number of k^x
HOPE = 1.0  # nats by which lines of few rows may be worth less than curves


def revise(model, training, problems, modes, learn):
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
    curves = _with_kernel(model, training, problems, modes)
    curves = _with_noise(model, *curves, learn)
    return _with_lines(model, *curves, learn)


def _with_kernel(model, training, problems, modes):
    """The same with the k^x that is best for the best form of K^rho."""
    best, n_jobs = _best(problems, modes), model.n_jobs
    found = list(zip(problems[best], modes[best], strict=True))
    names, found = rougher(model, training, found, n_jobs)
    if len(names) == 1:
        names, found = smoother(model, training, found, n_jobs)
    kernels = [as_named(model, training, name) for name in names[1:]]
    change, known = partial(_through, kernels=kernels), [{best: of} for of in found]
    problems, modes = _of_forms(change, problems, modes, n_jobs, known)
    return replace(training, kernel=names[-1]), problems, modes


def _with_lines(model, training, problems, modes, learn):
    """The same with linear functions, learned anew, if these are likelier.

    Of wide data they are learned on from the curves, which tell the inputs that matter:
    likelier weights follow noise along others. Where tasks were measured at different
    inputs it is not asked: lines go on where there are no rows.
    """
    n_jobs = model.n_jobs
    asks = _asks_for_lines(model, training, problems[0][0])
    pairs = [list(zip(*of, strict=True)) for of in zip(problems, modes, strict=True)]
    if not (asks and any(map(_may_be_lines, pairs))):
        return training, problems, modes
    best = best_of_forms(problems, modes, n_jobs)
    curves, least = pairs[best], problems[0][0].tuning.linear
    if not _may_be_lines(curves):
        return training, problems, modes
    hope, spent = _hope_of_lines(model, training, curves)
    modes = [*modes[:best], spent, *modes[best + 1 :]]
    if not hope:
        return training, problems, modes
    if model.verbose:
        say("functions may be straight lines: learned with kernel='linear'")
    lines = replace(training, kernel=LINEAR)
    if _is_wide(problems[0][0]):
        change = partial(as_lines, kernel=as_named(model, training, LINEAR))
        found = _of_forms(change, problems, modes, n_jobs)
    else:
        found = learn(lines)
    lines, *found = _with_noise(model, lines, *found, learn)
    k = best_of_forms(*found, n_jobs)
    gain = _gain((problems[best], modes[best]), [[of[k]] for of in found], n_jobs)
    pair = [problems[best], found[0][k]], [modes[best], found[1][k]]
    if gain > 0.0 and gain - _loss_left_out(*pair, n_jobs) > least:
        return lines, found[0], _spent_too(found[1], modes)
    return training, problems, _spent_too(modes, found[1])


def _may_be_lines(curves):
    """Whether curves hardly bend, or may have followed the noise."""
    return _hardly_bend(curves) or all(may_hide_lines(*of) for of in curves)


def _hardly_bend(curves):
    return all(may_be_lines(*of) for of in curves)


def _hope_of_lines(model, training, curves):
    """Whether lines may be likelier than the curves of a form, and their modes.

    Curves that hardly bend are learned on as lines. If these are worse, the K^rho may
    be what suits curves alone. So lines are learned from a few hundred rows, too.
    """
    kernel, n_jobs = as_named(model, training, LINEAR), model.n_jobs
    if _hardly_bend(curves):
        loss = sum(_by_chance(problem) for problem, _ in curves)
        single = len(curves) == 1  # of several outputs others may gain what one lacks
        change = partial(as_lines, kernel=kernel, loss=loss if single else np.inf)
        lines = run(change, curves, n_jobs=n_jobs)
        hope = log_likelihood(lines) >= log_likelihood(curves) - loss
        curves = counting(curves, lines)
        if hope:
            return hope, [mode for _, mode in curves]
    told = run(partial(sketched, kernel=kernel), curves, n_jobs=n_jobs)
    gain = sum(of for of, _ in told)
    spent = [
        mode.counting([of]) for (_, mode), (_, of) in zip(curves, told, strict=True)
    ]
    return gain > -HOPE * len(curves), spent


def _by_chance(problem):
    """Nats that curves gain by following noise along inputs that do not matter."""
    return 0.5 * problem.prior.kernel.n_dims if _is_wide(problem) else 0.0


def _asks_for_lines(model, training, problem):
    """Whether the user leaves k^x to the data."""
    if model._kernels() != [None] or model.max_iter == 0:
        return False
    if len(training.tasks) > 1 and is_apart(problem):
        return False
    kernel = as_named(model, training, LINEAR)
    try:
        prior = replace(problem.prior, kernel=kernel)
        problem.engine.check(prior, problem.data, training.tasks)
    except ValueError:  # an engine of the user's
        return False
    return True


def _through(problem, mode, kernels):
    """The problem with the last of some k^x, learned by way of the others."""
    for kernel in kernels:
        problem, mode = with_kernel(problem, mode, kernel)
    return problem, mode


def _with_noise(model, training, problems, modes, learn):
    """The same with noise for each task if that is worth it."""
    if len(kinds_of_noise(model, training)) == 1 or training.noise != "shared":
        return training, problems, modes
    best = _best(problems, modes)
    of_best = problems[best], modes[best]
    if training.kernel != LINEAR and any(map(hides_noise, *of_best)):
        other, *found = _anew(model, training, learn)
        gain = _gain(of_best, found, model.n_jobs)
        gain += _worth_of_units(other, found[0]) - _worth_of_units(training, problems)
        if _tells_all(*found) and gain > SURE_ANEW:
            return other, found[0], _spent_too(found[1], modes)
        modes = _spent_too(modes, found[1])
    if all(map(leaves_noise, *of_best)) and any(map(differ_in_noise, *of_best)):
        least = _criteria(problems, modes)[best] + least_gain(problems[best])
        found = _learned_on(problems, modes, least, model.n_jobs)
        if _is_taken(*found, least):
            return replace(training, noise="per_task"), *found
    return training, problems, modes


def _anew(model, training, learn):
    """What is learned with noise of each task from the start, and with which k^x."""
    if model.verbose:
        say("functions may follow noise: learned anew with noise of each task")
    training = for_own_noise(model, training)
    return _with_kernel(model, training, *learn(training))


def _gain(of_best, found, n_jobs):
    """Nats an output that the best of some forms is better by.

    The evidence says, for eq. 8 does not mind that functions follow rows. Where it
    cannot be had, eq. 8 does; without any noise it is that of the likelihood alone,
    because one task may be exact.
    """
    best = _best(*found)
    problems, modes = zip(of_best, [of[best] for of in found], strict=True)
    if may_be_weighed(problems) and is_weighed(problems, modes):
        values = evidences(problems, modes, n_jobs)
    elif all(map(Problem.is_noisy, *of_best)):
        values = _criteria(problems, modes)
    else:
        values = summed(by_likelihood, problems, modes)
    return (values[1] - values[0]) / len(problems[0])


def _worth_of_units(training, problems):
    """Nats an output that units are worth, see `worth_of_units`."""
    pairs = zip(problems[0], training.units.scale, strict=True)
    return np.mean([worth_of_units(*of) for of in pairs])


def _is_wide(problem):
    """Whether rows are so few beside the inputs that some matter by chance.

    Curves that follow noise along some of them predict rows well that are left out, by
    hyperparameters that have seen these rows.
    """
    return len(problem.data) < FEW_ROWS * problem.prior.kernel.n_dims


def _loss_left_out(problems, modes, n_jobs):
    """Nats an output that the second of two k^x predicts rows worse by, left out.

    Where curves bend little beside steep slopes, lines take them for noise. That costs
    predictions much, and the evidence of few rows little. More numbers of K^rho seem to
    predict better than they do, by one nat each. Of wide data nothing is lost.
    """
    if _is_wide(problems[0][0]):
        return -np.inf
    values = summed(log_density_of_inputs, problems, modes, n_jobs)
    values -= [sum(_numbers_of_tasks(of.prior) for of in each) for each in problems]
    return (values[0] - values[1]) / len(problems[0])


def _numbers_of_tasks(prior):
    """How many hyperparameters are not those of k^x."""
    return prior.n_hyperparameters - prior.kernel.n_dims


def _spent_too(modes, others):
    """Modes of each form and output, with what was spent on others."""
    return _of_each(lambda mode, other: mode.counting([other]), modes, others)


def _of_each(function, modes, others):
    """What a function makes of two modes of each form and output."""
    return [list(map(function, *of)) for of in zip(modes, others, strict=True)]


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
    gained = _criteria(problems, modes)[_best(problems, modes)] > least
    return gained and _tells_all(problems, modes)


def _tells_all(problems, modes):
    """Whether the rows tell all noise variances of the best form."""
    best = _best(problems, modes)
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


def _best(problems, modes):
    """Position of the best form by eq. 8, of those that may be chosen in the end.

    Others explain few rows without noise, and do so with any k^x.
    """
    if len(problems) == 1:  # perhaps of a user's
        return 0
    values = _criteria(problems, modes)
    among = weighed(problems, modes) or range(len(values))
    return max(among, key=values.__getitem__)


def _criteria(problems, modes):
    """Of each form, summed over the outputs."""
    return np.array(
        [sum(map(criterion, *of)) for of in zip(problems, modes, strict=True)]
    )
