"""BoTorch, in a process of its own: to import it changes GPyTorch's settings.

Shipped: MultiTaskGP with fit_gpytorch_mll, its PositiveIndexKernel, its prior of the
tasks' correlations, its prior and bound of the noise. Best: a plain IndexKernel, no
priors, noise down to 1e-10, logarithms as parameters, L-BFGS-B with a long memory and
tight tolerances, started again while it gains.
"""

import warnings

import botorch
import gpytorch
import numpy as np
import torch
from adapter import main
from botorch.exceptions.errors import ModelFittingError
from botorch.fit import fit_gpytorch_mll
from botorch.models import MultiTaskGP
from botorch.models.utils.gpytorch_modules import (
    get_gaussian_likelihood_with_lognormal_prior,
)
from botorch.optim.closures import get_loss_closure_with_grads
from gpytorch.kernels import IndexKernel
from gpytorch.likelihoods import GaussianLikelihood
from lbfgs import OPTIONS, keep_climbing
from problem import KAPPA
from torch_model import (
    DenseProduct,
    InputKernel,
    TorchAdapter,
    exact_settings,
    log_domain,
    log_domain_noise,
)


class Adapter(TorchAdapter):
    """BoTorch."""

    version = botorch.__version__

    def __init__(self, problem, settings, threads):
        self.best = settings == "best"
        torch.manual_seed(0)
        torch.set_num_threads(threads)
        torch.set_default_dtype(torch.float64)
        # PositiveIndexKernel's first variance is 1: k^x takes the scale.
        scale = 1.0 if self.best else float(problem.start.K_rho[0, 0])
        self.inputs = InputKernel(problem.start, in_logs=self.best, scale=scale)
        self.model = self.make_model(problem)
        if self.best:
            exact_settings()
            self.use_plain_index_kernel(problem)
        else:
            self.start_shipped(problem)
        likelihood = self.model.likelihood
        likelihood.noise = float(problem.start.noise)
        self.mll = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, self.model)
        self.prepare(problem)

    def make_model(self, problem):
        """MultiTaskGP with k^x, a mean of zero and a noise shared by the tasks."""
        if self.best:
            options = {"task_covar_prior": None}
            likelihood = GaussianLikelihood(noise_constraint=log_domain_noise())
        else:
            options, likelihood = {}, get_gaussian_likelihood_with_lognormal_prior()
        return MultiTaskGP(
            torch.tensor(problem.X),
            torch.tensor(problem.y).reshape(-1, 1),
            task_feature=-1,
            mean_module=gpytorch.means.ZeroMean(),
            covar_module=self.inputs.kernel,
            likelihood=likelihood,
            rank=problem.F.shape[1],
            outcome_transform=None,
            **options,
        )

    def use_plain_index_kernel(self, problem):
        """Put an IndexKernel in the place of the PositiveIndexKernel."""
        n_tasks, rank = problem.F.shape
        column = problem.u.shape[1]
        kernel = IndexKernel(num_tasks=n_tasks, rank=rank, var_constraint=log_domain())
        kernel.covar_factor.data = torch.tensor(problem.F)
        kernel.var = torch.full((n_tasks,), KAPPA)
        self.task_kernel = kernel
        self.model.covar_module = DenseProduct(self.inputs.kernel, kernel, column)

    def start_shipped(self, problem):
        """The nearest start that has positive correlations only: |F|."""
        self.task_kernel = self.model.covar_module.kernels[-1]
        self.task_kernel.covar_factor = torch.tensor(np.abs(problem.F) + 1e-6)
        self.task_kernel.var = torch.full((len(problem.F),), KAPPA)

    def fit(self, recorder):
        """Learn."""
        warnings.simplefilter("ignore")
        if not self.best:
            self.fit_once(recorder)
            return "fit_gpytorch_mll ended"
        options = {"bounds": self.flat.bounds_by_name, "options": OPTIONS}

        def climb(x):
            self.restore(x)
            return self.fit_once(recorder, optimizer_kwargs=options, max_attempts=1)

        stop = keep_climbing(climb, self.start_x, recorder)
        self.restore(recorder.state)
        return stop

    def fit_once(self, recorder, **options):
        """Call fit_gpytorch_mll."""
        self.mll.train()
        named = {k: p for k, p in self.mll.named_parameters() if p.requires_grad}
        inner = get_loss_closure_with_grads(self.mll, parameters=named)

        def closure():
            loss, gradients = inner()
            recorder(-loss.item() * self.n, self.flat.x)
            return loss, gradients

        try:
            fit_gpytorch_mll(self.mll, closure=closure, **options)
        except ModelFittingError:
            return "failed"
        return "converged"


if __name__ == "__main__":
    main(Adapter)
