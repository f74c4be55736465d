"""Targets that repeat in time, as seasons do: a second kernel with a period."""

import warnings

import numpy as np
import pandas as pd
import pytest
from rarely import rarely
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ExpSineSquared, Matern

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._estimators import other_models
from skmtgp.exceptions import SeveralKernelsWarning
from skmtgp.kernels import Columns
from skmtgp.learning import repeating
from skmtgp.learning.repeating import NO_PERIOD, function_that_repeats

METERS = MultiTaskGPRegressor(task_feature="meter")


def meters(n_meters=4, days=8, every=4, noise=0.2, seed=0, *, same=False, wave=1.0):
    """Hours with a wave of a day, and a drift of each meter."""
    rng = np.random.default_rng(seed)
    hour = np.arange(0.0, 24.0 * days, every)
    turn, tables = 2.0 * np.pi * hour / 24.0, []
    for meter in "abcdefgh"[:n_meters]:
        size = wave * (1.0 if same else rng.uniform(0.5, 2.0))
        y = size * (np.sin(turn) + 0.5 * np.cos(2.0 * turn)) + rng.uniform(0.0, 9.0)
        y += 0.1 * rng.standard_normal(len(hour)).cumsum()
        y += noise * rng.standard_normal(len(hour))
        tables.append(pd.DataFrame({"hour": hour, "meter": meter, "y": y}))
    return pd.concat(tables, ignore_index=True)


