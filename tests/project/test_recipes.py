"""The recipes of docs/design.md with every engine: all work, or are refused by name."""

import pickle

import building
import numpy as np
import pytest
import recipes
from numpy.testing import assert_allclose
from pairs import in_pairs
from recipes import NODES, Brownian, BrownianNode, Exchangeable, ExchangeableGP
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.learning import climbing
from skmtgp.model.task_covariance import WithDiagonal

M, N = 3, 12
pytestmark = pytest.mark.filterwarnings(  # the budget of the fits is small
    "ignore::sklearn.exceptions.ConvergenceWarning"
)
QUICK = {"max_iter": 3, "n_inducing": 6, "n_exact": 20}
STAGED = {"learning": "staged", **QUICK}  # from one start
ALIKE = QUICK | {"normalize_y": "shared", "noise": "shared"}  # all tasks
KERNELS = {
    "alone": Brownian(),
    "fixed": Brownian(1.0, "fixed"),
    "sum": Brownian() + RBF(),
    "product": RBF() * Brownian(2.0),
}
each_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS.keys())
each_inference = pytest.mark.parametrize("inference", ["dense", "kronecker", "sparse"])


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setitem(NODES, Brownian, BrownianNode)


@pytest.fixture
def no_climbs(monkeypatch):
    def climb(*_, **__):
        raise AssertionError("too late to refuse")

    monkeypatch.setattr(climbing, "minimize", climb)


def draw(n_outputs=None):
    """Complete data, which all engines take."""
    rng = np.random.default_rng(0)
    x, tasks = np.tile(np.linspace(0.2, 3.0, N), M), np.repeat(np.arange(M), N)
    y = np.sin(2.0 * x) * np.array([1.0, 2.0, -1.0])[tasks]
    y = y[:, None] + 0.1 * rng.standard_normal((M * N, n_outputs or 1))
    return np.column_stack([x, tasks]), y if n_outputs else y[:, 0]


def assert_works(model, n_outputs=None):
    X, y = draw(n_outputs)
    model.fit(X, y)
    mean, std = model.predict(X, return_std=True)
    assert np.isfinite([mean, std]).all()
    found, covariance = model.predict(X[:2], return_cov=True)
    assert_allclose(found, mean[:2])
    assert np.isfinite(covariance).all()
    assert np.isfinite(model.loo_predict()).all()
    assert np.isfinite(model.sample_y(X[:2])).all()
    gradient = model.log_marginal_likelihood(model.theta_, eval_gradient=True)[1]
    assert np.isfinite(gradient).all()
    assert_allclose(pickle.loads(pickle.dumps(model)).predict(X), mean)
    return model


def test_the_page_does_what_it_says():
    assert recipes.run_page()[0] == 0


class TestKernel:
    @each_kernel
    @each_inference
    def test_registered_and_not(self, monkeypatch, kernel, inference):
        of = {"kernel": kernel, "inference": inference, "rank": 1, **STAGED}
        plain = assert_works(MultiTaskGPRegressor(**of))
        monkeypatch.setitem(NODES, Brownian, BrownianNode)
        fast = assert_works(MultiTaskGPRegressor(**of))
        if inference != "sparse":  # its inducing inputs depend on the last digits
            value = plain.log_marginal_likelihood_value_
            assert_allclose(fast.log_marginal_likelihood(plain.theta_), value)
        added = fast.add_task([[0.5, 7.0], [1.0, 7.0]], [1.0, 2.0])
        assert np.isfinite(added.predict([[0.7, 7.0]])).all()

    @each_kernel
    @pytest.mark.parametrize(
        "model",
        [MultiTaskGPRegressor(rank=1), IndependentGP(), PooledGP(), SingleTaskGP()],
        ids=lambda model: type(model).__name__,
    )
    def test_no_derivative_by_the_inputs(self, registered, no_climbs, kernel, model):
        model.set_params(kernel=kernel, inference="sparse", **QUICK)
        model.set_params(inducing_inputs="optimised")
        match = r"which is not known of BoundBrownian\. Set inducing_inputs='greedy'"
        with pytest.raises(ValueError, match=match):
            model.fit(*draw())

    # rows of a task are sorted, and the tasks are not one function
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.CorrelatedResidualsWarning")
    def test_clusters_are_inducing_inputs(self, registered):
        options = {"inference": "sparse", "inducing_inputs": "k-means", **QUICK}
        assert_works(PooledGP(Brownian(), **options))

    def test_ranks(self, registered):
        search = RankSearchIC(MultiTaskGPRegressor(Brownian(), **QUICK), ranks=(1, 2))
        assert np.isfinite(search.fit(*draw()).loo_predict()).all()


