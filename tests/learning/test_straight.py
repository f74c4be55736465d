"""Functions that may be straight lines."""

from dataclasses import replace

import building
import numpy as np
import pytest
from drawn import mode_at
from scipy.stats import multivariate_normal, norm
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.linear_model import LinearRegression

from skmtgp import IndependentGP, PooledGP
from skmtgp.kernels import ARDLinear
from skmtgp.learning import lines
from skmtgp.learning.climbing import climb
from skmtgp.learning.lines import as_lines, log_density_of_inputs, may_be_lines
from skmtgp.model.task_covariance import identity, low_rank

M = 3
PLAIN, SCALED = RBF([1.0, 1.0]), ConstantKernel() * RBF(1.0)


def learned(curve=0.0, *, scale=8.0, kernel=PLAIN, seed=0, n_noise=1):
    """A problem of planes and a curve, and a mode with noise of 0.1, the truth."""
    rng = np.random.default_rng(seed)
    tasks, x = np.repeat(np.arange(M), 40), rng.standard_normal((120, 2))
    y = (rng.standard_normal((M, 2))[tasks] * x).sum(axis=1) + tasks
    y += curve * x[:, 0] ** 2 + np.sqrt(0.1) * rng.standard_normal(len(y))
    data = building.data(x, tasks, y, M)
    problem = building.problem(kernel, identity(M), data, n_noise=n_noise)
    theta = problem.theta()
    theta[problem.prior.of_kernel] = np.log(scale)
    theta[problem.prior.of_noise] = np.log(0.1)
    return problem, mode_at(problem, theta)


