"""Tasks that joined with few rows, of which more follow by `partial_fit`."""

import numpy as np
import pytest
from multitask_models import PAPER
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from streams import close, fresh, refitted, told

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    compile_predictor,
    partial_fit,
)
from skmtgp._numerics.updates import UpdatedCholesky

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning"),
]
STAGED = {"learning": "staged", "max_iter": 30}
MODELS = {
    "paper": MultiTaskGPRegressor(rank=2, **PAPER | STAGED),
    "defaults": MultiTaskGPRegressor(),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **STAGED),
    "full rank": MultiTaskGPRegressor("rbf", **STAGED),
    "shared": MultiTaskGPRegressor(rank=1, shared=True, **STAGED),
    "two kernels": MultiTaskGPRegressor([RBF(), RBF(0.3)], rank=[2, 1], max_iter=5),
    "noise of each": MultiTaskGPRegressor(rank=2, noise="per_task", **STAGED),
    "units of each": MultiTaskGPRegressor(rank=2, normalize_y="per_task", **STAGED),
    "trend": MultiTaskGPRegressor(rank=1, trend=[0], **STAGED),
    "laplace": MultiTaskGPRegressor(rank=1, hyperparameters="laplace", **STAGED),
    "sparse": MultiTaskGPRegressor(rank=2, inference="sparse", n_inducing=30, **STAGED),
}


def tasks(labels, n, seed=0):
    """Rows of tasks that are sums of two functions, the label in the last column."""
    rng = np.random.default_rng(seed)
    task = np.repeat(labels, n)
    x = rng.uniform(0.0, 6.0, len(task))
    weights = np.array([[1, 2], [-2, 1], [0.5, -1], [1, -1], [3, 0.5], [-1, 2.0]])
    one, two = weights[task].T
    y = one * np.sin(x) + two * np.cos(2.0 * x) + 0.05 * rng.standard_normal(len(x))
    return np.column_stack([x, task]), y


FIRST = tasks([0, 1, 2, 3], 15)
X_NEW, Y_NEW = tasks([4], 12, seed=1)
Z = tasks([0, 3, 4], 20, seed=2)[0]


@pytest.fixture(scope="module", params=MODELS)
def known(request):
    """A model of four tasks; not to be changed."""
    return request.param, clone(MODELS[request.param]).fit(*FIRST)


def streamed(model, n_first=2, n=8, X=X_NEW, y=Y_NEW):
    """The model with the first rows of a task at once, and others one by one."""
    model = model.add_task(X[:n_first], y[:n_first])
    for i in range(n_first, n):
        model.partial_fit(X[[i]], y[[i]])
    return model


def test_the_relation_is_that_of_all_rows_at_once(known):
    """After 2, 3, 5 and 8 rows it is learned anew."""
    name, model = known
    expected = model.add_task(X_NEW[:8], Y_NEW[:8])
    found, digits = streamed(model), 2 if name == "sparse" else 5
    close([found.task_covariance_], [expected.task_covariance_], digits=digits)
    close([found.predict(Z)], [expected.predict(Z)], digits=digits)
    assert found.tasks_.tolist() == [0, 1, 2, 3, 4]


def test_the_posterior_is_that_of_a_refit(known):
    name, model = known
    for n in (3, 4):
        found = streamed(model, n=n)
        close(told(found, Z), told(refitted(found), Z), digits=7)
        if name != "sparse":
            assert isinstance(found._posteriors[0].cholesky, UpdatedCholesky)


def test_the_others_stay(known):
    _, model = known
    found = streamed(model)
    others = found.task_covariance_[..., :4, :4]
    np.testing.assert_allclose(others, model.task_covariance_, rtol=1e-9, atol=1e-12)
    assert str(found.kernel_) == str(model.kernel_)
    assert found.get_params() == model.get_params()


def test_rows_stay_in_their_order(known):
    _, model = known
    found = streamed(model)
    assert found.y_train_.tolist() == [*FIRST[1], *Y_NEW[:8]]
    labels = found.tasks_[found.tasks_train_]
    assert labels.tolist() == [*FIRST[0][:, -1], *X_NEW[:8, -1]]


def test_between_it_stays_as_it_was_learned():
    model = MODELS["paper"].fit(*FIRST).add_task(X_NEW[:4], Y_NEW[:4])
    K_rho = model.task_covariance_
    model.partial_fit(X_NEW[[4]], Y_NEW[[4]])
    np.testing.assert_array_equal(model.task_covariance_, K_rho)
    model.partial_fit(X_NEW[[5]], Y_NEW[[5]])
    assert (model.task_covariance_ != K_rho).any()


