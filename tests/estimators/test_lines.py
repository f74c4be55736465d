"""`kernel=None` and functions that are linear: straight lines, planes."""

from types import SimpleNamespace

import numpy as np
import pytest
from rarely import rarely
from sklearn.gaussian_process.kernels import RBF
from sklearn.linear_model import LinearRegression

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    compile_predictor,
)
from skmtgp._data.data import Data
from skmtgp._estimators import revising
from skmtgp.exceptions import CorrelatedResidualsWarning
from skmtgp.inference.engines import Dense
from skmtgp.kernels import ARDLinear
from skmtgp.learning.lines import may_be_lines
from skmtgp.learning.tuning import TUNING


def lines(seed, *, n_tasks=8, n_each=10, d=3, alike=0.0, noise=0.4, at=0.0):
    """Rows of planes of each task, inputs around `at`, and those that tell the truth.

    The slopes of tasks are `alike` plus deviations of one.
    """
    rng = np.random.default_rng(seed)
    slopes = alike + rng.standard_normal((n_tasks, d))
    tasks = np.repeat(np.arange(n_tasks), n_each)

    def rows(spread):
        x = spread * rng.standard_normal((len(tasks), d))
        f = (slopes[tasks] * x).sum(axis=1) + tasks
        return np.column_stack([x + at, tasks]), f

    (X, f), (Z, g) = rows(1.0), rows(3.0)
    return X, f + noise * rng.standard_normal(len(f)), Z, g


def is_linear(model):
    kernel = getattr(model, "best_estimator_", model).kernel_
    return type(getattr(kernel, "k2", kernel)) is ARDLinear


def least_squares(X, y, Z):
    """Predictions by a plane of each task alone."""
    found = np.empty(len(Z))
    for task in np.unique(Z[:, -1]):
        own, new = X[:, -1] == task, Z[:, -1] == task
        plane = LinearRegression().fit(X[own, :-1], y[own])
        found[new] = plane.predict(Z[new, :-1])
    return found


def error(found, g):
    return np.sqrt(np.mean((found - g) ** 2) / g.var())


@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
@pytest.mark.parametrize("alike", [0.0, 2.0])
def test_planes_are_found(seed, alike):
    """Also where there are no rows, to which they go on."""
    X, y, Z, g = lines(seed, alike=alike)
    model, smooth = (MultiTaskGPRegressor(of).fit(X, y) for of in (None, "rbf"))
    assert is_linear(model)
    found = error(model.predict(Z), g)
    assert found < 0.9 * error(smooth.predict(Z), g)
    assert found < 1.1 * error(least_squares(X, y, Z), g)
    assert model.n_evaluations_ > smooth.n_evaluations_  # those are counted, too
    form = {name: getattr(model, f"{name}_") for name in ("rank", "shared", "diagonal")}
    alone = MultiTaskGPRegressor("linear", **form).fit(X, y)
    value = alone.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.05)


