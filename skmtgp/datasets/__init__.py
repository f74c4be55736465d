"""Data for multi-task regression: inverse dynamics of a Puma 560 under loads."""

from ._make import make_puma560
from ._puma560 import fetch_puma560, load_puma560

__all__ = ["fetch_puma560", "load_puma560", "make_puma560"]
