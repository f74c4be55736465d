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
from skmtgp._support.progress import silent
from skmtgp.inference.inducing import greedy_variance, k_means, optimised
from skmtgp.inference.latent import check_latent
from skmtgp.learning.climbing import climb
from skmtgp.learning.nesting import nest

ROUNDS = 2  # of choosing inducing inputs
GAIN = 1e-4  # nats a row under which a climb of the bound ends, but
MOST_GAIN = 10.0  # nats at most
MOST_MOVES = 100  # of all inducing inputs, in a round
NOISES = 6  # noise variances that are tried before the first climb
RAISED = 100.0  # times the noise variance, before the second


def exact_part(pairs, forms):
    """What of the data exact inference learns from, for each output: all, or some rows.

    Parameters
    ----------
    pairs : list of (Data, Settings)
        For each output.
    forms : list of FixedTaskCovariance, LowRank or WithDiagonal
        Forms of K^rho that will be learned.

    Returns
    -------
    pairs : list of (Data, Settings)
        Of `n_exact` rows where inference is sparse.

    Raises
    ------
    ValueError
        If inference is sparse and a form has no latent functions: better now than
        after the exact part.
    """
    if any(settings.inference == "sparse" for _, settings in pairs):
        for form in forms:
            check_latent(form)
    return [
        (data.drawn(min(settings.n_exact, len(data.y))), settings)
        if settings.inference == "sparse"
        else (data, settings)
        for data, settings in pairs
    ]


def learn_rest(pairs, forms, modes, *, n_jobs=None, progress=silent):
    """Learn on from all rows where the modes are those of a part.

    Parameters
    ----------
    pairs : list of (Data, Settings)
        For each output.
    forms : list of FixedTaskCovariance, LowRank or WithDiagonal
        Forms of K^rho, of ascending rank.
    modes : list of list of Mode
        For each output and form, what `exact_part` of the pairs told.
    n_jobs : int, default=None
        Processes. Rows that lie in Dask's partitions are shared out already: one.
    progress : callable, default=silent
        Told of each output, see :func:`skmtgp._support.progress.fitting`.

    Returns
    -------
    modes : list of list of Mode
        For each output and form. As they were where inference is exact.
    """
    if all(settings.inference != "sparse" for _, settings in pairs):
        return modes
    jobs = [(*pair, forms, of) for pair, of in zip(pairs, modes, strict=True)]

    def describe(j, modes):
        values = ", ".join(f"{mode.value:.2f}" for mode in modes)
        return (
            f"{pairs[j][1].name}: bound on the log marginal likelihood {values} "
            f"(scaled) of {modes[0].n_samples} rows"
        )

    report = progress("learning from all rows by inducing inputs", len(jobs), describe)
    if not is_dask(pairs[0][0].X):
        return run(climb_bounds, jobs, n_jobs=n_jobs, report=report)
    with parallel_config(backend="sequential"):
        return run(climb_bounds, jobs, report=report)


def climb_bounds(data, settings, forms, modes):
    """Climb the bound from modes of some of the rows.

    Parameters
    ----------
    data : Data
        Observations, of which there may be millions.
    settings : Settings
        Kernel, bounds and budget.
    forms : list of FixedTaskCovariance, LowRank or WithDiagonal
        Forms of K^rho, of ascending rank.
    modes : list of Mode
        The mode of each.

    Returns
    -------
    modes : list of Mode
        Their values do not fall as the rank grows.
    """
    gain = min(GAIN * len(data.y), MOST_GAIN)
    settings = replace(settings, tol=max(settings.tol, gain))
    best = None
    for _ in range(ROUNDS):
        begin = perf_counter()
        Z, n_evaluations = inducing_inputs(data, settings, forms[-1], modes[-1])
        seconds = perf_counter() - begin
        summarised = replace(data, Z=Z)
        modes = [
            _climb_on(summarised, settings, form, mode)
            for form, mode in zip(forms, modes, strict=True)
        ]
        modes = [
            mode._replace(
                n_evaluations=mode.n_evaluations + n_evaluations,
                seconds=mode.seconds + seconds,
            )
            for mode in nest(summarised, settings, forms, modes)
        ]
        if best is None or modes[-1].value > best[-1].value:
            best = modes
    return [
        mode._replace(n_evaluations=last.n_evaluations, seconds=last.seconds)
        for mode, last in zip(best, modes, strict=True)
    ]


def _climb_on(data, settings, form, mode):
    return mode.then(climb(data, settings, form, begin_at(data, settings, form, mode)))


def begin_at(data, settings, form, mode):
    """Parameters at which the climb of the bound begins.

    A few rows may ask for less noise than all do. Raised at once to where it is held,
    it would lead the first climb away from what is known already: it is no higher than
    it must. A climb with next to no noise gets stuck for lack of digits: raised a
    little, though not above where it is held, it lets the second get further.

    Parameters
    ----------
    data : Data
        Observations with their inducing inputs.
    settings, form, mode
        Of the model, and what was learned so far.

    Returns
    -------
    theta : ndarray of shape (n_theta,)
        The mode's, or with more noise.
    """
    way = settings.with_noise(mode.theta, form) - mode.theta
    if mode.Z is not None:
        return mode.theta + np.minimum(way, np.log(RAISED))
    steps = np.linspace(1.0, 0.0, NOISES if way.any() else 1)
    value = settings.likelihood(data, form).value
    return max((mode.theta + step * way for step in steps), key=value)


def inducing_inputs(data, settings, form, mode):
    """Inducing inputs for the bound that is climbed from a mode.

    Parameters
    ----------
    data : Data
        Observations.
    settings : Settings
        Which inputs, how many, and the budget.
    form : FixedTaskCovariance, LowRank or WithDiagonal
        Form of K^rho.
    mode : Mode
        What was learned so far.

    Returns
    -------
    Z : ndarray of shape (n_inducing, n_features)
        The inputs.
    n_evaluations : int
        Bounds with their gradients that it took.
    """
    if settings.inducing_inputs != "optimised":
        return _chosen(data.X, settings, mode), 0
    Z = _chosen(data.X, settings, mode) if mode.Z is None else mode.Z
    data = replace(data, Z=Z)
    return optimised(
        settings.likelihood(data, form),
        begin_at(data, settings, form, mode),
        max_iter=min(MOST_MOVES, settings.max_iter),
        tol=settings.tol,
    )


def _chosen(X, settings, mode):
    """Rows of X or means of clusters of them, for k^x as learned."""
    kernel = settings.kernel.clone_with_theta(settings.split(mode.theta)[0])
    rng = np.random.RandomState(0)
    if settings.inducing_inputs == "k-means":
        X = k_means(X, settings.n_inducing, random_state=rng)
    return greedy_variance(kernel, X, settings.n_inducing, random_state=rng)
