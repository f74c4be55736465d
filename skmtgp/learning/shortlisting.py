"""One of several forms of K^rho, of which only the likely ones are learned thoroughly.

All are sketched first, from a few hundred of the rows: from the likeliest start,
compound symmetry and rank 1 from all starts. Ranks ascend until two in a row are worse
than a lower one. If the noise of the likeliest hides functions, all are sketched from
what is found, too. Forms that will not be chosen are left out then, see
:mod:`.weighing`.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from skmtgp._numerics.parallel import run
from skmtgp._support.progress import say, silent
from skmtgp.learning.climbing import Ascent, climb
from skmtgp.learning.contenders import penalties, plausible, weighed, worth
from skmtgp.learning.further import with_higher
from skmtgp.learning.hidden import reveal
from skmtgp.learning.nesting import descend, has_columns_more, with_columns
from skmtgp.learning.problem import Problem, best_of
from skmtgp.learning.ranks import (
    all_starts,
    by_output,
    coarsest,
    description,
    from_starts,
)
from skmtgp.learning.stages import Start, follow, likeliest, with_starts
from skmtgp.learning.telling import about, in_words
from skmtgp.learning.weighing import best_of_forms, corrections
from skmtgp.model.task_covariance import WithDiagonal, enlarged

WORSE = 2  # ranks in a row that end the sketches


def learn_best(problems, forms, *, seeds=(), n_jobs=None, progress=silent):
    """Learn the best one of several forms of K^rho.

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
    forms = taken(forms, problems[0].engine)
    coarse, starts = coarsest(problems), all_starts(problems, seeds, n_jobs)
    sketches = _sketched(coarse, forms, starts, **options)
    sketches = run(_revealed, [(of,) for of in sketches], n_jobs=n_jobs)
    n = problems[0].data.n_measured
    correction = corrections(*_by_form(sketches), n_jobs, n)
    likely = _likely(problems, coarse, sketches, correction)
    kept, modes = _learned(problems, sketches, likely, starts, **options)
    if _overtaken(problems, sketches, likely, modes, correction):
        likely = list(range(len(sketches[0])))
        kept, modes = _learned(problems, sketches, likely, starts, **options)
    every = bool(weighed(*_by_form(sketches), n))
    if problems[0].noisy and len(coarse[0].data) < len(problems[0].data):
        most = max(form.rank for form in forms)
        kept, modes = with_higher(problems, kept, modes, most, n_jobs)
    best, of_best = chosen(problems, kept, modes, n_jobs, every=every)
    found = []
    for mode, others, of, begun in zip(of_best, modes, sketches, starts, strict=True):
        dropped = [of[j].ascent.mode for j in range(len(of)) if j not in likely]
        others = [other for other in others if other is not mode]
        found.append(with_starts(mode.counting([*others, *dropped]), begun))
    return best, found


def taken(forms, engine):
    """The forms that an engine takes; its error if it takes none of them."""
    taken = [form for form in forms if _is_taken(form, engine)]
    if not taken:
        engine.check_form(forms[0])
    return taken


def _is_taken(form, engine):
    """Whether an engine takes a form of K^rho."""
    with suppress(ValueError):
        engine.check_form(form)
        return True
    return False


def chosen(problems, forms, modes, n_jobs=None, *, every=False):
    """The form that is best, over all outputs, see :mod:`skmtgp.learning.weighing`.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of FixedTaskCovariance, LowRank or another
        Forms of K^rho.
    modes : list of list of Mode
        For each output and form.
    n_jobs : int, default=None
        Processes.
    every : bool, default=False
        Whether all are near the best, by the evidence of their sketches.

    Returns
    -------
    problems : list of Problem
        With the form.
    modes : list of Mode
        For each output.
    """
    of_forms = [[problem.with_form(form) for problem in problems] for form in forms]
    learned = list(map(list, zip(*modes, strict=True)))
    best = best_of_forms(of_forms, learned, n_jobs, every=every)
    return of_forms[best], learned[best]


