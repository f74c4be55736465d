"""Which of several forms of K^rho may be taken: those near the best by eq. 8.

Eq. 8 prices parameters as if rows were many, and does not mind where there is almost no
noise, with which models of few rows predict badly. It also prices the numbers of a task
as if all rows told them. So several forms may be near the best, by eq. 8 and the prior
of the noise, and :mod:`.weighing` takes one of them.
"""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp.learning.problem import Problem
from skmtgp.learning.screening import criterion, price
from skmtgp.learning.vanishing import price_of_choice, vanished
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.several import Forms


def worth(problem, mode, times=1.0):
    """Eq. 8, see `criterion`; of a diagonal only what has not vanished counts.

    The density of little noise does not, but see `penalties`.
    """
    n_vanished, choices = uncounted(problem, mode)
    found = criterion(problem, mode, times) - problem.of_little_noise(mode.theta)[0]
    return found + price(n_vanished, times * problem.data.n_measured) - choices


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
        tuning, sizes = problems[0][0].tuning, sizes_of(problems)
        most = n_rows(problems, n) // tuning.rows_explained
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
    return np.array(learned) & (sizes_of(problems) <= _most_weighed(problems, n))


def overpriced(problems):
    """Nats by which eq. 8 may price each form too high, over all outputs; an array.

    It prices all numbers of K^rho as if all n rows told them. Nearly all are a task's,
    and of M tasks those of one do, n / M of them on average.
    """
    numbers = [of[0].prior.task_covariance.n_free for of in problems]
    return price(np.array(numbers), problems[0][0].prior.n_tasks) * len(problems[0])


def is_of_own_functions(form):
    """Whether tasks have functions of one variance: independent, or with one of all."""
    return form.n_own > 0 and form.n_free <= 2


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
    small = np.flatnonzero(list(map(is_of_own_functions, forms))).tolist()
    tuning, noisy = problems[0][0].tuning, _are_noisy(problems, modes)
    told = noisy[best]
    if not told and small:
        told = noisy[max(small, key=lambda k: forms[k].n_free)]
    each = tuning.rows_told if noisy[best] else tuning.rows_explained
    return told and n_rows(problems, n) < each * sizes_of(problems)[best]


def _are_noisy(problems, modes):
    """Whether each form leaves noise, in all outputs."""
    pairs = zip(problems, modes, strict=True)
    return [all(map(Problem.is_noisy, *of)) for of in pairs]


def sizes_of(problems):
    """Hyperparameters of each form."""
    return np.array([of[0].prior.n_hyperparameters for of in problems])


def _most_weighed(problems, n=None):
    """Hyperparameters of a form of which the evidence does not take too long."""
    tuning = problems[0][0].tuning
    of_few_rows, of_any = tuning.most_weighed
    by_work = int(tuning.weighed_work // n_rows(problems, n))
    return min(of_few_rows, max(of_any, by_work))


def n_rows(problems, n=None):
    """Number of measurements: `n`, or those of the problems."""
    return problems[0][0].data.n_measured if n is None else n


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
    return n_rows(problems, n) <= first.tuning.rows_weighed * sizes_of(problems).max()


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
    likeliest = near[int(np.argmax(plausible(*some_of(problems, modes, near))))]
    learned = [all(mode.converged for mode in modes[k]) for k in near]
    noisy = _are_noisy(*some_of(problems, modes, near))
    near = [k for k, *of in zip(near, learned, noisy, strict=True) if any(of)]
    told = likeliest in near and is_weighed(*some_of(problems, modes, near), n)
    return near if told else []


def some_of(problems, modes, positions):
    """The problems and modes of some forms."""
    return [problems[k] for k in positions], [modes[k] for k in positions]
