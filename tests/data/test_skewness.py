"""Inputs with many small values and a few large ones."""

import re
import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rarely import rarely
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, SingleTaskGP
from skmtgp._data.skewness import is_skewed, logarithm, share_far
from skmtgp._estimators import skew
from skmtgp.exceptions import SkewedInputWarning
from skmtgp.learning.log_inputs import gains_of_logarithms

DOSES = np.geomspace(0.1, 100.0, 7)
LOGNORMAL = np.exp(1.5 * np.random.default_rng(0).standard_normal(200))


@pytest.mark.parametrize(
    ("x", "skewed"),
    [
        (DOSES, True),
        (np.append(0.0, DOSES), True),  # a control without any
        (np.repeat([1.0, 3.0, 10.0, 30.0, 100.0], 6), True),  # series of doses
        (np.repeat(2.0 ** np.arange(-2, 6), 3), True),
        (np.repeat([1.0, 2.0, 3.0, 5.0, 8.0], 6), False),
        (LOGNORMAL, True),
        (np.log(LOGNORMAL), False),
        (-LOGNORMAL, False),
        (LOGNORMAL - 1.0, False),  # of negative values there is no logarithm
        (np.linspace(0.0, 1.0, 50), False),
        (np.repeat(DOSES[:4], 10), False),  # too few to say
        (np.zeros(20), False),
        (np.geomspace(1e-320, 1e300, 9), False),  # some vanish beside the largest
        (np.r_[np.linspace(1.0, 2.0, 99), 1e6], False),  # so are the logarithms
    ],
)
def test_which_inputs_are_skewed(x, skewed):
    assert is_skewed(x) is skewed


@given(st.floats(1e-200, 1e200), st.permutations(range(len(DOSES))))
def test_units_and_order_do_not_matter(unit, order):
    assert is_skewed(unit * DOSES[order])


def test_share_of_the_range():
    x = np.array([0.0, 1.0, 1.0, 10.0])
    assert share_far(x, 0.25) == pytest.approx((0.5 + 8.5) / 10.0)
    assert share_far(x, 5.0) == 0.0


def measured(seed=0):
    """Saturating responses of four tasks to doses, as a frame."""
    rng, task = np.random.default_rng(seed), np.repeat(list("abcd"), len(DOSES) * 2)
    dose, half = np.tile(DOSES, 8), np.repeat(rng.uniform(0.5, 3.0, 4), 14)
    y = dose / (half + dose) + 0.02 * rng.standard_normal(len(dose))
    return pd.DataFrame({"dose": dose, "drug": task}), y


@cache
def told(estimator, change=np.asarray):
    """A model of doses or of their logarithms, and what is said of skewed inputs."""
    X, y = measured()
    model = estimator(task_feature="drug")
    return model, texts_of(model, X.assign(dose=change(X["dose"])), y)


@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, IndependentGP])
def test_a_fit_says_so(estimator):
    [text] = told(estimator)[1]
    assert re.search("'dose'.*Try the logarithm of 'dose'", text)


@pytest.mark.parametrize("amplitude_first", [True, False])
def test_an_amplitude_does_not_matter(amplitude_first):
    X, y = measured()
    parts = ConstantKernel(2.0), RBF(1.0)
    kernel = parts[0] * parts[1] if amplitude_first else parts[1] * parts[0]
    with pytest.warns(SkewedInputWarning):
        MultiTaskGPRegressor(kernel, task_feature="drug").fit(X, y)


def test_without_names_it_is_a_number():
    X, y = measured()
    X = np.column_stack([np.ones(len(y)), X["dose"], X["drug"].factorize()[0]])
    with pytest.warns(SkewedInputWarning, match="column 1 of the inputs"):
        MultiTaskGPRegressor().fit(X, y)


