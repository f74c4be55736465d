"""What a long fit tells while it goes on: records of logging, and callbacks.

`verbose` says what is told at all. Its lines are records of the logger "skmtgp". Where
the user has set up logging, their handlers and levels decide what becomes of them;
where nobody has, the lines are printed, as those of scikit-learn are.
"""

import logging
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from time import time

from skmtgp._support.sklearn_compat import begin_callbacks

# A process has one connection to a progress bar, whose messages threads would mix.
_TELLING = Lock()
_PART = ContextVar("part", default="")
_KEPT = ContextVar("kept", default=None)
SILENCE = 5.0  # seconds after which a fit that tells lines says how far it is
_last = 0.0  # when a line was told, by any fit of this process

LOGGER = logging.getLogger("skmtgp")
if LOGGER.level == logging.NOTSET:  # or the root's, WARNING, would silence `verbose`
    LOGGER.setLevel(logging.DEBUG)


class Console(logging.Handler):
    """Prints to where output goes now, which notebooks and tests change."""

    def emit(self, record):
        """Print a line."""
        print(self.format(record), flush=True)


CONSOLE = Console()  # is on no logger: it takes what no handler of the user's would
CONSOLE.setFormatter(logging.Formatter("[%(name)s] %(message)s"))


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
        Whether to tell lines.

    Yields
    ------
    progress : callable
        ``progress(stage, n_jobs, describe)`` gives what is to be called with the
        position and the result of each job of a stage when it is done, or None if
        nobody listens. ``describe(position, result)`` is the line that is told, a list
        of lines, or None.
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


def say(line, level=logging.INFO):
    """Tell a line of a fit.

    Parameters
    ----------
    line : str
        What to tell.
    level : int, default=logging.INFO
        Of the record.
    """
    global _last
    _last = time()
    record = LOGGER.makeRecord(
        LOGGER.name, level, __file__, 0, f"{_PART.get()}{line}", (), None, "say"
    )
    kept = _KEPT.get()
    if kept is None:
        pass_on([record])
    else:
        kept.append(record)


def pass_on(records):
    """Give records to the user's handlers, or print them where there are none."""
    for record in records:
        if LOGGER.isEnabledFor(record.levelno):
            (LOGGER if LOGGER.hasHandlers() else CONSOLE).handle(record)


def are_handled():
    """Whether the user has set up logging."""
    return LOGGER.hasHandlers()


@contextmanager
def keep_lines():
    """Context of another process, whose records wait to be taken to the user's.

    Yields
    ------
    records : list of LogRecord
        What is told in it.
    """
    records = []
    token = _KEPT.set(records)
    try:
        yield records
    finally:
        _KEPT.reset(token)


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
            lines = describe(i, result) if verbose and not _PART.get() else None
            for line in [lines] if isinstance(lines, str) else lines or []:
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
