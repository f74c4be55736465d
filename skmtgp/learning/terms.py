r"""Several terms K^rho_q x k_q: grown one after another, each from what is left.

The term that explains most alone is learned first, as a model of one term is. Then the
others join, one by one. A term that joins begins small, along the derivative of the
likelihood by its K^rho, with theta of its kernel where learning of it starts, faster
and slower than that, and than those of the terms that are there. It may also begin as
half of a term of the same kernel, which is split in a faster and a slower one. From the
likeliest of these starts all parameters are learned, first from a few hundred of the
rows. A model with a term less is part of one with it: no mode is worse. By sparse
inference terms are grown from the rows that it is exact of; the bound is of all terms.
"""

from contextlib import suppress
from dataclasses import replace
from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._numerics.parallel import limit_threads, run
from skmtgp._support.progress import say, silent
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.learning.climbing import climb, refine, shake
from skmtgp.learning.own_kernels import split
from skmtgp.learning.problem import Mode, Problem, best_of
from skmtgp.learning.summarised import exact_part, learn_rest
from skmtgp.learning.telling import about, in_words
from skmtgp.model.several import terms_of
from skmtgp.model.task_covariance import LowRank

MANY = 1000  # rows, with which a second search takes too long


class Grown(NamedTuple):
    """A model of some of the terms, in the order in which they joined.

    Attributes
    ----------
    problem : Problem
        Of these terms.
    mode : Mode
        What was learned of them.
    order : tuple of int
        Which of the terms they are.
    """

    problem: Problem
    mode: Mode
    order: tuple


def learn_terms(learn, problems, forms, *, n_jobs=None, progress=silent):
    """Learn models of several terms for several outputs.

    Parameters
    ----------
    learn : callable
        ``learn(problems, forms)`` learns models of one term: modes of each form and
        output.
    problems : list of Problem
        For each output, with the kernels of all terms.
    forms : list of Forms
        Forms of K^rho of the terms.
    n_jobs : int, default=None
        Processes.
    progress : callable, default=silent
        Told of bounds over all rows, see :func:`skmtgp._support.progress.fitting`.

    Returns
    -------
    modes : list of list of Mode
        For each of the forms and each output.
    """
    running, found = {"n_jobs": n_jobs, "progress": progress}, []
    for form in forms:
        of_form = [problem.with_form(form) for problem in problems]
        exact = _learn(learn, exact_part(of_form, [form]), n_jobs)
        modes = learn_rest(of_form, [form], [[mode] for mode in exact], **running)
        of_outputs = zip(of_form, modes, strict=True)
        found.append([_ordered(problem, mode) for problem, [mode] in of_outputs])
    return found


def _learn(learn, problems, n_jobs):
    """The mode of each output, of one list of terms, by exact inference."""
    alone = []
    for q in _distinct(problems[0], range(problems[0].prior.n_terms)):
        of_term = [_one_term(problem, q) for problem in problems]
        [modes] = learn(of_term, [of_term[0].prior.task_covariance])
        alone.append(list(map(Grown, of_term, modes, [(q,)] * len(modes))))
    firsts = list(map(_likeliest, zip(*alone, strict=True)))
    modes = run(_grow_all, list(zip(problems, firsts, strict=True)), n_jobs=n_jobs)
    one = [_as_one(problem) for problem in problems]
    if None in one:
        return modes
    [of_one] = learn(one, [one[0].prior.task_covariance])
    jobs = list(zip(problems, modes, one, of_one, strict=True))
    return run(_or_split, jobs, n_jobs=n_jobs)


def _as_one(problem):
    """The problem of two terms that begin alike as one of their ranks together.

    It has few hundred of many rows. None where there are others, or the second is not
    of rank one, or where they have no length-scales to differ in.
    """
    if not (problem.budget.max_iter and problem.prior.n_length_scales.any()):
        return None
    terms = problem.prior.terms
    (kernel, form), (other, last) = terms[0], terms[-1]
    alike = len(terms) == 2 and str(kernel.get_params()) == str(other.get_params())
    low = problem.data.Q is None and {type(form), type(last)} == {LowRank}
    if not (alike and low) or last.rank != 1 or form.rank + 1 > form.n_tasks:
        return None
    one = kernel, LowRank(form.n_tasks, form.rank + 1)
    return replace(_to_split(problem), prior=problem.prior.with_terms([one]))


