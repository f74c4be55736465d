"""Compare skmtgp with other packages: same data, kernel, start and threads.

``python benchmarks/peers/run.py`` measures what benchmarks/results does not have yet:
the time and memory of an evaluation, and fits. Every package works in a process and an
environment of its own (``make bench-envs``). ``page.py`` makes the page and the plots.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from adapter import threads_environment
from prepare import Rows, load_case, make_problem, random_problem
from problem import load_problem, load_result
from reference import Posterior, normalized_mean_squared_error
from results import RESULTS, Table, write_machine
from threadpoolctl import threadpool_limits

HERE = Path(__file__).resolve().parent
ENVIRONMENTS, PROBLEMS = HERE.parent / ".envs", HERE.parent / ".problems"
OURS = "skmtgp"
PEERS = ("gpytorch", "botorch", "gpy", "gpflow", "sklearn")
SETTINGS = ("best", "shipped")
SIZES = (280, 1400, 2800, 4000)
N_PARAMETERS = 115  # of scikit-learn's kernel, whose gradient is n x n x p
TENSOR_SHARE = 0.5  # of the memory, that it may take
TIME_SETTINGS = {"gpytorch": SETTINGS, "botorch": SETTINGS}
ABSENT = "not installed"
WAIT = 5.0  # budgets, as the processor's time may count, and others may use it too
GRACE = 120.0  # seconds more, to load, to end an evaluation and to write


class Runner:
    """Runs adapters and writes rows.

    Parameters
    ----------
    arguments : Namespace
        From the command line.
    """

    kinds = "fits", "timings", "checks"
    adapter = "adapter"  # how the adapters' files end
    memory = np.inf  # GiB that an adapter may take

    def __init__(self, arguments):
        self.arguments = arguments
        self.tables = {kind: Table(kind, arguments.results) for kind in self.kinds}

    def wanted(self, kind, **key):
        """Whether a row is to be measured."""
        table = self.tables[kind]
        row = table.rows.get(table.key(key), {"error": ABSENT})
        return self.arguments.redo or row.get("error") == ABSENT

    def limit(self, budget):
        """Seconds after which an adapter is ended."""
        return WAIT * budget + GRACE

    def adapt(self, package, settings, mode, problem, budget):
        """Run an adapter in its environment: parameters, trace, report."""
        python = interpreter(package)
        if python is None:
            return None, None, {"error": ABSENT}
        with tempfile.TemporaryDirectory() as folder:
            result = Path(folder) / "result.npz"
            command = [python, HERE / f"{package}_{self.adapter}.py", problem, result]
            command += ["--mode", mode, "--settings", settings]
            command += ["--budget", budget, "--threads", self.arguments.threads]
            limits = self.limit(budget), self.memory
            failure = execute(command, self.arguments.threads, *limits)
            if failure or not result.exists():
                return None, None, {"error": failure or "no result"}
            return load_result(result)

    def append(self, kind, key, report):
        """Write a row and print it."""
        row = {**key, "threads": self.arguments.threads, **report}
        row = self.tables[kind].append(row)
        shown = {k: v for k, v in row.items() if k not in ("trace", "date")}
        print(kind, *(f"{k}={brief(v)}" for k, v in shown.items()), flush=True)

    # Seconds and memory of an evaluation

    def time_all(self):
        """Every package at every n."""
        for n in self.arguments.sizes:
            for package in (OURS, *self.arguments.peers):
                for settings in TIME_SETTINGS.get(package, ("best",)):
                    key = {"package": package, "settings": settings, "n": n}
                    if self.wanted("timings", **key):
                        self.time_one(key)

    def time_one(self, key):
        """One package at one n."""
        n = key["n"]
        tensor_gib = 8.0 * n**2 * N_PARAMETERS / 2**30
        if key["package"] == "sklearn" and tensor_gib > TENSOR_SHARE * free_gib():
            reason = f"its gradient needs {tensor_gib:.1f} GiB"
            return self.append("timings", key, {"error": reason})
        path = PROBLEMS / f"random-{n}.npz"
        if not path.exists():
            save(random_problem(n), path)
        budget = self.arguments.time_budget
        _, _, report = self.adapt(key["package"], key["settings"], "time", path, budget)
        return self.append("timings", key, report)

    # Fits

    def fit_all(self):
        """Every package on every problem; this one first, for it sets the budget."""
        problems = [
            (n_per_load, joint, draw)
            for n_per_load, draw in self.arguments.plan
            for joint in self.arguments.joints
        ]
        with ThreadPoolExecutor(self.arguments.jobs) as pool:
            list(pool.map(lambda key: self.fit_problem(self.case(*key)), problems))

    def fit_problem(self, case):
        """Every package on one problem."""
        jobs = [(OURS, "best"), (OURS, "shipped")]
        jobs += [(p, s) for p in self.arguments.peers for s in self.arguments.settings]
        for package, settings in jobs:
            key = {"package": package, "settings": settings, **case.key}
            if self.wanted("fits", **key):
                budget = self.budget(case) if package != OURS else 3600.0
                self.fit_one(key, case, budget)

    def budget(self, case):
        """Seconds for a peer: a multiple of what this package took."""
        table, a = self.tables["fits"], self.arguments
        ours = table.rows.get((OURS, "best", *case.key.values()), {})
        seconds = a.budget_factor * ours.get("seconds", 0.0)
        return float(np.clip(seconds, a.budget_min, a.budget_max))

    def fit_one(self, key, case, budget):
        """One package on one problem."""
        parameters, trace, report = self.adapt(
            key["package"], key["settings"], "fit", case.problem_path, budget
        )
        report["budget"] = budget
        if parameters is not None:
            report |= case.score(parameters)
            report["trace"] = [[float(f"{v:.6g}") for v in point] for point in trace]
        self.append("fits", key, report)

    def check_all(self):
        """Whether each package's likelihood at the start is the reference's."""
        case = self.case(20, self.arguments.joints[0], 0)
        jobs = [(OURS, "best")]
        jobs += [(p, s) for p in self.arguments.peers for s in SETTINGS]
        for package, settings in jobs:
            key = {"package": package, "settings": settings, **case.key}
            parameters, _, report = self.adapt(
                package, settings, "check", case.problem_path, 60.0
            )
            if parameters is not None:
                report |= case.score(parameters)
                report["difference"] = report["own_likelihood"] - report["likelihood"]
            self.append("checks", key, report)

    def case(self, n_per_load, joint, draw):
        """A problem, made once."""
        return StoredCase(n_per_load, joint, draw)


class StoredCase:
    """A problem with its file and its test sets."""

    def __init__(self, n_per_load, joint, draw):
        self.key = {"n": 14 * n_per_load, "joint": joint, "draw": draw}
        name = f"puma560-{n_per_load}-{joint}-{draw}"
        self.problem_path = PROBLEMS / f"{name}.npz"
        tests_path = PROBLEMS / f"{name}-tests.npz"
        if not (self.problem_path.exists() and tests_path.exists()):
            case = load_case(n_per_load, joint, draw)
            save_tests(case, tests_path)
            save(make_problem(case.train), self.problem_path)
        self.tests_path = tests_path

    def score(self, parameters):
        """Likelihood and errors by the reference implementation."""
        posterior = Posterior(parameters, load_problem(self.problem_path))
        scores = {
            "likelihood": posterior.log_marginal_likelihood,
            "jitter": posterior.jitter,
            "noise": float(parameters.noise),
        }
        with np.load(self.tests_path) as file:
            for subset in ("interpolation", "extrapolation"):
                u, tasks, y = (file[f"{subset}_{k}"] for k in Rows._fields)
                mean = posterior.mean(u, tasks)
                nmse = normalized_mean_squared_error(y, mean, tasks)
                scores[f"nmse_{subset}"] = nmse
        return scores


def save(problem, path):
    """Write a problem, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npz")
    problem.save(part)
    part.replace(path)


