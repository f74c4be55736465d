"""How much memory the tiles of a kernel take."""

import numpy as np

from skmtgp.model._nodes.expressions import compile_kernel, side_of_tensor


def count_arrays(kernel, x, node=None):
    """How many arrays of a tile there are until its gradient is contracted.

    They are counted, with a tile of one pair, so that no kernel need declare them.

    Parameters
    ----------
    kernel : Kernel
        The kernel.
    x : ndarray of shape (1, n_features)
        An input.
    node : Node, default=None
        The kernel's, where it is there already.

    Returns
    -------
    n_arrays : int
        The values, what is on the tape, and those of `new` that are neither.
    """
    node = node or compile_kernel(kernel)
    made, twice = [], np.repeat(np.asarray(x, dtype=float), 2, axis=0)

    def new():
        made.append(np.empty((1, 1)))
        return made[-1]

    bound = node.bind(np.zeros(node.n_dims), twice)  # whatever the values are
    values, tape = bound.block(slice(0, 1), slice(1, 2), new)
    return len({id(array) for array in _arrays([made, values, tape])})


def _arrays(found):
    """The arrays of tiles in nested lists and tuples."""
    if isinstance(found, list | tuple):
        for part in found:
            yield from _arrays(part)
    elif np.ndim(found) == 2:
        yield found


def count_elements(kernel, side, node=None):
    """Elements of the tensors by which kernels that are not known are differentiated.

    Parameters
    ----------
    kernel : Kernel
        The kernel.
    side : int
        Rows of a tile.
    node : Node, default=None
        The kernel's, where it is there already.

    Returns
    -------
    n_elements : int
        Of all that such a kernel makes at a time, by what those of scikit-learn do.
    """
    n_slices = (node or compile_kernel(kernel)).n_slices
    n_parts = max(1, -(-side // side_of_tensor(n_slices)))
    both = 2 * -(-side // n_parts)  # rows and columns
    return 3 * (n_slices + 1) * both**2 if n_slices else 0
