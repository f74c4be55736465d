"""Ranks whose parameters some rows cannot tell, learned from all rows alone.

Sparse inference begins with exact inference from some of the rows. A rank with nearly
as many parameters as those have would follow them for a long time, to a mode of no use.
It is grown from a lower one instead, on the bound over all rows. What descriptors do
not tell of the tasks is grown from what they tell.
"""

from dataclasses import replace
from itertools import takewhile

import numpy as np

from skmtgp._numerics.parallel import run
from skmtgp._support.progress import silent
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import is_of_own_functions
from skmtgp.learning.nesting import grow, with_columns
from skmtgp.learning.problem import Mode, Problem, best_of
from skmtgp.learning.ranks import description
from skmtgp.learning.screening import criterion
from skmtgp.learning.shortlisting import chosen, learn_best, taken
from skmtgp.learning.summarised import exact_part, learn_rest, with_gain
from skmtgp.model.task_covariance import enlarged, low_rank

WORSE = 2  # ranks in a row that end a search
TIMES = 20.0  # own functions of all tasks may take, of a bound without them
OFF = 8.0  # times its usual length-scale: a feature hardly matters


def learn_forms(learn, problems, forms, *, until_worse=False, **options):
    """Learn models of several ranks, by way of some of the rows where that is needed.

    Parameters
    ----------
    learn : callable
        :func:`skmtgp.learning.ranks.learn_ranks`, or another learner.
    problems : list of Problem
        For each output.
    forms : list of LowRank, WithShared or WithDiagonal
        Forms of K^rho of ascending rank.
    until_worse : bool, default=False
        Whether those that are grown are left out once two in a row are worse than a
        lower one, by eq. 8 over all outputs.
    **options
        Of the learner. It shares `n_jobs` and `progress` with all else.

    Returns
    -------
    modes : list of list of Mode
        For each form and output; the last forms may be left out.
    """
    running = {name: options[name] for name in ("n_jobs", "progress")}
    parts = exact_part(problems, forms)
    first = forms if problems[0].engine.exact else told(parts[0], forms)
    modes = learn(parts, first, **options)
    modes = learn_rest(problems, first, modes, **running)
    modes, begun = list(zip(*modes, strict=True)), first
    rest = [form for form in forms if form not in first]
    while rest and not (until_worse and _falls(problems, begun, modes)):
        modes.append(_grown(problems, begun[-1], rest[0], modes[-1], **running))
        begun, rest = [*begun, rest[0]], rest[1:]
    return modes if begun[0] is forms[0] else [_counting(*modes[:2]), *modes[2:]]


def learn_upwards(problems, forms, *, seeds=(), n_jobs=None, progress=silent):
    """The best of several ranks, begun at the best one by some of the rows.

    That is learned from all rows, and ranks grow from it until two in a row are worse:
    more rows speak for more functions, hardly ever for fewer. Instead, tasks may have
    functions of their own beside one of all tasks, see :func:`with_own_functions`.

    Parameters
    ----------
    problems : list of Problem
        For each output, with an engine that approximates.
    forms : list of LowRank, WithShared or WithDiagonal
        Forms of K^rho of ascending rank.
    seeds, n_jobs, progress
        See :func:`skmtgp.learning.ranks.learn_ranks`.

    Returns
    -------
    problems : list of Problem
        For each output, with the form that was chosen.
    modes : list of Mode
        The best mode found for each.
    """
    running = {"n_jobs": n_jobs, "progress": progress}
    parts = exact_part(problems, forms)
    of_some, modes = learn_best(parts, told(parts[0], forms), seeds=seeds, **running)
    begun = [of_some[0].prior.task_covariance]
    modes = learn_rest(problems, begun, [[mode] for mode in modes], **running)
    modes = list(zip(*modes, strict=True))
    rest = [form for form in forms if form.rank > begun[0].rank]
    while rest and not _falls(problems, begun, modes):
        modes.append(_grown(problems, begun[-1], rest[0], modes[-1], **running))
        begun, rest = [*begun, rest[0]], rest[1:]
    begun, modes = with_own_functions(problems, begun, modes, **running)
    return chosen(problems, begun, list(zip(*modes, strict=True)), n_jobs)


def with_own_functions(problems, forms, modes, *, n_jobs=None, progress=silent):
    """Several ranks, and compound symmetry if it may be better than all of them.

    One function of all tasks, and one of each, have two variances where a rank has a
    number of each task. So a rank explains them badly, but it takes many to tell. Data
    without noise are not asked: own functions would explain whatever is left.

    Parameters
    ----------
    problems : list of Problem
        For each output, with an engine that approximates.
    forms : list of LowRank or WithShared
        Ranks that were learned.
    modes : list of list of Mode
        For each form and output.
    n_jobs, progress
        See :func:`skmtgp.learning.ranks.learn_ranks`.

    Returns
    -------
    forms : list of LowRank, WithShared or WithDiagonal
        Perhaps with one more, the last.
    modes : list of list of Mode
        For each form and output.
    """
    best = _best(problems, forms, modes)
    form, of_best = forms[best], modes[best]
    ranked = [problem.with_form(form) for problem in problems]
    noisy = all(map(Problem.is_noisy, ranked, of_best))
    if not (noisy and _may_own(problems[0], form)):
        return forms, modes
    own = low_rank(form.n_tasks, 0, diagonal="equal", shared=True)
    running = {"n_jobs": n_jobs, "progress": progress}
    of_own = _grown(problems, form, own, of_best, **running)
    return [*forms, own], [*modes, of_own]


