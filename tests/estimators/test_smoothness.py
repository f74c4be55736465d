"""`kernel=None`: the data say how smooth the functions are."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import smoothness as smoothness_of
from skmtgp._estimators.named_kernels import SMOOTHNESS, named_kernel
from skmtgp.learning.tuning import TUNING

TRUTHS = {
    "rbf": RBF(0.1),
    "matern52": Matern(0.2, nu=2.5),
    "matern": Matern(0.3, nu=1.5),
    "exponential": Matern(0.5, nu=0.5),
}
NU = {"rbf": None, "matern52": 2.5, "matern": 1.5, "exponential": 0.5}
EACH = pytest.mark.parametrize("name", TRUTHS)
ONE = {"rank": 1, "learning": "staged"}


def drawn(kernel, *, n_tasks=2, n_each=60, noise=0.02, seed=0):
    """Two tasks or more with some of one function each, at inputs of their own."""
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(n_tasks), n_each)
    x = rng.uniform(0.0, 1.0, len(tasks))
    K = kernel(x[:, None]) + 1e-12 * np.eye(len(x))
    f = np.linalg.cholesky(K) @ rng.standard_normal(len(x))
    y = (1.0 + tasks) * f + noise * rng.standard_normal(len(x))
    return np.column_stack([x, tasks]), y


def smoothness(model):
    """Name of the kernel that a model has."""
    kernel = getattr(model, "best_estimator_", model).kernel_
    kernel = getattr(kernel, "k2", kernel)  # without an amplitude
    [name] = [name for name, nu in NU.items() if nu == getattr(kernel, "nu", None)]
    return name


def test_each_is_less_smooth_than_the_one_before():
    x = np.array([[-1.0], [0.0], [0.1], [1.0]])
    near = [named_kernel(name, x)(x)[1, 2] for name in SMOOTHNESS]
    assert near == sorted(near, reverse=True)
    assert set(SMOOTHNESS) == set(TRUTHS)


class TestChoice:
    @EACH
    def test_the_truth_is_chosen(self, name):
        model = MultiTaskGPRegressor(**ONE).fit(*drawn(TRUTHS[name]))
        assert smoothness(model) == name

    @pytest.mark.parametrize("cls", [IndependentGP, PooledGP, SingleTaskGP])
    @pytest.mark.parametrize("name", ["rbf", "exponential"])
    def test_of_the_baselines(self, cls, name):
        n_tasks = 2 if cls is IndependentGP else 1
        X, y = drawn(TRUTHS[name], n_tasks=n_tasks, n_each=120)
        model = cls().fit(X, y)
        model = model.estimators_[0] if cls is SingleTaskGP else model
        assert smoothness(model) == name

    @pytest.mark.parametrize("name", ["rbf", "exponential"])
    def test_a_search_has_one_for_all_candidates(self, name):
        search = RankSearchIC(ranks=(1, 2), simpler=False, keep_estimators=True)
        search.fit(*drawn(TRUTHS[name]))
        assert {smoothness(model) for model in search.estimators_} == {name}

    def test_it_is_one_for_all_outputs(self):
        """That of their summed likelihoods: one is sure, the other says nothing."""
        X, y = drawn(TRUTHS["exponential"])
        noise = np.random.default_rng(1).standard_normal(len(y))
        model = MultiTaskGPRegressor(**ONE).fit(X, np.column_stack([y, noise]))
        assert [kernel.nu for kernel in model.kernel_] == [0.5, 0.5]

    @pytest.mark.parametrize("inference", ["kronecker", "sparse"])
    def test_with_every_engine(self, inference):
        X, y = drawn(TRUTHS["exponential"], n_tasks=1, n_each=120)
        X = np.vstack([X, X + [0.0, 1.0]])
        y = np.append(y, -y + 0.02 * np.random.default_rng(1).standard_normal(len(y)))
        options = {"inference": inference, "n_inducing": 30, **ONE}
        assert smoothness(MultiTaskGPRegressor(**options).fit(X, y)) == "exponential"


@pytest.mark.parametrize(
    ("gains", "chosen"),
    [
        ((-0.1, 9.0, 9.0), "rbf"),
        ((0.05, 9.0, 9.0), "rbf"),  # no more than two climbs end apart
        ((0.2, -0.1, 9.0), "matern52"),
        ((0.3, 0.2, -0.1), "matern"),
        ((3.0, 1.0, 0.5), "exponential"),
    ],
)
def test_it_is_as_rough_as_is_likeliest(monkeypatch, gains, chosen):
    values = dict(zip(SMOOTHNESS, np.cumsum([0.0, *gains]), strict=True))

    def with_kernel(problem, mode, kernel, gain):
        found = SimpleNamespace(value=values[kernel], spending=lambda _: mode)
        return problem, found

    monkeypatch.setattr(smoothness_of, "with_kernel", with_kernel)
    monkeypatch.setattr(smoothness_of, "as_named", lambda *_: _[-1])
    first = SimpleNamespace(value=0.0, spending=lambda _: first)
    found = [(SimpleNamespace(tuning=TUNING), first)]
    training = SimpleNamespace(kernel="rbf")
    names, _ = smoothness_of.rougher(MultiTaskGPRegressor(), training, found)
    assert names[-1] == chosen
    assert names == list(SMOOTHNESS[: len(names)])


def test_many_short_tasks_tell_it_together():
    """Once their function is known; the small model has one for each task."""
    kernel = TRUTHS["exponential"]
    X, y = drawn(kernel, n_tasks=1, n_each=120)
    X[:, 1] = np.arange(120) % 30
    model = MultiTaskGPRegressor(rank=0, shared=True).fit(X, y)
    assert smoothness(model) == "exponential"


def test_it_is_the_model_of_that_kernel():
    """As if the user had named it."""
    X, y = drawn(TRUTHS["exponential"])
    model = MultiTaskGPRegressor(**ONE).fit(X, y)
    named = MultiTaskGPRegressor("exponential", **ONE).fit(X, y)
    found, expected = (of.log_marginal_likelihood_value_ for of in (model, named))
    np.testing.assert_allclose(found, expected, atol=1e-3)
    np.testing.assert_allclose(model.predict(X), named.predict(X), atol=1e-3)


def test_order_and_units_do_not_matter():
    X, y = drawn(TRUTHS["matern"])
    order = np.random.default_rng(0).permutation(len(y))
    moved = X[order] * [1e3, 1.0] + [5e4, 0.0]
    first, other = (
        MultiTaskGPRegressor(**ONE).fit(*of) for of in ((X, y), (moved, 7.0 * y[order]))
    )
    assert smoothness(first) == smoothness(other) == "matern"


@pytest.mark.parametrize(
    "options",
    [{"kernel": "rbf"}, {"max_iter": 0}, {"kernel": RBF(0.1)}],
    ids=["named", "nothing is learned", "the user's"],
)
def test_it_is_not_asked(options):
    model = MultiTaskGPRegressor(**ONE | options).fit(*drawn(TRUTHS["exponential"]))
    assert smoothness(model) == "rbf"


def test_terms_of_a_list_have_the_usual_one():
    model = MultiTaskGPRegressor(["linear", None], rank=[1, 1], max_iter=3, tol=1.0)
    model.fit(*drawn(TRUTHS["exponential"], n_each=20))
    assert type(model.kernel_[1]) is RBF


def test_a_joining_task_has_it(caplog):
    X, y = drawn(TRUTHS["exponential"], n_tasks=3)
    old = X[:, 1] < 2
    model = MultiTaskGPRegressor(**ONE, verbose=1).fit(X[old], y[old])
    assert 'kernel="exponential"' in caplog.text
    assert smoothness(model.add_task(X[~old][:5], y[~old][:5])) == "exponential"
