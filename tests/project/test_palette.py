"""One palette for all figures, which the colour-blind can tell apart."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
    make_inverse_dynamics_regressor,
)
from skmtgp.inspection import COLORS, color_of
from skmtgp.inspection._drawing import OF_MODELS

ROOT = Path(__file__).parents[2]
PALETTE = ROOT / "skmtgp" / "inspection" / "_drawing.py"
OWN = re.compile(r"""["']#[0-9a-fA-F]{6}["']|["']C\d["']|["']tab:|tab10|tab20""")
# How linear colours are seen: by most, and by those without cones for red or for green
# (Machado, Oliveira and Fernandes 2009).
SIGHTS = {
    "usual": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}
TO_XYZ = [
    [0.4124, 0.3576, 0.1805],
    [0.2126, 0.7152, 0.0722],
    [0.0193, 0.1192, 0.9505],
]
WHITE = np.sum(TO_XYZ, axis=1)


def linear(color):
    """Red, green and blue light of a colour."""
    values = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(
        values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4
    )


def seen(color, sight):
    """A colour in CIELAB, where distances are differences that are seen."""
    xyz = TO_XYZ @ np.clip(np.array(SIGHTS[sight]) @ linear(color), 0.0, 1.0)
    f = np.cbrt(xyz / WHITE)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHTS)
def test_any_two_colours_can_be_told_apart(sight):
    apart = {
        pair: np.linalg.norm(np.subtract(*(seen(color, sight) for color in pair)))
        for pair in combinations(COLORS, 2)
    }
    assert min(apart.values()) > 10.0, min(apart, key=apart.get)


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_all_are_seen_on_white_and_on_black(background):
    """With a contrast of 2 or more, and 3 that of multi-task models."""
    light = [TO_XYZ[1] @ linear(color) for color in COLORS]
    contrast = [
        (max(y, background) + 0.05) / (min(y, background) + 0.05) for y in light
    ]
    assert min(contrast) >= 2.0
    assert contrast[COLORS.index(OF_MODELS["MultiTaskGPRegressor"])] >= 3.0


def test_each_model_has_a_colour_of_its_own():
    models = OF_MODELS.keys() - {"RankSearchIC", "WideRegressor"}
    assert len({OF_MODELS[name] for name in models}) == len(models)
    assert set(OF_MODELS.values()) <= set(COLORS)


def test_what_is_around_a_model_does_not_matter():
    multi_task = color_of(MultiTaskGPRegressor())
    grid = GridSearchCV(PooledGP(), {})
    found = {
        RankSearchIC(): multi_task,
        RankSearchIC(MultiTaskGPRegressor()): multi_task,
        WideRegressor(): multi_task,
        WideRegressor(IndependentGP()): color_of(IndependentGP()),
        make_inverse_dynamics_regressor(): multi_task,
        make_inverse_dynamics_regressor(SingleTaskGP()): color_of(SingleTaskGP()),
        make_pipeline("passthrough", grid): color_of(PooledGP()),
        LinearRegression(): COLORS[0],
    }
    assert [color_of(model) for model in found] == list(found.values())


def test_no_figure_has_colours_of_its_own():
    folders = [ROOT / name for name in ("skmtgp", "examples", "benchmarks")]
    files = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    files = [path for path in files if ".envs" not in path.parts and path != PALETTE]
    assert files
    found = {
        str(path.relative_to(ROOT)): colors
        for path in files
        if (colors := OWN.findall(path.read_text("utf-8")))
    }
    assert not found, "take colours from skmtgp.inspection"
