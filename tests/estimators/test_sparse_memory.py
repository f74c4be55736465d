"""Sparse inference: what it takes of memory, and what it refuses to take."""

import pickle
import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn import clone
from sklearn.gaussian_process.kernels import RBF
from sparse_models import SPARSE, M, draw

from skmtgp import MultiTaskGPRegressor
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import InsufficientMemoryError
from skmtgp.inference import inducing
from skmtgp.inference import memory as _of_inference
from skmtgp.inference.engine import Demand
from skmtgp.inference.memory import TileMemory

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


class TestMemory:
    def test_that_cannot_suffice(self, monkeypatch):
        monkeypatch.setattr(_memory, "available_memory", lambda: 1e6)
        match = "Sparse inference with n_inducing=90, 3 tasks and rank 2 needs about"
        model = MultiTaskGPRegressor(rank=2, inference="sparse")
        with pytest.raises(InsufficientMemoryError, match=match):
            model.fit(*draw())

    @pytest.mark.parametrize("rank", [1, None])
    def test_that_cannot_suffice_for_many_tasks(self, monkeypatch, rank):
        """Whatever the inducing inputs; no matrix between tasks is made before."""
        n_tasks = 1000
        X = np.column_stack([np.linspace(0.0, 9.0, 2000), np.arange(2000) % n_tasks])
        y = np.sin(X[:, 0])
        demand = Demand(2000, n_tasks)
        needed = _of_inference._of_tasks(demand, n_climbs=1, n_parameters=n_tasks)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed - 1.0)
        model = MultiTaskGPRegressor(rank=rank, inference="sparse", n_inducing=1)
        match = "with 1000 tasks needs about .* Take fewer tasks, .* a SingleTaskGP"
        with pytest.raises(InsufficientMemoryError, match=match):
            model.fit(X, y)  # libraries are loaded
        tracemalloc.start()
        with pytest.raises(InsufficientMemoryError, match=match):
            model.fit(X, y)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 0.5 * 8.0 * n_tasks**2
        options = {"rank": 1, "inference": "sparse", "n_inducing": 900}
        monkeypatch.setattr(_memory, "available_memory", lambda: needed + 1.0)
        with pytest.raises(InsufficientMemoryError, match="fewer inducing inputs, a"):
            MultiTaskGPRegressor(**options).fit(X, y)

    def test_too_much_memory_of_the_rows_that_are_learned_exactly(self, monkeypatch):
        X, y = draw()
        tiles = TileMemory(RBF(), X[:1]).of_triangle(SPARSE["n_exact"], 1)
        needed = 8.0 * SPARSE["n_exact"] ** 2 + tiles
        demand = Demand(len(y), n_tasks=3)
        needed += _of_inference._of_tasks(demand, n_climbs=1, n_parameters=3)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed)
        model = MultiTaskGPRegressor(
            "rbf", rank=1, **SPARSE | {"n_inducing": 10, "max_iter": 1}
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
            "rbf", rank=1, **SPARSE | {"n_inducing": 10, "max_iter": 1}
        )
        assert model.fit(X, y).inference_ == "sparse"

    @pytest.mark.parametrize(
        ("position", "choice", "binary"),
        [
            (0, "greedy", False),
            pytest.param(-1, "greedy", False, marks=pytest.mark.long),
            pytest.param(-1, "k-means", False, marks=pytest.mark.long),
            pytest.param(-1, "greedy", True, marks=pytest.mark.long),
        ],
    )
    def test_a_file_is_read_in_blocks(
        self, tmp_path, monkeypatch, position, choice, binary
    ):
        """Also where the tasks' numbers and the first feature might be complete."""
        for choose in (inducing.greedy_variance, inducing.k_means):
            monkeypatch.setitem(choose.__kwdefaults__, "n_candidates", 300)
        n, d = 100_000 if binary else 24_000, 12
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