def with_own(problems, modes, n_jobs=None, progress=silent):
    """What was learned, or the same with functions of the tasks' own, if likelier.

    Descriptors may not tell all that tasks differ by. Data without noise are not asked,
    for own functions would explain whatever is left.

    Parameters
    ----------
    problems : list of Problem
        For each output, with an exact engine.
    modes : list of Mode
        Their modes.
    n_jobs, progress
        See :func:`skmtgp.learning.ranks.learn_ranks`.

    Returns
    -------
    problems : list of Problem
        For each output, with the form that was chosen.
    modes : list of Mode
        The mode of each.
    """
    form = problems[0].prior.task_covariance
    forms = taken([form, enlarged(form, diagonal="equal")], problems[0].engine)
    if len(forms) == 1 or not all(map(Problem.is_noisy, problems, modes)):
        return problems, modes
    jobs = [
        (problem, problem.with_form(forms[1]), mode)
        for problem, mode in zip(problems, modes, strict=True)
    ]
    of_all = description(problems, forms[1:], stage="grown from the descriptors")
    report = progress("functions of the tasks' own", len(jobs), of_all)
    grown = run(grown_in_two_ways, jobs, n_jobs=n_jobs, report=report)
    both = list(zip(modes, grown, strict=True))
    best, found = chosen(problems, forms, both, n_jobs)
    spent = [[mode for mode in of if mode is not found[j]] for j, of in enumerate(both)]
    return best, list(map(Mode.counting, found, spent))


def told(part, forms):
    """The first of some forms of K^rho, which the rows can tell, or a lower rank's.

    Parameters
    ----------
    part : Problem
        Of the rows.
    forms : list of LowRank, WithShared or WithDiagonal
        Forms of ascending rank.

    Returns
    -------
    forms : list of LowRank, WithShared or WithDiagonal
        All of them if nothing is learned.
    """
    most = len(part.data) / part.tuning.telling if part.budget.max_iter else np.inf

    def is_told(form):
        return form.rank < 2 or form.n_free <= most

    lower = (forms[0].with_rank(r) for r in range(forms[0].rank - 1, 0, -1))
    return list(takewhile(is_told, forms)) or [next(filter(is_told, lower))]


def _falls(problems, forms, modes):
    """Whether the last forms are all worse than one before them."""
    return _best(problems, forms, modes) < len(forms) - WORSE


def _best(problems, forms, modes):
    """Position of the best form by eq. 8, over all outputs."""
    found = [
        sum(map(criterion, [of.with_form(form) for of in problems], of_form))
        for form, of_form in zip(forms, modes, strict=True)
    ]
    return int(np.argmax(found))


def _may_own(problem, form):
    """Whether tasks may have functions of their own, where a form has none.

    A bound of n rows and m inducing inputs has n m^2 + m^3 products for a function of
    all tasks, and M m^3 more with them. That should take no more than some times as
    long.
    """
    m, n_tasks = problem.engine.n_inducing, form.n_tasks
    few = n_tasks * m <= TIMES * (len(problem.data) + m)
    return few and n_tasks > 1 and not is_of_own_functions(form)


def _grown(problems, lower, form, modes, *, n_jobs, progress):
    """The mode of a form for each output, from those of a lower rank."""
    jobs = [
        (*_on_bound(problem, mode, lower, form), mode)
        for problem, mode in zip(problems, modes, strict=True)
    ]
    of_all = description(problems, [form], stage="grown from a lower rank")
    report = progress("learning a higher rank", len(jobs), of_all)
    return run(grown_in_two_ways, jobs, n_jobs=n_jobs, report=report)


def grown_in_two_ways(lower, higher, mode):
    """The better of what grows from a mode, and from it with all features awake.

    Functions of a feature that the lower rank has switched off have no gradient.

    Parameters
    ----------
    lower, higher, mode
        See :func:`skmtgp.learning.nesting.grow`.

    Returns
    -------
    mode : Mode
        Not worse.
    """
    found, prior = grow(lower, higher, mode), lower.prior
    usual = lower.theta()
    off = prior.of_length_scales & (mode.theta > usual + np.log(OFF))
    if not off.any():
        return found
    awake = mode._replace(theta=np.where(off, usual, mode.theta))
    other = climb(higher, with_columns(lower, higher, awake), known=[found])
    return best_of([found, mode.led_to(other)])


def _on_bound(problem, mode, *forms):
    """The problem of a mode's inducing inputs, with each of some forms."""
    problem = problem.with_data(replace(problem.data, Z=mode.Z))
    problem = with_gain(problem, mode)
    return [problem.with_form(form) for form in forms]


def _counting(lower, modes):
    """The modes of a rank, with what was spent on a lower one for them."""
    return [of.counting([before]) for of, before in zip(modes, lower, strict=True)]
