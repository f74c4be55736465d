"""Periods at which learning begins: of many maxima, that of the true one."""

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, ExpSineSquared

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._data.statistics import shortest_period
from skmtgp._estimators.named_kernels import named_kernel
from skmtgp.kernels import Columns
from skmtgp.learning import periods as module
from skmtgp.learning.periods import begun_in_time, periods_of
from skmtgp.model.task_covariance import identity

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

CLOSE = {"rel": 1e-2}
IRREGULAR = np.cumsum(1.0 + 0.3 * np.sin(np.arange(40.0)))


def meters(days=14, n=40, period=24.0, n_meters=3, seed=0):
    """Hours, the meter of each row, and targets with a level of each meter."""
    rng = np.random.default_rng(seed)
    hours, ys = [], []
    for m in range(n_meters):
        h = np.sort(rng.choice(24 * days, n, replace=False)).astype(float)
        angle = 2.0 * np.pi * h / period
        y = (1.0 + m / 2.0) * np.sin(angle + rng.uniform(-0.3, 0.3))
        y += 0.5 * np.cos(2.0 * angle) + 0.1 * rng.standard_normal(n)
        hours.append(h)
        ys.append(y)
    tasks = np.repeat(np.arange(n_meters), n)
    return np.concatenate(hours)[:, None], tasks, np.concatenate(ys)


def problem(kernel, X, tasks, y, **changes):
    n_tasks = tasks.max() + 1
    data = building.data(X, tasks, y, n_tasks)
    return building.problem(kernel, identity(n_tasks), data, **changes)


def begun(kernel, X, tasks, y, **changes):
    """The periods at which learning begins."""
    prior = begun_in_time(problem(kernel, X, tasks, y, **changes)).prior
    periods = periods_of(prior.kernels, X.shape[1])
    return np.exp(prior.kernel.theta[[of.position for of in periods]])


def named(X):
    return named_kernel("periodic", X)


@pytest.mark.parametrize("period", [24.0, 17.3])
@pytest.mark.parametrize("days", [5, 28])
def test_the_period_is_found(days, period):
    X, tasks, y = meters(days, period=period, seed=days)
    assert begun(named(X), X, tasks, y) == pytest.approx([period], **CLOSE)


@pytest.mark.parametrize(
    "kernel",
    [
        ExpSineSquared(),
        ExpSineSquared(1.0, 70.0) ** 2,
        Columns(ExpSineSquared(), [0]) * RBF(200.0),
        0.5 * RBF(100.0) + ConstantKernel(2.0, "fixed") * ExpSineSquared(),
    ],
    ids=str,
)
def test_kernels_of_users(kernel):
    """As with a spherical range, it need not be known where to begin."""
    X, tasks, y = meters()
    found = begun_in_time(problem(kernel, X, tasks, y)).prior.kernel
    [period] = periods_of([kernel], 1)
    assert np.exp(found.theta[period.position]) == pytest.approx(24.0, **CLOSE)
    others = np.arange(kernel.n_dims) != period.position
    np.testing.assert_array_equal(found.theta[others], kernel.theta[others])


def test_starts_that_are_kept():
    X, tasks, y = meters()
    for kernel, changes in [
        (ExpSineSquared(1.0, 100.0, periodicity_bounds="fixed"), {}),
        (RBF(100.0), {}),
        (ExpSineSquared(1.0, 100.0), {"max_iter": 0}),
        (ExpSineSquared(1.0, 24.0), {}),
        (ExpSineSquared(1.0, 600.0, periodicity_bounds=(500.0, 700.0)), {}),
    ]:
        given = problem(kernel, X, tasks, y, **changes)
        assert begun_in_time(given) is given


def test_bounds_are_kept():
    X, tasks, y = meters()
    kernel = ExpSineSquared(1.0, 60.0, periodicity_bounds=(30.0, 70.0))
    assert 30.0 <= begun(kernel, X, tasks, y) <= 70.0


