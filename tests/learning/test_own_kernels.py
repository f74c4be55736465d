"""Functions that vary at different speeds, of which each has a kernel of its own."""

import warnings

import numpy as np
import pytest
from rarely import rarely
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp._estimators import base, doubts, other_models
from skmtgp.exceptions import SeveralKernelsWarning, UnrelatedTasksWarning
from skmtgp.learning import own_kernels

N_TASKS, ROWS = 4, 25
RANK_2 = {"rank": 2, "noise": "shared", "normalize_y": "shared"}


def drawn(*, fast=3.0, seed=0, n=ROWS):
    """A slow function, and another one, of each of which a task has more or less.

    X, y, and the function itself.
    """
    rng = np.random.default_rng(seed)
    a, b = rng.normal(0.0, 1.0, (2, N_TASKS))
    task = np.repeat(np.arange(N_TASKS), n)
    x = rng.uniform(0.0, 12.0, len(task))
    f = 3.0 * a[task] * np.sin(x / 4.0) + b[task] * np.cos(fast * x)
    return np.column_stack([x, task]), f + 0.1 * rng.standard_normal(len(f)), f


def said(model, X, y, *given):
    """What was said of several kernels."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y, *given)
    return [str(of.message) for of in caught if of.category is SeveralKernelsWarning]


def gains(monkeypatch, model, X, y, *given):
    """What the fit finds that two kernels gain, and the problems and modes."""
    found, ask = [], own_kernels.gain_of_own_kernels

    def asked(problem, mode, enough, **kernel):
        found.append((ask(problem, mode, **kernel), problem, mode))
        return found[-1][0]

    monkeypatch.setattr(other_models, "gain_of_own_kernels", asked)
    said(model, X, y, *given)
    return found


@pytest.mark.parametrize("model", [MultiTaskGPRegressor(), RankSearchIC()])
@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_it_is_said(model, unit):
    X, y, _ = drawn()
    (message,) = said(clone(model), X, unit * y)
    assert (
        "Try MultiTaskGPRegressor(kernel=[None, None], rank=[1, 1], noise=" in message
    )


@pytest.mark.parametrize("seed", [0, 1, *rarely(2, 3)])
def test_functions_of_one_kernel(seed):
    assert said(MultiTaskGPRegressor(), *drawn(fast=0.3, seed=seed)[:2]) == []


def advised(message):
    """The parameters that a warning names."""
    named = message.split("Try MultiTaskGPRegressor(")[1]
    return eval(f"dict({named.split('). This takes longer.')[0]})")


def test_following_it_helps():
    ratios = []
    for seed in range(6):
        X, y, _ = drawn(seed=seed)
        Z, _, g = drawn(seed=seed, n=50)
        one = MultiTaskGPRegressor()
        for message in said(one, X, y):
            two = MultiTaskGPRegressor(**advised(message))
            assert said(two, X, y) == []
            assert two.log_marginal_likelihood_value_ > (
                one.log_marginal_likelihood_value_ + 10.0
            )
            errors = (np.square(of.predict(Z) - g).mean() for of in (one, two))
            ratios.append(np.divide(*errors))
    assert len(ratios) >= 5
    assert np.exp(np.mean(np.log(ratios))) > 1.3


@pytest.mark.parametrize("rank", [2, 3])
def test_two_equal_kernels_are_one(monkeypatch, rank):
    """Whichever direction is that of the second."""
    X, y, _ = drawn()
    model = MultiTaskGPRegressor(**{**RANK_2, "rank": rank})
    monkeypatch.setattr(own_kernels, "SCALES", [0.0])
    values = []

    class Kept:
        def __init__(self, likelihood):
            self.value = lambda theta: values.append(likelihood.value(theta)) or 0.0

    start = own_kernels._likeliest_start

    def kept(both, problem, mode):
        class Both:
            prior = both.prior

            def likelihood(self):
                return Kept(both.likelihood())

        return start(Both(), problem, mode)

    monkeypatch.setattr(own_kernels, "_likeliest_start", kept)
    [(_, _, mode)] = gains(monkeypatch, model, X, y)
    assert len(values) == own_kernels.ANGLES * rank * (rank - 1) // 2
    np.testing.assert_allclose(values, mode.value, rtol=1e-8)


def test_the_gain_is_that_of_a_model_that_is_fitted(monkeypatch):
    X, y, _ = drawn()
    one = MultiTaskGPRegressor(**RANK_2)
    [(gain, _, _)] = gains(monkeypatch, one, X, y)
    assert isinstance(one.kernel_, RBF)
    both = {"rank": [1, 1], "kernel": ["rbf", "rbf"]}
    two = MultiTaskGPRegressor(**{**RANK_2, **both}).fit(X, y)
    bics = [
        of.log_marginal_likelihood_value_ - 0.5 * of.n_hyperparameters_ * np.log(len(y))
        for of in (one, two)
    ]
    assert gain > 10.0
    assert gain == pytest.approx(bics[1] - bics[0], abs=0.5)


def simulated(seed):
    """60 rows of a cheap simulation and 20 of a dear one, and rows of the dear one."""
    rng = np.random.default_rng(seed)
    cheap, dear, new = (rng.uniform(size=(n, 2)) for n in (60, 20, 300))

    def low(u):
        return np.sin(8.0 * u[:, 0]) * u[:, 1] + u.sum(axis=1)

    def high(u):
        return 1.5 * low(u) + 0.3 * np.cos(5.0 * u[:, 1])

    X = np.column_stack([np.vstack([cheap, dear]), np.repeat([0, 1], [60, 20])])
    Z = np.column_stack([new, np.ones(len(new))])
    return X, np.r_[low(cheap), high(dear)], Z, high(new)


@pytest.mark.parametrize("seed", [0, *rarely(1, 2), 3])
def test_simulations_without_noise(seed):
    """The first is of independent tasks, the last of compound symmetry."""
    X, y, Z, g = simulated(seed)
    one = MultiTaskGPRegressor()
    (message,) = said(one, X, y)
    two = MultiTaskGPRegressor(**advised(message))
    assert said(two, X, y) == []
    gain = two.log_marginal_likelihood_value_ - one.log_marginal_likelihood_value_
    assert gain > 10.0
    errors = [np.square(of.predict(Z) - g).mean() for of in (one, two)]
    assert errors[1] < 1e-3 * errors[0]


@pytest.mark.parametrize(
    ("form", "ranks"),
    [
        ({"rank": 1}, [1, 1]),
        ({"rank": 1, "diagonal": True}, [2, 1]),
        ({"rank": 0, "diagonal": "equal"}, [2, 1]),
        ({"rank": 0, "shared": True, "diagonal": "equal"}, [2, 1]),
        ({"rank": 0, "shared": True}, [1, 1]),
    ],
    ids=str,
)
def test_other_forms(monkeypatch, form, ranks):
    """Without noise; a model of two kernels can be each of them, with another rank."""
    X, _, y = drawn()
    X, y = X[X[:, 1] < 3], y[X[:, 1] < 3]
    y = y if ranks[0] > 1 else np.sin(X[:, 0])
    model = MultiTaskGPRegressor(**RANK_2 | form)
    monkeypatch.setattr(MultiTaskGPRegressor, "_shares", lambda self: False)
    [(gain, problem, mode)] = gains(monkeypatch, model, X, y)
    assert np.isfinite(gain)
    assert own_kernels.ranks_of_two(problem, mode) == ranks
    F = own_kernels._factor(problem, mode)
    np.testing.assert_allclose(F @ F.T, problem.prior.K_rho_at(mode.theta), atol=1e-8)


def test_modes_that_stalled(monkeypatch):
    kept = []
    monkeypatch.setattr(base, "warn_of_doubts", lambda *of, **_: kept.append(of))
    X, y, _ = drawn()
    said(MultiTaskGPRegressor(**RANK_2), X, y)
    [(training, problems, [mode])] = kept
    stalled = mode._replace(converged=False, stalled=True)
    with pytest.warns(SeveralKernelsWarning):
        doubts.warn_of_doubts(training, problems, [stalled])


def test_the_likelier_of_two_models_is_named(monkeypatch):
    """Tasks apart, or two kernels."""
    X, y, _ = drawn()
    for apart, told in ((11.0, SeveralKernelsWarning), (1e3, UnrelatedTasksWarning)):
        monkeypatch.setattr(
            other_models, "gain_of_separate_models", lambda *_, a=apart: a
        )
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            MultiTaskGPRegressor(**RANK_2).fit(X, y)
        assert [of.category for of in caught] == [told]


def test_where_nothing_is_asked(monkeypatch):
    X, y, _ = drawn()
    model = MultiTaskGPRegressor(**RANK_2)
    two = {"rank": [1, 1], "kernel": ["rbf", "rbf"]}
    cases = {
        "a function of all": (clone(model).set_params(shared=True), X, y),
        "a diagonal": (clone(model).set_params(diagonal=True), X, y),
        "rank 1, with noise": (clone(model).set_params(rank=1), X, y),
        "two kernels": (clone(model).set_params(**two), X, y),
        "held length-scales": (
            clone(model).set_params(kernel=RBF(0.5, "fixed")),
            X,
            y,
        ),
        "an amplitude": (
            clone(model).set_params(kernel=ConstantKernel(1.0) * RBF(0.5)),
            X,
            y,
        ),
        "a kernel that is given": (clone(model).set_params(kernel="matern"), X, y),
        "units that are given": (clone(model).set_params(normalize_y=False), X, y),
        "staged": (clone(model).set_params(learning="staged"), X, y),
        "no length-scale": (clone(model).set_params(kernel="linear"), X, y),
        "independent": (IndependentGP(), X, y),
        "pooled": (PooledGP(), X, y),
        "alpha": (clone(model), X, y, np.full(len(y), 0.1)),
        "trend": (clone(model).set_params(trend="linear"), X, y),
        "sparse": (clone(model).set_params(inference="sparse", n_inducing=9), X, y),
    }
    for name, case in cases.items():
        found = [gain for gain, *_ in gains(monkeypatch, *case)]
        assert not np.isfinite(found).any(), name
    laplace = clone(model).set_params(hyperparameters="laplace")
    assert gains(monkeypatch, laplace, X, y) == []  # it takes one kernel
    monkeypatch.setattr(own_kernels, "MOST_ROWS", len(y) - 1)
    assert gains(monkeypatch, clone(model), X, y)[0][0] == -np.inf
