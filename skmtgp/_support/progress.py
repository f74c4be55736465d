"""What a long fit tells while it goes on: lines, and scikit-learn's callbacks."""

from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from time import time

from skmtgp._support.sklearn_compat import begin_callbacks

# A process has one connection to a progress bar, whose messages threads would mix.
_TELLING = Lock()
_PART = ContextVar("part", default="")
SILENCE = 5.0  # seconds after which a fit that prints lines says how far it is
_last = 0.0  # when a line was printed, by any fit of this process


@contextmanager
def fitting(estimator, X, y, *, verbose=0):
    """Context of a fit, which gives what reports its progress.

    An exception leaves the estimator as it was before. The callbacks of the estimator
    are told that the fit begins, what is done of it, and that it has ended.

    Parameters
    ----------
    estimator : estimator
        Being fitted, by a method with the decorator `with_callbacks`.
    X, y : array-like
        Training data, for the callbacks.
    verbose : int, default=0
        Whether to print lines.

    Yields
    ------
    progress : callable
        ``progress(stage, n_jobs, describe)`` gives what is to be called with the
        position and the result of each job of a stage when it is done, or None if
        nobody listens. ``describe(position, result)`` is the line that is printed, or
        None.
    """
    with _TELLING:
        context = begin_callbacks(estimator, X, y)
    before = vars(estimator).copy()
    try:
        yield _reporter(estimator, context, verbose)
        if context:
            with _TELLING:
                context.call_on_fit_task_end(
                    estimator=estimator, X=X, y=y, reconstruction_attributes={}
                )
    except BaseException:
        vars(estimator).clear()
        vars(estimator).update(before)
        raise


def say(line):
    """Print a line of a fit."""
    global _last
    _last = time()
    print(f"[skmtgp] {_PART.get()}{line}", flush=True)


def is_due(since):
    """Whether nothing was said for some seconds, since a time at the earliest."""
    return time() - max(_last, since) >= SILENCE


@contextmanager
def part(name):
    """Context of a fit within another one, whose name begins its lines.

    What is done of it the other one says.
    """
    token = _PART.set(f"{name}, ")
    try:
        yield
    finally:
        _PART.reset(token)


def silent(stage, n_jobs, describe):
    """Progress that nobody listens to."""


def _reporter(estimator, context, verbose):
    if not (context or verbose):
        return silent

    def progress(stage, n_jobs, describe):
        if context:
            of_stage = context.subcontext(task_name=stage, max_subtasks=n_jobs)
            with _TELLING:
                of_stage.call_on_fit_task_begin(estimator=estimator)

        def report(i, result):
            line = describe(i, result) if verbose and not _PART.get() else None
            if line:
                say(line)
            if context:
                job = of_stage.subcontext(task_name="job")
                with _TELLING:
                    job.call_on_fit_task_begin(estimator=estimator)
                    job.call_on_fit_task_end(estimator=estimator)
                    if i + 1 == n_jobs:
                        of_stage.call_on_fit_task_end(estimator=estimator)

        return report

    return progress
