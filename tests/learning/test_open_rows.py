"""What the data leave open of rows of F; it widens intervals where it is much."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp.learning.novel import Population
from skmtgp.learning.open_rows import open_row, with_open_rows

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
    assert LAST in [of.task for of in fitted._leeway[0]]


def test_tasks_with_rows_everywhere_are_as_certain_as_before():
    """A hundred rows each tell the rows of F, and little is added anywhere."""
    rng, tasks = np.random.default_rng(0), np.repeat([0, 1, 2], 100)
    x = rng.uniform(0.0, 6.0, 300)
    y = (1.0 + tasks) * np.sin(x) + 0.1 * rng.standard_normal(300)
    X = np.column_stack([x, tasks])
    model = MultiTaskGPRegressor(rank=1, kernel="rbf").fit(X, y)
    assert model._leeway == [()]
    std = model.predict(X, return_std=True)[1]
    np.testing.assert_allclose(std, known_rows(model, X), rtol=1e-12)


def posed(model):
    """The problem, the mode and the posterior that were learned from."""
    found = []

    def seen(problem, mode, posterior):
        found.append((problem, mode, posterior))
        return mode

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skmtgp.multitask.with_open_rows", seen)
        X, y, *_ = draw(1)
        clone(model).fit(X, y)
    return found[0]


@pytest.mark.parametrize("options", [{}, {"diagonal": True}, {"rank": 1}])
def test_rows_by_the_book(options):
    """Fisher's information of l, of p(y_task | the other tasks), by differences."""
    model = MultiTaskGPRegressor(**{"rank": 2} | options, kernel="rbf")
    problem, mode, _ = posed(model.set_params(task_levels=False, noise="shared"))
    prior, data = problem.prior, problem.data
    at = np.linspace(0.0, 6.0, 5)[:, None]
    [leeway], g = open_row(problem, mode.theta, LAST, at)
    values, last = prior.values(mode.theta), data.tasks == LAST
    F = prior.task_covariance.columns(values.rho)
    k, others = prior.kernel_at(mode.theta), ~last
    K_rho, noise = prior.K_rho_at(mode.theta), values.noise[0]
    K = K_rho[np.ix_(data.tasks, data.tasks)] * k(data.X) + noise * np.eye(len(data.y))
    old = K[np.ix_(others, others)]

    def latents(X):  # cov(y_old, z_a(X))
        K_x = k(data.X[others], X)
        return [F[data.tasks[others], a][:, None] * K_x for a in range(F.shape[1])]

    solved = np.linalg.solve(old, data.y[others])
    np.testing.assert_allclose(g, [c.T @ solved for c in latents(at)], atol=1e-8)
    of_last, X = latents(data.X[last]), data.X[last]

    def gaussian(row):
        c = np.tensordot(row[:rank], of_last, axes=1)
        S = row @ row * k(X) + noise * np.eye(len(X))
        return c.T @ solved, S - c.T @ np.linalg.solve(old, c)

    own = np.sqrt(np.diagonal(K_rho - F @ F.T)[[LAST] * bool(options.get("diagonal"))])
    rank, row, step = F.shape[1], np.append(F[LAST], own), 1e-5
    _, S = gaussian(row)
    d_mean, d_S = [], []
    for e in step * np.eye(len(row)):
        (m, A), (n, B) = gaussian(row + e), gaussian(row - e)
        d_mean.append((m - n) / (2 * step))
        d_S.append(np.linalg.solve(S, (A - B) / (2 * step)))
    d_mean = np.array(d_mean)
    information = d_mean @ np.linalg.solve(S, d_mean.T)
    information += 0.5 * np.einsum("aij,bji->ab", d_S, d_S)
    scale = Population(np.delete(F, LAST, axis=0), len(own)).scale
    expected = np.linalg.inv(information + np.linalg.inv(scale @ scale.T))[:rank, :rank]
    covariance = leeway.axes[0].T @ leeway.axes[0]
    np.testing.assert_allclose(covariance, expected, rtol=1e-5)


def test_nothing_is_open_where_nothing_was_learned_so():
    X, y, *_ = draw(0)
    quick = {"rank": 1, "kernel": "rbf", "max_iter": 5}
    of_paper = MultiTaskGPRegressor(**quick, learning="staged").fit(X, y)
    kept = MultiTaskGPRegressor(**quick | {"max_iter": 0}).fit(X, y)
    shared = MultiTaskGPRegressor(**quick | {"rank": 0, "shared": True}).fit(X, y)
    for model in (of_paper, kept, shared):
        assert model._leeway == [()]


def test_a_search_keeps_what_is_open():
    X, y, *_ = draw(0)
    search = RankSearchIC(MultiTaskGPRegressor(kernel="rbf"), ranks=[1, 2]).fit(X, y)
    assert search.best_estimator_._leeway[0]


def test_as_many_as_are_affordable():
    """Those that matter most; each end of an axis takes a posterior."""
    problem, mode, posterior = posed(MultiTaskGPRegressor(rank=2, kernel="rbf"))
    everything = with_open_rows(problem, mode, posterior).leeway
    assert everything[0].task == LAST
    cube = len(problem.data) ** 3

    def opened(work):
        tuning = replace(problem.tuning, open_work=work * cube)
        return with_open_rows(replace(problem, tuning=tuning), mode, posterior).leeway

    n_ends = 2 * sum(len(of.axes[0]) for of in everything)
    assert len(everything) > 3
    assert len(opened(n_ends + 1)) == len(everything)
    assert [of.task for of in opened(M + 1)] == [of.task for of in everything[:2]]
    assert opened(M - 1) == ()  # to ask takes a posterior of each task


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
    """Nor does which inputs are asked, of more than are."""
    X, y, new, _ = draw(3)
    assert len(X) > 64
    order = np.random.default_rng(0).permutation(len(y))
    options = {"rank": 1, "kernel": "rbf", "tol": 1e-8}
    models = [MultiTaskGPRegressor(**options).fit(X[of], y[of]) for of in (..., order)]
    tasks = [[of.task for of in model._leeway[0]] for model in models]
    assert tasks[0] == tasks[1] != []
    of_both = [model.predict(new, return_std=True)[1] for model in models]
    np.testing.assert_allclose(*of_both, rtol=1e-4)
