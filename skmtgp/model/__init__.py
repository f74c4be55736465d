"""The model: its prior, covariances between tasks, kernels in tiles.

A kernel joins the fast path with a `Node`, the `Bound` kernel that it gives, and an
entry in `NODES`. See the page "Design" of the documentation.
"""

from skmtgp.model._nodes import NODES, Bound, Node, allocate, compile_kernel

__all__ = ["NODES", "Bound", "Node", "allocate", "compile_kernel"]
