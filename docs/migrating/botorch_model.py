"""The model of docs/migrating.md in BoTorch."""

import torch
from botorch.fit import fit_gpytorch_mll
from botorch.models import MultiTaskGP
from data import task, task_new, x, x_new, y
from gpytorch.kernels import IndexKernel, RBFKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.means import ZeroMean
from gpytorch.mlls import ExactMarginalLogLikelihood

torch.manual_seed(0)
X = torch.cat([torch.tensor(x), torch.tensor(task)[:, None]], dim=1)
X_new = torch.cat([torch.tensor(x_new), torch.tensor(task_new)[:, None]], dim=1)

kernel = RBFKernel(ard_num_dims=2, active_dims=[0, 1])
model = MultiTaskGP(
    X,
    torch.tensor(y)[:, None],
    task_feature=-1,
    rank=2,
    mean_module=ZeroMean(),
    covar_module=kernel,
    likelihood=GaussianLikelihood(),
    task_covar_prior=None,
)
# In the place of its PositiveIndexKernel, which has no negative correlations:
tasks = IndexKernel(num_tasks=3, rank=2, active_dims=[2])
model.covar_module = (kernel * tasks).to(X)
fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))

posterior = model.posterior(X_new)
mean = posterior.mean.detach().numpy()[:, 0]
std = posterior.variance.sqrt().detach().numpy()[:, 0]
