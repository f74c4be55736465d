"""Which other model is likelier than the one that was learned, and its parameters."""

from operator import itemgetter

import numpy as np

from skmtgp._data.labels import name_input
from skmtgp._estimators.forms import diagonal_of
from skmtgp._estimators.named_kernels import DEFAULT, LINEAR, named_kernel
from skmtgp._support.guide import FORECASTS
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    RowEffectsWarning,
    SeveralKernelsWarning,
    UnrelatedTasksWarning,
)
from skmtgp.learning.common_function import NOT_ASKED, common_function
from skmtgp.learning.own_kernels import gain_of_own_kernels, ranks_of_two
from skmtgp.learning.repeating import (
    NO_PERIOD,
    SHAPES,
    function_that_repeats,
)
from skmtgp.learning.row_effects import effects_of_rows
from skmtgp.learning.separate import gain_of_separate_models

TELLING = 10.0  # nats of BIC that another model must gain to be told of


def warn_of_others(training, problem, mode, names, compared, one_kernel):
    """Say which other model is likelier: one of each task, or one of two kernels.

    Parameters
    ----------
    training : Training
        What was learned from.
    problem : Problem
        Of an output.
    mode : Mode
        Its mode.
    names : list of str or None
        Of the inputs.
    compared : bool
        Whether models of each task were compared with the one that was learned.
    one_kernel : bool
        Whether the user has chosen the kernel, or what takes no second one.
    """
    if not one_kernel and _warn_of_rows(training, problem, mode):
        return
    apart, repeats = -np.inf, NO_PERIOD
    common, two = NOT_ASKED, (-np.inf, None)
    if mode.converged and not compared:
        apart = gain_of_separate_models(problem, mode)
    if not one_kernel:
        repeats = function_that_repeats(problem, mode, TELLING)
    if repeats.gain > TELLING:  # others that are likelier may follow what repeats
        _tell_repeating(training, problem, mode, names, repeats)
        return
    if not one_kernel:
        common = common_function(problem, mode, max(TELLING, apart))
        two = _two_kernels(training, problem, mode, max(TELLING, apart, common.gain))
    if common.gain > max(TELLING, apart, two[0]):
        _tell_common_function(training, problem, mode, names, common)
    elif two[0] > max(TELLING, apart):
        _tell_own_kernels(training, problem, mode, *two)
    elif apart > TELLING:
        warn(
            f"No two tasks of {problem.name} are closely related, and a model of each "
            f"task by itself is likelier by {apart:.0f} nats (BIC). One kernel does "
            "not suit all tasks: their functions may depend on different inputs, or "
            "some may vary faster than others. RankSearchIC compares both models, and "
            "SingleTaskGP learns each task by itself.",
            UnrelatedTasksWarning,
        )


def _warn_of_rows(training, problem, mode):
    """Say if rows have effects of their own; whether it was said."""
    X, alike = problem.data.X, training.alike
    kernels = (named_kernel(name, X, alike=alike) for name in (DEFAULT, LINEAR))
    found = effects_of_rows(problem, mode, *kernels)
    told = found is not None and found.gain > TELLING and found.clear
    if told:
        first = LINEAR if found.straight else None
        kernel = f"[{first!r}, RBF({found.length_scale!r}, 'fixed')]"
        rest = _named(training, rank=found.ranks)
        warn(
            f"Rows of {problem.name} have effects of their own, which the tasks share "
            "and inputs do not tell, as those of patients or places where each has a "
            "row of a table. The kernel took them for a rough function of the inputs, "
            "so predictions of new rows are poor. With a second kernel for them the "
            f"model is likelier by {found.gain:.0f} nats (BIC), and the mean squared "
            f"error at rows that are left out is {1.0 - found.ratio:.0%} lower. Try "
            f"MultiTaskGPRegressor(kernel={kernel}, {rest}), with RBF of "
            "sklearn.gaussian_process.kernels, in the WideRegressor or pipeline if "
            "there is one. This takes longer.",
            RowEffectsWarning,
        )
    return told


def _named(training, **options):
    """Parameters in words, with the units and the noise of this fit."""
    options |= {"noise": training.noise, "normalize_y": training.units.name}
    return ", ".join(f"{key}={value!r}" for key, value in options.items())


def _two_kernels(training, problem, mode, enough):
    """Nats that two kernels gain, and which: as rough as the one, or smooth.

    Two smooth functions that vary at different speeds are a rough one to one kernel.
    """
    kernel = _kernel_in_lists(training, problem, mode)
    gain = gain_of_own_kernels(problem, mode, enough)
    if gain > enough or training.kernel == DEFAULT:
        return gain, kernel
    smooth = named_kernel(DEFAULT, problem.data.X, alike=training.alike)
    of_smooth = gain_of_own_kernels(problem, mode, enough, kernel=smooth)
    smooth = smooth if training.alike else None
    return max((gain, kernel), (of_smooth, smooth), key=itemgetter(0))


