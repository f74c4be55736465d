"""What the displays share: axes, colours, names of many things."""

from __future__ import annotations

import math
from numbers import Integral
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sklearn.base import BaseEstimator

# Okabe and Ito's colours, which the colour-blind can tell apart; yellow is too pale,
# and theirs of purple looks like grey to many of them.
# This is the palette of the whole project: its figures take their colours from here.
COLORS = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#56b4e9", "#a64d79", "#999999"
OF_MODELS = {
    "MultiTaskGPRegressor": COLORS[1],
    "RankSearchIC": COLORS[1],  # and WideRegressor, where they are not told of what
    "WideRegressor": COLORS[1],
    "SingleTaskGP": COLORS[6],
    "IndependentGP": COLORS[4],
    "PooledGP": COLORS[3],
    "BayesianLinearRegression": COLORS[0],
    "RigidBodyRegressor": COLORS[2],
    "SemiparametricRegressor": COLORS[5],
}
MARKERS = "osD^vPX"
LEAST = 6.5  # points; smaller letters cannot be read


class Display:
    """Base of the displays."""

    color = COLORS[0]  # of what is predicted; from_estimator sets the model's
    own_units = False  # whether tasks have units of their own; from_estimator asks

    def _set_axes(self, ax, figsize=None):
        """The axes to draw on, new ones if None."""
        check_axes(ax)
        if ax is None:
            _, ax = pyplot().subplots(figsize=figsize, layout="constrained")
        self.ax_, self.figure_ = ax, ax.figure
        return ax


def pyplot():
    """matplotlib.pyplot; the package does without it until something is drawn."""
    try:
        import matplotlib.pyplot
    except ImportError as error:
        raise ImportError(
            'Drawing needs matplotlib: pip install "skmtgp[plot]".'
        ) from error
    return matplotlib.pyplot


def check_axes(ax):
    """Raise a TypeError unless this is a matplotlib Axes, or None."""
    if ax is not None and not hasattr(ax, "get_subplotspec"):
        raise TypeError(f"ax={ax!r} must be an Axes of matplotlib, or None.")


def check_option(name, value, allowed):
    """Raise a ValueError unless the value is one of those allowed."""
    if value not in allowed:
        raise ValueError(
            f"{name}={value!r} must be one of {', '.join(map(repr, allowed))}."
        )


def check_count(name, value):
    """Raise an error unless the value is an integer of 1 or more."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name}={value!r} must be an integer, such as 10.")
    if value < 1:
        raise ValueError(f"{name}={value!r} must be 1 or more.")


def color_of(model: BaseEstimator) -> str:
    """Return the colour that displays and this documentation use for a model.

    Parameters
    ----------
    model : estimator
        A model of the package, fitted or not, or a Pipeline or search with one.

    Returns
    -------
    color : str
        Colour for matplotlib, one of `COLORS`, which colour-blind people can
        distinguish. Models of other packages get the first one.

    Examples
    --------
    >>> from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC
    >>> from skmtgp.inspection import color_of
    >>> color_of(RankSearchIC()) == color_of(MultiTaskGPRegressor())
    True
    >>> color_of(IndependentGP())
    '#56b4e9'
    """
    for inside in (getattr(model, "steps", None), getattr(model, "estimator", None)):
        if inside is not None:
            return color_of(inside[-1][1] if isinstance(inside, list) else inside)
    return OF_MODELS.get(type(model).__name__, COLORS[0])


def style(k):
    """Colour and marker of the k-th of several lines."""
    return {"color": COLORS[k % len(COLORS)], "marker": MARKERS[k % len(MARKERS)]}


def label_positions(axis, labels):
    """Name the positions 0, 1, ...: in small letters, or only some, if many.

    Parameters
    ----------
    axis : matplotlib Axis
        Whose limits are set already.
    labels : sequence of str
        One for each position.
    """
    room = points(axis) / max(1, len(labels))
    size = letter_size()
    upright = axis.axis_name == "x" and 0.65 * size * longest(labels) > room
    if axis.axis_name == "y" or upright:  # a line of text is 1.2 times as high as wide
        size = max(LEAST, min(size, room / 1.2))
    step = math.ceil(1.1 * size / room) if axis.axis_name == "y" or upright else 1
    shown = range(0, len(labels), step)
    axis.set_ticks(shown, [labels[k] for k in shown], fontsize=size)
    axis.set_tick_params(labelrotation=90 if upright else 0)


def points(axis):
    """Length of an axis in points."""
    figure = axis.axes.figure.figure  # of a subfigure, the whole one
    engine = figure.get_layout_engine()
    if engine is not None:  # it would move the axes later, when they are drawn
        engine.execute(figure)
    axis.axes.apply_aspect()
    box = axis.axes.get_window_extent()
    pixels = box.width if axis.axis_name == "x" else box.height
    return 72.0 * pixels / figure.dpi


def letter_size():
    """The user's own, in points."""
    return float(pyplot().rcParams["font.size"])


def longest(texts):
    """Number of letters of the longest."""
    return max((len(text) for text in texts), default=0)
