"""The order of the examples, their colours, and how they warn, for docs/conf.py."""

import re
import warnings
from pathlib import Path

from skmtgp.inspection import COLORS

INDEX = Path(__file__).parents[1] / "examples" / "gallery" / "index.rst"
ORDER = re.findall(r"^   (plot_\w+)$", INDEX.read_text("utf-8"), re.MULTILINE)


def position(script):
    """Where a script, a name or path, stands in examples/gallery/index.rst."""
    return ORDER.index(Path(script).stem)


def short_warnings(gallery_conf, name):
    """Examples show once what a warning says, not where on this machine the code is."""
    shown = set()

    def format_once(text, kind, *where):
        line = f"{kind.__name__}: {text}\n"
        new = line not in shown
        shown.add(line)
        return line if new else ""

    warnings.formatwarning = format_once


def project_colors(gallery_conf, name):
    """Lines of no model have the project's colours, too, in their order."""
    import matplotlib as mpl

    mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=COLORS)
