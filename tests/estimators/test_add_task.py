"""Section 3.3 by the estimator: a task joins a fitted model."""

import pickle

import joining
import numpy as np
import pytest
import textbook
from joining import OLD, PLACES, learner, split
from multitask_models import PAPER
from samples import draw, log_densities, outputs, posteriors
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, multitask

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
UNITS = {"task_levels": True, "normalize_y": "per_task"}
# parameters, number of outputs, place of the new task, prior
CASES = {
    "full rank": ({}, None, "last", "tasks"),
    "full rank, two outputs": ({}, 2, "middle", None),
    "rank 2": ({"rank": 2}, None, "first", None),
    "rank 2, two outputs": ({"rank": 2}, 2, "last", "tasks"),
    "diagonal": ({"rank": 2, "diagonal": True}, None, "middle", "tasks"),
    "full rank, diagonal": ({"diagonal": True}, None, "last", None),
    "noise of each": ({"rank": 2, "noise": "per_task"}, None, "middle", None),
    "not normalised": ({"rank": 1, "normalize_y": False}, None, "first", "tasks"),
    "all, two outputs": (
        {"diagonal": True, "noise": "per_task", "normalize_y": False},
        2,
        "first",
        "tasks",
    ),
    "fixed noise": ({"rank": 1, "noise_variance_bounds": "fixed"}, 2, "middle", None),
    "levels": ({"rank": 1, "task_levels": True}, None, "middle", "tasks"),
    "units of each": (UNITS | {"rank": 2}, 2, "first", None),
    "units and noise of each": (UNITS | {"noise": "per_task"}, None, "last", "tasks"),
}


def encode(X, model):
    """The tasks of X as positions, which is what samples.py takes."""
    return np.column_stack([X[:, :-1], np.searchsorted(model.tasks_, X[:, -1])])


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def case(request):
    return request.param


@pytest.fixture(scope="module")
def fitted(case):
    """Tests share it: add_task leaves it alone."""
    params, n_outputs, *_ = case
    return joining.fitted(*split(n_outputs)[:2], **params)


@pytest.fixture(scope="module")
def extension(case, fitted):
    """The extended model, what it was made of, and where the new task is."""
    _, n_outputs, place, prior = case
    X, y, X_new, y_new = split(n_outputs, place)
    model = fitted.add_task(X_new, y_new, prior=prior)
    position = {"first": 0, "middle": 2, "last": 3}[place]
    return model, np.vstack([X, X_new]), np.concatenate([y, y_new]), position


@pytest.fixture(params=["tasks", None])
def prior(request):
    return request.param


def test_what_was_learned_is_kept(fitted, extension):
    model, *_, position = extension
    others = np.delete(np.arange(4), position)
    assert model.tasks_[others].tolist() == OLD
    assert model.kernel_ == fitted.kernel_
    per_task = model.normalize_y == "per_task"
    for name in ("y_mean_", "y_scale_"):
        kept = getattr(model, name)
        kept = kept[..., others] if per_task else kept
        np.testing.assert_array_equal(kept, getattr(fitted, name))
    for j, (new, old) in enumerate(zip(outputs(model), outputs(fitted), strict=True)):
        block = new.K_rho[np.ix_(others, others)]
        np.testing.assert_allclose(block, old.K_rho, rtol=1e-10)
        if model.noise == "per_task" or per_task:
            np.testing.assert_allclose(new.noise[others], old.noise, rtol=1e-12)
            unit = np.ones(4)
            if per_task:
                unit = np.square(model.y_scale_.reshape(-1, 4)[j])
            mean = np.exp(np.log(old.noise / unit[others]).mean()) * unit[position]
            np.testing.assert_allclose(new.noise[position], mean, rtol=1e-12)
        else:
            assert new.noise == old.noise
        level = new.level[others] if per_task else new.level
        np.testing.assert_allclose(level, old.level, rtol=1e-12)


def test_attributes_reproduce_likelihood_and_predictions(extension):
    model, X, y, position = extension
    expected = log_densities(model, encode(X, model), y)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-8)
    assert model.log_marginal_likelihood_value_ == pytest.approx(np.sum(expected))
    Z = draw(n_tasks=4, per_task=3, seed=1)[0]
    found = posteriors(model, encode(X, model), y, Z)
    widened = (Z[:, -1] == position) & any(model._leeway)
    Z[:, -1] = model.tasks_[Z[:, -1].astype(int)]
    mean, std = model.predict(Z, return_std=True)
    for j, (f, K) in enumerate(found):
        close = {"rtol": 1e-6, "atol": 1e-7 * np.abs(K).max()}
        np.testing.assert_allclose(mean.reshape(12, -1)[:, j], f, **close)
        variance, least = std.reshape(12, -1)[:, j] ** 2, np.diag(K)
        np.testing.assert_allclose(variance[~widened], least[~widened], **close)
        assert (variance[widened] > least[widened]).all()


