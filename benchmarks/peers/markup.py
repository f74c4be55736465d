"""Markdown: tables, the numbers in them, and what a benchmark printed."""

import re
import textwrap

DASH = "-"
WIDTH = 88  # of what is printed
VERDICTS = re.compile(r"^Goals$|\bgoal +is$")  # the tables of goals, at the end
GOAL = re.compile(r" +goal at (?:most|least) \S+: (?:met|NOT MET)$| \(goal: [^)]*\)")


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
    """What a benchmark printed, if it was run, without the goals of development."""
    path = folder / f"{name}.txt"
    if not path.exists():
        return []
    shown = without_goals(path.read_text("utf-8").strip("\n").split("\n"))
    lines = "\n".join(map(folded, shown)).rstrip("\n")
    return [f"{title} (`python benchmarks/{name}.py`):\n", f"```text\n{lines}\n```\n"]


def without_goals(lines):
    """What was measured alone: no verdicts, no columns of goals."""
    kept, column = [], None
    for line in lines:
        if VERDICTS.search(line):
            break
        column = goal_column(line) or column
        if column:
            line = line[: column.start] + line[column.stop :]
        kept.append(GOAL.sub("", line))
    return kept


def goal_column(line):
    """Where a table has its goals, by the line of its names."""
    found = re.search(r" +goal(?= )", line)
    return slice(*found.span()) if found and ":" not in line else None


def folded(line):
    """A long line of prose, such as a warning, as several; a table's stays."""
    if len(line) <= WIDTH or "  " in line.strip():
        return line
    return textwrap.fill(line, WIDTH, subsequent_indent="    ")
