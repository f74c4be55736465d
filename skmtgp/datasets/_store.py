"""Arrays in a file that is either whole or not there, and known to be right."""

import hashlib
import io
import os
import secrets
from pathlib import Path

import numpy as np

DIGEST = "sha256"


class DamagedFileError(ValueError):
    """The file is not what was once written."""


def digest(arrays):
    """SHA-256 of the names, shapes, types and values of arrays.

    Parameters
    ----------
    arrays : dict of str to ndarray
        The arrays; their order does not matter.

    Returns
    -------
    digest : str
        64 hexadecimal digits.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._store import digest
    >>> digest({"a": np.zeros(2)})[:8]
    'ff8a4d3f'
    """
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.reshape(-1).view(np.uint8).data)
    return total.hexdigest()


def write(path, arrays, compress=False):
    """Write arrays with their checksum as one npz file, all or nothing.

    The file is written beside its place and moved there when it is complete, so
    that neither an interruption nor a second process leaves half of one.

    Parameters
    ----------
    path : path-like
        Where to; its folder is made if need be.
    arrays : dict of str to ndarray
        The arrays, none of objects.
    compress : bool, default=False
        Whether to compress the file.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from skmtgp.datasets import _store as store
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store.write(f"{folder}/a.npz", {"a": np.arange(3)})
    ...     store.read(f"{folder}/a.npz")["a"].tolist()
    [0, 1, 2]
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    save = np.savez_compressed if compress else np.savez
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:
            save(file, **arrays, **{DIGEST: np.array(digest(arrays))})
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def read(path):
    """Read the arrays of a file and check them.

    Parameters
    ----------
    path : path-like
        A file of :func:`write`.

    Returns
    -------
    arrays : dict of str to ndarray
        The arrays written.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    DamagedFileError
        If it is cut short, changed, or no such file at all.
    """
    content = io.BytesIO(Path(path).read_bytes())
    # Damage shows as almost any error, depending on the byte it hits.
    try:
        with np.load(content, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:
        raise DamagedFileError(f"{path} cannot be read: {error}") from error
    expected = arrays.pop(DIGEST, None)
    if expected is None or str(expected) != digest(arrays):
        raise DamagedFileError(f"{path} does not have the checksum it was given")
    return arrays
