"""Data for multi-task regression: inverse dynamics of a Puma 560 under loads."""

from ._make import make_puma560
from ._puma560 import fetch_puma560, load_puma560
from ._urdf import puma560_urdf

__all__ = ["fetch_puma560", "load_puma560", "make_puma560", "puma560_urdf"]
