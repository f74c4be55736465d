"""GPyTorch's InducingPointKernel (SGPR), with the settings that are best for it exact.

As in its SGPR example, with the Hadamard multi-task kernel as the base kernel. The
inducing points are given, and are not learned: a task cannot be. K^rho has no diagonal,
like skmtgp's. Jitter is added to the covariance of the inducing points only where it
has no Cholesky factor.
"""

import gpytorch
import torch
from adapter import main
from gpytorch.kernels import InducingPointKernel
from gpytorch_adapter import Adapter
from inducing import SETTINGS, inducing_points
from sparse_model import JITTERS, NO_KAPPA


class Model(gpytorch.models.ExactGP):
    """The example's model with a mean of zero."""

    def __init__(self, X, y, likelihood, kernel):
        super().__init__(X, y, likelihood)
        self.mean_module, self.covar_module = gpytorch.means.ZeroMean(), kernel

    def forward(self, X):
        """Prior of f."""
        return gpytorch.distributions.MultivariateNormal(
            self.mean_module(X), self.covar_module(X)
        )


class SparseAdapter(Adapter):
    """GPyTorch, sparse."""

    kappa = NO_KAPPA

    def make_model(self, problem, likelihood):
        """The model of the data."""
        sparse_settings()
        kernel = self.make_kernels(problem)
        self.task_kernel.raw_var.requires_grad_(False)
        points = torch.tensor(inducing_points(problem, self.settings))
        sparse = InducingPointKernel(kernel, points, likelihood)
        sparse.inducing_points.requires_grad_(False)
        return Model(*self.data(problem), likelihood, sparse)


def sparse_settings():
    """Settings under which GPyTorch uses the low rank, and computes exactly."""
    gpytorch.settings.fast_computations.log_prob._set_state(True)
    gpytorch.settings.cholesky_jitter._set_value(None, JITTERS[0], None)
    gpytorch.settings.cholesky_max_tries._set_value(len(JITTERS))


if __name__ == "__main__":
    main(SparseAdapter, SETTINGS)
