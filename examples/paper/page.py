"""Make docs/paper.md, docs/paper_details.md and their plots from the results alone.

Run ``python examples/paper/page.py``. Missing results are shown as missing. Results of
another folder are shown on pages in that folder. The goals go to
``examples/paper/README.md``.
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
    overview,
    plots,
    table2,
)
from reporting.markdown import MISSING, table

DOCS = Path(__file__).resolve().parents[2] / "docs"
README = Path(__file__).parent / "README.md"
BEGIN, END = "<!-- goals: made by page.py -->", "<!-- end of goals -->"
INTRODUCTION = """\
# The paper's experiments in detail

This page repeats the experiments in section 6 of Chai, Williams, Klanke and
Vijayakumar, *Multi-task Gaussian Process Learning of Robot Inverse Dynamics* (NIPS
2008). It also tests two claims of section 3 for which the paper has no experiments.
[The short page](paper.md) has the paper's numbers beside ours. `make paper` measures
everything, and `make paper-page` makes these pages from `examples/paper/results` alone.

The nMSE is the mean squared error divided by the variance of the test targets, averaged
over loads. Interpolation is tested on 4000 samples of each load, from the trajectories
of its training data. Extrapolation is tested on 60,000 samples of each load from all 16
trajectories.
"""
DATA = """\
## Where the data differ from the paper's

The paper's data are not published, so only orders of magnitude can be compared.

- **Loads.** The masses are the paper's, 0.2 to 3.0 kg. The paper does not give the
  sizes and places of the cuboids, so we draw them at random. A *draw*, the
  `random_state` of `fetch_puma560`, determines them and the training samples.
- **Subsets.** The paper selects the samples of each n independently. Here, within a
  draw, a larger n includes the samples of a smaller one. Only draws are independent.
- **Trajectories.** Places, rotations and speeds of the four paths are the paper's. We
  chose the shape of the figure eight and the direction of the tool, which stays the
  same. With a tool that does not turn, only a load's mass and its first moments change
  the torques.
- **Torques.** Pinocchio computes them from the published parameters of the Puma 560,
  with viscous and Coulomb friction against the motion. The toolbox of 2008 handles
  friction differently. It uses the sign of the gear ratio, which reverses friction at
  joints 1 and
  3. It applies the ratio only once, which makes viscous friction far weaker.
- **Noise.** There is none. The paper mentions none, and its errors down to 3e-9 leave
  little room for it.
- **Learning.** Model, kernel and criterion are the paper's. The search for the mode is
  more thorough, see *Learning in stages*.
"""


def make(results=store.RESULTS, docs=None, draw=True):
    """Write the pages, the goals and the plots."""
    docs = docs or (DOCS if results == store.RESULTS else results)
    everything = {name: store.read(name, results) for name in store.KEYS}
    rows = {name: store.measured(table) for name, table in everything.items()}
    docs.mkdir(parents=True, exist_ok=True)
    (docs / "paper.md").write_text(overview.page(rows), "utf-8")
    (docs / "paper_details.md").write_text(details(rows, everything, results), "utf-8")
    readme = README if docs == DOCS else docs / "README.md"
    readme.write_text(with_goals(README.read_text("utf-8"), rows), "utf-8")
    if draw:
        plots.draw(rows, docs / "images")
    print("paper.md:", *(f"{name} {len(t)} rows," for name, t in rows.items()))


def details(rows, everything, results):
    """The page with all numbers."""
    parts = [
        INTRODUCTION,
        *table2.section(rows["table2"]),
        *figure4_section.section(rows["figure4"]),
        *learning.section(rows["learning"]),
        *novel_task.section(rows["novel_task"]),
        DATA,
        *units_section(everything),
        *failures_section(everything),
        *machine_section(results),
    ]
    return "\n".join(parts)


def with_goals(readme, rows):
    """The README, with what was to be reached and what was."""
    before, _, rest = readme.partition(BEGIN)
    text = "\n".join(goals.section(all_goals(rows)))
    return f"{before}{BEGIN}\n\n{text}\n{END}{rest.partition(END)[2]}"


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
    note = "A unit is one fit or one search over ranks, with its tests.\n"
    return ["## What was measured\n", note, table(head, lines)]


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
    note = "A plus after a commit means that the package differed from this commit.\n"
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
    parser.add_argument("--no-plots", action="store_true", help="the words alone")
    arguments = parser.parse_args()
    make(arguments.results, arguments.docs, draw=not arguments.no_plots)


if __name__ == "__main__":
    main()
