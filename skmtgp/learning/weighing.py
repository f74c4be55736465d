"""Which of several forms of K^rho to take: by eq. 8, and by the evidence.

Eq. 8 prices parameters as if rows were many, and does not mind where there is almost no
noise, with which models of few rows predict badly. It also prices the numbers of a task
as if all rows told them. The log evidence minds all three, but takes a gradient for
each hyperparameter. So it is only computed of the forms that may be near the best by
eq. 8 and the prior of the noise.
"""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._data.overlap import share_overlapping
from skmtgp._numerics.parallel import run
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.problem import Problem
from skmtgp.learning.screening import criterion, n_measured, price
from skmtgp.learning.tuning import TUNING
from skmtgp.learning.vanishing import price_of_choice, vanished
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.several import Forms


def worth(problem, mode, times=1.0):
    """Eq. 8, see `criterion`; of a diagonal only what has not vanished counts.

    The density of little noise does not, but see `penalties`.
    """
    n_vanished, choices = uncounted(problem, mode)
    found = criterion(problem, mode, times) - problem.of_little_noise(mode.theta)[0]
    return found + price(n_vanished, times * n_measured(problem.data)) - choices


def uncounted(problem, mode):
    """How many numbers of a diagonal have vanished, and what it costs that they may."""
    n_vanished = np.count_nonzero(
        vanished(problem.prior, mode.theta, problem.tuning.vanishing)
    )
    return n_vanished, price_of_choice(problem.prior, n_vanished)


def noise_penalty(prior, theta):
    """Nats by which noise variances are less likely beforehand than the likeliest."""
    hyperprior = Hyperprior(prior)
    away = (theta - hyperprior.centre)[prior.of_noise]
    return 0.5 * float(hyperprior.precision[prior.of_noise] @ away**2)


def penalties(problems, modes):
    """`noise_penalty` of each form, summed over the outputs; none if it is in there.

    Parameters
    ----------
    problems : list of list of Problem
        For each form of K^rho and each output.
    modes : list of list of Mode
        Their modes.

    Returns
    -------
    penalties : ndarray of shape (n_forms,)
    """
    return np.array(
        [
            sum(
                0.0 if problem.weak_priors else noise_penalty(problem.prior, mode.theta)
                for problem, mode in zip(*of, strict=True)
            )
            for of in zip(problems, modes, strict=True)
        ]
    )


def near_best(problems, modes, n=None):
    """Positions of the forms near the best, by eq. 8 and the prior of the noise.

    Parameters
    ----------
    problems, modes, n
        See `weighed`.

    Returns
    -------
    positions : list of int
    """
    if is_overexplained(problems, modes, n):
        tuning, sizes = problems[0][0].tuning, _sizes(problems)
        most = _n_rows(problems, n) // tuning.rows_explained
        most = min(_most_weighed(problems, n), most)
        most = max(most, sizes.min() + 1)  # compound symmetry beside independent tasks
        return np.flatnonzero(sizes <= most).tolist()
    found, too_high = plausible(problems, modes), overpriced(problems)
    least = found.max() - problems[0][0].tuning.weighed_within * len(problems[0])
    more = np.maximum(too_high - too_high[np.argmax(found)], 0.0)
    more[~_may_be_overpriced(problems, modes, n)] = 0.0
    return np.flatnonzero(found + more >= least).tolist()


def _may_be_overpriced(problems, modes, n):
    """Which forms were learned to the end, with few hyperparameters."""
    learned = [all(mode.converged for mode in of) for of in modes]
    return np.array(learned) & (_sizes(problems) <= _most_weighed(problems, n))


def overpriced(problems):
    """Nats by which eq. 8 may price each form too high, over all outputs; an array.

    It prices all numbers of K^rho as if all n rows told them. Nearly all are a task's,
    and of M tasks those of one do, n / M of them on average.
    """
    numbers = [of[0].prior.task_covariance.n_free for of in problems]
    return price(np.array(numbers), problems[0][0].prior.n_tasks) * len(problems[0])


