"""What a user should know before learning begins, and what it leaves in doubt."""

import numpy as np

from skmtgp._data.complete import count_places
from skmtgp._data.dask import is_dask
from skmtgp._data.labels import name_tasks
from skmtgp._data.outliers import far_off, warn_of_unforeseen
from skmtgp._estimators.many_columns import are_alike, columns_are_many
from skmtgp._estimators.other_models import warn_of_others
from skmtgp._estimators.targets import AS_GIVEN
from skmtgp._estimators.units import count_tasks, units_of_tasks
from skmtgp._support.guide import NOISE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    AmbiguousFitWarning,
    ConstantTargetWarning,
    CorrelatedResidualsWarning,
    LongFitWarning,
    NarrowIntervalsWarning,
    SmallTaskWarning,
    TargetScaleWarning,
    UnidentifiedNoiseWarning,
)
from skmtgp.learning.ambiguity import doubt_about
from skmtgp.learning.jackknife import MOST_COORDINATES
from skmtgp.learning.neighbours import LARGE, correlated_share
from skmtgp.learning.settling import FEW
from skmtgp.learning.transformed import SURE, likelier_scale
from skmtgp.learning.unforeseen import unforeseen

OTHER_UNIT = 5.0  # times the deviation of another task, so that it may have one
LONG = 120.0  # seconds of learning that a user wants to know of before
MOST_DRAWN = 2000  # rows of sparse inference, of which draws take hours
# For each hyperparameter: with fewer rows intervals are too narrow, where variances
# count that hyperparameters were learned from them, and where they do not.
ENOUGH_ROWS_EACH, ENOUGH_IF_KNOWN = 4, 8


def warn_of_duration(learning, seconds, less="inference='sparse' or fewer rows"):
    """Say that learning will take minutes, and what takes less."""
    if seconds < LONG:
        return
    minutes = seconds / 60.0
    about = f"{minutes:.0f} minutes" if minutes < 90 else f"{minutes / 60.0:.0f} hours"
    warn(
        f"{learning} very roughly {about} on one processor. {less} take less time.",
        LongFitWarning,
    )


def warn_of_constants_alone(tasks, constant):
    """Say which tasks, each learned alone, have targets that do not vary.

    Parameters
    ----------
    tasks : ndarray of shape (n_tasks,)
        Labels.
    constant : ndarray of bool of shape (n_tasks, n_outputs)
        Whether each has the same y in all rows.
    """
    for j, same in enumerate(constant.T, 1):
        if same.any():
            which = f" of output {j}" * (constant.shape[1] > 1)
            names = name_tasks(tasks[same], begins=True)
            warn(
                f"{names}: all targets{which} are equal: the standard deviations of "
                "predictions there mean nothing. Check y, or leave these rows out.",
                ConstantTargetWarning,
            )


def warn_of_small_tasks(training, form):
    """Say which tasks have too few rows to be related to the others by likelihood.

    Parameters
    ----------
    training : Training
        What was learned from.
    form : task covariance
        K^rho.
    """
    if training.descriptors is not None or not np.any(getattr(form, "rank", 0)):
        return
    n_rows = count_tasks(training.codes, len(training.tasks), training.known)
    small = n_rows <= FEW
    if small.any() and not small.all():
        names = name_tasks(training.tasks[small], begins=True)
        warn(
            f"{names}: at most {FEW} rows. So few rows do not determine how a "
            "task is related to the others: its predictions may be off, and their "
            "intervals too narrow. hyperparameters='sampled' has wider ones. rank=0 "
            "with shared=True relates all tasks alike.",
            SmallTaskWarning,
        )


