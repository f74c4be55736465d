"""Build the part of the Puma 560 data that is bundled with the package.

Run ``python datasets/puma560/build.py`` with the extra ``puma`` installed. The
same arrays come out each time on one machine; another machine's mathematical
library may change the last digits.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from skmtgp.datasets import _store as store
from skmtgp.datasets import fetch_puma560
from skmtgp.datasets._loads import N_LOADS
from skmtgp.datasets._puma560 import BUNDLED, bundled_path
from skmtgp.datasets._whole import LABELS

# Rows of each load: as many as two million bytes hold.
N_PER_LOAD = {"train": 200, "interpolation": 180, "extrapolation": 340}


def bundled_arrays(data_home=None):
    """Arrays of the bundled file.

    Parameters
    ----------
    data_home : path-like, default=None
        Where the whole data are kept.

    Returns
    -------
    arrays : dict of str to ndarray
        For each subset ``x`` (15, n, 18), ``torque`` (15, n, 6) and ``trajectory``
        (15, n), the position of the label among p1s1..p4s4; and ``loads`` (15, 21).
    """
    arrays = {}
    for subset, n in N_PER_LOAD.items():
        puma = fetch_puma560(subset=subset, n_per_load=n, data_home=data_home)
        arrays[f"{subset}_x"] = puma.data[:, :-1].reshape(N_LOADS, n, -1)
        arrays[f"{subset}_torque"] = puma.target.reshape(N_LOADS, n, -1)
        positions = np.searchsorted(LABELS, puma.trajectory).astype(np.uint8)
        arrays[f"{subset}_trajectory"] = positions.reshape(N_LOADS, n)
    return arrays | {"loads": puma.loads.to_numpy()}


def main():
    """Make the data afresh and write the file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--output", type=Path, default=Path(str(bundled_path())))
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as folder:
        arrays = bundled_arrays(folder)
    store.write(output, arrays, BUNDLED, compress=True)
    print(f"{output}: {output.stat().st_size} bytes, sha256:")
    print(store.digest(arrays, BUNDLED))


if __name__ == "__main__":
    main()
