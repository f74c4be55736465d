"""What other projects document, for links to it; docs/conf.py asks for it."""

from concurrent.futures import ThreadPoolExecutor
from urllib.request import urlopen

PATIENCE = 5.0  # seconds


def reachable(**urls):
    """The mapping of intersphinx, of the projects whose inventory can be had now.

    Without a network there is none: the documentation is then built without links to
    other projects, and without a warning.
    """
    with ThreadPoolExecutor() as pool:
        up = pool.map(answers, urls.values())
    return {
        name: (urls[name], None) for name, is_up in zip(urls, up, strict=True) if is_up
    }


def answers(url):
    """Whether there is an inventory."""
    try:
        with urlopen(f"{url}objects.inv", timeout=PATIENCE):
            return True
    except OSError:  # of urllib, too
        return False
