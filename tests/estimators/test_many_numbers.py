"""Functions that no kernel draws, and two functions of so many tasks."""

import numpy as np
import pytest

from skmtgp import MultiTaskGPRegressor


def waves(n_tasks, per_task, n_inputs, *, n_functions=2, noise=0.3, seed=0, n_new=0):
    """Tasks that mix sines of sums of the inputs; rows to learn from and new ones."""
    rng = np.random.default_rng(seed)
    weights = rng.standard_normal((n_tasks, n_functions))
    x = rng.uniform(-2.0, 2.0, (n_tasks * per_task, n_inputs))
    task = np.repeat(np.arange(n_tasks), per_task)
    slopes = rng.standard_normal((n_functions, n_inputs))
    phases = rng.uniform(0.0, 6.0, n_functions)

    def function(x, task):
        return (np.sin(x @ slopes.T + phases) * weights[task]).sum(axis=1)

    y = function(x, task) + noise * rng.standard_normal(len(x))
    x_new = rng.uniform(-2.0, 2.0, (n_new, n_inputs))
    new = rng.integers(0, n_tasks, n_new)
    told = np.column_stack([x_new, new]), function(x_new, new)
    return np.column_stack([x, task]), y, *told


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SeveralKernelsWarning")
@pytest.mark.parametrize(
    ("n_tasks", "per_task", "d"),
    [
        pytest.param(52, 7, 1, marks=pytest.mark.long),
        pytest.param(60, 10, 2, marks=pytest.mark.longest),
    ],
)
def test_two_functions_of_many_tasks(n_tasks, per_task, d):
    """A hundred numbers and more, of seven to ten rows a task, are what rows tell."""
    X, y, X_new, f_new = waves(
        n_tasks, per_task, d, noise=0.3 if d == 1 else 0.1, n_new=500
    )
    model = MultiTaskGPRegressor().fit(X, y)
    assert (model.rank_, model.diagonal_) == (2, False)
    alone = MultiTaskGPRegressor(rank=0, diagonal="equal").fit(X, y)
    errors = [np.std(of.predict(X_new) - f_new) for of in (model, alone)]
    assert errors[0] < 0.7 * errors[1]


@pytest.mark.long
def test_no_input_is_switched_off():
    """Of four inputs, which all matter; without one rank 2 is 230 nats less likely."""
    X, y, X_new, f_new = waves(20, 30, 4, n_new=500)
    model = MultiTaskGPRegressor().fit(X, y)
    assert model.rank_ == 2
    assert (model.kernel_.length_scale < 3.0).all()
    assert np.std(model.predict(X_new) - f_new) < 0.4 * np.std(f_new)
