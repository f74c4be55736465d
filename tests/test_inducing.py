import numpy as np
import pytest
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    WhiteKernel,
)

from skmtgp.inference import inducing
from skmtgp.inference.inducing import greedy_variance, k_means, optimised
from skmtgp.inference.sparse import SparseBound
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.task_covariance import low_rank

KERNELS = {
    "paper": inverse_dynamics_kernel(1),
    "rbf": RBF(1.3),
    "white": ConstantKernel(0.7) * RBF((0.5, 1.0, 2.0, 1.5)) + WhiteKernel(0.1),
    "sine": ExpSineSquared(1.1, 2.0) + DotProduct(0.3),
}


def draw(n=40, seed=0):
    return np.random.default_rng(seed).standard_normal((n, 4))


def naive(kernel, X, n_inducing):
    """Rows by their conditional variance, each time computed anew."""
    K, chosen = kernel(X), []
    for _ in range(n_inducing):
        among, cross = K[np.ix_(chosen, chosen)], K[chosen]
        variance = np.diagonal(K) - np.sum(cross * np.linalg.solve(among, cross), 0)
        variance[chosen] = -np.inf
        chosen.append(int(np.argmax(variance)))
    return X[chosen]


@pytest.mark.parametrize("name", KERNELS)
def test_greedy_variance(name):
    X = draw()
    Z = greedy_variance(KERNELS[name], X, 12)
    np.testing.assert_array_equal(Z, naive(KERNELS[name], X, 12))
    np.testing.assert_array_equal(greedy_variance(KERNELS[name], X, 5), Z[:5])


def test_no_row_is_chosen_twice():
    chosen = greedy_variance(RBF(5.0) + WhiteKernel(0.1), draw(), 100)
    assert sorted(map(tuple, chosen)) == sorted(map(tuple, draw()))


def test_no_more_than_there_is_variance():
    X, K = np.repeat(draw(6), 3, axis=0), RBF(1.3)
    Z = greedy_variance(K, X, 10)
    assert sorted(map(tuple, Z)) == sorted(map(tuple, draw(6)))
    assert len(greedy_variance(DotProduct(1.0), draw(), 10)) == 5  # and the constant
    assert len(greedy_variance(ConstantKernel(2.0), draw(), 10)) == 1
    np.linalg.cholesky(RBF(9.0)(greedy_variance(RBF(9.0), draw(500), 400)))


def test_some_of_the_rows_are_candidates(tmp_path):
    X = draw(200)
    np.save(tmp_path / "X.npy", X)
    mapped = np.load(tmp_path / "X.npy", mmap_mode="r")
    seeded = {"n_candidates": 30, "random_state": 1}
    Z = greedy_variance(RBF(), mapped, 30, **seeded)
    among = np.sort(np.random.RandomState(1).choice(200, 30, replace=False))
    np.testing.assert_array_equal(Z, naive(RBF(), X[among], len(Z)))
    assert len(np.unique(Z, axis=0)) == 30


@pytest.mark.parametrize("many", [150, 10])
def test_k_means(many, monkeypatch):
    monkeypatch.setattr(inducing, "CANDIDATES", many)
    centres = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]])
    rng = np.random.default_rng(0)
    X = np.repeat(centres, 50, axis=0) + 0.1 * rng.standard_normal((150, 2))
    Z = k_means(X, 3, random_state=0)
    nearest = np.argmin([[np.linalg.norm(z - c) for z in Z] for c in centres], 1)
    np.testing.assert_allclose(Z[nearest], centres, atol=0.1)
    np.testing.assert_array_equal(k_means(X, 3, random_state=0), Z)
    assert k_means(X.astype(np.float32), 3, random_state=0).dtype == np.float64


def test_k_means_of_few_rows():
    Z = k_means(draw(5), 9, random_state=0)
    np.testing.assert_allclose(Z, np.unique(draw(5), axis=0), rtol=1e-12)


def make(kernel, Z):
    rng, X, tasks = np.random.default_rng(1), draw(120), np.arange(120) % 3
    y = np.sin(X[:, 0]) * (1 + tasks) + 0.1 * rng.standard_normal(120)
    return SparseBound(kernel, low_rank(3, 1), X, tasks, y, Z)


def test_optimised():
    theta = np.r_[np.log(1.3), 1.0, 2.0, 3.0, np.log(1e-2)]
    bound = make(RBF(), draw()[:10])
    Z = optimised(bound, theta)
    assert Z.shape == bound.Z.shape
    value, _, before = bound.value_and_grads(theta)
    better, _, after = bound.with_inducing(Z).value_and_grads(theta)
    assert better > value + 100.0
    assert np.abs(after).max() < 0.1 * np.abs(before).max()
    further = bound.with_inducing(optimised(bound, theta, max_iter=20))
    assert value < further.value(theta) <= better


def test_optimised_where_a_feature_is_constant():
    theta = np.r_[np.log(1.3), 1.0, 2.0, 3.0, np.log(1e-2)]
    bound = make(RBF(), np.zeros((1, 4)))
    better = bound.with_inducing(optimised(bound, theta, max_iter=5))
    assert better.value(theta) > bound.value(theta)


def test_optimised_where_the_bound_fails():
    bound, theta = make(RBF(), draw()[:3]), np.full(5, np.nan)
    np.testing.assert_array_equal(optimised(bound, theta), bound.Z)


def test_optimised_of_an_unknown_kernel():
    bound = make(ExpSineSquared(1.1, 2.0), draw()[:3])
    with pytest.raises(ValueError, match=r"not known of kernel=ExpSine"):
        optimised(bound, np.zeros(6))
