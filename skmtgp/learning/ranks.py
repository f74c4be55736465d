"""Models of several ranks, which help each other, from coarse to fine.

Each rank's search is a draw of the lottery; what one of them won is handed to the
others, see :mod:`skmtgp.learning.nesting`. A model with a diagonal is learned
on its own, and from the mode of the one without, which is part of it.
"""

from dataclasses import replace
from functools import partial
from itertools import compress

from skmtgp._numerics.parallel import run
from skmtgp._support.progress import silent
from skmtgp.learning.climbing import refine
from skmtgp.learning.exchanging import exchange, reopen
from skmtgp.learning.hidden import awaken, reveal
from skmtgp.learning.nesting import descend, detour, nest
from skmtgp.learning.problem import best_of
from skmtgp.learning.stages import (
    add_diagonal,
    first_stage,
    first_without_levels,
    full_rank_start,
    likeliest,
    perturbed,
    second_stage,
    with_starts,
)
from skmtgp.learning.telling import about, in_words
from skmtgp.model.described import describes
from skmtgp.model.task_covariance import WithDiagonal, identity, ones


def learn_ranks(problems, forms, *, seeds=(), n_jobs=None, progress=silent):
    """Learn models of several ranks for several outputs.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of LowRank, WithShared or WithDiagonal
        Forms of K^rho of ascending rank. Those that are not part of the next one come
        first.
    seeds : sequence of int, default=()
        One for each additional start: the first of them truncates a full-rank fit, the
        others are perturbed with these seeds.
    n_jobs : int, default=None
        Processes.
    progress : callable, default=silent
        Told of each rank and output, see :func:`skmtgp._support.progress.fitting`.

    Returns
    -------
    modes : list of list of Mode
        The best mode found, for each output and form.
    """
    starts = all_starts(problems, seeds, n_jobs)
    modes = from_starts(problems, forms, starts, n_jobs=n_jobs, progress=progress)
    return [
        [with_starts(mode, of_output).counting(problem.spent) for mode in of]
        for problem, of, of_output in zip(problems, modes, starts, strict=True)
    ]


def wary(problems, forms, n_jobs=None):
    """The problems of the only form of K^rho, each as `Problem.wary` has it.

    Those of several forms are as they were: they are compared by their evidence. So are
    those of data without noise, as step 1 finds them although it is wary, unless rows
    are so few that this would make all intervals far too narrow.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of LowRank, WithShared, WithDiagonal or Forms
        Forms of K^rho.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    problems : list of Problem
        In the same order.
    """
    if len(forms) > 1:
        return problems
    careful = [problem.wary(forms[0]) for problem in problems]
    if not problems[0].engine.exact or problems[0].prior.n_terms > 1:
        return careful
    doubtful = [j for j, of in enumerate(careful) if of.is_nearly_sure(forms[0])]
    starts = make_starts(coarsest([careful[j] for j in doubtful]), n_jobs)
    for j, of_output in zip(doubtful, starts, strict=True):
        chosen = careful[j] if likeliest(of_output).is_noisy else problems[j]
        careful[j] = replace(chosen, spent=tuple(start.mode for start in of_output))
    return careful


def all_starts(problems, seeds, n_jobs):
    """Where learning from the coarsest rows begins, for each output; of all ranks."""
    coarse = coarsest(problems)
    starts = make_starts(coarse, n_jobs, bare=True)
    more = more_starts(coarse, starts, seeds, n_jobs)
    return [[*of, *others] for of, others in zip(starts, more, strict=True)]


def from_starts(
    problems, forms, starts, *, firsts=None, compared=(), n_jobs=None, progress=silent
):
    """The same as `learn_ranks`, from the starts of each output, which do not count.

    Parameters
    ----------
    problems, forms, n_jobs, progress
        See :func:`learn_ranks`.
    starts : list of list of Start
        See :func:`all_starts`.
    firsts : list of list of Ascent, default=None
        For each output and form, from the likeliest start, if they are known already.
    compared : sequence of LowRank, WithShared or WithDiagonal, default=()
        Forms that a form need not be learned from, for it is known to be better.

    Returns
    -------
    modes : list of list of Mode
        The best mode found, for each output and form.
    """
    options = {"n_jobs": n_jobs, "progress": progress}
    problems = list(map(_as_exact_as_needed, problems, starts))
    modes = _coarse_to_fine(problems, forms, starts, firsts=firsts, **options)
    names = {str(form) for form in [*compared, *forms]}
    return _with_diagonal(problems, forms, starts, modes, names, **options)


