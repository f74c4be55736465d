import numpy as np
import pytest
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    WhiteKernel,
)

from skmtgp.inference.inducing import greedy_variance
from skmtgp.kernels import inverse_dynamics_kernel

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
