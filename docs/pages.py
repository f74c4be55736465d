"""What pages need on small and on sharp screens: marked numbers, pictures of 2x."""

import re
from pathlib import Path

from docutils import nodes
from sphinx.transforms import SphinxTransform

SHARP = "_2_00x"  # what sphinx-gallery adds to the name of a picture of twice the size
NUMBER = re.compile(
    r"[<>~≈≤≥+\-−]?\s?\d[\d.,]*(e[+\-−]?\d+)?"  # 1,234.5 or 1e-07
    r"(\s?[±(–-]\s?[\d.,]+\)?)?\s?(ms|µs|s|min|h|%|[KMG]i?B|×|x|\*)?"
)


class Numbers(SphinxTransform):
    """Mark the cells that hold a number: skmtgp.css keeps those in one line."""

    default_priority = 500

    def apply(self):
        """Give them a class."""
        for entry in self.document.findall(nodes.entry):
            if NUMBER.fullmatch(entry.astext().strip()):
                entry["classes"].append("number")


class SharpPictures(SphinxTransform):
    """Show the gallery's pictures of 2x where a page borrows one, as wide as of 1x."""

    default_priority = 500

    def apply(self):
        """Change the file, and say how wide it is shown."""
        folder = Path(self.env.doc2path(self.env.docname)).parent
        for image in self.document.findall(nodes.image):
            plain = Path(image["uri"])
            sharp = plain.with_stem(plain.stem + SHARP)
            if (folder / sharp).exists():
                image["uri"] = sharp.as_posix()
                image.setdefault("width", f"{width(folder / plain)}px")


def width(path):
    """Pixels of a PNG from left to right: its header says so."""
    with path.open("rb") as file:
        return int.from_bytes(file.read(20)[16:], "big")


def setup(app):
    """As an extension of Sphinx."""
    app.add_transform(Numbers)
    app.add_transform(SharpPictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
