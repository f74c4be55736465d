"""Tasks that differ in noise: whether they differ in units, too, and late choices."""

import numpy as np
import pytest

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._estimators import deciding, revising
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.reading import read
from skmtgp._estimators.units import deviation_within

N_TASKS, N_ROWS = 10, 20


def noisy(f, tasks, rng):
    """Targets with a noise variance of each task, the deviations around 0.2."""
    noise = 0.2 * np.exp(rng.standard_normal(N_TASKS))
    return f + noise[tasks] * rng.standard_normal(len(f))


def one_function_in_other_ranges(seed):
    """All tasks have the same function; their inputs hardly overlap."""
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(N_TASKS), N_ROWS)
    start = rng.uniform(0.0, 5.0, N_TASKS)
    x = start[tasks] + 3.0 * rng.uniform(size=len(tasks))
    y = noisy(np.sin(x) + np.cos(2.2 * x), tasks, rng)
    return np.column_stack([x, tasks]), y


def much_alike(seed):
    """A function of all tasks, and a little of another one."""
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(N_TASKS), N_ROWS)
    F = np.column_stack([np.ones(N_TASKS), 0.3 * rng.standard_normal(N_TASKS)])[tasks]
    x = rng.uniform(0.0, 8.0, len(tasks))
    K = F @ F.T * np.exp(-0.5 * np.subtract.outer(x, x) ** 2)
    f = np.linalg.cholesky(K + 1e-9 * np.eye(len(x))) @ rng.standard_normal(len(x))
    return np.column_stack([x, tasks]), noisy(f, tasks, rng)


@pytest.mark.parametrize(
    "data",
    [
        one_function_in_other_ranges(0),
        one_function_in_other_ranges(1),
        much_alike(7),
        much_alike(12),
    ],
)
def test_tasks_with_the_same_units_keep_them(data):
    """Functions as large in shared units speak for these, as in units of each."""
    model = MultiTaskGPRegressor()
    found = decide(model, read(model, *data))
    assert not found.units.own_scales
    assert found.noise == "per_task"


def accuracies(seed):
    """What settings of a learner reach on data sets: some lose more, all in one way."""
    rng, tasks = np.random.default_rng(seed), np.repeat(np.arange(N_TASKS), 12)
    size = np.geomspace(0.01, 0.3, N_TASKS)[tasks]
    X, best = rng.random((len(tasks), 3)), rng.uniform(0.3, 0.7, (N_TASKS, 3))
    loss = 1.0 - np.exp(-3.0 * np.square(X - best[tasks]).sum(axis=1))
    y = 0.9 - size * (loss + 0.1 * rng.standard_normal(len(tasks)))
    return np.column_stack([X, tasks]), y


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_functions_and_noise_of_the_same_proportion_want_units_of_their_own(seed):
    """One amplitude then serves all tasks."""
    model = MultiTaskGPRegressor()
    found = decide(model, read(model, *accuracies(seed)))
    assert found.units.own_scales
    assert found.noise == "shared"


@pytest.mark.parametrize("n_outputs", [1, 2])
def test_forms_that_could_not_gain_enough_are_learned_to_the_end(
    n_outputs, monkeypatch
):
    """They end early while it is open whether tasks have their own noise."""
    rng, tasks = np.random.default_rng(0), np.arange(180) % 6
    x, noise = rng.uniform(0.0, 6.0, 180), np.array([0.02, 0.1, 0.5, 0.02, 1.0, 0.05])
    y = np.sin(x) * (1.0 + tasks) + noise[tasks] * rng.standard_normal(180)
    learn, go_on, told = revising.with_own_noise, revising._to_the_end, []

    def ended_early(problem, mode, *, least=None):
        problem, mode = learn(problem, mode, least=least)
        assert bool(least > -np.inf) is (n_outputs == 1)
        early = n_outputs == 1 and str(problem.prior.task_covariance) == "rank 1"
        return problem, mode._replace(converged=not early)

    def to_the_end(problem, mode):
        told.append(str(problem.prior.task_covariance))
        return go_on(problem, mode)

    monkeypatch.setattr(deciding, "_own_noise", lambda found: [])  # it is not seen soon
    monkeypatch.setattr(revising, "with_own_noise", ended_early)
    monkeypatch.setattr(revising, "_to_the_end", to_the_end)
    model = MultiTaskGPRegressor(normalize_y="shared", kernel="rbf", n_jobs=1)
    search = RankSearchIC(model, ranks=[1, 2], simpler=False)
    search.fit(np.column_stack([x, tasks]), np.tile(y[:, None], n_outputs))
    assert search.best_estimator_.noise_ == "per_task"
    # of several outputs none ends early: others may gain what one lacks
    assert told == (["rank 1"] if n_outputs == 1 else [])


def test_deviation_within_tasks():
    """Tasks' means take a row each; of one row a task little is known."""
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(4), [5, 1, 3, 2])
    y = rng.standard_normal(11) + 1e6 * tasks
    parts = [y[tasks == m] for m in range(4)]
    square = sum(np.square(part - part.mean()).sum() for part in parts) / (11 - 4)
    assert deviation_within(y, tasks, 5) == pytest.approx(np.sqrt(square), rel=1e-8)
    assert deviation_within(y[3:6], tasks[3:6], 5) == 0.0
    assert deviation_within(np.arange(4.0), np.arange(4), 4) == 0.0


def cells(seed, n_cells=20):
    """Calcium signals of neurons by direction: noise grows with the gain of a cell."""
    rng, angle = np.random.default_rng(seed), np.arange(0.0, 360.0, 30.0)
    best, width = rng.uniform(0, 360, n_cells), rng.uniform(0.8, 3, n_cells)
    height, base = rng.gamma(4, 4, n_cells), rng.gamma(2, 1.5, n_cells)
    gain, zero = np.exp(rng.normal(0, 0.6, n_cells)), rng.normal(0, 10, n_cells)
    bumps = np.exp(width * (np.cos(np.deg2rad(angle[:, None] - best)) - 1.0)).T
    rates = base[:, None] + height[:, None] * bumps
    trials = [
        [2.0 * gain[i] * rng.poisson(rate, 4) + 4.0 * rng.normal(size=4) for rate in of]
        for i, of in enumerate(rates)
    ]
    y = (zero[:, None] + np.mean(trials, axis=2)).ravel()
    turn = np.tile(np.deg2rad(angle), n_cells)
    X = np.column_stack([np.cos(turn), np.sin(turn), np.repeat(np.arange(n_cells), 12)])
    return X, y, (zero[:, None] + 2.0 * gain[:, None] * rates).ravel()


def test_noise_that_grows_with_functions_takes_units_of_each():
    """By one amplitude the strongest cell was flat, and its tuning noise."""
    X, y, f = cells(12)
    strongest = X[:, -1] == np.argmax([np.ptp(f[X[:, -1] == i]) for i in range(20)])
    model = MultiTaskGPRegressor().fit(X, y)
    assert (model.normalize_y_, model.noise_) == ("per_task", "per_task")
    error = np.sqrt(np.mean((model.predict(X) - f)[strongest] ** 2))
    assert error < 0.3 * f[strongest].std()  # it was 0.8
