"""Functions that the levels of the tasks hide."""

from dataclasses import replace

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning import hidden, ranks
from skmtgp.learning.hidden import hidden_start, reveal
from skmtgp.learning.problem import Mode
from skmtgp.learning.ranks import learn_ranks
from skmtgp.model.task_covariance import identity, low_rank, ones

M = 6
SHARED = {"normalize_y": "shared", "noise": "shared"}


def sites(seed, frequency, n_features, *, second=False, n=300):
    """Six sites with levels from -5 to 40, signals of deviation 1.5, noise 0.3."""
    rng = np.random.default_rng(1000 + seed)
    levels = np.linspace(-5.0, 40.0, M)
    levels = rng.permutation(levels) if second else levels
    x, site = rng.uniform(0.0, 6.0, (n, n_features)), np.repeat(np.arange(M), n // M)
    size, phase = rng.uniform(0.5, 1.5, M), rng.uniform(0.0, 2.0 * np.pi, M)
    if second:  # a sine that all share, and a slower one of each
        f = np.sin(frequency * x[:, 0])
        f += 0.5 * size[site] * np.cos(0.5 * frequency * x[:, -1] + phase[site])
    else:
        f = np.sin(frequency * x[:, 0] + phase[site])
    y = levels[site] + f * 1.5 / f.std() + 0.3 * rng.standard_normal(n)
    training = rng.permutation(n)[: n * 4 // 5]
    return np.column_stack([x, site])[training], y[training]


def pose(data, form=None, kernel=None, **changes):
    kernel, form = kernel or RBF([3.0, 3.0, 3.0], (1e-2, 1e3)), form or identity(M)
    given = {"scale": np.sqrt(np.square(data.y).mean()), "noise": 1e-2, "tol": 1e-2}
    return building.problem(kernel, form, data, **given | changes)


@pytest.fixture(scope="module")
def data():
    X, y = sites(0, 4.0, 3)
    order = np.argsort(X[:, -1], kind="stable")
    return building.data(
        X[order, :-1], X[order, -1].astype(int), y[order] - y.mean(), M
    )


# The likelihoods are those that 10 additional starts find too. Without hidden starts
# the fits took the signals for noise, and ended 26 to 280 nats lower.
@pytest.mark.parametrize(
    ("seed", "frequency", "n_features", "second", "expected"),
    [
        pytest.param(1, 4.0, 3, False, -162.3, marks=pytest.mark.long),
        pytest.param(3, 4.0, 3, True, -353.4, marks=pytest.mark.long),
        (2, 3.0, 2, True, -350.4),
    ],
)
def test_sites(seed, frequency, n_features, second, expected):
    X, y = sites(seed, frequency, n_features, second=second)
    model = MultiTaskGPRegressor(rank=3, task_levels=False, **SHARED).fit(X, y)
    assert model.log_marginal_likelihood_value_ > expected - 1.0
    assert model.noise_variance_ < 1.0  # the signals have 2.25


# Without hidden starts they ended 308 and 112 nats lower.
@pytest.mark.parametrize(("second", "expected"), [(False, -138.1), (True, -307.9)])
def test_sites_where_levels_are_in_the_model(second, expected):
    X, y = sites(1, 4.0, 3, second=second)
    model = MultiTaskGPRegressor(rank=3, **SHARED).fit(X, y)
    assert model.log_marginal_likelihood_value_ > expected - 1.0
    assert 0.05 < model.noise_variance_ < 0.2  # it is 0.09


@pytest.mark.parametrize("form", [identity(M), ones(M)], ids=["identity", "ones"])
class TestHiddenStart:
    def test_the_kernel_is_that_of_the_functions(self, data, form):
        problem = pose(data, form)
        start = hidden_start(problem)
        length_scales = np.exp(start.kernel_theta)
        assert 0.2 < length_scales[0] < 1.2
        assert (length_scales[1:] > 10.0).all()
        theta = start.theta(problem.with_form(low_rank(M, 3)))
        assert theta[-1] == start.log_noise == start.mode.theta[-1]
        assert np.exp(theta[-1]) < 2.25  # the variance of the signals

    def test_levels_are_in_the_task_covariance(self, data, form):
        start = hidden_start(pose(data, form))
        moved = replace(data, y=data.y + 40.0 * (data.tasks == 2))
        other = hidden_start(pose(data, form).with_data(moved))
        np.testing.assert_allclose(other.kernel_theta, start.kernel_theta, rtol=1e-3)
        assert other.K_rho[2, 2] > 1.5 * start.K_rho[2, 2]

    @pytest.mark.parametrize("variance", [0.0, 1.0])
    def test_nothing_but_levels(self, data, form, variance):
        levels = replace(data, y=variance * data.tasks.astype(float))
        problem = pose(data, form)
        start = hidden_start(problem.with_data(levels))
        assert np.isfinite(start.theta(problem.with_form(low_rank(M, 2)))).all()

    @pytest.mark.parametrize("n_noise", [1, M])
    def test_candidates_are_within_the_bounds(self, data, form, n_noise):
        kernel = RBF([1.0, 2.0, 5.0], (0.5, 6.0))
        bounds = {"log_noise": -3.0, "log_noise_bounds": (-3.5, -2.5)}
        prior = pose(data, form, kernel, n_noise=n_noise, **bounds).prior
        candidates = hidden._candidates(prior, 1.0)
        assert len(candidates) == 2 * (4 + 2 * 3)
        theta = np.array(candidates)
        assert theta.shape[1] == 3 + n_noise
        lower, upper = prior.bounds()
        assert ((lower <= theta) & (theta <= upper)).all()
        assert (theta[:, :3] == kernel.theta).all(axis=1).sum() == 2


class TestReveal:
    mode = Mode(np.zeros(3 + 3 * M + 1), 100.0, 7, 70, True, False, 1.0, 240)

    def led_to(self, monkeypatch, data, value):
        found = self.mode._replace(theta=self.mode.theta + 1.0, value=value)
        monkeypatch.setattr(hidden, "held_first", lambda *_: found)
        monkeypatch.setattr(hidden, "shake", lambda *args: args[1])
        starts = [hidden_start(pose(data, max_iter=1))] * 2
        return reveal(pose(data, low_rank(M, 3)), self.mode, starts)

    @pytest.mark.parametrize("value", [-np.inf, 50.0, 100.9])
    def test_good_modes_stay_as_they_are(self, data, monkeypatch, value):
        mode = self.led_to(monkeypatch, data, value)
        assert mode.theta is self.mode.theta
        assert mode.value == 100.0

    def test_better_ones_are_taken(self, data, monkeypatch):
        assert self.led_to(monkeypatch, data, 101.1).value == 101.1

    @pytest.mark.parametrize("value", [50.0, 150.0])
    def test_what_was_spent_counts(self, data, monkeypatch, value):
        assert self.led_to(monkeypatch, data, value).n_evaluations == 3 * 70

    def test_without_starts(self, data):
        mode = reveal(pose(data, low_rank(M, 3)), self.mode, [])
        assert mode is self.mode


@pytest.mark.parametrize(("noise", "expected"), [(0.3, [2]), (0.0, [0])])
def test_only_noisy_data_have_hidden_starts(noise, expected, monkeypatch):
    """Data without noise are learned as if there were none."""
    rng, counts = np.random.default_rng(0), []
    x, task = rng.uniform(0.0, 6.0, (60, 1)), np.repeat([0, 1], 30)
    y = np.sin(x[:, 0]) * (1.0 + task) + noise * rng.standard_normal(60)
    data = building.data(x, task, y - y.mean(), 2)

    def count(problems, forms, modes, hidden, *args):
        counts.extend(len(starts) for starts in hidden)
        return modes

    monkeypatch.setattr(ranks, "_revealed", count)
    problem = pose(data, identity(2), RBF(1.0, (1e-2, 1e3)))
    learn_ranks([problem], [low_rank(2, 1)])
    assert counts == expected


def test_no_iterations_no_hidden_starts(data, monkeypatch):
    """max_iter=0 keeps the starting values."""
    monkeypatch.setattr(ranks, "hidden_start", None)
    problem = pose(data, max_iter=0)
    [[mode]] = learn_ranks([problem], [low_rank(M, 2)])
    np.testing.assert_array_equal(mode.theta[:3], problem.prior.kernel.theta)
