"""Goals: what was to be reached, what was measured, whether it is reached."""

from typing import NamedTuple

from .markdown import table

WORDS = {True: "yes", False: "**no**", None: "not measured", "so far": "so far"}


class Goal(NamedTuple):
    """A goal.

    Attributes
    ----------
    text : str
        What it is.
    measured : str
        Figures.
    reached : {True, False, None, "so far"}
        None is not measured; "so far" is on the part that is measured.
    """

    text: str
    measured: str
    reached: bool | str | None


def judge(text, measured, holds, complete):
    """A goal that holds on what is measured, which may not be all."""
    if not measured:
        return Goal(text, "not measured", None)
    return Goal(text, measured, "so far" if holds and not complete else bool(holds))


def section(goals):
    """Goals in a table."""
    rows = [(g.text, g.measured, WORDS[g.reached]) for g in goals]
    note = "*So far*: it holds on what is measured, and some is missing.\n"
    notes = [note] if any(g.reached == "so far" for g in goals) else []
    head = ["goal", "measured", "reached"]
    return [table(head, rows, "---"), *notes]