def said(model, X, y, *given):
    """What was said of targets that repeat."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, y, *given)
    told = [str(of.message) for of in caught if of.category is SeveralKernelsWarning]
    return [message for message in told if "seem to repeat" in message]


def asked(monkeypatch, model, X, y, *given):
    """The problem, the mode, and what is found."""
    found = []

    def ask(problem, mode, enough):
        found.append((problem, mode, function_that_repeats(problem, mode, enough)))
        return found[-1][-1]

    monkeypatch.setattr(other_models, "function_that_repeats", ask)
    said(model, X, y, *given)
    return found


def named(message):
    """The model that a message names."""
    told = message.split("Try ")[1].split(", with Columns")[0]
    known = {"Columns": Columns, "ExpSineSquared": ExpSineSquared}
    known |= {"RBF": RBF, "Matern": Matern}
    return eval(told, known | {"MultiTaskGPRegressor": MultiTaskGPRegressor})


@pytest.mark.parametrize("unit", [1.0, *rarely(1e-6, 1e6)])
def test_it_is_said_and_what_it_says_forecasts_better(unit):
    rows = meters()
    past = rows["hour"] < 160.0
    X, X_new = (rows.loc[of, ["hour", "meter"]] for of in (past, ~past))
    y, y_new = unit * rows.loc[past, "y"], unit * rows.loc[~past, "y"]
    model = clone(METERS)
    (message,) = said(model, X, y)
    assert "seem to repeat in 'hour', every 2" in message
    better = named(message).set_params(task_feature="meter").fit(X, y)
    period = better.kernel_[1].kernel.periodicity
    assert period == pytest.approx(24.0, rel=0.01)
    errors = [np.square(of.predict(X_new) - y_new).mean() for of in (model, better)]
    assert errors[1] < 0.3 * errors[0]


def test_of_an_array_it_names_the_column():
    rows = meters()
    codes = rows["meter"].map(ord)
    hours = rows["hour"].to_numpy()
    other = np.random.default_rng(0).standard_normal(len(rows))
    X = np.column_stack([other, hours[::-1], codes])  # time may fall
    (message,) = said(MultiTaskGPRegressor(), X, rows["y"].to_numpy())
    assert "seem to repeat in column 1 of the inputs, every 2" in message
    named(message).fit(X, rows["y"])


def test_a_function_that_all_tasks_have_alike():
    """Has one number, not one for each task."""
    rows = meters(8, every=6, same=True)
    (message,) = said(clone(METERS), rows[["hour", "meter"]], rows["y"])
    assert "0], shared=[" in message
    named(message).set_params(task_feature="meter").fit(
        rows[["hour", "meter"]], rows["y"]
    )


def test_days_of_a_week_that_have_nothing_in_common():
    rng, day = np.random.default_rng(0), np.arange(70)
    f = rng.uniform(0.5, 1.5, (3, 1)) * rng.standard_normal(7)[day % 7]
    y = (f + 0.2 * rng.standard_normal(f.shape)).ravel()
    X = np.column_stack([np.tile(day, 3), np.repeat(range(3), 70)])
    (message,) = said(MultiTaskGPRegressor(), X, y)
    periodic = named(message).kernel[1].kernel
    assert periodic.periodicity == pytest.approx(7.0, rel=0.01)


@pytest.mark.parametrize("seed", [0, *rarely(1, 2, 3)])
@pytest.mark.parametrize("every", [4, *rarely(1)])
def test_where_nothing_repeats_it_is_not_said(seed, every):
    rows = meters(every=every, wave=0.0, seed=seed, days=8 if every > 1 else 4)
    assert not said(clone(METERS), rows[["hour", "meter"]], rows["y"])


@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
def test_curves_without_noise_do_not_repeat(seed):
    """A period of few gaps would be noise."""
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 1.0, 50)
    K = np.exp(-0.5 * ((x[:, None] - x) / 0.1) ** 2) + 1e-9 * np.eye(50)
    f = np.linalg.cholesky(K) @ rng.standard_normal((50, 2))
    y = (f @ rng.standard_normal((2, 4))).T.ravel()
    X = np.column_stack([np.tile(x, 4), np.repeat(range(4), 50)])
    assert not said(MultiTaskGPRegressor(), X, y)


def test_the_gain_is_that_of_bic(monkeypatch):
    """Less the logarithm of how many periods as long there may be."""
    rows = meters()
    X, y = rows[["hour", "meter"]], rows["y"]
    model = clone(METERS)
    [(_, _, found)] = asked(monkeypatch, model, X, y)
    (message,) = said(model, X, y)
    two = named(message).set_params(task_feature="meter").fit(X, y)
    gain = two.log_marginal_likelihood_value_ - model.log_marginal_likelihood_value_
    price = two.n_hyperparameters_ - model.n_hyperparameters_
    gain -= 0.5 * price * np.log(len(y)) + np.log(
        np.ptp(X["hour"]) / found.kernel.periodicity
    )
    assert found.gain == pytest.approx(gain, abs=3.0)
    assert found.feature == 0
    assert not found.shared


def test_of_many_rows_some_are_asked(monkeypatch):
    """Of far more, none."""
    rows, model, n_asked = meters(), clone(METERS), []
    [(problem, mode, all_asked)] = asked(
        monkeypatch, model, rows[["hour", "meter"]], rows["y"]
    )

    def climbed(problem, *given, **options):
        n_asked.append(len(problem.data))
        return climb(problem, *given, **options)

    climb = repeating.climb
    monkeypatch.setattr(repeating, "climb", climbed)
    monkeypatch.setattr(repeating, "MOST_ROWS", 191)
    monkeypatch.setattr(repeating, "SOME", 120)
    some_asked = function_that_repeats(problem, mode)
    assert set(n_asked) == {120}
    assert some_asked.kernel.periodicity == pytest.approx(24.0, rel=0.01)
    assert other_models.TELLING < some_asked.gain < all_asked.gain
    monkeypatch.setattr(repeating, "MOST", 191)
    assert function_that_repeats(problem, mode) is NO_PERIOD


def test_where_it_is_not_asked(monkeypatch):
    """Rows are in no order, or of few times, or their noise is known."""
    rows = meters(every=6)
    X, y = rows[["hour", "meter"]], rows["y"]
    mixed = np.random.default_rng(0).permutation(len(y))
    few = X["hour"] < 72.0
    for data in (
        (X.iloc[mixed], y.iloc[mixed]),
        (X[few], y[few]),
        (X, y, np.full(len(y), 0.04)),
    ):
        [(_, _, found)] = asked(monkeypatch, clone(METERS), *data)
        assert found is NO_PERIOD
    for model in (
        clone(METERS).set_params(kernel=RBF(5.0)),
        clone(METERS).set_params(inference="sparse", n_inducing=20),
        IndependentGP(task_feature="meter"),
        PooledGP(task_feature="meter"),
        SingleTaskGP(task_feature="meter"),
    ):
        found = asked(monkeypatch, model, X, y)
        assert all(of is NO_PERIOD for _, _, of in found)


@pytest.mark.parametrize("seed", [0, *rarely(1, 2, 3)])
def test_of_many_tasks_a_trend_does_not_repeat(seed):
    """A constant that all share, and few of the rows, gain by themselves."""
    rng, x = np.random.default_rng(seed), np.arange(25.0)
    y = np.log1p(x) * (1.0 + 0.3 * rng.standard_normal((60, 1)))
    y = (y + 0.1 * rng.standard_normal(y.shape)).ravel()
    X = np.column_stack([np.tile(x, 60), np.repeat(range(60), 25)])
    assert not said(MultiTaskGPRegressor(), X, y)


@pytest.mark.parametrize("unit", [1e-9, 86400.0])
def test_what_is_named_fits_in_any_unit(unit):
    rows = meters()
    X = rows[["hour", "meter"]].assign(hour=1e9 * unit + unit * rows["hour"])
    model = clone(METERS)
    (message,) = said(model, X, rows["y"])
    two = named(message).set_params(task_feature="meter").fit(X, rows["y"])
    gain = two.log_marginal_likelihood_value_ - model.log_marginal_likelihood_value_
    assert gain > 20.0


def test_asking_changes_nothing(monkeypatch):
    rows = meters(every=6)
    X, y = rows[["hour", "meter"]], rows["y"]
    first, other = clone(METERS), clone(METERS)
    assert said(first, X, y)
    monkeypatch.setattr(other_models, "function_that_repeats", lambda *_: NO_PERIOD)
    assert not said(other, X, y)
    np.testing.assert_array_equal(first.predict(X), other.predict(X))
    assert first.log_marginal_likelihood_value_ == other.log_marginal_likelihood_value_