class ExchangeableTasks(MultiTaskGPRegressor):
    """Learned as a factor is, and with `add_task`."""

    form = Exchangeable

    def _learn(self, problems, progress):
        form = self.form(problems[0].prior.n_tasks)
        form = WithDiagonal(form) if self.diagonal else form
        (modes,) = self._learn_ranks(problems, [form], progress)
        return [problem.with_form(form) for problem in problems], modes


class WithLastHeldUp(Exchangeable):
    """Whose b is held up with the noise."""

    n_kappa = 1


class TestTaskCovariance:
    @in_pairs(
        inference={"dense": "dense", "kronecker": "kronecker"},
        estimator={"GP": ExchangeableGP, "tasks": ExchangeableTasks},
        diagonal={"no diagonal": False, "diagonal": True},
        noise={"one noise": "shared", "noise of each": "per_task"},
    )
    def test_exact(self, inference, estimator, diagonal, noise):
        options = {**ALIKE, "diagonal": diagonal, "noise": noise}
        model = assert_works(estimator(inference=inference, **options))
        K = model.task_covariance_
        assert_allclose(K[0, 1], K[1, 2])
        assert (K[0, 0] == K[1, 1]) == (not diagonal)

    def test_several_outputs(self):
        assert_works(ExchangeableGP(**QUICK), n_outputs=2)

    @pytest.mark.parametrize("estimator", [ExchangeableGP, ExchangeableTasks])
    @pytest.mark.parametrize("diagonal", [False, True])
    def test_sparse_is_refused(self, no_climbs, estimator, diagonal):
        model = estimator(inference="sparse", diagonal=diagonal, **ALIKE)
        match = "but Exchangeable has no latent and no pull_back_latent. Give the class"
        with pytest.raises(ValueError, match=match):
            model.fit(*draw())

    def test_sparse_once_it_is_told(self):
        _, page = recipes.run_page()
        (X, y), form = draw(), page["Exchangeable"](M)
        model = page["ExchangeableGP"](inference="sparse", diagonal=True, **QUICK)
        assert np.isfinite(model.fit(X, y).predict(X)).all()
        tasks = X[:, 1].astype(int)
        bound = building.sparse(RBF(), form, X[:, :1], tasks, y, X[:5, :1])
        theta = np.array([0.1, 0.3, -0.5, -2.0])
        _, gradient = bound.value_and_grad(theta)
        steps = 1e-5 * np.eye(4)
        differences = [bound.value(theta + h) - bound.value(theta - h) for h in steps]
        assert_allclose(gradient, np.divide(differences, 2e-5), rtol=1e-5)

    @pytest.mark.parametrize("diagonal", [False, True])
    def test_a_task_more_is_refused(self, diagonal):
        model = ExchangeableTasks(diagonal=diagonal, **QUICK).fit(*draw())
        match = "but Exchangeable has no columns and no bordered. Fit the model to all"
        with pytest.raises(ValueError, match=match):
            model.add_task([[0.5, 7.0]], [1.0])

    def test_a_diagonal_of_its_own(self):
        class Model(ExchangeableTasks):
            form = WithLastHeldUp

        model = Model(**QUICK).fit(*draw())
        assert model.task_covariance_[0, 1] == model.task_covariance_[1, 2]
