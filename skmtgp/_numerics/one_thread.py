"""One thread of BLAS, for any number of Python's threads at once.

threadpoolctl sets how many threads BLAS has. With some libraries, the OpenBLAS in the
wheels of NumPy and SciPy among them, the number is the process's; with others each of
Python's threads has one. Where limits of the process's number overlap in two threads,
the second finds the first one's and gives that back at its end, for good.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from threading import RLock, local


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
        self.lock, self.n_inside, self.found = RLock(), 0, {}
        self.own = local()
        if hasattr(os, "register_at_fork"):  # not on Windows
            os.register_at_fork(
                before=self.lock.acquire,
                after_in_parent=self.lock.release,
                after_in_child=self._begin_child,
            )

    @property
    def depth(self):
        """How many times this thread is inside."""
        return getattr(self.own, "depth", 0)

    def __enter__(self):
        with self.lock:
            if not self.depth:
                self.own.found = self._limit()
                self.n_inside += 1
            self.own.depth = self.depth + 1

    def __exit__(self, *exception):
        with self.lock:
            self.own.depth -= 1
            if not self.depth:
                _give_back(self.own.found)
                self.n_inside -= 1
                self._end()

    def n_threads(self):
        """Threads for pieces of work: one inside, else as many as BLAS has outside."""
        if self.depth:
            return 1
        with self.lock:
            now = [library.num_threads for library in self.libraries]
            return max([1, *now, *self.found.values()])

    def _limit(self):
        """Set all numbers to one, and return those that were this thread's own."""
        own = {}
        for library in self.libraries:
            n_threads = library.num_threads
            if n_threads > 1:
                if library not in self.of_process:
                    self.of_process[library] = _is_of_process(library)
                found = self.found if self.of_process[library] else own
                found[library] = n_threads
                _set(library, 1)
        return own

    def _end(self):
        """Give the process's numbers back if nobody is inside any more."""
        if not self.n_inside:
            _give_back(self.found)
            self.found = {}

    def _begin_child(self):
        """Of the threads of a process that forks only this one lives on."""
        self.n_inside = min(self.depth, 1)
        self._end()
        self.lock.release()


def _give_back(found):
    for library, n_threads in found.items():
        if library.num_threads == 1:  # else somebody has set another since
            _set(library, n_threads)


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
