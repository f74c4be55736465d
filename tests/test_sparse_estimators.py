"""Sparse inference behind the estimators."""

import pickle
import tracemalloc
from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from numpy.testing import assert_allclose, assert_array_equal
from sklearn import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, WhiteKernel
from sklearn.utils._param_validation import InvalidParameterError

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import InsufficientMemoryError
from skmtgp.inference import inducing
from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.memory import TileMemory
from skmtgp.learning import summarised
from skmtgp.learning.problem import Mode
from skmtgp.model.task_covariance import low_rank, ones

M, N, NOISE = 3, 90, 0.05
FACTOR = np.array([[1.0, 0.2], [-0.7, 0.5], [0.4, 1.0]])
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def draw(n=N, seed=0, n_outputs=None):
    """Rows in no order of their tasks, the label last."""
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(-2.0, 2.0, (n, 2)), rng.integers(0, M, n)
    tasks[:M] = np.arange(M)
    z = np.column_stack([np.sin(2.0 * x[:, 0]), np.cos(x[:, 1] + x[:, 0])])
    y = (FACTOR[tasks] * z).sum(axis=1) + NOISE * rng.standard_normal(n)
    if n_outputs:
        y = y[:, None] * np.linspace(1.0, 2.0, n_outputs) + np.arange(n_outputs)
    return np.column_stack([x, tasks]), y


SPARSE = {"inference": "sparse", "n_inducing": 20, "n_exact": 60, "max_iter": 15}
GPS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(rank=2, **SPARSE),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **SPARSE),
    "per task": MultiTaskGPRegressor(rank=2, noise="per_task", **SPARSE),
    "staged": MultiTaskGPRegressor(rank=2, learning="staged", **SPARSE),
    "k-means": MultiTaskGPRegressor(rank=2, inducing_inputs="k-means", **SPARSE),
    "optimised": MultiTaskGPRegressor(rank=2, inducing_inputs="optimised", **SPARSE),
    "IndependentGP": IndependentGP(**SPARSE),
    "PooledGP": PooledGP(**SPARSE),
}
each = pytest.mark.parametrize("model", GPS.values(), ids=GPS.keys())


@each
class TestFit:
    def test_bound_is_below_the_likelihood(self, model):
        X, y = draw()
        sparse = clone(model).fit(X, y)
        exact = clone(model).set_params(inference="dense", max_iter=0).fit(X, y)
        below = sparse.log_marginal_likelihood_value_
        assert below < exact.log_marginal_likelihood(sparse.theta_)
        assert_allclose(below, sparse.log_marginal_likelihood(sparse.theta_), rtol=1e-9)
        assert sparse.inference_ == "sparse"
        assert sparse.inducing_inputs_.shape == (20, 2)

    def test_exact_where_all_inputs_are_inducing(self, model):
        X, y = draw(40)
        model = clone(model).set_params(n_inducing=1000, kernel=RBF(1.0))
        sparse = model.fit(X, y)
        exact = clone(model).set_params(inference="dense", max_iter=0).fit(X, y)
        theta = sparse.theta_
        value, gradient = exact.log_marginal_likelihood(theta, eval_gradient=True)
        found = sparse.log_marginal_likelihood(theta, eval_gradient=True)
        assert_allclose(found[0], value, rtol=1e-6)
        assert_allclose(
            found[1], gradient, rtol=1e-3, atol=1e-6 + 1e-3 * abs(gradient).max()
        )

    def test_order_of_rows_does_not_matter(self, model):
        X, y = draw()
        model = clone(model).set_params(max_iter=0, n_inducing=N, n_exact=N)
        order = np.random.default_rng(1).permutation(N)
        one, other = model.fit(X, y), clone(model).fit(X[order], y[order])
        assert_allclose(
            one.log_marginal_likelihood_value_,
            other.log_marginal_likelihood_value_,
            rtol=1e-9,
        )
        for a, b in zip(
            one.predict(X, return_std=True),
            other.predict(X, return_std=True),
            strict=True,
        ):
            assert_allclose(a, b, rtol=1e-6, atol=1e-8)
        for a, b in zip(one.loo_predict(), other.loo_predict(), strict=True):
            assert_allclose(a[order], b, rtol=1e-6, atol=1e-8)

    def test_predicts(self, model):
        X, y = draw(300)
        model = clone(model).set_params(n_inducing=40, max_iter=200).fit(X, y)
        X_new, y_new = draw(200, seed=1)
        mean, std = model.predict(X_new, return_std=True)
        if not isinstance(model, PooledGP):
            assert np.mean((mean - y_new) ** 2) < 0.1 * y_new.var()
        _, covariance = model.predict(X_new[:9], return_cov=True)
        assert_allclose(np.diagonal(covariance), std[:9] ** 2, rtol=1e-6, atol=1e-9)
        assert model.sample_y(X_new[:9], 3).shape == (9, 3)

    def test_pickles(self, model):
        X, y = draw(n_outputs=2)
        model = clone(model).set_params(max_iter=2).fit(X, y)
        again = pickle.loads(pickle.dumps(model))
        assert_allclose(again.predict(X), model.predict(X), rtol=0.0)
        assert [len(Z) for Z in model.inducing_inputs_] == [20, 20]