def test_theta_is_that_of_the_extended_model(extension):
    model = extension[0]
    value = model.log_marginal_likelihood_value_
    found, gradient = model.log_marginal_likelihood(model.theta_, eval_gradient=True)
    assert found == pytest.approx(value, rel=1e-10)
    assert gradient.shape == model.theta_.shape
    theta = model.theta_ + 0.01
    expected = textbook.derivative(model.log_marginal_likelihood, theta, step=1e-4)
    found = model.log_marginal_likelihood(theta, eval_gradient=True)[1]
    atol = 1e-6 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=atol)


def test_factor_and_rank(fitted, extension):
    model = extension[0]
    grown = model.rank is None and not model.diagonal
    assert model.rank_ == fitted.rank_ + grown
    assert model.get_params() == fitted.get_params()
    factors = model.task_factor_.reshape(-1, 4, model.rank_)
    for output, L in zip(outputs(model), factors, strict=True):
        K_rho = output.K_rho
        assert np.linalg.eigvalsh(K_rho)[0] > -1e-12 * np.trace(K_rho)
        rest = K_rho - L @ L.T
        rest -= np.diag(np.diag(rest)) * model.diagonal
        np.testing.assert_allclose(rest, 0.0, atol=1e-10 * np.abs(K_rho).max())


def test_number_of_hyperparameters_is_that_of_eq_8(extension):
    model, M, r = extension[0], 4, extension[0].rank_
    fixed = model.noise_variance_bounds == "fixed"
    n_noise = 0 if fixed else M if model.noise == "per_task" else 1
    of_tasks = r * (2 * M + 1 - r) // 2 + M * model.diagonal + model.task_levels
    each = 2 + of_tasks + n_noise
    assert model.n_hyperparameters_ == each * len(outputs(model))


def test_training_data_are_those_of_all_tasks(extension):
    model, X, y, position = extension
    np.testing.assert_array_equal(model.X_train_, X[:, :-1])
    np.testing.assert_array_equal(model.tasks_[model.tasks_train_], X[:, -1])
    np.testing.assert_array_equal(model.y_train_, y)
    assert model.tasks_train_[-1] == position
    assert model.complete_ is False
    assert model.n_features_in_ == 3
    assert model.n_evaluations_ > model.n_iter_ > 0


def test_the_extended_model_is_a_model(extension):
    model, X, y, _ = extension
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    assert model.sample_y(X[:4], 3).shape == (4, *y.shape[1:], 3)
    assert model.score(X, y) > 0.5
    fresh = clone(model)
    assert not hasattr(fresh, "tasks_")


def test_model_is_left_as_it_was(case, fitted):
    _, n_outputs, place, prior = case
    _, _, X_new, y_new = split(n_outputs, place)
    before, attributes = pickle.dumps(fitted), dict(vars(fitted))
    fitted.add_task(X_new, y_new, prior=prior)
    assert pickle.dumps(fitted) == before
    assert vars(fitted).keys() == attributes.keys()
    assert all(vars(fitted)[name] is value for name, value in attributes.items())


