"""One of several forms of K^rho, of which only the likely ones are learned thoroughly.

All are sketched first: from the likeliest start alone, and from a few hundred of the
rows. Ranks ascend until two in a row are worse than a lower one. Forms that eq. 8 will
not choose are left out then.
"""

from contextlib import suppress
from itertools import chain
from math import comb, log

import numpy as np

from skmtgp._numerics.parallel import run
from skmtgp._support.progress import silent
from skmtgp.learning.climbing import Ascent, climb
from skmtgp.learning.nesting import descend, has_columns_more, with_columns
from skmtgp.learning.ranks import (
    all_starts,
    by_output,
    coarsest,
    description,
    from_starts,
)
from skmtgp.learning.screening import criterion, price
from skmtgp.learning.stages import follow, likeliest, with_starts
from skmtgp.model.task_covariance import WithDiagonal, enlarged

WORSE = 2  # ranks in a row that end the sketches


def learn_best(problems, forms, *, seeds=(), n_jobs=None, progress=silent):
    """Learn the one of several forms of K^rho that eq. 8 chooses.

    Parameters
    ----------
    problems : list of Problem
        For each output, with an exact engine.
    forms : list of LowRank, WithShared or WithDiagonal
        Those that are not part of the next one first, then ascending ranks.
    seeds, n_jobs, progress
        See :func:`skmtgp.learning.ranks.learn_ranks`.

    Returns
    -------
    problems : list of Problem
        For each output, with the form that was chosen.
    modes : list of Mode
        The best mode found for each, with what was spent on all forms.
    """
    options = {"n_jobs": n_jobs, "progress": progress}
    forms = [form for form in forms if _is_taken(form, problems[0].engine)]
    coarse = coarsest(problems)
    starts = all_starts(problems, seeds, n_jobs)
    sketches = _sketched(coarse, forms, starts, **options)
    likely = _likely(problems, coarse, sketches)
    jobs = [of_output[k] for of_output in sketches for k in likely]
    compared = [problem.prior.task_covariance for problem, _ in sketches[0]]
    kept = [compared[k] for k in likely]
    firsts = by_output(run(_finished, jobs, n_jobs=n_jobs), kept)
    known = {"firsts": firsts, "compared": compared}
    modes = from_starts(problems, kept, starts, **known, **options)
    best, of_best = chosen(problems, kept, modes)
    k = kept.index(best[0].prior.task_covariance)
    found = []
    for mode, of, of_output, begun in zip(
        of_best, modes, sketches, starts, strict=True
    ):
        others = [of[:k], of[k + 1 :]]
        dropped = [sketch for j, sketch in enumerate(of_output) if j not in likely]
        others += [[ascent.mode for _, ascent in dropped]]
        found.append(with_starts(mode.counting(chain(*others)), begun))
    return best, found


def _is_taken(form, engine):
    """Whether an engine takes a form of K^rho."""
    with suppress(ValueError):
        engine.check_form(form)
        return True
    return False


def chosen(problems, forms, modes):
    """The form that eq. 8 chooses, over all outputs.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of FixedTaskCovariance, LowRank or another
        Forms of K^rho.
    modes : list of list of Mode
        For each output and form.

    Returns
    -------
    problems : list of Problem
        With the form.
    modes : list of Mode
        For each output.
    """
    of_forms = [
        ([problem.with_form(form) for problem in problems], of_form)
        for form, of_form in zip(forms, zip(*modes, strict=True), strict=True)
    ]
    return max(of_forms, key=lambda of: sum(map(worth, *of)))


def worth(problem, mode, times=1.0):
    """Eq. 8, see `criterion`; of a diagonal only what has not vanished counts.

    Which numbers these are is chosen, too, and any choice of as many is as likely
    beforehand (Chen and Chen 2008, extended BIC).
    """
    prior, found = problem.prior, criterion(problem, mode, times)
    form = prior.task_covariance
    if not (isinstance(form, WithDiagonal) and form.n_kappa > 1):
        return found
    rho = prior.values(mode.theta).rho
    own = np.exp(rho[-form.n_kappa :]) / np.diagonal(form.matrix(rho))
    vanished = np.count_nonzero(own < problem.tuning.vanishing)
    choices = comb(form.n_kappa, vanished)
    return found + price(vanished, times * len(problem.data)) - log(choices)


