"""Small data of related tasks, and the fitted model written out by hand."""

import numpy as np
import textbook


def draw(per_task=10, n_tasks=3, n_outputs=None, seed=0):
    """X with two features and the task last, in no order, and y of some unit."""
    rng = np.random.default_rng(seed)
    tasks = rng.permutation(np.repeat(np.arange(n_tasks), per_task))
    x = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    basis = np.column_stack([np.sin(1.5 * x[:, 0]), x[:, 1], np.cos(x).prod(axis=1)])
    weights = rng.normal(size=(n_outputs or 1, n_tasks, 3))
    y = np.einsum("nb,jnb->nj", basis, weights[:, tasks])
    y += 0.1 * rng.standard_normal(y.shape)
    y = 5.0 + 20.0 * y * np.arange(1, y.shape[1] + 1)
    return np.column_stack([x, tasks]), y if n_outputs else y[:, 0]


def split(X):
    """Features and tasks."""
    return X[:, :-1], X[:, -1].astype(int)


def outputs(model):
    """Kernel, K^rho, noise and mean of each output, in units of y."""
    if isinstance(model.kernel_, list):
        return list(
            zip(
                model.kernel_,
                model.task_covariance_,
                model.noise_variance_,
                model.y_mean_,
                strict=True,
            )
        )
    names = "kernel_", "task_covariance_", "noise_variance_", "y_mean_"
    return [tuple(getattr(model, name) for name in names)]


def log_densities(model, X, y):
    """log p(y) of each output."""
    x, tasks = split(X)
    return [
        textbook.log_marginal_likelihood(
            textbook.covariance(kernel, K_rho, noise, x, tasks), t - mean
        )
        for (kernel, K_rho, noise, mean), t in zip(
            outputs(model), y.reshape(len(y), -1).T, strict=True
        )
    ]


def posteriors(model, X, y, Z):
    """Mean and covariance of f(Z) of each output."""
    found = []
    for (kernel, K_rho, noise, centre), t in zip(
        outputs(model), y.reshape(len(y), -1).T, strict=True
    ):
        mean, cov = textbook.posterior(
            kernel, K_rho, noise, *split(X), t - centre, *split(Z)
        )
        found.append((mean + centre, cov))
    return found


class Listener:
    """Keeps what learning tells of its progress."""

    def __init__(self):
        self.stages, self.lines = [], []

    def __call__(self, stage, n_jobs, describe):
        self.stages.append((stage, n_jobs))
        return lambda i, result: self.lines.append(describe(i, result))