@pytest.mark.parametrize("cls", [IndependentGP, PooledGP, SingleTaskGP, RankSearchIC])
def test_every_model_finds_them(cls):
    n_tasks = 1 if cls in (PooledGP, SingleTaskGP) else 8
    X, y, Z, g = lines(0, n_tasks=n_tasks, n_each=80 // n_tasks)
    model = cls().fit(X, y)
    assert is_linear(model.estimators_[0] if cls is SingleTaskGP else model)
    assert error(model.predict(Z), g) < 0.2


def test_far_from_zero():
    """Years, say: it is the same model, because the kernel is centred."""
    data = [lines(0, at=at) for at in (0.0, 2000.0)]
    here, there = (MultiTaskGPRegressor().fit(*of[:2]) for of in data)
    assert is_linear(there)
    mean = data[1][0][:, :-1].mean(axis=0)
    np.testing.assert_allclose(there.kernel_.center, mean)
    found = there.predict(data[1][2])
    np.testing.assert_allclose(found, here.predict(data[0][2]), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_curves_are_not_taken_for_lines(seed):
    X, y, *_ = lines(seed, d=1, n_each=12, noise=0.1)
    model = MultiTaskGPRegressor().fit(X, y + np.sin(2.0 * X[:, 0]))
    assert not is_linear(model)


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_steep_curves_that_bend_little_are_none(seed):
    """Lines are likelier, but take the bend for noise."""
    rng = np.random.default_rng(seed)
    levels, slopes = rng.normal(0.0, 2.0, 5), rng.normal(1.0, 0.05, 5)
    bends, waves = rng.normal(0.0, 3e-4, 5), rng.normal(0.0, 0.2, 5)

    def rows(x, task):
        f = levels[task] + slopes[task] * x + bends[task] * x**2
        return np.column_stack([x, task]), f + waves[task] * np.sin(x / 12.0)

    grid = np.tile(np.linspace(0.0, 100.0, 8), 5) + rng.uniform(-3.0, 3.0, 40)
    X, f = rows(grid, np.repeat(np.arange(5), 8))
    Z, g = rows(rng.uniform(0.0, 100.0, 200), np.repeat(np.arange(5), 40))
    y = f + 0.1 * rng.standard_normal(40)
    model = MultiTaskGPRegressor().fit(X, y)
    assert not is_linear(model)
    with pytest.warns(CorrelatedResidualsWarning):
        straight = MultiTaskGPRegressor("linear").fit(X, y)
    assert error(model.predict(Z), g) < 0.7 * error(straight.predict(Z), g)


@pytest.mark.parametrize("loss", [-2.0, 0.9, 1.1])
def test_what_left_out_rows_lose_is_taken_off(loss, monkeypatch):
    """Else logarithms that bend a little were taken for lines."""
    X, y, *_ = lines(0, n_tasks=4, n_each=20)
    monkeypatch.setattr(revising, "_gain", lambda *_: 4.0)
    monkeypatch.setattr(revising, "_loss_left_out", lambda *_: loss)
    assert is_linear(IndependentGP().fit(X, y)) == (4.0 - loss > 3.0)


@pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP])
def test_lines_that_are_far_worse_are_not_learned_on(cls, monkeypatch):
    """One climb tells."""
    X, y, *_ = lines(0, n_tasks=4, n_each=20, d=1, noise=0.1)
    y += 0.02 * X[:, 0] ** 3 + 0.2 * X[:, 0] ** 2
    asked = cls("rbf").fit(X, y)
    monkeypatch.setattr(revising, "may_be_lines", lambda problem, mode: True)
    monkeypatch.setattr(revising, "_loss_left_out", None)  # not reached
    model = cls().fit(X, y)
    assert type(model.kernel_) is type(asked.kernel_)
    more = model.n_evaluations_ - asked.n_evaluations_
    assert 0 < more < 200
    value = asked.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.1)


def test_only_where_the_user_does_not_say():
    X, y, *_ = lines(0)
    for kernel in ("rbf", RBF(np.ones(3)), "matern"):
        assert not is_linear(MultiTaskGPRegressor(kernel).fit(X, y))
    start = MultiTaskGPRegressor(max_iter=0).fit(X, y)  # nothing is learned
    assert not is_linear(start)


def test_an_engine_that_takes_no_lines():
    """It is asked before anything is learned."""

    class Stationary(Dense):
        def check(self, prior, data, tasks):
            if not prior.kernel.is_stationary():
                raise ValueError("stationary kernels only")

    X, y, *_ = lines(0)
    model = MultiTaskGPRegressor(inference=Stationary()).fit(X, y)
    assert not is_linear(model)


def test_many_rows_that_are_means():
    """Least squares of plain rows would not know how much noise means have."""
    X, y, *_ = lines(0, n_tasks=6, n_each=90, noise=0.0)
    counts = np.random.default_rng(0).integers(1, 4, len(y))
    y += 0.4 / np.sqrt(counts) * np.random.default_rng(1).standard_normal(len(y))
    known = {"sample_weight": counts, "repeat_variance": 0.16 * (1.0 - 1.0 / counts)}
    model = MultiTaskGPRegressor(rank=0, shared=True, diagonal="equal")
    assert is_linear(model.fit(X, y, **known))


def test_noise_of_each_task():
    """It is decided with lines, as with any k^x."""
    X, y, *_ = lines(0, n_tasks=4, n_each=25)
    noise = np.random.default_rng(1).standard_normal(len(y))
    y = y + np.where(X[:, -1] == 0.0, 6.0, 0.1) * noise
    model = MultiTaskGPRegressor().fit(X, y)
    assert is_linear(model)
    assert model.noise_ == "per_task"
    assert model.noise_variance_.argmax() == 0


def test_inputs_of_tasks_that_do_not_overlap(monkeypatch):
    """Lines go on where there are no rows, so rows there would have to tell."""
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(4), 12)
    x = tasks + rng.uniform(0.0, 0.8, len(tasks))
    X, y = np.column_stack([x, tasks]), x + 0.2 * rng.standard_normal(len(x))
    assert not is_linear(MultiTaskGPRegressor().fit(X, y))
    monkeypatch.setattr(revising, "is_apart", lambda problem: False)
    assert is_linear(MultiTaskGPRegressor().fit(X, y))


@pytest.mark.parametrize("per_task", [False, True])
@pytest.mark.parametrize("kernel", [None, "linear"])
def test_beside_a_trend_of_lines(per_task, kernel):
    """Nothing but rounding is left to the kernel of what a trend explains."""
    X, y, Z, g = lines(0, alike=2.0)
    model = MultiTaskGPRegressor(kernel, trend="linear", trend_per_task=per_task)
    assert error(model.fit(X, y).predict(Z), g) < 0.2


