"""Locally weighted projection regression (LWPR), the comparator [8] of the paper.

Receptive fields with Gaussian weights, each with a local linear model that partial
least squares learns along a few directions, one sample after another; the shape of each
field learns by gradients of a local leave-one-out error. Vijayakumar, D'Souza and
Schaal, "Incremental online learning in high dimensions", Neural Computation 17 (2005),
sections 2 and 3, with their names.

``python benchmarks/lwpr.py`` checks it: it learns the 2-D cross function of the same
authors from 500 noisy samples, and prints the normalised error on a grid of 41 x 41,
beside that of a Gaussian process.
"""

import argparse

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

ACTIVE = 1e-3  # weight below which a field neither learns nor predicts
TINY = 1e-10
BEGIN = 5  # samples for each dimension, before the shape of a field learns
TRUSTED = 2  # samples for each dimension, before a new direction predicts


class Fields:
    """Receptive fields with their local models, one along the first axis of each array.

    Sums are weighted and forget: a direction r of a field has the sums ``ss`` of s_r^2,
    ``sr`` of s_r times the residual and ``xs`` of s_r x.
    """

    def __init__(self, d):
        self.of = {
            "centre": np.empty((0, d)),
            "M": np.empty((0, d, d)),  # upper triangle; the metric is D = M' M
            "W": np.empty(0),
            "mean_x": np.empty((0, d)),
            "mean_y": np.empty(0),
            "U": np.empty((0, d, d)),
            "P": np.empty((0, d, d)),
            "xs": np.empty((0, d, d)),
            "beta": np.empty((0, d)),
            "ss": np.empty((0, d)),
            "sr": np.empty((0, d)),
            "mse": np.empty((0, d + 1)),
            "E": np.empty(0),
            "H": np.empty((0, d + 1)),
            "R": np.empty((0, d + 1, d + 1)),
            "forgetting": np.empty(0),
            "seen": np.empty(0),
            "seen_last": np.empty(0),
            "n_directions": np.empty(0, dtype=int),
        }

    def __len__(self):
        return len(self.of["W"])

    def add(self, centre, M, forgetting):
        """One more, which knows nothing."""
        known = {"centre": centre, "M": M, "forgetting": forgetting, "n_directions": 1}
        for name, array in self.of.items():
            new = np.zeros_like(array, shape=(1, *array.shape[1:]))
            new[0] = known.get(name, TINY if name in ("W", "ss") else 0.0)
            self.of[name] = np.concatenate([array, new])

    def drop(self, k):
        """One less."""
        self.of = {name: np.delete(array, k, axis=0) for name, array in self.of.items()}

    def weights(self, X):
        """Of the samples, of shape (n_samples, n_fields)."""
        away = X[:, None] - self.of["centre"]
        reach = np.einsum("kij,nkj->nki", self.of["M"], away)
        return np.exp(-0.5 * np.einsum("nki,nki->nk", reach, reach))


def project(f, x):
    """Coordinates of samples, one a field, along its directions."""
    z, s = x - f["mean_x"], np.zeros(f["beta"].shape)
    lengths = np.sqrt(np.einsum("krd,krd->kr", f["U"], f["U"]))
    for r in range(f["n_directions"].max()):
        used = (f["n_directions"] > r) & (lengths[:, r] > TINY)
        s[:, r] = np.where(
            used,
            np.einsum("kd,kd->k", z, f["U"][:, r]) / np.maximum(lengths[:, r], TINY),
            0.0,
        )
        z = z - s[:, r, None] * f["P"][:, r]
    return s


def predict(f, x):
    """Of each local model; the last direction counts when it has seen enough."""
    trusted = f["n_directions"] - (f["seen_last"] < TRUSTED * x.shape[-1])
    s = project(f, x) * (np.arange(x.shape[-1]) < trusted[:, None])
    return f["mean_y"] + np.einsum("kr,kr->k", s, f["beta"])


