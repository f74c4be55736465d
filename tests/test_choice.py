"""The parameter `inference`: what is chosen, what is refused, and that both agree."""

import itertools
import pickle
import warnings

import building
import numpy as np
import pytest
from samples import log_densities, posteriors
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    WhiteKernel,
)

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import base as _base
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import IncompleteDataWarning, InsufficientMemoryError
from skmtgp.inference.choice import choose, depends_on_inputs_only, extended
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.kernels import Columns, inverse_dynamics_kernel
from skmtgp.learning import problem
from skmtgp.model.task_covariance import low_rank

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
LABELS = np.array([0, 2, 5])


def draw(n_inputs=10, n_outputs=None, seed=0):
    """Complete data of three tasks, in no order."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.0, 2.0, (n_inputs, 2))
    basis = np.column_stack([np.sin(1.5 * x[:, 0]), x[:, 1]])
    y = np.einsum("nb,jmb->mnj", basis, rng.normal(size=(n_outputs or 1, 3, 2)))
    y = 5.0 + 20.0 * (y + 0.1 * rng.standard_normal(y.shape)).reshape(-1, y.shape[2])
    X = np.column_stack([np.tile(x, (3, 1)), LABELS.repeat(n_inputs)])
    order = rng.permutation(len(X))
    return X[order], y[order] if n_outputs else y[order, 0]


class OwnWhite(WhiteKernel):
    """A user's kernel with noise of its own."""


class OtherWhite(RBF):
    """Another one."""

    def __call__(self, X, Y=None, eval_gradient=False):
        if Y is not None:
            return super().__call__(X, Y)
        K, gradient = super().__call__(X, eval_gradient=True)
        K = K + 0.1 * np.eye(len(X))
        return (K, gradient.reshape(*K.shape, -1)) if eval_gradient else K

    def diag(self, X):
        return super().diag(X) + 0.1


WHITE = {
    "sum": RBF(1.0) + WhiteKernel(1e-20, (1e-30, 1.0)),
    "product": ConstantKernel(2.0) * WhiteKernel() + RBF(1.0),
    "columns": Columns(RBF(1.0) + WhiteKernel(), [0]),
    "user's": OwnWhite() + RBF(1.0),
    "another user's": OtherWhite(1.0),
}
PURE = [RBF([1.0, 2.0]), Matern(1.0, nu=0.7) + DotProduct(), Columns(RBF(1.0), [1])]
every_white = pytest.mark.parametrize("kernel", WHITE.values(), ids=WHITE)


class TestChoice:
    def choose(self, inference, X, kernel=PURE[0]):
        tasks, codes = np.unique(X[:, -1].astype(int), return_inverse=True)
        return choose(inference, kernel, X[:, :-1], codes, tasks)

    @pytest.mark.parametrize("inference", ["auto", "kronecker"])
    @pytest.mark.parametrize("kernel", PURE)
    def test_complete_data(self, inference, kernel):
        X, _ = draw()
        assert self.choose(inference, X, kernel) == "kronecker"
        assert self.choose("dense", X, kernel) == "dense"

    def test_incomplete_data(self):
        X, _ = draw()
        for other in (X[1:], np.vstack([X, X[:1]]), np.vstack([X, X])):
            assert self.choose("auto", other) == "dense"
            assert self.choose("dense", other) == "dense"
            with pytest.raises(ValueError, match="needs every task observed at the"):
                self.choose("kronecker", other)

    def test_one_task(self):
        X, _ = draw()
        X = X[X[:, -1] == 2]
        assert self.choose("auto", X) == "dense"
        assert self.choose("kronecker", X) == "kronecker"

    @every_white
    def test_noise_of_the_kernel(self, kernel):
        X, _ = draw()
        assert not depends_on_inputs_only(kernel, X[:, :-1])
        assert self.choose("auto", X, kernel) == "dense"
        with pytest.raises(ValueError, match="needs a kernel of the inputs alone, but"):
            self.choose("kronecker", X, kernel)


ESTIMATORS = [MultiTaskGPRegressor, IndependentGP, PooledGP]
every_estimator = pytest.mark.parametrize("estimator", ESTIMATORS)


@every_estimator
def test_what_was_used(estimator):
    X, y = draw()
    for inference, used in [("auto", "kronecker"), ("dense", "dense")]:
        model = estimator(inference=inference, max_iter=0).fit(X, y)
        assert model.inference_ == used
        assert model.complete_ is True
    model = estimator(max_iter=0).fit(X[1:], y[1:])
    assert (model.inference_, model.complete_) == ("dense", False)
    model = estimator(inference="kronecker", max_iter=0).fit(X, y)
    assert model.inference_ == "kronecker"


