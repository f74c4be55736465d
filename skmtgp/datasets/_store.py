"""Arrays in a file that is either whole or not there, and known to be right."""

import contextlib
import hashlib
import io
import os
import secrets
import time
import zipfile
from pathlib import Path

import numpy as np

FORMAT = "skmtgp.datasets 2"  # of the file
STALE = 24 * 3600.0  # seconds since a file was written to, after which nobody does


class DamagedFileError(ValueError):
    """The file is not what was once written, or not what is expected."""


def digest(arrays, what=""):
    """SHA-256 of the names, shapes, types and values of arrays, and of what they are.

    Parameters
    ----------
    arrays : dict of str to ndarray
        The arrays; their order does not matter.
    what : str, default=""
        What they are, such as the seed that they were made with.

    Returns
    -------
    digest : str
        64 hexadecimal digits. The format of the file is part of what they are of.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._store import digest
    >>> digest({"a": np.zeros(2)}, "zeros")[:8]
    '82052461'
    """
    total = hashlib.sha256(f"{FORMAT}\n{what}\n".encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.reshape(-1).view(np.uint8).data)
    return total.hexdigest()


def write(path, arrays, what="", *, compress=False):
    """Write arrays as one npz file with a checksum, all or nothing.

    The file is written beside its place and moved there when it is complete, so
    that neither an interruption nor a second process leaves half of one. The checksum
    is not among the arrays: it is the comment of the zip archive that an npz file is.

    Parameters
    ----------
    path : path-like
        Where to; its folder is made if need be.
    arrays : dict of str to ndarray
        The arrays, none of objects.
    what : str, default=""
        What they are, which reading asks for again.
    compress : bool, default=False
        Whether to compress the file.

    Raises
    ------
    OSError
        If it cannot be written. What was there before is still there.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from skmtgp.datasets import _store as store
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store.write(f"{folder}/a.npz", {"a": np.arange(3)}, "seed 0")
    ...     store.read(f"{folder}/a.npz", "seed 0")["a"].tolist()
    [0, 1, 2]
    """
    save = np.savez_compressed if compress else np.savez
    with replacing(path) as file:
        save(file, **arrays)
        with zipfile.ZipFile(file, "a") as archive:
            archive.comment = _comment(arrays, what)


@contextlib.contextmanager
def replacing(path):
    """Context of a file that is written beside its place, and moved there when whole.

    Parameters
    ----------
    path : path-like
        Its place; its folder is made if need be.

    Yields
    ------
    file : file object
        Open for reading and writing bytes.

    Raises
    ------
    OSError
        If it cannot be written. What was there before is still there.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "x+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):  # the first error is the one to tell
            temporary.unlink(missing_ok=True)
        raise


def _comment(arrays, what):
    return f"{FORMAT} sha256 {digest(arrays, what)}".encode()


def remove_stale(path):
    """Remove what processes that were killed while they wrote a file have left.

    Parameters
    ----------
    path : path-like
        The file. A process that still writes has written to its own within `STALE`
        seconds, and is left alone.
    """
    path = Path(path)
    for temporary in path.parent.glob(f".{path.name}.*.tmp"):
        with contextlib.suppress(OSError):  # another process was faster, or may not
            if time.time() - temporary.stat().st_mtime > STALE:
                temporary.unlink()


def read(path, what="", shapes=None):
    """Read the arrays of a file and check them.

    Parameters
    ----------
    path : path-like
        A file of :func:`write`.
    what : str, default=""
        What the arrays are to be.
    shapes : dict of str to tuple of int, default=None
        Their names and shapes. None is any.

    Returns
    -------
    arrays : dict of str to ndarray
        The arrays written.

    Raises
    ------
    OSError
        If there is no such file, or it may not be read.
    DamagedFileError
        If it is cut short, changed, of other data or shapes, of another version's
        format, or no such file at all.
    """
    comment, arrays = _load(path)
    if comment != _comment(arrays, what):
        raise DamagedFileError(
            f"{path} does not have the checksum of {what or 'its arrays'}: it is "
            "damaged, of other data or of another version"
        )
    found = {name: array.shape for name, array in arrays.items()}
    if shapes is not None and found != shapes:
        raise DamagedFileError(f"{path} holds arrays of shapes {found}, not {shapes}")
    return arrays


def _load(path):
    """The comment and the arrays of a file, unchecked."""
    content = io.BytesIO(Path(path).read_bytes())
    # Damage shows as almost any error, depending on the byte it hits.
    try:
        with np.load(content, allow_pickle=False) as archive:
            return archive.zip.comment, {name: archive[name] for name in archive.files}
    except Exception as error:
        raise DamagedFileError(f"{path} cannot be read: {error}") from error
