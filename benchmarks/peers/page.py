"""Make the pages of benchmarks and their plots from the results, and nothing else.

``docs/benchmarks.md`` is the short page, ``docs/benchmarks_how.md`` says how we
measure, ``docs/benchmarks_tables.md`` has all numbers. Their words are in ``pages``;
what was to be reached goes to ``benchmarks/README.md``.
"""

import argparse
import re
from pathlib import Path
from string import Template

import everyday
import overview
import plots
import tables
from compare import OURS
from goals import goals_text
from results import RESULTS, Table
from sparse_page import SparseResults

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = Path(__file__).parent / "pages"
README = Path(__file__).resolve().parents[1] / "README.md"
BEGIN, END = "<!-- goals: made by page.py -->", "<!-- end of goals -->"


class Results:
    """What has been measured.

    Parameters
    ----------
    folder : Path
        Of the files.
    """

    def __init__(self, folder):
        self.folder = folder
        self.fits, self.timings, self.checks, self.real = (
            Table(kind, folder).select()
            for kind in ("fits", "timings", "checks", "real_data")
        )
        self.sparse = SparseResults(folder)


def pages(results):
    """The text of each page, by its name."""
    values = {
        "benchmarks": overview.values(results),
        "benchmarks_how": how(results),
        "benchmarks_tables": every_table(results),
    }
    return {
        f"{name}.md": filled((PAGES / f"{name}.md").read_text("utf-8"), of_page)
        for name, of_page in values.items()
    }


def filled(template, values):
    """A page, with one empty line where a value is empty."""
    text = Template(template).substitute(values)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip("\n") + "\n"


def how(results):
    """What the page on measuring has from the results."""
    rows = [*results.fits, *results.timings, *results.checks]
    sparse = [*results.sparse.timings, *results.sparse.peers]
    return {
        "jitter": joined(tables.jitter_section(results.fits)),
        "checks": joined(tables.checks_section(results.checks)),
        "everyday_sets": everyday.sets_table(results.real),
        "failures": joined(tables.failures_section(rows)) or "None.",
        "machine": tables.machine_section(results.folder, [*rows, *sparse]),
    }


def every_table(results):
    """What the appendix has."""
    return {
        "timings": joined(tables.timings_section(results.timings)),
        "fits": joined(tables.fits_section(results.fits)),
        "errors": joined(tables.errors_section(results.fits)),
        "error_table": overview.error_table(overview.error_rows(results)),
        "everyday": joined(everyday.tables(results.real)),
        "sparse": joined(results.sparse.section()),
        "own": joined(tables.own_section(results.folder)),
    }


def joined(parts):
    """Paragraphs and tables, one below the other."""
    return "\n".join(parts).rstrip("\n")


def with_goals(readme, results):
    """The README, with what was to be reached and what was."""
    before, _, rest = readme.partition(BEGIN)
    after = rest.partition(END)[2]
    return f"{before}{BEGIN}\n\n{goals_text(results)}\n\n{END}{after}"


def main():
    """Write the pages and the plots."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--docs", type=Path, default=DOCS)
    parser.add_argument("--no-plots", action="store_true", help="the words alone")
    arguments = parser.parse_args()
    results = Results(arguments.results)
    arguments.docs.mkdir(parents=True, exist_ok=True)
    for name, text in pages(results).items():
        (arguments.docs / name).write_text(text, "utf-8")
    readme = README if arguments.docs == DOCS else arguments.docs / "README.md"
    readme.write_text(with_goals(README.read_text("utf-8"), results), "utf-8")
    if not arguments.no_plots:
        plots.draw(results, arguments.docs / "images")
    peers = len({r["package"] for r in results.fits} - {OURS})
    print(f"{arguments.docs}: {len(results.fits)} fits, {peers} peers")


if __name__ == "__main__":
    main()
