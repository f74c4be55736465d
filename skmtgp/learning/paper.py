"""The paper's heuristic to the letter, and what it argues against.

Both learn each rank on its own, from one start unless more are asked for, by one climb
over all rows: to compare with :func:`skmtgp.learning.ranks.learn_ranks`.
"""

import numpy as np

from skmtgp._parallel import run
from skmtgp._progress import silent
from skmtgp.learning.climbing import climb
from skmtgp.learning.problem import best_of
from skmtgp.learning.ranks import (
    by_output,
    description,
    make_starts,
    more_starts,
)
from skmtgp.learning.stages import Start, likeliest, with_starts


def learn_staged(pairs, forms, *, seeds=(), n_jobs=None, progress=silent):
    """Section 3: steps 1 and 2 from K_0^rho = 1 1^T and I, step 3 from the likelier.

    Parameters and result are those of :func:`skmtgp.learning.ranks.learn_ranks`.
    """
    starts = make_starts(pairs, n_jobs, relaxed=False)
    more = more_starts(pairs, starts, seeds, n_jobs)
    jobs = [
        (*pair, form, of_output, others)
        for pair, of_output, others in zip(pairs, starts, more, strict=True)
        for form in forms
    ]
    report = progress("learning", len(jobs), description(pairs, forms))
    return by_output(run(_third_step, jobs, n_jobs=n_jobs, report=report), forms)


def _third_step(data, settings, form, starts, more):
    """Section 3.1: "we select the one with the higher likelihood"."""
    modes = [
        climb(data, settings, form, start.theta(settings, form))
        for start in (likeliest(starts), *more)
    ]
    return with_starts(best_of(modes), [*starts, *more])


def learn_simultaneously(pairs, forms, *, seeds, n_jobs=None, progress=silent):
    """All parameters at once, from theta_0^x, sigma_0^2 and a random K_0^rho.

    Parameters and result are those of :func:`skmtgp.learning.ranks.learn_ranks`; there
    is one start for each seed.

    Notes
    -----
    K_0^rho = 1 1^T and I will not do: the columns that a factor of the first lacks have
    no gradient, and of the second, cut to a lower rank, nothing is left for most tasks.
    """
    jobs = [(*pair, form, seeds) for pair in pairs for form in forms]
    report = progress("learning", len(jobs), description(pairs, forms))
    return by_output(run(_from_random, jobs, n_jobs=n_jobs, report=report), forms)


def _from_random(data, settings, form, seeds):
    modes = []
    for seed in seeds:
        draw = np.random.default_rng(seed).standard_normal((data.n_tasks, form.rank))
        F = draw / np.sqrt(form.rank)
        start = Start(settings.kernel.theta, F @ F.T).theta(settings, form)
        modes.append(climb(data, settings, form, start))
    return best_of(modes)
