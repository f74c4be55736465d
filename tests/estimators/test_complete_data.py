"""Estimators of complete data: the Kronecker product tells what K does."""

import pickle

import numpy as np
import pytest
from pairs import in_pairs
from same_inputs import LABELS, NEW, TARGETS, draw
from samples import log_densities, posteriors
from sklearn.base import clone

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.kernels import inverse_dynamics_kernel

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning"),
]


def close(found, expected, digits=8):
    for a, b in zip(found, expected, strict=True):
        atol = 10.0**-digits * np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=10.0**-digits, atol=atol)


def told(model, Z):
    """All that a model says of itself and of Z."""
    likelihood = model.log_marginal_likelihood(model.theta_ + 0.01, eval_gradient=True)
    return [
        *model.predict(Z, return_std=True),
        *model.predict(Z, return_cov=True),
        *model.loo_predict(),
        *likelihood,
        model.log_marginal_likelihood(model.theta_ + 0.01),
        model.log_marginal_likelihood_value_,
        model.log_marginal_likelihoods_,
        model.theta_,
        model.task_covariance_,
        model.task_factor_,
        model.noise_variance_,
        model.n_hyperparameters_,
    ]


STAGED = {"learning": "staged"}  # from one start: quicker
MODELS = {
    "full rank": (MultiTaskGPRegressor, STAGED, None),
    "rank 2, two outputs": (MultiTaskGPRegressor, {"rank": 2, **STAGED}, 2),
    "noise of each": (MultiTaskGPRegressor, {"rank": 1, "noise": "per_task"}, None),
    "diagonal": (MultiTaskGPRegressor, {"rank": 1, "diagonal": True, **STAGED}, 2),
    "iGP": (IndependentGP, {"noise": "per_task"}, None),
    "pGP": (PooledGP, {"diagonal": True}, None),
}
QUICKEST = ["full rank", "diagonal", "pGP"]  # to learn
LEARNED = [name for name, of in MODELS.items() if of[0] is MultiTaskGPRegressor]
every_model = pytest.mark.parametrize(
    ("estimator", "params", "n_outputs"), MODELS.values(), ids=MODELS
)
some_models = pytest.mark.parametrize(
    ("estimator", "params", "n_outputs"),
    [
        pytest.param(*of, id=name, marks=[pytest.mark.long] * (name not in QUICKEST))
        for name, of in MODELS.items()
    ],
)


@every_model
def test_both_tell_the_same(estimator, params, n_outputs):
    (X, y), Z = draw(n_outputs=n_outputs), draw(4, seed=1)[0]
    model, dense = (
        estimator(inference=i, max_iter=0, **params).fit(X, y)
        for i in ("kronecker", "dense")
    )
    close(told(model, Z), told(dense, Z))
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    assert vars(model).keys() == vars(dense).keys()


@some_models
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.AmbiguousFitWarning")  # 30 rows
def test_both_learn_the_same(estimator, params, n_outputs):
    (X, y), Z = draw(n_outputs=n_outputs), draw(4, seed=1)[0]
    model, dense = (
        estimator(inference=i, tol=1e-9, **params).fit(X, y)
        for i in ("kronecker", "dense")
    )
    values = [m.log_marginal_likelihood_value_ for m in (model, dense)]
    np.testing.assert_allclose(*values, rtol=1e-6)
    scale = y.std()
    found, expected = model.predict(Z), dense.predict(Z)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3 * scale)


@pytest.mark.usefixtures("certain_theta")
def test_attributes_reproduce_likelihood_and_predictions():
    (X, y), Z = draw(n_outputs=2), draw(4, seed=1)[0]
    model = MultiTaskGPRegressor(rank=2, noise="per_task", max_iter=20).fit(X, y)
    encode = lambda X: np.c_[X[:, :2], np.searchsorted(LABELS, X[:, 2])]  # noqa: E731
    expected = log_densities(model, encode(X), y)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-8)
    mean, std = model.predict(Z, return_std=True)
    for j, (f, K) in enumerate(posteriors(model, encode(X), y, encode(Z))):
        np.testing.assert_allclose(mean[:, j], f, rtol=1e-7)
        np.testing.assert_allclose(std[:, j] ** 2, np.diag(K), rtol=1e-6)


@pytest.mark.parametrize("inference", ["auto", "kronecker"])
def test_the_order_of_the_rows_does_not_matter(inference):
    (X, y), Z = draw(), draw(4, seed=1)[0]
    order = np.random.default_rng(0).permutation(len(X))
    one, other = (
        MultiTaskGPRegressor(rank=2, inference=inference, max_iter=0).fit(*data)
        for data in [(X, y), (X[order], y[order])]
    )
    close(one.predict(Z, return_std=True), other.predict(Z, return_std=True))
    for a, b in zip(one.loo_predict(), other.loo_predict(), strict=True):
        np.testing.assert_allclose(a[order], b, rtol=1e-8)