def save_tests(case, path):
    """Write the test sets."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"{subset}_{field}": getattr(getattr(case, subset), field)
        for subset in ("interpolation", "extrapolation")
        for field in Rows._fields
    }
    np.savez(path, **arrays)


def interpreter(package):
    """The Python of a package's environment; None where there is none."""
    if package == OURS:
        return sys.executable
    python = ENVIRONMENTS / package / "bin" / "python"
    return python if python.exists() else None


def execute(command, threads, timeout, memory=np.inf):
    """Run a command; None, or why it failed.

    Parameters
    ----------
    command : list
        Its words.
    threads : int
        Of numerical libraries.
    timeout : float
        Seconds.
    memory : float, default=inf
        GiB that it may take.
    """
    with tempfile.TemporaryFile("w+") as printed:
        process = subprocess.Popen(
            [str(word) for word in command],
            env=threads_environment(threads),
            stdout=subprocess.DEVNULL,
            stderr=printed,
        )
        try:
            reason = wait(process, timeout, memory)
        finally:
            process.kill()
            process.wait()
        if reason is None and process.returncode:
            printed.seek(0)
            tail = printed.read()[-200:].strip()
            reason = f"exit status {process.returncode}: {tail}"
    return reason


def wait(process, timeout, memory):
    """Wait for the end of a process; None, or why it must be ended."""
    end = time.monotonic() + timeout
    while process.poll() is None:
        if time.monotonic() > end:
            return f"did not end within {timeout:.0f} s"
        if resident_gib(process) > memory:
            return f"took more than {memory:g} GiB"
        time.sleep(0.05)
    return None