def test_rows_of_other_tasks_change_no_relation():
    model = MODELS["paper"].fit(*FIRST).add_task(X_NEW[:2], Y_NEW[:2])
    K_rho = model.task_covariance_
    model.partial_fit(*tasks([0, 1, 2], 4, seed=3))
    np.testing.assert_array_equal(model.task_covariance_, K_rho)


def test_a_fit_forgets_who_has_joined():
    model = streamed(MODELS["paper"].fit(*FIRST))
    assert list(model._joined) == [4]
    assert not fresh(model).fit(*FIRST)._joined


def test_several_that_joined():
    """Each is learned from its own rows, beside all others."""
    model = MODELS["paper"].fit(*FIRST)
    for label, seed in ((4, 1), (5, 4)):
        X, y = tasks([label], 10, seed=seed)
        model = streamed(model, X=X, y=y)
    close(told(model, Z), told(refitted(model), Z), digits=7)
    expected = MODELS["paper"].fit(*FIRST)
    for label, seed in ((4, 1), (5, 4)):
        X, y = tasks([label], 10, seed=seed)
        expected = expected.add_task(X[:8], y[:8])
    close([model.task_covariance_], [expected.task_covariance_], digits=5)


def test_a_first_row_misleads_no_more():
    """Two rows that are close together say little of two functions."""
    X = np.column_stack([np.r_[1.0, 1.01, np.linspace(0.5, 5.5, 12)], np.full(14, 4)])
    y = 3.0 * np.sin(X[:, 0]) + 0.5 * np.cos(2.0 * X[:, 0])
    model = MODELS["paper"].fit(*FIRST)
    X_test, y_test = tasks([4], 60, seed=6)
    models = model.add_task(X, y), streamed(model, n=14, X=X, y=y)
    at_once, one_by_one = (np.std(of.predict(X_test) - y_test) for of in models)
    assert one_by_one < 1.1 * at_once


def test_the_unit_follows():
    """Two rows tell no unit: it is that of the others, until there are more rows."""
    model = MODELS["units of each"].fit(*FIRST)
    found = streamed(model, y=1000.0 * Y_NEW)
    assert found.y_scale_[4] == pytest.approx(1000.0 * np.std(Y_NEW[:8]))
    expected = model.add_task(X_NEW[:8], 1000.0 * Y_NEW[:8])
    close([found.predict(Z)], [expected.predict(Z)], digits=5)


def test_sampled():
    model = MultiTaskGPRegressor(
        "rbf", rank=2, hyperparameters="sampled", n_draws=6, max_iter=10
    )
    model, of_theta = model.fit(*FIRST), lambda of: of.theta_samples_
    first, found = model.add_task(X_NEW[:2], Y_NEW[:2]), streamed(model)
    close(told(found, Z), told(refitted(found), Z), digits=7)
    changed = (of_theta(found) != of_theta(first)).any(axis=0)
    assert changed.sum() == 2  # the row of each draw, of rank 2, and nothing else
    X, y = tasks([4], 60, seed=6)
    errors = [np.std(of.predict(X) - y) for of in (first, found)]
    assert errors[1] < 0.7 * errors[0]


def test_several_outputs():
    X, y = FIRST
    model = clone(MODELS["paper"]).fit(X, np.column_stack([y, np.cos(y)]))
    rows = np.column_stack([Y_NEW, np.cos(Y_NEW)])
    found, expected = streamed(model, y=rows), model.add_task(X_NEW[:8], rows[:8])
    close([found.predict(Z)], [expected.predict(Z)], digits=5)


def test_without_a_prior():
    """By maximum likelihood, as the task has joined."""
    model = MODELS["paper"].fit(*FIRST)
    found = model.add_task(X_NEW[:4], Y_NEW[:4], prior=None)
    for i in range(4, 9):
        found.partial_fit(X_NEW[[i]], Y_NEW[[i]])
    expected = model.add_task(X_NEW[:9], Y_NEW[:9], prior=None)
    close([found.task_covariance_], [expected.task_covariance_], digits=5)


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=2, **PAPER | {"trend": [0], "trend_per_task": True}),
        MultiTaskGPRegressor(rank=0, diagonal="equal", max_iter=5),
        IndependentGP(max_iter=5),
    ],
    ids=["trend per task", "rank 0", "iGP"],
)
def test_where_nothing_is_learned(model):
    """Trends of each task are told by its rows alone, and the others know no more."""
    model = clone(model).partial_fit(*FIRST).partial_fit(X_NEW[:4], Y_NEW[:4])
    K_rho = model.task_covariance_
    model.partial_fit(X_NEW[4:], Y_NEW[4:])
    np.testing.assert_array_equal(model.task_covariance_, K_rho)
    close(told(model, Z), told(refitted(model), Z), digits=7)


