"""Data for multi-task regression: sites, soil, and the inverse dynamics of robots."""

from ._kinova_gen3 import fetch_kinova_gen3
from ._make import make_puma560
from ._puma560 import fetch_puma560, load_puma560
from ._recordings import prepare_trajectory
from ._sites import make_sites
from ._soil import make_soil
from ._urdf import puma560_urdf

__all__ = [
    "fetch_kinova_gen3",
    "fetch_puma560",
    "load_puma560",
    "make_puma560",
    "make_sites",
    "make_soil",
    "prepare_trajectory",
    "puma560_urdf",
]
