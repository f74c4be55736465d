"""What a long fit tells while it goes on: lines, and scikit-learn's callbacks."""

from contextlib import contextmanager
from threading import Lock

from skmtgp._support.sklearn_compat import begin_callbacks

# A process has one connection to a progress bar, whose messages threads would mix.
_TELLING = Lock()


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
            line = describe(i, result) if verbose else None
            if line:
                print(f"[skmtgp] {line}", flush=True)
            if context:
                job = of_stage.subcontext(task_name="job")
                with _TELLING:
                    job.call_on_fit_task_begin(estimator=estimator)
                    job.call_on_fit_task_end(estimator=estimator)
                    if i + 1 == n_jobs:
                        of_stage.call_on_fit_task_end(estimator=estimator)

        return report

    return progress
