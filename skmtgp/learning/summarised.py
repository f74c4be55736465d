"""Learning from more rows than exact inference takes: the bound of sparse inference.

Some of the rows are learned from exactly, by any of the learners. From the modes found
there the bound over all rows is climbed, with inducing inputs chosen for the kernel as
learned so far, which are the same for all ranks: their models stay part of each other.
Where they are optimised, the highest rank's bound says where they go.
"""

from dataclasses import replace
from time import perf_counter

import numpy as np
from joblib import parallel_config

from skmtgp._data.dask import is_dask
from skmtgp._numerics.parallel import run
from skmtgp._support.progress import say, silent
from skmtgp.inference.engines import Dense
from skmtgp.inference.inducing import greedy_variance, k_means, optimised
from skmtgp.learning.climbing import climb
from skmtgp.learning.nesting import nest
from skmtgp.learning.telling import about, in_words


def exact_part(problems, forms):
    """What exact inference learns, for each output: all of it, or from some rows.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of FixedTaskCovariance, LowRank or another
        Forms of K^rho that will be learned.

    Returns
    -------
    problems : list of Problem
        Of `n_exact` rows where the engine approximates.

    Raises
    ------
    ValueError
        If the engine cannot take a form: better now than after the exact part.
    """
    for form in forms:
        problems[0].engine.check_form(form)
    return [_exact(problem) for problem in problems]


def _exact(problem):
    data, engine = problem.data, problem.engine
    if engine.n_exact is None:
        return problem
    drawn = data.drawn(min(engine.n_exact, len(data)))
    budget = replace(problem.budget, only_begins=True)
    return replace(problem, data=drawn, engine=Dense(), budget=budget)


def learn_rest(problems, forms, modes, **options):
    """Learn on from all rows where the modes are those of a part.

    Parameters
    ----------
    problems : list of Problem
        For each output.
    forms : list of FixedTaskCovariance, LowRank or another
        Forms of K^rho, of ascending rank.
    modes : list of list of Mode
        For each output and form, what `exact_part` of the problems told.
    **options
        See `learn_bounds`.

    Returns
    -------
    modes : list of list of Mode
        For each output and form. As they were where inference is exact.
    """
    models = [[problem.with_form(form) for form in forms] for problem in problems]
    return learn_bounds(models, modes, **options)


def learn_bounds(models, modes, *, nest=nest, n_jobs=None, progress=silent):
    """The same for any models of the outputs.

    Parameters
    ----------
    models : list of list of Problem
        For each output, those that are part of others first; the last one says where
        the inducing inputs of all are.
    modes : list of list of Mode
        For each output and model, what its `exact_part` told.
    nest : callable, default=nest
        What learns models again from those that are part of them.
    n_jobs : int, default=None
        Processes. Rows that lie in Dask's partitions are shared out already: one.
    progress : callable, default=silent
        Told of each output, see :func:`skmtgp._support.progress.fitting`.

    Returns
    -------
    modes : list of list of Mode
        For each output and model. As they were where inference is exact.
    """
    [first, *_] = models[0]
    if first.engine.exact:
        return modes
    jobs = [(*of, nest) for of in zip(models, modes, strict=True)]

    def describe(j, modes):
        return [
            f"{about(of, of.prior.task_covariance)}"
            f"{in_words(of, mode.theta, mode.value, bound=True)} "
            f"of all {mode.n_samples} rows"
            for of, mode in zip(models[j], modes, strict=True)
        ]

    report = progress("learning from all rows by inducing inputs", len(jobs), describe)
    if not is_dask(first.data.X):
        return run(climb_bounds, jobs, n_jobs=n_jobs, report=report)
    with parallel_config(backend="sequential"):
        return run(climb_bounds, jobs, report=report)


