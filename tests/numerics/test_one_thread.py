"""One thread of BLAS, whichever threads of Python ask for it at once."""

import contextlib
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path

import pytest

from skmtgp._numerics import one_thread
from skmtgp._numerics.one_thread import OneThread

FOLDER = str(Path(one_thread.__file__).parent)


class Library:
    """A BLAS whose number of threads is that of the process."""

    def __init__(self, num_threads):
        self.default = num_threads
        self.set_num_threads(num_threads)

    def get_num_threads(self):
        return self.num_threads

    def set_num_threads(self, num_threads):
        self.num_threads = num_threads


class OfThread(Library):
    """A BLAS that has a number for each thread."""

    def __init__(self, num_threads):
        self.own = threading.local()
        super().__init__(num_threads)

    @property
    def num_threads(self):
        return getattr(self.own, "num_threads", self.default)

    @num_threads.setter
    def num_threads(self, num_threads):
        self.own.num_threads = num_threads


class Controlled(Library):
    """A number of the process, which the first thread that sets it keeps to itself."""

    thread = None

    def clear_controlling_thread(self, force=False):
        if force or self.thread is threading.current_thread():
            self.thread = None

    def set_num_threads(self, num_threads):
        if self.thread in (None, threading.current_thread()):
            self.thread = threading.current_thread()
            self.num_threads = num_threads


def now(libraries):
    return [library.num_threads for library in libraries]


@pytest.fixture(params=[Library, OfThread, Controlled])
def libraries(request):
    return [request.param(4), request.param(2)]


@pytest.fixture
def limit(libraries):
    return OneThread(libraries)


@pytest.mark.parametrize("first_out", [0, 1])
def test_overlap(limit, libraries, first_out):
    """Two threads, of which the first to enter leaves first, or last."""
    enter, leave = ([threading.Event() for _ in range(2)] for _ in range(2))
    entered = threading.Semaphore(0)
    seen = {}

    def work(i):
        enter[i].wait(10)
        with limit:
            entered.release()
            leave[i].wait(10)
            seen[i] = now(libraries)
        seen[i, "after"] = now(libraries)

    with ThreadPoolExecutor(2) as pool:
        of_thread = [pool.submit(work, i) for i in range(2)]
        for event in enter:
            event.set()
            entered.acquire(timeout=10)
        for i in (first_out, 1 - first_out):
            leave[i].set()
            of_thread[i].result(10)
    assert seen[0] == seen[1] == [1, 1]
    assert seen[1 - first_out, "after"] == now(libraries) == [4, 2]
    if isinstance(libraries[0], OfThread):
        assert seen[first_out, "after"] == [4, 2]


def test_many_times_at_once(limit, libraries):
    def work(i):
        for _ in range(500):
            with limit:
                assert now(libraries) == [1, 1]
        return now(libraries)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
    assert now(libraries) == [4, 2]


def test_nested(limit, libraries):
    with limit:
        with limit, limit:
            assert limit.depth == 3
        assert now(libraries) == [1, 1]
    assert now(libraries) == [4, 2]
    assert limit.depth == 0


def test_errors_leave(limit, libraries):
    with pytest.raises(ZeroDivisionError, match="zero"), limit:
        1 / 0  # noqa: B018
    assert now(libraries) == [4, 2]


def test_a_limit_of_the_user_is_found_again(limit, libraries):
    libraries[0].set_num_threads(3)
    with limit:
        assert now(libraries) == [1, 1]
    assert now(libraries) == [3, 2]
    libraries[0].set_num_threads(1)
    with limit:
        assert now(libraries) == [1, 1]
    assert now(libraries) == [1, 2]


def test_what_another_has_set_since_stays(limit, libraries):
    """Such as the end of a limit that was around the begin of this one."""
    with limit:
        libraries[0].set_num_threads(8)
    assert now(libraries) == [8, 2]


