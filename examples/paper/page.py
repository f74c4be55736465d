"""Make docs/paper.md and its plots from the results, and from nothing else.

``python examples/paper/page.py``; what is missing is shown as missing. Results of
another folder are shown on a page in that folder.
"""

import argparse
import json
from pathlib import Path

from measuring import store
from reporting import (
    figure4,
    figure4_section,
    goals,
    learning,
    novel_task,
    plots,
    table2,
)
from reporting.markdown import MISSING, table

DOCS = Path(__file__).resolve().parents[2] / "docs"
INTRODUCTION = """\
# The paper's experiments

Section 6 of Chai, Williams, Klanke and Vijayakumar, *Multi-task Gaussian Process
Learning of Robot Inverse Dynamics* (NIPS 2008), done again with this package, and two
claims of its section 3 that it gives no experiments for. `make paper` measures all of
it anew; this page is made by `make paper-page` from `examples/paper/results` alone, and
what is missing there is missing here. nMSE is the mean squared error over the variance
of the test targets, averaged over loads; interpolation is tested on 4000 samples of
each load, from the trajectories that it was trained on, extrapolation on 60,000 from
all 16.
"""
DATA = """\
## Where the data differ from the paper's

The paper's data are not published, so that numbers can be compared in size only.

- **Loads.** Masses are the paper's, 0.2 to 3.0 kg; sizes and places of the cuboids are
  not given there and are drawn at random. A draw, `random_state` of `fetch_puma560`,
  draws them and the training samples.
- **Subsets.** The paper selects the samples of each n independently. Here those of a
  small n are among those of a larger one of the same draw; only draws are independent.
- **Trajectories.** Places, rotations and speeds of the four paths are the paper's; the
  shape of the eight and the direction of the tool, which stays the same, are chosen.
  With a tool that does not turn, a load shows by its mass and its first moments only.
- **Torques.** Computed by Pinocchio from the Puma 560's published parameters, with
  viscous and Coulomb friction against the motion. The toolbox of 2008 takes the gear
  ratio with its sign, which turns friction around at joints 1 and 3, and only once,
  which makes viscous friction far weaker.
- **Noise.** None. The paper names none; its errors down to 3e-9 leave little room.
- **Learning.** Same model, kernel and criterion; the search for the mode goes further
  than the paper's, see *Learning in stages*.
"""


def make(results=store.RESULTS, docs=None):
    """Write the page and the plots."""
    docs = docs or (DOCS if results == store.RESULTS else results)
    everything = {name: store.read(name, results) for name in store.KEYS}
    rows = {name: store.measured(table) for name, table in everything.items()}
    parts = [
        INTRODUCTION,
        *goals.section(all_goals(rows)),
        *table2.section(rows["table2"]),
        *figure4_section.section(rows["figure4"]),
        *learning.section(rows["learning"]),
        *novel_task.section(rows["novel_task"]),
        DATA,
        *units_section(everything),
        *failures_section(everything),
        *machine_section(results),
    ]
    docs.mkdir(parents=True, exist_ok=True)
    (docs / "paper.md").write_text("\n".join(parts))
    plots.draw(rows, docs / "images")
    print("paper.md:", *(f"{name} {len(t)} rows," for name, t in rows.items()))


def all_goals(rows):
    """Of all experiments."""
    return [
        *table2.goals(rows["table2"]),
        *figure4.goals(rows["figure4"]),
        *novel_task.goals(rows["novel_task"]),
    ]


def units_section(everything):
    """How much there is, and what warned."""
    lines = []
    for name, rows in everything.items():
        units = rows.drop_duplicates(list(store.KEYS[name]))
        warned = units["warned"].str.split().explode().value_counts()
        words = ", ".join(f"{kind} {count}" for kind, count in warned.items())
        hours = units["seconds"].sum() / 3600.0
        failed = len(store.failed(units))
        lines.append([name, len(units), failed, f"{hours:.2f}", words or "-"])
    head = ["experiment", "units", "failed", "hours of one core", "units that warned"]
    return ["## What was measured\n", table(head, lines)]


def failures_section(everything):
    """What did not work, and why."""
    lines = [
        [name, " ".join(f"{k}={row[k]}" for k in store.KEYS[name]), reason(row)]
        for name, rows in everything.items()
        for row in store.failed(rows).to_dict("records")
    ]
    return (
        ["Failed:\n", table(["experiment", "unit", "reason"], lines)] if lines else []
    )


def reason(row):
    """An error, fit for a table."""
    return row["error"].replace("|", "/")[:160]


def machine_section(results):
    """Processor and versions, then commands and commits."""
    path = results / "machine.json"
    runs = json.loads(path.read_text()) if path.exists() else {}
    every = [(name, run) for name, of_name in runs.items() for run in of_name]
    machines = list(dict.fromkeys(machine_words(run) for _, run in every))
    lines = [f"- Machine {i}: {m}" for i, m in enumerate(machines, start=1)]
    lines += [
        f"- {name}: `{run['command']}` at {run['commit']}, begun {run['begun']} UTC, "
        f"machine {machines.index(machine_words(run)) + 1}"
        for name, run in every
    ]
    note = "A commit with a plus: the package differed from it.\n"
    text = "\n".join(lines) + "\n" if lines else f"{MISSING}\n"
    return ["## Where it was measured\n", text, note]


def machine_words(run):
    """Processor and versions of a run."""
    versions = ", ".join(f"{k} {v}" for k, v in run["versions"].items())
    return (
        f"{run['processor']}, {run['cores']} cores, {run['memory_gib']} GiB, "
        f"{run['system']}, Python {run['python']}, {versions}"
    )


def main():
    """Parse the command line and make the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=store.RESULTS)
    parser.add_argument("--docs", type=Path, help="folder of the page")
    arguments = parser.parse_args()
    make(arguments.results, arguments.docs)


if __name__ == "__main__":
    main()
