"""Which of several forms of K^rho to take: by their evidence, or by eq. 8.

The log evidence minds all that eq. 8 does not, see :mod:`.contenders`, but takes a
gradient for each hyperparameter. So it is only computed of the forms near the best.
"""

import numpy as np

from skmtgp._data.overlap import share_overlapping
from skmtgp._numerics.parallel import run
from skmtgp.learning.contenders import (
    is_of_own_functions,
    is_overexplained,
    n_rows,
    overpriced,
    penalties,
    plausible,
    sizes_of,
    some_of,
    weighed,
    worth,
    worths_of,
)
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.screening import price
from skmtgp.learning.tuning import TUNING
from skmtgp.model.several import Forms


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
    reach += tuning.tie_each * sizes_of(problems).max()
    found, first = np.full(len(problems), -np.inf), int(np.argmax(most))
    found[first] = evidences(*some_of(problems, modes, [first]), n_jobs)[0]
    least = found[first] - reach
    left = [k for k in range(len(most)) if k != first and not most[k] <= least]
    if left:
        found[left] = evidences(*some_of(problems, modes, left), n_jobs)
    return np.where(np.isnan(found), -np.inf, found)


def at_most(problems, modes):
    """What the evidence of each form has not been above, in nats; an array.

    That is eq. 8 without the price of the numbers of k^x and the noise, and with that
    of the numbers of K^rho by the rows of a task.
    """
    forms = [of[0].prior.task_covariance for of in problems]
    numbers = sizes_of(problems) - [form.n_free for form in forms]
    prices = price(numbers, problems[0][0].data.n_measured) * len(modes[0])
    return worths_of(problems, modes) + overpriced(problems) + prices


def log_odds(problems, modes, n=None):
    """Log prior of each form, but for a constant.

    - With fewer than five measurements a task, on average, a rough function of each
      explains noise as well as functions, and hides what tasks share. So unrelated
      tasks are unlikely, and more so functions of each task that leave a fifth or less
      of the noise that the likeliest form without them has.
    - Where tasks were measured at different inputs, unrelated tasks are a little
      likelier: rows hardly tell, and their predictions there are less sure.
    - Where learning is not exact, nothing but eq. 8 chooses, and this is what it prices
      the best rank too high beside functions of the tasks' own.

    Parameters
    ----------
    problems, modes, n
        See `weighed`.

    Returns
    -------
    log_odds : ndarray of shape (n_forms,)
        Zeros where learning is of several terms.
    """
    first, forms = problems[0][0], [of[0].prior.task_covariance for of in problems]
    tuning, found = first.tuning, np.zeros(len(forms))
    if any(isinstance(form, Forms) for form in forms):
        return found
    if not first.engine.exact:
        return found + _refund(problems, modes, forms)
    unrelated = np.array(list(map(is_unrelated, forms)))
    if n_rows(problems, n) < tuning.few_rows * first.prior.n_tasks:
        found[unrelated] = -tuning.seldom
        found[_take_noise(problems, modes)] = -tuning.seldom_taken
    if is_apart(first):
        found[~unrelated] -= tuning.tie
    return found


def _refund(problems, modes, forms):
    """What eq. 8 prices ranks too high, of the best one; none for own functions."""
    own = np.array(list(map(is_of_own_functions, forms)))
    worths = np.where(own, -np.inf, worths_of(problems, modes))
    return np.where(own, 0.0, overpriced(problems)[np.argmax(worths)])


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
    if len(problems) == 1:  # perhaps of a user's
        return 0
    near = weighed(problems, modes, every=every)
    if not near:
        return int(np.argmax(worths_of(problems, modes) + log_odds(problems, modes)))
    if len(near) == 1:
        return near[0]
    some, odds = some_of(problems, modes, near), log_odds(problems, modes)[near]
    told = evidences_in_reach(*some, n_jobs) + odds
    by_eq_8 = worths_of(*some) + odds
    return near[preferred(told, by_eq_8, sizes_of(some[0]), problems[0][0])]


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
    enough = problem.data.n_measured >= tuning.rows_if_close * np.asarray(sizes)
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
        some = some_of(problems, modes, near)
        told = evidences_in_reach(*some, n_jobs)
        below = told.max() - problems[0][0].tuning.weighed_within * len(modes[0])
        others = np.minimum(at_most(*some), below)
        told = np.where(np.isfinite(told), told, others) + odds[near]
        highest = np.nanmax(np.where(np.isnan(worths), -np.inf, worths + found))
        found[near] = told - told.max() + highest - worths[near]
    return found