def with_own_part(problems, modes, n_jobs=None):
    """The best rank with a diagonal in place of its last column, of noisy data.

    It may be that one task alone has that function to itself.

    Parameters
    ----------
    problems : list of list of Problem
        For each form of K^rho and each output.
    modes : list of list of Mode
        Their modes.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    problems : list of Problem
        For each output; none if there is nothing to try.
    modes : list of Mode
        What was learned on from there.
    """
    pairs = [list(zip(*of, strict=True)) for of in zip(problems, modes, strict=True)]
    pairs = [of for of in pairs if not of[0][0].prior.task_covariance.n_own]
    best = max(pairs, key=lambda of: sum(worth(*pair) for pair in of), default=[])
    form = _own_form(best)
    if form is None:
        return [], []
    others = [problem.with_form(form) for problem, _ in best]
    jobs = [
        (problem, _cut(*pair, form)) for problem, pair in zip(others, best, strict=True)
    ]
    return others, run(climb, jobs, n_jobs=n_jobs)


def _own_form(best):
    """The form of a rank less and a diagonal; None if there is nothing to try.

    `best` has the problem and the mode of each output.
    """
    if not best or not all(problem.is_noisy(mode) for problem, mode in best):
        return None
    problem, _ = best[0]
    form = problem.prior.task_covariance
    if not 1 < form.rank < problem.prior.n_tasks:  # else it has no fewer numbers
        return None
    form = enlarged(form.with_rank(form.rank - 1), diagonal=True)
    return form if _is_taken(form, problem.engine) else None


def _cut(problem, mode, form):
    """Parameters of another form near the K^rho of a mode."""
    prior = problem.with_form(form).prior
    rho = form.parameters(problem.prior.K_rho_at(mode.theta))
    return prior.with_rho(mode.theta, rho)


class Sketch(NamedTuple):
    """A form of K^rho, learned quickly.

    Attributes
    ----------
    problem : Problem
        With the form, of the coarsest rows.
    ascent : Ascent
        From the likeliest start.
    led : bool, default=False
        Whether that start led to a better mode than the rank below.
    """

    problem: Problem
    ascent: Ascent
    led: bool = False

    @property
    def form(self):
        """The form."""
        return self.problem.prior.task_covariance

    @property
    def is_noisy(self):
        """Whether its mode takes more than a little for noise."""
        return self.problem.is_noisy(self.ascent.mode)

    def worth(self, times=1.0):
        """See `worth`."""
        return worth(self.problem, self.ascent.mode, times)


def _sketched(problems, forms, starts, *, n_jobs, progress):
    """For each output a sketch of each form, or of the first forms."""
    n = len(problems) * len(forms)
    of_all = description(problems, forms, stage="from the likeliest start")
    report = progress("comparing ranks", n, of_all)
    found = []
    for k, form in enumerate(forms):
        before = zip(*found, strict=True) if found else [()] * len(problems)
        jobs = [
            (problem.with_form(form), *of)
            for problem, *of in zip(problems, starts, before, strict=True)
        ]
        found.append(run(_sketch, jobs, n_jobs=n_jobs))
        for j, sketch in enumerate(found[-1] if report is not None else ()):
            report(j * len(forms) + k, sketch.ascent.mode)
        if _falls(found):
            break
    found += _with_own(found, n_jobs)
    found.sort(key=lambda of: not of[0].form.n_own)  # which are not part of all others
    return run(_descended, [(of,) for of in zip(*found, strict=True)], n_jobs=n_jobs)


