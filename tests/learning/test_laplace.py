"""The posterior of the hyperparameters as a normal density around its mode."""

from dataclasses import replace

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning import laplace
from skmtgp.learning.climbing import climb
from skmtgp.learning.evidence import LogPosterior
from skmtgp.learning.laplace import with_leeway
from skmtgp.model.chart import Chart
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import identity, low_rank

N_TASKS = 3


def problem(rank, rows=8):
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(N_TASKS), rows)
    x = rng.uniform(0.0, 6.0, len(tasks))
    y = np.sin(x) * (tasks - 0.5) + 0.2 * rng.standard_normal(len(x))
    form = low_rank(N_TASKS, rank) if rank else identity(N_TASKS)
    data = building.data(x[:, None], tasks, y, N_TASKS)
    return building.problem(RBF(1.0), form, data, tol=1e-8)


def learned(problem):
    return climb(problem, problem.theta(K_rho=np.eye(N_TASKS) + 0.5))


@pytest.fixture(scope="module", params=[0, 1, 2])
def found(request):
    model = problem(request.param)
    return model, with_leeway(model, learned(model))


def density_around(model, theta):
    hyperprior = Hyperprior(model.prior)
    chart = Chart(hyperprior, theta)
    return chart, LogPosterior(model.likelihood(), hyperprior, chart).polar


def spread(chart, mode):
    """The axes, in coordinates of the chart."""
    ends = mode.leeway[0].ends
    of_chart = np.array([[chart.coordinates(end) for end in pair] for pair in ends])
    return 0.5 * (of_chart[:, 0] - of_chart[:, 1])


def test_the_mode_stays(found):
    model, mode = found
    known = learned(model)
    np.testing.assert_array_equal(mode.theta, known.theta)
    assert mode.value == known.value
    middle = mode.leeway[0].ends.mean(axis=1)
    assert not np.allclose(mode.leeway[0].ends[:, 0], middle, atol=1e-3)


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_covariance_is_the_inverse_of_the_curvature(rank, monkeypatch):
    """By second differences of values, along directions of the logarithms."""
    monkeypatch.setattr(laplace, "FALL", np.inf)  # no end is nearer
    model = problem(rank)
    mode = with_leeway(model, learned(model))
    chart, density = density_around(model, mode.theta)
    x, step = chart.coordinates(mode.theta), 1e-3
    away = spread(chart, mode)
    C = away.T @ away
    of_logs = slice(chart.n_factor, None)
    n = chart.size
    H = np.empty((n, n))
    for i, e in enumerate(step * np.eye(n)):
        for j, d in enumerate(step * np.eye(n)):
            values = [density(x + a * e + b * d)[0] for a in (1, -1) for b in (1, -1)]
            H[i, j] = -(values[0] - values[1] - values[2] + values[3]) / (4 * step**2)
    g = x[: chart.n_factor]
    if len(g) > 1:  # where a direction ends somewhere
        length = np.linalg.norm(g)
        bend = np.eye(len(g)) - np.outer(g, g) / length**2
        H[: len(g), : len(g)] += (len(g) - 1) / length**2 * bend
    assert np.linalg.eigvalsh(H).min() > 0.5  # so that none is kept from being flat
    expected = np.linalg.inv(H)
    np.testing.assert_allclose(
        C[of_logs, of_logs], expected[of_logs, of_logs], rtol=0.1
    )


def test_ends_are_no_farther_than_the_density_says():
    """Without noise the curvature says little of what is farther."""
    model = problem(2)
    theta = model.theta(K_rho=np.eye(N_TASKS) + 0.5)
    theta[model.prior.of_noise] = np.log(1e-9)
    mode = with_leeway(model, learned(model)._replace(theta=theta))
    chart, density = density_around(model, theta)
    top = density(chart.coordinates(theta))[0]
    for end in mode.leeway[0].ends.reshape(-1, len(theta)):
        assert density(chart.coordinates(end))[0] > top - 2.0


def test_more_rows_leave_less_open():
    spreads = []
    for rows in (6, 60):
        model = problem(1, rows)
        mode = with_leeway(model, learned(model))
        ends = mode.leeway[0].ends[..., model.prior.of_noise]
        spreads.append(np.square(ends[:, 0] - ends[:, 1]).sum())
    assert spreads[1] < 0.3 * spreads[0]


def test_evaluations_count():
    model = problem(1)
    mode = learned(model)
    found = with_leeway(model, mode)
    n_axes = len(found.leeway[0].ends)
    assert found.n_evaluations >= mode.n_evaluations + 5 * n_axes


def test_by_inducing_inputs():
    """All inputs are inducing: as exact inference has it."""
    from skmtgp.inference.engines import Sparse

    model = problem(1)
    mode = learned(model)
    exact = with_leeway(model, mode)
    sparse = replace(model, engine=Sparse(n_inducing=24))
    bound = with_leeway(sparse, mode._replace(Z=model.data.X))
    ends = [of.leeway[0].ends for of in (exact, bound)]
    spreads = [np.square(of[:, 0] - of[:, 1]).sum(axis=0) for of in ends]
    np.testing.assert_allclose(*spreads, rtol=1e-3, atol=1e-6)
