"""Which of several forms of K^rho to take: by eq. 8, and by the evidence.

Eq. 8 prices parameters as if rows were many, and does not mind where there is almost no
noise, with which models of few rows predict badly. The log evidence minds both, but
takes two gradients for each hyperparameter. So it is only computed of the forms that
are near the best by eq. 8 and the prior of the noise.
"""

import numpy as np

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import run
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.screening import criterion, price
from skmtgp.learning.vanishing import price_of_choice, vanished
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.several import Forms

REACH = 5.0  # nats an output: no more did eq. 8 miss by, on drawn data
MOST = 100  # hyperparameters of an output: with more the evidence takes too long
# Rows of each hyperparameter, of the largest form: with more eq. 8 says much the same,
# and the evidence takes as long as learning does.
ROWS = 30
TIE = 1.0  # nats of evidence: not worth more than a bare mention (Kass, Raftery 1995)


def worth(problem, mode, times=1.0):
    """Eq. 8, see `criterion`; of a diagonal only what has not vanished counts."""
    n_vanished, choices = uncounted(problem, mode)
    found = criterion(problem, mode, times)
    return found + price(n_vanished, times * len(problem.data)) - choices


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


def near_best(problems, modes):
    """Positions of the forms near the best, by eq. 8 and the prior of the noise.

    Parameters
    ----------
    problems, modes
        See `penalties`.

    Returns
    -------
    positions : list of int
    """
    worths = worths_of(problems, modes) - penalties(problems, modes)
    least = np.nanmax(worths) - REACH * len(problems[0])
    return np.flatnonzero(worths >= least).tolist()


def worths_of(problems, modes):
    """`worth` of each form, summed over the outputs; an array."""
    pairs = zip(problems, modes, strict=True)
    return np.array([sum(map(worth, *of)) for of in pairs])


def may_be_weighed(problems, n=None):
    """Whether some forms are learned exactly, in memory, of one term and few rows.

    `n` is the number of rows, where the problems have only some of them.
    """
    first = problems[0][0]
    several = any(isinstance(of.prior.task_covariance, Forms) for of, *_ in problems)
    if several or not first.engine.exact or is_dask(first.data.X):
        return False
    most = max(of.prior.n_hyperparameters for each in problems for of in each)
    return (len(first.data) if n is None else n) <= ROWS * most


def is_weighed(problems, modes):
    """Whether the evidence is to choose among some forms, and not eq. 8.

    It is where all were learned to the end, where one of them has noise, and none too
    many hyperparameters. Without noise rows tell the form well, and the Hessian has too
    few digits.
    """
    learned = all(mode.converged for of in modes for mode in of)
    noisy = any(
        all(problem.is_noisy(mode) for problem, mode in zip(*of, strict=True))
        for of in zip(problems, modes, strict=True)
    )
    return learned and noisy and few_hyperparameters(problems)


def few_hyperparameters(problems):
    """Whether none of some forms has more of them than its Hessian may take."""
    return all(of.prior.n_hyperparameters <= MOST for each in problems for of in each)


def evidences(problems, modes, n_jobs=None):
    """Log evidence of each form, summed over the outputs; see :mod:`.evidence`.

    Parameters
    ----------
    problems, modes
        See `penalties`.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    evidences : ndarray of shape (n_forms,)
    """
    jobs = [
        pair
        for of in zip(problems, modes, strict=True)
        for pair in zip(*of, strict=True)
    ]
    found = np.array(run(evidence_of, jobs, n_jobs=n_jobs))
    return found.reshape(len(problems), -1).sum(axis=1)


def evidence_of(problem, mode):
    """The log evidence of a problem around a mode, in the problem's units."""
    likelihood = problem.engine.likelihood(problem.prior, problem.data)
    return evidence_around(likelihood, mode.theta)


def best_of_forms(problems, modes, n_jobs=None):
    """Position of the form to take, see :func:`corrections` and :func:`simplest`.

    Parameters
    ----------
    problems, modes, n_jobs
        See `evidences`.
    """
    found = corrections(problems, modes, n_jobs)
    values = found + worths_of(problems, modes)
    if not found.any():  # eq. 8 has chosen
        return int(np.argmax(values))
    return simplest(values, [of.prior.n_hyperparameters for of, *_ in problems])


def simplest(evidences, sizes):
    """Position of the smallest model of those with all but the highest evidence."""
    close = np.flatnonzero(evidences >= evidences.max() - TIE)
    return int(min(close, key=lambda k: (sizes[k], -evidences[k])))


def corrections(problems, modes, n_jobs=None, n=None):
    """What to add to eq. 8 of each form, so that those near the best have the evidence.

    Parameters
    ----------
    problems, modes, n_jobs
        See `evidences`.
    n : int, default=None
        Number of rows, where the problems have only some of them.

    Returns
    -------
    corrections : ndarray of shape (n_forms,)
        The prior of the noise. Forms within reach differ by their evidence instead, so
        that it chooses among them. Zeros where eq. 8 is to choose.
    """
    worths = worths_of(problems, modes)
    if not may_be_weighed(problems, n):
        return np.zeros(len(worths))
    near, found = near_best(problems, modes), -penalties(problems, modes)
    of_near = [problems[k] for k in near], [modes[k] for k in near]
    if not is_weighed(*of_near):
        return np.zeros(len(worths))
    if len(near) > 1:
        told = evidences(*of_near, n_jobs)
        best = near[int(np.argmax(told))]
        found[near] = told - told.max() + worths[best] + found[best] - worths[near]
    return found
