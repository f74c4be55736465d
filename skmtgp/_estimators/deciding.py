"""In which units the targets are learned, and with which noise."""

from dataclasses import replace

import numpy as np

from skmtgp._estimators.units import Units, shared_units, units_of_tasks
from skmtgp._numerics.parallel import limit_threads
from skmtgp.learning.climbing import climb
from skmtgp.learning.screening import (
    differ_in_noise,
    differ_in_size,
    price,
    score,
    screen,
)
from skmtgp.learning.summarised import exact_part


def decide(model, training):
    """The training data with the units, and the noise, that are to be learned with.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters `normalize_y` and `noise` say which, or that the data do.
    training : Training
        Checked.

    Returns
    -------
    training : Training
        With `units` and `noise`.
    """
    noises = _noises(model, training)
    with limit_threads(len(training.Y)):
        units = _units(model, training)
    candidates = [replace(training, units=of, noise=noises[0]) for of in units]
    if len(candidates) == len(noises) == 1:
        return candidates[0]
    with limit_threads(len(training.Y)):
        found = [_screened(model, candidate, noises) for candidate in candidates]
    _, best, noise = max(found, key=lambda of: of[0])
    return replace(best, noise=noise)


def _units(model, training):
    """Units that may be taken; the first ones where there is nothing to decide."""
    Y, codes, n_tasks = training.Y, training.codes, len(training.tasks)
    if model.normalize_y == "per_task" and n_tasks > 1:
        return [units_of_tasks(Y, codes, n_tasks)]
    centred = bool(model.normalize_y)
    # without an amplitude in the model a scale changes it; otherwise, the path
    scaled = centred or model._learns_amplitude()
    shared = shared_units(Y, centred=centred, scaled=scaled)
    if model._has_levels() and scaled:
        shared = shared.without_levels(Y, codes, n_tasks)
    if model.normalize_y != "auto" or n_tasks == 1 or model.max_iter == 0:
        return [shared]
    of_tasks = units_of_tasks(Y, codes, n_tasks)
    asks = differ_in_size(of_tasks.scale, training.counts)
    return [shared, of_tasks] if asks else [shared]


def _noises(model, training):
    """Kinds of noise that may be taken."""
    if model.noise != "auto":
        return [model.noise]
    fixed = isinstance(model.noise_variance_bounds, str)
    if fixed or len(training.tasks) == 1 or model.max_iter == 0:
        return ["shared"]
    return ["shared", "per_task"]


def _screened(model, training, noises):
    """The score of the training data, they, and the noise that has it."""
    small = _without_levels(training) if model._has_levels() else training
    found = [screen(problem) for problem in _small(model, small)]
    best = _score(small, found), training, noises[0]
    if len(noises) > 1 and any(differ_in_noise(*of) for of in found):
        small = replace(small, noise=noises[1])
        found = [
            _with_noise(problem, *of)
            for problem, of in zip(_small(model, small), found, strict=True)
        ]
        best = max(
            best, (_score(small, found), training, noises[1]), key=lambda b: b[0]
        )
    return best


def _without_levels(training):
    """The training data, each task taken off its own mean.

    Levels have then the same prior in all units: how far apart they are says nothing of
    the units.
    """
    of_tasks = units_of_tasks(training.Y, training.codes, len(training.tasks))
    scale = np.broadcast_to(training.units.scale, of_tasks.scale.shape)
    return replace(training, units=Units(of_tasks.centre, scale))


def _small(model, training):
    """The problems of a model whose tasks tell each other nothing but k^x."""
    form = model._form_for_screening(len(training.tasks))
    problems = [of.with_form(form) for of in model._problems(training)]
    return exact_part(problems, [form])


def _with_noise(problem, other, mode):
    """The mode of a problem with noise for each task, from one with shared noise."""
    problem = problem.with_data(other.data)
    log_noise = other.prior.log_noise_at(mode.theta)[0]
    theta = problem.prior.theta(
        kernel=other.prior.values(mode.theta).kernel,
        K_rho=other.prior.K_rho_at(mode.theta),
        log_noise=log_noise,
    )
    return problem, climb(problem, theta, relaxed=True)


def _score(training, found):
    """Summed over the outputs."""
    n_constants = sum(len(np.unique(of)) - 1 for of in training.units.scale)
    if not found[0][0].prior.levels:  # else the means are those of a prior
        n_constants *= 2
    scores = [
        score(*of, scale) for of, scale in zip(found, training.units.scale, strict=True)
    ]
    return float(np.sum(scores)) - price(n_constants, len(found[0][0].data))
