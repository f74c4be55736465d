"""What a sparse bound and its gradient cost on a Dask cluster: a model, on paper.

``python benchmarks/dask_model.py`` prints the table of the user guide's page on
parallel work. Its constants are those that ``dask_rows.py`` measured; what a partition
costs its worker, and the network, are assumed.
"""

import argparse
from math import log2

N_TASKS, N_FEATURES, INDUCING = 14, 6, (100, 500)
CASES = [(10**6, 2, 20), (10**7, 10, 40), (10**8, 100, 400), (10**9, 100, 400)]


def cost(n, n_workers, n_parts, m, row, options):
    """Seconds an evaluation, those of Dask and the network, bytes between workers."""
    rows = row * n * m**2 / n_workers
    dask = options.client * n_parts + options.worker * n_parts / n_workers
    out, back = 8 * (N_TASKS + 4.5) * m**2, 8 * N_TASKS * m**2
    network = out * (1 + log2(n_workers)) + back * log2(n_parts)
    others = dask + network / options.network
    return rows + others, others, out * (n_workers - 1) + back * (n_parts - 1)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    row = {"nargs": len(INDUCING), "type": float, "default": [9e-10, 3.2e-10]}
    parser.add_argument("--row", **row, help="c_1 for each m, seconds")
    parser.add_argument("--client", type=float, default=0.025, help="c_2, seconds")
    parser.add_argument("--worker", type=float, default=0.02, help="c_3, seconds")
    parser.add_argument("--network", type=float, default=1e9, help="bytes a second")
    options = parser.parse_args()
    print("rows, workers, partitions, m: MB of a worker; seconds, of these Dask and")
    print("network; MB sent between workers")
    for n, n_workers, n_parts in CASES:
        held = 8 * (N_FEATURES + 3) * n / n_workers
        for m, row in zip(INDUCING, options.row, strict=True):
            seconds, others, sent = cost(n, n_workers, n_parts, m, row, options)
            print(
                f"{n:.0e} {n_workers:4d} {n_parts:4d} {m:4d}: {held / 1e6:6.0f}; "
                f"{seconds:8.1f} {others:6.1f}; {sent / 1e6:8.0f}"
            )


if __name__ == "__main__":
    main()