def warn_of_few_rows(problem, way, *, given=False, counted=True):
    """Say that rows are too few to take the hyperparameters for certain.

    Repeats of a row tell the noise alone, so they do not count. Noise variances of
    tasks, which have a common prior, count as one hyperparameter.

    Parameters
    ----------
    problem : Problem
        What was learned.
    way : {"mode", "map", "laplace", "sampled"}
        Which hyperparameters predict.
    given : bool, default=False
        Whether the user chose k^x, one for all tasks.
    counted : bool, default=True
        Whether variances count that hyperparameters were learned, where they can.
    """
    if way == "sampled":
        return
    prior, data = problem.prior, problem.data
    counted = counted and prior.n_terms == 1 and not is_dask(data.X)
    counted = counted and prior.n_hyperparameters <= MOST_COORDINATES
    enough = ENOUGH_ROWS_EACH if counted else ENOUGH_IF_KNOWN
    n_noise = 0 if prior.noise_is_fixed else prior.n_noise
    n_each, stay = prior.n_hyperparameters - max(n_noise - 1, 0), is_dask(data.X)
    n_rows = len(data) if stay else count_places(data.X, data.tasks)
    if n_rows >= enough * n_each:
        return
    draws = "'auto'" if way != "laplace" and problem.engine.exact else "'sampled'"
    helps = f"hyperparameters={draws}, which takes longer, or more rows"
    helps = f"one kernel with {helps}" if prior.n_terms > 1 else helps
    if not (stay or problem.engine.exact) and len(data) > MOST_DRAWN:
        helps = "more rows, or fewer hyperparameters: a lower rank or fewer columns"
    warn(
        f"There are fewer than {enough} rows for each hyperparameter. They leave the "
        "hyperparameters more uncertain than predictions count: a 95 % interval may "
        f"hold only {'80 to 93' if counted else '50 to 90'} % of new observations, and "
        "less where there is almost no noise. This helps: "
        f"{'more rows' if stay else helps}.{_fewer_numbers(prior, data)}"
        f"{_fewer_length_scales(problem, given)}",
        NarrowIntervalsWarning,
    )


def _fewer_numbers(prior, data):
    """What to try where tasks are related by numbers of each."""
    if prior.n_terms > 1 or data.Q is not None:
        return ""
    if not getattr(prior.task_covariance, "rank", 0):
        return ""
    return (
        " rank=0 with shared=True and diagonal='equal' relates all tasks alike, by two "
        "hyperparameters: compare it at rows that are left out."
    )


def _fewer_length_scales(problem, given):
    """What to do where k^x has many numbers for the rows: chosen, or in other units."""
    X, n_tasks = problem.data.X, problem.data.n_tasks
    each = problem.prior.kernel.n_dims >= X.shape[1]
    if not (each and columns_are_many(X, n_tasks)):
        return ""
    if not given and are_alike(X):  # it was compared
        return ""
    if not given:
        return (
            " Columns are many, and in different units. Scale them, for example by "
            "StandardScaler: then one length-scale for all of them is tried, too."
        )
    return (
        " The kernel has a number for each column. One length-scale for all columns "
        "suits spectra: kernel=Matern(1.0, nu=2.5). The default, kernel=None, compares."
    )


def warn_of_doubts(
    training,
    problems,
    modes,
    *,
    names=None,
    sampled=False,
    compared=False,
    one_kernel=False,
):
    """Say what the modes that were learned leave in doubt.

    Parameters
    ----------
    training : Training
        What was learned from.
    problems : sequence of Problem
        Of each output.
    modes : sequence of Mode
        Their modes.
    names : list of str, default=None
        Of the inputs.
    sampled : bool, default=False
        Whether predictions average over draws, which are of other modes too.
    compared : bool, default=False
        Whether models of each task were compared with the one that was learned.
    one_kernel : bool, default=False
        Whether the user has chosen the kernel, or what takes no second one.
    """
    for j, (problem, mode) in enumerate(zip(problems, modes, strict=True)):
        if not mode.n_iter or is_dask(problem.data.X):
            continue
        ended = mode.converged or mode.stalled
        told = ended and _warn_of_scale(training, problem, mode, j)
        if ended and not told:
            _warn_of_unforeseen(training, problem, mode, j)
        if mode.converged:
            if not told:  # what grows with the targets looks correlated where these do
                _warn_of_neighbours(problem, mode)
            if not sampled:
                _warn_of_rivals(problem, mode)
        if ended:
            warn_of_others(training, problem, mode, names, compared, one_kernel)


def _warn_of_scale(training, problem, mode, j):
    """Say if an output might better be on another scale; whether it was said.

    Where noise is known, or the user has chosen a scale or a trend, it is not asked.
    Nor is it of two values, which are as far apart on any scale.
    """
    given = training.known is not None or training.trends is not None
    given |= problem.prior.noise_is_fixed or training.target is not AS_GIVEN
    if given or training.binary[j]:
        return False
    data, y = problem.data, training.targets(problem.engine)[:, j]
    groups = data.tasks if training.units.own_centres else np.zeros(len(y), dtype=int)
    scale = likelier_scale(problem, mode, y, groups)
    if scale:
        warn(
            f"{_of_units(training, problem, j)}The targets of {problem.name} are never "
            f"negative, and likelier by more than {SURE:.0f} nats on another scale: "
            "noise or functions grow with them. So intervals may be too narrow where "
            "targets are large and too wide where they are small. Try "
            f"target_transform={scale}. Then `predict` gives medians, in units of y, "
            "and their sums are too low. If you need means or "
            "sums, take sample_y(X, 1000, include_noise=True).mean(axis=-1).",
            TargetScaleWarning,
        )
    return bool(scale)