def _to_split(problem):
    """The problem with the rows from which terms are split, all if they are not many.

    Few hundred of 977 rows led to a mode 8 nats below that of all.
    """
    many = len(problem.data) > MANY
    return problem.coarse_to_fine()[0] if many else problem


def _or_split(problem, mode, one, of_one):
    """The better of a mode of two terms, and of one that is split in two."""
    part = _to_split(problem)
    other = of_one.then(split(part, one, of_one))
    if part.data is not problem.data:
        other = refine(problem, other)
    return best_of([mode, other])


def _likeliest(alone):
    """Of several models of one term, with what was spent on the others."""
    best = max(alone, key=lambda of: of.mode.value)
    others = [of.mode for of in alone if of is not best]
    return best._replace(mode=best.mode.counting(others))


def _grow_all(problem, grown):
    """The mode of all terms, from that of one of them."""
    while len(grown.order) < problem.prior.n_terms:
        grown = _with_one_more(problem, grown)
    mode = grown.mode
    of_terms = grown.problem.prior.theta_of_terms(mode.theta)
    of_terms = [of_terms[k] for k in np.argsort(grown.order)]
    theta = problem.prior.with_theta_of_terms(mode.theta, of_terms)
    return mode._replace(theta=theta, rivals=())


def _ordered(problem, mode):
    """The mode with terms that may take each other's places as their kernels began."""
    prior = problem.prior
    of_terms = _in_place(prior, prior.theta_of_terms(mode.theta))
    return mode._replace(theta=prior.with_theta_of_terms(mode.theta, of_terms))


def _in_place(prior, of_terms):
    """Theta of terms that may take each other's places as their kernels began.

    The one that began slowest is the slowest; of equal beginnings the first.
    """
    terms, found = prior.terms, list(of_terms)
    alike = {}
    for q, (kernel, form) in enumerate(terms):
        alike.setdefault((str(_kinds(kernel)), str(form)), []).append(q)
    for places in alike.values():
        by_start = sorted(places, key=lambda q: -terms[q][0].theta.sum())
        learned = sorted((of_terms[q] for q in places), key=lambda of: -of[0].sum())
        pairs = list(zip(by_start, learned, strict=True))
        if all(_is_within(terms[q][0], theta) for q, (theta, _) in pairs):
            for q, of_term in pairs:
                found[q] = of_term
    return found


def _is_within(kernel, theta):
    lower, upper = kernel.bounds.reshape(-1, 2).T
    return bool(((lower <= theta) & (theta <= upper)).all())


def _with_one_more(problem, grown):
    """A model of one term more, the best of those that are left."""
    rest = [q for q in range(problem.prior.n_terms) if q not in grown.order]
    found = [_with_term(problem, grown, q) for q in _distinct(problem, rest)]
    best = max(found, key=lambda of: of.mode.value)
    others = [of.mode for of in found if of is not best]
    more, mode = best.problem, best.mode.counting(others)
    coarse = more.coarse_to_fine()[0]
    mode = shake(coarse, mode, 1) if coarse.data is more.data else refine(more, mode)
    same = _enlarged(more, grown.problem, grown.mode)
    mode = best_of([grown.mode.led_to(mode), same]).counting([grown.mode])
    if more.budget.verbose:
        say(
            f"{about(more, more.prior.task_covariance)}"
            f"{in_words(more, mode.theta, mode.value)} ({len(more.data)} rows)"
        )
    return best._replace(mode=mode)


