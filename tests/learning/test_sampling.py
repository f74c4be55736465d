"""Draws of the hyperparameters, against integrals on a grid."""

import warnings

import building
import numpy as np
import pytest
from quadrature import Grid
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp._numerics.hmc import diagnose, sample
from skmtgp.learning import sampling
from skmtgp.learning.evidence import climb_posterior
from skmtgp.learning.sampling import (
    N_CHAINS,
    find_peaks,
    quantities,
    sample_hyperparameters,
)
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import identity, low_rank, ones

LONGEST = pytest.mark.longest  # a minute each


def likelihood_of(form, *, n=16, kernel=None, seed=0, **options):
    rng = np.random.default_rng(seed)
    X = np.sort(rng.uniform(0.0, 8.0, (n, 1)), axis=0)
    tasks = np.arange(n) * form.n_tasks // n
    y = np.sin(X[:, 0]) * np.where(tasks % 2, -1.0, 1.0)
    y += 0.3 * rng.standard_normal(n)
    return building.dense(kernel or RBF(1.0), form, X, tasks, y, **options)


def long_run(likelihood, n_draws):
    """A chain, by the same steps as `sample_hyperparameters`, of any length."""
    peak = climb_posterior(likelihood, likelihood.prior.theta())
    values, vectors = peak.curvature()
    scale, rng = vectors / np.sqrt(values), np.random.default_rng(0)
    chain = sample(peak.density, peak.x, scale, rng, n_warm=200, n_draws=n_draws)
    return np.array([peak.density.chart.theta(x) for x in chain.draws])


def test_moments_are_those_of_the_posterior():
    likelihood = likelihood_of(ones(2), n=40)
    mean, variance = Grid(likelihood, 41).moments()
    draws = long_run(likelihood, 1500)
    effective = diagnose(draws[None])[0]
    assert effective.min() > 300
    error = (draws.mean(axis=0) - mean) / np.sqrt(variance / effective)
    assert np.abs(error).max() < 4.0
    np.testing.assert_allclose(draws.var(axis=0), variance, rtol=0.25)


def test_draws_of_a_flat_likelihood_are_those_of_the_prior():
    """One row tells nothing of the length-scale."""
    likelihood = likelihood_of(ones(1), n=1)
    hyperprior = Hyperprior(likelihood.prior)
    draws = long_run(likelihood, 1500)[:, 0]
    assert draws.mean() == pytest.approx(hyperprior.centre[0], abs=0.25)
    assert draws.std() == pytest.approx(hyperprior.precision[0] ** -0.5, rel=0.12)


@pytest.mark.parametrize(
    "rank", [pytest.param(1, marks=pytest.mark.long), pytest.param(2, marks=LONGEST)]
)
def test_signs_and_sizes_are_those_of_the_posterior(rank):
    """Of few rows, which leave open whether tasks go together, against draws of the
    prior that are weighted by the likelihood."""
    likelihood, rng = likelihood_of(low_rank(3, rank), n=9), np.random.default_rng(0)
    prior, hyperprior = likelihood.prior, Hyperprior(likelihood.prior)
    thetas = [hyperprior.draw(rng) for _ in range(3000)]
    logs = np.array([likelihood.value(theta) for theta in thetas])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    of_prior = np.array([quantities(prior, theta) for theta in thetas])
    mean = weights @ of_prior
    deviation = np.sqrt(weights @ np.square(of_prior - mean))
    sample = sample_hyperparameters([(likelihood, prior.theta())], n_draws=60, seed=[0])
    found = np.array([quantities(prior, theta) for theta in sample.theta])
    effective = np.minimum(sample.effective, len(found))
    effective = 1.0 / (1.0 / effective + np.square(weights).sum())
    error = (found.mean(axis=0) - mean) / deviation * np.sqrt(effective)
    assert effective.min() > 20
    assert np.abs(error).max() < 4.0
    correlations = found[:, -3:]  # both signs are seen
    assert (correlations.min(axis=0) < 0.0).all()
    assert (correlations.max(axis=0) > 0.0).all()


@pytest.fixture(scope="module")
def drawn():
    likelihood = likelihood_of(low_rank(2, 1), levels=True)
    theta = likelihood.prior.theta()
    return likelihood, sample_hyperparameters(
        [(likelihood, theta)], n_draws=10, seed=[1]
    )


def test_what_is_kept(drawn):
    likelihood, sample = drawn
    assert sample.theta.shape == (10, likelihood.prior.n_theta)
    lower, upper = likelihood.prior.bounds()
    logs = ~likelihood.prior.of_factor
    assert (sample.theta[:, logs] > lower[logs]).all()
    assert (sample.theta[:, logs] < upper[logs]).all()
    assert len(np.unique(sample.theta[:, 0])) > 5
    assert sample.n_evaluations > 4 * 130
    assert sample.effective.shape == sample.r_hat.shape