def test_dense_has_no_inducing_inputs():
    model = MultiTaskGPRegressor(rank=1, **SPARSE).fit(*draw())
    model.set_params(inference="dense").fit(*draw(20))
    assert not hasattr(model, "inducing_inputs_")


def test_single_tasks():
    X, y = draw()
    model = SingleTaskGP(**SPARSE).fit(X, y)
    assert model.inference_ == "sparse"
    alone = PooledGP(**SPARSE).fit(X[X[:, -1] == 1], y[X[:, -1] == 1])
    rows = X[:, -1] == 1
    assert_allclose(model.predict(X[rows]), alone.predict(X[rows]), rtol=1e-8)


class TestRankSearch:
    def test_likelihood_does_not_fall_with_the_rank(self):
        search = RankSearchIC(MultiTaskGPRegressor(**SPARSE), ranks=(1, 2, 3))
        search.set_params(keep_estimators=True).fit(*draw())
        values = search.results_["log_marginal_likelihood"]
        assert (np.diff(values) >= 0.0).all()
        found = [m.log_marginal_likelihood_value_ for m in search.estimators_]
        assert_allclose(found, values, rtol=1e-9)
        first, *others = (m.inducing_inputs_ for m in search.estimators_)
        for other in others:
            assert_array_equal(first, other)

    def test_progress(self, capsys):
        model = MultiTaskGPRegressor(rank=1, verbose=1, **SPARSE)
        model.set_params(max_iter=1).fit(*draw())
        assert "bound on the log marginal likelihood" in capsys.readouterr().out


def scattered(seed=0):
    """A bound, parameters, and what they stand for."""
    X, y = draw(30, seed)
    kernel, form = RBF([0.8, 1.3]), low_rank(M, 2)
    theta = np.concatenate([kernel.theta, FACTOR.ravel(), [np.log(NOISE)]])
    features, tasks = X[:, :2], X[:, 2].astype(int)
    bound = building.sparse(
        kernel, form, features, tasks, y, features[:8], block_size=7
    )
    return bound, theta


class TestLeaveOneOut:
    def expected(self, bound, theta):
        """Left out one after another, with the same inducing inputs."""
        K_rho, every = FACTOR @ FACTOR.T, np.arange(len(bound.y))
        kernel, Z = bound.kernel, bound.Z
        Q = kernel(bound.X, Z) @ np.linalg.solve(kernel(Z), kernel(Z, bound.X))
        between = K_rho[np.ix_(bound.tasks, bound.tasks)]
        Q, prior = Q * between, between * kernel(bound.X)
        for i in every:
            o = every[every != i]
            solved = np.linalg.solve(Q[np.ix_(o, o)] + NOISE * np.eye(len(o)), Q[o, i])
            yield bound.y[i] - solved @ bound.y[o], prior[i, i] - solved @ Q[o, i]

    @pytest.mark.parametrize("include_noise", [False, True])
    def test_leave_one_out(self, include_noise):
        bound, theta = scattered()
        found = bound.posterior(theta).leave_one_out(include_noise)
        residual, variance = np.array(list(self.expected(bound, theta))).T
        assert_allclose(found[0], residual, rtol=1e-8, atol=1e-10)
        assert_allclose(found[1], variance + NOISE * include_noise, rtol=1e-7)