def _sketch(problem, starts, before):
    """The sketch of a form; that of noisy data is quick, and begins at the rank below.

    Without noise both would miss modes that are far better. A rank begins at the
    likeliest start, too: the rank below may have taken fast functions for noise, or be
    a mode from which no column leads to the best. If that rank gained nothing, or if
    its own mode from there was no better, it has been tried already.
    Compound symmetry and rank 1 are learned from all starts, for one may tell them
    independent tasks alone, or one function.
    """
    start, below = likeliest(starts), before[-1] if before else None
    if not start.is_noisy:
        return Sketch(problem, follow(problem, start, below and below[:2]))
    if _has_below(before, problem):
        theta = with_columns(below.problem, problem, below.ascent.mode)
        found, lower = _quick(problem, theta), before[:-1]
        helps = below.led and _is_better(below, lower)
        if _has_below(lower, below.problem) and not helps:
            return found
        again = _quick(problem, start.theta(problem), [found.ascent.mode])
        gain = again.ascent.mode.value - found.ascent.mode.value
        return again._replace(led=gain > problem.tuning.doubt)
    found = _quick(problem, start.theta(problem))
    form = problem.prior.task_covariance
    for other in starts if form.rank == 1 or (form.shared and form.n_own) else ():
        if other is not start:
            found = _quick(problem, other.theta(problem), [found.ascent.mode])
    return found


def _has_below(before, problem):
    """Whether the last sketch is of a form that has a column less, and nothing else."""
    return bool(before) and has_columns_more(before[-1].problem, problem)


def _is_better(sketch, before):
    """Whether a sketch is likelier than all before, beyond doubt."""
    best = max(of.ascent.mode.value for of in before)
    return sketch.ascent.mode.value > best + sketch.problem.tuning.doubt


def _quick(problem, theta, known=()):
    """The sketch that a short climb makes, or a better one that is known."""
    mode = climb(problem.quickly(), theta, relaxed=True, known=known)
    mode = best_of([mode, *known])
    return Sketch(problem, Ascent(mode, mode))


def _with_own(found, n_jobs):
    """The sketch of the best rank with a diagonal in place of its last column."""
    ladder = [of for of in found if not of[0].form.n_own]
    best = max(ladder, key=_total, default=[])
    form = _own_form([(sketch.problem, sketch.ascent.mode) for sketch in best])
    if form is None:
        return []
    return [run(_own, [(sketch, form) for sketch in best], n_jobs=n_jobs)]


def _own(higher, form):
    """The sketch of a form that begins at the K^rho of a higher rank."""
    problem, mode = higher.problem.with_form(form), higher.ascent.mode
    sketch = _quick(problem, _cut(higher.problem, mode, form))
    if problem.budget.verbose:
        _tell(sketch, "from the best rank")
    return sketch


def _descended(sketches):
    """The same, with what a rank can learn from the next higher one."""
    problems, ascents, _ = zip(*sketches, strict=True)
    modes = descend(problems, [ascent.mode for ascent in ascents])
    return [
        sketch._replace(ascent=sketch.ascent._replace(mode=mode))
        for sketch, mode in zip(sketches, modes, strict=True)
    ]


def _revealed(sketches):
    """The sketches of an output, with what the noise of the likeliest one hid.

    If that is something, other forms are sketched from there, too. Of so few rows that
    they are learned again in any case, it is not asked.
    """
    best = _likeliest_of_worth(sketches)
    problem, mode = best.problem, best.ascent.mode
    if len(problem.data) <= problem.tuning.quick:
        return sketches
    found = reveal(problem.quickly(), mode)
    if found.value <= mode.value + problem.tuning.doubt:
        same = best._replace(ascent=best.ascent._replace(mode=found))
        return [same if sketch is best else sketch for sketch in sketches]
    prior, theta = problem.prior, found.theta
    start = Start(
        prior.values(theta).kernel,
        prior.K_rho_at(theta),
        log_noise=prior.log_noise_at(theta),
        log_level=prior.log_level_at(theta),
    )
    again = [
        best._replace(ascent=Ascent(found, found))
        if sketch is best
        else _quick(sketch.problem, start.theta(sketch.problem), [sketch.ascent.mode])
        for sketch in sketches
    ]
    for sketch in again if problem.budget.verbose else ():
        _tell(sketch, "once noise was explained")
    return _descended(again)


def _likeliest_of_worth(sketches):
    """The likeliest sketch, but for those whose parameters cost far more than that."""
    worths = [sketch.worth() for sketch in sketches]
    least = max(worths) - sketches[0].problem.tuning.poorer
    pairs = zip(sketches, worths, strict=True)
    able = [sketch for sketch, of in pairs if of >= least]
    return max(able, key=lambda sketch: sketch.ascent.mode.value)


