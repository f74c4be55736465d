"""Pieces of work side by side, and what they tell."""

import threading

import joblib
import pytest
from threadpoolctl import threadpool_limits

from skmtgp import PooledGP, _parallel
from skmtgp._parallel import at_a_time, map_threads, run
from skmtgp._progress import fitting, silent


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
