"""The model in GPyTorch's terms, for GPyTorch and for BoTorch."""

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan, Positive
from gpytorch.kernels import ConstantKernel, LinearKernel, RBFKernel, ScaleKernel
from problem import (
    FACTOR,
    KAPPA_BOUNDS,
    LENGTH_SCALES,
    N_X,
    NOISE,
    WEIGHTS,
    Parameters,
)

BOUNDS = {
    "raw_lengthscale": np.log(LENGTH_SCALES),
    "raw_variance": np.log(WEIGHTS),
    "raw_constant": np.log(WEIGHTS),
    "raw_outputscale": np.log(WEIGHTS),
    "covar_factor": FACTOR,
    "raw_var": np.log(KAPPA_BOUNDS),
    "raw_noise": np.log([1e-3 * NOISE[0], NOISE[1]]),  # added to the smallest
}


def log_domain():
    """The constraint of a positive parameter that is learned as its logarithm."""
    return Positive(transform=torch.exp, inv_transform=torch.log)


def log_domain_noise():
    """The same with the smallest noise variance."""
    return GreaterThan(NOISE[0], transform=torch.exp, inv_transform=torch.log)


class InputKernel:
    """k^x, made of GPyTorch's kernels.

    Parameters
    ----------
    start : Parameters
        Starting values.
    in_logs : bool
        Whether to learn logarithms; GPyTorch's default is the inverse of softplus.
    scale : float, default=1.0
        Factor of the starting values.
    """

    def __init__(self, start, in_logs, scale=1.0):
        constraint = log_domain if in_logs else Positive
        self.linear = LinearKernel(
            ard_num_dims=len(start.weights),
            active_dims=range(len(start.weights)),
            variance_constraint=constraint(),
        )
        self.bias = ConstantKernel(constant_constraint=constraint())
        self.rbf = RBFKernel(
            ard_num_dims=N_X,
            active_dims=range(N_X),
            lengthscale_constraint=constraint(),
        )
        self.scaled = ScaleKernel(self.rbf, outputscale_constraint=constraint())
        self.kernel = self.linear + self.bias + self.scaled
        self.kernel.to(torch.get_default_dtype())
        self.linear.variance = torch.tensor(scale * start.weights).reshape(1, -1)
        self.bias.constant = torch.tensor(scale * start.bias)
        self.rbf.lengthscale = torch.tensor(start.length_scales).reshape(1, -1)
        self.scaled.outputscale = torch.tensor(scale * start.amplitude)

    def parameters(self, K_rho, noise):
        """Parameters as the comparison has them."""
        return Parameters(
            to_numpy(self.rbf.lengthscale).ravel(),
            to_numpy(self.linear.variance).ravel(),
            to_numpy(self.bias.constant).item(),
            to_numpy(self.scaled.outputscale).item(),
            to_numpy(noise).item(),
            to_numpy(K_rho),
        )


def to_numpy(tensor):
    """A tensor's values in double precision."""
    return tensor.detach().double().numpy()


class DenseProduct(gpytorch.kernels.Kernel):
    """The elementwise product as a plain matrix, which is faster at these sizes.

    GPyTorch's own product keeps its factors, and may decompose each of them.
    """

    def __init__(self, kernel, task_kernel, column):
        super().__init__()
        self.kernel, self.task_kernel, self.column = kernel, task_kernel, column

    def forward(self, x1, x2, diag=False, **_):
        """Covariance of f at x1 and x2, the task in a column."""
        a, b = (x[..., self.column, None].long() for x in (x1, x2))
        if diag:
            return self.kernel(x1, x2, diag=True) * self.task_kernel(a, b, diag=True)
        K_rho = self.task_kernel._eval_covar_matrix()
        between = K_rho[a[..., 0]][..., b[..., 0]]
        return self.kernel(x1, x2).to_dense() * between


class Flat:
    """The learned parameters of a module as one vector, with bounds."""

    def __init__(self, module):
        named = [(k, p) for k, p in module.named_parameters() if p.requires_grad]
        self.names, self.tensors = zip(*named, strict=True)

    @property
    def x(self):
        """The vector."""
        return np.concatenate([to_numpy(p).ravel() for p in self.tensors])

    @x.setter
    def x(self, x):
        parts = np.split(x, np.cumsum([p.numel() for p in self.tensors])[:-1])
        with torch.no_grad():
            for tensor, part in zip(self.tensors, parts, strict=True):
                tensor.copy_(torch.from_numpy(part).reshape(tensor.shape))

    @property
    def gradient(self):
        """The vector of gradients."""
        return np.concatenate([to_numpy(p.grad).ravel() for p in self.tensors])

    @property
    def bounds_by_name(self):
        """Bounds of each tensor."""
        return {k: tuple(BOUNDS[k.split(".")[-1]]) for k in self.names}

    @property
    def bounds(self):
        """Bounds of each element."""
        return [
            tuple(bound)
            for bound, p in zip(self.bounds_by_name.values(), self.tensors, strict=True)
            for _ in range(p.numel())
        ]

    def clear(self):
        """Forget the gradients."""
        for tensor in self.tensors:
            tensor.grad = None


class TorchAdapter:
    """What the adapters of both packages share.

    Subclasses set `model`, `mll`, `inputs` (an InputKernel), `task_kernel`.
    """

    def prepare(self, problem):
        """Set what is needed to evaluate."""
        self.n = len(problem.y)
        self.flat = Flat(self.mll)
        self.mll.train()
        self.start_x = self.flat.x

    def likelihood(self):
        """Log marginal likelihood (and log prior, where there is one), a tensor."""
        output = self.model(*self.model.train_inputs)
        return self.mll(output, self.model.train_targets) * self.n

    def value_and_grad(self, x):
        """Log likelihood and gradient at x, or None where it fails."""
        self.flat.x = x
        self.flat.clear()
        try:
            value = self.likelihood()
            value.backward()
        except (RuntimeError, ValueError):  # NotPSDError, NanError, LinAlgError
            return None
        return value.item(), self.flat.gradient

    def evaluate(self, k):
        """The likelihood and its gradient, once."""
        return self.value_and_grad(self.start_x + 1e-6 * k)[0]

    def restore(self, x):
        """Go back to a state."""
        self.flat.x = x

    def parameters(self):
        """The current parameters."""
        kernel, noise = self.task_kernel, self.model.likelihood.noise
        return self.inputs.parameters(kernel._eval_covar_matrix(), noise)


def exact_settings():
    """Settings under which GPyTorch computes exactly, whatever n."""
    gpytorch.settings.fast_computations.covar_root_decomposition._set_state(False)
    gpytorch.settings.fast_computations.log_prob._set_state(False)
    gpytorch.settings.fast_computations.solves._set_state(False)
    gpytorch.settings.cholesky_jitter._set_value(1e-12, 1e-14, None)
    gpytorch.settings.debug._set_state(False)