def _tell(sketch, how):
    """Print a sketch and how it was found."""
    problem, mode = sketch.problem, sketch.ascent.mode
    value = in_words(problem, mode.theta, mode.value)
    say(f"{about(problem, sketch.form)}{value}, {how}")


def _falls(found):
    """Whether the last ranks are all worse than a lower one."""
    ladder = [found[-1]]
    for lower in reversed(found[:-1]):
        if not has_columns_more(lower[0].problem, ladder[-1][0].problem):
            break
        ladder.append(lower)
    return int(np.argmax(list(map(_total, ladder)))) >= WORSE


def _total(of_form):
    """What a form is worth, over all outputs."""
    return sum(sketch.worth() for sketch in of_form)


def _by_form(sketches):
    """Problems and modes of each form and output."""
    of_forms = list(zip(*sketches, strict=True))
    problems = [[sketch.problem for sketch in of] for of in of_forms]
    return problems, [[sketch.ascent.mode for sketch in of] for of in of_forms]


def _likely(problems, coarse, sketches, correction):
    """Positions of the forms that are near the best, by some or by all rows."""
    tuning = problems[0].tuning
    most = len(problems[0].data) / len(coarse[0].data)
    margin = tuning.unsure * len(problems)
    likely, poor = set(), np.ones(len(correction), dtype=bool)
    for times in np.geomspace(1.0, most, tuning.foreseen if most > 1.0 else 1):
        found = np.sum([[of.worth(times) for of in each] for each in sketches], axis=0)
        found += correction
        likely |= set(np.flatnonzero(found >= found.max() - margin).tolist())
        poor &= found < found.max() - tuning.poorer * len(problems)
    lower = _with_lower(likely, sketches) - set(np.flatnonzero(poor).tolist())
    return sorted(likely | lower)


def _with_lower(likely, sketches):
    """The same, and the ranks below: quick sketches of them may miss their modes.

    Rank 1 is not one of them, for it was sketched from all starts.
    """
    forms = [sketch.form for sketch in sketches[0]]
    if not all(of[k].is_noisy for of in sketches for k in likely):
        return likely
    below = (of for k in likely for of in _below(forms[k]))
    lower = {str(form) for form in below if form.rank != 1}
    return likely | {k for k, form in enumerate(forms) if str(form) in lower}


def _below(form):
    """The form of a rank less, or without its diagonal."""
    if isinstance(form, WithDiagonal) and not form.equal:
        yield form.form
    if form.rank > 1:
        yield form.with_rank(form.rank - 1)


def _learned(problems, sketches, likely, starts, **options):
    """The likely forms, and modes of each output and form."""
    compared = [sketch.form for sketch in sketches[0]]
    kept = [compared[k] for k in likely]
    jobs = [of_output[k][:2] for of_output in sketches for k in likely]
    ascents = run(_finished, jobs, n_jobs=options["n_jobs"])
    known = {"firsts": by_output(ascents, kept), "compared": compared}
    return kept, from_starts(problems, kept, starts, **known, **options)


def _overtaken(problems, sketches, likely, modes, correction):
    """Whether a form that was left out is better than the likely ones turned out.

    Once they are learned, they may explain few rows without noise, which is unlikely.
    """
    dropped = [k for k in range(len(sketches[0])) if k not in likely]
    if not dropped or len(sketches[0][0].problem.data) < len(problems[0].data):
        return False
    of_forms, sketched = _by_form(sketches)
    kept, learned = [of_forms[k] for k in likely], list(zip(*modes, strict=True))
    odds = correction + penalties(of_forms, sketched)
    left_out = (plausible(of_forms, sketched) + odds)[dropped]
    return left_out.max() > (plausible(kept, learned) + odds[likely]).max()


def _finished(problem, ascent):
    """The ascent of a sketch, learned as far as others are."""
    mode = ascent.mode.then(climb(problem, ascent.mode.theta))
    return ascent._replace(mode=mode)