def test_few_draws_are_of_all_chains(drawn):
    likelihood, more = drawn
    theta = likelihood.prior.theta()
    few = sample_hyperparameters([(likelihood, theta)], n_draws=5, seed=[1]).theta
    np.testing.assert_array_equal(few, more.theta[:5])  # a turn of four, and one more


def test_one_mode_is_one_whatever_the_coordinates():
    """Charts order the tasks by their own factor, and densities follow."""
    likelihood = likelihood_of(low_rank(3, 2), n=45, levels=True)
    peaks, _ = find_peaks(
        likelihood, likelihood.prior.theta(), np.random.default_rng(2)
    )
    found = [
        quantities(likelihood.prior, peak.density.chart.theta(peak.x)) for peak in peaks
    ]
    for k, one in enumerate(found):
        for other in found[:k]:
            assert np.abs(one - other).max() >= sampling.SAME


def test_no_peak_is_without_a_function_of_many_tasks():
    """The density of coordinates has a pole at the origin, of next to no mass."""
    rng = np.random.default_rng(0)
    X, tasks = rng.uniform(0.0, 8.0, (160, 1)), np.arange(160) // 4
    y = rng.standard_normal(160)
    likelihood = building.dense(RBF(1.0), low_rank(40, 1), X, tasks, y)
    prior = likelihood.prior
    peaks, _ = find_peaks(likelihood, prior.theta(), rng)
    for peak in peaks:
        theta = peak.density.chart.theta(peak.x)
        deviations = np.sqrt(np.diagonal(prior.K_rho_at(theta)))
        assert np.sqrt(np.mean(deviations**2)) > 0.01 * prior.scale


@pytest.mark.long
def test_is_deterministic(drawn):
    likelihood, first = drawn
    theta = likelihood.prior.theta()
    again = sample_hyperparameters([(likelihood, theta)], n_draws=10, seed=[1])
    np.testing.assert_array_equal(again.theta, first.theta)
    other = sample_hyperparameters([(likelihood, theta)], n_draws=4, seed=[2])
    assert (other.theta != first.theta[:4]).any()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::UserWarning")  # of processes that start
def test_processes_draw_the_same(drawn):
    likelihood, first = drawn
    theta = likelihood.prior.theta()
    options = {"n_draws": 10, "seed": [1], "n_jobs": 2}
    again = sample_hyperparameters([(likelihood, theta)], **options)
    np.testing.assert_array_equal(again.theta, first.theta)


def test_what_is_told_before_and_while_it_goes_on():
    likelihood = likelihood_of(ones(2), n=8)
    before, done = [], []

    def tell(n_modes, seconds):
        before.append((n_modes, seconds))
        return lambda k, chain: done.append(k)

    start = likelihood.prior.theta()
    sample_hyperparameters([(likelihood, start)], n_draws=4, seed=[0], tell=tell)
    [(n_modes, seconds)] = before
    assert n_modes >= 1
    assert 0.0 < seconds < 60.0
    assert done == list(range(N_CHAINS))


def test_a_better_mode_than_the_learned_one_is_found():
    """From a start whose noise explains everything."""
    likelihood = likelihood_of(low_rank(2, 1), n=40)
    poor = likelihood.prior.theta(log_noise=0.0, kernel=np.array([6.0]))
    peaks, _ = find_peaks(likelihood, poor, np.random.default_rng(0))
    best = peaks[0]
    assert best.value == max(peak.value for peak in peaks)
    assert np.exp(best.density.chart.theta(best.x)[-1]) < 0.3


@pytest.mark.parametrize(("learned", "kept"), [(0.1, [99.0, 9.0, 3.0]), (1e-9, [99.0])])
def test_a_spike_without_noise_leaves_others(learned, kept, monkeypatch):
    """Rows explained exactly are likelier by far, and have less evidence.

    Where no noise was learned a mode without noise is as any other.
    """
    likelihood = likelihood_of(low_rank(2, 1), n=40)
    found = iter(
        [(3.0, 0.1), (99.0, 1e-9), (-20.0, 0.1), (9.0, 0.2), *[(0.0, 0.1)] * 8]
    )

    def climbed(likelihood, theta):
        peak, (value, noise) = climb_posterior(likelihood, theta), next(found)
        theta = np.where(
            likelihood.prior.of_noise, np.log(noise), peak.density.chart.around
        )
        return peak._replace(x=peak.density.chart.coordinates(theta), value=value)

    monkeypatch.setattr(sampling, "climb_posterior", climbed)
    monkeypatch.setattr(sampling, "_are_alike", lambda *peaks: peaks[0].value == 0.0)
    theta = likelihood.prior.theta(log_noise=np.log(learned))
    peaks, _ = find_peaks(likelihood, theta, np.random.default_rng(0))
    assert [peak.value for peak in peaks] == kept


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([1.0], [0, 0, 0, 0]),
        ([0.5, 0.5], [0, 0, 1, 1]),
        ([0.7, 0.3], [0, 0, 0, 1]),
        ([0.95, 0.05], [0, 0, 0, 0]),
    ],
)
def test_chains_are_shared_out_by_weight(weights, expected):
    assert sampling._share_out(np.array(weights)) == expected