def resident_gib(process):
    """Memory that a process takes now, in GiB; 0 where the system does not tell."""
    try:
        pages = Path(f"/proc/{process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE") / 2**30
    except (OSError, IndexError):
        return 0.0


def free_gib():
    """Memory that is free now, in GiB."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        (kib,) = (x.split()[1] for x in lines if x.startswith("MemAvailable"))
        return int(kib) / 2**20
    except (OSError, ValueError):
        return 8.0


def brief(value):
    """A value for the screen."""
    return f"{value:.6g}" if isinstance(value, float) else value


def make_plan(sizes, draws):
    """Pairs of samples a load and draw: the small ones first, draw by draw."""
    return [(n // 14, draw) for n in sizes for draw in draws]


def parse():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--parts", nargs="+", default=["times", "fits"], help="times, fits, checks")
    add("--peers", nargs="*", default=PEERS, help="packages besides skmtgp")
    add("--settings", nargs="+", default=SETTINGS)
    add("--joints", nargs="+", type=int, default=range(1, 7))
    add("--draws", nargs="+", type=int, default=range(3))
    add("--fit-sizes", nargs="+", type=int, default=[280, 896])
    add("--sizes", nargs="+", type=int, default=SIZES, help="n of the timings")
    add("--threads", type=int, default=2, help="of each package")
    add("--jobs", type=int, default=1, help="fits at a time: at most cores / threads")
    add("--budget-factor", type=float, default=10.0, help="of skmtgp's time")
    add("--budget-min", type=float, default=60.0, help="seconds")
    add("--budget-max", type=float, default=600.0, help="seconds")
    add("--time-budget", type=float, default=20.0, help="seconds of repeated timings")
    add("--results", type=Path, default=RESULTS)
    add("--beside", default="nothing", help="what else runs on the machine, to be told")
    add("--redo", action="store_true", help="measure again what is there")
    arguments = parser.parse_args()
    arguments.plan = make_plan(arguments.fit_sizes, arguments.draws)
    return arguments


def command_line():
    """What was asked for, but for what the results say elsewhere."""
    words = sys.argv[1:]
    if "--beside" in words:
        at = words.index("--beside")
        del words[at : at + 2]
    return words


def main():
    """Measure what is missing."""
    arguments = parse()
    write_machine(
        arguments.results,
        " ".join(["python benchmarks/peers/run.py", *command_line()]),
        threads=arguments.threads,
        beside=arguments.beside,
    )
    runner = Runner(arguments)
    threadpool_limits(arguments.threads)
    parts = {
        "checks": runner.check_all,
        "times": runner.time_all,
        "fits": runner.fit_all,
    }
    for part in arguments.parts:
        parts[part]()


if __name__ == "__main__":
    main()