def interrupt(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("patch", [None, interrupt])
def test_model_is_left_as_it_was_by_a_failure(monkeypatch, patch):
    X, y, X_new, y_new = split()
    model = learner(rank=1).fit(X, y)
    before = pickle.dumps(model)
    if patch:
        monkeypatch.setattr(multitask, "learn_novel", patch)
    else:
        y_new = np.full_like(y_new, np.nan)
    with pytest.raises((KeyboardInterrupt, ValueError)):
        model.add_task(X_new, y_new)
    assert pickle.dumps(model) == before


def test_data_are_not_changed():
    X, y, X_new, y_new = split()
    model = learner(rank=1).fit(X, y)
    before = X_new.copy(), y_new.copy()
    model.add_task(X_new, y_new)
    np.testing.assert_array_equal(X_new, before[0])
    np.testing.assert_array_equal(y_new, before[1])


@pytest.mark.parametrize(
    "params",
    [{}, {"rank": 2, "noise": "per_task"}, {"rank": 1, "diagonal": True}, UNITS],
)
def test_the_position_of_the_task_does_not_matter(params, prior):
    Z = draw(n_tasks=4, per_task=3, seed=1)[0]
    found = []
    for place in PLACES:
        X, y, X_new, y_new = split(place=place)
        model = joining.fitted(X, y, **params).add_task(X_new, y_new, prior=prior)
        labels = np.array([*OLD, PLACES[place]])[Z[:, -1].astype(int)]
        mean, cov = model.predict(np.c_[Z[:, :-1], labels], return_cov=True)
        found.append(np.vstack([mean, cov]))
    for other in found[1:]:
        atol = 1e-8 * np.abs(found[0]).max()
        np.testing.assert_allclose(other, found[0], rtol=1e-7, atol=atol)


@pytest.mark.parametrize("diagonal", [False, True])
def test_the_likelihood_of_all_data_is_maximised(diagonal):
    """Its derivatives by the new row vanish; those by the old ones need not."""
    X, y, X_new, y_new = split(n_new=8)
    model = learner(rank=2, diagonal=diagonal).fit(X, y)
    model.set_params(tol=1e-8)
    model = model.add_task(X_new, y_new, prior=None)
    _, gradient = model.log_marginal_likelihood(model.theta_, eval_gradient=True)
    row = slice(2 + 2 * 3, 2 + 2 * 4)  # after two length-scales and three rows
    assert np.abs(gradient[row]).max() < 1e-2
    assert np.abs(gradient[: row.start]).max() > 1.0
    rng, value = np.random.default_rng(0), model.log_marginal_likelihood_value_
    for step in (1e-3, 1e-2, 0.1):
        for _ in range(20):
            theta = model.theta_.copy()
            theta[row] *= 1.0 + step * rng.standard_normal(2)
            assert model.log_marginal_likelihood(theta) < value + 1e-6


def related(seed=0, n_tasks=6, per_task=15, n_new=40, rank=2, spread=1.0):
    """Data of the model itself; the rows of the factor, the new task's last."""
    rng = np.random.default_rng(seed)
    F = 1.0 + spread * rng.normal(size=(n_tasks + 1, rank))
    tasks = np.repeat(np.arange(n_tasks + 1), [per_task] * n_tasks + [n_new])
    x = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    K = RBF([1.0, 1.5])(x) + 1e-10 * np.eye(len(x))
    z = np.linalg.cholesky(K) @ rng.standard_normal((len(x), rank))
    y = (F[tasks] * z).sum(axis=1) + 0.05 * rng.standard_normal(len(x))
    X, old = np.column_stack([x, tasks]), tasks < n_tasks
    return X[old], 20.0 * y[old], X[~old], 20.0 * y[~old], F


@pytest.mark.parametrize("seed", range(3))
def test_a_combination_of_the_tasks_is_recognised(seed):
    X, y, X_new, y_new, F = related(seed)
    weights = np.linalg.lstsq(F[:-1].T, F[-1], rcond=None)[0]
    model = MultiTaskGPRegressor(rank=2, **PAPER | {"normalize_y": False}).fit(X, y)
    old = model.task_covariance_
    for prior in ("tasks", None):
        K = model.add_task(X_new, y_new, prior=prior).task_covariance_
        close = {"atol": 0.05 * old.max()}
        np.testing.assert_allclose(K[-1, :-1], old @ weights, **close)
        np.testing.assert_allclose(K[-1, -1], weights @ old @ weights, **close)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.AmbiguousFitWarning")
def test_the_other_tasks_help_where_there_is_one_sample():
    errors = []
    for seed in range(11):
        X, y, X_new, y_new, _ = related(seed, per_task=8, spread=0.3)
        options = PAPER | {"rank": 2, "normalize_y": False, "learning": "staged"}
        model = MultiTaskGPRegressor(RBF([1.0, 1.5], "fixed"), **options).fit(X, y)
        few = X_new[:1], y_new[:1]
        extended = [model.add_task(*few, prior=prior) for prior in ("tasks", None)]
        errors.append(
            [np.square(model.predict(X_new) - y_new).mean() for model in extended]
            / y_new.var()
        )
    informed, alone = np.median(errors, axis=0)
    assert informed < 0.8 * alone
    assert np.less(*np.transpose(errors)).sum() >= 7


@pytest.mark.parametrize("rank", [2, None])
def test_one_task_after_another(rank, prior):
    X, y, X_new, y_new, _ = related(n_tasks=5, per_task=12, n_new=48)
    negative = 2.0 * y.mean() - y_new
    Z = np.column_stack([X_new[:, :2], np.full(48, 7)])
    learning = "annealed" if rank else "staged"  # which takes full rank without asking
    model = MultiTaskGPRegressor(rank=rank, learning=learning, **PAPER).fit(X, y)
    first, second = (X_new[::2], y_new[::2]), (Z[::2], negative[::2])
    one, other = (
        model.add_task(*a, prior=prior).add_task(*b, prior=prior)
        for a, b in [(first, second), (second, first)]
    )
    assert one.tasks_.tolist() == other.tasks_.tolist() == [*range(5), 5, 7]
    assert one.rank_ == (2 if rank else 7)
    for test, y_test in [(X_new, y_new), (Z, negative)]:
        here, there = one.predict(test), other.predict(test)
        assert np.square(here - y_test).mean() < 0.05 * y_test.var()
        far = 0.01 if prior else 1e-4
        assert np.square(here - there).mean() < far * y_test.var()
    if prior is None:
        value = one.log_marginal_likelihood_value_
        assert other.log_marginal_likelihood_value_ == pytest.approx(value, abs=0.01)


@pytest.mark.parametrize("params", [{"rank": 2}, {"rank": 3}, {}])
def test_a_task_with_the_samples_of_another_is_like_it(params, prior):
    X, y, *_ = split()
    model, copied = joining.fitted(X, y, **params), X[:, -1] == OLD[1]
    extended = model.add_task(X[copied] + [0.0, 0.0, 10.0], y[copied], prior=prior)
    K = extended.task_covariance_
    close = {"atol": (0.1 if prior else 0.03) * K[1, 1]}
    np.testing.assert_allclose(K[3, :3], K[1, :3], **close)
    np.testing.assert_allclose(K[3, 3], K[1, 1], **close)
    Z = draw(per_task=5, n_tasks=1, seed=1)[0]
    one, other = (extended.predict(Z + [0.0, 0.0, m]) for m in (OLD[1], OLD[1] + 10))
    np.testing.assert_allclose(other, one, atol=0.1 * y.std())


@pytest.mark.parametrize("noise", ["shared", "per_task"])
def test_a_second_task(noise, prior):
    """One task is all that is known; its noise is known too."""
    X, y = draw(n_tasks=2, per_task=10)
    first = X[:, -1] == 0
    model = learner(noise=noise).fit(X[first], y[first])
    two = model.add_task(X[~first][:5], y[~first][:5], prior=prior)
    assert two.tasks_.tolist() == [0, 1]
    expected = np.full((2,) if noise == "per_task" else (), model.noise_variance_)
    np.testing.assert_allclose(two.noise_variance_, expected, rtol=1e-12)
    assert np.shape(two.noise_variance_) == expected.shape
    rows = np.r_[np.flatnonzero(first), np.flatnonzero(~first)[:5]]
    (value,) = log_densities(two, X[rows], y[rows])
    assert two.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-8)
    three = two.add_task(X[~first][5:] + [0.0, 0.0, 1.0], y[~first][5:], prior=prior)
    assert three.rank_ == 3
    assert np.isfinite(three.predict(X)).all()