def climb_bounds(problems, modes, nest=nest):
    """Climb the bound from modes of some of the rows.

    Parameters
    ----------
    problems : list of Problem
        Of all rows, of which there may be millions; those that are part of others
        first.
    modes : list of Mode
        The mode of each.
    nest : callable, default=nest
        See `learn_bounds`.

    Returns
    -------
    modes : list of Mode
        None is below that of a model that is part of it.
    """
    given, best, rounds = problems, None, problems[0].tuning.rounds
    for k in range(rounds):
        begin, last = perf_counter(), k == rounds - 1
        problems = [with_gain(*of, last=last) for of in zip(given, modes, strict=True)]
        if problems[-1].budget.verbose:
            say(
                f"{about(problems[-1])}choosing inducing inputs from "
                f"{len(problems[-1].data)} rows, round {k + 1} of {rounds}"
            )
        Z, n_evaluations = inducing_inputs(problems[-1], modes[-1])
        seconds = perf_counter() - begin
        summarised = [p.with_data(replace(p.data, Z=Z)) for p in problems]
        modes = [
            mode.then(climb(problem, begin_at(problem, mode)))
            for problem, mode in zip(summarised, modes, strict=True)
        ]
        modes = [
            mode._replace(
                n_evaluations=mode.n_evaluations + n_evaluations,
                seconds=mode.seconds + seconds,
            )
            for mode in nest(summarised, modes)
        ]
        if best is None or modes[-1].value > best[-1].value:
            best = modes
    return [
        mode._replace(n_evaluations=last.n_evaluations, seconds=last.seconds)
        for mode, last in zip(best, modes, strict=True)
    ]


def with_gain(problem, mode, *, last=True):
    """The problem with a tolerance for many rows.

    Parameters
    ----------
    problem : Problem
        Of many rows.
    mode : Mode
        Where the climb begins. Climbs of noisy data do not creep: where they gain
        little they are soon given up.
    last : bool, default=True
        Whether it is the last round; those before say where inducing inputs are to be.

    Returns
    -------
    problem : Problem
    """
    tuning, budget = problem.tuning, problem.budget
    gain = min(tuning.gain * len(problem.data), tuning.most_gain)
    patience = budget.patience
    if problem.is_noisy(mode):
        patience = tuning.noisy_patience if last else tuning.sketched
    budget = replace(budget, tol=max(budget.tol, gain), patience=patience)
    return replace(problem, budget=budget)


def begin_at(problem, mode):
    """Parameters at which the climb of the bound begins.

    A few rows may ask for less noise than all do. Raised at once to where it is held,
    it would lead the first climb away from what is known already: it is no higher than
    it must. A climb with almost no noise gets stuck for lack of digits: raised a
    little, though not above where it is held, it lets the second get further.

    Parameters
    ----------
    problem : Problem
        With inducing inputs.
    mode : Mode
        What was learned so far.

    Returns
    -------
    theta : ndarray of shape (n_theta,)
        The mode's, or with more noise.
    """
    way = problem.with_noise(mode.theta) - mode.theta
    if mode.Z is not None:
        return mode.theta + np.minimum(way, np.log(problem.tuning.raised))
    steps = np.linspace(1.0, 0.0, problem.tuning.noises if way.any() else 1)
    value = problem.likelihood().value
    return max((mode.theta + step * way for step in steps), key=value)


def inducing_inputs(problem, mode):
    """Inducing inputs for the bound that is climbed from a mode.

    Parameters
    ----------
    problem : Problem
        Which inputs, how many, and the budget.
    mode : Mode
        What was learned so far.

    Returns
    -------
    Z : ndarray of shape (n_inducing, n_features)
        The inputs.
    n_evaluations : int
        Bounds with their gradients that it took.
    """
    if problem.engine.inducing_inputs != "optimised":
        return _chosen(problem, mode), 0
    Z = _chosen(problem, mode) if mode.Z is None else mode.Z
    problem = problem.with_data(replace(problem.data, Z=Z))
    return optimised(
        problem.likelihood(),
        begin_at(problem, mode),
        max_iter=min(problem.tuning.most_moves, problem.budget.max_iter),
        tol=problem.budget.tol,
    )


def _chosen(problem, mode):
    """Rows of X or means of clusters of them, for k^x as learned."""
    X, n_inducing = problem.data.X, problem.engine.n_inducing
    rng = np.random.RandomState(0)
    if problem.engine.inducing_inputs == "k-means":
        X = k_means(X, n_inducing, random_state=rng)
    kernel = problem.prior.kernel_at(mode.theta)
    sizes = _sizes(problem.prior, mode.theta)
    return greedy_variance(kernel, X, n_inducing, sizes=sizes, random_state=rng)


def _sizes(prior, theta):
    """How large each term is, beside the largest: by K^rho, of all tasks."""
    variances = [np.diagonal(K_rho).mean() for _, K_rho in prior.terms_at(theta)]
    sizes = np.maximum(variances, np.finfo(float).tiny)
    return sizes / sizes.max()
