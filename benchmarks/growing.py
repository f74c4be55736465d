"""What the benchmarks of growth share: measurements, which are kept one by one."""

import argparse
import csv
import sys
import tracemalloc
from functools import partial
from pathlib import Path
from time import process_time

from threadpoolctl import threadpool_limits

sys.path.append(str(Path(__file__).parents[1] / "docs"))
import stacked

HERE = Path(__file__).parent
LEAST, MOST, ENOUGH = 3, 50, 3.0  # repeats, and seconds after which LEAST are enough
save = partial(stacked.save, dpi=150)  # the plot, also for phones
MEASURED = ["seconds", "bytes"]


def run(doc, name, image, collect_and_draw):
    """Measure what is missing on one thread, and draw.

    Parameters
    ----------
    doc : str
        The module's, for the command line.
    name : str
        Of the file of results.
    image : str
        The plot's among the images of the docs.
    collect_and_draw : callable
        Called with whether the run is short, the file of results and that of the plot.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="into benchmarks/.short")
    parser.add_argument("--fresh", action="store_true", help="measure all again")
    arguments = parser.parse_args()
    table = HERE / (".short" if arguments.short else "results") / name
    path = HERE.parent / "docs" / "images" / image
    if arguments.short:
        path = table.with_suffix(".png")
    if arguments.fresh:
        table.unlink(missing_ok=True)
    with threadpool_limits(1):
        collect_and_draw(arguments.short, table, path)


def collect(path, names, keys, measure):
    """Measure what a file does not have yet; each measurement is kept at once.

    Parameters
    ----------
    path : Path
        A CSV file with the columns `names` and MEASURED.
    names : list of str
        What identifies a row.
    keys : list of tuple
        What to measure.
    measure : callable
        Called with a key; the seconds and bytes.

    Returns
    -------
    found : dict
        Seconds and bytes of each key.
    """
    rows = read(path, names) if path.exists() else {}
    for key in keys:
        words = tuple(map(str, key))
        if words not in rows:
            rows[words] = measure(*key)
            append(path, [*names, *MEASURED], [*key, *rows[words]])
            told = "  ".join(f"{n} {w}" for n, w in zip(names, words, strict=True))
            print(f"{told}: {rows[words][0]:.4g} s, {rows[words][1]} bytes", flush=True)
    return {key: rows[tuple(map(str, key))] for key in keys}


def read(path, names):
    """Seconds and bytes by the words of a key."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        tuple(row[name] for name in names): (float(row["seconds"]), int(row["bytes"]))
        for row in rows
    }


def append(path, head, row):
    """A row at the end of a file that may have to be begun."""
    path.parent.mkdir(exist_ok=True)
    begun = path.exists()
    with path.open("a", newline="") as file:
        csv.writer(file).writerows([row] if begun else [head, row])


def cost(evaluate):
    """Best seconds of the processor, and the most bytes over those that are held."""
    tracemalloc.start()
    evaluate()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    times = []
    while len(times) < LEAST or (len(times) < MOST and sum(times) < ENOUGH):
        begin = process_time()
        evaluate()
        times.append(process_time() - begin)
    return min(times), peak
