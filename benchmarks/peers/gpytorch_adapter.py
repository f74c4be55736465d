"""GPyTorch.

Shipped: its Hadamard multi-task regression example: single precision, IndexKernel,
GaussianLikelihood, 50 steps of Adam with a learning rate of 0.1. Best: double
precision, Cholesky decompositions whatever n, noise down to 1e-10, logarithms as
parameters, the IndexKernel's diagonal down to 1e-16, L-BFGS-B.
"""

import gpytorch
import torch
from adapter import main
from gpytorch.kernels import IndexKernel
from gpytorch.likelihoods import GaussianLikelihood
from lbfgs import maximise
from problem import KAPPA
from torch_model import (
    DenseProduct,
    InputKernel,
    TorchAdapter,
    exact_settings,
    log_domain,
    log_domain_noise,
)

STEPS, LEARNING_RATE = 50, 0.1


class Model(gpytorch.models.ExactGP):
    """The example's model with another kernel and a mean of zero."""

    def __init__(self, X, y, likelihood, kernel, task_kernel):
        super().__init__((X, tasks_of(X)), y, likelihood)
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module, self.task_covar_module = kernel, task_kernel

    def forward(self, X, tasks):
        """Prior of f."""
        if isinstance(self.covar_module, DenseProduct):
            covariance = self.covar_module(X)
        else:
            covariance = self.covar_module(X).mul(self.task_covar_module(tasks))
        return gpytorch.distributions.MultivariateNormal(
            self.mean_module(X), covariance
        )


def tasks_of(X):
    """The last column, as the example has it."""
    return X[:, -1:].long()


class Adapter(TorchAdapter):
    """GPyTorch."""

    version = gpytorch.__version__
    kappa = KAPPA

    def __init__(self, problem, settings, threads):
        self.settings, self.best = settings, settings != "shipped"
        torch.manual_seed(0)
        torch.set_num_threads(threads)
        torch.set_default_dtype(torch.float64 if self.best else torch.float32)
        if self.best:
            exact_settings()
        likelihood = GaussianLikelihood(
            noise_constraint=log_domain_noise() if self.best else None
        )
        likelihood.noise = float(problem.start.noise)
        self.model = self.make_model(problem, likelihood)
        self.mll = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, self.model)
        self.prepare(problem)

    def make_model(self, problem, likelihood):
        """The model of the data."""
        kernel = self.make_kernels(problem)
        return Model(*self.data(problem), likelihood, kernel, self.task_kernel)

    @staticmethod
    def data(problem):
        """Inputs with the task, and targets."""
        dtype = torch.get_default_dtype()
        return (torch.tensor(a, dtype=dtype) for a in (problem.X, problem.y))

    def make_kernels(self, problem):
        """The task kernel and k^x at the start; k^x, at best times the task kernel."""
        self.inputs = InputKernel(problem.start, in_logs=self.best)
        n_tasks, rank = problem.F.shape
        self.task_kernel = IndexKernel(
            num_tasks=n_tasks,
            rank=rank,
            var_constraint=log_domain() if self.best else None,
        )
        factor = torch.tensor(problem.F, dtype=torch.get_default_dtype())
        self.task_kernel.covar_factor.data = factor
        self.task_kernel.var = torch.full((n_tasks,), self.kappa)
        if not self.best:
            return self.inputs.kernel
        column = problem.u.shape[1]
        return DenseProduct(self.inputs.kernel, self.task_kernel, column)

    def fit(self, recorder):
        """Learn."""
        if self.best:
            stop = maximise(
                self.value_and_grad, self.start_x, recorder, self.n, self.flat.bounds
            )
            self.restore(recorder.state)
            return stop
        return self.fit_as_shipped(recorder)

    def fit_as_shipped(self, recorder):
        """The example's loop."""
        optimizer = torch.optim.Adam(self.model.parameters(), lr=LEARNING_RATE)
        for _ in range(STEPS):
            optimizer.zero_grad()
            value = self.likelihood()
            recorder(value.item(), self.flat.x)
            (-value / self.n).backward()
            optimizer.step()
        return f"{STEPS} steps"


if __name__ == "__main__":
    main(Adapter)