@pytest.mark.parametrize(
    ("change", "params"),
    [
        (np.asarray, {"max_iter": 0}),
        (lambda dose: np.linspace(1.0, 2.0, len(dose)), {}),
    ],
    ids=["not learned", "evenly spread"],
)
def test_nothing_is_said(change, params):
    X, y = measured()
    X["dose"] = change(X["dose"].to_numpy())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # evenly spread the responses repeat
        warnings.simplefilter("error", SkewedInputWarning)
        MultiTaskGPRegressor(task_feature="drug", **params).fit(X, y)


def test_each_input_is_named_once():
    X, y = measured()
    rng = np.random.default_rng(1)
    X["time"] = X["dose"].to_numpy()[rng.permutation(len(y))]
    later = X["time"] / (1.0 + X["time"]) + 0.02 * rng.standard_normal(len(y))
    Y = np.column_stack([later, y])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        MultiTaskGPRegressor(task_feature="drug").fit(X, Y)
    texts = [str(of.message) for of in caught if of.category is SkewedInputWarning]
    assert [text.split("'")[1] for text in texts] == ["dose", "time"]


def test_models_of_each_task_warn_once():
    X, y = measured()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        SingleTaskGP(task_feature="drug").fit(X, y)
    [text] = [str(of.message) for of in caught if of.category is SkewedInputWarning]
    assert text.endswith("Try the logarithm of 'dose'.")


def test_rows_of_all_tasks_say_whether_inputs_are_skewed():
    """Six rows of one task may be by chance."""
    rng = np.random.default_rng(0)
    task, x = np.repeat(np.arange(30), 6), rng.uniform(0.0, 10.0, 180)
    x[:6] = [0.1, 0.2, 0.4, 1.0, 3.0, 9.0]
    assert is_skewed(x[:6])
    y = np.sin(3.0 * x) + 0.1 * rng.standard_normal(180)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkewedInputWarning)
        SingleTaskGP(RBF(0.3, "fixed")).fit(np.column_stack([x, task]), y)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("cls", [MultiTaskGPRegressor, SingleTaskGP])
def test_climbs_that_did_not_end_say_nothing(cls):
    X, y = measured()
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkewedInputWarning)
        cls(task_feature="drug", max_iter=1).fit(X, y)


@pytest.mark.parametrize("seed", [0, *rarely(1)])
def test_gaps_of_a_few_rows_are_none(seed):
    """Of six rows of a skewed input nearly any leave some."""
    rng = np.random.default_rng(seed)
    task, x = np.repeat(np.arange(20), 6), np.exp(rng.standard_normal(120))
    y = x * rng.normal(2.0, 0.3, 20)[task] + 0.5 * rng.standard_normal(120)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkewedInputWarning)
        SingleTaskGP().fit(np.column_stack([x, task]), y)


def test_long_length_scales_bridge_gaps():
    X, _ = measured()
    y = 0.1 * X["dose"] + np.random.default_rng(0).standard_normal(len(X))
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkewedInputWarning)
        MultiTaskGPRegressor(task_feature="drug").fit(X, y)


@pytest.mark.parametrize(
    "params",
    [
        {"kernel": "periodic"},
        {"kernel": RBF(1.0) + DotProduct()},
        {"kernel": RBF(1.0) * DotProduct()},
        {"kernel": ConstantKernel(2.0) * ConstantKernel(3.0), "rank": 1},
        {"trend": "linear"},
        {"kernel": ["rbf", "rbf"], "rank": 1},
    ],
    ids=["periodic", "sum", "product", "constant", "trend", "two terms"],
)
def test_other_kernels_do_not_return_to_the_mean(params):
    X, y = measured()
    with warnings.catch_warnings():
        warnings.simplefilter("error", SkewedInputWarning)
        MultiTaskGPRegressor(task_feature="drug", **params).fit(X, y)