def _with_term(problem, grown, q):
    """A model with one of the terms more, learned from a few hundred of the rows."""
    more = _of_terms(problem, [*grown.order, q])
    coarse, modes = more.coarse_to_fine()[0], []
    with limit_threads(len(coarse.data)):
        for starts in joined(coarse, grown.problem, grown.mode.theta):
            starts = sorted(starts, key=lambda start: -start[0])
            for _, theta in starts[: problem.tuning.joining]:
                modes.append(climb(coarse, theta, known=modes))
    return Grown(more, best_of(modes), (*grown.order, q))


def joined(problem, fewer, theta):
    """Where a model with one term more may begin.

    Parameters
    ----------
    problem : Problem
        With the new term last.
    fewer : Problem
        Without it.
    theta : ndarray of shape (n_theta,)
        What was learned without it.

    Returns
    -------
    small, halves, anew : list of (float, ndarray)
        Starts, the value of each and its parameters: with a small new term, the best
        for each theta of its kernel; with a term of its kind in two halves, one slower
        and one faster than it was; or than where learning of it began, for what is
        fast may have led it astray.
    """
    of_terms = fewer.prior.theta_of_terms(theta)
    value, noises = problem.likelihood().value, np.log(problem.tuning.noises_of_joining)
    small = []
    for kernel in _kernels(problem, of_terms):
        new = [(kernel, K_rho) for K_rho in _sizes(problem, theta, of_terms, kernel)]
        thetas = [_begin(problem, theta, of_terms, *of) for of in product(new, noises)]
        small.append(max(((value(of), of) for of in thetas), key=itemgetter(0)))
    halves, anew = [], []
    for k, (kernel, _) in enumerate(fewer.prior.terms):
        for centre, starts in ((of_terms[k][0], halves), (kernel.theta, anew)):
            split = _split(problem, of_terms, k, centre)
            thetas = [_begin(problem, theta, terms, new) for *terms, new in split]
            starts += [(value(of), of) for of in thetas]
    return small, halves, anew


def _begin(problem, theta, of_terms, new, log_noise=0.0):
    """Theta with a new term, of a theta of k^x and a matrix K^rho; other noise."""
    prior, (kernel, K_rho) = problem.prior, new
    form = terms_of(prior.task_covariance)[-1]
    rho = form.parameters(K_rho, problem.budget.truncation)
    theta = prior.with_theta_of_terms(theta, [*of_terms, (kernel, rho)])
    theta[prior.of_noise] += log_noise
    return np.clip(theta, *prior.bounds())


def _kernels(problem, of_terms):
    """Theta of the new kernel: as it is, faster and slower than it and the others."""
    *others, kernel = terms_of(problem.prior.kernel)
    alike = [
        learned
        for other, (learned, _) in zip(others, of_terms, strict=True)
        if _same_kind(other, kernel)
    ]
    lower, upper = kernel.bounds.reshape(-1, 2).T
    found = [np.clip(kernel.theta, lower, upper)]
    for theta in [kernel.theta, *alike]:
        found += [np.clip(theta + step, lower, upper) for step in problem.tuning.apart]
    return found


def _sizes(problem, theta, of_terms, kernel):
    """Matrices K^rho of several sizes along the derivative of the likelihood."""
    n_tasks, zero = problem.prior.n_tasks, np.zeros((problem.prior.n_tasks,) * 2)
    start = _begin(problem, theta, of_terms, (kernel, zero))
    values, vectors = np.ones(n_tasks), np.eye(n_tasks)  # where nothing can be told
    with suppress(NotPositiveDefiniteError):
        D = problem.likelihood().task_gradient(start)[-1]
        found = np.linalg.eigh(D) if np.isfinite(D).all() else (-values, vectors)
        values, vectors = found if found[0][-1] > 0.0 else (values, vectors)
    along = (vectors * np.maximum(values, 0.0)) @ vectors.T
    along *= n_tasks * problem.prior.scale**2 / np.trace(along)
    return [share * along for share in problem.tuning.shares]


