"""What is to be learned: the prior of the training data, and an engine for it."""

from dataclasses import replace
from numbers import Real

import numpy as np
from sklearn.base import clone

from skmtgp._estimators.named_kernels import DEFAULT, with_positions
from skmtgp._estimators.reading import names_of_inputs
from skmtgp._estimators.sampled import n_posteriors
from skmtgp._estimators.units import deviation_within, variance_of_means
from skmtgp._numerics.parallel import at_a_time
from skmtgp.inference.engine import Demand, check_known, check_terms, check_trend
from skmtgp.inference.engines import choose
from skmtgp.inference.memory import TileMemory
from skmtgp.learning.penalised import may_vanish
from skmtgp.learning.periods import begun_in_time
from skmtgp.learning.problem import THE_OUTPUT, Problem
from skmtgp.learning.ranges import begun_in_sight
from skmtgp.model.kernel_check import check_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import identity, low_rank

FIRST_LEVEL = 1e-2  # where learning of the levels' variance starts, of the targets'
# Its least where each task was taken off its own mean: learned from such targets it
# would be zero, as if the means were known. This is the prior of unit information.
CENTRED = 1.0
ROUNDING = 1e-15  # of the mean of equal numbers, relative to them
LITTLE = 1e-2  # noise variance of the targets', less than which few rows do not tell
NO_NOISE = 1e-200  # in place of a noise variance of 0, whose logarithm is none


def pose(model, training, n_ranks=1, n_kept=1, *, told=True):
    """What is learned for each output.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters say by which model.
    training : Training
        From what.
    n_ranks, n_kept : int, default=1
        How many models, by the rank, are learned, and how many of them are kept.
    told : bool, default=True
        Whether `verbose` says where learning begins: not of models for screening.

    Returns
    -------
    problems : list of n_outputs Problem
        Their K^rho is I until its form is known.

    Raises
    ------
    ValueError
        If a parameter cannot be used, or not with these data.
    InsufficientMemoryError
        If memory is too small.
    """
    kernels, n_tasks = kernels_of(model, training), len(training.tasks)
    prior = _prior(model, training, kernels, low_rank(n_tasks, 0))  # without a matrix
    engine = choose(model.inference, prior, training, **model._options())
    _check_engine(model, engine, prior, training)
    _check_memory(model, engine, prior, training, n_ranks, n_kept)
    prior = _prior(model, training, kernels, identity(n_tasks))
    of_outputs = training.data(engine)
    engine.check(prior, of_outputs[0], training.tasks)
    n, budget, problems = len(of_outputs), model._budget(), []
    for j, data in enumerate(of_outputs):
        scaled = _scaled(model, prior, data, training, j)
        problem = Problem(
            scaled,
            data=data,
            engine=engine,
            budget=budget,
            name=f"output {j + 1} of {n}" if n > 1 else THE_OUTPUT,
            weak_priors=model.hyperparameters == "map",
            log_little=_log_little(model, scaled),
            unbounded=model._some_noise() and may_vanish(scaled),
            noise_deviation=model._noise_deviation(),
            log_scales=np.log(training.units.scale[j]),
            noisy=training.noisy,
        )
        problems.append(begun_in_time(begun_in_sight(problem), told))
    return problems


def kernels_of(model, training):
    """k^x of each term with its starting values, checked."""
    features = training.features
    kernels = [
        kernel_made(model, kernel, features, training.kernel, alike=training.alike)
        for kernel in model._kernels()
    ]
    for kernel in kernels:
        check_kernel(kernel, features)
    return kernels


def kernel_made(model, kernel, features, default=DEFAULT, *, alike=False):
    """A kernel as the user gave it, or that of the name, or of the default's."""
    if kernel is None or isinstance(kernel, str):
        return model._named_kernel(kernel or default, features, alike=alike)
    return with_positions(clone(kernel), lambda: names_of_inputs(model))


def _prior(model, training, kernels, of_tasks):
    """The model, with the same form of K^rho in all terms until it is known."""
    n_tasks = len(training.tasks)
    prior = Prior(
        kernels[0],
        of_tasks,
        n_noise=n_tasks if training.noise == "per_task" else 1,
        levels=model._has_levels() and not training.has_constants,
        noise_is_fixed=isinstance(model.noise_variance_bounds, str),
        trend=training.trends and training.trends[0],
    )
    return prior.with_terms([(kernel, of_tasks) for kernel in kernels])