def learn(f, x, y, w, model):
    """Update local models and shapes by a sample of weights w."""
    keep = f["forgetting"]
    old = keep * f["W"]
    f["W"] = old + w
    f["mean_x"] = (old[:, None] * f["mean_x"] + np.outer(w, x)) / f["W"][:, None]
    f["mean_y"] = (old * f["mean_y"] + w * y) / f["W"]
    z, rest = x - f["mean_x"], y - f["mean_y"]
    f["mse"][:, 0] = keep * f["mse"][:, 0] + w * rest**2
    s = np.zeros(f["beta"].shape)
    for r in range(f["n_directions"].max()):
        used = f["n_directions"] > r
        U = keep[:, None] * f["U"][:, r] + (w * rest)[:, None] * z
        length = np.sqrt(np.einsum("kd,kd->k", U, U))
        used &= length > TINY
        s_r = np.einsum("kd,kd->k", z, U) / np.maximum(length, TINY) * used
        ss = keep * f["ss"][:, r] + w * s_r**2
        sr = keep * f["sr"][:, r] + w * s_r * rest
        xs = keep[:, None] * f["xs"][:, r] + (w * s_r)[:, None] * z
        beta, P = sr / ss * used, xs / ss[:, None] * used[:, None]
        rest, z = rest - s_r * beta, z - s_r[:, None] * P
        s[:, r], f["beta"][:, r], f["P"][:, r] = s_r, beta, P
        f["U"][:, r] = np.where(used[:, None], U, f["U"][:, r])
        f["ss"][:, r] = np.where(used, ss, f["ss"][:, r])
        f["sr"][:, r], f["xs"][:, r] = sr, xs
        mse = keep * f["mse"][:, r + 1] + w * rest**2
        f["mse"][:, r + 1] = np.where(used, mse, f["mse"][:, r + 1])
    f["seen"], f["seen_last"] = f["seen"] + w, f["seen_last"] + w
    reshape(f, x, rest, np.column_stack([np.ones(len(s)), s]), w, model)
    tau = model.tau_lambda
    f["forgetting"] = tau * keep + (1.0 - tau) * model.final_lambda
    grow(f, model)


def reshape(f, x, rest, s, w, model):
    """A step of the metric down the gradient of the leave-one-out error."""
    keep, d = f["forgetting"], len(x)
    Ps = s / np.column_stack([f["W"], np.maximum(f["ss"], TINY)])
    h = np.minimum(w * np.einsum("kr,kr->k", s, Ps), 0.99)
    left_out = rest / (1.0 - h)
    quadratic = np.einsum("kr,krs,ks->k", Ps, f["R"], Ps)
    linear = rest * np.einsum("kr,kr->k", Ps, f["H"])
    d_w = -f["E"] / f["W"] ** 2
    d_w += (left_out**2 - 2.0 * linear - 2.0 * quadratic) / f["W"]
    away, M = x - f["centre"], f["M"]
    reach = np.einsum("kij,kj->ki", M, away)
    d_M = -(w * d_w)[:, None, None] * np.einsum("ki,kj->kij", reach, away)
    D = np.einsum("kji,kjl->kil", M, M)
    d_M += (4.0 * model.penalty / d * w / f["W"])[:, None, None] * (M @ D)
    step = model.alpha * np.triu(d_M)
    size = np.abs(step).max(axis=(1, 2))
    limit = 0.1 * np.abs(M).max(axis=(1, 2))
    ready = (f["seen"] >= BEGIN * d) & (f["E"] > 0.0) & np.isfinite(size)
    scale = np.minimum(1.0, limit / np.maximum(size, TINY)) * ready
    f["M"] = M - scale[:, None, None] * np.where(ready[:, None, None], step, 0.0)
    w = np.where(f["seen"] >= BEGIN * d, w, 0.0)
    f["E"] = keep * f["E"] + w * left_out**2
    f["H"] = keep[:, None] * f["H"] + (w * left_out / (1.0 - h))[:, None] * s
    outer = np.einsum("kr,ks->krs", s, s)
    weight = w**2 * left_out**2 / (1.0 - h)
    f["R"] = keep[:, None, None] * f["R"] + weight[:, None, None] * outer


def grow(f, model):
    """One more direction for fields whose last one has paid."""
    d, n = f["centre"].shape[1], f["n_directions"]
    rows = np.arange(len(n))
    paid = f["mse"][rows, n] < model.add_threshold * f["mse"][rows, n - 1]
    more = paid & (n < d) & (f["seen_last"] >= TRUSTED * d)
    f["n_directions"] = n + more
    f["seen_last"] = np.where(more, 0.0, f["seen_last"])