def _split(problem, of_terms, k, centre):
    """Terms with one of them in two halves, a slower and a faster one than `centre`."""
    *others, (kernel, of_new) = problem.prior.terms
    other, form = others[k]
    if not _same_kind(other, kernel):
        return
    steps = problem.tuning.halves  # the second is the first, with the halves exchanged
    steps = steps[:1] if str(form) == str(of_new) else steps
    half = 0.5 * form.matrix(of_terms[k][1])
    rho = form.parameters(half, problem.budget.truncation)
    for step, new_step in steps:
        terms = list(of_terms)
        terms[k] = np.clip(centre + step, *other.bounds.reshape(-1, 2).T), rho
        new = np.clip(centre + new_step, *kernel.bounds.reshape(-1, 2).T), half
        yield [*terms, new]


def _same_kind(kernel, other):
    """Whether theta of one kernel means what it does of another."""
    return _kinds(kernel) == _kinds(other)


def _kinds(kernel):
    """What a kernel is but for theta: types, fixed values, other arguments."""
    alike = kernel.clone_with_theta(np.zeros_like(kernel.theta))
    arguments = {
        name: type(value) if isinstance(value, Kernel) else repr(value)
        for name, value in alike.get_params().items()
        if not name.endswith("_bounds")
    }
    free = [(of.name, of.n_elements, of.fixed) for of in kernel.hyperparameters]
    return type(kernel), arguments, free


def _of_terms(problem, chosen):
    """The problem of some of its terms."""
    terms = problem.prior.terms
    prior = problem.prior.with_terms([terms[q] for q in chosen])
    return replace(problem, prior=prior)


def _one_term(problem, q):
    """The same of one of them, by whose name its lines begin."""
    name = about(problem, f"kernel {q + 1} alone").removesuffix(": ")
    return replace(_of_terms(problem, [q]), name=name)


def _distinct(problem, chosen):
    """Of terms that begin alike the first."""
    terms, found = problem.prior.terms, {}
    for q in chosen:
        kernel, form = terms[q]
        found.setdefault((str(kernel.get_params()), str(form)), q)
    return list(found.values())


def nest_terms(problems, modes):
    """Learn a model again from one that is part of it, where it ended below that.

    Parameters
    ----------
    problems : list of Problem
        Of the same data, those that are part of others first.
    modes : list of Mode
        The mode of each.

    Returns
    -------
    modes : list of Mode
        None is below that of a model that is part of it.
    """
    modes = list(modes)
    for k, problem in enumerate(problems):
        parts = [j for j in range(k) if _is_part(problems[j], problem)]
        best = max(parts, key=lambda j: modes[j].value, default=k)
        if modes[best].value > modes[k].value:
            same = _enlarged(problem, problems[best], modes[best])
            found = modes[best].led_to(climb(problem, same.theta))
            modes[k] = best_of([modes[k], found, same])
    return modes


def _is_part(lower, higher):
    """Whether a model is another one with fewer terms, or with lower ranks."""
    terms, others = lower.prior.terms, higher.prior.terms
    return len(terms) <= len(others) and all(
        str(kernel) == str(other)
        and form.rank <= of_other.rank
        and (form.shared, form.n_own) == (of_other.shared, of_other.n_own)
        for (kernel, form), (other, of_other) in zip(terms, others, strict=False)
    )


def _enlarged(problem, lower, mode):
    """The mode of a model that is part of another, as that one's."""
    prior, terms = problem.prior, []
    learned = lower.prior.theta_of_terms(mode.theta)
    K_rhos = [K_rho for _, K_rho in lower.prior.terms_at(mode.theta)]
    zero = np.zeros((prior.n_tasks,) * 2)
    for q, (kernel, form) in enumerate(prior.terms):
        is_known = q < len(learned)
        theta = learned[q][0] if is_known else kernel.theta
        K_rho = K_rhos[q] if is_known else zero
        terms.append((theta, form.parameters(K_rho, problem.budget.truncation)))
    theta = prior.with_theta_of_terms(mode.theta, terms)
    theta = np.clip(theta, *prior.bounds())
    value, spent = problem.likelihood().value(theta), {"n_evaluations": 0, "seconds": 0}
    return mode._replace(theta=theta, value=value, rivals=(), **spent)
