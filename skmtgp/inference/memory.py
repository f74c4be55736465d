"""How much memory likelihoods take for the tiles of a kernel."""

from skmtgp._numerics.parallel import SMALL, count_threads
from skmtgp.inference.sparse import BLOCK
from skmtgp.inference.tiles import TILE
from skmtgp.model._nodes import count_arrays, count_elements

WORK = 8  # arrays of a tile that come and go, at most


class TileMemory:
    """Bytes of the tiles of a kernel, with what their gradients need.

    Parameters
    ----------
    kernel : Kernel
        k^x.
    x : ndarray of shape (1, n_features)
        An input.

    Attributes
    ----------
    n_arrays : int
        Arrays of a tile until its gradient is contracted.
    """

    def __init__(self, kernel, x):
        self.kernel, self.n_arrays = kernel, count_arrays(kernel, x)

    def of_triangle(self, n_rows, n_climbs):
        """Bytes of exact inference: one triangle of tiles, and work on some of them.

        Parameters
        ----------
        n_rows : int
            Number of inputs that K^x is between.
        n_climbs : int
            Likelihoods at the same time.

        Returns
        -------
        n_bytes : float
            Of all of them.
        """
        n_tiles = max(1, -(-n_rows // TILE))
        side = -(-n_rows // n_tiles)
        kept = 0.5 * n_tiles * (n_tiles + 1) * self.n_arrays * side**2
        work = WORK * side**2 + count_elements(self.kernel, side)
        n_threads = 1 if n_rows < SMALL else min(count_threads(), n_tiles)
        return 8.0 * (n_climbs * kept + max(n_climbs, n_threads) * work)

    def of_blocks(self, n_inducing, n_rows, n_climbs):
        """Bytes of sparse inference: a tile of the inducing inputs and some rows.

        Parameters
        ----------
        n_inducing : int
            Number of inducing inputs.
        n_rows : int
            Rows that the bound is of.
        n_climbs : int
            Bounds at the same time.

        Returns
        -------
        n_bytes : float
            Of all of them.
        """
        size = min(n_rows, BLOCK)
        arrays = (self.n_arrays + WORK) * n_inducing * size
        return 8.0 * n_climbs * (arrays + count_elements(self.kernel, size))