def _sketched(problems, forms, starts, *, n_jobs, progress):
    """For each output the problem and an ascent of each form, or of the first forms."""
    n = len(problems) * len(forms)
    of_all = description(problems, forms, stage="from the likeliest start")
    report = progress("comparing ranks", n, of_all)
    starts, below, found = list(map(likeliest, starts)), [None] * len(problems), []
    for k, form in enumerate(forms):
        of_form = [problem.with_form(form) for problem in problems]
        jobs = list(zip(of_form, starts, below, strict=True))
        ascents = run(_sketch, jobs, n_jobs=n_jobs)
        below = list(zip(of_form, ascents, strict=True))
        found.append(below)
        for j, ascent in enumerate(ascents if report is not None else ()):
            report(j * len(forms) + k, ascent.mode)
        if _falls(found):
            break
    found = _with_own(found, starts, n_jobs)
    return run(_descended, [(of,) for of in zip(*found, strict=True)], n_jobs=n_jobs)


def _with_own(found, starts, n_jobs):
    """The same, and the best rank with a diagonal in place of its last column.

    It may be that one task alone has that to itself. Only of noisy data.
    """
    ladder = [
        k for k, of in enumerate(found) if not of[0][0].prior.task_covariance.n_own
    ]
    best = max(ladder, key=lambda k: _total(found[k]), default=None)
    form = None if best is None else found[best][0][0].prior.task_covariance
    if form is None or form.rank < 2 or not all(start.is_noisy for start in starts):
        return found
    form = enlarged(form.with_rank(form.rank - 1), diagonal=True)
    if not _is_taken(form, found[best][0][0].engine):
        return found
    jobs = [(*of, form) for of in found[best]]
    own = run(_cut, jobs, n_jobs=n_jobs)
    return [*found[: ladder[0]], own, *found[ladder[0] :]]


def _cut(higher, ascent, form):
    """A sketch of a form that begins at the K^rho of a higher rank."""
    problem = higher.with_form(form)
    rho = form.parameters(higher.prior.K_rho_at(ascent.mode.theta))
    theta = problem.prior.with_rho(ascent.mode.theta, rho)
    mode = climb(problem.quickly(), theta)
    return problem, Ascent(mode, mode)


def _sketch(problem, start, below):
    """An ascent of a form; that of noisy data is quick, and begins at the rank below.

    Without noise both would miss modes that are far better.
    """
    if not start.is_noisy:
        return follow(problem, start, below)
    problem, theta = problem.quickly(), None
    if below is not None and has_columns_more(below[0], problem):
        theta = with_columns(below[0], problem, below[1].mode)
    mode = climb(problem, start.theta(problem) if theta is None else theta)
    return Ascent(mode, mode)


def _descended(sketches):
    """The same, with what a rank can learn from the next higher one."""
    problems, ascents = zip(*sketches, strict=True)
    modes = descend(problems, [ascent.mode for ascent in ascents])
    return [
        (problem, ascent._replace(mode=mode))
        for (problem, ascent), mode in zip(sketches, modes, strict=True)
    ]


def _falls(found):
    """Whether the last ranks are all worse than a lower one."""
    ladder = [found[-1]]
    for lower in reversed(found[:-1]):
        if not has_columns_more(lower[0][0], ladder[-1][0][0]):
            break
        ladder.append(lower)
    return int(np.argmax(list(map(_total, ladder)))) >= WORSE


def _total(of_form):
    """What a form is worth, over all outputs."""
    return sum(worth(problem, ascent.mode) for problem, ascent in of_form)


def _likely(problems, coarse, sketches):
    """Positions of the forms that are near the best, by some or by all rows."""
    tuning = problems[0].tuning
    most = len(problems[0].data) / len(coarse[0].data)
    margin = tuning.unsure * len(problems)
    for of_output in sketches:
        best, ascent = max(of_output, key=lambda of: worth(of[0], of[1].mode))
        if not best.is_noisy(ascent.mode):
            margin += tuning.unsure_of_row * len(best.data)
    likely = set()
    for times in np.geomspace(1.0, most, tuning.foreseen if most > 1.0 else 1):
        found = sum(
            np.array([worth(of, ascent.mode, times) for of, ascent in of_output])
            for of_output in sketches
        )
        likely |= set(np.flatnonzero(found >= found.max() - margin).tolist())
    return sorted(likely)


def _finished(problem, ascent):
    """A sketch, learned as far as other modes are."""
    mode = ascent.mode.then(climb(problem, ascent.mode.theta))
    return ascent._replace(mode=mode)
