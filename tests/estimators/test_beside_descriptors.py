"""What tasks have beside their descriptors, as the data say."""

import numpy as np
import pytest
import textbook
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    DescriptorTracker,
    MultiTaskGPRegressor,
    TaskIdentifier,
    compile_predictor,
)

M, NEW, ROWS, NOISE = 14, 6, 15, 0.2
MODEL = MultiTaskGPRegressor(RBF(1.0), task_descriptors=[1, 2])
every_seed = pytest.mark.parametrize("seed", range(3))


def draw(seed, own):
    """X, y and f of tasks to fit, and of new ones: `own` is what they differ by."""
    rng = np.random.default_rng(seed)
    size = M + NEW
    table = rng.standard_normal((size, 2))
    D = np.column_stack([np.ones(size), table])
    weights = D @ rng.normal(0.0, 0.5, (3, 2)) + own * rng.standard_normal((size, 2))
    task, x = np.repeat(np.arange(size), ROWS), rng.uniform(0.0, 6.0, size * ROWS)
    f = weights[task, 0] * np.sin(x) + weights[task, 1] * np.cos(x)
    X = np.column_stack([x, table[task], task])
    y = f + NOISE * rng.standard_normal(len(f))
    return [[of[task < M] for of in (X, y, f)], [of[task >= M] for of in (X, y, f)]]


@every_seed
def test_own_functions_are_found(seed):
    (X, y, _), (X_new, _, f_new) = draw(seed, own=0.3)
    model = clone(MODEL).fit(X, y)
    assert model.diagonal_ == "equal"
    lower, upper = model.predict_interval(X_new, 0.95, include_noise=False)
    assert np.mean((lower < f_new) & (f_new < upper)) > 0.85
    given = clone(MODEL).set_params(rank=3).fit(X, y)
    assert not given.diagonal_
    gain = model.log_marginal_likelihood_value_ - given.log_marginal_likelihood_value_
    assert gain > 10.0
    # not a poor mode: the same as where a user asks for it
    asked = clone(MODEL).set_params(diagonal="equal").fit(X, y)
    found = model.log_marginal_likelihood_value_
    assert found > asked.log_marginal_likelihood_value_ - 0.1


@every_seed
def test_descriptors_that_tell_all(seed):
    (X, y, _), (X_new, _, _) = draw(seed, own=0.0)
    model = clone(MODEL).fit(X, y)
    assert model.diagonal_ is False
    given = clone(MODEL).set_params(rank=3).fit(X, y)
    np.testing.assert_array_equal(model.theta_, given.theta_)
    np.testing.assert_array_equal(model.predict(X_new), given.predict(X_new))
    assert model.n_evaluations_ > given.n_evaluations_  # both were learned


OTHERWISE = {
    "rank": {"rank": 3},
    "no steps": {"max_iter": 0},
    "staged": {"learning": "staged", "max_iter": 20},
    "sparse": {"inference": "sparse", "n_inducing": 10, "max_iter": 20},
}


@pytest.mark.parametrize("options", OTHERWISE.values(), ids=OTHERWISE)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_where_it_is_not_asked(options):
    (X, y, _), _ = draw(0, own=0.3)
    assert not clone(MODEL).set_params(**options).fit(X, y).diagonal_


def test_data_without_noise_are_not_asked():
    (X, _, f), _ = draw(0, own=0.0)
    assert not clone(MODEL).fit(X, f).diagonal_


def test_a_diagonal_that_is_given_is_kept():
    (X, y, _), _ = draw(0, own=0.0)
    assert clone(MODEL).set_params(diagonal="equal").fit(X, y).diagonal_ == "equal"
    assert clone(MODEL).set_params(diagonal=True).fit(X, y).diagonal_ is True


def test_unseen_tasks_by_the_book():
    (X, y, _), (X_new, _, _) = draw(0, own=0.3)
    model = clone(MODEL).set_params(normalize_y="shared", noise="shared").fit(X, y)
    K_rho = np.array(model.task_covariance_)
    F = model.task_factor_
    D = np.column_stack([np.ones(M), model.task_descriptors_.to_numpy()])
    one = X_new[:: ROWS // 3]
    of_new = np.column_stack([np.ones(len(one)), one[:, 1:3]])
    labels = one[:, 3].astype(int)
    first = np.unique(labels, return_index=True)[1]
    all_F = np.vstack([F, of_new[first] @ np.linalg.lstsq(D, F, rcond=None)[0]])
    K = all_F @ all_F.T
    own = np.diagonal(K_rho - F @ F.T)
    np.testing.assert_allclose(own, own[0])
    K += own[0] * np.eye(len(K))
    mean, cov = textbook.posterior(
        model.kernel_,
        K,
        model.noise_variance_,
        model.X_train_,
        model.tasks_train_,
        model.y_train_ - model.y_mean_,
        one[:, :1],
        labels,
        model.level_variance_,
    )
    found = model.predict(one, return_cov=True)
    np.testing.assert_allclose(found[0], mean + model.y_mean_, atol=1e-6)
    cov = cov * model.variance_factor_
    np.testing.assert_allclose(found[1], cov, atol=1e-6)


def test_what_follows_a_fit_takes_it():
    (X, y, _), (X_new, y_new, _) = draw(1, own=0.3)
    model = clone(MODEL).fit(X, y)
    new, y_of_new = X_new[:ROWS], y_new[:ROWS]
    std = model.predict(new, return_std=True)[1]
    joined = model.add_task(new, y_of_new)
    assert (joined.predict(new, return_std=True)[1] < std).all()
    tracker = DescriptorTracker(compile_predictor(model), noise=NOISE)
    assert np.isfinite(tracker.update(new[0, :1], y_of_new[:1])).all()
    mean, _ = TaskIdentifier(model).estimate(new[:, :1], y_of_new)
    assert np.isfinite(mean).all()
    Y = np.column_stack([y, 2.0 * y])
    assert clone(MODEL).fit(X, Y).diagonal_ == "equal"
