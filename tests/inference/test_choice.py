"""The parameter `inference`: what is chosen, what is refused, and that both agree."""

import warnings

import building
import numpy as np
import pytest
from same_inputs import LABELS, NEW, TARGETS, draw
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    WhiteKernel,
)

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._data.data import Data
from skmtgp._estimators import online
from skmtgp._estimators.training import Training
from skmtgp._estimators.units import shared_units
from skmtgp._numerics import memory as _memory
from skmtgp.exceptions import IncompleteDataWarning, InsufficientMemoryError
from skmtgp.inference import engines, memory
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import ENGINES, choose
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.kernels import Columns
from skmtgp.model.kernel_check import depends_on_inputs_only
from skmtgp.model.task_covariance import identity, low_rank

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


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
        """The name of the engine, which takes the data."""
        tasks, codes = np.unique(X[:, -1].astype(int), return_inverse=True)
        Y = np.zeros((len(X), 1))
        units = shared_units(Y, centred=False, scaled=False)
        training = Training(X[:, :-1], codes, tasks, Y, True, units)
        prior = building.prior(kernel, identity(len(tasks)))
        engine = choose(inference, prior, training)
        engine.check(prior, *training.data(engine), tasks)
        return engine.name

    @pytest.mark.parametrize("inference", ["auto", "kronecker"])
    @pytest.mark.parametrize("kernel", PURE)
    def test_complete_data(self, inference, kernel):
        X, _ = draw()
        assert self.choose(inference, X, kernel) == "kronecker"
        assert self.choose("dense", X, kernel) == "dense"

    def test_incomplete_data(self):
        X, _ = draw()
        apart = X + np.outer(X[:, -1], [1.0, 0.0, 0.0])
        for other in (apart, np.vstack([X, X[:1]]), np.vstack([X, X])):
            assert self.choose("auto", other) == "dense"
            assert self.choose("dense", other) == "dense"
            with pytest.raises(ValueError, match="needs the tasks observed at the"):
                self.choose("kronecker", other)

    @pytest.mark.parametrize(
        ("n_missing", "expected"),
        [(1, "kronecker"), (3, "kronecker"), (4, "dense"), (10, "dense")],
    )
    def test_missing_cells(self, n_missing, expected):
        """Up to a tenth of them by itself, and less than half when asked to."""
        X, _ = draw()
        assert self.choose("auto", X[n_missing:]) == expected
        assert self.choose("kronecker", X[n_missing:]) == "kronecker"
        assert self.choose("dense", X[n_missing:]) == "dense"

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
    for start, used in [(1, "kronecker"), (4, "dense")]:
        model = estimator(max_iter=0).fit(X[start:], y[start:])
        assert (model.inference_, model.complete_) == (used, False)
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
    "two tasks": (
        missing(missing(X, 2, 8), 5, 7),
        "but task 2 lacks 8 of the 10 inputs, task 5 lacks 7 of the 10 inputs. Compl",
    ),
    "twice": (
        np.vstack([X, X[X[:, -1] == 5][:2]]),
        "but task 5 has 2 of the 10 inputs more than once. Complete",
    ),
    "both": (
        np.vstack([missing(X, 0, 1), X[X[:, -1] == 5][:1]]),
        "cells missing, but task 5 has 1 of the 10 inputs more than once. Complete",
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


def test_tasks_join_by_the_same_method():
    X, y = draw()
    order = np.argsort(X[:, -1], kind="stable")
    tasks, kernel = np.searchsorted(LABELS, X[order, -1]), RBF()
    rows = X[order, :2], tasks, y[order]
    prior, more = (building.prior(kernel, low_rank(m, 1)) for m in (3, 4))
    new = X[0, :2], 3, 0.0
    grown = [np.append(a, [b], axis=0) for a, b in zip(rows, new, strict=True)]
    for name, expected in [
        ("dense", DenseLikelihood),
        ("kronecker", ExtendedLikelihood),
    ]:
        engine = ENGINES[name]()
        likelihood = engine.likelihood(prior, building.data(*rows, 3))
        found = engine.joined(likelihood, more, Data(*grown, 4), 3, kernel)
        assert type(found) is expected
    new = X[0, :2], 0, 1.0  # before the others
    grown[1] = grown[1] + 1
    again = [np.insert(a, 0, b, axis=0) for a, b in zip(grown, new, strict=True)]
    more = building.prior(kernel, low_rank(5, 1))
    found = engine.joined(found, more, Data(*again, 5), 0, kernel)
    assert found.novel == [4, 0]


class TestMemory:
    @pytest.fixture(autouse=True)
    def little(self, monkeypatch):
        for between_tasks in ("OF_CLIMB", "OF_POSTERIOR"):
            monkeypatch.setattr(memory, between_tasks, 0)
        # 3, one of the kernel's tiles and 8 that come and go; one between 4 tasks
        available = 8.0 * (12 * 11**2 + 4**2)
        monkeypatch.setattr(_memory, "available_memory", lambda: available)

    def test_matrices_of_the_inputs_fit(self):
        X, y = draw()
        assert MultiTaskGPRegressor(max_iter=0).fit(X, y).inference_ == "kronecker"
        with pytest.raises(InsufficientMemoryError, match="with 30 samples needs"):
            MultiTaskGPRegressor(max_iter=0, inference="dense").fit(X, y)

    def test_too_many_inputs(self):
        X, y = draw(12)
        with pytest.raises(InsufficientMemoryError, match="with 12 inputs of each ta"):
            MultiTaskGPRegressor(max_iter=0).fit(X, y)

    def test_a_task_of_too_many_samples(self, monkeypatch):
        monkeypatch.setattr(online, "AT_ONCE", 1)
        X, y = draw()
        model = MultiTaskGPRegressor(max_iter=0, rank=1).fit(X, y)
        model.add_task(NEW[:1], TARGETS[:1])
        with pytest.raises(InsufficientMemoryError, match="with 13 inputs of each ta"):
            model.add_task(NEW, TARGETS)

    def test_cells_that_are_missing(self):
        """They are told where dense inference is for want of them alone."""
        X, y = draw()
        match = r"with 26 samples .*available\. 4 cells are missing of 10 inputs of 3 t"
        with pytest.raises(InsufficientMemoryError, match=match):
            MultiTaskGPRegressor(max_iter=0).fit(X[4:], y[4:])
        for model in (
            MultiTaskGPRegressor(max_iter=0, inference="dense"),
            MultiTaskGPRegressor(RBF() + WhiteKernel(), max_iter=0),
        ):
            with pytest.raises(InsufficientMemoryError, match=r"available\. Set inf"):
                model.fit(X[4:], y[4:])

    def test_what_they_take(self):
        X, y = draw()
        with pytest.raises(InsufficientMemoryError, match="with 10 inputs of each ta"):
            MultiTaskGPRegressor(max_iter=0).fit(X[1:], y[1:])


class TestIncompleteData:
    @pytest.fixture(autouse=True)
    def few_are_many(self, monkeypatch):
        monkeypatch.setattr(engines, "MANY", 25)

    def test_warning(self):
        X, y = draw()
        match = r"4 cells are missing of 10 .* dense, of 26 samples\. See the user guid"
        with pytest.warns(IncompleteDataWarning, match=match):
            model = MultiTaskGPRegressor(max_iter=0).fit(X[4:], y[4:])
        assert model.inference_ == "dense"

    def test_what_it_advises(self):
        """At most a tenth missing, none repeated; or to ask for it."""
        X, y = draw()
        for rows in (slice(4, None), np.r_[0, : len(y)]):
            match = "none repeated and at most 10% missing, inference would be by Kro"
            with pytest.warns(IncompleteDataWarning, match=match):
                MultiTaskGPRegressor(max_iter=0).fit(X[rows], y[rows])
        with warnings.catch_warnings():
            warnings.simplefilter("error", IncompleteDataWarning)
            model = MultiTaskGPRegressor(max_iter=0, inference="kronecker")
            model.fit(X[4:], y[4:])
        assert model.inference_ == "kronecker"

    def test_no_warning(self, monkeypatch):
        X, y = draw()
        with warnings.catch_warnings():
            warnings.simplefilter("error", IncompleteDataWarning)
            MultiTaskGPRegressor(max_iter=0).fit(X, y)
            MultiTaskGPRegressor(max_iter=0).fit(X[1:], y[1:])
            MultiTaskGPRegressor(max_iter=0, inference="dense").fit(X[4:], y[4:])
            MultiTaskGPRegressor(RBF() + WhiteKernel(), max_iter=0).fit(X[4:], y[4:])
            monkeypatch.setattr(engines, "MANY", 26)
            MultiTaskGPRegressor(max_iter=0).fit(X[4:], y[4:])
