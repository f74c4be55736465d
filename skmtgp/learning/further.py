"""Ranks above the best one, of which a few of the rows said too little."""

from skmtgp._numerics.parallel import run
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import worth
from skmtgp.learning.nesting import grow


def with_higher(problems, forms, modes, most, n_jobs=None):
    """The forms, and higher ranks, as long as all rows speak for them.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of LowRank, WithShared or WithDiagonal
        Those that were learned.
    modes : list of list of Mode
        For each output and form.
    most : int
        The highest rank.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    forms : list
        With those that are better by eq. 8.
    modes : list of list of Mode
        For each output and form.
    """
    forms, modes = list(forms), [list(of) for of in modes]
    while (best := _best(problems, forms, modes)) is not None:
        form = forms[best].with_rank(forms[best].rank + 1)
        if form.rank > most or str(form) in map(str, forms):
            break
        jobs = [
            (problem.with_form(forms[best]), problem.with_form(form), of[best])
            for problem, of in zip(problems, modes, strict=True)
        ]
        found = run(_grown, jobs, n_jobs=n_jobs)
        higher = [[*of, mode] for of, mode in zip(modes, found, strict=True)]
        if _best(problems, [*forms, form], higher) != len(forms):
            for of, mode in zip(modes, found, strict=True):
                of[best] = of[best].counting([mode])
            break
        jobs = [(job[1], mode) for job, mode in zip(jobs, found, strict=True)]
        for of, mode in zip(modes, run(_finished, jobs, n_jobs=n_jobs), strict=True):
            of.append(mode)
        forms.append(form)
    return forms, modes


def _best(problems, forms, modes):
    """Position of the best form by eq. 8; None if it is no plain rank."""
    found = [
        sum(map(worth, (of.with_form(form) for of in problems), of_form))
        for form, of_form in zip(forms, zip(*modes, strict=True), strict=True)
    ]
    best = max(range(len(forms)), key=found.__getitem__)
    plain = forms[best].rank and not (forms[best].shared or forms[best].n_own)
    return best if plain else None


def _grown(lower, higher, mode):
    """A mode of a rank that is quickly learned from a lower one's."""
    return grow(lower, higher.quickly(), mode)


def _finished(higher, found):
    """The same, learned to the end."""
    return found.then(climb(higher, found.theta))
