"""GPy's models of tasks, for real_data.py.

The kernels of ``GPy.util.multioutput``'s ICM and LCM, and the noise of its
GPCoregionalizedRegression, built by hand for the rows as they are.
"""

import warnings

import GPy
import numpy as np
from tasks import main, start


class Adapter:
    """A sum of kernels times Coregionalize."""

    def __init__(self, problem, shape, rng, *, drawn):
        warnings.simplefilter("ignore")
        tasks = problem.X[:, -1:].astype(int)
        self.own_noise = shape.own_noise
        if shape.own_noise:
            each = [GPy.likelihoods.Gaussian(variance=0.1) for _ in np.unique(tasks)]
            likelihood = GPy.likelihoods.MixedNoise(each)
        else:
            likelihood = GPy.likelihoods.Gaussian(variance=0.1)
        self.model = GPy.core.GP(
            problem.X,
            problem.y[:, None],
            self.kernel(shape, problem, *start(shape, problem, rng, drawn=drawn)),
            likelihood,
            Y_metadata={"output_index": tasks},
        )

    @staticmethod
    def kernel(shape, problem, scales, factors):
        """Covariance of f, without the amplitudes that task covariances have."""
        d, n_tasks = problem.n_features, problem.n_tasks
        kern, inputs = GPy.kern, range(d)
        parts = []
        for lengthscale in scales:
            smooth = kern.RBF(
                d, lengthscale=lengthscale, ARD=True, active_dims=inputs, name="smooth"
            )
            smooth.variance.fix(1.0)
            parts.append(smooth)
        bias = kern.Bias(d, 0.1, active_dims=inputs)
        if shape.levels:
            bias.variance.fix()
            parts.append(bias)
        else:
            parts[0] = parts[0] + bias
        products = []
        for part, W in zip(parts, factors, strict=True):
            kappa = np.full(n_tasks, 0.1)
            tasks = kern.Coregionalize(
                1, n_tasks, shape.rank, W=W, kappa=kappa, active_dims=[d]
            )
            products.append(part * tasks)
        return products[0] if len(products) == 1 else kern.Add(products)

    @property
    def x(self):
        """The optimiser's vector."""
        return self.model.optimizer_array.copy()

    def value_and_grad(self, x):
        """Log likelihood and gradient at x, or None where it fails."""
        try:
            self.model.optimizer_array = x
            gradient = self.model._transform_gradients(
                self.model.objective_function_gradients()
            )
            return float(self.model.log_likelihood()), -gradient
        except (np.linalg.LinAlgError, ZeroDivisionError, ValueError):
            return None

    def predict(self, X):
        """Mean and standard deviation of y."""
        mean, variance = self.model.predict_noiseless(X)
        likelihood, tasks = self.model.likelihood, X[:, -1].astype(int)
        if self.own_noise:
            each = [float(one.variance[0]) for one in likelihood.likelihoods_list]
            noise = np.array(each)[tasks]
        else:
            noise = float(likelihood.variance[0])
        return mean[:, 0], np.sqrt(variance[:, 0] + noise)


if __name__ == "__main__":
    main(Adapter)
