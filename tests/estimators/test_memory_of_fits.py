"""What does not fit in memory is refused before anything is learned."""

import math

import joblib
import numpy as np
import pytest
from hard_data import X, Y, columns, each_gp
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import online
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import kernels_of, pose
from skmtgp._estimators.reading import read
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import InsufficientMemoryError
from skmtgp.inference import memory as _of_inference
from skmtgp.inference.memory import TileMemory

pytestmark = pytest.mark.usefixtures("nothing_is_printed")


class TestMemory:
    N = 200_000

    @pytest.fixture(autouse=True)
    def nothing_between_tasks(self, monkeypatch):
        monkeypatch.setattr(_of_inference, "OF_CLIMB", 0)
        monkeypatch.setattr(_of_inference, "OF_POSTERIOR", 0)

    @pytest.fixture
    def large(self):
        rng = np.random.default_rng(0)
        return columns(rng.normal(size=self.N), np.zeros(self.N)), np.arange(self.N)

    @pytest.fixture
    def sixteen_gib(self, monkeypatch):
        monkeypatch.setattr(_memory, "available_memory", lambda: 16 * 2.0**30)

    @each_gp
    def test_that_cannot_suffice(self, model, large, sixteen_gib):
        # 1.5 matrices with a kernel of one term, 2 with that of two
        match = (
            r"Exact inference with 200000 samples needs about (447|597|596) GiB of "
            "memory, but 16 GiB are available. Set inference='sparse', .* or a Bayes"
        )
        model = clone(model)
        with pytest.raises(InsufficientMemoryError, match=match) as caught:
            model.fit(*large)
        proposed = "a SingleTaskGP" in str(caught.value)
        assert proposed != isinstance(model, SingleTaskGP)
        with pytest.raises(NotFittedError):
            model.predict(large[0][:1])

    def test_of_many_outputs(self, monkeypatch):
        """The factor of each is kept: 12 of 24 x 24 doubles."""
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 24**2 * 11.0)
        PooledGP(max_iter=0).fit(X, np.column_stack([Y] * 3))
        with pytest.raises(MemoryError):
            PooledGP(max_iter=0).fit(X, np.column_stack([Y] * 12))

    def test_of_many_ranks(self, monkeypatch):
        """The factor of each is kept where the estimators are."""
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 24**2 * 10.0)
        estimator, many = MultiTaskGPRegressor(max_iter=0), np.column_stack([Y] * 6)
        search = RankSearchIC(estimator, ranks=(1, 2))
        search.fit(X, many)
        with pytest.raises(MemoryError):
            search.set_params(keep_estimators=True).fit(X, many)

    def test_that_suffices_for_single_tasks(self, monkeypatch):
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 24**2 * 2.0)
        SingleTaskGP(max_iter=0).fit(X, Y)
        with pytest.raises(MemoryError):
            PooledGP(max_iter=0).fit(X, Y)

    @pytest.mark.parametrize("inference", ["auto", "sparse"])
    def test_of_single_tasks_at_the_same_time(self, monkeypatch, inference):
        """Of 8 samples each: 3 tasks take three times what one takes."""
        one, more = (11, 33) if inference == "auto" else (14 + 10, 38 + 30)
        model = SingleTaskGP(max_iter=0, inference=inference, n_jobs=3)
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0**3 * (more - 1))
        match = r"3 times at once by n_jobs, .* n_jobs"
        with pytest.raises(InsufficientMemoryError, match=match):
            model.fit(X, Y)
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0**3 * one)
        model.set_params(n_jobs=1).fit(X, Y)

    def test_is_no_matter_for_linear_regression(self, large, sixteen_gib):
        assert BayesianLinearRegression().fit(*large).coef_.shape == (1, 1)

    def test_of_this_machine(self):
        assert 2.0**20 < _memory.available_memory() < 2.0**50

    def test_of_climbs_at_the_same_time(self, monkeypatch):
        """Each has its matrices: those of outputs, and of ranks, with n_jobs."""
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 24**2 * 25.0)
        many, model = np.column_stack([Y] * 3), MultiTaskGPRegressor(max_iter=0)
        of_two = model.set_params(rank=1, n_jobs=2)
        assert pose(of_two, decide(of_two, read(of_two, X, many)))
        match = "24 samples, 3 times at once by n_jobs, needs"
        for fit in (
            lambda: PooledGP(max_iter=0, n_jobs=3).fit(X, many),
            lambda: RankSearchIC(model, ranks=(1, 2), n_jobs=3).fit(X, many),
            lambda: model.set_params(learning="staged", n_jobs=3).fit(X, many[:, :2]),
        ):
            with pytest.raises(InsufficientMemoryError, match=match):
                fit()
        with joblib.parallel_config(backend="sequential"):
            assert pose(model, decide(model, read(model, X, many)))

    def test_of_sparse_inference(self, monkeypatch):
        """Six for each climb and one for each output, of M + r^2 matrices."""
        options = {"inference": "sparse", "n_inducing": 10, "n_exact": 4}
        model = PooledGP(n_jobs=2, max_iter=0, **options)
        n_tasks = len(np.unique(X[:, -1]))
        training = decide(model, read(model, X, np.column_stack([Y, Y])))
        tiles = TileMemory(*kernels_of(model, training), training.features[:1])
        needed = 8.0 * 10**2 * (6 * 2 + 2) * (n_tasks + 1) + tiles.of_blocks(10, 24, 2)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed)
        assert pose(model, training)
        monkeypatch.setattr(_memory, "available_memory", lambda: needed - 1.0)
        with pytest.raises(InsufficientMemoryError, match="rank 1, 2 times at once"):
            pose(model, training)

    def test_of_a_task_that_joins(self, monkeypatch):
        options = {"inference": "sparse", "n_inducing": 10, "max_iter": 0}
        model = MultiTaskGPRegressor(rank=1, **options).fit(X, Y)
        new = X[:3].copy()
        new[:, -1] = 77
        monkeypatch.setattr(_memory, "available_memory", lambda: 1e4)
        model.add_task(new, Y[:3])  # of a few rows it is not looked for
        monkeypatch.setattr(online, "AT_ONCE", 25)  # one more than there are
        with pytest.raises(InsufficientMemoryError, match=r"n_inducing=13, .* rank 1"):
            model.add_task(new, Y[:3])

    @pytest.fixture
    def groups(self, tmp_path, monkeypatch):
        """No control groups, and 1 GB of the machine; files are written to it."""
        monkeypatch.setattr(_memory, "CGROUP", tmp_path / "cgroup")
        monkeypatch.setattr(_memory, "PROC", tmp_path)

        def write(files):
            for name, text in files.items():
                path = tmp_path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)

        write({"meminfo": "MemFree: 1 kB\nMemAvailable: 1000000 kB\n"})
        return write

    @pytest.mark.parametrize(
        ("files", "expected"),
        [
            ({}, 1_024_000_000),
            ({"memory.max": "max\n", "memory.current": "5\n"}, 1_024_000_000),
            ({"memory.max": "900\n"}, 1_024_000_000),
            ({"memory.max": "900\n", "memory.current": "500\n"}, 400),
            ({"memory.max": "900\n", "memory.current": "950\n"}, 0),
            (
                {
                    "memory.max": "900\n",
                    "memory.current": "500\n",
                    "memory.stat": "anon 200\ninactive_file 300\n",
                },
                700,
            ),
            (
                {
                    "memory/memory.limit_in_bytes": "900\n",
                    "memory/memory.usage_in_bytes": "500\n",
                    "memory/memory.stat": "inactive_file 1\ntotal_inactive_file 50\n",
                },
                450,
            ),
            (
                {
                    "memory/memory.limit_in_bytes": "9223372036854771712\n",
                    "memory/memory.usage_in_bytes": "500\n",
                },
                1_024_000_000,
            ),
        ],
    )
    def test_of_a_container(self, groups, files, expected):
        groups({f"cgroup/{name}": text for name, text in files.items()})
        assert _memory.available_memory() == expected

    @pytest.mark.parametrize(
        ("line", "folder"),
        [("0::/job/step", ""), ("4:memory:/job/step", "memory/")],
    )
    def test_of_a_job(self, groups, line, folder):
        """In a group of its own; a limit of those above it counts too."""
        names = _memory.CONTROLS[1 if folder else 0]
        groups({"self/cgroup": f"8:pids:/other\n{line}\n"})
        for group, limit in [("job/step", 900), ("job", 800)]:
            groups({f"cgroup/{folder}{group}/{names[0]}": str(limit)})
            groups({f"cgroup/{folder}{group}/{names[1]}": "100"})
            assert _memory.available_memory() == limit - 100

    @pytest.mark.parametrize("text", ["", "MemFree: 1 kB", "MemAvailable: much"])
    def test_where_the_system_does_not_tell(self, monkeypatch, text):
        monkeypatch.setattr(_memory.Path, "read_text", lambda self: text)
        assert 2.0**20 < _memory.available_memory() < 2.0**50
        monkeypatch.delattr(_memory.os, "sysconf")
        assert _memory.available_memory() == math.inf
