"""The fitted model, its predictions, and the course of fit."""

from functools import partial

import numpy as np
import pytest
from multitask_models import PAPER, QUICK, SHARED
from samples import draw, log_densities
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    multitask,
)
from skmtgp._estimators import base, posing
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning import paper, ranks
from skmtgp.learning.paper import learn_simultaneously, learn_staged
from skmtgp.learning.problem import Problem
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.tuning import Tuning

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(params=[None, 2], ids=["one output", "two outputs"])
def data(request):
    return draw(n_outputs=request.param)


@pytest.fixture(scope="module")
def fitted():
    """A model that tests share and leave alone."""
    with pytest.warns(ConvergenceWarning):
        return MultiTaskGPRegressor(rank=2, **PAPER, **QUICK).fit(*draw())


LEARNERS = {
    "annealed": learn_ranks,
    "staged": learn_staged,
    "simultaneous": learn_simultaneously,
}


class TestLearning:
    @pytest.mark.parametrize("learning", LEARNERS)
    @pytest.mark.parametrize("truncation", ["eigen", "cholesky"])
    def test_learner_and_truncation_are_those_asked_for(
        self, data, monkeypatch, learning, truncation
    ):
        called = []

        def spying(name):
            def spy(problems, forms, **options):
                asked = [problem.budget.truncation for problem in problems]
                called.append((name, asked))
                return LEARNERS[name](problems, forms, **options)

            return spy

        for name, learner in LEARNERS.items():
            monkeypatch.setattr(multitask, learner.__name__, spying(name))
        options = {"learning": learning, "truncation": truncation, "rank": 3, **QUICK}
        MultiTaskGPRegressor(**options, **PAPER).fit(*data)
        assert called == [(learning, [truncation] * (data[1].size // len(data[1])))]

    def test_default(self, fitted):
        model = MultiTaskGPRegressor(
            rank=2, learning="annealed", truncation="eigen", **PAPER, **QUICK
        )
        np.testing.assert_array_equal(model.fit(*draw()).theta_, fitted.theta_)

    @pytest.mark.parametrize("learning", ["annealed", "staged"])
    def test_truncation_changes_where_learning_begins(self, learning):
        eigen, cholesky = (
            MultiTaskGPRegressor(rank=1, learning=learning, truncation=how, max_iter=0)
            .fit(*draw())
            .task_covariance_
            for how in ("eigen", "cholesky")
        )
        assert not np.allclose(eigen, cholesky)

    @pytest.mark.parametrize("learning", LEARNERS)
    @pytest.mark.parametrize(
        "params",
        [PAPER, PAPER | {"rank": 2, "diagonal": True}, SHARED | {"rank": 2}],
        ids=["full rank", "diagonal", "levels"],
    )
    def test_attributes_reproduce_the_likelihood(self, data, learning, params):
        model = MultiTaskGPRegressor(learning=learning, **params, **QUICK).fit(*data)
        expected = log_densities(model, *data)
        np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-9)

    @pytest.mark.parametrize("learning", LEARNERS)
    def test_random_state_determines_the_mode(self, learning):
        model = MultiTaskGPRegressor(rank=2, learning=learning, **SHARED, **QUICK)
        one, same, other = (
            clone(model).set_params(random_state=seed).fit(*draw()).theta_
            for seed in (0, 0, 1)
        )
        np.testing.assert_array_equal(one, same)
        assert np.array_equal(one, other) == (learning != "simultaneous")

    @pytest.mark.parametrize("learning", ["staged", "simultaneous"])
    def test_more_starts_never_hurt(self, learning):
        spent, values = [], []
        for n in (0, 1, 3):
            model = MultiTaskGPRegressor(
                rank=2,
                learning=learning,
                n_restarts_optimizer=n,
                random_state=0,
                **SHARED,
                **QUICK,
            ).fit(*draw())
            spent.append(model.n_evaluations_)
            values.append(model.log_marginal_likelihood_value_)
        assert (np.diff(spent) > 0).all()
        assert (np.diff(values) >= 0.0).all()

    def test_all_find_the_mode_where_there_is_but_one(self):
        values = [
            MultiTaskGPRegressor(rank=2, learning=learning, random_state=0, **PAPER)
            .fit(*draw(per_task=20))
            .log_marginal_likelihood_value_
            for learning in LEARNERS
        ]
        np.testing.assert_allclose(values, max(values), atol=0.05)

    def test_search_learns_as_its_estimator_does(self):
        for learning in LEARNERS:
            model = MultiTaskGPRegressor(
                learning=learning,
                truncation="cholesky",
                random_state=0,
                **SHARED,
                **QUICK,
            )
            best = RankSearchIC(model, ranks=[2]).fit(*draw()).best_estimator_
            alone = clone(model).set_params(rank=2).fit(*draw())
            np.testing.assert_array_equal(best.theta_, alone.theta_)
            assert (best.learning, best.truncation) == (learning, "cholesky")

    @pytest.mark.parametrize("name", ["learning", "truncation"])
    def test_bad_value(self, name):
        model = MultiTaskGPRegressor(**{name: "bad"})
        with pytest.raises(ValueError, match=rf"'{name}' .* must be a str among"):
            model.fit(*draw())


PER_TASK = PAPER | {"noise": "per_task"}
STAGED = {"learning": "staged", "rank": 2}


class TestEvaluations:
    """n_evaluations_ is what fit spent: likelihoods with their gradients."""

    @pytest.fixture
    def count(self, monkeypatch):
        calls, plain = [], DenseLikelihood.value_and_grad
        # what is asked after learning does not count
        monkeypatch.setattr(base, "warn_of_doubts", lambda *_, **__: None)

        def counting(self, theta):
            calls.append(len(self.y))
            return plain(self, theta)

        monkeypatch.setattr(DenseLikelihood, "value_and_grad", counting)
        return calls

    @pytest.fixture(params=[False, True], ids=["all rows", "coarse to fine"])
    def levels(self, request, monkeypatch):
        if request.param:
            tuning = Tuning(coarse=12, coarse_per_task=4, refinement=2.0)
            monkeypatch.setattr(posing, "Problem", partial(Problem, tuning=tuning))
        return request.param

    @pytest.mark.parametrize(
        "model",
        [
            MultiTaskGPRegressor(**PAPER),
            MultiTaskGPRegressor(**SHARED),
            MultiTaskGPRegressor(**PER_TASK, diagonal=True, rank=1),
            MultiTaskGPRegressor(**PAPER, n_restarts_optimizer=2, random_state=0),
            MultiTaskGPRegressor(**PAPER, **STAGED),
            MultiTaskGPRegressor(**PAPER, **STAGED, n_restarts_optimizer=2),
            MultiTaskGPRegressor(
                **PAPER, learning="simultaneous", n_restarts_optimizer=1
            ),
            IndependentGP(**SHARED),
            PooledGP(noise="shared", diagonal=True),
            SingleTaskGP(),
        ],
        ids=repr,
    )
    def test_of_a_model(self, model, count, levels):
        data = draw(n_outputs=None if levels else 2)
        model = clone(model).set_params(max_iter=3).fit(*data)
        assert model.n_evaluations_ == len(count) > 5
        whole = getattr(model, "learning", "") in ("staged", "simultaneous")
        if not isinstance(model, SingleTaskGP):  # ten rows are too few for levels
            assert (len(set(count)) > 1) == (levels and not whole)

    @pytest.mark.usefixtures("levels")
    @pytest.mark.parametrize("learning", LEARNERS)
    def test_of_a_search(self, data, count, monkeypatch, learning):
        """What the ranks share is counted for each."""
        shared = []

        def counted(plain):
            def shares(*args, **options):
                before = len(count)
                starts = plain(*args, **options)
                shared.append(len(count) - before)
                return starts

            return shares

        make_starts = counted(ranks.make_starts)
        for module in (ranks, paper):
            monkeypatch.setattr(module, "make_starts", make_starts)
        options = {"learning": learning, "random_state": 0, "max_iter": 3}
        model = MultiTaskGPRegressor(**options, **SHARED)
        search = RankSearchIC(model, ranks=(1, 2, 3), keep_estimators=True).fit(*data)
        total = sum(model.n_evaluations_ for model in search.estimators_)
        assert total - 2 * sum(shared) == len(count)
        assert search.best_estimator_.n_evaluations_ < len(count)

    @pytest.mark.parametrize("learning", LEARNERS)
    def test_of_a_single_rank(self, data, count, learning):
        options = {"learning": learning, "random_state": 0, "max_iter": 3}
        model = MultiTaskGPRegressor(**options, **SHARED)
        search = RankSearchIC(model, ranks=[2]).fit(*data)
        assert search.best_estimator_.n_evaluations_ == len(count)