@pytest.mark.parametrize("scale", [1.0, 8.0])
@pytest.mark.parametrize("kernel", [PLAIN, SCALED])
def test_length_scales_are_long(scale, kernel):
    assert may_be_lines(*learned(scale=scale, kernel=kernel)) == (scale > 2.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("curve", [0.0, 0.5])
def test_of_many_rows_planes_must_leave_noise(curve, seed, monkeypatch):
    monkeypatch.setattr(lines, "MANY", 100)
    assert may_be_lines(*learned(curve, seed=seed)) == (curve == 0.0)


@pytest.mark.parametrize("n_noise", [1, M])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("curve", [0.0, 0.5])
def test_of_few_rows_planes_must_be_as_likely_as_curves(curve, seed, n_noise):
    """The likelihood of planes is that of scikit-learn's least squares and their noise.

    It is a bound to that of lines with any prior.
    """
    problem, mode = learned(curve, seed=seed, n_noise=n_noise)
    data, variances = problem.data, np.empty(M)
    for task in range(M):
        X, y = data.X[data.tasks == task], data.y[data.tasks == task]
        rest = y - LinearRegression().fit(X, y).predict(X)
        variances[task] = np.mean(rest**2)
    variances = variances if n_noise > 1 else np.full(M, variances.mean())
    bound = 40 * (norm.logpdf(0.0, scale=np.sqrt(variances)) - 0.5).sum()
    at = [mode_with(mode, problem, value) for value in (bound - 0.01, bound + 0.01)]
    assert [may_be_lines(problem, of) for of in at] == [True, False]
    lines_of = with_lines(problem)
    theta = lines_of.theta()
    theta[lines_of.prior.of_noise] = np.log(variances[:n_noise])
    assert lines_of.likelihood().value(theta) < bound


def mode_with(mode, problem, likelihood):
    """The mode as if it had another likelihood."""
    return mode._replace(value=likelihood + problem.log_density(mode.theta))


def with_lines(problem):
    """The same with a linear kernel."""
    kernel = ARDLinear(np.ones(2), 1.0)
    return replace(problem, prior=replace(problem.prior, kernel=kernel))


def test_planes_through_all_rows_may_be_likelier():
    """Each task has as many rows as a plane has coefficients."""
    rng = np.random.default_rng(0)
    tasks, x = np.repeat(np.arange(M), 3), rng.standard_normal((9, 2))
    data = building.data(x, tasks, rng.standard_normal(9), M)
    problem = building.problem(PLAIN, identity(M), data)
    theta = problem.theta()
    theta[problem.prior.of_kernel] = np.log(8.0)
    assert may_be_lines(problem, mode_at(problem, theta))


def mixed(kernel, at, step=1e-4):
    """Covariance of the slopes along each feature, by central differences."""
    steps = step * np.eye(len(at))
    above, below = kernel(at + steps), kernel(at + steps, at - steps)
    others = kernel(at - steps)
    return np.diagonal(above - below - below.T + others) / (4.0 * step**2)


@pytest.mark.parametrize("kernel", [PLAIN, SCALED])
def test_lines_begin_with_the_slopes_of_curves(kernel, monkeypatch):
    """And with the same tasks and noise; the climb ends no lower."""
    problem, mode = learned(kernel=kernel)
    linear = ARDLinear(np.ones(2), center=[0.5, -1.0])
    amplitude = hasattr(kernel, "k1")
    if amplitude:
        linear = ConstantKernel() * ARDLinear(1.0, center=[0.5, -1.0])
    climbs, climb = [], lines.climb

    def told(problem, theta, **options):
        climbs.append((problem.prior.kernel_at(theta), theta))
        return climb(problem, theta, **options)

    monkeypatch.setattr(lines, "climb", told)
    straight, found = as_lines(problem, mode, linear)
    [(begun, theta)] = climbs
    curves = problem.prior.kernel_at(mode.theta)
    at = np.array([0.5, -1.0])
    np.testing.assert_allclose(mixed(begun, at), mixed(curves, at), rtol=1e-5)
    n_tail = problem.prior.n_theta - problem.prior.kernel.n_dims
    np.testing.assert_array_equal(theta[-n_tail:], mode.theta[-n_tail:])
    value = straight.likelihood().value(theta)
    assert found.value >= value
    assert found.value == pytest.approx(straight.likelihood().value(found.theta))


def test_lines_end_early_where_they_lose_more_than_they_may():
    problem, mode = learned(curve=2.0, scale=1.0, kernel=SCALED)
    curves = climb(problem, mode.theta)
    options = problem, curves, ConstantKernel() * ARDLinear(1.0)
    (_, to_the_end), (_, early) = as_lines(*options), as_lines(*options, loss=5.0)
    assert early.value <= to_the_end.value < curves.value - 5.0
    assert early.n_evaluations < to_the_end.n_evaluations
    assert as_lines(*options, loss=1e4)[1].value == to_the_end.value


@pytest.mark.parametrize("cls", [IndependentGP, PooledGP])
def test_lines_of_a_covariance_that_is_held(cls):
    """It has no rank, beside a diagonal; nor is there another form to choose."""
    rng = np.random.default_rng(0)
    x, task = rng.standard_normal(40), np.arange(40) % 2
    y = 2.0 * x + task + 0.1 * rng.standard_normal(40)
    model = cls(diagonal=True).fit(np.column_stack([x, task]), y)
    assert "ARDLinear" in repr(model.kernel_)


@pytest.mark.parametrize("gaps", [0, 7])
def test_rows_of_one_input_are_left_out_together(gaps):
    rng = np.random.default_rng(0)
    x = rng.standard_normal((12, 2))
    X, y = np.tile(x, (3, 1)), rng.standard_normal(36)
    kept = np.sort(rng.permutation(36)[gaps:])
    data = building.data(X[kept], np.repeat(np.arange(3), 12)[kept], y[kept], 3)
    problem = building.problem(RBF([1.0, 1.0]), low_rank(3, 1), data)
    mode = mode_at(problem, problem.theta())
    X, _, y, _, K = problem.some(mode, np.arange(len(data)))
    told = 0.0
    for one in np.unique(X, axis=0):
        out = (one == X).all(axis=1)
        share = np.linalg.solve(K[np.ix_(~out, ~out)], K[np.ix_(~out, out)])
        rest = K[np.ix_(out, out)] - K[np.ix_(out, ~out)] @ share
        told += multivariate_normal.logpdf(y[out], share.T @ y[~out], rest)
    assert log_density_of_inputs(problem, mode) == pytest.approx(told, rel=1e-8)