def is_overexplained(problems, modes, n=None):
    """Whether the best form by eq. 8 has few rows for each hyperparameter, with noise.

    Many hyperparameters explain few rows without noise, and eq. 8 takes that for true.
    If the best form has none, it must have yet fewer rows for each, and a form of few
    hyperparameters with a function for each task must have noise: compound symmetry, or
    else independent tasks.

    Parameters
    ----------
    problems, modes, n
        See `weighed`.

    Returns
    -------
    is_overexplained : bool
    """
    best = int(np.argmax(plausible(problems, modes)))
    forms = [of[0].prior.task_covariance for of in problems]
    small = [k for k, form in enumerate(forms) if form.n_own > 0 and form.n_free <= 2]
    tuning, noisy = problems[0][0].tuning, _are_noisy(problems, modes)
    told = noisy[best]
    if not told and small:
        told = noisy[max(small, key=lambda k: forms[k].n_free)]
    each = tuning.rows_told if noisy[best] else tuning.rows_explained
    return told and _n_rows(problems, n) < each * _sizes(problems)[best]


def _are_noisy(problems, modes):
    """Whether each form leaves noise, in all outputs."""
    pairs = zip(problems, modes, strict=True)
    return [all(map(Problem.is_noisy, *of)) for of in pairs]


def _sizes(problems):
    """Hyperparameters of each form."""
    return np.array([of[0].prior.n_hyperparameters for of in problems])