def _as_exact_as_needed(problem, starts):
    """The problem, learned quickly where noisy data only begin to be learned.

    Without noise, quick learning would miss modes that are far better.
    """
    rough = problem.budget.only_begins and likeliest(starts).is_noisy
    return problem.quickly() if rough else problem


def coarsest(problems):
    """The problem of the fewest rows, for each output."""
    return [problem.coarse_to_fine()[0] for problem in problems]


def _coarse_to_fine(problems, forms, starts, *, firsts=None, n_jobs, progress):
    """The best mode from some of the rows, learned on from more and more of them."""
    coarse = coarsest(problems)
    fine = any(
        few.data is not all_.data for few, all_ in zip(coarse, problems, strict=True)
    )
    jobs = [
        ([problem.with_form(form) for form in forms], of)
        for problem, of in zip(coarse, starts, strict=True)
    ]
    reporters = _reporters(progress, coarse, forms, len(starts[0]))
    running = {"n_jobs": n_jobs, "reporters": reporters}
    modes = second_stage(jobs, shakes=1, firsts=firsts, **running)
    each = [problem for of, _ in jobs for problem in of]
    modes = run(exchange, list(zip(each, modes, strict=True)), n_jobs=n_jobs)
    modes = run(awaken, list(zip(each, modes, strict=True)), n_jobs=n_jobs)
    if len(forms) == 1 and not fine:  # else other ranks and rows help
        modes = run(_another_way, list(zip(each, modes, strict=True)), n_jobs=n_jobs)
        if describes(forms[0]):  # exchanging alone lost 30 nats at a joint of the Puma
            firsts = map(likeliest, starts)
            ways = list(zip(each, firsts, modes, strict=True))
            modes = run(detour, ways, n_jobs=n_jobs)
    modes = _revealed(coarse, forms, by_output(modes, forms), n_jobs)
    modes = run(descend, _of_output(coarse, forms, modes), n_jobs=n_jobs)
    modes = run(nest, _of_output(coarse, forms, modes), n_jobs=n_jobs)
    if not fine:
        return modes
    jobs = _of_each(problems, forms, modes)
    of_all = description(problems, forms, stage="learned on from all rows")
    report = progress("learning from all rows", len(jobs), of_all)
    modes = by_output(run(refine, jobs, n_jobs=n_jobs, report=report), forms)
    return run(nest, _of_output(problems, forms, modes), n_jobs=n_jobs)


def _reporters(progress, problems, forms, n_starts):
    """Make what tells of the starts, and of what is learned from the best."""
    told, n_modes = {}, len(problems) * len(forms)
    each = description(problems, forms, n_starts, told=told)
    again = "climbed again from more noise"
    shaken = description(problems, forms, stage=again, told=told)
    return (
        partial(progress, "starts", n_starts * n_modes, each),
        partial(progress, "learning", n_modes, shaken),
    )


def _another_way(problem, mode):
    """The better of a mode of data without noise and one that is found another way.

    Features that the mode does without are tried again. Where levels vanish, that is
    done with the model without them, which may also have other features in their place.
    """
    if problem.is_noisy(mode):
        return mode
    prior = problem.prior
    if not prior.levels_vanish(mode.theta):
        return reopen(problem, mode)
    bare = replace(problem, prior=prior.without_levels)
    theta = prior.less_levels(mode.theta)
    value = bare.likelihood().value(theta)
    start = mode._replace(theta=theta, value=value, n_evaluations=0, seconds=0.0)
    other = reopen(bare, exchange(bare, start._replace(rivals=())))
    theta = prior.with_least_levels(other.theta)
    value = problem.likelihood().value(theta)
    return best_of([mode, other._replace(theta=theta, value=value, rivals=())])


def _revealed(problems, forms, modes, n_jobs):
    """The same with another mode of the highest rank if its noise hid functions.

    Lower ranks learn of it when theirs is cut from it.
    """
    highest = [
        (of.with_form(forms[-1]), m[-1]) for of, m in zip(problems, modes, strict=True)
    ]
    found = run(reveal, highest, n_jobs=n_jobs)
    return [[*of[:-1], mode] for of, mode in zip(modes, found, strict=True)]


