"""The model of docs/migrating.md in GPy."""

import GPy
import numpy as np
from data import task, task_new, x, x_new, y

np.random.seed(0)  # noqa: NPY002, GPy draws from it
kernel = GPy.util.multioutput.ICM(
    input_dim=2, num_outputs=3, kernel=GPy.kern.RBF(2, ARD=True), W_rank=2
)
kernel.rbf.variance.fix(1.0)  # the task covariance has the scale
model = GPy.models.GPRegression(
    np.column_stack([x, task]), y[:, None], kernel, normalizer=True
)
model.optimize_restarts(5, verbose=False)

mean, variance = model.predict_noiseless(np.column_stack([x_new, task_new]))
mean, std = mean[:, 0], np.sqrt(variance[:, 0])
