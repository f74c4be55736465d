"""Markdown: tables, the numbers in them, and what a benchmark printed."""

import textwrap

DASH = "-"
WIDTH = 88  # of what is printed


def number(value, digits=3):
    """A number with a few significant digits, or a dash."""
    if value is None:
        return DASH
    if isinstance(value, int):
        return str(value)
    if value and (abs(value) < 1e-2 or abs(value) >= 1e5):
        return f"{value:.1e}"
    return f"{value:.{digits}g}" if abs(value) < 1000 else f"{value:.0f}"


def table(head, rows, others="--:"):
    """A Markdown table; all columns but the first to the right, or as told."""
    lines = [head, ["---"] + [others] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


def printed(folder, name, title):
    """What a benchmark printed, if it was run."""
    path = folder / f"{name}.txt"
    if not path.exists():
        return []
    lines = "\n".join(map(folded, path.read_text().strip("\n").split("\n")))
    return [f"{title} (`python benchmarks/{name}.py`):\n", f"```text\n{lines}\n```\n"]


def folded(line):
    """A long line, a warning, as several."""
    if len(line) <= WIDTH:
        return line
    return textwrap.fill(line, WIDTH, subsequent_indent="    ")
