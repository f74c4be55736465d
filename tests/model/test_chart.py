"""Coordinates of theta: there and back, densities by their Jacobians."""

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF

from skmtgp.model.chart import Chart
from skmtgp.model.described import task_covariance
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import identity, low_rank

FORMS = {
    "rank 1": low_rank(3, 1),
    "rank 2": low_rank(3, 2),
    "full": low_rank(3, 3),
    "shared": low_rank(3, 1, shared=True),
    "diagonal": low_rank(3, 2, diagonal=True),
    "compound symmetry": low_rank(3, 0, "equal", shared=True),
    "independent": identity(3),
    "descriptors": task_covariance(
        3, 2, np.array([[1.0, -1.0, 0.3], [1.0, 0.2, -1.3], [1.0, 0.8, 1.0]])
    ),
}


def chart_of(form, seed=0, **options):
    prior = building.prior(RBF([1.0, 2.0]), form, levels=True, **options)
    hyperprior = Hyperprior(prior)
    theta = hyperprior.draw(np.random.default_rng(seed))
    return prior, Chart(hyperprior, theta), theta


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_there_and_back(form):
    prior, chart, theta = chart_of(form)
    x = chart.coordinates(theta)
    assert x.shape == (chart.size,)
    again = chart.theta(x)
    np.testing.assert_allclose(again[~prior.of_factor], theta[~prior.of_factor])
    np.testing.assert_allclose(
        prior.K_rho_at(again), prior.K_rho_at(theta), rtol=1e-10, atol=1e-12
    )
    np.testing.assert_allclose(chart.coordinates(again), x, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_rotations_are_left_out(form):
    _, chart, _ = chart_of(form)
    rank = getattr(form, "rank", 0)
    free = chart.around.size - rank * (rank - 1) // 2
    assert chart.size == free


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_gradient(form):
    """Of a density of theta that rotations do not change."""
    prior, chart, theta = chart_of(form)
    weights = np.random.default_rng(1).standard_normal(len(theta))
    W = np.random.default_rng(2).standard_normal((3, 3))
    W = W + W.T

    def density(x):
        theta = chart.theta(x)
        value = weights[~prior.of_factor] @ theta[~prior.of_factor]
        F = theta[prior.of_factor].reshape(chart.shape)
        gradient = np.where(prior.of_factor, 0.0, weights)
        gradient[prior.of_factor] = (2.0 * W @ F).ravel()
        return chart.polar_density(x, value + np.trace(F.T @ W @ F), gradient)

    x = chart.coordinates(theta)
    for of in (density, chart.log_spread):
        numerical = textbook.derivative(lambda x, of=of: of(x)[0], x)
        np.testing.assert_allclose(of(x)[1], numerical, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("rank", [1, 2])
def test_volume_is_that_of_all_factors(rank):
    """dF over the measure of the prior, |F|^-D, with all rotations by numbers."""
    prior, chart, theta = chart_of(low_rank(3, rank))
    g = chart.coordinates(theta)[: chart.n_factor]

    def factor(numbers):
        x = np.concatenate([numbers[: len(g)], np.zeros(chart.size - len(g))])
        L = chart.theta(x)[prior.of_factor].reshape(chart.shape)
        if rank == 1:
            return L.ravel()
        c, s = np.cos(numbers[-1]), np.sin(numbers[-1])
        return (L @ np.array([[c, s], [-s, c]])).ravel()

    numbers = np.append(g, [0.3] * (rank - 1))
    jacobian = textbook.derivative(factor, numbers)
    D = 3 * rank
    length = np.linalg.norm(factor(numbers))
    expected = np.linalg.slogdet(jacobian)[1] - D * np.log(length)
    spread = chart.log_spread(chart.coordinates(theta))[0]
    found = chart._of_factor(g, np.zeros(D))[0] + spread
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_turned(rank):
    """Amplitudes, and what is no factor, stay; signs are those that changed."""
    prior, chart, theta = chart_of(low_rank(4, rank))
    x, rng = chart.coordinates(theta), np.random.default_rng(0)
    K, n_mirrored = prior.K_rho_at(theta), 0
    for _ in range(50):
        turned, signs = chart.turned(x, rng)
        np.testing.assert_array_equal(turned[chart.n_factor :], x[chart.n_factor :])
        assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(x))
        of_turned = prior.K_rho_at(chart.theta(turned))
        np.testing.assert_allclose(np.diagonal(of_turned), np.diagonal(K))
        if (signs < 0.0).any():
            n_mirrored += 1
            np.testing.assert_array_equal(turned, signs * x)
            np.testing.assert_allclose(np.abs(of_turned), np.abs(K))
        else:
            assert (np.abs(of_turned - K) > 1e-9).any(axis=1).sum() in (0, 1, 4)
    assert 10 < n_mirrored < 40


def test_bounds_are_never_reached():
    prior, chart, theta = chart_of(low_rank(3, 1))
    lower, upper = prior.bounds()
    for edge in (-200.0, 200.0):
        found = chart.theta(
            np.append(np.ones(chart.n_factor), np.full(5, edge))[: chart.size]
        )
        logs = ~prior.of_factor
        assert (found[logs] >= lower[logs]).all()
        assert (found[logs] <= upper[logs]).all()
    at_bounds = np.where(prior.of_factor, theta, lower)
    assert np.isfinite(chart.coordinates(at_bounds)).all()


def test_what_is_held_stays():
    options = {"log_noise": -2.0, "log_noise_bounds": (-2.0, -2.0)}
    _, chart, theta = chart_of(low_rank(3, 1), **options)
    assert chart.theta(np.ones(chart.size))[-1] == theta[-1] == -2.0


def test_a_factor_of_less_than_its_rank_has_coordinates():
    prior, chart, theta = chart_of(low_rank(3, 2))
    F = np.outer([1.0, 2.0, -1.0], [1.0, 0.0])
    less = prior.with_rho(theta, F.ravel())
    chart = Chart(Hyperprior(prior), less)
    x = chart.coordinates(less)
    assert np.isfinite(chart.polar_density(x, 0.0, np.zeros(len(theta)))[1]).all()
    found = prior.K_rho_at(chart.theta(x))
    np.testing.assert_allclose(found, F @ F.T, atol=0.01)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_jacobian(form):
    """By central differences."""
    _, chart, theta = chart_of(form)
    x, h = chart.coordinates(theta), 1e-5
    steps = h * np.eye(chart.size)
    columns = [(chart.theta(x + s) - chart.theta(x - s)) / (2.0 * h) for s in steps]
    J = np.column_stack(columns)
    np.testing.assert_allclose(chart.jacobian(x), J, rtol=1e-6, atol=1e-7)