def test_one_task_alone():
    X, y = draw()
    assert SingleTaskGP(max_iter=0).fit(X, y).inference_ == "dense"
    model = SingleTaskGP(max_iter=0, inference="kronecker").fit(X, y)
    assert model.inference_ == "kronecker"
    expected = SingleTaskGP(max_iter=0).fit(X, y)
    for found, of_dense in zip(
        model.predict(X, return_std=True),
        expected.predict(X, return_std=True),
        strict=True,
    ):
        np.testing.assert_allclose(found, of_dense, rtol=1e-8)


def missing(X, label, n_inputs):
    """All rows but some of a task's."""
    return np.delete(X, np.flatnonzero(X[:, -1] == label)[:n_inputs], axis=0)


X = draw()[0]
ERRORS = {
    "one": (missing(X, 2, 1), "but task 2 lacks 1 of the 10 inputs. Complete the da"),
    "two tasks": (
        missing(missing(X, 2, 3), 5, 2),
        "but task 2 lacks 3 of the 10 inputs, task 5 lacks 2 of the 10 inputs",
    ),
    "twice": (
        np.vstack([X, X[X[:, -1] == 5][:2]]),
        "but task 5 has 2 of the 10 inputs more than once. Complete",
    ),
    "both": (
        np.vstack([missing(X, 0, 1), X[X[:, -1] == 5][:1]]),
        "task 0 lacks 1 of the 10 inputs, task 5 has 1 of the 10 inputs more than",
    ),
    "different inputs": (
        X + np.outer(X[:, -1], [1.0, 0.0, 0.0]),
        "task 0 lacks 20 of the 30 inputs, task 2 lacks 20 of the 30 inputs, task 5",
    ),
    "many tasks": (
        np.column_stack([np.arange(8.0), np.arange(8.0), np.arange(8)]),
        "task 4 lacks 7 of the 8 inputs and 3 more. Complete the data, or set infe",
    ),
}


@every_estimator
@pytest.mark.parametrize(("X", "match"), ERRORS.values(), ids=ERRORS)
def test_what_is_missing(estimator, X, match):
    model = estimator(inference="kronecker", max_iter=0)
    with pytest.raises(ValueError, match=match):
        model.fit(X, np.arange(len(X), dtype=float))
    assert not hasattr(model, "tasks_")


def test_an_input_twice_of_one_task_alone():
    X, y = draw()
    twice = np.vstack([X, X[X[:, -1] == 5][:1]])
    model = SingleTaskGP(inference="kronecker", max_iter=0)
    with pytest.raises(ValueError, match="but task 5 has 1 of the 10 inputs more than"):
        model.fit(twice, np.append(y, 0.0))
    assert SingleTaskGP(max_iter=0).fit(twice, np.append(y, 0.0)).inference_ == "dense"


@every_white
def test_kernels_with_noise_are_refused(kernel):
    X, y = draw()
    model = MultiTaskGPRegressor(kernel, inference="kronecker", max_iter=0)
    with pytest.raises(ValueError, match="Leave it to noise_variance, or set infer"):
        model.fit(X, y)
    assert model.set_params(inference="auto").fit(X, y).inference_ == "dense"


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


