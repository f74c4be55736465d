"""Pieces of the page."""

import numpy as np

MISSING = "missing"
IMAGES = "images"


def table(head, rows, others="--:"):
    """A Markdown table; all columns but the first to the right, or as told."""
    lines = [head, ["---"] + [others] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


def error(value):
    """An nMSE."""
    return MISSING if absent(value) else f"{value:.1e}"


def number(value, digits=3):
    """A number with a few significant digits."""
    if absent(value):
        return MISSING
    if value and not 1e-2 <= abs(value) < 1e5:
        return f"{value:.1e}"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"


def absent(value):
    """Whether there is no number."""
    return value is None or np.isnan(value)


def image(name, text):
    """A plot of the page."""
    return f"![{text}]({IMAGES}/{name})\n"


def made_by(command):
    """What a section comes from."""
    return f"Measured by `python examples/paper/{command}.py`.\n"
