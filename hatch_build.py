"""The README as PyPI shows it: links to files of the checkout lead to the web."""

import re
import tomllib
from pathlib import Path, PurePosixPath

from hatchling.metadata.plugin.interface import MetadataHookInterface

# The target of a link or an image, unless it is a place on the page or an address
TARGET = re.compile(
    r"(?P<image>!?)(?P<text>\[[^\[\]]*\])\((?P<path>(?!#|\w+:)[^()\s]+)\)"
)


class CustomMetadataHook(MetadataHookInterface):
    """Sets the description that `[project]` calls dynamic."""

    def update(self, metadata):
        """Add the README to the metadata of a build."""
        names = "README.md", "pyproject.toml", "skmtgp/__init__.py"
        text, project, package = (Path(self.root, n).read_text("utf-8") for n in names)
        urls = tomllib.loads(project)["project"]["urls"]
        version = re.search(r'__version__ = "(.*)"', package)[1]
        text = absolute(text, urls, version)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def absolute(text, urls, version):
    """The text with addresses in place of paths in the checkout.

    Parameters
    ----------
    text : str
        Markdown.
    urls : dict
        `[project.urls]` of pyproject.toml, the one place where they are.
    version : str
        Of the package, whose tag has the files.

    Returns
    -------
    text : str
        Pages of the user guide are linked in the documentation, images and all other
        files in the repository.
    """

    def replaced(match):
        path, hash_, place = match["path"].partition("#")
        target = address(PurePosixPath(path), bool(match["image"]), urls, version)
        return f"{match['image']}{match['text']}({target}{hash_}{place})"

    return TARGET.sub(replaced, text)


def address(path, is_image, urls, version):
    """Where a file of the checkout is found in the web."""
    if path.parts[0] == "docs" and path.suffix == ".md":
        page = PurePosixPath(*path.parts[1:]).with_suffix(".html")
        return f"{urls['Documentation']}/en/stable/{page}"
    kind = "raw" if is_image else "blob"
    return f"{urls['Repository']}/{kind}/v{version}/{path}"