def _most_weighed(problems, n=None):
    """Hyperparameters of a form of which the evidence does not take too long."""
    tuning = problems[0][0].tuning
    of_few_rows, of_any = tuning.most_weighed
    by_work = int(tuning.weighed_work // _n_rows(problems, n))
    return min(of_few_rows, max(of_any, by_work))


def _n_rows(problems, n):
    return n_measured(problems[0][0].data) if n is None else n


def worths_of(problems, modes):
    """`worth` of each form, summed over the outputs; an array."""
    pairs = zip(problems, modes, strict=True)
    return np.array([sum(map(worth, *of)) for of in pairs])


def plausible(problems, modes):
    """`worths_of` less the penalty of the noise; -inf where it is not a number."""
    found = worths_of(problems, modes) - penalties(problems, modes)
    return np.where(np.isnan(found), -np.inf, found)


def may_be_weighed(problems, n=None):
    """Whether some forms are learned exactly, in memory, of one term and few rows.

    `n` is that of measurements, where the problems have only some of them.
    """
    first = problems[0][0]
    several = any(isinstance(of.prior.task_covariance, Forms) for of, *_ in problems)
    if several or not first.engine.exact or is_dask(first.data.X):
        return False
    return _n_rows(problems, n) <= first.tuning.rows_weighed * _sizes(problems).max()


def is_weighed(problems, modes, n=None):
    """Whether the evidence is to choose among some forms, and not eq. 8.

    It is where all were learned to the end, where one of them has noise, and none too
    many hyperparameters. Without noise rows tell the form well, and the Hessian has too
    few digits.
    """
    learned = all(mode.converged for of in modes for mode in of)
    noisy = any(_are_noisy(problems, modes))
    return learned and noisy and few_hyperparameters(problems, n)


def few_hyperparameters(problems, n=None):
    """Whether none of some forms has more of them than its Hessian may take."""
    most = _most_weighed(problems, n)
    return all(of.prior.n_hyperparameters <= most for each in problems for of in each)


def weighed(problems, modes, n=None, *, every=False):
    """Positions of the forms among which the evidence chooses; none if eq. 8 does.

    Parameters
    ----------
    problems, modes
        See `penalties`.
    n : int, default=None
        Number of measurements, where the problems have only some of them.
    every : bool, default=False
        Whether all are near the best, as their evidences have told before.

    Returns
    -------
    positions : list of int
        Forms without noise that were not learned to the end are none of them. If other
        forms near the best were not, or the likeliest, eq. 8 chooses.
    """
    if not may_be_weighed(problems, n):
        return []
    near = list(range(len(modes))) if every else near_best(problems, modes, n)
    likeliest = near[int(np.argmax(plausible(*_some(problems, modes, near))))]
    learned = [all(mode.converged for mode in modes[k]) for k in near]
    noisy = _are_noisy(*_some(problems, modes, near))
    near = [k for k, *of in zip(near, learned, noisy, strict=True) if any(of)]
    told = likeliest in near and is_weighed(*_some(problems, modes, near), n)
    return near if told else []


def _some(problems, modes, positions):
    return [problems[k] for k in positions], [modes[k] for k in positions]


def summed(density, problems, modes, n_jobs=None):
    """A log density of each form, summed over the outputs.

    Parameters
    ----------
    density : callable
        ``density(problem, mode)`` is that of an output.
    problems, modes
        See `penalties`.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    densities : ndarray of shape (n_forms,)
    """
    pairs = zip(problems, modes, strict=True)
    jobs = [job for of in pairs for job in zip(*of, strict=True)]
    found = np.array(run(density, jobs, n_jobs=n_jobs))
    return found.reshape(len(problems), -1).sum(axis=1)


def evidence_of_form(problem, mode):
    """The log evidence of a problem around a mode, in the problem's units.

    With little noise rows tell hyperparameters to many more digits than the prior. It
    hardly knows how large a second function is, and each costs the logarithm of that.
    So the evidence is at most some nats for each below eq. 8.
    """
    found = evidence_around(problem.likelihood_at(mode), mode.theta)
    most = problem.tuning.most_charged * problem.prior.n_hyperparameters
    return max(found, worth(problem, mode) - most)


def log_density_left_out(problem, mode):
    """Log density of each target given the others, in the problem's units, summed."""
    posterior = problem.likelihood_at(mode).posterior(mode.theta)
    residual, variance = posterior.leave_one_out(include_noise=True)
    return -0.5 * float((residual**2 / variance + np.log(2.0 * np.pi * variance)).sum())


def evidences(problems, modes, n_jobs=None):
    """`summed` of the log evidence; see :mod:`.evidence`."""
    return summed(evidence_of_form, problems, modes, n_jobs)


def evidences_in_reach(problems, modes, n_jobs=None):
    """`evidences`; -inf of forms that cannot come near the highest, see `at_most`.

    The one that may have most is weighed first, and then those that it leaves.

    Parameters
    ----------
    problems, modes, n_jobs
        See `summed`.

    Returns
    -------
    evidences : ndarray of shape (n_forms,)
    """
    tuning, most = problems[0][0].tuning, at_most(problems, modes)
    reach = tuning.weighed_within * len(modes[0]) + tuning.seldom_taken
    reach += tuning.tie_each * _sizes(problems).max()
    found, first = np.full(len(problems), -np.inf), int(np.argmax(most))
    found[first] = evidences(*_some(problems, modes, [first]), n_jobs)[0]
    least = found[first] - reach
    left = [k for k in range(len(most)) if k != first and not most[k] <= least]
    if left:
        found[left] = evidences(*_some(problems, modes, left), n_jobs)
    return np.where(np.isnan(found), -np.inf, found)


def at_most(problems, modes):
    """What the evidence of each form has not been above, in nats; an array.

    That is eq. 8 without the price of the numbers of k^x and the noise, and with that
    of the numbers of K^rho by the rows of a task.
    """
    forms = [of[0].prior.task_covariance for of in problems]
    numbers = _sizes(problems) - [form.n_free for form in forms]
    prices = price(numbers, n_measured(problems[0][0].data)) * len(modes[0])
    return worths_of(problems, modes) + overpriced(problems) + prices


def log_odds(problems, modes, n=None):
    """Log prior of each form, but for a constant.

    - With fewer than five measurements a task, on average, a rough function of each
      explains noise as well as functions, and hides what tasks share. So unrelated
      tasks are unlikely, and more so functions of each task that leave a fifth or less
      of the noise that the likeliest form without them has.
    - Where tasks were measured at different inputs, unrelated tasks are a little
      likelier: rows hardly tell, and their predictions there are less sure.

    Parameters
    ----------
    problems, modes, n
        See `weighed`.

    Returns
    -------
    log_odds : ndarray of shape (n_forms,)
        Zeros where learning is not exact, or of several terms.
    """
    first, forms = problems[0][0], [of[0].prior.task_covariance for of in problems]
    tuning, found = first.tuning, np.zeros(len(forms))
    if not first.engine.exact or any(isinstance(form, Forms) for form in forms):
        return found
    unrelated = np.array(list(map(is_unrelated, forms)))
    if _n_rows(problems, n) < tuning.few_rows * first.prior.n_tasks:
        found[unrelated] = -tuning.seldom
        found[_take_noise(problems, modes)] = -tuning.seldom_taken
    if is_apart(first):
        found[~unrelated] -= tuning.tie
    return found


def _take_noise(problems, modes):
    """Which forms have functions of each task that take most of the noise."""
    own = np.array([of[0].prior.task_covariance.n_own > 0 for of in problems])
    if own.all():
        return np.zeros(len(own), dtype=bool)
    noise = np.array(list(map(_log_noise, problems, modes)))
    best = np.argmax(np.where(own, -np.inf, plausible(problems, modes)))
    return own & (noise < noise[best] + np.log(problems[0][0].tuning.taken))


def is_unrelated(form):
    """Whether tasks have functions of their own alone."""
    several = isinstance(form, Forms)
    return not several and form.n_own > 0 and not (form.rank or form.shared)


def is_apart(problem):
    """Whether tasks, with few rows, were measured at inputs that hardly overlap."""
    data, tuning = problem.data, problem.tuning
    few = len(data) <= tuning.rows_apart
    return few and share_overlapping(data.X, data.tasks) < tuning.overlapping


def _log_noise(problems, modes):
    """Mean logarithm of the noise variances of a form, over the outputs."""
    pairs = zip(problems, modes, strict=True)
    return np.mean([mode.theta[of.prior.of_noise].mean() for of, mode in pairs])


def best_of_forms(problems, modes, n_jobs=None, *, every=False):
    """Position of the form to take.

    Parameters
    ----------
    problems, modes, n_jobs
        See `summed`.
    every : bool, default=False
        See `weighed`.
    """
    near = weighed(problems, modes, every=every)
    if not near:
        return int(np.argmax(worths_of(problems, modes) + log_odds(problems, modes)))
    if len(near) == 1:
        return near[0]
    some, odds = _some(problems, modes, near), log_odds(problems, modes)[near]
    told = evidences_in_reach(*some, n_jobs) + odds
    by_eq_8 = worths_of(*some) + odds
    return near[preferred(told, by_eq_8, _sizes(some[0]), problems[0][0])]


def preferred(evidences, by_eq_8, sizes, problem):
    """Position of the form to take: the simplest of the likeliest, or that of eq. 8.

    Laplace's method charges a factor too much where tasks are nearly alike, for its
    prior does not prefer that. So eq. 8 may take another form of nearly the highest
    evidence, if it has enough rows for each hyperparameter. Where tasks were measured
    at different inputs neither tells much, and predictions differ most.

    Parameters
    ----------
    evidences, by_eq_8 : ndarray of shape (n_forms,)
        Log evidence and eq. 8.
    sizes : ndarray of shape (n_forms,)
        Hyperparameters of an output.
    problem : Problem
        Of any form.

    Returns
    -------
    position : int
    """
    tuning = problem.tuning
    simple = simplest(evidences, sizes, tuning)
    if is_apart(problem):
        return simple
    enough = n_measured(problem.data) >= tuning.rows_if_close * np.asarray(sizes)
    close = _close(evidences, sizes, tuning.close, tuning) & enough
    best = int(np.argmax(np.where(close & ~np.isnan(by_eq_8), by_eq_8, -np.inf)))
    gains = close[best] and by_eq_8[best] > by_eq_8[simple] + tuning.tie
    return best if gains else simple


def simplest(evidences, sizes, tuning=TUNING):
    """Position of the smallest model of those with all but the highest evidence.

    Laplace's method is the less exact, the more hyperparameters it integrates out.
    """
    close = np.flatnonzero(_close(evidences, sizes, tuning.tie, tuning))
    return int(min(close, key=lambda k: (sizes[k], -evidences[k])))


def _close(evidences, sizes, tie, tuning):
    """Which have the highest evidence or less by a tie; smaller ones have a larger."""
    best = int(np.argmax(evidences))
    more = np.maximum(0, sizes[best] - np.asarray(sizes))
    return evidences >= evidences[best] - tie - tuning.tie_each * more


def corrections(problems, modes, n_jobs=None, n=None):
    """What to add to eq. 8 of each form, so that those near the best have the evidence.

    Parameters
    ----------
    problems, modes, n_jobs
        See `summed`.
    n : int, default=None
        Number of measurements, where the problems have only some of them.

    Returns
    -------
    corrections : ndarray of shape (n_forms,)
        The prior of the noise and that of the form. Forms within reach differ by their
        evidence instead, so that it chooses among them; of those that cannot be chosen
        then it is -inf. Where eq. 8 is to choose, the prior of the form alone.
    """
    worths, odds = worths_of(problems, modes), log_odds(problems, modes, n)
    near = weighed(problems, modes, n)
    if not near:
        return odds
    found = odds - penalties(problems, modes)
    if is_overexplained(problems, modes, n):
        found[np.setdiff1d(np.arange(len(found)), near)] = -np.inf
    if len(near) > 1:
        some = _some(problems, modes, near)
        told = evidences_in_reach(*some, n_jobs)
        below = told.max() - problems[0][0].tuning.weighed_within * len(modes[0])
        others = np.minimum(at_most(*some), below)
        told = np.where(np.isfinite(told), told, others) + odds[near]
        highest = np.nanmax(np.where(np.isnan(worths), -np.inf, worths + found))
        found[near] = told - told.max() + highest - worths[near]
    return found
