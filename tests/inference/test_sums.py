import tracemalloc

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF
from sparse_bounds import ARD, EVERY, KERNELS, D, M, Sample, draw, make, parameters

from skmtgp.inference.features import Features
from skmtgp.inference.gradients import Adjoint, Gradients
from skmtgp.inference.sums import (
    WINDOW,
    blocks_by_task,
    sum_features,
    sum_gradients,
)
from skmtgp.model.task_covariance import low_rank


class TestSums:
    """What is made of the rows adds up over them."""

    @pytest.fixture(params=["paper", "unknown"])
    def bound(self, request):
        return make(EVERY[request.param], low_rank(M, 2, diagonal=True), M)

    def test_forward(self, bound):
        theta = building.parts(
            bound, parameters(bound.prior.kernel, bound.prior.task_covariance, M)
        )[0]
        features = Features(bound.prior.kernels_with(theta), bound.Z)
        blocks = list(bound.blocks())
        whole = sum_features(features, M, blocks)
        halves = (
            sum_features(features, M, blocks[:2]),
            sum_features(features, M, blocks[2:]),
        )
        self.check(halves[0] + halves[1], whole)
        none = sum_features(features, M, [])
        self.check(whole + none, whole)

    def test_backward(self, bound):
        theta = parameters(bound.prior.kernel, bound.prior.task_covariance, M)
        phi, weights = bound.forward(theta)
        adjoint, blocks = Gradients(weights).adjoint(), list(bound.blocks())
        whole, one, two = (
            sum_gradients(phi, adjoint, some)
            for some in (blocks, blocks[:2], blocks[2:])
        )
        self.check(one + two, whole)

    def check(self, actual, expected):
        assert type(actual) is type(expected)
        for name, value in vars(expected).items():
            np.testing.assert_allclose(
                getattr(actual, name), value, rtol=1e-11, atol=1e-11
            )

    def test_are_small(self, bound):
        theta = parameters(bound.prior.kernel, bound.prior.task_covariance, M)
        phi, weights = bound.forward(theta)
        m, adjoint = len(bound.Z), Gradients(weights).adjoint()
        for sums in (weights.sums, sum_gradients(phi, adjoint, bound.blocks())):
            assert max(part.size for part in vars(sums).values()) <= M * m * m


def test_blocks_have_few_tasks():
    n, n_tasks, size, rng = 500, 40, 20, np.random.default_rng(0)
    tasks = rng.integers(0, n_tasks, n)
    X, y = np.column_stack([np.arange(n), tasks]), np.arange(n)
    found = list(blocks_by_task(X, tasks, y, size))
    for features, codes, targets in found:
        np.testing.assert_array_equal(features[:, 0], targets)
        np.testing.assert_array_equal(features[:, 1], codes)
        assert len(targets) <= size
    np.testing.assert_array_equal(np.sort(np.concatenate([y for *_, y in found])), y)
    parts = sum(len(np.unique(codes)) for _, codes, _ in found)
    n_windows = -(-n // (WINDOW * size))
    assert parts <= n_windows * n_tasks + len(found)


def test_rows_on_disk(tmp_path):
    kernel, form = KERNELS["paper"], low_rank(M, 2)
    mapped = []
    for name, part in draw()._asdict().items():
        np.save(tmp_path / f"{name}.npy", part)
        mapped.append(np.load(tmp_path / f"{name}.npy", mmap_mode="r"))
    theta = parameters(kernel, form)
    value, gradient = make(kernel, form, sample=Sample(*mapped)).value_and_grad(theta)
    expected = make(kernel, form).value_and_grad(theta)
    assert value == expected[0]
    np.testing.assert_array_equal(gradient, expected[1])


def test_rows_of_single_precision():
    kernel, form, (X, tasks, y) = RBF(ARD), low_rank(M, 2), draw()
    X, y = X.astype(np.float32), y.astype(np.float32)
    theta = parameters(kernel, form)
    value = make(kernel, form, sample=Sample(X, tasks, y)).value(theta)
    double = Sample(X.astype(float), tasks, y.astype(float))
    assert value == make(kernel, form, sample=double).value(theta)


def test_memory():
    n, m, rng = 20_000, 50, np.random.default_rng(0)
    X, tasks, y = rng.standard_normal((n, D)), np.arange(n) % M, rng.standard_normal(n)
    kernel, form = KERNELS["paper"], low_rank(M, 2)
    bound = building.sparse(kernel, form, X, tasks, y, X[:m], block_size=100)
    theta = parameters(kernel, form)
    tracemalloc.start()
    try:
        bound.value_and_grads(theta)
        bound.posterior(theta)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.25 * 8 * n * m


@pytest.mark.parametrize(("n_inducing", "n_calls"), [(2, 1), (20, 0)])
def test_adjoints_are_pulled_back_for_sums_or_for_rows(
    n_inducing, n_calls, monkeypatch
):
    """For the fewer of them, with the same gradients."""
    kernel, form = KERNELS["paper"], low_rank(M, 2, diagonal=True)
    X, tasks, y = draw()
    bound = building.sparse(kernel, form, X, tasks, y, X[:n_inducing], levels=True)
    theta, called = bound.prior.theta(K_rho=np.eye(M) + 0.5), []
    pulled_back = Adjoint.pulled_back

    def spy(adjoint, half_solve):
        called.append(adjoint)
        return pulled_back(adjoint, half_solve)

    monkeypatch.setattr(Adjoint, "pulled_back", spy)
    bound.value_and_grads(theta)
    assert len(called) == n_calls
    features, weights = bound.forward(theta)
    one = Gradients(weights).adjoint()
    other = pulled_back(one._replace(C=one.C.copy()), features.pull_back)
    sums = [
        sum_gradients(features, adjoint, bound.blocks(), inputs=True)
        for adjoint in (one, other)
    ]
    np.testing.assert_allclose(sums[0].theta, sums[1].theta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(sums[0].Z, sums[1].Z, rtol=1e-9, atol=1e-9)