def test_rank_search():
    X, y = draw()
    searches = [
        RankSearchIC(MultiTaskGPRegressor(inference=i, tol=1e-6), ranks=(1, 2, 3)).fit(
            X, y
        )
        for i in ("auto", "dense")
    ]
    used = [search.best_estimator_.inference_ for search in searches]
    assert used == ["kronecker", "dense"]
    found, expected = (search.results_["bic"] for search in searches)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert searches[0].best_rank_ == searches[1].best_rank_


class TestAddTask:
    @pytest.fixture(params=LEARNED)
    def pair(self, request):
        """A model by Kronecker algebra and a dense one, at the starting values."""
        _, params, n_outputs = MODELS[request.param]
        model = MultiTaskGPRegressor(**STAGED | params, max_iter=0)
        return [
            clone(model).set_params(inference=i).fit(*draw(n_outputs=n_outputs))
            for i in ("kronecker", "dense")
        ]

    def targets(self, model, sign=1.0):
        shape = -1, *np.ones_like(model.y_train_.shape[1:])
        return sign * TARGETS.reshape(shape) * np.ones(model.y_train_.shape[1:])

    @in_pairs(
        "pair",
        pair={name: name for name in LEARNED},
        label={"first": -1, "middle": 3, "last": 9},
        prior={"tasks": "tasks", "none": None},
    )
    def test_one_task(self, pair, prior, label):
        new = np.c_[NEW[:, :2], np.full(3, label)]
        found, expected = (
            model.add_task(new, self.targets(model), prior=prior) for model in pair
        )
        assert (found.inference_, expected.inference_) == ("kronecker", "dense")
        assert isinstance(found._likelihoods[0], ExtendedLikelihood)
        Z = np.vstack([draw(2, seed=1)[0], new[:2] + [0.1, 0.0, 0.0]])
        close(told(found, Z), told(expected, Z), digits=7)
        assert vars(found).keys() == vars(expected).keys()
        assert found.complete_ is False

    def test_one_after_another(self, pair):
        found, expected = (
            model.add_task(NEW, self.targets(model))
            .add_task(NEW[:2] - [0.0, 0.1, 4.0], self.targets(model, -1.0)[:2])
            .add_task(NEW[1:] + [0.0, 0.1, 1.0], self.targets(model)[1:])
            for model in pair
        )
        assert found.tasks_.tolist() == [-1, 0, 2, 3, 4, 5]
        assert found.inference_ == "kronecker"
        Z = np.vstack([draw(2, seed=1)[0], NEW + [0.1, 0.0, 1.0]])
        close(told(found, Z), told(expected, Z), digits=6)

    def test_learned(self, pair):
        found, expected = (
            model.set_params(max_iter=500, tol=1e-10)
            .add_task(NEW, self.targets(model))
            .predict(NEW, return_std=True)
            for model in pair
        )
        close(found, expected, digits=3)

    def test_complete_again(self, pair):
        (model, dense), X = pair, draw()[0]
        new = X[X[:, -1] == 2] + [0.0, 0.0, 5.0]
        y = model.y_train_[X[:, -1] == 2]
        found, expected = model.add_task(new, y), dense.add_task(new, y)
        assert found.complete_ is True
        assert isinstance(found._likelihoods[0], KroneckerLikelihood)
        Z = draw(2, seed=1)[0]
        close(told(found, Z), told(expected, Z), digits=7)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_data_without_noise(seed):
    """Eigenvalues that are rounding would make the likelihood too rough to climb.

    There are three rows for each hyperparameter, to tell that there is no noise.
    """
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((20, 4))
    X = np.column_stack([np.tile(x, (3, 1)), np.repeat([0, 1, 2], 20)])
    y = np.concatenate([np.sin(x).sum(axis=1) + m * x[:, 0] for m in range(3)])
    model, dense = (
        MultiTaskGPRegressor(inverse_dynamics_kernel(1), rank=2, inference=i).fit(X, y)
        for i in ("kronecker", "dense")
    )
    assert model.n_evaluations_ < 3 * dense.n_evaluations_
    values = [each.log_marginal_likelihood_value_ for each in (model, dense)]
    assert values[0] > values[1] - 5.0
    assert model.score(X, y) > 1.0 - 1e-9