@pytest.mark.parametrize("described", [False, True])
def test_noise_of_two_rows_does_not_become_that_of_a_new_task(described):
    """Two rows do not tell a noise variance: the others count by their rows."""
    X, y = draw(n_tasks=3, per_task=12)
    keep = (X[:, -1] < 2) | (np.cumsum(X[:, -1] == 2) <= 2)
    X, y = X[keep], y[keep] + 0.1 * np.random.default_rng(0).standard_normal(keep.sum())
    X_new, y_new = np.insert(X[:4, :2], 2, 9.0, axis=1), y[:4]
    options = {"noise": "per_task", "normalize_y": "shared"}
    if described:
        X, X_new = (np.insert(of, 2, of[:, -1], axis=1) for of in (X, X_new))
        options["task_descriptors"] = [2]
    model = learner(rank=1, **options).fit(X, y)
    joined = model.add_task(X_new, y_new)
    *old, new = np.log(joined.noise_variance_)
    assert new == pytest.approx(np.average(old, weights=[12, 12, 2]))
    assert abs(new - np.mean(old)) > 0.1
    if described:  # and without any row
        (with_noise,), (without,) = (
            np.square(model.predict(X_new[:1], return_std=True, include_noise=noisy)[1])
            for noisy in (True, False)
        )
        assert np.log(with_noise - without) == pytest.approx(new)


def test_complete_data_stay_complete():
    x, y = draw(per_task=5, n_tasks=1)
    X = np.vstack([x, x + [0.0, 0.0, 1.0]])
    model = learner(rank=1).fit(X, np.append(y, 2.0 * y))
    assert model.complete_ is True
    new = x + [0.0, 0.0, 2.0]
    assert model.add_task(new, -y).complete_ is True
    assert model.add_task(new[:4], -y[:4]).complete_ is False


def test_too_few_iterations_are_reported():
    X, y, X_new, y_new = split()
    model = learner(rank=2).fit(X, y).set_params(max_iter=1)
    with pytest.warns(ConvergenceWarning, match=r"likelihood was .* max_iter=1 itera"):
        model.add_task(X_new, y_new)


@pytest.mark.filterwarnings("error")
def test_without_iterations_the_best_start_is_kept():
    X, y, X_new, y_new = split()
    model = learner(rank=2).set_params(max_iter=0).fit(X, y)
    extended = model.add_task(X_new, y_new)
    assert extended.n_iter_ == 0
    assert extended.n_evaluations_ == 5  # three rows, their mean, least squares
