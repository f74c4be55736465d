"""How close the packages' models on docs/migrating.md and docs/kriging.md come to ours.

Each ``docs/migrating/*_model.py`` runs in its package's environment (``make
bench-envs``); the example that follows it on the page, or the last one before it, runs
here. Their predictions are compared, ours without what the rows leave open of F, which
the others do not count. Ends with 1 where one differs by more than 0.05 standard
deviations.
"""

import argparse
import json
import re
import subprocess
import sys
from contextlib import ExitStack
from doctest import DocTestParser
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
SNIPPETS = ROOT / "docs" / "migrating"
PAGES = ROOT / "docs" / "migrating.md", ROOT / "docs" / "kriging.md"
PARTS = re.compile(
    r"\{literalinclude\} migrating/(?P<peer>\w+)_model\.py"
    r"|```\{doctest\}\n(?P<example>.*?)```",
    re.DOTALL,
)
RUN = """
import json, runpy, sys
found = runpy.run_path(sys.argv[1])
print(json.dumps([list(found["mean"]), list(found["std"])]))
"""
TOLERANCE = 0.05


def pairs(page):
    """Name of each package, and mean and std of the example that is the same."""
    sys.path.insert(0, str(SNIPPETS))
    names, peer = {"np": np, "pd": pd}, None
    for part in PARTS.finditer(page):
        if not part["peer"]:
            for line in DocTestParser().get_examples(part["example"]):
                exec(line.source, names)
        if peer:
            yield peer, np.array([names["mean"], names["std"]])
        peer = part["peer"]
    if peer:
        yield peer, np.array([names["mean"], names["std"]])


def peers_predictions(peer, python):
    """Mean and standard deviation that a package's snippet ends with."""
    command = [python, "-W", "ignore", "-c", RUN, f"{peer}_model.py"]
    run = subprocess.run(
        command, cwd=SNIPPETS, stdout=subprocess.PIPE, text=True, check=True
    )
    return np.array(json.loads(run.stdout.splitlines()[-1]))


def main():
    """Print the differences."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=Path, default=ROOT / "benchmarks" / ".envs")
    envs, worst = parser.parse_args().envs, 0.0
    print("largest differences, in standard deviations")
    print(f"{'':10}{'mean':>10}{'std':>10}")
    with ExitStack() as known:  # theta, as it is to the others
        for path in ("multitask.with_open_rows", "_estimators.fitted.with_growth"):
            known.enter_context(patch(f"skmtgp.{path}", lambda problem, mode, _: mode))
        found = [pair for page in PAGES for pair in pairs(page.read_text("utf-8"))]
    for peer, ours in found:
        python = envs / peer / "bin" / "python"
        if not python.exists():
            print(f"{peer:10}not installed")
            continue
        apart = np.abs(peers_predictions(peer, python) - ours) / ours[1]
        print(f"{peer:10}{apart[0].max():10.1e}{apart[1].max():10.1e}", flush=True)
        worst = max(worst, apart.max())
    return int(worst > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
