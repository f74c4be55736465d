"""What pages need on small and on sharp screens: marked numbers, sharp pictures."""

import re
from pathlib import Path

from docutils import nodes
from PIL import Image  # Matplotlib has it
from sphinx.transforms import SphinxTransform
from sphinx_gallery.directives import imgsgnode

NARROW = "-narrow"  # what docs/stacked.py adds to that of a picture for phones
SHARP = "_2_00x"  # what sphinx-gallery adds to the name of a picture of twice the size
INCH = 100  # pixels of the page for an inch of a picture
PHONE = 620  # pixels: a wider picture cannot be read on a phone unless it scrolls
NUMBER = re.compile(  # -1,234.5 or 1e-07, one more, and a unit
    r"\W?\s?\d[\d.,]*(e\W?\d+)?(\s?\W\s?[\d.,]+)?\s?\W?\s?(ms|µ?s|min|h|[KMG]i?B)?"
)


class Numbers(SphinxTransform):
    """Mark the cells that hold a number: skmtgp.css keeps those in one line."""

    default_priority = 500

    def apply(self):
        """Give them a class."""
        for entry in self.document.findall(nodes.entry):
            if NUMBER.fullmatch(entry.astext().strip()):
                entry["classes"].append("number")


class Pictures(SphinxTransform):
    """Show an inch of every picture as wide, sharp, and let wide ones scroll.

    A picture beside which there is one for phones is replaced by it where a page is
    narrow: see ``skmtgp.css``.
    """

    default_priority = 500

    def apply(self):
        """Say how wide a picture is, and take the gallery's of twice the size."""
        folder = Path(self.env.doc2path(self.env.docname)).parent
        for image in list(self.document.findall(nodes.image)):
            path = folder / image["uri"]
            if path.suffix == ".png" and path.exists():
                image.setdefault("width", f"{width(path):.0f}px")
                image["classes"] += ["wide"] * (width(path) > PHONE)
                sharp = path.with_stem(path.stem + SHARP)
                if sharp.exists():
                    image["uri"] = str(Path(image["uri"]).with_name(sharp.name))
                if path.with_stem(path.stem + NARROW).exists():
                    offer(image, path.with_stem(path.stem + NARROW))
        for image in list(self.document.findall(imgsgnode)):
            if width(Path(self.env.srcdir, image["uri"].lstrip("/"))) > PHONE:
                box = nodes.container(classes=["scrolls"])
                image.replace_self(box)
                box += image


def offer(image, path):
    """Put a picture for phones, with the same words, beside another."""
    narrow = image.deepcopy()
    narrow["uri"] = str(Path(image["uri"]).with_name(path.name))
    narrow["width"] = f"{width(path):.0f}px"
    narrow["classes"] = ["on-phones"]
    image["classes"] += ["on-desktops"]
    image.parent.insert(image.parent.index(image), narrow)


def width(path):
    """Pixels of the page for a PNG, whose header says how many there are to an inch."""
    with Image.open(path) as image:
        return INCH * image.width / image.info.get("dpi", (INCH, INCH))[0]


def setup(app):
    """As an extension of Sphinx."""
    app.add_transform(Numbers)
    app.add_transform(Pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
