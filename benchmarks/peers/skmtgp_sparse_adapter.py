"""skmtgp's bound; its fits are those of sparse_fits.py."""

from adapter import main
from skmtgp_adapter import Adapter

from skmtgp.inference.sparse import SparseBound
from skmtgp.model.prior import Prior


class SparseAdapter(Adapter):
    """skmtgp, sparse."""

    def make_likelihood(self, *data):
        """The objective."""
        return SparseBound(Prior(self.kernel, self.form), *data, self.problem.Z)


if __name__ == "__main__":
    main(SparseAdapter, ("inputs",))
