"""What the data leave open of rows of F widens intervals."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.exceptions import SmallTaskWarning
from skmtgp.inference.leeway import OfAll

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.OutlierWarning"),
]
M, N, NEW = 8, 20, 30
LAST = M - 1


def draw(seed, rank=2, noise=0.1, corner=2.0, rows=8):
    """Tasks on [0, 6]; the last has a few rows in a corner, and is asked beyond it."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 6.0, (M, N + NEW))
    x[LAST, :N] = rng.uniform(0.0, corner, N)
    x[LAST, N:] = rng.uniform(corner, 6.0, NEW)
    K = RBF(1.0)(x.reshape(-1, 1)) + 1e-9 * np.eye(x.size)
    z = np.linalg.cholesky(K) @ rng.standard_normal((x.size, rank))
    F = 0.5 * rng.standard_normal((M, rank)) + np.eye(rank)[0]
    y = np.einsum("tnr,tr->tn", z.reshape(*x.shape, rank), F)
    y = y + noise * rng.standard_normal(x.shape)
    X = np.stack([x, np.broadcast_to(np.arange(M)[:, None], x.shape)], axis=-1)
    kept = np.ones((M, N), dtype=bool)
    kept[LAST, rows:] = False
    return X[:, :N][kept], y[:, :N][kept], X[LAST, N:], y[LAST, N:]


def known_rows(model, X):
    """Deviations of f with theta alone."""
    [posterior] = model._posteriors
    variance = posterior.variance(X[:, :-1], X[:, -1].astype(int))
    variance *= model.variance_factor_
    return np.sqrt(variance) * model.y_scale_


def share_held(seed):
    """Of new observations of the last task, by 95 % intervals."""
    X, y, new, observed = draw(seed)
    lower, upper = MultiTaskGPRegressor(rank=2).fit(X, y).predict_interval(new)
    return np.mean((lower <= observed) & (observed <= upper))


def test_intervals_of_a_task_in_a_corner_hold(monkeypatch):
    """Its rows tell little of how it is related to the others."""
    seeds = range(6)
    held = np.mean([share_held(seed) for seed in seeds])
    monkeypatch.setattr(
        "skmtgp.multitask.with_open_rows", lambda problem, mode, posterior: mode
    )
    before = np.mean([share_held(seed) for seed in seeds])
    assert held > 0.85
    assert before < held - 0.15


@pytest.fixture(scope="module")
def fitted():
    X, y, *_ = draw(0)
    return MultiTaskGPRegressor(rank=2).fit(X, y)


def test_means_are_those_of_the_mode(fitted):
    *_, new, _ = draw(0)
    mean, std = fitted.predict(new, return_std=True)
    [posterior] = fitted._posteriors
    of_mode = posterior.mean(new[:, :-1], new[:, -1].astype(int))
    np.testing.assert_allclose(mean, of_mode * fitted.y_scale_ + fitted.y_mean_)
    assert (std > known_rows(fitted, new)).all()
    *rows, _ = fitted._leeway[0]
    assert [of.task for of in rows] == list(range(M))


def test_tasks_with_rows_everywhere_are_nearly_as_certain():
    """A hundred rows each tell the rows of F, and little is added anywhere."""
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1, 2], 100)
    x = rng.uniform(0.0, 6.0, 300)
    y = (1.0 + tasks) * np.sin(x) + 0.1 * rng.standard_normal(300)
    X = np.column_stack([x, tasks])
    model = MultiTaskGPRegressor(rank=1, kernel="rbf").fit(X, y)
    std = model.predict(X, return_std=True)[1]
    more = std / known_rows(model, X)
    assert (more > 1.0).all()
    assert (more < 2.0).all()
    assert more.mean() < 1.3


def test_a_task_of_two_rows_is_less_certain_than_the_others():
    rng, tasks = np.random.default_rng(1), np.repeat(range(4), 12)
    x = rng.uniform(0.0, 6.0, 48)
    y = (1.0 + tasks) * np.sin(x) + 0.1 * rng.standard_normal(48)
    kept = (tasks != 3) | (np.arange(48) % 6 == 0)
    X = np.column_stack([x, tasks])[kept]
    options = {"rank": 1, "normalize_y": "shared", "noise": "shared"}
    with pytest.warns(SmallTaskWarning):
        model = MultiTaskGPRegressor("rbf", **options).fit(X, y[kept])
    *rows, _ = model._leeway[0]
    assert [of.task for of in rows] == [0, 1, 2, 3]
    new = np.array([[2.0, 3.0], [5.0, 3.0], [2.0, 1.0]])
    more = model.predict(new, return_std=True)[1] / known_rows(model, new) - 1.0
    assert (more > 0.0).all()
    assert (more[:2] > 2.0 * more[2]).all()


def test_nothing_is_open_where_nothing_was_learned_so():
    X, y, *_ = draw(0)
    quick = {"rank": 1, "kernel": "rbf", "max_iter": 5}
    of_paper = MultiTaskGPRegressor(**quick, learning="staged").fit(X, y)
    kept = MultiTaskGPRegressor(**quick | {"max_iter": 0}).fit(X, y)
    shared = MultiTaskGPRegressor(**quick | {"rank": 0, "shared": True}).fit(X, y)
    one = MultiTaskGPRegressor(**quick).fit(X[X[:, 1] < 1], y[X[:, 1] < 1])
    for model in (of_paper, kept):
        assert model._leeway == [()]
    for model in (shared, one):
        assert all(isinstance(of, OfAll) for of in model._leeway[0])


def test_a_search_keeps_what_is_open():
    X, y, *_ = draw(0)
    search = RankSearchIC(MultiTaskGPRegressor(kernel="rbf"), ranks=[1, 2]).fit(X, y)
    assert search.best_estimator_._leeway[0]


def test_engines_agree():
    """Of complete data, which the fast algebra decomposes."""
    rng, x = np.random.default_rng(0), np.linspace(0.0, 6.0, 8)
    X = np.column_stack([np.tile(x, 4), np.repeat(np.arange(4), 8)])
    y = np.sin(X[:, 0] + X[:, 1]) + 0.1 * rng.standard_normal(32)
    options = {"rank": 2, "kernel": "rbf", "noise": "shared", "tol": 1e-9}
    dense = MultiTaskGPRegressor(**options, inference="dense").fit(X, y)
    fast = MultiTaskGPRegressor(**options, inference="kronecker").fit(X, y)
    assert fast._leeway[0]
    of_both = [model.predict(X, return_std=True)[1] for model in (dense, fast)]
    np.testing.assert_allclose(*of_both, rtol=1e-4)


def test_orders_of_rows_do_not_matter():
    X, y, new, _ = draw(3)
    order = np.random.default_rng(0).permutation(len(y))
    options = {"rank": 1, "kernel": "rbf", "tol": 1e-8}
    models = [MultiTaskGPRegressor(**options).fit(X[of], y[of]) for of in (..., order)]
    of_both = [model.predict(new, return_std=True)[1] for model in models]
    np.testing.assert_allclose(*of_both, rtol=1e-4)
