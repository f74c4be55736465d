"""The model: its prior, covariances between tasks, kernels in tiles."""
