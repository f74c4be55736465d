"""GPflow's SGPR, with the settings that are best for its GPR.

The inducing points are given, and are not learned: a task cannot be. K^rho has no
diagonal, like skmtgp's. The jitter, which GPflow adds to the covariance of the inducing
points at all parameters, is ten times the least with which there is a Cholesky factor
at the start.
"""

import gpflow
import numpy as np
import tensorflow as tf
from adapter import main
from gpflow_adapter import Adapter
from inducing import SETTINGS, inducing_points
from sparse_model import JITTERS, NO_KAPPA


class SparseAdapter(Adapter):
    """GPflow, sparse."""

    kappa = NO_KAPPA

    def make_model(self, problem, noise):
        """The model of the data."""
        points = inducing_points(problem, self.settings)
        model = gpflow.models.SGPR(
            self.data(problem), self.kernel, points, likelihood=noise
        )
        gpflow.set_trainable(model.inducing_variable, False)
        gpflow.set_trainable(self.tasks.kappa, False)
        least = next((j for j in JITTERS if has_factor(model, j)), JITTERS[-1])
        gpflow.config.set_default_jitter(10.0 * least)
        return model


def has_factor(model, jitter):
    """Whether the covariance of the inducing points has a Cholesky factor."""
    K = gpflow.covariances.Kuu(model.inducing_variable, model.kernel, jitter=jitter)
    try:
        return np.isfinite(tf.linalg.cholesky(K)).all()
    except tf.errors.InvalidArgumentError:
        return False


if __name__ == "__main__":
    main(SparseAdapter, SETTINGS)