def _tell_own_kernels(training, problem, mode, gain, kernel):
    """Say which parameters give two kernels, beside the units and noise of this fit."""
    named = _named(training, kernel=[kernel] * 2, rank=ranks_of_two(problem, mode))
    warn(
        f"Two kernels for {problem.name} are likelier than one, by {gain:.0f} nats "
        "(BIC): functions that the tasks share vary at different speeds, or depend "
        "on different inputs. "
        f"Try MultiTaskGPRegressor({named}). This takes longer. Keep your other "
        "parameters.",
        SeveralKernelsWarning,
    )


def _tell_common_function(training, problem, mode, names, found):
    """The same of a second kernel, for a function of one input."""
    form, j = problem.prior.task_covariance, found.feature
    first, second = _kernel_in_lists(training, problem, mode), found.kernel
    least, most = second.length_scale_bounds
    scale = np.clip(second.length_scale, 2.0 * least, 0.5 * most)  # before rounding
    of_input = f"Matern({scale:.2g}, ({least:.1g}, {most:.1g}), nu=1.5)"
    column = j if names is None else names[j]
    kernel = f"[{first!r}, Columns({of_input}, [{column!r}])]"
    diagonal = [diagonal_of(form), False]
    several = {"rank": [form.rank, 0], "shared": [form.shared, True]}
    rest = _named(training, **several, diagonal=diagonal)
    warn(
        f"All tasks of {problem.name} share a function of {name_input(j, names)} "
        "alone, as the shocks of a year that all countries feel. One kernel of all "
        "inputs cannot tell it. With a second one the model is likelier by "
        f"{found.gain:.0f} nats (BIC). Try MultiTaskGPRegressor(kernel={kernel}, "
        f"{rest}), with Columns of skmtgp.kernels and Matern of "
        "sklearn.gaussian_process.kernels. Keep your other parameters.",
        SeveralKernelsWarning,
    )


def _tell_repeating(training, problem, mode, names, found):
    """The same of a second kernel, for a function that repeats in one input.

    Both begin as they were learned, as no climb leads to a period from far away.
    """
    form, j = problem.prior.task_covariance, found.feature
    shape, period = found.kernel.length_scale, found.kernel.periodicity
    periodic = f"ExpSineSquared({shape:.2g}, {period:.6g}, {SHAPES}, 'fixed')"
    column = j if names is None else names[j]
    kernel = f"[{_begun_at(found.others)}, Columns({periodic}, [{column!r}])]"
    several = {"rank": [form.rank, 0 if found.shared else 1]}
    if form.shared or found.shared:
        several["shared"] = [form.shared, found.shared]
    if diagonal_of(form):
        several["diagonal"] = [diagonal_of(form), False]
    name = type(found.others).__name__
    warn(
        f"The targets of {problem.name} seem to repeat in {name_input(j, names)}, "
        f"every {period:.4g}. The kernel follows that from row to row, but does not go "
        "on with it where there are no rows, as in forecasts and gaps. With a second "
        f"kernel that has a period the model is likelier by {found.gain:.0f} nats "
        f"(BIC). Try MultiTaskGPRegressor(kernel={kernel}, "
        f"{_named(training, **several)}), with Columns of skmtgp.kernels, and "
        f"ExpSineSquared and {name} of sklearn.gaussian_process.kernels. If you know "
        f"the period, give that. Keep your other parameters. {FORECASTS}",
        SeveralKernelsWarning,
    )


def _begun_at(kernel):
    """A smooth kernel that begins at its length-scales, in words."""
    bounds = np.atleast_2d(kernel.length_scale_bounds)
    least, most = bounds[:, 0].min(), bounds[:, 1].max()
    scales = np.clip(kernel.length_scale, 1.1 * least, 0.9 * most)  # before rounding
    scales = ", ".join(f"{scale:.2g}" for scale in np.atleast_1d(scales))
    scales = f"[{scales}]" if np.ndim(kernel.length_scale) else scales
    nu = f", nu={kernel.nu}" if hasattr(kernel, "nu") else ""
    return f"{type(kernel).__name__}({scales}, ({least:.1g}, {most:.1g}){nu})"


def _kernel_in_lists(training, problem, mode):
    """The kernel of this fit as an element of a list of kernels."""
    if training.alike:  # names give each column a length-scale
        return problem.prior.kernel_at(mode.theta)
    return None if training.kernel == DEFAULT else training.kernel