def test_higher_ranks_have_a_head_start_but_not_the_first_column():
    found = [sampling._understated(8, rank, 5) for rank in range(5)]
    np.testing.assert_allclose(found, [0.0, 0.0, 4.0, 7.6, 10.6])
    assert sampling._understated(200, 3, 10) == 2.0 * sampling.MOST_UNDERSTATED
    assert sampling._understated(200, 3, 40) == 0.5 * sampling.MOST_UNDERSTATED


def test_quantities_do_not_see_rotations():
    prior = building.prior(RBF(1.0), low_rank(3, 2), levels=True)
    theta = Hyperprior(prior).draw(np.random.default_rng(0))
    F = theta[prior.of_factor].reshape(3, 2)
    turned = prior.with_rho(theta, (F @ [[0.0, 1.0], [-1.0, 0.0]]).ravel())
    np.testing.assert_allclose(quantities(prior, turned), quantities(prior, theta))
    found = quantities(prior, theta)
    K = F @ F.T
    assert len(found) == 3 + 3 + 3
    np.testing.assert_allclose(found[3:6], 0.5 * np.log(np.diagonal(K)))
    assert found[6] == pytest.approx(K[0, 1] / np.sqrt(K[0, 0] * K[1, 1]))


def test_independent_tasks_have_no_correlation():
    prior = building.prior(RBF(1.0), identity(3))
    found = quantities(prior, prior.theta())
    np.testing.assert_array_equal(found[-3:], 0.0)


def test_tasks_that_do_not_vary_have_no_correlation():
    prior = building.prior(RBF(1.0), low_rank(3, 1))
    theta = prior.theta()
    theta[prior.of_factor] = [0.0, 1e-170, 1.0]
    found = quantities(prior, theta)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[-3:], 0.0)


def test_a_chain_does_not_start_where_the_density_is_far_too_poor():
    """A flat direction of a Hessian says nothing of what is far off."""
    likelihood = likelihood_of(low_rank(3, 2), n=12)
    peak = climb_posterior(likelihood, likelihood.prior.theta())
    scale, rngs = np.eye(len(peak.x)), map(np.random.default_rng, range(8))
    near = [sampling._start_near(peak, scale, rng) for rng in rngs]
    least = peak.value - sampling.HOPELESS - sampling.FALL * len(peak.x)
    for k, x in enumerate(near):
        draw = np.random.default_rng(k).standard_normal(len(x))
        if peak.density(peak.x + draw)[0] >= least:
            np.testing.assert_array_equal(x, peak.x + draw)
        far = sampling._start_near(peak, 1e3 * scale, np.random.default_rng(k))
        assert peak.density(far)[0] >= least
        assert peak.density(peak.x + 1e3 * draw)[0] < least


@LONGEST
def test_no_chain_of_few_rows_is_lost():
    """One of these four was, at functions of 1e8 times the targets."""
    X, y = textbook_draw(n_tasks=8, n_rows=5, rank=3, seed=13)
    model = MultiTaskGPRegressor("rbf", rank=3, hyperparameters="sampled")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
    assert np.abs(model.predict(X + [0.5, 0.0])).max() < 10.0 * np.abs(y).max()
    assert model.r_hat_ < 3.0


def textbook_draw(n_tasks, n_rows, rank, seed):
    """Rows of a squared exponential on [0, 8], with noise of deviation 0.2."""
    rng = np.random.default_rng([n_tasks, n_rows, rank, seed])
    F = rng.standard_normal((n_tasks, rank)) / np.sqrt(rank)
    n = n_rows + 20
    x, task = rng.uniform(0.0, 8.0, n_tasks * n), np.repeat(np.arange(n_tasks), n)
    K = (F @ F.T)[np.ix_(task, task)] * np.exp(-0.5 * (x[:, None] - x) ** 2)
    values, vectors = np.linalg.eigh(K)
    f = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(x)))
    y, X = f + 0.2 * rng.standard_normal(len(x)), np.column_stack([x, task])
    trained = np.tile(np.arange(n) < n_rows, n_tasks)
    return X[trained], y[trained]