def _with_diagonal(problems, forms, starts, modes, names, **options):
    """The better of a mode and what a diagonal makes of the one without.

    The model without is part of the model with a diagonal, whose mode must not be
    worse. Where that has one of the names, what it found is known already.
    """
    grows = [
        isinstance(form, WithDiagonal) and form.n_kappa and str(form.form) not in names
        for form in forms
    ]
    if not any(grows):
        return modes
    with_one, n_jobs = list(compress(forms, grows)), options["n_jobs"]
    without = [form.form for form in with_one]
    simpler = _coarse_to_fine(problems, without, starts, **options)
    jobs = _of_each(problems, with_one, simpler)
    grown = by_output(run(add_diagonal, jobs, n_jobs=n_jobs), with_one)
    modes = [_better(*of, grows) for of in zip(modes, grown, strict=True)]
    return run(nest, _of_output(problems, forms, modes), n_jobs=n_jobs)


def _better(modes, others, those):
    """The modes, of some the better of two."""
    others = iter(others)
    return [
        best_of([mode, next(others)]) if is_one else mode
        for mode, is_one in zip(modes, those, strict=True)
    ]


def description(problems, forms, n_starts=1, *, stage="", told=None):
    """What to say of the mode of each output and form, which a stage found.

    Of several starts it is said once, when all have come: first those that are the
    first of an output and form, then all others. What was told before, of an earlier
    stage, is not told again.
    """
    told = {} if told is None else told
    of = [(problem, form) for problem in problems for form in forms]
    stage = f"best of {n_starts} starts" if n_starts > 1 else stage
    stage = stage and f", {stage}"
    found = [[] for _ in of]

    def describe(i, mode):
        others = i - len(of)  # starts but the first one of each
        j = i if others < 0 else others // (n_starts - 1)
        found[j].append(mode)
        if len(found[j]) < n_starts:
            return None
        best = max(found[j], key=lambda mode: mode.value)
        (problem, form), bound = of[j], best.Z is not None
        learned = problem.with_form(form), best.theta, best.value
        line = f"{about(problem, form)}{in_words(*learned, bound=bound)}"
        known, told[j] = told.get(j), line
        steps = f"({best.n_iter} iterations, {best.n_samples} rows)"
        return None if known == line else f"{line}{stage} {steps}"

    return describe


def by_output(modes, forms):
    """Lists of the modes of each output, one for each form."""
    return [list(modes[j : j + len(forms)]) for j in range(0, len(modes), len(forms))]


def _of_output(problems, forms, modes):
    return [
        ([problem.with_form(form) for form in forms], of)
        for problem, of in zip(problems, modes, strict=True)
    ]


def _of_each(problems, forms, modes):
    return [
        (problem.with_form(form), mode)
        for problem, of_output in zip(problems, modes, strict=True)
        for form, mode in zip(forms, of_output, strict=True)
    ]


def make_starts(problems, n_jobs, *, relaxed=True, bare=False):
    """Where step 3 begins, after I and 1 1^T, for each output; the same for all ranks.

    With one task I and 1 1^T are the same, and so are the starts. With `bare` there is
    one of the model without levels, from I, too, where they may vanish.
    """
    starts = _from_fixed(partial(first_stage, relaxed=relaxed), problems, n_jobs)
    if not bare or problems[0].prior.without_levels is None:
        return starts
    alone = [
        (problem.with_form(identity(problem.prior.n_tasks)),) for problem in problems
    ]
    others = run(first_without_levels, alone, n_jobs=n_jobs)
    return [[*of, other] for of, other in zip(starts, others, strict=True)]


def _from_fixed(start, problems, n_jobs):
    """The starts from K_0^rho = I and 1 1^T, of each output."""
    if not problems:
        return []
    M = problems[0].prior.n_tasks
    fixed = [identity(M), ones(M)][: min(M, 2)]
    jobs = [(problem.with_form(form),) for problem in problems for form in fixed]
    return by_output(run(start, jobs, n_jobs=n_jobs), fixed)


def more_starts(problems, starts, seeds, n_jobs):
    """As many additional starts as seeds, for each output."""
    if not seeds:
        return [[] for _ in problems]
    jobs = [(problem, of[0]) for problem, of in zip(problems, starts, strict=True)]
    return [
        [full_rank, *(perturbed(of[0], seed) for seed in seeds[1:])]
        for full_rank, of in zip(
            run(full_rank_start, jobs, n_jobs=n_jobs), starts, strict=True
        )
    ]