def _check_engine(model, engine, prior, training):
    """Whether the engine, and draws of hyperparameters, take the model and the data."""
    check_terms(engine, prior)
    check_trend(engine, prior)
    check_known(engine, prior, training.known, training.features)
    if model.hyperparameters in ("laplace", "sampled") and prior.n_terms > 1:
        raise ValueError(
            f"hyperparameters={model.hyperparameters!r} takes one term K^rho x k^x, "
            f"but kernel is a list of {prior.n_terms} kernels. Set "
            "hyperparameters='map' or 'mode', or give one kernel."
        )


def _scaled(model, prior, data, training, j):
    """The prior of an output, with starts and bounds relative to its targets."""
    deviation, scale = data.deviation, data.size or 1.0
    if deviation < ROUNDING * scale:  # constant targets
        deviation = 1.0
    start, bounds = model.noise_variance, _noise_bounds(model, data.known)
    start = max(start, NO_NOISE)
    bounds = (start,) * 2 if isinstance(bounds, str) else bounds
    noises = np.multiply([start, *bounds], deviation**2)
    noises[:2] = np.maximum(noises[:2], _least_noise(training, j))
    log_noise, *log_noise_bounds = np.log(noises).tolist()
    least = CENTRED if training.units.own_scales else prior.least_level
    level, within = max(least, FIRST_LEVEL) * scale**2, np.inf
    if prior.levels:
        of_rows = data.y, data.tasks, data.n_tasks, data.known
        level = max(level, variance_of_means(*of_rows))
        within = deviation_within(*of_rows)
    return replace(
        prior,
        scale=scale,
        within=within if within > ROUNDING * scale else np.inf,
        log_noise=log_noise,
        log_noise_bounds=tuple(log_noise_bounds),
        log_level=float(np.log(level)),
        least_level=least,
        trend=training.trends and training.trends[j],
    )


def _least_noise(training, j):
    """Noise variance that an output has at least, in the unit of the largest task."""
    if training.least_noise is None:
        return 0.0
    return training.least_noise[j] / np.max(training.units.scale[j]) ** 2


def _log_little(model, prior):
    """Logarithm of the noise variance below which less is unlikely; -inf is none."""
    if not model._some_noise():
        return -np.inf
    start = max(model.noise_variance, NO_NOISE)
    return prior.log_noise + min(0.0, np.log(LITTLE / start))  # not above the start


def _check_memory(model, engine, prior, training, n_ranks, n_kept):
    """Whether memory suffices."""
    (n, n_outputs), n_tasks = training.Y.shape, len(training.tasks)
    climbs = n_outputs * model._n_climbs(n_ranks)
    rank = model._rank(n_tasks, n, engine)
    demand = Demand(
        n,
        n_tasks,
        rank=rank,
        n_kept=n_outputs * n_kept * n_posteriors(model, n),
        n_climbs=at_a_time(model.n_jobs, climbs if engine.exact else n_outputs),
        n_exact_climbs=at_a_time(model.n_jobs, climbs),
        n_parameters=n_tasks * rank,
        n_missing=training.n_missing if engine.uses_design else 0,
        n_coefficients=prior.n_coefficients,
    )
    x = np.asarray(training.features[:1])
    engine.check_memory(demand, TileMemory(prior.kernel, x))


def _noise_bounds(model, known):
    start, bounds = model.noise_variance, model.noise_variance_bounds
    told = known is not None and known.variance.min() > 0.0
    if start == 0.0 and not (told and isinstance(bounds, str)):
        raise ValueError(
            "noise_variance=0 leaves the noise to alpha: it needs "
            "noise_variance_bounds='fixed', and an alpha above 0 for each row. "
            "Otherwise give a small positive number."
        )
    if isinstance(bounds, str):
        return bounds
    pair = np.asarray(bounds, dtype=object)
    if not _is_range(pair):
        raise ValueError(
            f"noise_variance_bounds={bounds!r} must be a pair of positive numbers, the "
            "smaller one first, or 'fixed'."
        )
    if not pair[0] <= start <= pair[1]:
        raise ValueError(
            f"noise_variance={start} is outside noise_variance_bounds={bounds!r}: it "
            "is where learning starts. Give one between them."
        )
    return pair.astype(np.float64)


def _is_range(bounds):
    """Whether these are two positive numbers, the smaller one first."""
    if bounds.shape != (2,) or not all(isinstance(bound, Real) for bound in bounds):
        return False
    return bool(0.0 < bounds[0] <= bounds[1] < np.inf)
