"""Compare skmtgp's bound with the sparse models of GPyTorch and GPflow.

``python benchmarks/peers/sparse_run.py`` measures what benchmarks/results does not have
yet. Its parts are

- checks: each package's own bound against the textbook formulae, and with all inputs
  inducing against the exact likelihood;
- times: seconds and memory of one evaluation of the bound with its gradient;
- fits: from the mode at which skmtgp begins to climb the bound, for a budget of time.

`inducing.py` says which inducing points the others get. skmtgp's own fits are those of
`sparse_fits.py`.
"""

import argparse
from pathlib import Path

from inducing import SETTINGS, inducing_points
from prepare import load_case
from problem import load_problem
from reference import Posterior, normalized_mean_squared_error
from results import RESULTS, write_machine
from run import (
    ABSENT,
    GRACE,
    OURS,
    PROBLEMS,
    WAIT,
    Runner,
    StoredCase,
    command_line,
    save,
)
from sparse_prepare import (
    learned_problem,
    part_problem,
    random_sparse_problem,
    start_of,
    whole_problem,
)
from sparse_reference import SparsePosterior
from threadpoolctl import threadpool_limits

from skmtgp.learning.tuning import TUNING

PEERS = ("gpytorch", "gpflow")
SIZES, INDUCING, LOADS = (10_000, 56_000), (500, 1000, 1500), 14
CHECK_INDUCING = 50


