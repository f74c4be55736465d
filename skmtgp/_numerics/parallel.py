"""Independent pieces of work, one after another or side by side; threads of BLAS."""

import contextlib
from concurrent.futures import ThreadPoolExecutor

import joblib
import scipy.linalg.lapack  # noqa: F401  its BLAS is to be found below
from joblib import effective_n_jobs, parallel_config
from joblib.parallel import get_active_backend
from sklearn.utils import parallel as sklearn_parallel
from threadpoolctl import ThreadpoolController

from skmtgp._numerics.one_thread import OneThread
from skmtgp._support.progress import are_handled, keep_lines, pass_on
from skmtgp._support.warnings import quiet

SMALL = 600  # rows of a matrix


with quiet():  # in a browser threadpoolctl's use of Pyodide warns
    LIBRARIES = ThreadpoolController().select(user_api="blas").lib_controllers
ONE_THREAD = OneThread(LIBRARIES)


def limit_threads(size):
    """Context in which small matrices are not spread over threads, which slows them.

    Parameters
    ----------
    size : int
        Rows of the largest of them.
    """
    return ONE_THREAD if size < SMALL else contextlib.nullcontext()


def run(function, jobs, *, n_jobs=None, report=None):
    """``[function(*job) for job in jobs]``, on `n_jobs` processes.

    Parameters
    ----------
    function : callable
        What to do; can be pickled.
    jobs : sequence of tuple
        Its arguments.
    n_jobs : int, default=None
        As in scikit-learn: None is 1 unless in a ``joblib.parallel_config`` context.
        Where the caller is limited to one thread of BLAS, each of them is.
    report : callable, default=None
        Called with a job's position and its result, in the order of the jobs, as soon
        as they are there.

    Returns
    -------
    results : list
        In the order of the jobs.
    """
    tools, small = _tools(n_jobs), ONE_THREAD.depth > 0
    # What processes of this machine print is seen at once; handlers are here alone.
    keeps = tools is not joblib and (is_on_dask() or are_handled())
    tasks = (tools.delayed(_alone)(function, job, small, keeps) for job in jobs)
    results = []
    for result, lines in tools.Parallel(n_jobs=n_jobs, return_as="generator")(tasks):
        pass_on(lines)
        if report is not None:
            report(len(results), result)
        results.append(result)
    return results


def _tools(n_jobs):
    """The module whose Parallel and delayed are to be used.

    scikit-learn's take its configuration and the filters of warnings to other
    processes. In this one both are there already, and threads that set such filters at
    the same time may lose them.
    """
    backend, _ = get_active_backend()
    if effective_n_jobs(n_jobs) == 1 or getattr(backend, "supports_sharedmem", False):
        return joblib
    return sklearn_parallel


def is_on_dask():
    """Whether pieces of work are shared out to Dask's workers."""
    backend, _ = get_active_backend()
    return type(backend).__name__.startswith("Dask")


def at_a_time(n_jobs, n_pieces):
    """How many of so many pieces of work share this machine's memory.

    Those that Dask does do not: its workers have memory of their own.
    """
    if is_on_dask():
        return 1
    return max(1, min(effective_n_jobs(n_jobs), n_pieces))


def _alone(function, job, small, keeps):
    """``function(*job)`` in one process, which shares out nothing of it; its lines.

    The arguments travel together, in a tuple: of large arrays that travel alone Dask
    has one copy, on one worker, and the fit fails or hangs once that worker is dead.
    """
    limit = ONE_THREAD if small else contextlib.nullcontext()
    lines = keep_lines() if keeps else contextlib.nullcontext(())
    with parallel_config(backend="sequential"), limit, lines as told:
        return function(*job), told


def count_threads():
    """How many threads pieces of work are spread over at most."""
    return ONE_THREAD.n_threads()


def map_threads(function, jobs):
    """``[function(*job) for job in jobs]``, on as many threads as BLAS may use.

    BLAS itself has one meanwhile. The number is that outside of any limit of another
    thread of Python; a caller that is limited itself has one.

    Parameters
    ----------
    function : callable
        Spends its time in numpy, which lets other threads run, on small matrices.
    jobs : sequence of tuple
        Its arguments.

    Returns
    -------
    results : list
        In the order of the jobs.
    """
    if ONE_THREAD.depth:
        return [function(*job) for job in jobs]
    n_threads = min(count_threads(), len(jobs)) if len(jobs) > 1 else 1
    with ONE_THREAD:
        if n_threads == 1:
            return [function(*job) for job in jobs]
        with ThreadPoolExecutor(n_threads) as pool:
            return list(pool.map(lambda job: _inside(function, job), jobs))


def _inside(function, job):
    """``function(*job)`` in a thread of a pool, which shares out nothing of it."""
    with ONE_THREAD:
        return function(*job)
