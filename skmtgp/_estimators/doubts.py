"""What a user should know before learning begins, and what it leaves in doubt."""

from skmtgp._data.dask import is_dask
from skmtgp._support.warnings import warn
from skmtgp.exceptions import (
    AmbiguousFitWarning,
    CorrelatedResidualsWarning,
    LongFitWarning,
)
from skmtgp.learning.ambiguity import doubt_about
from skmtgp.learning.neighbours import LARGE, correlated_share

LONG = 120.0  # seconds of learning that a user wants to know of before


def warn_of_duration(learning, seconds):
    """Say that learning will take minutes, and what takes less."""
    if seconds < LONG:
        return
    minutes = seconds / 60.0
    about = f"{minutes:.0f} minutes" if minutes < 90 else f"{minutes / 60.0:.0f} hours"
    warn(
        f"{learning} very roughly {about} on one processor. inference='sparse' takes "
        "less, and so do fewer rows.",
        LongFitWarning,
    )


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
            f"the order that fit was given: more than {LARGE} of its variance is. "
            "Learning takes it for independent and a part of it for a function of the "
            "inputs: standard deviations are too small, and scores of random folds or "
            "of leaving out one row too good. Rows of a time series: cross-validate "
            "with TaskStratifiedGroupKFold, stretches of rows as groups, choose a "
            "higher lower bound in noise_variance_bounds by it, or fit fewer rows, "
            "farther apart. Rows sorted by an input: k^x may be too smooth, or tasks "
            "more alike in the model than they are.",
            CorrelatedResidualsWarning,
        )


def _warn_of_rivals(problem, mode):
    doubt = doubt_about(problem, mode) if problem.engine.exact else None
    if doubt:
        # more, where that is too little to take another one
        nats = f"{abs(doubt.nats):.1f} nats {'less' if doubt.nats >= 0.0 else 'more'}"
        warn(
            f"Another mode of {problem.name} is {nats} likely than the one that was "
            "learned, and predicts differently: by "
            f"{doubt.apart:.1f} deviations of the targets within tasks, in the root "
            "mean square, and by more than two standard deviations of either. The rows "
            "do not tell which is right. hyperparameters='sampled' averages over both. "
            "More rows tell, and narrower bounds of the kernel or of the noise may. So "
            "may a lower rank of a MultiTaskGPRegressor, whose n_restarts_optimizer "
            "looks for a better mode still.",
            AmbiguousFitWarning,
        )
