"""Fast functions that a climb has taken for noise."""

import building
import numpy as np
import pytest
from rarely import rarely
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC
from skmtgp.learning.climbing import climb
from skmtgp.learning.faster import with_faster
from skmtgp.model.task_covariance import identity

M = 4


def waves(seed, *, speed, noise=0.15, n_features=1, slope=1.0):
    """Sines of each task of the first feature, and slopes of the last one; X and y."""
    rng, task = np.random.default_rng(seed), np.repeat(np.arange(M), 40)
    x = rng.uniform(0.0, 6.0, (len(task), n_features))
    phase, size = rng.uniform(0.0, 2.0 * np.pi, M), rng.uniform(0.7, 1.5, M)
    f = slope * rng.standard_normal(M)[task] * x[:, -1]
    f += size[task] * np.sin(speed * x[:, 0] + phase[task])
    y = f + noise * rng.standard_normal(len(task))
    return np.column_stack([x, task]), y


def pose(X, y):
    n_features = X.shape[1] - 1
    y = (y - y.mean()) / y.std()
    data = building.data(X[:, :-1], X[:, -1].astype(int), y, M)
    kernel = RBF(np.full(n_features, 1.8 * np.sqrt(n_features)), (1e-2, 1e3))
    return building.problem(kernel, identity(M), data, scale=1.0, noise=1e-2)


@pytest.mark.parametrize("n_features", [1, 2])
def test_they_are_found_from_a_mode_that_took_them_for_noise(n_features):
    problem = pose(*waves(1, speed=6.0, n_features=n_features, slope=0.1))
    mode = climb(problem, problem.theta(), relaxed=True)
    found = with_faster(problem, problem.theta(), mode)
    assert found.value > mode.value + 20.0
    assert found.n_evaluations > mode.n_evaluations
    assert problem.prior.values(found.theta).noise < 0.2
    lengths = np.exp(problem.prior.values(found.theta).kernel)
    assert lengths[0] < 0.6
    if n_features == 2:  # the slow feature stays slow
        assert lengths[1] > 1.0


def test_slow_functions_are_left_alone():
    problem = pose(*waves(0, speed=0.7))
    mode = climb(problem, problem.theta(), relaxed=True)
    assert with_faster(problem, problem.theta(), mode) is mode


@pytest.mark.parametrize("seed", range(8))
def test_pure_noise_has_no_faster_functions(seed):
    """By chance rows follow one, but that gains a few nats only."""
    X, _ = waves(seed, speed=6.0, n_features=2)
    y = np.random.default_rng(seed).standard_normal(len(X))
    problem = pose(X, y)
    mode = climb(problem, problem.theta(), relaxed=True)
    assert with_faster(problem, problem.theta(), mode).value == mode.value


def test_a_kernel_without_length_scales_has_none():
    X, y = waves(0, speed=6.0)
    kernel = RBF(1.0, "fixed")
    data = building.data(X[:, :-1], X[:, -1].astype(int), y / y.std(), M)
    problem = building.problem(kernel, identity(M), data, scale=1.0, noise=1e-2)
    mode = climb(problem, problem.theta(), relaxed=True)
    assert with_faster(problem, problem.theta(), mode) is mode


def test_nothing_is_asked_without_noise(monkeypatch):
    problem = pose(*waves(0, speed=0.7, noise=0.0))
    mode = climb(problem, problem.theta(), relaxed=True)
    assert not problem.is_noisy(mode)
    monkeypatch.setattr(type(problem), "likelihood", None)
    assert with_faster(problem, problem.theta(), mode) is mode


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning")
@pytest.mark.parametrize("seed", [0, *rarely(1)])
def test_estimators_begin_there_by_themselves(seed):
    """No start is given, and none is needed."""
    X, y = waves(seed, speed=6.0)
    near = IndependentGP(RBF([0.3], (1e-2, 1e2))).fit(X, y)
    alone = IndependentGP().fit(X, y)
    least = near.log_marginal_likelihood_value_ - 1.0
    assert alone.log_marginal_likelihood_value_ > least
    near = MultiTaskGPRegressor(RBF([0.3], (1e-2, 1e2))).fit(X, y)
    least = near.log_marginal_likelihood_value_ - 3.0  # or another form
    default = MultiTaskGPRegressor().fit(X, y)
    assert default.log_marginal_likelihood_value_ > least
    best = RankSearchIC().fit(X, y).best_estimator_
    assert best.log_marginal_likelihood_value_ > least


def test_all_is_learned_from_the_noise_that_is_left():
    """From the noise where learning begins they were taken for noise once more."""
    X, y = waves(4, speed=6.0, noise=0.2)
    model = MultiTaskGPRegressor().fit(X, y)
    assert np.sqrt(model.noise_variance_) < 0.3
    assert model.kernel_.length_scale < 1.0
