"""One thread of BLAS, for any number of Python's threads at once.

threadpoolctl sets how many threads BLAS has. With some libraries, the OpenBLAS in the
wheels of NumPy and SciPy among them, the number is the process's; with others each of
Python's threads has one. Where limits of the process's number overlap in two threads,
the second finds the first one's and gives that back at its end, for good.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import RLock, get_ident, local


class Own(local):
    """What each thread has: how many times it is inside, and numbers to give back."""

    def __init__(self):
        self.depth, self.found = 0, {}


class OneThread:
    """Context in which BLAS has one thread.

    Of a number of the process the first thread that enters takes note, and the last
    that leaves gives it back, whatever overlaps. Of its own number each thread does. To
    enter again from inside changes nothing.

    A thread with large matrices has one thread of BLAS too while others are inside,
    and takes at most as many times longer as it would have threads. A small matrix may
    take tens of times longer with two threads beside a busy process than with one.

    Others may limit BLAS around this context, or within it. What begins in another
    thread while somebody is inside and ends later finds our limit and gives it back.

    Parameters
    ----------
    libraries : list of threadpoolctl.LibController
        What is limited.
    """

    def __init__(self, libraries):
        self.libraries, self.of_process = libraries, {}
        self.lock, self.inside, self.found = RLock(), set(), {}
        self.own = Own()
        if hasattr(os, "register_at_fork"):  # not on Windows
            os.register_at_fork(
                before=self.lock.acquire,
                after_in_parent=self.lock.release,
                after_in_child=self._begin_child,
            )

    @property
    def depth(self):
        """How many times this thread is inside."""
        return self.own.depth

    def __enter__(self):
        with self.lock:
            if not self.depth:
                self._leave(0)  # an exception may have cut the last time short
                self.inside.add(get_ident())
                self._limit()
            self.own.depth += 1

    def __exit__(self, *exception):
        self._leave(self.depth - 1)

    @contextmanager
    def unwinding(self):
        """Context after whose exceptions this thread is as deep inside as before.

        Those of a signal or a timeout come between any two steps, also of `__enter__`
        and before the first of `__exit__`, and nothing but a context outside of both
        can put that right.
        """
        depth = self.depth
        try:
            yield
        except BaseException:
            self._leave(depth)
            raise

    def n_threads(self):
        """Threads for pieces of work: one inside, else as many as BLAS has outside."""
        if self.depth:
            return 1
        with self.lock:
            now = [library.num_threads for library in self.libraries]
            return max([1, *now, *self.found.values()])

    def _limit(self):
        """Set all numbers to one; each is noted before."""
        for library in self.libraries:
            n_threads = library.num_threads
            if n_threads > 1:
                self.own.found[library] = n_threads
                if library not in self.of_process:
                    self.of_process[library] = _is_of_process(library)
                if self.of_process[library]:
                    self.found[library] = n_threads
                    del self.own.found[library]
                _set(library, 1)

    def _leave(self, depth):
        """Be inside so many times. To repeat it, whole or in part, changes nothing."""
        with self.lock:
            if not depth:
                _give_back(self.own.found)
                self.inside.discard(get_ident())
                self._end()
            self.own.depth = depth

    def _end(self):
        """Give the process's numbers back if nobody is inside any more."""
        if not self.inside:
            _give_back(self.found)

    def _begin_child(self):
        """Of the threads of a process that forks only this one lives on."""
        self.inside = {get_ident()} if self.depth else set()
        self._end()
        self.lock.release()


def _give_back(found):
    """Set numbers as they were found, and forget each that is set."""
    for library, n_threads in list(found.items()):
        if library.num_threads == 1:  # else somebody has set another since
            _set(library, n_threads)
        del found[library]


def _set(library, n_threads):
    """Set a number, whichever thread has set it last, and leave that to any thread.

    From version 3.8 on threadpoolctl lets the first thread alone set OpenBLAS's number,
    until its limit ends.
    """
    clear = getattr(library, "clear_controlling_thread", lambda force: None)
    clear(force=True)
    library.set_num_threads(n_threads)
    clear(force=True)


def _is_of_process(library):
    """Whether another thread sees the number that this one sets, which is 1."""
    with ThreadPoolExecutor(1) as other:
        before = other.submit(library.get_num_threads).result()
        _set(library, 1)
        return other.submit(library.get_num_threads).result() == 1 < before
