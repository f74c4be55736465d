"""The paper's heuristic to the letter, and what it argues against.

Both learn each rank on its own, from one start unless more are asked for, by one climb
over all rows: to compare with :func:`skmtgp.learning.ranks.learn_ranks`.
"""

import numpy as np

from skmtgp._support.progress import silent
from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of
from skmtgp.learning.ranks import (
    by_output,
    description,
    make_starts,
    more_starts,
)
from skmtgp.learning.stages import from_each_start, likeliest, with_starts


def learn_staged(problems, forms, *, seeds=(), n_jobs=None, progress=silent):
    """Section 3: steps 1 and 2 from K_0^rho = 1 1^T and I, step 3 from the likelier.

    Parameters and result are those of :func:`skmtgp.learning.ranks.learn_ranks`.
    """
    starts = make_starts(problems, n_jobs, relaxed=False)
    more = more_starts(problems, starts, seeds, n_jobs)
    followed = [
        [likeliest(of), *others] for of, others in zip(starts, more, strict=True)
    ]
    modes = _learn(_third_step, problems, forms, followed, n_jobs, progress)
    return [
        [with_starts(mode, [*of, *others]) for mode in of_output]
        for of_output, of, others in zip(modes, starts, more, strict=True)
    ]


def _third_step(problem, start):
    """Section 3.1: "we select the one with the higher likelihood"."""
    return climb(problem, start.theta(problem))


def learn_simultaneously(problems, forms, *, seeds, n_jobs=None, progress=silent):
    """All parameters at once, from theta_0^x, sigma_0^2 and a random K_0^rho.

    Parameters and result are those of :func:`skmtgp.learning.ranks.learn_ranks`; there
    is one start for each seed.

    Notes
    -----
    K_0^rho = 1 1^T and I will not do: the columns that a factor of the first lacks have
    no gradient, and of the second, cut to a lower rank, nothing is left for most tasks.
    """
    return _learn(
        _from_random, problems, forms, [seeds] * len(problems), n_jobs, progress
    )


def _from_random(problem, seed):
    n_tasks, rank = problem.prior.n_tasks, problem.prior.task_covariance.rank
    n_columns = max(rank, 1)  # of rank 0, too, something is shared
    draw = np.random.default_rng(seed).standard_normal((n_tasks, n_columns))
    F = draw / np.sqrt(n_columns)
    return climb(problem, problem.theta(K_rho=F @ F.T))


def _learn(climb_from, problems, forms, starts, n_jobs, progress):
    """The best mode of each output and form, from the starts of the output."""
    jobs = [
        (problem.with_form(form), of)
        for problem, of in zip(problems, starts, strict=True)
        for form in forms
    ]
    n = len(starts[0])
    report = progress("learning", n * len(jobs), description(problems, forms, n))
    modes = from_each_start(climb_from, jobs, n_jobs=n_jobs, report=report)
    return by_output([best_of(of) for of in modes], forms)
