"""Hamiltonian Monte Carlo against densities whose moments are known."""

import numpy as np
import pytest

from skmtgp._numerics.hmc import Walker, diagnose, sample

COVARIANCE = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.2], [0.0, 0.2, 4.0]])


def normal(x):
    pull = np.linalg.solve(COVARIANCE, x)
    return -0.5 * float(x @ pull), -pull


def chains_of(log_density, *, n_draws=1000, scale=None, start=0.0):
    size = len(COVARIANCE)
    scale = np.eye(size) if scale is None else scale
    return [
        sample(
            log_density,
            np.full(size, start),
            scale,
            np.random.default_rng([3, k]),
            n_warm=100,
            n_draws=n_draws,
        )
        for k in range(4)
    ]


def test_moments_of_a_normal_density():
    chains = chains_of(normal, n_draws=2500)
    draws = np.array([chain.draws for chain in chains])
    effective, r_hat = diagnose(draws)
    assert effective.min() > 2000
    assert r_hat.max() < 1.01
    draws = draws.reshape(-1, len(COVARIANCE))
    error = draws.mean(axis=0) / np.sqrt(np.diagonal(COVARIANCE) / effective)
    assert np.abs(error).max() < 3.5
    # a variance has a deviation of sqrt(2 / n)
    np.testing.assert_allclose(np.cov(draws.T), COVARIANCE, atol=0.15)


def test_tails_are_as_heavy_as_they_are():
    """Of Student's t of 5 degrees of freedom in each direction."""

    def student(x):
        away = 1.0 + x**2 / 5.0
        return float(-3.0 * np.log(away).sum()), -6.0 / 5.0 * x / away

    draws = np.concatenate([chain.draws for chain in chains_of(student)])
    shares = (np.abs(draws) > 2.571).mean(axis=0)  # 5 %
    np.testing.assert_allclose(shares, 0.05, atol=0.02)


def test_the_same_seed_gives_the_same_draws():
    first, second = chains_of(normal, n_draws=10), chains_of(normal, n_draws=10)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.draws, other.draws)


def test_chains_never_leave_where_the_density_is_finite():
    def half(x):
        value, gradient = normal(x)
        return (value, gradient) if x[0] > 0.0 else (-np.inf, np.zeros_like(x))

    chains = chains_of(half, start=1.0)
    assert all((chain.draws[:, 0] > 0.0).all() for chain in chains)
    assert sum(chain.n_divergent for chain in chains) > 0
    draws = np.concatenate([chain.draws[:, 0] for chain in chains])
    assert draws.mean() == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.1)


def two_hills(x):
    """Normal densities around 6 and -6, of shares 0.8 and 0.2, times a normal one."""
    logs = np.log([0.8, 0.2]) - 0.5 * (x[0] - [6.0, -6.0]) ** 2
    shares = np.exp(logs - logs.max())
    pull = -(shares @ (x[0] - [6.0, -6.0])) / shares.sum()
    value = float(logs.max() + np.log(shares.sum()) - 0.5 * (x[1] - 0.1 * x[0]) ** 2)
    away = x[1] - 0.1 * x[0]
    return value, np.array([pull + 0.1 * away, -away])


def mirrored(x, rng):
    """The other hill, or the other side of it."""
    signs = np.array([-1.0, rng.choice([-1.0, 1.0])])
    return signs * x, signs


def test_jumps_cross_between_modes():
    shares = {}
    for name, propose in (("without", None), ("with", mirrored)):
        rng, start = np.random.default_rng(0), np.array([6.0, 0.6])
        run = sample(
            two_hills, start, np.eye(2), rng, n_warm=100, n_draws=4000, propose=propose
        )
        shares[name] = run.draws
    assert (shares["without"][:, 0] > 0.0).all()
    draws = shares["with"]
    assert np.mean(draws[:, 0] > 0.0) == pytest.approx(0.8, abs=0.03)
    assert draws[:, 1].mean() == pytest.approx(0.1 * 0.6 * 6.0, abs=0.1)
    assert np.cov(draws.T)[0, 1] == pytest.approx(0.1 * draws[:, 0].var(), rel=0.1)


def test_jumps_that_are_never_accepted_end():
    calls = []

    def far(x, rng):
        calls.append(x)
        return x + 100.0, np.ones_like(x)

    rng = np.random.default_rng(0)
    sample(normal, np.zeros(3), np.eye(3), rng, n_warm=20, n_draws=50, propose=far)
    assert len(calls) == 10  # those of the second half of warming up


def test_evaluations_are_counted():
    calls = []

    def counted(x):
        calls.append(x)
        return normal(x)

    size = len(COVARIANCE)
    rng = np.random.default_rng(0)
    chain = sample(counted, np.zeros(size), np.eye(size), rng, n_warm=6, n_draws=4)
    assert chain.n_evaluations == len(calls)
    assert chain.draws.shape == (4, size)


def test_the_metric_is_learned():
    walker = Walker(normal, np.zeros(3), np.eye(3), np.random.default_rng(0))
    C = np.linalg.cholesky(COVARIANCE)
    walker.learn_scale(np.random.default_rng(1).standard_normal((4000, 3)) @ C.T)
    found = walker.scale @ walker.scale.T
    np.testing.assert_allclose(found, COVARIANCE, atol=0.25)


def test_few_draws_leave_the_metric_as_it_was():
    walker = Walker(normal, np.zeros(3), 2.0 * np.eye(3), np.random.default_rng(0))
    walker.learn_scale(np.zeros((1, 3)))
    found = walker.scale @ walker.scale.T
    np.testing.assert_allclose(found, 4.0 * np.eye(3) * 8.0 / 9.0)


class TestDiagnose:
    def autoregressive(self, correlation, n=4000):
        rng = np.random.default_rng(0)
        x, found = rng.standard_normal((4, 1)), []
        for _ in range(n):
            noise = rng.standard_normal((4, 1))
            x = correlation * x + np.sqrt(1.0 - correlation**2) * noise
            found.append(x)
        return np.stack(found, axis=1)

    @pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9, -0.4])
    def test_effective_size_of_an_autoregression(self, correlation):
        [effective], [r_hat] = diagnose(self.autoregressive(correlation))
        expected = 16_000 * (1.0 - correlation) / (1.0 + correlation)
        assert effective == pytest.approx(expected, rel=0.2)
        assert r_hat == pytest.approx(1.0, abs=0.02)

    def test_chains_apart(self):
        chains = np.random.default_rng(0).standard_normal((4, 100, 1))
        chains[0] += 5.0
        [effective], [r_hat] = diagnose(chains)
        assert effective < 20
        assert r_hat > 1.5

    def test_what_never_changes_has_neither(self):
        held = np.log(0.01) * np.ones((4, 250, 2))  # whose mean is rounded
        effective, r_hat = diagnose(held)
        assert np.isnan(effective).all()
        assert np.isnan(r_hat).all()