class LWPR(RegressorMixin, BaseEstimator):
    """Locally weighted projection regression of one output.

    Parameters
    ----------
    init_D : float, default=50
        Metric of a new field, the same for all inputs: standardise them before.
    alpha : float, default=500
        Learning rate of the metric; 0 keeps it.
    penalty : float, default=1e-7
        Of the metric's size.
    w_gen : float, default=0.2
        Weight below which of all fields a sample makes a new one.
    w_prune : float, default=0.9
        Weight above which of two fields at a sample the narrower is dropped.
    init_lambda, final_lambda, tau_lambda : float
        Forgetting at the beginning, in the end, and how slowly it gets there.
    add_threshold : float, default=0.5
        Share of the error that a direction must leave at most for another one.
    n_epochs : int, default=60
        Times that `fit` sees the data, in random order.
    random_state : int, default=0
        Of the order.
    """

    def __init__(
        self,
        init_D=50.0,
        alpha=500.0,
        penalty=1e-7,
        w_gen=0.2,
        w_prune=0.9,
        init_lambda=0.995,
        final_lambda=0.9999,
        tau_lambda=0.9995,
        add_threshold=0.5,
        n_epochs=60,
        random_state=0,
    ):
        self.init_D = init_D
        self.alpha = alpha
        self.penalty = penalty
        self.w_gen = w_gen
        self.w_prune = w_prune
        self.init_lambda = init_lambda
        self.final_lambda = final_lambda
        self.tau_lambda = tau_lambda
        self.add_threshold = add_threshold
        self.n_epochs = n_epochs
        self.random_state = random_state

    def fit(self, X, y):
        """Learn from all rows, `n_epochs` times."""
        X, y = validate_data(self, X, y, y_numeric=True)
        self.fields_, rng = Fields(X.shape[1]), check_random_state(self.random_state)
        self.mean_y_ = float(np.mean(y))
        for _ in range(self.n_epochs):
            for i in rng.permutation(len(X)):
                self._learn(X[i], y[i])
        return self

    def _learn(self, x, y):
        fields = self.fields_
        weights = fields.weights(x[None])[0]
        if weights.max(initial=0.0) < self.w_gen:
            fields.add(x, np.sqrt(self.init_D) * np.eye(len(x)), self.init_lambda)
            weights = np.append(weights, 1.0)
        active = np.flatnonzero(weights > ACTIVE)
        f = {name: array[active] for name, array in fields.of.items()}
        learn(f, x, y, weights[active], self)
        for name, array in fields.of.items():
            array[active] = f[name]
        if len(weights) > 1:
            pair = np.argsort(weights)[-2:]
            if weights[pair[0]] > self.w_prune:
                sizes = [np.abs(np.linalg.det(fields.of["M"][k])) for k in pair]
                fields.drop(pair[int(np.argmax(sizes))])

    def predict(self, X):
        """Predictions: the fields' own, averaged by their weights."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False)
        weights = self.fields_.weights(X)
        nearest = weights.max(axis=1, keepdims=True)
        weights = np.where((weights > ACTIVE) | (weights == nearest), weights, 0.0)
        of, k = self.fields_.of, len(self.fields_)
        own = np.array([predict(of, np.tile(x, (k, 1))) for x in X])
        total = weights.sum(axis=1)
        mean = (weights * own).sum(axis=1) / np.where(total > 0.0, total, 1.0)
        return np.where(total > 0.0, mean, self.mean_y_)


def cross(X):
    """The cross function of two inputs between -1 and 1."""
    a, b = np.square(X).T
    ridges = np.exp(-10.0 * a), np.exp(-50.0 * b), 1.25 * np.exp(-5.0 * (a + b))
    return np.max(ridges, axis=0)


def cross_data(seed, n=500, noise=0.1):
    """Training rows, and a grid with the truth."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (n, 2))
    axis = np.linspace(-1.0, 1.0, 41)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return X, cross(X) + noise * rng.standard_normal(n), grid, cross(grid)


def nmse(model, grid, truth):
    """Mean squared error over the variance of the truth."""
    return float(np.mean((model.predict(grid) - truth) ** 2) / np.var(truth))


def main():
    """Print the errors of a few draws."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    kernel = ConstantKernel() * RBF([0.3, 0.3]) + WhiteKernel(0.01)
    for seed in range(parser.parse_args().seeds):
        X, y, *test = cross_data(seed)
        model = LWPR(random_state=seed).fit(X, y)
        peer = GaussianProcessRegressor(kernel, normalize_y=True).fit(X, y)
        print(
            f"draw {seed}: nMSE {nmse(model, *test):.4f}, {len(model.fields_)} fields; "
            f"Gaussian process {nmse(peer, *test):.4f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