def _of_units(training, problem, j):
    """What to try before another scale, where tasks may be in different units."""
    scales = units_of_tasks(training.Y, training.codes, len(training.tasks)).scale[j]
    ratio = scales.max() / scales.min()
    if training.units.own_scales or ratio < OTHER_UNIT:
        return ""
    return (
        f"The targets of {problem.name} vary up to {ratio:.0f} times as much in one "
        "task as in another. Are the tasks in different units? Then set "
        "normalize_y='per_task', and fit again. Otherwise read on. "
    )


def _warn_of_unforeseen(training, problem, mode, j):
    """Say which rows are outliers, but for those that were told before learning."""
    rows, sizes = unforeseen(problem, mode)
    if not len(rows):
        return
    order = np.arange(len(training.Y))[training.order(problem.engine)][rows]
    new = ~far_off(training.unexplained(False), training.codes)[order, j]
    if new.any():
        order, sizes = order[new], sizes[new]
        values = training.target.back(training.Y)[order, j]
        of_rows = training.codes[order], training.tasks
        transformed = training.target is not AS_GIVEN
        warn_of_unforeseen(
            values, *of_rows, sizes, problem.name, transformed=transformed
        )


def _warn_of_neighbours(problem, mode):
    if correlated_share(problem, mode):
        warn(
            f"The noise of {problem.name} is correlated between neighbouring rows, in "
            f"the order of the rows in fit: more than {LARGE} of its variance is "
            "correlated. Learning assumes independent noise. So standard deviations "
            "are too small, and scores of random folds, or of leaving out one row, are "
            "too good. If the rows are a time series: cross-validate with "
            "TaskStratifiedGroupKFold and stretches of rows as groups, choose a higher "
            "lower bound in noise_variance_bounds by these folds, or fit fewer rows, "
            "farther apart. If the rows are sorted by an input: the kernel may be too "
            "smooth, or the tasks less alike than the model assumes."
            f"{_higher(problem)}",
            CorrelatedResidualsWarning,
        )


def _higher(problem):
    """What to try where tasks may have more functions in common."""
    data, terms = problem.data, problem.prior.terms
    rank = getattr(terms[0][1], "rank", None)
    if rank is None or len(terms) > 1 or data.Q is not None or rank >= data.n_tasks:
        return ""
    return f" Then try a higher rank: rank={rank + 1}."


def _warn_of_rivals(problem, mode):
    doubt = doubt_about(problem, mode) if problem.engine.exact else None
    if doubt:
        # more, where that is too little to take another one
        more = "less" if doubt.nats >= 0.0 else "more"
        nats = f"{abs(doubt.nats):.1f} nats {more} likely than"
        if nats.startswith("0.0"):
            nats = "as likely as"
        warn(
            f"Another mode of {problem.name} is {nats} the one that was learned, and "
            "predicts differently. The root mean square difference is "
            f"{doubt.apart:.1f} standard deviations of the targets within tasks, and "
            "more than two standard deviations of either prediction. The rows do not "
            "tell which mode is right. hyperparameters='sampled' averages over both. "
            "More rows can decide; so can narrower bounds of the kernel or of the "
            "noise, or a lower rank of a MultiTaskGPRegressor, whose "
            "n_restarts_optimizer also searches for a still better mode.",
            AmbiguousFitWarning,
        )


def warn_of_noise(told, tasks=None, lower=""):
    """Say which noise variances were learned from next to nothing.

    Parameters
    ----------
    told : ndarray of bool of shape (n_outputs, n_noise)
        Whether the rows tell each.
    tasks : ndarray of shape (n_noise,), default=None
        Labels of the tasks, if they have one each.
    lower : str, default=""
        A lower rank, in words; none without one.
    """
    if told.all():
        return
    outputs, unknown = np.flatnonzero(~told.all(axis=1)) + 1, ~told.all(axis=0)
    which = f" of output {outputs.tolist()}" * (len(told) > 1)
    same = ""
    if tasks is not None:
        which += f" of {name_tasks(tasks[unknown])}"
        same = "set noise='shared' if all tasks are measured with the same precision, "
    warn(
        f"The rows do not tell the noise variance{which}: the model follows them so "
        "closely that a variance many times as large would be as likely. The learned "
        "variance may be far too small, and so may the standard deviations of "
        f"predictions. Give more rows, {same}{lower and f'choose {lower}, '}raise the "
        "lower bound in noise_variance_bounds, a share of the variance of y, or fix "
        f"the noise variance if you know it. {NOISE}",
        UnidentifiedNoiseWarning,
    )
