"""Independent pieces of work, one after another or side by side."""

import contextlib
from concurrent.futures import ThreadPoolExecutor

import scipy.linalg.lapack  # noqa: F401  its BLAS is to be found below
from joblib import effective_n_jobs, parallel_config
from joblib.parallel import get_active_backend
from sklearn.utils.parallel import Parallel, delayed
from threadpoolctl import ThreadpoolController

SMALL = 600  # samples
BLAS = ThreadpoolController().select(user_api="blas")


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
    report : callable, default=None
        Called with a job's position and its result, in the order of the jobs, as soon
        as they are there.

    Returns
    -------
    results : list
        In the order of the jobs.
    """
    tasks = (delayed(_alone)(function, job) for job in jobs)
    if report is None:
        return Parallel(n_jobs=n_jobs)(tasks)
    results = []
    for result in Parallel(n_jobs=n_jobs, return_as="generator")(tasks):
        report(len(results), result)
        results.append(result)
    return results


def at_a_time(n_jobs, n_pieces):
    """How many of so many pieces of work share this machine's memory.

    Those that Dask does do not: its workers have memory of their own.
    """
    backend, _ = get_active_backend()
    if type(backend).__name__.startswith("Dask"):
        return 1
    return max(1, min(effective_n_jobs(n_jobs), n_pieces))


def _alone(function, job):
    """``function(*job)`` in one process, which shares out nothing of it.

    The arguments travel together, in a tuple: of large arrays that travel alone Dask
    has one copy, on one worker, and the fit fails or hangs once that worker is dead.
    """
    with parallel_config(backend="sequential"):
        return function(*job)


def limit_threads(size):
    """Context in which small matrices are not spread over threads, which slows them."""
    return BLAS.limit(limits=1) if size < SMALL else contextlib.nullcontext()


def count_threads():
    """As many as BLAS may use."""
    return max((library.num_threads for library in BLAS.lib_controllers), default=1)


def map_threads(function, jobs):
    """``[function(*job) for job in jobs]``, on as many threads as BLAS may use.

    Parameters
    ----------
    function : callable
        Spends its time in numpy, which lets other threads run.
    jobs : sequence of tuple
        Its arguments.

    Returns
    -------
    results : list
        In the order of the jobs.
    """
    n_threads = count_threads()
    if n_threads == 1 or len(jobs) == 1:
        return [function(*job) for job in jobs]
    with BLAS.limit(limits=1), ThreadPoolExecutor(n_threads) as pool:
        return list(pool.map(lambda job: function(*job), jobs))
