"""The model of docs/migrating.md in GPyTorch."""

import gpytorch
import torch
from data import task, task_new, x, x_new, y

torch.set_default_dtype(torch.float64)
torch.manual_seed(0)
X, X_new = torch.tensor(x), torch.tensor(x_new)
i, i_new = torch.tensor(task)[:, None], torch.tensor(task_new)[:, None]
y_mean, y_scale = y.mean(), y.std()
target = torch.tensor((y - y_mean) / y_scale)


class Model(gpytorch.models.ExactGP):
    """The Hadamard multi-task example, with a mean of zero."""

    def __init__(self, inputs, target, likelihood):
        super().__init__(inputs, target, likelihood)
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = gpytorch.kernels.RBFKernel(ard_num_dims=2)
        self.task_covar_module = gpytorch.kernels.IndexKernel(num_tasks=3, rank=2)

    def forward(self, X, i):
        """Prior of f."""
        covar = self.covar_module(X).mul(self.task_covar_module(i))
        return gpytorch.distributions.MultivariateNormal(self.mean_module(X), covar)


likelihood = gpytorch.likelihoods.GaussianLikelihood()
model = Model((X, i), target, likelihood)
mll = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
optimizer = torch.optim.Adam(model.parameters(), lr=0.05)
for _ in range(1000):
    optimizer.zero_grad()
    loss = -mll(model(X, i), target)
    loss.backward()
    optimizer.step()

model.eval()
with torch.no_grad():
    posterior = model(X_new, i_new)
    mean = y_mean + y_scale * posterior.mean.numpy()
    std = y_scale * posterior.stddev.numpy()
