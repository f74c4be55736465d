import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    WhiteKernel,
)

from skmtgp.inference.inducing import (
    check_differentiable,
    greedy_variance,
    k_means,
    optimised,
)
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.model.several import Kernels
from skmtgp.model.task_covariance import low_rank

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


@pytest.mark.parametrize("sizes", [None, np.array([1.0, 0.2])])
def test_greedy_variance_of_several_terms(sizes):
    """Of each the conditional variances, which are summed."""
    X, kernels = draw(), [RBF(1.3), ConstantKernel(0.5) * RBF(0.7)]
    counts = np.ones(2) if sizes is None else sizes
    Z = greedy_variance(Kernels(kernels), X, 12, sizes=sizes)
    chosen = []
    for _ in range(12):
        total = np.zeros(len(X))
        for kernel, size in zip(kernels, counts, strict=True):
            K = kernel(X)
            told = np.linalg.solve(K[np.ix_(chosen, chosen)], K[chosen])
            total += size * (np.diagonal(K) - np.sum(K[chosen] * told, axis=0))
        total[chosen] = -np.inf
        chosen.append(int(np.argmax(total)))
    np.testing.assert_array_equal(Z, X[chosen])


def test_a_slow_term_ends_no_choice():
    X = np.linspace(0.0, 1.0, 200)[:, None]
    slow, fast = RBF(3.0), RBF(0.02)
    assert len(greedy_variance(slow, X, 60)) < 15
    Z = greedy_variance(Kernels([slow, fast]), X, 60)
    assert len(Z) == 60
    np.linalg.cholesky(fast(Z))
    sizes = np.array([1.0, np.finfo(float).tiny])  # a term that is next to nothing
    few = greedy_variance(Kernels([slow, fast]), X, 8, sizes=sizes)
    np.testing.assert_array_equal(few, greedy_variance(slow, X, 8))


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


def clustered():
    """Rows around three centres, the second feature in small units."""
    centres = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9000.0]])
    rows = np.random.default_rng(0).standard_normal((50, 3, 2)) * [0.1, 100.0]
    return centres, (rows + centres).reshape(-1, 2)


def test_k_means():
    centres, X = clustered()
    Z = k_means(X, 3, random_state=0)
    found, expected = (of[np.argsort(of @ [100.0, 1.0])] for of in (Z, centres))
    np.testing.assert_allclose(found[:, 0], expected[:, 0], atol=0.1)
    np.testing.assert_allclose(found[:, 1], expected[:, 1], atol=100.0)
    np.testing.assert_array_equal(k_means(X, 3, random_state=0), Z)
    assert k_means(X.astype(np.float32), 3, random_state=0).dtype == np.float64


def test_k_means_of_some_of_the_rows(tmp_path):
    _, X = clustered()
    np.save(tmp_path / "X.npy", X)
    mapped = np.load(tmp_path / "X.npy", mmap_mode="r")
    Z = k_means(mapped, 3, n_candidates=30, random_state=1)
    np.testing.assert_array_equal(Z, k_means(X, 3, n_candidates=30, random_state=1))
    rng = np.random.RandomState(1)
    among = X[np.sort(rng.choice(150, 30, replace=False))]
    np.testing.assert_array_equal(Z, k_means(among, 3, random_state=rng))


def test_k_means_of_few_rows():
    X = draw(5)
    for rows in (X, np.repeat(X, 3, axis=0)):
        Z = k_means(rows, 9, random_state=0)
        found, expected = (np.unique(of.round(9), axis=0) for of in (Z, X))
        np.testing.assert_array_equal(found, expected)
        assert len(greedy_variance(RBF(), Z, 9)) == 5


def test_k_means_where_a_feature_is_constant():
    X = np.column_stack([draw(30), np.full(30, 7.0)])
    np.testing.assert_array_equal(k_means(X, 4, random_state=0)[:, -1], 7.0)


def make(kernel, Z):
    rng, X, tasks = np.random.default_rng(1), draw(120), np.arange(120) % 3
    y = np.sin(X[:, 0]) * (1 + tasks) + 0.1 * rng.standard_normal(120)
    return building.sparse(kernel, low_rank(3, 1), X, tasks, y, Z)


def test_optimised():
    theta = np.r_[np.log(1.3), 1.0, 2.0, 3.0, np.log(1e-2)]
    bound = make(RBF(), draw()[:10])
    Z, n_evaluations = optimised(bound, theta)
    assert Z.shape == bound.Z.shape
    assert n_evaluations > 10
    value, _, before = bound.value_and_grads(theta)
    better, _, after = bound.with_inducing(Z).value_and_grads(theta)
    assert better > value + 100.0
    assert np.abs(after).max() < 0.1 * np.abs(before).max()
    few = [optimised(bound, theta, max_iter=20), optimised(bound, theta, tol=100.0)]
    for Z, n_fewer in few:
        assert value < bound.with_inducing(Z).value(theta) <= better
        assert n_fewer < n_evaluations


def test_optimised_without_iterations():
    bound = make(RBF(), draw()[:10])
    Z, n_evaluations = optimised(bound, np.zeros(5), max_iter=0)
    np.testing.assert_array_equal(Z, bound.Z)
    assert n_evaluations == 1


def test_optimised_where_a_feature_is_constant():
    theta = np.r_[np.log(1.3), 1.0, 2.0, 3.0, np.log(1e-2)]
    bound = make(RBF(), np.zeros((1, 4)))
    better = bound.with_inducing(optimised(bound, theta, max_iter=5)[0])
    assert better.value(theta) > bound.value(theta)


def test_optimised_where_the_bound_fails():
    bound, theta = make(RBF(), draw()[:3]), np.full(5, np.nan)
    np.testing.assert_array_equal(optimised(bound, theta)[0], bound.Z)


def test_optimised_of_an_unknown_kernel():
    bound = make(ExpSineSquared(1.1, 2.0), draw()[:3])
    with pytest.raises(ValueError, match=r"not known of kernel=ExpSine"):
        optimised(bound, np.zeros(6))


@pytest.mark.parametrize("name", KERNELS)
def test_check_differentiable(name):
    if name == "sine":
        with pytest.raises(ValueError, match="Set inducing_inputs='greedy'"):
            check_differentiable(KERNELS[name], draw(1))
    else:
        check_differentiable(KERNELS[name], draw(1))
