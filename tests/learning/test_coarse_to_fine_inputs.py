"""The parameter `inference`: what is chosen, what is refused, and that both agree."""

import itertools

import building
import numpy as np
import pytest
from same_inputs import LABELS, draw
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.learning import problem
from skmtgp.model.task_covariance import low_rank

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


class TestCoarseToFine:
    @pytest.fixture
    def data(self, monkeypatch):
        monkeypatch.setattr(problem, "COARSE", 8)
        monkeypatch.setattr(problem, "REFINEMENT", 2.0)
        X, y = draw(n_inputs=24)
        order = np.argsort(X[:, -1], kind="stable")
        tasks = np.searchsorted(LABELS, X[order, -1])
        return building.data(X[order, :2], tasks, y[order], 3, complete=True)

    def test_levels_are_complete_and_nested(self, data):
        levels = data.levels()
        assert [len(level.y) for level in levels] == [3 * 8, 3 * 13, 3 * 24]
        assert levels[-1] is data
        for few, more in itertools.pairwise(levels):
            assert set(few.y) < set(more.y)
            assert few.complete
            building.kronecker(RBF(), low_rank(3, 1), few.X, few.tasks, few.y)

    def test_levels_do_not_depend_on_the_order_of_the_rows(self, data):
        order = np.lexsort([np.random.default_rng(0).random(72), data.tasks])
        other = building.data(
            data.X[order], data.tasks, data.y[order], 3, complete=True
        )
        assert set(data.levels()[0].y) == set(other.levels()[0].y)

    @pytest.mark.parametrize(
        ("n_inputs", "sizes"), [(599, [599]), (2000, [300, 774, 2000])]
    )
    def test_sizes_are_counted_in_inputs(self, n_inputs, sizes):
        X = np.tile(np.arange(float(n_inputs))[:, None], (4, 1))
        tasks = np.repeat(np.arange(4), n_inputs)
        levels = building.data(X, tasks, X[:, 0], 4, complete=True).levels()
        assert [len(level.y) for level in levels] == [4 * size for size in sizes]

    @pytest.mark.usefixtures("data")
    def test_fit(self):
        X, y = draw(n_inputs=24)
        model = MultiTaskGPRegressor(rank=2).fit(X, y)
        assert model.inference_ == "kronecker"
        assert model.score(X, y) > 0.98
