"""The model: its prior, covariances between tasks, kernels in tiles.

What a kernel needs to join the fast path is here: a `Node`, the `Bound` kernel that it
gives, and its entry in `NODES`, see the page "Design" of the documentation.
"""

from skmtgp.model._nodes import NODES, Bound, Node, allocate, compile_kernel

__all__ = ["NODES", "Bound", "Node", "allocate", "compile_kernel"]