class TestCompleteData:
    """Whose rows stay a Kronecker product, from which those of new tasks are apart."""

    @pytest.fixture
    def complete(self):
        X, y = tasks([0, 1, 2, 3], 12)
        X[:, 0] = np.tile(np.linspace(0.0, 6.0, 12), 4)
        model = MultiTaskGPRegressor("rbf", rank=2, inference="kronecker", max_iter=10)
        return model.fit(X, y)

    def test_the_relation_is_that_of_all_rows_at_once(self, complete):
        found, expected = streamed(complete), complete.add_task(X_NEW[:8], Y_NEW[:8])
        assert found.inference_ == "kronecker"
        close([found.task_covariance_], [expected.task_covariance_], digits=5)
        close(told(found, Z), told(refitted(found), Z), digits=7)

    def test_nothing_is_decomposed_again(self, complete):
        found = streamed(complete)
        assert found._posteriors[0].base.eigen is complete._posteriors[0].eigen

    def test_several(self, complete):
        found = expected = complete
        for label, seed in ((5, 4), (4, 1)):
            X, y = tasks([label], 5, seed=seed)
            found, expected = streamed(found, n=5, X=X, y=y), expected.add_task(X, y)
        assert found.inference_ == "kronecker"
        close([found.task_covariance_], [expected.task_covariance_], digits=5)
        close(told(found, Z), told(refitted(found), Z), digits=7)

    def test_cells_of_the_product_tell_nothing_again(self, complete):
        """Rows at the same inputs become a part of it, with their first relation."""
        X = np.column_stack([complete.X_train_[:12, 0], np.full(12, 4)])
        y = 2.0 * np.sin(X[:, 0])
        found = complete.add_task(X[:6], y[:6])
        K_rho = found.task_covariance_
        found.partial_fit(X[6:], y[6:])
        np.testing.assert_array_equal(found.task_covariance_, K_rho)
        close(told(found, Z), told(refitted(found), Z), digits=7)


def test_limited_memory():
    """What fewer rows would tell takes the place of nothing that more have told."""
    model = MODELS["paper"].fit(*FIRST).add_task(X_NEW[:8], Y_NEW[:8])
    K_rho = model.task_covariance_
    X, y = tasks([0, 1, 2, 3], 30, seed=8)
    model.partial_fit(X, y, max_rows=20)
    kept = int((model.tasks_train_ == 4).sum())
    assert kept < 8
    for i in range(8, 12):
        model.partial_fit(X_NEW[[i]], Y_NEW[[i]], max_rows=20)
    np.testing.assert_array_equal(model.task_covariance_, K_rho)
    close(told(model, Z), told(refitted(model), Z), digits=6)
    for i in range(3):
        X, y = tasks([4], 6, seed=20 + i)
        model.partial_fit(X, y, max_rows=60)
    assert (model.task_covariance_ != K_rho).any()


def test_predictors_and_searches_follow():
    search = RankSearchIC(MODELS["paper"], ranks=[1, 2]).fit(*FIRST)
    search = search.add_task(X_NEW[:2], Y_NEW[:2])
    predictor = compile_predictor(search, task=4)
    K_rho = search.best_estimator_.task_covariance_
    for i in range(2, 8):
        partial_fit(search, X_NEW[[i]], Y_NEW[[i]])
    assert (search.best_estimator_.task_covariance_ != K_rho).any()
    expected = search.predict(Z[-3:])
    found = [predictor(x[:1])[0] for x in Z[-3:]]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_a_failure_changes_nothing(monkeypatch):
    model = MODELS["paper"].fit(*FIRST).add_task(X_NEW[:2], Y_NEW[:2])
    before = told(model, Z)

    def fail(*_, **__):
        raise MemoryError

    monkeypatch.setattr("skmtgp.multitask.learn_again", fail)
    with pytest.raises(MemoryError):
        model.partial_fit(X_NEW[2:4], Y_NEW[2:4])
    close(told(model, Z), before, digits=14)
    assert model._joined[4].told == 2


def test_many_rows(monkeypatch):
    """A hundred rows are enough, and are taken from all of them."""
    monkeypatch.setattr("skmtgp._estimators.joining.ENOUGH", 20)
    X, y = tasks([4], 60, seed=7)
    model = MODELS["paper"].fit(*FIRST).add_task(X[:2], y[:2])
    model.partial_fit(X[2:40], y[2:40])
    K_rho = model.task_covariance_
    expected = MODELS["paper"].fit(*FIRST).add_task(X[:40][::2], y[:40][::2])
    np.testing.assert_allclose(K_rho, expected.task_covariance_, rtol=0.05, atol=0.05)
    model.partial_fit(X[40:], y[40:])
    np.testing.assert_array_equal(model.task_covariance_, K_rho)
    close(told(model, Z), told(refitted(model), Z), digits=7)
