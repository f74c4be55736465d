"""The model of docs/migrating.md in GPflow."""

import gpflow
import numpy as np
from data import task, task_new, x, x_new, y

X, X_new = np.column_stack([x, task]), np.column_stack([x_new, task_new])
y_mean, y_scale = y.mean(), y.std()

kernel = gpflow.kernels.SquaredExponential(lengthscales=[1.0, 1.0], active_dims=[0, 1])
gpflow.set_trainable(kernel.variance, False)  # the task covariance has the scale
tasks = gpflow.kernels.Coregion(output_dim=3, rank=2, active_dims=[2])
tasks.W.assign(np.random.default_rng(0).standard_normal((3, 2)))
model = gpflow.models.GPR((X, ((y - y_mean) / y_scale)[:, None]), kernel * tasks)
gpflow.optimizers.Scipy().minimize(model.training_loss, model.trainable_variables)

mean, variance = (a.numpy()[:, 0] for a in model.predict_f(X_new))
mean, std = y_mean + y_scale * mean, y_scale * np.sqrt(variance)
