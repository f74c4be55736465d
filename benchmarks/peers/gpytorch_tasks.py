"""GPyTorch's models of tasks, for real_data.py.

Double precision, exact whatever n; kernels times IndexKernel as plain matrices.
"""

import warnings

import gpytorch
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import ConstantKernel, IndexKernel, RBFKernel
from gpytorch.likelihoods import GaussianLikelihood, HadamardGaussianLikelihood
from tasks import main, start
from torch_model import DenseProduct, Flat, exact_settings, log_domain

LEAST_NOISE = 1e-8


class Model(gpytorch.models.ExactGP):
    """A mean of zero, and a kernel."""

    def __init__(self, X, y, likelihood, kernel):
        super().__init__(X, y, likelihood)
        self.mean_module, self.covar_module = gpytorch.means.ZeroMean(), kernel

    def forward(self, X):
        """Prior of f."""
        return gpytorch.distributions.MultivariateNormal(
            self.mean_module(X), self.covar_module(X)
        )


class Adapter:
    """A sum of kernels times IndexKernel."""

    def __init__(self, problem, shape, rng, *, drawn):
        warnings.simplefilter("ignore")
        torch.set_num_threads(1)
        torch.set_default_dtype(torch.float64)
        exact_settings()
        noise = GreaterThan(LEAST_NOISE, transform=torch.exp, inv_transform=torch.log)
        if shape.own_noise:
            likelihood = HadamardGaussianLikelihood(
                problem.n_tasks, noise_constraint=noise, task_feature_index=-1
            )
            likelihood.noise = torch.full((problem.n_tasks, 1), 0.1)
        else:
            likelihood = GaussianLikelihood(noise_constraint=noise)
            likelihood.noise = 0.1
        kernel = self.kernel(shape, problem, *start(shape, problem, rng, drawn=drawn))
        X, y = torch.tensor(problem.X), torch.tensor(problem.y)
        self.model = Model(X, y, likelihood, kernel)
        self.mll = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, self.model)
        self.flat = Flat(self.mll)

    @staticmethod
    def kernel(shape, problem, scales, factors):
        """Covariance of f, without the amplitudes that task covariances have."""
        d, parts = problem.n_features, []
        for lengthscale in scales:
            smooth = RBFKernel(
                ard_num_dims=d,
                active_dims=range(d),
                lengthscale_constraint=log_domain(),
            )
            smooth.lengthscale = torch.tensor(lengthscale).reshape(1, -1)
            parts.append(smooth)
        bias = ConstantKernel(constant_constraint=log_domain())
        bias.constant = torch.tensor(0.1)
        if shape.levels:
            bias.raw_constant.requires_grad_(False)
            parts.append(bias)
        else:
            parts[0] = parts[0] + bias
        products = []
        for part, W in zip(parts, factors, strict=True):
            tasks = IndexKernel(
                num_tasks=problem.n_tasks, rank=shape.rank, var_constraint=log_domain()
            )
            tasks.covar_factor.data = torch.tensor(W)
            tasks.var = torch.full((problem.n_tasks,), 0.1)
            products.append(DenseProduct(part, tasks, d))
        return sum(products[1:], products[0])

    @property
    def x(self):
        """The learned parameters."""
        return self.flat.x

    def value_and_grad(self, x):
        """Log likelihood and gradient at x, or None where it fails."""
        self.mll.train()
        self.flat.x = x
        self.flat.clear()
        try:
            inputs, y = self.model.train_inputs, self.model.train_targets
            value = self.mll(self.model(*inputs), y, *inputs) * len(y)
            value.backward()
        except (RuntimeError, ValueError):  # NotPSDError, NanError, LinAlgError
            return None
        return value.item(), self.flat.gradient

    def predict(self, X):
        """Mean and standard deviation of y."""
        self.mll.eval()
        X = torch.tensor(X)
        with torch.no_grad():
            y = self.model.likelihood(self.model(X), X)
            return y.mean.numpy(), y.stddev.numpy()


if __name__ == "__main__":
    main(Adapter)
