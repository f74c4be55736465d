"""What a user should know before learning begins, and what it leaves in doubt."""

from itertools import permutations

import numpy as np
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, Product

from skmtgp._data.checks import name_tasks
from skmtgp._data.dask import is_dask
from skmtgp._data.skewness import is_skewed, share_far
from skmtgp._estimators.units import count_tasks
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    AmbiguousFitWarning,
    ConstantTargetWarning,
    CorrelatedResidualsWarning,
    LongFitWarning,
    SkewedInputWarning,
    SmallTaskWarning,
)
from skmtgp.learning.ambiguity import doubt_about
from skmtgp.learning.neighbours import LARGE, correlated_share
from skmtgp.learning.settling import FEW

MUCH = 0.2  # of the range of an input, that is far from all rows
LONG = 120.0  # seconds of learning that a user wants to know of before


def warn_of_duration(learning, seconds):
    """Say that learning will take minutes, and what takes less."""
    if seconds < LONG:
        return
    minutes = seconds / 60.0
    about = f"{minutes:.0f} minutes" if minutes < 90 else f"{minutes / 60.0:.0f} hours"
    warn(
        f"{learning} very roughly {about} on one processor. inference='sparse' or "
        "fewer rows take less time.",
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
            warn(
                f"T{name_tasks(tasks[same])[1:]}: all targets{which} are equal: the "
                "standard deviations of predictions there mean nothing. Check y, or "
                "leave these rows out.",
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
        names = name_tasks(training.tasks[small])
        warn(
            f"T{names[1:]}: at most {FEW} rows. So few rows do not determine how a "
            "task is related to the others: its predictions may be off, and their "
            "intervals too narrow. hyperparameters='sampled' has wider ones. rank=0 "
            "with shared=True relates all tasks alike.",
            SmallTaskWarning,
        )


def warn_of_skew(problems, modes, names):
    """Say which inputs might better be logarithms.

    Parameters
    ----------
    problems, modes
        See `warn_of_doubts`.
    names : list of str or None
        Of the inputs.
    """
    skewed = set()
    for problem, mode in zip(problems, modes, strict=True):
        X, scales = problem.data.X, _length_scales(problem, mode)
        if scales is not None and mode.converged and not is_dask(X):
            skewed |= {
                k
                for k, (x, scale) in enumerate(
                    zip(np.asarray(X).T, scales, strict=True)
                )
                if is_skewed(x) and share_far(x, scale) > MUCH
            }
    for k in sorted(skewed):
        name = f"column {k} of the inputs" if names is None else repr(names[k])
        warn(
            f"Rows are dense at small values of {name} and sparse at large ones. The "
            f"length-scale follows the small ones. So more than {MUCH:.0%} of its "
            "range is farther than a length-scale from all rows, and predictions there "
            f"return to the mean. Try the logarithm of {name}.",
            SkewedInputWarning,
        )


def _length_scales(problem, mode):
    """Of each input; None where k^x has no such numbers, or a trend goes on."""
    prior = problem.prior
    if prior.n_terms > 1 or prior.trend is not None or not mode.n_iter:
        return None
    kernel = prior.kernel_at(mode.theta)
    if isinstance(kernel, Product):
        for amplitude, other in permutations((kernel.k1, kernel.k2)):
            kernel = other if isinstance(amplitude, ConstantKernel) else kernel
    if type(kernel) not in (RBF, Matern):
        return None
    return np.broadcast_to(kernel.length_scale, problem.data.X.shape[1])


def warn_of_doubts(problems, modes, *, sampled=False):
    """Say what the modes that were learned leave in doubt.

    Parameters
    ----------
    problems : sequence of Problem
        Of each output.
    modes : sequence of Mode
        Their modes.
    sampled : bool, default=False
        Whether predictions average over draws, which are of other modes too.
    """
    for problem, mode in zip(problems, modes, strict=True):
        if mode.n_iter and mode.converged and not is_dask(problem.data.X):
            _warn_of_neighbours(problem, mode)
            if not sampled:
                _warn_of_rivals(problem, mode)


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
            "smooth, or the tasks less alike than the model assumes.",
            CorrelatedResidualsWarning,
        )


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
