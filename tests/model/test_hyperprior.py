"""Weak priors of the hyperparameters."""

import building
import numpy as np
import pytest
import textbook
from scipy.integrate import quad
from scipy.stats import norm
from sklearn.gaussian_process.kernels import RBF, RationalQuadratic

from skmtgp.model.described import task_covariance
from skmtgp.model.hyperprior import LONGER, OF_KERNEL, OF_VARIANCE, Hyperprior
from skmtgp.model.task_covariance import identity, low_rank

FORMS = {
    "rank 2": low_rank(3, 2),
    "shared": low_rank(3, 1, shared=True),
    "diagonal": low_rank(3, 1, diagonal=True),
    "compound symmetry": low_rank(3, 0, "equal", shared=True),
    "independent": identity(3),
    "descriptors": task_covariance(
        3, 2, np.array([[1.0, -1.0, 0.3], [1.0, 0.2, -1.3], [1.0, 0.8, 1.0]])
    ),
}


def hyperprior_of(form, *, scale=1.0, **options):
    kernel = RBF([1.0, 2.0])
    return Hyperprior(building.prior(kernel, form, levels=True, scale=scale, **options))


@pytest.mark.parametrize("scale", [1e-100, 1.0, 1e100])
def test_a_factor_of_next_to_nothing(scale):
    """Its square may underflow, and its share of the targets' does."""
    hyperprior = hyperprior_of(FORMS["rank 2"], scale=scale)
    theta, before = hyperprior.draw(np.random.default_rng(0)), np.inf
    of_factor = hyperprior.prior.of_factor
    for size in (scale, 1e-50, 1e-100, 1e-140):
        theta[of_factor] = size
        value, gradient = hyperprior.log_density(theta)
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()
        assert scale < 1.0 or value < before
        before = value
    for size in (1e-170, 0.0):
        theta[of_factor] = size
        assert hyperprior.log_density(theta)[0] == -np.inf


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_gradient(form):
    hyperprior = hyperprior_of(form)
    theta = hyperprior.draw(np.random.default_rng(0))
    _, gradient = hyperprior.log_density(theta)
    numerical = textbook.derivative(lambda t: hyperprior.log_density(t)[0], theta)
    np.testing.assert_allclose(gradient, numerical, rtol=1e-6, atol=1e-7)


def test_rotations_of_the_factor_cost_nothing():
    hyperprior = hyperprior_of(low_rank(3, 2))
    theta = hyperprior.draw(np.random.default_rng(0))
    F = theta[hyperprior.prior.of_factor].reshape(3, 2)
    Q = np.linalg.qr(np.array([[1.0, 2.0], [3.0, 1.0]]))[0]
    turned = hyperprior.prior.with_rho(theta, (F @ Q).ravel())
    value, _ = hyperprior.log_density(theta)
    assert hyperprior.log_density(turned)[0] == pytest.approx(value, rel=1e-12)


def test_it_is_around_rougher_functions_and_more_noise_than_learning_starts_with():
    hyperprior = hyperprior_of(low_rank(3, 2))
    away = np.exp(hyperprior.centre - hyperprior.prior.theta())
    np.testing.assert_allclose(away[:2], 0.5)  # length-scales
    assert away[-1] == pytest.approx(3.0)
    assert away[-2] == pytest.approx(1.0)  # levels


def test_what_is_no_length_scale_or_is_fixed_is_where_it_starts():
    kernel = RationalQuadratic(2.0, 0.7) * RBF(3.0, "fixed")
    prior = building.prior(kernel, low_rank(3, 1))
    away = Hyperprior(prior).centre - prior.theta()
    names = [part.name for part in kernel.hyperparameters if not part.fixed]
    shorter = np.array([name.endswith("length_scale") for name in names])
    np.testing.assert_allclose(np.exp(away[:2]), np.where(shorter, 0.5, 1.0))


