"""Functions that vary at different speeds, of which each has a kernel of its own."""

import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC
from skmtgp._estimators import doubts
from skmtgp.exceptions import SeveralKernelsWarning
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

    def asked(problem, mode):
        found.append((ask(problem, mode), problem, mode))
        return found[-1][0]

    monkeypatch.setattr(doubts, "gain_of_own_kernels", asked)
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


@pytest.mark.parametrize("seed", range(4))
def test_functions_of_one_kernel(seed):
    assert said(MultiTaskGPRegressor(), *drawn(fast=0.3, seed=seed)[:2]) == []


def advised(message):
    """The parameters that a warning names."""
    named = message.split("Try MultiTaskGPRegressor(")[1]
    return eval(f"dict({named.removesuffix(' This takes longer.').removesuffix('.')}")


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


def test_where_nothing_is_asked(monkeypatch):
    X, y, _ = drawn()
    model = MultiTaskGPRegressor(**RANK_2)
    two = {"rank": [1, 1], "kernel": ["rbf", "rbf"]}
    cases = {
        "rank 1": (clone(model).set_params(rank=1), X, y),
        "a function of all": (clone(model).set_params(shared=True), X, y),
        "a diagonal": (clone(model).set_params(diagonal=True), X, y),
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