def test_single_tasks_of_which_one_is_a_line():
    """Their kernels have different numbers of parameters."""
    rng = np.random.default_rng(0)
    tasks, x = np.repeat([0, 1], 25), rng.uniform(-2.0, 2.0, 50)
    f = np.where(tasks, 2.0 * x, np.sin(4.0 * x))
    X, y = np.column_stack([x, tasks]), f + 0.2 * rng.standard_normal(50)
    model = SingleTaskGP().fit(X, y)
    assert [is_linear(of) for of in model.estimators_] == [False, True]
    value, gradient = model.log_marginal_likelihood(model.theta_, eval_gradient=True)
    assert value == pytest.approx(model.log_marginal_likelihood_value_)
    assert gradient.shape == model.theta_.shape
    predictor = compile_predictor(model)
    found = [predictor(row[:-1], int(row[-1])) for row in X[::9]]
    np.testing.assert_allclose(np.ravel(found), model.predict(X[::9]), rtol=1e-9)


def test_a_form_without_noise_does_not_decide():
    """Two rows a task: rank 1 explains them all, and so do lines."""
    rng = np.random.default_rng(901)
    tasks, x = np.repeat(np.arange(40), 2), rng.uniform(0.0, 6.0, 80)
    y = 2.0 * rng.standard_normal(40)[tasks] + np.sin(x)
    y += 0.15 * rng.standard_normal(80)
    search = RankSearchIC(ranks=(0, 1), simpler=True).fit(
        np.column_stack([x, tasks]), y
    )
    table = search.results_.set_index("model")
    assert table["bic"].idxmin() == "rank 1"
    assert table.loc["rank 1", "log_marginal_likelihood"] > 100.0
    assert search.best_rank_ == 0
    assert not is_linear(search)


@pytest.mark.parametrize("seed", [3, 4])
def test_many_inputs_of_which_few_matter(seed):
    """Curves follow the noise along others, and rows that are left out do not tell."""
    rng = np.random.default_rng(seed)
    slopes = np.zeros((5, 30))
    slopes[:, :4] = rng.normal([1.0, -1.0, 0.7, 0.5], 0.2, (5, 4))
    levels, tasks = rng.normal(0.0, 1.0, 5), np.repeat(np.arange(5), 70)
    x = rng.normal(size=(350, 30))
    f = levels[tasks] + (x * slopes[tasks]).sum(axis=1)
    X, y = np.column_stack([x, tasks]), f + 0.5 * rng.normal(size=350)
    train = np.arange(350) % 70 < 20
    model = MultiTaskGPRegressor().fit(X[train], y[train])
    assert is_linear(model)
    assert np.sqrt(np.mean((model.predict(X[~train]) - f[~train]) ** 2)) < 0.4


@pytest.mark.parametrize(("values", "may_be"), [(2, True), (3, False)])
def test_an_input_of_two_values_does_not_bend(values, may_be):
    """However short its length-scale is."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.normal(size=60), np.arange(60) % values])
    data = Data(X, np.repeat([0, 1, 2], 20), X.sum(axis=1), 3)
    prior = SimpleNamespace(
        kernel_at=lambda theta: RBF([50.0, 0.01]), trend=None, n_noise=1
    )
    problem = SimpleNamespace(
        data=data, prior=prior, tuning=TUNING, log_likelihood=lambda mode: 0.0
    )
    assert may_be_lines(problem, SimpleNamespace(theta=None)) == may_be


@pytest.mark.parametrize("seed", [3, *rarely(1, 2, 7)])
def test_planes_behind_noise(seed):
    """Curves follow it, by a form of K^rho that does not suit planes."""
    rng = np.random.default_rng(seed)
    slopes = [1.0, 0.3, 0.2, -0.1] + 0.4 * rng.standard_normal((12, 4))
    x, z = rng.standard_normal((60, 4)), rng.standard_normal((200, 4))
    noise = np.sqrt(np.square(slopes).sum(axis=1) / 0.3)[:, None]
    f, g = slopes @ x.T, (slopes @ z.T).ravel()
    y = (f + noise * rng.standard_normal(f.shape)).ravel()
    X, Z = (
        np.column_stack([np.tile(of, (12, 1)), np.repeat(np.arange(12), len(of))])
        for of in (x, z)
    )
    model = MultiTaskGPRegressor().fit(X, y)
    assert is_linear(model)
    straight = MultiTaskGPRegressor("linear").fit(X, y)
    value = straight.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.05)
    found, smooth = error(model.predict(Z), g), MultiTaskGPRegressor("matern")
    assert found < 0.9 * error(smooth.fit(X, y).predict(Z), g)
    assert found < 0.9 * error(least_squares(X, y, Z), g)
