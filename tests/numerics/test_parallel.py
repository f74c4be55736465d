"""Pieces of work side by side, what they tell, and threads of BLAS."""

import threading
from concurrent.futures import ThreadPoolExecutor

import joblib
import pytest
from threadpoolctl import threadpool_limits

from skmtgp import PooledGP
from skmtgp._numerics import parallel as _parallel
from skmtgp._numerics.parallel import ONE_THREAD, at_a_time, map_threads, run
from skmtgp._support.progress import fitting, silent


@pytest.mark.parametrize("n_threads", [1, 2])
def test_threads(n_threads):
    """As many as BLAS has, which has one for each of them."""
    met = threading.Barrier(n_threads, timeout=10.0)

    def work(i):
        met.wait()
        return i, threading.get_ident()

    with threadpool_limits(n_threads, user_api="blas"):
        results, threads = zip(
            *map_threads(work, [(i,) for i in range(4)]), strict=True
        )
    assert results == (0, 1, 2, 3)
    assert len(set(threads)) == n_threads


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_reports_come_in_order(n_jobs):
    told = []
    jobs = [(k,) for k in (3, 1, 2)]
    report = lambda *found: told.append(found)  # noqa: E731
    assert run(abs, jobs, n_jobs=n_jobs, report=report) == [3, 1, 2]
    assert told == [(0, 3), (1, 1), (2, 2)]


def test_nobody_listens():
    with fitting(PooledGP(), [[0.0]], [0.0]) as progress:
        assert progress is silent
        assert progress("learning", 2, str) is None


class TestAtATime:
    """How many pieces of work share this machine's memory."""

    @pytest.mark.parametrize(
        ("n_jobs", "n_pieces", "expected"),
        [(None, 5, 1), (2, 5, 2), (9, 5, 5), (3, 0, 1)],
    )
    def test_processes(self, n_jobs, n_pieces, expected):
        assert at_a_time(n_jobs, n_pieces) == expected

    def test_context(self):
        with joblib.parallel_config(n_jobs=3):
            assert at_a_time(None, 5) == 3
        with joblib.parallel_config(backend="sequential"):
            assert at_a_time(3, 5) == 1

    def test_dask(self, monkeypatch):
        """Its workers have memory of their own."""
        backend = type("DaskDistributedBackend", (), {})()
        monkeypatch.setattr(_parallel, "get_active_backend", lambda: (backend, 8))
        assert at_a_time(8, 5) == 1


@pytest.fixture
def two_threads():
    """BLAS has two threads, which must be so again at the end."""
    with threadpool_limits(2, user_api="blas"):
        yield
        assert {library.num_threads for library in ONE_THREAD.libraries} == {2}


def blas_threads():
    return max(library.num_threads for library in ONE_THREAD.libraries)


@pytest.mark.usefixtures("two_threads")
class TestPools:
    def test_beside_another_thread_s_limit(self):
        """A large fit has all threads for its tiles while a small one goes on."""
        with ONE_THREAD, ThreadPoolExecutor(1) as another:
            names = another.submit(self.names).result()
        assert len(names) == 2
        with ONE_THREAD:
            assert len(self.names()) == 1

    def names(self):
        met = threading.Barrier(ONE_THREAD.n_threads(), timeout=10.0)

        def work(i):
            met.wait()
            assert blas_threads() == 1
            return threading.current_thread().name

        return set(map_threads(work, [(i,) for i in range(4)]))

    def test_pools_have_no_pools(self):
        nested = lambda i: map_threads(lambda j: threading.get_ident(), [(1,), (2,)])  # noqa: E731
        for idents in map_threads(nested, [(i,) for i in range(4)]):
            assert len(set(idents)) == 1

    def test_one_piece_of_work_is_limited_too(self):
        assert map_threads(blas_threads, [()]) == [1]
        assert map_threads(blas_threads, []) == []

    @pytest.mark.parametrize("backend", ["threading", "loky"])
    def test_a_limit_goes_with_the_jobs(self, backend):
        depth, jobs = lambda i: _parallel.ONE_THREAD.depth, [(1,), (2,)]
        with joblib.parallel_config(backend):
            with ONE_THREAD:
                assert run(depth, jobs, n_jobs=2) == [1, 1]
            assert run(depth, jobs, n_jobs=2) == [0, 0]
