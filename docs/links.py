"""Links to the repository and its issues, at the top of every page."""

import tomllib

BLANK = "FILL-IN"
ICONS = {"Repository": "fa-solid fa-code-branch", "Issues": "fa-solid fa-bug"}


def icons(pyproject):
    """What pyproject.toml links to, as the theme takes it; not what is left blank."""
    urls = tomllib.loads(pyproject.read_text("utf-8"))["project"]["urls"]
    return [
        {"name": name, "url": urls[name], "icon": icon}
        for name, icon in ICONS.items()
        if BLANK not in urls[name]
    ]
