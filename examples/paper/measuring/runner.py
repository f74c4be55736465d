"""Run an experiment: what its file does not have yet, on all cores."""

import argparse
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from sklearn.utils.parallel import Parallel, delayed
from threadpoolctl import threadpool_limits

from .data import Source
from .machine import record
from .store import KEYS, RESULTS, Table, read

SHORT_ITERATIONS = 15


@dataclass(frozen=True)
class Option:
    """Integers of the command line: as in the paper, and in a short run."""

    default: tuple
    short: tuple
    help: str


@dataclass(frozen=True)
class Setting:
    """What all units of a run share."""

    source: Source = field(default_factory=Source)
    max_iter: int | None = None  # None is the models' own


@dataclass(frozen=True)
class Experiment:
    """What is measured.

    Attributes
    ----------
    name : str
        Of its file.
    summary : str
        One line.
    options : dict of str to Option
        By name.
    stages : sequence of callable
        Each gives, from the arguments and the rows so far, a list of units: dicts with
        the key and what else `measure` needs.
    measure : callable
        Gives the rows of a unit, from it and the setting.
    """

    name: str
    summary: str
    options: dict
    stages: tuple[Callable, ...]
    measure: Callable


def main(experiment, argv=None, command=None):
    """Parse the command line and measure what is missing."""
    argv = sys.argv[1:] if argv is None else argv
    arguments = parse(experiment, argv)
    command = command or public(f"python examples/paper/{experiment.name}.py", argv)
    Run(experiment, arguments, command).all_stages()


def parse(experiment, argv):
    """The command line of an experiment."""
    parser = common_parser(experiment.summary)
    for name, option in experiment.options.items():
        flag, words = "--" + name.replace("_", "-"), map(str, option.default)
        text = f"{option.help} (default: {' '.join(words)})"
        parser.add_argument(flag, nargs="+", type=int, help=text)
    arguments = parser.parse_args(argv)
    for name, option in experiment.options.items():
        default = option.short if arguments.short else option.default
        if getattr(arguments, name) is None:
            setattr(arguments, name, list(default))
    return with_results(arguments)


def parse_common(summary, argv):
    """The command line of all experiments."""
    return with_results(common_parser(summary).parse_args(argv))


def common_parser(summary):
    """Options of every command."""
    parser = argparse.ArgumentParser(description=summary, allow_abbrev=False)
    add = parser.add_argument
    add("--short", action="store_true", help="tiny, into the folder results/short")
    add("--retry", action="store_true", help="measure failed units again")
    add("--n-jobs", type=int, default=-1, help="processes; -1 is all cores")
    add_private(parser)
    return parser


def add_private(parser):
    """Options whose values are paths of this machine."""
    parser.add_argument("--results", type=Path, help="folder of the results")
    parser.add_argument("--data-home", help="folder of the stored data")


def with_results(arguments):
    """The arguments with the folder of the results."""
    default = RESULTS / "short" if arguments.short else RESULTS
    arguments.results = arguments.results or default
    return arguments


def public(command, argv):
    """The command without paths of this machine."""
    private = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_private(private)
    _, rest = private.parse_known_args(argv)
    return " ".join([command, *rest])


class Run:
    """A run of an experiment.

    Parameters
    ----------
    experiment : Experiment
        What is measured.
    arguments : Namespace
        From the command line.
    command : str
        To be recorded.
    """

    def __init__(self, experiment, arguments, command):
        self.experiment, self.arguments = experiment, arguments
        self.command = command
        self.table = Table(experiment.name, arguments.results)
        self.setting = Setting(
            Source(arguments.data_home, bundled=arguments.short),
            SHORT_ITERATIONS if arguments.short else None,
        )
        self.begun = time.perf_counter()
        self.n_failed = 0

    def all_stages(self):
        """One after another, for later ones may need the rows of earlier ones."""
        for stage in self.experiment.stages:
            rows = read(self.experiment.name, self.arguments.results)
            self.measure_all(stage(self.arguments, rows))
        if self.n_failed:
            print(f"{self.n_failed} units failed; --retry measures them again.")

    def measure_all(self, units):
        """Those that are missing, in this order."""
        failed = set() if self.arguments.retry else self.table.failed
        skipped = self.table.done | failed
        missing = [u for u in units if self.table.key(u) not in skipped]
        there = f"{len(units) - len(missing)} of {len(units)} units are there"
        print(f"{self.experiment.name}: {there}", flush=True)
        if missing:
            name, n_jobs = self.experiment.name, self.arguments.n_jobs
            record(self.arguments.results, name, self.command, n_jobs)
            self.setting.source.prepare(sorted({u["draw"] for u in missing}))
            self.in_parallel(missing)

    def in_parallel(self, units):
        """Measure units; write and report each as soon as it is known."""
        measure, setting = self.experiment.measure, self.setting
        jobs = (delayed(attempt)(measure, unit, setting) for unit in units)
        parallel = Parallel(
            self.arguments.n_jobs, return_as="generator_unordered", batch_size=1
        )
        for i, (unit, rows) in enumerate(parallel(jobs), start=1):
            self.table.append(unit, rows)
            self.report(f"[{i}/{len(units)}]", unit, rows)

    def report(self, position, unit, rows):
        """One line."""
        name, error = self.experiment.name, rows[0].get("error", "")
        self.n_failed += bool(error)
        key = [f"{k}={unit[k]}" for k in KEYS[name]]
        minutes = (time.perf_counter() - self.begun) / 60.0
        took = f"{rows[0]['seconds']:.1f} s, {minutes:.1f} min in all"
        print(position, name, *key, took, error or rows[0]["warned"], flush=True)


def attempt(measure, unit, setting):
    """The rows of a unit, or one row that says why there are none."""
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught, threadpool_limits(1):
        warnings.simplefilter("always")
        try:
            rows = measure(unit, setting)
        except Exception as error:  # recorded, and the other units go on
            traceback.print_exc()
            rows = [{"error": " ".join(f"{type(error).__name__}: {error}".split())}]
    common = {
        "seconds": round(time.perf_counter() - begin, 3),
        "warned": " ".join(sorted({w.category.__name__ for w in caught})),
    }
    return unit, [{**row, **common} for row in rows]
