"""GPflow's SGPR, with the settings that are best for its GPR.

The inducing points are given, and are not learned: a task cannot be. K^rho has no
diagonal, like skmtgp's. The jitter, which GPflow always adds to the covariance of the
inducing points, is as small as it can be.
"""

import gpflow
from adapter import main
from gpflow_adapter import Adapter
from inducing import SETTINGS, inducing_points
from sparse_model import JITTER, NO_KAPPA


class SparseAdapter(Adapter):
    """GPflow, sparse."""

    kappa = NO_KAPPA

    def make_model(self, problem, noise):
        """The model of the data."""
        gpflow.config.set_default_jitter(JITTER)
        points = inducing_points(problem, self.settings)
        model = gpflow.models.SGPR(
            self.data(problem), self.kernel, points, likelihood=noise
        )
        gpflow.set_trainable(model.inducing_variable, False)
        gpflow.set_trainable(self.tasks.kappa, False)
        return model


if __name__ == "__main__":
    main(SparseAdapter, SETTINGS)
