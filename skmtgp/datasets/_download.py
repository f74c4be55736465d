"""A file from a public address: whole and right, or not there."""

import contextlib
import hashlib
import time
import urllib.request
import warnings
from http.client import HTTPException
from pathlib import Path

from . import _store as store

TIMEOUT = 30.0  # seconds without an answer


class NotThisFileError(OSError):
    """What the address gave is not what was expected."""


def fetch_file(url, path, sha256, *, download=True, n_retries=3, delay=1.0):
    """Content of a file that is kept, and downloaded where it is not there or damaged.

    Parameters
    ----------
    url : str
        Address.
    path : path-like
        Where it is kept; its folder is made if need be.
    sha256 : str
        Its checksum.
    download : bool, default=True
        Whether it may be downloaded.
    n_retries : int, default=3
        How often more, after an address did not answer.
    delay : float, default=1.0
        Seconds between.

    Returns
    -------
    content : bytes
        Of the right checksum.

    Raises
    ------
    OSError
        If it is not there and may not, or cannot, be downloaded.

    Warns
    -----
    UserWarning
        If the kept file is damaged, if the address did not answer at first, or if
        what was downloaded cannot be kept.
    """
    path = Path(path)
    with contextlib.suppress(OSError):
        content = path.read_bytes()
        if _is(content, sha256):
            return content
        what = "is downloaded again" if download else "cannot be used"
        warnings.warn(f"{path} is damaged and {what}.", stacklevel=3)
    if not download:
        raise OSError(
            f"{path} is not there. Set download_if_missing=True, or save {url} there."
        )
    content = _download(url, path, sha256, n_retries, delay)
    try:
        with store.replacing(path) as file:
            file.write(content)
    except OSError as error:
        warnings.warn(
            f"{url} was downloaded, but cannot be kept: {error}. Pass another "
            "data_home, or it is downloaded again each time.",
            stacklevel=3,
        )
    return content


def _download(url, path, sha256, n_retries, delay):
    """The content of an address, tried a few times."""
    for left in range(n_retries, -1, -1):
        try:
            with urllib.request.urlopen(url, timeout=TIMEOUT) as answer:
                content = answer.read()
            if not _is(content, sha256):
                found = hashlib.sha256(content).hexdigest()
                raise NotThisFileError(
                    f"it has the checksum {found}, not {sha256}: the address gives "
                    "another file, or a part of it"
                )
            return content
        except (OSError, HTTPException) as error:
            if not left:
                raise OSError(
                    f"{url} could not be downloaded: {error}. Where there is no "
                    f"network, save it as {path} on a machine that has one."
                ) from error
            warnings.warn(f"{url} did not answer: {error}. Trying again.", stacklevel=4)
            time.sleep(delay)
    raise AssertionError("the last try returns or raises")


def _is(content, sha256):
    return hashlib.sha256(content).hexdigest() == sha256
