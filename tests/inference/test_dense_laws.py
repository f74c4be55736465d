import building
import hypothesis.strategies as st
import numpy as np
from dense_models import ARD, KERNELS, M, draw
from hypothesis import given, settings
from sklearn.gaussian_process.kernels import RBF

from skmtgp.model.task_covariance import low_rank

seeds = st.integers(0, 2**32 - 1)
names = st.sampled_from(sorted(KERNELS))
quick = settings(max_examples=40, deadline=None)


def value_and_kernel_gradient(kernel, F, noise, X, tasks, y):
    form = low_rank(*F.shape)
    theta = np.concatenate([kernel.theta, F.ravel(), np.log(noise)])
    likelihood = building.dense(kernel, form, X, tasks, y, len(noise))
    value, gradient = likelihood.value_and_grad(theta)
    return np.r_[value, gradient[: kernel.n_dims]]


def random_model(seed):
    rng = np.random.default_rng(seed)
    return rng, rng.standard_normal((M, 2)), 0.05 + rng.random(M), draw(seed)


@given(names, seeds)
@quick
def test_order_within_a_task_does_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    order = np.lexsort([rng.random(len(y)), tasks])
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    actual = value_and_kernel_gradient(
        KERNELS[name], F, noise, X[order], tasks[order], y[order]
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds)
@quick
def test_labels_of_tasks_do_not_matter(name, seed):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    label = rng.permutation(M)  # of each task
    order = np.argsort(label[tasks], kind="stable")
    new = np.argsort(label)  # the task of each label
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    actual = value_and_kernel_gradient(
        KERNELS[name], F[new], noise[new], X[order], label[tasks][order], y[order]
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds, st.integers(0, M - 1))
@quick
def test_a_task_may_be_two_equal_ones(name, seed, task):
    rng, F, noise, (X, tasks, y) = random_model(seed)
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    twin = np.where((tasks == task) & (rng.random(len(y)) < 0.5), M, tasks)
    order = np.argsort(twin, kind="stable")
    actual = value_and_kernel_gradient(
        KERNELS[name],
        np.vstack([F, F[task]]),
        np.r_[noise, noise[task]],
        X[order],
        twin[order],
        y[order],
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(names, seeds, st.sampled_from([1e-6, 0.3, 1e5]))
@quick
def test_units_of_the_targets(name, seed, unit):
    _, F, noise, (X, tasks, y) = random_model(seed)
    expected = value_and_kernel_gradient(KERNELS[name], F, noise, X, tasks, y)
    expected[0] -= len(y) * np.log(unit)
    actual = value_and_kernel_gradient(
        KERNELS[name], unit * F, unit**2 * noise, X, tasks, unit * y
    )
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@given(seeds)
@quick
def test_rotations_of_the_factor_do_not_matter(seed):
    rng, F, noise, sample = random_model(seed)
    rotation = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    expected = value_and_kernel_gradient(RBF(ARD), F, noise, *sample)
    actual = value_and_kernel_gradient(RBF(ARD), F @ rotation, noise, *sample)
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10)