class TestAddTask:
    @pytest.mark.parametrize("n", [5, 40])
    def test_latent_functions(self, n):
        """Their covariances are those of the tasks' functions, without F."""
        bound, theta = scattered()
        posterior, rank = bound.posterior(theta), FACTOR.shape[1]
        X = np.random.default_rng(2).uniform(-2.0, 2.0, (n, 2))
        means, halves = posterior.latent(X, FACTOR)
        assert halves.shape == (rank, rank * min(n, len(bound.Z)), n)
        for m, F_m in enumerate(FACTOR):
            tasks = np.full(n, m)
            assert_allclose(F_m @ means, posterior.mean(X, tasks), rtol=1e-7)
            half = np.tensordot(F_m, halves, 1)
            covariance = (F_m @ F_m) * bound.kernel(X) - half.T @ half
            expected = posterior.covariance(X, tasks)
            assert_allclose(covariance, expected, rtol=1e-7, atol=1e-9)

    def test_border_where_all_inputs_are_inducing(self):
        bound, theta = scattered()
        bound = bound.with_inducing(bound.X)
        order = np.argsort(bound.tasks, kind="stable")
        exact = building.dense(
            bound.kernel,
            bound.task_covariance,
            *(part[order] for part in (bound.X, bound.tasks, bound.y)),
        )
        X, y = np.random.default_rng(2).uniform(-2.0, 2.0, (4, 2)), np.arange(4.0)
        row = np.array([0.3, -0.8])
        found, expected = (
            BorderLikelihood(some.posterior(theta), FACTOR, X, y, NOISE, False)
            for some in (bound, exact)
        )
        found, expected = (one.value_and_grad(row) for one in (found, expected))
        assert_allclose(found[0], expected[0], rtol=1e-5)
        assert_allclose(found[1], expected[1], rtol=1e-4)

    def test_a_novel_task(self):
        X, y = draw(400)
        known, novel = X[:, 2] < 2, np.flatnonzero(X[:, 2] == 2)
        model = MultiTaskGPRegressor(rank=2, **SPARSE | {"max_iter": 200})
        model.set_params(n_inducing=50).fit(X[known], y[known])
        before = model.predict(X[known])
        extended = model.add_task(X[novel[:10]], y[novel[:10]])
        mean = extended.predict(X[novel])
        assert np.mean((mean - y[novel]) ** 2) < 0.2 * y[novel].var()
        assert extended.inference_ == "sparse"
        assert 50 <= len(extended.inducing_inputs_) <= 60
        assert_array_equal(model.predict(X[known]), before)

    def test_a_large_novel_task(self):
        """It does not get more inducing inputs than the others have."""
        X, y = draw(200)
        known = X[:, 2] < 2
        model = MultiTaskGPRegressor(rank=1, **SPARSE).fit(X[known], y[known])
        extended = model.add_task(X[~known], y[~known])
        assert len(extended.inducing_inputs_) <= 40

    @pytest.mark.parametrize(
        "options", [{"noise": "per_task"}, {"diagonal": True}, {"learning": "staged"}]
    )
    def test_novel_task_where_all_inputs_are_inducing(self, options):
        """It is the novel task of exact inference."""
        X, y = draw(80)
        novel = X[:, 2] == 2
        found = []
        for inference in ("sparse", "dense"):
            model = MultiTaskGPRegressor(rank=1, max_iter=0, **options)
            model.set_params(inference=inference, n_inducing=len(y))
            model.fit(X[~novel], y[~novel]).set_params(max_iter=100)
            found.append(model.add_task(X[novel], y[novel]))
        assert_allclose(*(model.theta_ for model in found), rtol=1e-5, atol=1e-5)
        pairs = (model.predict(X, return_std=True) for model in found)
        means, stds = zip(*pairs, strict=True)
        assert_allclose(*means, rtol=1e-5, atol=1e-5)
        assert_allclose(*stds, rtol=1e-5)


