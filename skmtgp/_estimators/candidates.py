"""The candidates of a search over forms of K^rho: models that were learned."""

from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

from skmtgp._estimators.forms import SIMPLER
from skmtgp._estimators.posing import pose
from skmtgp._support.warnings import collect_warnings
from skmtgp.learning.growing import with_own_functions
from skmtgp.learning.problem import Mode, Problem
from skmtgp.learning.ranks import wary
from skmtgp.learning.shortlisting import with_own_part

OPEN = 5.0  # nats of BIC, within which ranks are drawn where hyperparameters are


class Candidate(NamedTuple):
    """A model that was learned.

    Attributes
    ----------
    settings : dict
        Its parameters, those that other candidates do not share.
    problems : list of Problem
        For each output.
    modes : list of Mode
        For each output.
    """

    settings: dict[str, Any]
    problems: list[Problem]
    modes: list[Mode]

    @property
    def form(self):
        """The form of K^rho."""
        return self.problems[0].prior.task_covariance

    @property
    def rank(self):
        """Its rank; with several terms a tuple of theirs."""
        rank = self.settings["rank"]
        return tuple(rank) if isinstance(rank, list) else rank

    def is_of_rank(self, term, least):
        """Whether it is a candidate for its rank alone, which is not below the least.

        `term` is what the user asks for.
        """
        shared = bool(self.settings["shared"])
        as_asked = self.settings["diagonal"] == term.diagonal
        usual = shared == bool(term.shared or self.rank == 0)
        return as_asked and self.rank >= least and usual

    def fitted(self, model, training, lower=()):
        """A copy of the model that has learned these modes, and perhaps lower ranks."""
        model = copy(model).set_params(**self.settings)
        lower = [(of.problems, of.modes) for of in lower]
        model._store(training, self.problems, self.modes, lower)
        return model


def candidates_of(settings, problems, modes):
    """Candidates, from parameters, problems and modes of each."""
    return [Candidate(*of) for of in zip(settings, problems, modes, strict=True)]


def settings_of_ranks(term, ranks, *, simpler):
    """Parameters of the candidates, those that are part of no other one first.

    Parameters
    ----------
    term : Term
        What the user asks for.
    ranks : list of int
        Ascending.
    simpler : bool
        Whether simpler models are candidates, too.

    Returns
    -------
    settings : list of dict
    """
    of_ranks = [
        {"rank": r, "shared": term.shared or r == 0, "diagonal": term.diagonal}
        for r in ranks
    ]
    return [of for of in SIMPLER if simpler and of not in of_ranks] + of_ranks


def and_own_part(settings, problems, modes, n_jobs):
    """The same with one candidate more, if the data have noise.

    See :func:`skmtgp.learning.shortlisting.with_own_part`.
    """
    own, of_own = with_own_part(problems, modes, n_jobs)
    if not own:
        return settings, problems, modes
    form = own[0].prior.task_covariance
    params = {"rank": form.rank, "shared": bool(form.shared), "diagonal": True}
    return [*settings, params], [*problems, own], [*modes, of_own]


def and_own_functions(settings, problems, modes, **running):
    """The same with compound symmetry, which sparse inference takes beside ranks.

    See :func:`skmtgp.learning.growing.with_own_functions`.
    """
    forms = [of[0].prior.task_covariance for of in problems]
    forms, found = with_own_functions(problems[0], forms, modes, **running)
    if len(found) == len(modes):
        return settings, problems, modes
    own = [problem.with_form(forms[-1]) for problem in problems[0]]
    return [*settings, SIMPLER[-1]], [*problems, own], found


def learn_again(model, of_forms, progress, training):
    """Problems and modes of the same forms, with other units, noise and k^x.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Learns them.
    of_forms : list of list of Problem
        For each form of K^rho and each output, as learned before.
    progress : callable
        See :func:`skmtgp._support.progress.fitting`.
    training : Training
        With these units and noise.

    Returns
    -------
    problems : list of list of Problem
        For each form and output.
    modes : list of list of Mode
        The same.
    """
    budget = of_forms[0][0].budget
    problems = [replace(of, budget=budget) for of in pose(model, training)]
    forms = [of[0].prior.task_covariance for of in of_forms]
    problems = wary(problems, forms, model.n_jobs)
    order = sorted(range(len(forms)), key=lambda k: not forms[k].n_own)
    modes = model._learn_ranks(problems, [forms[k] for k in order], progress)
    modes = [modes[order.index(k)] for k in range(len(forms))]
    return [[of.with_form(form) for of in problems] for form in forms], modes


def ranks_to_draw(model, training, candidates, bic, best):
    """Positions of the ranks that BIC leaves open beside the best, ascending.

    Only the best itself where it is a model of another kind, or nothing is drawn.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Says whether hyperparameters are drawn.
    training : Training
        What was learned from.
    candidates : list of Candidate
        Models of all tasks.
    bic : ndarray of shape (n_candidates,)
        Of each candidate, and perhaps of single tasks.
    best : int
        Position of what is chosen.

    Returns
    -------
    positions : list of int
    """
    term, *others = model._terms()
    least = int(training.descriptors is not None)  # one function is no column of theirs
    if others:
        return [best]
    ranks = [k for k, of in enumerate(candidates) if of.is_of_rank(term, least)]
    if best not in ranks:
        return [best]
    near = [k for k in ranks if bic[k] <= bic[best] + 2.0 * OPEN]
    likely = sorted(near, key=lambda k: candidates[k].rank)
    highest = candidates[likely[-1]]
    problem, mode = highest.problems[0], highest.modes[0]
    drawn = problem.engine.exact and model._way(training, problem, mode) == "sampled"
    return likely if drawn else [best]


def made(makes, best, *, every):
    """The best model, and all of them if asked; these warn of nothing.

    Parameters
    ----------
    makes : list of callable
        What makes each model.
    best : int
        Position of the best.
    every : bool
        Whether to make all.

    Returns
    -------
    chosen : estimator
    kept : list of estimator
        Empty unless all are made.
    """
    chosen = makes[best]()
    if not every:
        return chosen, []
    with collect_warnings():
        kept = [chosen if k == best else make() for k, make in enumerate(makes)]
    return chosen, kept
