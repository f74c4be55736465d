"""Learning from a few of the inputs, from more, from all, where data are complete."""

import itertools
from functools import partial

import building
import numpy as np
import pytest
from same_inputs import LABELS, draw
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp._estimators import posing
from skmtgp.learning.problem import Problem
from skmtgp.learning.tuning import Tuning
from skmtgp.model.task_covariance import low_rank

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning"),
]


SMALL = {"coarse": 8, "refinement": 2.0}


def pose(data, **changes):
    return building.problem(RBF(), low_rank(data.n_tasks, 1), data, **changes)


class TestCoarseToFine:
    @pytest.fixture
    def data(self):
        X, y = draw(n_inputs=24)
        order = np.argsort(X[:, -1], kind="stable")
        tasks = np.searchsorted(LABELS, X[order, -1])
        return building.data(X[order, :2], tasks, y[order], 3, complete=True)

    def test_problems_are_complete_and_nested(self, data):
        problem = pose(data, **SMALL)
        problems = problem.coarse_to_fine()
        assert [len(each.data) for each in problems] == [3 * 8, 3 * 13, 3 * 24]
        assert problems[-1] is problem
        for few, more in itertools.pairwise(each.data for each in problems):
            assert set(few.y) < set(more.y)
            assert (few.X[few.design] == few.X[few.design[:, :1]]).all()
            assert (few.tasks[few.design] == np.arange(3)).all()
            np.testing.assert_array_equal(
                np.sort(few.design, axis=None), range(len(few))
            )
            building.kronecker(RBF(), low_rank(3, 1), few.X, few.tasks, few.y)

    def test_problems_do_not_depend_on_the_order_of_the_rows(self, data):
        order = np.lexsort([np.random.default_rng(0).random(72), data.tasks])
        other = building.data(
            data.X[order], data.tasks, data.y[order], 3, complete=True
        )
        coarse, same = (
            pose(each, **SMALL).coarse_to_fine()[0] for each in (data, other)
        )
        assert set(coarse.data.y) == set(same.data.y)

    @pytest.mark.parametrize(
        ("n_inputs", "sizes"), [(599, [599]), (2000, [300, 774, 2000])]
    )
    def test_sizes_are_counted_in_inputs(self, n_inputs, sizes):
        X = np.tile(np.arange(float(n_inputs))[:, None], (4, 1))
        tasks = np.repeat(np.arange(4), n_inputs)
        problem = pose(building.data(X, tasks, X[:, 0], 4, complete=True))
        found = [len(each.data) for each in problem.coarse_to_fine()]
        assert found == [4 * size for size in sizes]

    def test_fit(self, monkeypatch):
        monkeypatch.setattr(posing, "Problem", partial(Problem, tuning=Tuning(**SMALL)))
        X, y = draw(n_inputs=24)
        model = MultiTaskGPRegressor(rank=2).fit(X, y)
        assert model.inference_ == "kronecker"
        assert model.score(X, y) > 0.98