class TestMemory:
    def test_that_cannot_suffice(self, monkeypatch):
        monkeypatch.setattr(_memory, "available_memory", lambda: 1e6)
        match = "Sparse inference with n_inducing=90, 3 tasks and rank 2 needs about"
        model = MultiTaskGPRegressor(rank=2, inference="sparse")
        with pytest.raises(InsufficientMemoryError, match=match):
            model.fit(*draw())

    def test_too_much_memory_of_the_rows_that_are_learned_exactly(self, monkeypatch):
        X, y = draw()
        tiles = TileMemory(RBF(), X[:1]).of_triangle(SPARSE["n_exact"], 1)
        needed = 8.0 * SPARSE["n_exact"] ** 2 + tiles
        needed += _memory._of_tasks(3, n_parameters=3, n_climbs=1, n_factors=1)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed)
        model = MultiTaskGPRegressor(
            rank=1, **SPARSE | {"n_inducing": 10, "max_iter": 1}
        )
        assert model.fit(X, y).inference_ == "sparse"
        monkeypatch.setattr(_memory, "available_memory", lambda: needed - 1.0)
        with pytest.raises(InsufficientMemoryError, match="Sparse inference with"):
            model.fit(X, y)

    def test_too_much_memory_for_a_task_that_joins(self, monkeypatch):
        X, y = draw()
        model = MultiTaskGPRegressor(
            rank=1, **SPARSE | {"n_inducing": 10, "max_iter": 1}
        ).fit(X, y)
        new = np.column_stack([np.linspace(0, 1, 200), np.full(200, 99)])
        new = np.column_stack([new[:, :1]] * (X.shape[1] - 1) + [new[:, 1:]])
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 3 * 200**2)
        match = "add_task with 200 samples, 10 inducing inputs and rank 1 needs about"
        with pytest.raises(InsufficientMemoryError, match=match):
            model.add_task(new, np.zeros(200))

    def test_proposed_where_exact_inference_does_not_fit(self, monkeypatch):
        X, y = draw()
        needed = 8.0 * len(y) ** 2 + TileMemory(RBF(), X[:1]).of_triangle(len(y), 1)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed - 1.0)
        with pytest.raises(InsufficientMemoryError, match="inference='sparse'"):
            MultiTaskGPRegressor(rank=1).fit(X, y)
        model = MultiTaskGPRegressor(
            rank=1, **SPARSE | {"n_inducing": 10, "max_iter": 1}
        )
        assert model.fit(X, y).inference_ == "sparse"

    @pytest.mark.parametrize(
        ("position", "choice", "binary"),
        [
            (0, "greedy", False),
            (-1, "greedy", False),
            (-1, "k-means", False),
            (-1, "greedy", True),
        ],
    )
    def test_a_file_is_read_in_blocks(
        self, tmp_path, monkeypatch, position, choice, binary
    ):
        """Also where the tasks' numbers and the first feature might be complete."""
        for choose in (inducing.greedy_variance, inducing.k_means):
            monkeypatch.setitem(choose.__kwdefaults__, "n_candidates", 300)
        n, d = 100_000, 12
        rng = np.random.default_rng(0)
        X = np.lib.format.open_memmap(tmp_path / "X.npy", "w+", np.float64, (n, d + 1))
        X[:] = rng.standard_normal(X.shape)
        X[:, position] = np.arange(n) % 4 if binary else rng.integers(0, M, n)
        X[:, 0] = rng.integers(0, 2, n) if binary else X[:, 0]
        y = np.sin(X[:, 1]) * (1.0 + X[:, position])
        X = np.load(tmp_path / "X.npy", mmap_mode="r")
        model = MultiTaskGPRegressor(
            RBF(np.full(d, 3.0)),
            rank=1,
            task_feature=position,
            inference="sparse",
            n_inducing=5,
            n_exact=60,
            inducing_inputs=choice,
            max_iter=0,
        )
        small = clone(model).fit(X[:200], y[:200])  # libraries are loaded
        assert small.inference_ == "sparse"
        tracemalloc.start()
        model.fit(X, y)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert np.shares_memory(model.X_train_, X)
        assert peak < (0.9 if binary else 0.75) * X.nbytes
        in_memory = clone(model).fit(np.array(X), y)
        assert not np.shares_memory(in_memory.X_train_, X)
        assert_allclose(
            model.log_marginal_likelihood_value_,
            in_memory.log_marginal_likelihood_value_,
            rtol=1e-12,
        )


