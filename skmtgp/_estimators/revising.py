"""What learning tells of noise and smoothness that the small model did not."""

from dataclasses import replace
from functools import partial

import numpy as np

from skmtgp._estimators.deciding import kinds_of_noise, least_gain, screened
from skmtgp._estimators.named_kernels import DEFAULT, LINEAR
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
from skmtgp.learning.lines import as_lines, may_be_lines
from skmtgp.learning.nesting import nest
from skmtgp.learning.problem import Mode, Problem
from skmtgp.learning.screening import (
    by_likelihood,
    criterion,
    differ_in_noise,
    hides_noise,
    leaves_noise,
    tells_noise,
    with_kernel,
    with_own_noise,
)
from skmtgp.learning.weighing import (
    best_of_forms,
    evidences,
    is_apart,
    log_density_left_out,
    summed,
)

# Nats that noise of each task must gain where functions may have followed it.
SURE_ANEW = 3.0
FEW_ROWS = 5  # for each number of k^x


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
    training, problems, modes = _with_kernel(model, training, problems, modes)
    training, problems, modes = _with_lines(model, training, problems, modes)
    return _with_noise(model, training, problems, modes, learn)


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


def _with_lines(model, training, problems, modes):
    """The same with linear functions, learned on from curves, if that is likelier.

    Where tasks were measured at different inputs it is not asked: lines go on where
    there are no rows.
    """
    asks, n_jobs = _asks_for_lines(model, training, problems[0][0]), model.n_jobs
    may_be = [
        asks and all(map(may_be_lines, *of)) for of in zip(problems, modes, strict=True)
    ]
    best = best_of_forms(problems, modes, n_jobs) if any(may_be) else 0
    if not may_be[best]:
        return training, problems, modes
    of_best = problems[best], modes[best]
    if model.verbose:
        say("functions may be straight lines: learned on with kernel='linear'")
    change = partial(as_lines, kernel=as_named(model, training, LINEAR))
    curves = list(zip(*of_best, strict=True))
    least = curves[0][0].tuning.linear
    by_chance = sum(least + 0.5 * of.prior.kernel.n_dims for of, _ in curves)
    loss = by_chance if len(curves) == 1 else np.inf  # another output may gain it
    lines = run(partial(change, loss=loss), curves, n_jobs=n_jobs)
    if log_likelihood(lines) < log_likelihood(curves) - by_chance:
        spent = [mode for _, mode in counting(curves, lines)]
        return training, problems, [*modes[:best], spent, *modes[best + 1 :]]
    known = [{best: of} for of in lines]
    found = _of_forms(change, problems, modes, n_jobs, known)
    k = best_of_forms(*found, n_jobs)
    gain = _gain(of_best, [[of[k]] for of in found], n_jobs)
    pair = [problems[k], found[0][k]], [modes[k], found[1][k]]
    if gain > least and gain - _loss_left_out(*pair, n_jobs) > least:
        return replace(training, kernel=LINEAR), *found
    return training, problems, _of_each(Mode.spending, modes, found[1])


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
    if any(map(hides_noise, *of_best)):
        other, *found = _anew(model, training, learn)
        if _tells_all(*found) and _gain(of_best, found, model.n_jobs) > SURE_ANEW:
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
    training = replace(training, noise="per_task", kernel=DEFAULT)
    if model.verbose:
        say("functions may follow noise: learned anew with noise of each task")
    _, training, _ = screened(model, training, ["per_task"])
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


def _is_wide(problem):
    """Whether rows are so few beside the inputs that some matter by chance.

    Curves that follow noise along some of them predict rows well that are left out, by
    hyperparameters that have seen these rows.
    """
    return len(problem.data) < FEW_ROWS * problem.prior.kernel.n_dims


def _loss_left_out(problems, modes, n_jobs):
    """Nats an output that the second of two k^x predicts rows worse by, left out.

    Where curves bend little beside steep slopes, lines take them for noise. That costs
    predictions much, and the evidence of few rows little. Both have the same form of
    K^rho, for more hyperparameters seem to predict better than they do. Of wide data
    nothing is lost.
    """
    if _is_wide(problems[0][0]):
        return -np.inf
    values = summed(log_density_left_out, problems, modes, n_jobs)
    return (values[0] - values[1]) / len(problems[0])


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