def test_units_of_the_targets_cost_nothing():
    """Of targets that are a hundred times as large everything else is."""
    small = hyperprior_of(low_rank(3, 2, shared=True, diagonal=True))
    prior = small.prior
    large = Hyperprior(
        building.prior(
            prior.kernel,
            prior.task_covariance,
            levels=True,
            scale=100.0,
            log_level=prior.log_level + 2.0 * np.log(100.0),
            log_noise=prior.log_noise + 2.0 * np.log(100.0),
            log_noise_bounds=tuple(np.add(prior.log_noise_bounds, 2.0 * np.log(100.0))),
        )
    )
    theta = small.draw(np.random.default_rng(0))
    scaled = np.where(prior.of_kernel, theta, theta + 2.0 * np.log(100.0))
    scaled[prior.of_factor] = 100.0 * theta[prior.of_factor]
    value, _ = small.log_density(theta)
    assert large.log_density(scaled)[0] == pytest.approx(value, rel=1e-12)


def test_draws_have_the_spread_that_is_documented():
    hyperprior = Hyperprior(building.prior(RBF(1.0), low_rank(3, 1), levels=True))
    rng = np.random.default_rng(0)
    draws = np.array([hyperprior.draw(rng) for _ in range(4000)])
    prior = hyperprior.prior
    spread = draws[:, prior.of_kernel].std(axis=0)
    np.testing.assert_allclose(spread, OF_KERNEL, rtol=0.05)
    assert draws[:, -1].std() == pytest.approx(OF_VARIANCE, rel=0.05)
    sizes = np.log(np.linalg.norm(draws[:, prior.of_factor], axis=1) / np.sqrt(3))
    assert sizes.mean() == pytest.approx(0.0, abs=0.05)
    assert sizes.std() == pytest.approx(1.0, rel=0.05)


def length_scales_of(d, bounds=(1e-20, 1e20)):
    return Hyperprior(building.prior(RBF(np.ones(d), bounds), identity(2)))


def mixture(d, u):
    """Density of the logarithm of one of d length-scales, of which half may be long."""
    share, centre = 0.5 * (1.0 - 1.0 / d), np.log(0.5)
    near, far = (norm.pdf(u, centre + of, OF_KERNEL) for of in (0.0, LONGER))
    return (1.0 - share) * near + share * far


@pytest.mark.parametrize("d", [1, 2, 18])
@pytest.mark.parametrize("bounds", [(1e-20, 1e20), (0.3, 4.0)])
def test_length_scales_of_several_features_may_be_long(d, bounds):
    """The density is that of the definition, and normalised within the bounds."""
    hyperprior = length_scales_of(d, bounds)
    theta = hyperprior.centre
    inside = quad(lambda u: mixture(d, u), *np.log(bounds), points=[0.0, 3.0])[0]
    # The noise, at its centre, and the other length-scales, as the first:
    noise = hyperprior.prior.bounds()[:, -1]
    of_noise = norm.pdf(0.0, 0.0, OF_VARIANCE)
    of_noise /= np.diff(norm.cdf(noise, theta[-1], OF_VARIANCE))[0]
    for u in (-1.0, 0.3, 1.3):
        at = np.where(hyperprior.prior.of_length_scales, u, theta)
        found = hyperprior.log_density(at)[0] + hyperprior.log_constant
        expected = d * np.log(mixture(d, u) / inside) + np.log(of_noise)
        assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("d", [1, 2, 18])