class SparseRunner(Runner):
    """Runs the sparse models' adapters and writes rows."""

    kinds = "sparse_checks", "sparse_timings", "sparse_peers"
    adapter = "sparse_adapter"

    def __init__(self, arguments):
        super().__init__(arguments)
        self.memory = arguments.memory
        self.variants = [(p, s) for p in arguments.peers for s in arguments.settings]

    def limit(self, budget):
        """Seconds after which an adapter is ended."""
        return max(WAIT * budget + GRACE, self.arguments.time_limit)

    # Checks

    def check_all(self):
        """Whether each package's bound is the reference's, or the exact likelihood."""
        case = StoredCase(20, self.arguments.joints[0], 0)
        problem = load_problem(case.problem_path)
        key = {**case.key, "m": len(problem.y)}
        self.check_one(key, whole_problem(problem), exact)
        key["m"] = CHECK_INDUCING
        self.check_one(key, part_problem(problem, CHECK_INDUCING), sparse)

    def check_one(self, key, problem, likelihood):
        """All packages on one problem; likelihood(parameters, problem, settings)."""
        path = PROBLEMS / f"sparse-check-{key['joint']}-{key['m']}.npz"
        save(problem, path)
        for package, settings in [(OURS, "inputs"), *self.variants]:
            parameters, _, report = self.adapt(package, settings, "check", path, 60.0)
            if parameters is not None:
                value = likelihood(parameters, problem, settings)
                report |= {"likelihood": value}
                report["difference"] = report["own_likelihood"] - value
            row = {"package": package, "settings": settings, **key}
            self.append("sparse_checks", row, report)

    # Seconds and memory of an evaluation

    def time_all(self):
        """Every package at every n and m."""
        for n in self.arguments.sizes:
            for m in self.arguments.inducing:
                for package, settings in [(OURS, "inputs"), *self.variants]:
                    key = {"package": package, "settings": settings, "n": n, "m": m}
                    if self.wanted("sparse_timings", **key):
                        self.time_one(key)

    def time_one(self, key):
        """One package at one n and m, unless it failed with less."""
        failed = self.failed_with_less(key)
        if failed:
            reason = f"not tried: n = {failed['n']}, m = {failed['m']} failed"
            return self.append("sparse_timings", key, {"error": reason})
        path = PROBLEMS / f"sparse-random-{key['n']}-{key['m']}.npz"
        if not path.exists():
            save(random_sparse_problem(key["n"], key["m"]), path)
        budget = self.arguments.time_budget
        _, _, report = self.adapt(key["package"], key["settings"], "cost", path, budget)
        return self.append("sparse_timings", key, report)

    def failed_with_less(self, key):
        """A smaller problem at which this package failed, or None."""
        same = {name: key[name] for name in ("package", "settings")}
        n, m = key["n"], key["m"]
        for row in self.tables["sparse_timings"].select(**same):
            less = row["n"] <= n and row["m"] <= m and (row["n"], row["m"]) != (n, m)
            if less and row.get("error", ABSENT) != ABSENT:
                return row
        return None

    # Fits

    def fit_all(self):
        """Every peer on every joint."""
        a = self.arguments
        for m in a.fit_inducing:
            for joint in a.joints:
                key = {"n": LOADS * a.n_per_load, "m": m, "rank": a.rank}
                key |= {"joint": joint, "draw": a.draw}
                for package, settings in self.variants:
                    row = {"package": package, "settings": settings, **key}
                    if self.wanted("sparse_peers", **row):
                        self.fit_one(row)

    def fit_one(self, key):
        """One package on one problem; each round has new inducing points."""
        problem, rounds = load_problem(self.fit_problem(key)), []
        package, settings = key["package"], key["settings"]
        path = PROBLEMS / f"sparse-round-{package}-{settings}.npz"
        budget = self.arguments.budget / TUNING.rounds
        for _ in range(TUNING.rounds):
            save(problem, path)
            parameters, _, report = self.adapt(package, settings, "fit", path, budget)
            if parameters is None:
                return self.append("sparse_peers", key, report)
            rounds.append((report, parameters, problem))
            problem = learned_problem(problem, parameters, key["m"])
        return self.append("sparse_peers", key, self.best(rounds, key))

    def best(self, rounds, key):
        """The report of the round with the highest bound, with the time of all."""
        reports = [report for report, _, _ in rounds]
        best, parameters, problem = max(rounds, key=lambda r: r[0]["own_likelihood"])
        spent = {k: sum(r[k] for r in reports) for k in ("seconds", "evaluations")}
        spent["peak_mib"] = max(report["peak_mib"] for report in reports)
        scores = self.score(parameters, problem, key)
        return {**best, **spent, "budget": self.arguments.budget, **scores}

    def fit_problem(self, key):
        """The file of a problem, made once."""
        words = [str(key[name]) for name in ("n", "m", "rank", "joint", "draw")]
        path = PROBLEMS / f"sparse-{'-'.join(words)}.npz"
        if not path.exists():
            train = load_case(key["n"] // LOADS, key["joint"], key["draw"], 1).train
            save(start_of(train, key["m"], key["rank"]), path)
        return path

    def score(self, parameters, problem, key):
        """Bound and errors by the reference implementation, on the whole test sets."""
        points = inducing_points(problem, key["settings"])
        posterior = SparsePosterior(parameters, problem, points)
        scores = {
            "bound": posterior.bound,
            "n_inducing": len(points),
            "jitter": posterior.jitter,
            "noise": float(parameters.noise),
        }
        n, rows = key["n"] // LOADS, self.arguments.test_rows
        case = load_case(n, key["joint"], key["draw"], rows)
        for subset in ("interpolation", "extrapolation"):
            u, tasks, y = getattr(case, subset)
            error = normalized_mean_squared_error(y, posterior.mean(u, tasks), tasks)
            scores[f"nmse_{subset}"] = error
        return scores


def exact(parameters, problem, _):
    """The log marginal likelihood."""
    return Posterior(parameters, problem).log_marginal_likelihood


def sparse(parameters, problem, settings):
    """The bound."""
    points = inducing_points(problem, settings)
    return SparsePosterior(parameters, problem, points).bound


def parse():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--parts", nargs="+", default=["checks", "times"], help="checks, times, fits")
    add("--peers", nargs="*", default=PEERS)
    add("--settings", nargs="+", default=SETTINGS)
    add("--sizes", nargs="+", type=int, default=SIZES, help="n of the timings")
    add("--inducing", nargs="+", type=int, default=INDUCING, help="m of the timings")
    add("--joints", nargs="+", type=int, default=[4])
    add("--draw", type=int, default=0)
    add("--n-per-load", type=int, default=4000, help="of the fits")
    add("--fit-inducing", nargs="+", type=int, default=[500], help="m of the fits")
    add("--rank", type=int, default=5, help="of the fits")
    add("--test-rows", type=int, help="of each load; all if not given")
    add("--threads", type=int, default=1, help="of each package")
    add("--budget", type=float, default=1800.0, help="seconds of a fit")
    add("--time-budget", type=float, default=20.0, help="seconds of repeated timings")
    add("--time-limit", type=float, default=1800.0, help="seconds, of an adapter")
    add("--memory", type=float, default=16.0, help="GiB that a package may take")
    add("--results", type=Path, default=RESULTS)
    add("--beside", default="nothing", help="what else runs on the machine, to be told")
    add("--redo", action="store_true", help="measure again what is there")
    return parser.parse_args()


def main():
    """Measure what is missing."""
    arguments = parse()
    write_machine(
        arguments.results,
        " ".join(["python benchmarks/peers/sparse_run.py", *command_line()]),
        threads=arguments.threads,
        beside=arguments.beside,
    )
    threadpool_limits(arguments.threads)
    runner = SparseRunner(arguments)
    parts = {
        "checks": runner.check_all,
        "times": runner.time_all,
        "fits": runner.fit_all,
    }
    for part in arguments.parts:
        parts[part]()


if __name__ == "__main__":
    main()
