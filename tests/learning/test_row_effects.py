"""Effects of rows, such as patients, that all tasks share and inputs do not tell."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, WideRegressor
from skmtgp._estimators import other_models
from skmtgp.exceptions import RowEffectsWarning
from skmtgp.inference.left_out import errors_left_out
from skmtgp.learning import row_effects


def patients(n=40, *, effect=2.0, seed=2):
    """Rows of patients and columns of visits: X and Y as frames, and 200 new ones."""
    rng = np.random.default_rng(seed)
    base = rng.normal(50.0, 10.0, n + 200)
    X = pd.DataFrame({"base": base, "drug": rng.integers(0, 2, n + 200) * 1.0})
    own = rng.normal(0.0, effect, n + 200)
    noise = rng.normal(0.0, 0.5, (n + 200, 4))
    Y = pd.DataFrame(
        {
            f"v{k}": 0.2 * base - k * X["drug"] + own + noise[:, k - 1]
            for k in range(1, 5)
        }
    )
    return X[:n], Y[:n], X[n:], Y[n:]


def said(model, X, Y):
    """What was said of effects of rows."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, Y)
    return [str(of.message) for of in caught if of.category is RowEffectsWarning]


def advised(message):
    """The model that a warning names."""
    named = message.split("Try MultiTaskGPRegressor(")[1].split("), with RBF")[0]
    return MultiTaskGPRegressor(**eval(f"dict({named})"))


def error(model, X, Y):
    """Root mean squared error of new rows."""
    return np.sqrt(np.square(model.predict(X) - Y.to_numpy()).mean())


@pytest.fixture(scope="module")
def fits():
    """A fit, what it says, and new rows."""
    X, Y, *new = patients()
    model = WideRegressor()
    return X, Y, new, model, said(model, X, Y)


def test_following_it_helps(fits):
    X, Y, new, model, messages = fits
    (message,) = messages
    assert "['linear', RBF(" in message
    two = WideRegressor(advised(message))
    assert said(two, X, Y) == []
    one, other = model.estimator_, two.estimator_
    gain = other.log_marginal_likelihood_value_ - one.log_marginal_likelihood_value_
    assert gain > 10.0
    assert error(two, *new) < 0.85 * error(model, *new)
    A = np.column_stack([np.ones(len(X)), X])
    lines = np.linalg.lstsq(A, Y, rcond=None)[0]
    of_lines = np.column_stack([np.ones(len(new[0])), new[0]]) @ lines
    least = np.sqrt(np.square(of_lines - new[1].to_numpy()).mean())
    assert error(two, *new) < 1.1 * least


def test_rows_with_a_task_column_and_gaps(fits):
    """It is the same of stacked rows, some of which are missing."""
    X, Y, *_ = fits
    stacked = np.column_stack([np.tile(X, (4, 1)), np.repeat(np.arange(4), len(X))])
    y = Y.to_numpy().T.ravel()
    kept = np.arange(len(y)) % 23 > 0
    assert len(said(MultiTaskGPRegressor(), stacked[kept], y[kept])) == 1


@pytest.mark.parametrize("seed", range(4))
def test_functions_of_inputs(seed):
    """Rough and smooth ones, of the same inputs in all tasks."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 12.0, (30, 1))
    waves = np.sin([1.0, 3.0, 9.0, 30.0][seed] * x + np.arange(2))
    Y = waves @ rng.normal(size=(2, 3)) + 0.1 * rng.standard_normal((30, 3))
    assert said(WideRegressor(), x, Y) == []


def test_noise_alone(fits):
    X, Y, *_ = patients(effect=0.0)
    assert said(WideRegressor(), X, Y) == []


def test_errors_are_those_of_fits_without_the_rows(fits):
    """The closed form, with the hyperparameters as they are."""
    found = []

    def kept(problem, mode, *_):
        found.append((problem, mode))

    X, Y, _, model, _ = fits
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(other_models, "effects_of_rows", kept)
        said(clone(model), X, Y)
    [(problem, mode)] = found
    rows = row_effects._rows(problem)
    errors = errors_left_out(problem, mode.theta, rows)
    prior, data = problem.prior, problem.data
    K = prior.covariance(mode.theta, data.X, data.tasks)
    noise = np.broadcast_to(prior.values(mode.theta).noise, data.n_tasks)
    own = rows == 3
    assert own.sum() == 4
    among = K[~own][:, ~own] + np.diag(noise[data.tasks[~own]])
    mean = K[own][:, ~own] @ np.linalg.solve(among, data.y[~own])
    np.testing.assert_allclose(errors[own], data.y[own] - mean, rtol=1e-6, atol=1e-8)
    line = row_effects._errors_of_lines(data)
    task = data.tasks == data.tasks[5]
    others = task & (np.arange(len(task)) != 5)
    A = np.column_stack([np.ones(len(data.X)), data.X])
    slopes = np.linalg.lstsq(A[others], data.y[others], rcond=None)[0]
    np.testing.assert_allclose(line[5], data.y[5] - A[5] @ slopes, rtol=1e-6)


def test_where_nothing_is_asked(fits, monkeypatch):
    X, Y, *_ = fits
    asked = []
    monkeypatch.setattr(row_effects, "_with_effects", lambda *_: asked.append(1))
    for model in (
        MultiTaskGPRegressor("linear"),
        MultiTaskGPRegressor("exponential"),
        MultiTaskGPRegressor([None, RBF(0.01, "fixed")], rank=[2, 1]),
        MultiTaskGPRegressor(trend="linear"),
        MultiTaskGPRegressor(inference="sparse", n_inducing=9),
        MultiTaskGPRegressor(shared=True),
    ):
        said(WideRegressor(model.set_params(max_iter=20)), X, Y)
    monkeypatch.setattr(row_effects, "MOST_ROWS", Y.size - 1)
    said(WideRegressor(), X, Y)
    assert asked == []