def test_the_logarithm_is_better_and_nothing_is_said_of_it():
    between = pd.DataFrame({"dose": [55.0] * 4, "drug": list("abcd")})
    f = 55.0 / (np.random.default_rng(0).uniform(0.5, 3.0, 4) + 55.0)
    errors = []
    for change in (np.asarray, np.log):
        model, texts = told(MultiTaskGPRegressor, change)
        assert (texts == []) == (change is np.log)
        mean = model.predict(between.assign(dose=change(between["dose"])))
        errors.append(np.square(mean - f).mean())
    assert errors[1] < 0.25 * errors[0]


def curves(kind, seed=1, n=160):
    """Functions of a Gaussian process along a lognormal input, or its logarithm."""
    rng, task = np.random.default_rng(seed), np.arange(n) % 8
    x = np.exp(rng.standard_normal(n))
    z = np.log(x) if kind == "log" else x
    K = np.exp(-0.5 * np.subtract.outer(z, z) ** 2) + 1e-8 * np.eye(n)
    functions = np.linalg.cholesky(K) @ rng.standard_normal((n, 2))
    f = (functions * rng.standard_normal((8, 2))[task]).sum(axis=1)
    return np.column_stack([x, task]), f + 0.1 * rng.standard_normal(n)


def texts_of(model, X, y):
    """What a fit says of skewed inputs."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y)
    return [str(of.message) for of in caught if of.category is SkewedInputWarning]


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(),
        MultiTaskGPRegressor(rank=1),
        MultiTaskGPRegressor("matern", rank=2),
        IndependentGP(),
        RankSearchIC(),
    ],
    ids=repr,
)
def test_logarithms_are_told_if_they_are_likelier(model):
    [text] = texts_of(model, *curves("log"))
    assert "nats. Try the logarithm of column 0 of the inputs." in text


@pytest.mark.parametrize("seed", [0, *rarely(1, 2, 3, 4, 5)])
def test_the_shortest_length_scales_do_not_hide_the_gain(seed):
    """Along the doses of the smallest steps, the others are apart."""
    rng, doses = np.random.default_rng(seed), np.tile(np.geomspace(0.01, 100.0, 8), 12)
    drug, half = np.repeat(np.arange(12), 8), np.exp(rng.standard_normal(12))
    slope, top = rng.uniform(0.8, 2.0, 12), rng.uniform(0.7, 1.2, 12)
    y = top[drug] / (1.0 + (half[drug] / doses) ** slope[drug])
    y += 0.05 * rng.standard_normal(len(y))
    [text] = texts_of(MultiTaskGPRegressor(), np.column_stack([doses, drug]), y)
    assert "nats. Try the logarithm" in text


@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
def test_logarithms_that_are_less_likely_are_not_told(seed):
    """Though rows at large values are sparse."""
    assert texts_of(MultiTaskGPRegressor(), *curves("raw", seed)) == []


@pytest.mark.parametrize("seed", [0, *rarely(1)])
def test_nats_are_those_of_another_fit(seed, monkeypatch):
    (X, y), found = curves("log", seed), []

    def gains(*args):
        found.append(gains_of_logarithms(*args))
        return found[-1]

    monkeypatch.setattr(skew, "gains_of_logarithms", gains)
    model = MultiTaskGPRegressor(rank=2, normalize_y="shared", noise="shared")
    texts_of(model, X, y)
    before = model.log_marginal_likelihood_value_
    X[:, 0] = np.log(X[:, 0])
    after = model.fit(X, y).log_marginal_likelihood_value_
    assert found[0] == {0: pytest.approx(after - before, abs=0.5)}


def test_a_logarithm_keeps_mean_and_deviation():
    x = np.append(0.0, DOSES)
    z = logarithm(x)
    np.testing.assert_allclose([z.mean(), z.std()], [x.mean(), x.std()])
    shifted = np.log(x + DOSES[0])
    np.testing.assert_allclose(np.corrcoef(z, shifted)[0, 1], 1.0)


def test_few_rows_are_not_asked():
    X, y = curves("log", n=24)
    assert texts_of(MultiTaskGPRegressor(rank=1), X, y) == []
