"""``python -m skmtgp`` prints what a bug report should tell."""

import argparse
from collections.abc import Sequence

from skmtgp import __version__, show_versions


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the versions, or with ``--version`` that of the package alone."""
    parser = argparse.ArgumentParser(
        prog="python -m skmtgp",
        description="Print the system and the versions of what is installed.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    parser.parse_args(arguments)
    show_versions()


if __name__ == "__main__":
    main()