MODELS = {
    "full rank": (MultiTaskGPRegressor, {}, None),
    "rank 2, two outputs": (MultiTaskGPRegressor, {"rank": 2}, 2),
    "noise of each": (MultiTaskGPRegressor, {"rank": 1, "noise": "per_task"}, None),
    "diagonal": (MultiTaskGPRegressor, {"rank": 1, "diagonal": True}, 2),
    "iGP": (IndependentGP, {"noise": "per_task"}, None),
    "pGP": (PooledGP, {"diagonal": True}, None),
}
every_model = pytest.mark.parametrize(
    ("estimator", "params", "n_outputs"), MODELS.values(), ids=MODELS
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


@every_model
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


NEW = np.array([[0.3, 0.4, 3.0], [-0.7, 0.1, 3.0], [1.2, -1.1, 3.0]])
TARGETS = np.array([3.0, -8.0, 11.0])


class TestAddTask:
    @pytest.fixture(
        params=[case for case in MODELS.values() if case[0] is MultiTaskGPRegressor],
        ids=[name for name, case in MODELS.items() if case[0] is MultiTaskGPRegressor],
    )
    def pair(self, request):
        """A model by Kronecker algebra and a dense one, at the starting values."""
        _, params, n_outputs = request.param
        X, y = draw(n_outputs=n_outputs)
        return [
            MultiTaskGPRegressor(inference=i, max_iter=0, **params).fit(X, y)
            for i in ("kronecker", "dense")
        ]

    def targets(self, model, sign=1.0):
        shape = -1, *np.ones_like(model.y_train_.shape[1:])
        return sign * TARGETS.reshape(shape) * np.ones(model.y_train_.shape[1:])

    @pytest.mark.parametrize("prior", ["tasks", None])
    @pytest.mark.parametrize("label", [-1, 3, 9])
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


def test_extended_keeps_to_the_method():
    X, y = draw()
    order = np.argsort(X[:, -1], kind="stable")
    tasks, form = np.searchsorted(LABELS, X[order, -1]), low_rank(3, 1)
    data, more = (X[order, :2], tasks, y[order]), low_rank(4, 1)
    new = X[0, :2], 3, 0.0
    grown = [np.append(a, [b], axis=0) for a, b in zip(data, new, strict=True)]
    for build, expected in [
        (building.dense, DenseLikelihood),
        (building.kronecker, ExtendedLikelihood),
    ]:
        found = extended(build(RBF(), form, *data), more, *grown, 1, 3, RBF())
        assert type(found) is expected
    new = X[0, :2], 0, 1.0  # before the others
    grown[1] = grown[1] + 1
    again = [np.insert(a, 0, b, axis=0) for a, b in zip(grown, new, strict=True)]
    found = extended(found, low_rank(5, 1), *again, 1, 0, RBF())
    assert found.novel == [4, 0]


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


class TestMemory:
    @pytest.fixture(autouse=True)
    def little(self, monkeypatch):
        for between_tasks in ("OF_CLIMB", "OF_POSTERIOR"):
            monkeypatch.setattr(_memory, between_tasks, 0)
        # 3, one of the kernel's tiles and 8 that come and go
        monkeypatch.setattr(_memory, "available_memory", lambda: 8.0 * 12 * 11**2)

    def test_matrices_of_the_inputs_fit(self):
        X, y = draw()
        assert MultiTaskGPRegressor(max_iter=0).fit(X, y).inference_ == "kronecker"
        with pytest.raises(InsufficientMemoryError, match="with 30 samples needs"):
            MultiTaskGPRegressor(max_iter=0, inference="dense").fit(X, y)

    def test_too_many_inputs(self):
        X, y = draw(12)
        with pytest.raises(InsufficientMemoryError, match="with 12 inputs of each ta"):
            MultiTaskGPRegressor(max_iter=0).fit(X, y)

    def test_a_task_of_too_many_samples(self):
        X, y = draw()
        model = MultiTaskGPRegressor(max_iter=0, rank=1).fit(X, y)
        model.add_task(NEW[:1], TARGETS[:1])
        with pytest.raises(InsufficientMemoryError, match="with 13 inputs of each ta"):
            model.add_task(NEW, TARGETS)

    def test_cells_that_are_missing(self):
        """They are told where dense inference is for want of them alone."""
        X, y = draw()
        match = r"with 29 samples .*available\. 1 cell is missing of 10 inputs of 3 tas"
        with pytest.raises(InsufficientMemoryError, match=match):
            MultiTaskGPRegressor(max_iter=0).fit(X[1:], y[1:])
        for model in (
            MultiTaskGPRegressor(max_iter=0, inference="dense"),
            MultiTaskGPRegressor(RBF() + WhiteKernel(), max_iter=0),
        ):
            with pytest.raises(InsufficientMemoryError, match=r"available\. Set inf"):
                model.fit(X[1:], y[1:])


class TestIncompleteData:
    @pytest.fixture(autouse=True)
    def few_are_many(self, monkeypatch):
        monkeypatch.setattr(_base, "MANY", 28)

    def test_warning(self):
        X, y = draw()
        match = r"1 cell is missing of 10 .* dense, of 29 samples\. See the user guid"
        with pytest.warns(IncompleteDataWarning, match=match):
            model = MultiTaskGPRegressor(max_iter=0).fit(X[1:], y[1:])
        assert model.inference_ == "dense"

    def test_no_warning(self, monkeypatch):
        X, y = draw()
        with warnings.catch_warnings():
            warnings.simplefilter("error", IncompleteDataWarning)
            MultiTaskGPRegressor(max_iter=0).fit(X, y)
            MultiTaskGPRegressor(max_iter=0, inference="dense").fit(X[1:], y[1:])
            MultiTaskGPRegressor(RBF() + WhiteKernel(), max_iter=0).fit(X[1:], y[1:])
            monkeypatch.setattr(_base, "MANY", 29)
            MultiTaskGPRegressor(max_iter=0).fit(X[1:], y[1:])


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
@pytest.mark.parametrize("seed", range(3))
def test_data_without_noise(seed):
    """Eigenvalues that are rounding would make the likelihood too rough to climb."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((12, 4))
    X = np.column_stack([np.tile(x, (3, 1)), np.repeat([0, 1, 2], 12)])
    y = np.concatenate([np.sin(x).sum(axis=1) + m * x[:, 0] for m in range(3)])
    model, dense = (
        MultiTaskGPRegressor(inverse_dynamics_kernel(1), rank=2, inference=i).fit(X, y)
        for i in ("kronecker", "dense")
    )
    assert model.n_evaluations_ < 3 * dense.n_evaluations_
    values = [each.log_marginal_likelihood_value_ for each in (model, dense)]
    assert values[0] > values[1] - 5.0
    assert model.score(X, y) > 1.0 - 1e-9
