"""The order of the examples: that of examples/gallery/index.rst. docs/conf.py asks."""

import re
from pathlib import Path

INDEX = Path(__file__).parents[1] / "examples" / "gallery" / "index.rst"
ORDER = re.findall(r"^   (plot_\w+)$", INDEX.read_text("utf-8"), re.MULTILINE)


def position(script):
    """Where a script, a name or path, stands."""
    return ORDER.index(Path(script).stem)
