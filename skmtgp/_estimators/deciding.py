"""In which units the targets are learned, and with which noise."""

from dataclasses import replace

import numpy as np

from skmtgp._estimators.units import shared_units, units_of_tasks
from skmtgp._numerics.parallel import limit_threads, run
from skmtgp.learning.nesting import nest
from skmtgp.learning.screening import (
    criterion,
    differ_in_noise,
    differ_in_size,
    leaves_noise,
    score,
    screen,
    tells_noise,
    with_own_noise,
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
    training = replace(training, noise=noises[0])
    candidates = [training.with_units(of) for of in units]
    if len(candidates) == len(noises) == 1:
        return candidates[0]
    with limit_threads(len(training.Y)):
        found = [_screened(model, candidate, noises) for candidate in candidates]
    _, best, noise = max(found, key=lambda of: of[0])
    return replace(best, noise=noise)


def _units(model, training):
    """Units that may be taken; the first ones where there is nothing to decide."""
    codes, n_tasks, known = training.codes, len(training.tasks), training.known
    if model.normalize_y == "per_task" and n_tasks > 1:
        return [units_of_tasks(training.unexplained(True), codes, n_tasks, known)]
    Y = training.unexplained(False)
    centred = bool(model.normalize_y)
    # without an amplitude in the model a scale changes it; otherwise, the path
    scaled = centred or model._learns_amplitude()
    shared = shared_units(Y, centred=centred, scaled=scaled, known=known)
    if model._has_levels() and scaled:
        shared = shared.without_levels(Y, codes, n_tasks, known)
    asks = model.normalize_y == "auto" and n_tasks > 1 and model.max_iter > 0
    if not asks or training.descriptors is not None:  # of which units do not follow
        return [shared]
    if training.slopes and training.slopes.place(True) is None:
        return [shared]  # means of tasks would leave nothing of some columns
    of_tasks = units_of_tasks(training.unexplained(True), codes, n_tasks, known)
    asks = differ_in_size(of_tasks.scale, training.measured)
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
    # how far apart levels are says nothing of units: they have the same prior in all
    small = training.without_levels() if model._has_levels() else training
    found = [screen(problem) for problem in _small(model, small)]
    best = _score(small, found), training, noises[0]
    if len(noises) > 1 and any(differ_in_noise(*of) for of in found):
        found = [with_own_noise(*of) for of in found]
        other = _score(small, found), training, noises[1]
        best = max(best, other, key=lambda of: of[0])
    return best


def _small(model, training):
    """The problems of a model whose tasks tell each other nothing but k^x."""
    form = model._form_for_screening(len(training.tasks))
    problems = [of.with_form(form) for of in model._problems(training)]
    return exact_part(problems, [form])


def _score(training, found):
    """Summed over the outputs."""
    pairs = zip(found, training.units.scale, strict=True)
    return float(sum(score(*of, scale) for of, scale in pairs))


def decide_noise(model, training, problems, modes):
    """What was learned, or the same with noise for each task if that is worth it.

    What the small model cannot tell from its functions, the large one may.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameter `noise` says whether to ask.
    training : Training
        As decided so far.
    problems : list of list of Problem
        For each form of K^rho, ascending, and each output.
    modes : list of list of Mode
        Their modes.

    Returns
    -------
    training, problems, modes
        With the noise that is chosen.
    """
    asks = len(_noises(model, training)) > 1 and training.noise == "shared"
    learned = all(mode.converged for of in modes for mode in of)
    if not (asks and learned and problems[0][0].engine.exact):
        return training, problems, modes
    before = _criteria(problems, modes)
    best = int(np.argmax(before))
    of_best = problems[best], modes[best]
    if not (all(map(leaves_noise, *of_best)) and any(map(differ_in_noise, *of_best))):
        return training, problems, modes
    others, learned = _with_own_noise(problems, modes, model.n_jobs)
    after = _criteria(others, learned)
    k = int(np.argmax(after))
    if after[k] > before[best] and all(map(tells_noise, others[k], learned[k])):
        return replace(training, noise="per_task"), others, learned
    return training, problems, modes


def _with_own_noise(problems, modes, n_jobs):
    """Problems and modes with noise for each task; values do not fall with the rank."""
    of_outputs = zip(*problems, strict=True), zip(*modes, strict=True)
    jobs = [(list(of), list(found)) for of, found in zip(*of_outputs, strict=True)]
    learned = run(_of_all_forms, jobs, n_jobs=n_jobs)
    return [list(zip(*of, strict=True)) for of in zip(*learned, strict=True)]


def _of_all_forms(problems, modes):
    found = [with_own_noise(*of) for of in zip(problems, modes, strict=True)]
    problems = [problem for problem, _ in found]
    return problems, nest(problems, [mode for _, mode in found])


def _criteria(problems, modes):
    """Of each form, summed over the outputs."""
    return np.array(
        [sum(map(criterion, *of)) for of in zip(problems, modes, strict=True)]
    )
