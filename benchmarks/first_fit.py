"""How long the first fit of a few hundred rows takes, beside scikit-learn's GPR.

``python benchmarks/first_fit.py`` draws 288 rows of six tasks with three inputs, fits
``MultiTaskGPRegressor()``, a ``RankSearchIC`` of ranks 0 to 4, and scikit-learn's
``GaussianProcessRegressor`` with a column for each task, and prints seconds of the
processor on one thread and the error over the deviation of the noise-free functions.
The GPR has an amplitude, a length-scale of each column and white noise, without
restarts. The goals: a fit takes no longer than the GPR's, and the search no longer than
three fits.
"""

import argparse
import time
import warnings
from statistics import median

import numpy as np
from sklearn.compose import make_column_transformer
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import OneHotEncoder, StandardScaler
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor, RankSearchIC

N, N_TASKS, N_INPUTS, N_TEST = 288, 6, 3, 600
LENGTH_SCALES = {"smooth": 2.0, "rough": 0.7}  # of inputs in [-1, 1]
NOISES = {"noise 0.03": 0.03, "noise 0.3": 0.3}  # over the functions' deviation


def draw(length_scale, noise, seed):
    """Training rows with the task last, their targets, test rows and their functions.

    Tasks are weighted sums of two draws of a Gaussian process, and have levels.
    """
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (N + N_TEST, N_INPUTS))
    task = np.arange(len(x)) % N_TASKS
    distances = np.square(x[:, None] - x).sum(axis=-1)
    K = np.exp(-0.5 * distances / length_scale**2) + 1e-9 * np.eye(len(x))
    functions = np.linalg.cholesky(K) @ rng.standard_normal((len(x), 2))
    weights, levels = rng.standard_normal((N_TASKS, 2)), rng.standard_normal(N_TASKS)
    f = (functions * weights[task]).sum(axis=1)
    f = f / f.std() + levels[task]
    X, y = np.column_stack([x, task]), f[:N] + noise * rng.standard_normal(N)
    return X[:N], y, X[N:], f[N:]


def gpr(smooth):
    """scikit-learn's GPR of standardised inputs and a column for each task."""
    of_columns = np.ones(N_INPUTS + N_TASKS)
    kernel = ConstantKernel() * smooth(of_columns) + WhiteKernel(0.1, (1e-8, 1e1))
    return make_pipeline(
        make_column_transformer(
            (StandardScaler(), slice(0, N_INPUTS)),
            (OneHotEncoder(sparse_output=False), [N_INPUTS]),
        ),
        GaussianProcessRegressor(kernel, normalize_y=True),
    )


MODELS = {
    "fit": MultiTaskGPRegressor,
    "ranks 0 to 4": lambda: RankSearchIC(ranks=range(5)),
    "GPR, RBF": lambda: gpr(RBF),
    "GPR, Matern 5/2": lambda: gpr(lambda scales: Matern(scales, nu=2.5)),
}


def measure(make, X, y, X_test, f_test):
    """Seconds of the processor, and the error over the functions' deviation."""
    model, begin = make(), time.process_time()
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
        seconds = time.process_time() - begin
        error = np.sqrt(np.mean(np.square(model.predict(X_test) - f_test)))
    return seconds, error / f_test.std()


def main():
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    print(f"{'data':20}{'model':17}{'seconds':>8}{'over GPR':>10}{'error':>8}")
    for name, length_scale in LENGTH_SCALES.items():
        for of, noise in NOISES.items():
            data = [draw(length_scale, noise, k) for k in range(arguments.seeds)]
            report(f"{name}, {of}", data)


def report(name, data):
    """A line for each model: medians over the draws."""
    found = {
        model: [measure(make, *of) for of in data] for model, make in MODELS.items()
    }
    base = [seconds for seconds, _ in found["GPR, RBF"]]
    for model, of_model in found.items():
        seconds, errors = zip(*of_model, strict=True)
        ratio = median(s / b for s, b in zip(seconds, base, strict=True))
        print(
            f"{name:20}{model:17}{median(seconds):8.2f}{ratio:10.2f}"
            f"{median(errors):8.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