def test_draws_of_length_scales_are_of_the_mixture(d):
    hyperprior, rng = length_scales_of(d), np.random.default_rng(0)
    draws = np.array([hyperprior.draw(rng)[:d] for _ in range(6000 // d)]).ravel()

    def below(u):
        return quad(lambda v: mixture(d, v), -15.0, u, points=[-1.0, 2.0])[0]

    at = [-2.0, 0.0, 2.0, 4.0]
    found = np.mean(draws[:, None] < at, axis=0)
    np.testing.assert_allclose(found, [below(u) for u in at], atol=0.03)


def test_a_feature_that_tells_nothing_costs_little_more_with_a_longer_scale():
    """The density has one top, and falls by a nat at most up to 40 times the centre."""
    hyperprior = length_scales_of(18)
    theta = hyperprior.centre.copy()
    values = []
    for times in np.geomspace(1.0, 40.0, 20):
        theta[0] = hyperprior.centre[0] + np.log(times)
        values.append(hyperprior.log_density(theta)[0])
    assert values[0] - min(values) < 1.0
    top = int(np.argmax(values))
    assert (np.diff(values[: top + 1]) > 0.0).all()
    assert (np.diff(values[top:]) < 0.0).all()


def test_near_leaves_a_long_length_scale():
    hyperprior = length_scales_of(2)
    theta = hyperprior.centre.copy()
    theta[0] += LONGER + 3.0 * OF_KERNEL
    theta[1] += LONGER + 5.0 * OF_KERNEL
    near = hyperprior.near(theta, 3.0, hyperprior.prior.of_length_scales)
    assert near[0] == theta[0]
    assert near[1] == pytest.approx(theta[0])


def test_draws_are_within_the_bounds():
    kernel = RBF(1.0, (0.9, 1.1))
    hyperprior = Hyperprior(building.prior(kernel, low_rank(2, 1)))
    rng = np.random.default_rng(0)
    draws = np.exp([hyperprior.draw(rng)[0] for _ in range(50)])
    assert draws.min() >= 0.9
    assert draws.max() <= 1.1
    assert draws.std() > 0.02


def test_draws_within_bounds_that_are_all_but_one():
    kernel = RBF(1.0, (1.0, 1.000001))
    hyperprior = Hyperprior(building.prior(kernel, low_rank(2, 1)))
    theta = hyperprior.draw(np.random.default_rng(0))
    assert 0.0 <= theta[0] <= 1.1e-6


def test_what_is_held_has_no_prior():
    fixed = hyperprior_of(identity(3), log_noise_bounds=(-2.0, -2.0), log_noise=-2.0)
    theta = fixed.draw(np.random.default_rng(0))
    assert theta[-1] == -2.0
    value, gradient = fixed.log_density(theta)
    assert gradient[-1] == 0.0
    theta[-1] = 5.0
    assert fixed.log_density(theta)[0] == value


def test_the_constant_normalises():
    """Over the logarithm of one number of K^rho, and the two signs of its factor."""
    kernel = RBF(1.0, "fixed")
    prior = building.prior(kernel, low_rank(1, 1))
    hyperprior = Hyperprior(prior)

    def density(log_amplitude, log_noise):
        theta = np.array([np.exp(log_amplitude), log_noise])
        return np.exp(hyperprior.log_density(theta)[0] + hyperprior.log_constant)

    centre = hyperprior.centre[-1]
    of_noise = norm.pdf(centre, centre, OF_VARIANCE)
    inside = np.diff(norm.cdf(prior.bounds()[:, -1], centre, OF_VARIANCE))[0]
    of_noise /= inside
    total = quad(lambda u: density(u, centre), -8.0, 8.0)[0] / of_noise
    assert 2.0 * total == pytest.approx(1.0, rel=1e-8)


def test_no_amplitude_is_impossible():
    hyperprior = hyperprior_of(low_rank(3, 1))
    value, gradient = hyperprior.log_density(hyperprior.centre)
    assert value == -np.inf
    assert np.isnan(gradient).all()


def test_held_logarithms_have_no_density():
    prior = building.prior(RBF([1.0, 1.0]), low_rank(2, 1))
    held = np.arange(prior.n_theta) == 1
    hyperprior, theta = Hyperprior(prior, held), Hyperprior(prior).centre.copy()
    theta[prior.of_factor] = 1.0
    other = theta.copy()
    other[1] += 3.0
    assert hyperprior.log_density(other)[0] == hyperprior.log_density(theta)[0]
    assert not hyperprior.free[1]


def test_near_moves_what_is_far():
    prior = building.prior(RBF(1.0), low_rank(2, 1), levels=True)
    hyperprior = Hyperprior(prior)
    theta, level = hyperprior.centre.copy(), prior.n_theta - 2
    theta[level:] = -22.0  # the level, and the noise, which stays
    near = hyperprior.near(theta, 3.0, ~prior.of_noise)
    expected = hyperprior.centre[level] - 3.0 / np.sqrt(hyperprior.precision[level])
    assert near[level] == pytest.approx(expected)
    assert np.delete(near, level).tolist() == np.delete(theta, level).tolist()