def test_the_rows_are_pickled_once(tmp_path):
    n, d = 5000, 12
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.standard_normal((n, d)), rng.integers(0, M, n)])
    y = np.column_stack([np.sin(X[:, 0]), np.cos(X[:, 1])])
    np.save(tmp_path / "X.npy", X)
    model = MultiTaskGPRegressor(
        RBF(np.full(d, 3.0)), rank=1, **SPARSE | {"n_inducing": 5, "max_iter": 0}
    )
    for of in (X, np.load(tmp_path / "X.npy", mmap_mode="r")):
        model.fit(of, y[:, 0])
        assert model.X_train_ is model._likelihoods[0].X
        assert len(pickle.dumps(model)) < 1.3 * X.nbytes
    model.fit(X, y)
    assert len(pickle.dumps(model)) < 1.5 * X.nbytes  # a target has two columns
    assert_allclose(
        pickle.loads(pickle.dumps(model)).loo_predict(), model.loo_predict()
    )


def test_textbook_bound():
    """The estimator's value is Titsias' (2009) eq. 9, in units of y."""
    X, y = draw(40)
    model = MultiTaskGPRegressor(rank=2, kernel=RBF(1.0), normalize_y=False, **SPARSE)
    model.fit(X, y)
    Z, tasks, features = model.inducing_inputs_, model.tasks_train_, model.X_train_
    kernel, K_rho = model.kernel_, model.task_covariance_[np.ix_(tasks, tasks)]
    Q = kernel(features, Z) @ np.linalg.solve(kernel(Z), kernel(Z, features)) * K_rho
    noise = model.noise_variance_
    value = textbook.log_marginal_likelihood(Q + noise * np.eye(len(y)), y)
    value -= 0.5 * np.trace(kernel(features) * K_rho - Q) / noise
    assert_allclose(model.log_marginal_likelihood_value_, value, rtol=1e-7)


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.3])
def test_the_climb_begins_with_no_more_noise_than_it_must(noise):
    X, y = noisy()
    y = np.sin(X[:, 0]) + noise * np.random.default_rng(1).standard_normal(len(y))
    gp = PooledGP(RBF(1.0), normalize_y=False, **SPARSE)
    [(data, settings)] = gp._pairs(gp._read(X, y))
    data = replace(data, Z=greedy_variance(RBF(1.0), data.X, 20))
    few = Mode(np.log([1.0, 1e-10]), 0.0, 0, 0, True, False, 0.0, 60)
    begun = summarised.begin_at(data, settings, ones(M), few)
    assert begun[0] == few.theta[0]
    value = settings.likelihood(data, ones(M)).value
    held = settings.with_noise(few.theta, ones(M))
    others = np.linspace(few.theta, held, summarised.NOISES)
    assert value(begun) == max(map(value, others))
    assert (begun[1] == held[1]) == (noise > 0.0)


@pytest.mark.parametrize(
    ("gain", "tol", "expected"),
    [(1e-3, 1e-2, 1e-3 * N), (1.0, 1e-2, 10.0), (1e-4, 0.5, 0.5), (1.0, 20.0, 20.0)],
)
def test_gain_under_which_climbs_of_the_bound_end(monkeypatch, gain, tol, expected):
    tols, climb = [], summarised.climb

    def told(data, settings, *arguments):
        tols.append(settings.tol)
        return climb(data, settings, *arguments)

    monkeypatch.setattr(summarised, "GAIN", gain)
    monkeypatch.setattr(summarised, "climb", told)
    PooledGP(**SPARSE | {"tol": tol, "max_iter": 1}).fit(*draw())
    assert_allclose(tols, [expected] * summarised.ROUNDS)


@pytest.mark.parametrize(
    ("noise", "expected"), [(1e-10, 1e-8), (1e-6, 1e-5), (1e-4, 1e-4)]
)
def test_the_second_climb_begins_with_a_little_more_noise(noise, expected):
    gp = PooledGP(RBF(1.0), normalize_y=False, **SPARSE)
    X, y = noisy()
    [(data, settings)] = gp._pairs(gp._read(X, y / np.sqrt(np.mean(y**2))))
    mode = Mode(np.log([1.0, noise]), 0.0, 0, 0, True, False, 0.0, 60, data.X[:5])
    begun = summarised.begin_at(data, settings, ones(M), mode)
    assert_allclose(np.exp(begun), [1.0, expected])


def test_inducing_inputs_follow_the_kernel():
    X, y = draw()
    model = PooledGP(RBF([1.0, 1.0]), **SPARSE).fit(X, y)
    assert {tuple(z) for z in model.inducing_inputs_} <= {tuple(x) for x in X[:, :2]}
    chosen = greedy_variance(model.kernel_, X[:, :2], 20)
    assert len(chosen) == len(model.inducing_inputs_)


