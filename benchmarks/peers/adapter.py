"""What every package's adapter shares: its command line, its budget, its clock.

An adapter is a class with ``Adapter(problem, settings, threads)`` and

- ``version``: of the package;
- ``fit(recorder)``: learn from the start, tell the recorder of every evaluation, return
  why it stopped;
- ``parameters()``: the current ones;
- ``evaluate(k)``: compute the likelihood and its gradient once, at parameters that
  differ with k, so that nothing can be kept from the last time; return the likelihood.

It runs as ``python NAME_adapter.py problem.npz result.npz --mode fit --settings best``.
"""

import argparse
import os
import platform
import resource
import time
import traceback

import numpy as np
from problem import load_problem, save_result

MAX_TRACE = 150


class BudgetSpent(Exception):
    """The time for a fit is over."""


class Recorder:
    """Counts evaluations, keeps the trace and the best state, watches the budget.

    Parameters
    ----------
    budget : float
        Seconds.
    clock : callable
        Gives the time in seconds.
    """

    def __init__(self, budget=np.inf, clock=time.perf_counter):
        self.clock, self.begin, self.budget = clock, clock(), budget
        self.evaluations, self.trace = 0, []
        self.best, self.state = -np.inf, None

    @property
    def seconds(self):
        """Since the fit began."""
        return self.clock() - self.begin

    def __call__(self, value, state=None):
        """Note a log likelihood and the state at which it was found."""
        self.evaluations += 1
        if np.isfinite(value) and value > self.best:
            self.best, self.state = float(value), state
            self.trace.append((self.seconds, self.best))
        if self.seconds > self.budget:
            raise BudgetSpent

    def thinned(self):
        """The trace with at most MAX_TRACE points."""
        keep = np.linspace(0, len(self.trace) - 1, MAX_TRACE).astype(int)
        return [self.trace[i] for i in np.unique(keep)] if self.trace else []


def run_fit(make, problem, budget):
    """Learn; parameters, trace and report.

    The time of one thread is that of the processor, which other work beside it hardly
    changes; that of several is the time that passes.
    """
    adapter = make(problem)
    one_thread = adapter.threads == 1
    recorder = Recorder(budget, time.process_time if one_thread else time.perf_counter)
    try:
        stop = adapter.fit(recorder)
    except BudgetSpent:
        stop = "budget"
    seconds = recorder.seconds
    if stop == "budget":
        adapter.restore(recorder.state)
    report = {
        "seconds": seconds,
        "evaluations": recorder.evaluations,
        "stop": str(stop),
        "own_likelihood": recorder.best,
        "version": adapter.version,
        "peak_mib": peak_mib(),
    }
    return adapter.parameters(), recorder.thinned(), report


def run_time(make, problem, limit):
    """Best time of an evaluation, that of its floor, and the memory it took."""
    _, _, report = run_cost(make, problem, limit)
    return None, (), {**report, "floor_seconds": floor(len(problem.y))}


def run_cost(make, problem, limit):
    """Best time of an evaluation, the processor's with it, and the memory it took."""
    n, before = len(problem.y), peak_mib()
    adapter = make(problem)
    adapter.evaluate(0)
    times, processor, begin = [], [], time.perf_counter()
    while len(times) < 3 or (
        time.perf_counter() - begin < limit and len(times) < 60_000 // n
    ):
        start, start_processor = time.perf_counter(), time.process_time()
        adapter.evaluate(len(times) + 1)
        times.append(time.perf_counter() - start)
        processor.append(time.process_time() - start_processor)
    peak = peak_mib()
    report = {
        "seconds": min(times),
        "median_seconds": float(np.median(times)),
        "processor_seconds": min(processor),
        "repeats": len(times),
        "memory_mib": peak - before,
        "peak_mib": peak,
        "version": adapter.version,
    }
    return None, (), report


def run_check(make, problem, _):
    """The package's own likelihood at the start, and its parameters there."""
    adapter = make(problem)
    value = float(adapter.evaluate(0))
    report = {"own_likelihood": value, "version": adapter.version}
    return adapter.parameters(), (), report


def floor(n):
    """Best time of LAPACK's potrf and potri, as scipy has them here."""
    from scipy.linalg.lapack import dpotrf, dpotri

    rng = np.random.default_rng(0)
    A = rng.standard_normal((n, n))
    K = np.asfortranarray(A @ A.T + n * np.eye(n))
    times = []
    for _ in range(max(3, min(60, 20_000 // n))):
        work = K.copy(order="F")
        begin = time.perf_counter()
        factor, _ = dpotrf(work, lower=1, clean=0, overwrite_a=1)
        dpotri(factor, lower=1, overwrite_c=1)
        times.append(time.perf_counter() - begin)
    return min(times)


def peak_mib():
    """Peak memory of this process in MiB.

    Linux counts the parent's into ru_maxrss, but not into VmHWM.
    """
    try:
        with open("/proc/self/status") as file:
            lines = dict(line.split(":", 1) for line in file)
        return int(lines["VmHWM"].split()[0]) / 1024.0
    except (OSError, KeyError):
        unit = 2**20 if platform.system() == "Darwin" else 2**10
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


MODES = {"fit": run_fit, "time": run_time, "cost": run_cost, "check": run_check}


def main(adapter_class, settings=("shipped", "best")):
    """Run an adapter from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem")
    parser.add_argument("result")
    parser.add_argument("--mode", choices=MODES, default="fit")
    parser.add_argument("--settings", choices=settings, default=settings[-1])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--budget", type=float, default=60.0, help="seconds")
    arguments = parser.parse_args()

    def make(problem):
        adapter = adapter_class(problem, arguments.settings, arguments.threads)
        adapter.threads = arguments.threads
        return adapter

    try:
        problem = load_problem(arguments.problem)
        outcome = MODES[arguments.mode](make, problem, arguments.budget)
        parameters, trace, report = outcome
        save_result(arguments.result, parameters, trace, **report)
    except Exception as error:  # a package's failure is a result
        traceback.print_exc()
        save_result(arguments.result, error=f"{type(error).__name__}: {error}"[:300])


def threads_environment(threads):
    """Environment variables that limit the threads of numerical libraries."""
    names = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "TF_NUM_INTRAOP", "VECLIB_MAXIMUM")
    return {**os.environ, **{f"{name}_NUM_THREADS": str(threads) for name in names}}
