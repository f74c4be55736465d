"""Figures of several panels as files: side by side, and below each other for phones.

``pages.py`` shows the second file, whose name ends in ``-narrow``, on phones.
"""

from itertools import pairwise
from textwrap import fill

import matplotlib.pyplot as plt

WIDE = 6.2  # inches: a wider figure cannot be read on a phone
WIDTH, HEIGHT, REST = 4.2, 2.4, 1.2  # inches of a phone, a panel, titles and legend
SHARE = 0.6  # of the height of a panel beside others
LETTERS = 36  # of a title in one line


def save(figure, path, dpi):
    """Write a figure; if it is wide, stacked as well.

    Parameters
    ----------
    figure : Figure
        With a constrained layout. It is closed.
    path : Path
        Of the PNG file.
    dpi : float
        Pixels to an inch.
    """
    figure.savefig(path, dpi=dpi)
    if figure.get_figwidth() > WIDE and len(panels(figure)) > 1:
        stack(figure)
        figure.savefig(path.with_stem(f"{path.stem}-narrow"), dpi=200)
    plt.close(figure)


def panels(figure):
    """Places of the panels; two axes share one if they have an axis in common."""
    return list(dict.fromkeys(ax.get_subplotspec() for ax in figure.axes))


def stack(figure):
    """Put the panels of a figure below each other."""
    spread_labels(figure.axes)
    places = panels(figure)
    rows = places[0].get_gridspec().nrows
    height = max(HEIGHT, SHARE * figure.get_figheight() / rows)
    figure.set_size_inches(WIDTH, height * len(places) + REST)
    grid = dict(zip(places, figure.add_gridspec(len(places), 1), strict=True))
    for ax in figure.axes:
        ax.set_subplotspec(grid[ax.get_subplotspec()])
    figure.suptitle(fill(figure.get_suptitle(), LETTERS))
    for legend in list(figure.legends):  # anew: its columns are fixed when it is made
        legend.remove()
        names = [text.get_text() for text in legend.get_texts()]
        style = {"loc": "outside lower center", "frameon": legend.get_frame_on()}
        figure.legend(legend.legend_handles, names, ncols=2, **style)


def spread_labels(axes):
    """Name the vertical axis of every panel, and the horizontal one once if it can."""
    for left, ax in pairwise(axes):
        if not ax.get_ylabel():
            ax.set_ylabel(left.get_ylabel())
            ax.tick_params(labelleft=True)
    if len({ax.get_xlabel() for ax in axes} - {""}) == 1:
        for ax in axes[:-1]:
            ax.set_xlabel("")