def noisy(n=600):
    """What few inducing inputs cannot resolve."""
    rng = np.random.default_rng(0)
    x, tasks = rng.uniform(0.0, 10.0, n), rng.integers(0, M, n)
    y = FACTOR[tasks, 0] * (np.sin(x) + 0.5 * np.sin(4.0 * x))
    return np.column_stack([x, tasks]), y + 0.3 * rng.standard_normal(n)


class TestInducingInputs:
    """The parameter of that name."""

    @pytest.mark.parametrize("choice", ["greedy", "k-means", "optimised"])
    @pytest.mark.parametrize(
        "cls", [MultiTaskGPRegressor, IndependentGP, PooledGP, SingleTaskGP]
    )
    def test_every_choice(self, cls, choice):
        X, y = noisy(120)
        model = cls(inducing_inputs=choice, **SPARSE | {"max_iter": 2, "n_inducing": 5})
        again = clone(model).fit(X, y)
        assert again.get_params()["inducing_inputs"] == choice
        assert ("inducing_inputs" in repr(model)) == (choice != "greedy")
        model.fit(X, y)
        mean = model.predict(X)
        assert np.isfinite(mean).all()
        assert_array_equal(again.predict(X), mean)
        assert_allclose(pickle.loads(pickle.dumps(model)).predict(X), mean, rtol=0.0)

    def test_greedy(self):
        """As before there was a choice."""
        X, y = draw()
        model = PooledGP(RBF([1.0, 1.0]), **SPARSE)
        assert model.inducing_inputs == "greedy"
        model.set_params(max_iter=0).fit(X, y)
        expected = greedy_variance(model.kernel_, X[:, :2], 20)
        assert_array_equal(model.inducing_inputs_, expected)

    def test_k_means_in_any_units(self):
        X, y = draw()
        model = PooledGP(inducing_inputs="k-means", **SPARSE).set_params(max_iter=0)
        Z, units = model.fit(X, y).inducing_inputs_, [1.0, 1024.0, 1.0]
        assert not {tuple(z) for z in Z} <= {tuple(x) for x in X[:, :2]}
        found = model.fit(X * units, y).inducing_inputs_
        assert_allclose(found, Z * units[:2], rtol=1e-9)

    def test_more_clusters_than_the_kernel_resolves(self):
        """No JitterWarning: those that add nothing are left out."""
        X, y = noisy()
        kernel = RBF(10.0, "fixed")
        model = PooledGP(kernel, inducing_inputs="k-means", **SPARSE)
        model.set_params(n_inducing=200).fit(X, y)
        assert len(model.inducing_inputs_) < 50

    def test_optimised_raises_the_bound(self):
        X, y = noisy()
        greedy = MultiTaskGPRegressor(rank=1, normalize_y=False, **SPARSE)
        greedy.set_params(n_inducing=12, max_iter=100)
        moved = clone(greedy).set_params(inducing_inputs="optimised")
        values = [m.fit(X, y).log_marginal_likelihood_value_ for m in (greedy, moved)]
        assert values[0] + 20.0 < values[1]

    @pytest.mark.parametrize("n_inducing", [3, 12, 40])
    def test_optimised_is_never_below_greedy(self, n_inducing):
        X, y = noisy()
        pairs = PooledGP(RBF(1.0), **SPARSE)
        pairs.set_params(n_inducing=n_inducing, inducing_inputs="optimised")
        [(data, settings)] = pairs._pairs(pairs._read(X, y))
        form, theta = ones(M), np.log([0.7, 0.2])
        mode = Mode(theta, 0.0, 0, 0, True, False, 0.0, 60)
        kernel = RBF(0.7)
        Z = greedy_variance(kernel, X[:, :1], n_inducing)
        bound = settings.likelihood(replace(data, Z=Z), form)
        Z, n_evaluations = summarised.inducing_inputs(data, settings, form, mode)
        assert bound.with_inducing(Z).value(theta) >= bound.value(theta)
        assert n_evaluations > 1
        mode = mode._replace(Z=Z)
        further, _ = summarised.inducing_inputs(data, settings, form, mode)
        values = [bound.with_inducing(some).value(theta) for some in (Z, further)]
        assert values[0] <= values[1]

    def test_evaluations_are_counted(self):
        X, y = noisy()
        greedy = PooledGP(RBF(1.0), **SPARSE | {"max_iter": 1, "n_inducing": 5})
        moved = clone(greedy).set_params(inducing_inputs="optimised")
        counts = [m.fit(X, y).n_evaluations_ for m in (greedy, moved)]
        assert counts[0] < counts[1]

    def test_no_iterations(self):
        X, y = noisy()
        greedy = PooledGP(RBF(1.0), **SPARSE).set_params(max_iter=0).fit(X, y)
        moved = clone(greedy).set_params(inducing_inputs="optimised").fit(X, y)
        assert_array_equal(moved.inducing_inputs_, greedy.inducing_inputs_)

    def test_rank_search(self):
        model = MultiTaskGPRegressor(inducing_inputs="optimised", **SPARSE)
        search = RankSearchIC(model, ranks=(1, 2, 3), keep_estimators=True)
        X, y = draw(300)
        search.fit(X, y)
        values = search.results_["log_marginal_likelihood"]
        assert (np.diff(values) >= 0.0).all()
        found = [m.log_marginal_likelihood_value_ for m in search.estimators_]
        assert_allclose(found, values, rtol=1e-9)
        first, *others = (m.inducing_inputs_ for m in search.estimators_)
        assert not {tuple(z) for z in first} <= {tuple(x) for x in X[:, :2]}
        for other in others:
            assert_array_equal(first, other)

    def test_a_novel_task(self):
        X, y = draw(200)
        known, novel = X[:, 2] < 2, np.flatnonzero(X[:, 2] == 2)[:10]
        model = MultiTaskGPRegressor(inducing_inputs="optimised", **SPARSE)
        model.fit(X[known], y[known])
        extended = model.add_task(X[novel], y[novel])
        assert len(extended.inducing_inputs_) > len(model.inducing_inputs_)

    def test_an_unknown_derivative(self, monkeypatch):
        """It is said before anything is learned."""
        X, y = noisy(60)
        model = PooledGP(ExpSineSquared() * RBF(), inducing_inputs="optimised")
        model.set_params(inference="sparse", n_inducing=5, max_iter=1)
        with monkeypatch.context() as patch:
            patch.setattr(PooledGP, "_learn", pytest.fail)
            match = r"inducing_inputs='optimised' needs .* kernel=ExpSineSquared"
            with pytest.raises(ValueError, match=match):
                model.fit(X, y)
        for other in ({"inducing_inputs": "k-means"}, {"inference": "dense"}):
            clone(model).set_params(**other).fit(X, y)

    @pytest.mark.parametrize("choice", ["optimized", "kmeans", None, 3])
    def test_it_is_checked(self, choice):
        model = PooledGP(inference="sparse", inducing_inputs=choice)
        with pytest.raises(InvalidParameterError) as error:
            model.fit(*draw())
        for name in ("inducing_inputs", "'greedy'", "'k-means'", "'optimised'"):
            assert name in str(error.value)


