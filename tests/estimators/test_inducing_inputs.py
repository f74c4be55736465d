"""The choices of inducing inputs behind the estimators."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn import clone
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared
from sklearn.utils._param_validation import InvalidParameterError
from sparse_models import SPARSE, M, draw, noisy

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import read
from skmtgp.exceptions import ConstantTargetWarning
from skmtgp.inference.inducing import greedy_variance
from skmtgp.learning import summarised
from skmtgp.learning.penalised import SomeNoise
from skmtgp.learning.problem import Mode
from skmtgp.model.task_covariance import ones

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def test_inducing_inputs_follow_the_kernel():
    X, y = draw()
    model = PooledGP(RBF([1.0, 1.0]), **SPARSE).fit(X, y)
    assert {tuple(z) for z in model.inducing_inputs_} <= {tuple(x) for x in X[:, :2]}
    chosen = greedy_variance(model.kernel_, X[:, :2], 20)
    assert len(chosen) == len(model.inducing_inputs_)


class TestInducingInputs:
    """The parameter of that name."""

    @pytest.mark.parametrize(
        ("cls", "choice"),
        [
            (MultiTaskGPRegressor, "greedy"),
            (MultiTaskGPRegressor, "optimised"),
            (IndependentGP, "k-means"),
            (PooledGP, "optimised"),
            (SingleTaskGP, "greedy"),
            (SingleTaskGP, "k-means"),
        ],
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
        gp = PooledGP(RBF(1.0), noise="shared", **SPARSE)
        gp.set_params(n_inducing=n_inducing, inducing_inputs="optimised")
        [problem] = pose(gp, decide(gp, read(gp, X, y)))
        problem, theta = problem.with_form(ones(M)), np.log([0.7, 0.2])
        mode = Mode(theta, 0.0, 0, 0, True, False, 0.0, 60)
        kernel = RBF(0.7)
        Z = greedy_variance(kernel, X[:, :1], n_inducing)
        bound = problem.with_data(replace(problem.data, Z=Z)).likelihood()
        Z, n_evaluations = summarised.inducing_inputs(problem, mode)
        assert bound.with_inducing(Z).value(theta) >= bound.value(theta)
        assert n_evaluations > 1
        mode = mode._replace(Z=Z)
        further, _ = summarised.inducing_inputs(problem, mode)
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
        found = [m.log_marginal_likelihood_value_ for m in search.estimators_]
        assert_allclose(found, values, rtol=1e-9)
        model.set_params(rank=1)
        [problem] = pose(model, decide(model, read(model, X, y, (None,) * 3)))
        of_noise = [
            SomeNoise(m._likelihoods[0].prior, problem.log_little).log_density(m.theta_)
            for m in search.estimators_
        ]
        of_noise, _ = zip(*of_noise, strict=True)
        assert (np.diff(values + np.array(of_noise)) >= 0.0).all()
        first, *others = (m.inducing_inputs_ for m in search.estimators_)
        assert not {tuple(z) for z in first} <= {tuple(x) for x in X[:, :2]}
        for other in others:
            assert_array_equal(first, other)

    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
    def test_constant_targets_with_weak_priors(self):
        """Nothing is learned of them, nor where inducing inputs are."""
        X, y = draw(60)[0], np.full(60, 2.0)
        model = MultiTaskGPRegressor(hyperparameters="map", **SPARSE)
        model.set_params(inducing_inputs="optimised")
        with pytest.warns(ConstantTargetWarning):
            search = RankSearchIC(model, ranks=(1, 2)).fit(X, y)
        assert_allclose(search.predict(X), y, rtol=1e-9)
        assert np.isfinite(search.results_["log_marginal_likelihood"]).all()

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