def test_limits_in_another_thread_do_not_keep_this_one_from_it(limit, libraries):
    """From version 3.8 on threadpoolctl's would: the thread is alive."""
    libraries[0].set_num_threads(3)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: limit.__enter__() or now(libraries)).result() == [
            1,
            1,
        ]
        pool.submit(limit.__exit__).result()
    libraries[0].set_num_threads(5)
    assert now(libraries) == [5, 2]


def test_threads_for_pieces_of_work(limit):
    assert limit.n_threads() == 4
    with limit, ThreadPoolExecutor(1) as another:
        assert limit.n_threads() == 1
        assert another.submit(limit.n_threads).result() == 4  # it is not inside
    assert OneThread([]).n_threads() == 1


class InterruptAt:
    """Context in which the k-th step of the module is interrupted, as by a signal.

    Steps are calls and bytecodes, which is where Python looks for signals.
    """

    def __init__(self, k):
        self.left = k

    def __enter__(self):
        self.before = sys.gettrace()
        sys.settrace(self.trace)

    def __exit__(self, *exception):
        sys.settrace(self.before)

    def trace(self, frame, event, arg):
        if frame.f_code.co_filename != one_thread.__file__:
            return None
        frame.f_trace_opcodes = True
        if event in ("call", "opcode"):
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt
        return self.trace


def steps_of(use):
    """Interrupt every step of a function in turn, until there is none left."""
    for k in count(1):
        interrupt = InterruptAt(k)
        try:
            with interrupt:
                use()
        except KeyboardInterrupt:
            yield k
        if interrupt.left > 0:
            return


@pytest.mark.parametrize("nested", [False, True])
def test_interrupts_at_any_step_leave_nothing(limit, libraries, nested):
    """Also before the first step of `__exit__`, which is not run then."""

    def use():
        with limit.unwinding(), limit, limit if nested else contextlib.nullcontext():
            pass

    steps = []
    for step in steps_of(use):
        assert now(libraries) == [4, 2], step
        assert (limit.depth, limit.inside, limit.found) == (0, set(), {}), step
        steps.append(step)
    assert len(steps) > 100


def test_unwinding_inside_stays_inside(limit, libraries):
    def use():
        with limit.unwinding(), limit:
            pass

    with limit:
        for step in steps_of(use):
            assert (limit.depth, now(libraries)) == (1, [1, 1]), step
    assert now(libraries) == [4, 2]


def test_what_an_interrupt_has_left_is_given_back_the_next_time(limit, libraries):
    def use():
        with limit:
            pass

    for step in steps_of(use):
        limit.own.depth = 0  # whatever else is left
        with limit:
            assert now(libraries) == [1, 1], step
        assert now(libraries) == [4, 2], step


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.parametrize(
    ("who", "inside"), [("another thread", 4), ("this thread", 1), ("nobody", 4)]
)
def test_fork(who, inside):
    """A child is limited as the one thread is that it goes on with."""
    command = [sys.executable, "-W", "ignore", "-c", FORK, who, FOLDER]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.split() == [str(inside), "1", "4"], done.stderr


FORK = """
import contextlib, os, sys, threading
sys.path.insert(0, sys.argv[2])  # imported alone, which takes less time
from one_thread import OneThread

class Library:
    num_threads = 4
    def get_num_threads(self):
        return self.num_threads
    def set_num_threads(self, num_threads):
        self.num_threads = num_threads

library, ready, end = Library(), threading.Event(), threading.Event()
limit, who = OneThread([library]), sys.argv[1]

def stay():
    with limit:
        ready.set()
        end.wait()

if who == "another thread":
    threading.Thread(target=stay).start()
    ready.wait()
with limit if who == "this thread" else contextlib.nullcontext():
    child = os.fork()
    seen = [library.num_threads]
    if not child:
        with limit:
            seen.append(library.num_threads)
if not child:
    print(*seen, library.num_threads, flush=True)
    os._exit(0)
end.set()
os.waitpid(child, 0)
"""