def test_unfinished():
    with pytest.warns(ConvergenceWarning, match="max_iter=1"):
        MultiTaskGPRegressor(rank=1, **SPARSE | {"max_iter": 1}).fit(*draw())


def test_noise_of_the_kernel_is_refused():
    model = PooledGP(RBF() + WhiteKernel(), inference="sparse")
    with pytest.raises(ValueError, match=r"inference='sparse' needs .* WhiteKernel"):
        model.fit(*draw())


@pytest.mark.parametrize("name", ["n_inducing", "n_exact"])
@pytest.mark.parametrize("value", [0, -3, 2.5, "many"])
def test_numbers_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        PooledGP(inference="sparse", **{name: value}).fit(*draw())


@pytest.mark.parametrize(("n_exact", "least"), [(1, 3), (40, 40), (1100, N)])
def test_rows_that_are_learned_from_exactly(n_exact, least):
    """Of each task its share, rounded up."""
    gp = PooledGP(**SPARSE | {"n_exact": n_exact})
    pairs = gp._pairs(gp._read(*draw()))
    [(part, _)] = summarised.exact_part(pairs, [ones(M)])
    assert least <= len(part.y) <= least + M - 1
    assert_array_equal(np.unique(part.tasks), np.arange(M))
    assert part.Z is None