def test_noise_seldom_has_a_period():
    """There are many short periods: one of them explains something by chance."""
    X, tasks, _ = meters()
    found = []
    for seed in range(6):
        y = np.random.default_rng(seed).standard_normal(len(X))
        given = problem(named(X), X, tasks, y)
        found.append(begun_in_time(given) is not given)
    assert sum(found) <= 1


def test_units_of_the_input_and_order_of_rows():
    X, tasks, y = meters()
    expected = begun(named(X), X, tasks, y)
    Z = 3600.0 * X - 1e6
    assert begun(named(Z), Z, tasks, y) / 3600.0 == pytest.approx(expected, rel=1e-6)
    order = np.random.default_rng(0).permutation(len(y))
    order = order[np.argsort(tasks[order], kind="stable")]
    found = begun(named(X), X[order], tasks[order], y[order])
    assert found == pytest.approx(expected, rel=1e-9)


def test_each_input_has_its_period():
    rng = np.random.default_rng(0)
    X = rng.uniform(0.0, [300.0, 10.0], (150, 2))
    y = np.sin(2.0 * np.pi * X / [24.0, 1.7]).sum(axis=1)
    y += 0.1 * rng.standard_normal(len(y))
    found = begun(named(X), X, np.repeat([0, 1], 75), y)
    assert found == pytest.approx([24.0, 1.7], **CLOSE)


@pytest.mark.parametrize("others", [(1.0, 2.618), (5.0, 13.3), (24.0 / 7.0, 17.0)])
def test_two_periods_of_an_input(others):
    rng = np.random.default_rng(1)
    x, tasks = rng.uniform(0.0, 100.0, 300), np.repeat([0, 1, 2], 100)
    y = np.sin(2.0 * np.pi * x[:, None] / others).sum(axis=1)
    y += 0.1 * rng.standard_normal(300)
    found = begun(ExpSineSquared() + ExpSineSquared(), x[:, None], tasks, y)
    assert np.sort(found) == pytest.approx(others, **CLOSE)


@pytest.mark.parametrize(("moving", "n_looks"), [([0], 3), ([2], 5), ([0, 2], 5)])
def test_looked_at_again_only_if_another_moved(monkeypatch, moving, n_looks):
    X = np.random.default_rng(0).uniform(0.0, 10.0, (150, 3))
    y = np.sin(2.0 * np.pi * X[:, moving] / 1.3).sum(axis=1)
    looks, best = [], module._Choice._best
    monkeypatch.setattr(
        module._Choice, "_best", lambda of, theta: looks.append(of) or best(of, theta)
    )
    begun(named(X), X, np.repeat([0, 1], 75), y)
    assert len(looks) == n_looks


def test_inputs_without_a_width():
    X, tasks, y = meters()
    Z = np.column_stack([X, np.ones(len(X))])
    kernel = Columns(ExpSineSquared(), [0]) * Columns(ExpSineSquared(), [1])
    assert begun(kernel, Z, tasks, y) == pytest.approx([24.0, 1.0], **CLOSE)
    constant = problem(ExpSineSquared(), X, tasks, np.zeros(len(y)))
    assert begun_in_time(constant) is constant


@pytest.mark.parametrize(
    ("values", "period"),
    [(np.arange(24.0), 24.0), (np.linspace(0.0, 2.0 * np.pi, 200), 2.0 * np.pi)],
    ids=["hours", "angles"],
)
@pytest.mark.parametrize("wave", [1, 3])
def test_about_one_cycle(values, period, wave):
    """The periodogram does not tell it from a slow part, but the likelihood does."""
    rng, tasks = np.random.default_rng(0), np.arange(90) % 2
    x = rng.choice(values, 90)
    angle = 2.0 * np.pi * x / period
    y = np.sin(angle) + (wave > 1) * np.sin(wave * angle + 1.0)
    X, y = np.column_stack([x, tasks]), y + 0.1 * rng.standard_normal(90)
    known = ExpSineSquared(1.0, period, periodicity_bounds="fixed")
    models = [IndependentGP(of, max_iter=30).fit(X, y) for of in ("periodic", known)]
    found, true = [of.log_marginal_likelihood() for of in models]
    assert found >= true - 1.0


@pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP, PooledGP])
def test_it_is_learned(cls):
    X, tasks, y = meters(n=25)
    if cls is PooledGP:
        tasks = np.zeros_like(tasks)
    options = {"rank": 1} if cls is MultiTaskGPRegressor else {}
    model = cls("periodic", max_iter=30, **options).fit(np.column_stack([X, tasks]), y)
    [period] = periods_of([model.kernel_], 1)
    found = np.exp(model.kernel_.theta[period.position])
    assert found == pytest.approx(24.0, **CLOSE)


def test_of_each_task_alone():
    """Each has its own."""
    X, tasks, y = meters(n=60)
    _, _, other = meters(n=60, period=31.0)
    y = np.where(tasks == 0, y, other)
    model = SingleTaskGP("periodic", max_iter=30).fit(np.column_stack([X, tasks]), y)
    found = [of.kernel_.k2.periodicity for of in model.estimators_[:2]]
    assert found == pytest.approx([24.0, 31.0], **CLOSE)


@pytest.mark.parametrize(
    "options",
    [{"trend": [0]}, {"inference": "sparse", "n_inducing": 20, "n_exact": 60}],
    ids=str,
)
def test_with_other_options(options):
    X, tasks, y = meters()
    y = y + 0.02 * X[:, 0] if "trend" in options else y
    options |= {"rank": 1, "max_iter": 20}
    model = MultiTaskGPRegressor("periodic", **options)
    model.fit(np.column_stack([X, tasks]), y)
    assert model.kernel_.periodicity == pytest.approx(24.0, **CLOSE)


def test_complete_data():
    hours = np.arange(0.0, 24.0 * 10.0, 5.0)
    X = np.column_stack([np.repeat(hours, 2), np.tile([0, 1], len(hours))])
    y = np.sin(2.0 * np.pi * X[:, 0] / 24.0) * (1.0 + X[:, 1])
    y += 0.1 * np.random.default_rng(0).standard_normal(len(y))
    options = {"inference": "kronecker", "rank": 1, "max_iter": 20}
    model = MultiTaskGPRegressor("periodic", **options).fit(X, y)
    assert model.kernel_.periodicity == pytest.approx(24.0, **CLOSE)


def test_it_is_told(told):
    """Once, not of models for screening, too."""
    X, tasks, y = meters(n=20)
    model = IndependentGP("periodic", verbose=1, max_iter=3)
    model.fit(np.column_stack([X, tasks]), y)
    lines = [of for of in told() if "learning begins at a period of 2" in of]
    assert len(lines) == 1


def test_periods_below_the_gaps_of_irregular_times():
    """Visits once a night, with times that vary: the period is half a day."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.choice(90, 50, replace=False)) + 0.08 * rng.standard_normal(50)
    x, tasks = np.tile(t, 2), np.repeat([0, 1], 50)
    y = np.sin(2 * np.pi * (x / 0.53 + 0.1 * tasks)) + 0.05 * rng.standard_normal(100)
    model = MultiTaskGPRegressor("periodic", rank=2).fit(np.column_stack([x, tasks]), y)
    assert model.kernel_.periodicity == pytest.approx(0.53, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "shortest"),
    [
        (np.arange(30.0), 2.0),
        (np.delete(np.arange(30.0), [3, 4, 9, 20]), 2.0),  # some are missing
        (np.arange(30.0) + 0.01 * np.sin(np.arange(30.0)), 2 * 0.983),  # nearly even
        (IRREGULAR, 0.2),
        (np.cumsum([0.0, 0.05, 1.0, 1.7, 0.9, 2.3]), 0.1),  # two gaps are less
        (np.outer([1.0, 1.0 - 1e-15, 1.0 + 1e-15], IRREGULAR).ravel(), 0.2),  # rounded
        (np.ones(5), 0.0),
    ],
)
def test_shortest_period(values, shortest):
    assert shortest_period(values) == pytest.approx(shortest, rel=0.02)
