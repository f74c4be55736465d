"""The fitted model, its predictions, and the course of fit."""

from functools import partial

import numpy as np
import pytest
import textbook
from multitask_models import MODELS, PAPER, QUICK, SHARED, learned
from samples import draw, log_densities, outputs, posteriors, split
from scipy.stats import multivariate_normal
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp.inference import posterior

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(params=[None, 2], ids=["one output", "two outputs"])
def n_outputs(request):
    return request.param


@pytest.fixture
def data(n_outputs):
    return draw(n_outputs=n_outputs)


@pytest.fixture(params=MODELS)
def model(request, n_outputs, certain_theta):
    return learned(request.param, n_outputs)


@pytest.fixture(scope="module")
def fitted():
    """A model that tests share and leave alone."""
    with pytest.warns(ConvergenceWarning):
        return MultiTaskGPRegressor(rank=2, **PAPER, **QUICK).fit(*draw())


def test_attributes_reproduce_the_likelihood(model, data):
    X, y = data
    expected = log_densities(model, X, y)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-9)
    assert model.log_marginal_likelihood_value_ == pytest.approx(np.sum(expected))
    assert model.log_marginal_likelihood() == pytest.approx(np.sum(expected))
    assert type(model.log_marginal_likelihood_value_) is float


def test_attributes_reproduce_the_likelihood_of_scipy():
    X, y = draw()
    model = MultiTaskGPRegressor(rank=2, **PAPER, **QUICK).fit(X, y)
    x, t = split(X)
    K = model.task_covariance_[np.ix_(t, t)] * model.kernel_(x)
    K += model.noise_variance_ * np.eye(len(y))
    expected = multivariate_normal(cov=K).logpdf(y - model.y_mean_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(expected, rel=1e-9)


def test_attributes_reproduce_the_predictions(model, data):
    X, y = data
    Z, _ = draw(per_task=4, seed=1)
    expected = posteriors(model, X, y, Z)
    mean, std = model.predict(Z, return_std=True)
    _, cov = model.predict(Z, return_cov=True)
    assert mean.shape == std.shape == (len(Z), *y.shape[1:])
    assert cov.shape == (len(Z), len(Z), *y.shape[1:])
    np.testing.assert_array_equal(mean, model.predict(Z))
    means, stds = mean.reshape(len(Z), -1), std.reshape(len(Z), -1)
    covs = cov.reshape(len(Z), len(Z), -1)
    for j, (f, K) in enumerate(expected):
        close = {"rtol": 1e-7, "atol": 1e-9 * np.abs(K).max()}
        np.testing.assert_allclose(means[:, j], f, **close)
        np.testing.assert_allclose(covs[..., j], K, **close)
        np.testing.assert_allclose(stds[:, j] ** 2, np.diag(K), **close)


def test_uncertainty_of_an_observation(model):
    Z, _ = draw(per_task=2, seed=1)
    (_, std), (_, noisy) = [
        model.predict(Z, return_std=True, include_noise=flag) for flag in (False, True)
    ]
    (_, cov), (_, noisy_cov) = [
        model.predict(Z, return_cov=True, include_noise=flag) for flag in (False, True)
    ]
    tasks = split(Z)[1]
    noise = [np.broadcast_to(part.noise, 3)[tasks] for part in outputs(model)]
    added = np.squeeze(np.transpose(noise)) if std.ndim == 1 else np.transpose(noise)
    np.testing.assert_allclose(noisy**2 - std**2, added, rtol=1e-6)
    rows = np.arange(len(Z))
    cov[rows, rows] += added
    np.testing.assert_allclose(noisy_cov, cov)


def n_kappa(model):
    """Numbers of the diagonal of K^rho."""
    return {False: 0, True: 3, "equal": 1}[model.diagonal_]


def test_form_is_the_one_asked_for(model):
    for name in "rank", "shared", "diagonal":
        if model.rank is not None:
            assert getattr(model, f"{name}_") == getattr(model, name)


def test_factor_is_a_lower_trapezoid_of_the_task_covariance(model):
    rank = model.rank_
    n_outputs = len(outputs(model))
    factors = model.task_factor_.reshape(n_outputs, 3, rank)
    for output, L in zip(outputs(model), factors, strict=True):
        K_rho = output.K_rho
        assert (L[np.triu_indices(3, 1, rank)] == 0.0).all()
        assert (np.diagonal(L) >= 0.0).all()
        rest = K_rho - L @ L.T
        rest -= model.shared_ * rest[0, 1]
        assert (np.diag(rest) > 0.0).all() or not model.diagonal_
        rest -= np.diag(np.diag(rest)) * bool(model.diagonal_)
        np.testing.assert_allclose(rest, 0.0, atol=1e-10 * np.abs(K_rho).max())


def test_theta_is_as_documented(model):
    rank, n_outputs = model.rank_, len(outputs(model))
    scales = np.reshape(model.y_scale_, (n_outputs, -1))
    if not model.normalize_y:
        square = np.square(model.y_train_).mean(axis=0)
        scales = np.sqrt(square).reshape(n_outputs, 1)
    parts = np.split(model.theta_, n_outputs)
    n_noise = 3 if model.noise_ == "per_task" else 1
    n_levels = int(model.task_levels)
    sizes = int(model.shared_), n_kappa(model), n_levels, n_noise
    for theta, scale, output in zip(parts, scales, outputs(model), strict=True):
        ends = np.cumsum([output.kernel.n_dims, 3 * rank, *sizes])
        kernel, F, log_a, log_kappa, log_level, log_noise, rest = np.split(theta, ends)
        assert not len(rest)
        np.testing.assert_allclose(kernel, output.kernel.theta, rtol=1e-12)
        kappa = np.broadcast_to(np.exp(log_kappa), 3) if len(log_kappa) else None
        K_rho = textbook.low_rank(F.reshape(3, rank), kappa) + np.exp(log_a).sum()
        scales = np.broadcast_to(scale, 3)
        K_rho *= np.multiply.outer(scales, scales)
        close = {"atol": 1e-12 * np.square(scale).max()}
        np.testing.assert_allclose(output.K_rho, K_rho, **close)
        np.testing.assert_allclose(output.noise, np.exp(log_noise) * scale**2)
        level = np.exp(log_level) if model.task_levels else np.zeros(1)
        np.testing.assert_allclose(output.level, level * scale**2)


def test_number_of_hyperparameters_is_that_of_eq_8(model):
    M, r = 3, model.rank_
    per_output = (
        outputs(model)[0].kernel.n_dims
        + r * (2 * M + 1 - r) // 2
        + model.shared_
        + n_kappa(model)
        + model.task_levels
        + (M if model.noise_ == "per_task" else 1)
    )
    assert model.n_hyperparameters_ == per_output * len(outputs(model))


def test_gradient_of_the_likelihood(model):
    away = 0.1 * np.random.default_rng(0).standard_normal(len(model.theta_))
    theta = np.clip(model.theta_, -8.0, 8.0) + away
    value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == pytest.approx(model.log_marginal_likelihood(theta), rel=1e-12)
    expected = textbook.derivative(model.log_marginal_likelihood, theta)
    atol = 1e-6 * np.abs(expected).max()
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=atol)


def test_single_and_several_outputs_are_the_same_models():
    X, Y = draw(n_outputs=2)
    model = MultiTaskGPRegressor(rank=2, **SHARED, **QUICK)
    both, Z = clone(model).fit(X, Y), draw(seed=1)[0]
    for j, y in enumerate(Y.T):
        alone = clone(model).fit(X, y)
        assert alone.log_marginal_likelihood_value_ == pytest.approx(
            both.log_marginal_likelihoods_[j]
        )
        np.testing.assert_allclose(alone.predict(Z), both.predict(Z)[:, j])


@pytest.mark.parametrize("block_size", [1, 75])
def test_prediction_in_blocks(monkeypatch, fitted, block_size):
    Z, _ = draw(per_task=7, seed=1)
    mean, std = fitted.predict(Z, return_std=True)
    monkeypatch.setattr(posterior, "BLOCK_SIZE", block_size)
    (of_output,), sizes = fitted._posteriors, []
    explained = of_output.explained

    def counted(X, tasks):
        sizes.append(len(X))
        return explained(X, tasks)

    monkeypatch.setattr(of_output, "explained", counted)
    blocks = fitted.predict(Z, return_std=True)
    np.testing.assert_allclose(blocks, [mean, std], rtol=1e-7)
    assert max(sizes) == max(1, block_size // 30)


@pytest.mark.parametrize("noise", [False, True], ids=["of f", "with noise"])
def test_moments_of_samples(model, noise):
    Z, n = draw(per_task=1, seed=1)[0], 20_000
    mean, cov = model.predict(Z, return_cov=True, include_noise=noise)
    samples = model.sample_y(Z, n, random_state=0, include_noise=noise)
    assert samples.shape == (*mean.shape, n)
    std = np.sqrt(np.diagonal(cov).T)
    assert (np.abs(samples.mean(axis=-1) - mean) < 5.0 * std / np.sqrt(n)).all()
    means, covs = mean.reshape(3, -1), cov.reshape(3, 3, -1)
    for j in range(means.shape[1]):
        found = np.cov(samples.reshape(3, -1, n)[:, j])
        atol = 0.05 * np.abs(covs[..., j]).max()
        np.testing.assert_allclose(found, covs[..., j], atol=atol)


def test_samples_depend_on_the_random_state_only(fitted):
    Z = draw(per_task=2, seed=1)[0]
    first, again, other = (fitted.sample_y(Z, 3, random_state=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


@pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP, SingleTaskGP])
@pytest.mark.parametrize("n_outputs", [None, 2])
def test_noise_of_samples_is_of_their_task(cls, n_outputs):
    X, y = draw(n_outputs=n_outputs)
    scale, options = 1.0 + 10.0 * X[:, -1], {"noise": "per_task"}
    model = cls(max_iter=5, **(options if cls is not SingleTaskGP else {}))
    model.fit(X, (y.T * scale).T)
    n = 4000
    plain, noisy, again = (
        model.sample_y(X[:6], n, include_noise=flag) for flag in (False, True, True)
    )
    np.testing.assert_array_equal(noisy, again)
    var, total = (
        np.square(model.predict(X[:6], return_std=True, include_noise=flag)[1])
        for flag in (False, True)
    )
    assert len(np.unique((total - var).round(9))) > 1
    noise = noisy - plain
    assert (np.abs(noise.mean(axis=-1)) < 5.0 * np.sqrt((total - var) / n)).all()
    np.testing.assert_allclose(noise.var(axis=-1), total - var, rtol=0.15)


def test_samples_of_large_targets_at_repeated_inputs():
    X, y = draw()
    model = MultiTaskGPRegressor(max_iter=0).fit(X, 1e9 * y)
    samples = model.sample_y(X[[0, 0, 0, 1, 1]], 4)
    assert np.ptp(samples[:3], axis=0).max() < 1e-5 * np.abs(samples).max()


def test_default_kernel_is_scaled_to_the_features():
    X, y = draw()
    X[:, 0] *= 1e4
    model = MultiTaskGPRegressor(max_iter=0).fit(X, y)
    expected = X[:, :2].std(axis=0) * np.sqrt(2)
    np.testing.assert_allclose(model.kernel_.length_scale, expected)


def test_noise_that_is_fixed():
    X, y = draw()
    model = MultiTaskGPRegressor(
        rank=3, noise_variance=0.05, noise_variance_bounds="fixed", **QUICK
    ).fit(X, y)
    assert model.noise_variance_ == pytest.approx(0.05 * y.var())
    assert model.n_hyperparameters_ == 2 + 6 + 1
    assert model.n_iter_ > 0


@pytest.mark.parametrize("normalize_y", [False, True])
def test_noise_stays_within_its_bounds(normalize_y):
    X, y = draw()
    model = MultiTaskGPRegressor(
        normalize_y=normalize_y,
        noise_variance=0.6,
        noise_variance_bounds=(0.5, 1.0),
        **QUICK,
    ).fit(X, y)
    assert model.noise_variance_ == pytest.approx(0.5 * y.var())


def test_mean_and_scale():
    X, Y = draw(n_outputs=2)
    model = MultiTaskGPRegressor(max_iter=0, task_levels=False).fit(X, Y)
    np.testing.assert_allclose(model.y_mean_, Y.mean(axis=0))
    np.testing.assert_allclose(model.y_scale_, Y.std(axis=0))
    model.set_params(normalize_y=False).fit(X, Y[:, 0])
    assert (model.y_mean_, model.y_scale_) == (0.0, 1.0)


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.ConstantTargetWarning")
def test_constant_targets_are_predicted():
    X, y = draw()
    model = MultiTaskGPRegressor(max_iter=5).fit(X, np.full_like(y, 3.0))
    np.testing.assert_allclose(model.predict(X), 3.0, rtol=1e-6)


@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, IndependentGP, PooledGP])
def test_targets_of_any_scale_without_normalisation(estimator):
    rng = np.random.default_rng(0)
    if estimator is MultiTaskGPRegressor:
        estimator = partial(estimator, rank=1, learning="staged")
    x, task = rng.uniform(0.0, 6.0, 45), np.repeat([0, 1, 2], 15)
    X, y = np.column_stack([x, task]), np.sin(x) + 0.01 * rng.standard_normal(45)
    one = estimator(normalize_y=False).fit(X, y)
    for scale in (1e-3, 1e5):
        other = estimator(normalize_y=False).fit(X, scale * y)
        assert other.y_scale_ == 1.0
        np.testing.assert_allclose(other.predict(X), scale * one.predict(X), rtol=1e-4)
        change_of_units = -len(y) * np.log(scale)
        assert other.log_marginal_likelihood_value_ == pytest.approx(
            one.log_marginal_likelihood_value_ + change_of_units, abs=1e-3
        )


def test_constant_target_that_is_not_exact_in_binary():
    model = MultiTaskGPRegressor().fit([[0.0, 0], [1.0, 0], [2.0, 1]], [0.1] * 3)
    assert model.y_scale_ == 1.0
    np.testing.assert_allclose(model.predict([[0.5, 1]]), 0.1)


def complete(n_inputs=7, n_tasks=3, seed=0):
    """Every task at the same inputs, task by task: y = vec of a matrix."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.0, 2.0, (n_inputs, 2))
    T = np.column_stack([np.sin(x[:, 0]), x[:, 1]]) @ rng.normal(size=(2, n_tasks))
    y = 5.0 + 20.0 * (T + 0.1 * rng.standard_normal(T.shape)).T.ravel()
    tasks = np.repeat(np.arange(n_tasks), n_inputs)
    return np.column_stack([np.tile(x, (n_tasks, 1)), tasks]), y


class TestCompleteData:
    """Section 2.3: "one can exploit the Kronecker-product structure [3, eq. 2]"."""

    @pytest.mark.parametrize(
        "options",
        [{}, {"rank": 1}, {"rank": 2, "diagonal": True}, {"task_levels": True}],
    )
    def test_kronecker_product(self, options):
        """Sigma = K^rho (x) K^x + sigma^2 I, f-bar = (k^f_l (x) k^x_*)^T Sigma^-1 y."""
        X, y = complete()
        order = np.random.default_rng(1).permutation(len(y))  # any order of the rows
        model = MultiTaskGPRegressor(**PAPER | options, **QUICK)
        model.fit(X[order], y[order])
        assert model.complete_ is True
        x, K_rho, level = X[:7, :2], model.task_covariance_, model.level_variance_
        Sigma = np.kron(K_rho, model.kernel_(x)) + model.noise_variance_ * np.eye(21)
        Sigma += level * np.kron(np.eye(3), np.ones((7, 7)))
        centred = y - model.y_mean_
        value = textbook.log_marginal_likelihood(Sigma, centred)
        assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-9)
        Z, _ = draw(per_task=2, seed=1)
        mean, std = model.predict(Z, return_std=True)
        for z, task, f, s in zip(*split(Z), mean, std, strict=True):
            k = np.kron(K_rho[task], model.kernel_(x, z[None])[:, 0])
            k += level * np.repeat(np.arange(3) == task, 7)
            f_bar = k @ np.linalg.solve(Sigma, centred)
            np.testing.assert_allclose(f - model.y_mean_, f_bar, rtol=1e-6)
            prior = K_rho[task, task] * model.kernel_(z[None]).item() + level
            variance = prior - k @ np.linalg.solve(Sigma, k)
            np.testing.assert_allclose(s**2, variance, atol=1e-8 * prior)

    @pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP, PooledGP])
    def test_attribute(self, cls):
        X, y = complete()
        model = cls(max_iter=0)
        assert model.fit(X, y).complete_ is True
        assert model.fit(X[:-1], y[:-1]).complete_ is False
        again = np.vstack([X, X[:1]]), np.append(y, y[0])
        assert model.fit(*again).complete_ is False
        assert model.fit(X[:7], y[:7]).complete_ is True  # one task


@pytest.mark.parametrize(
    ("n_tasks", "rows", "expected"),
    [(3, 8, 3), (3, 7, 2), (6, 2, 1), (6, 14, 6), (1, 3, 1)],
)
def test_the_default_rank_is_what_the_rows_can_tell(n_tasks, rows, expected):
    """Four rows for each number of the task covariance; M (M + 1) / 2 of full rank."""
    rng = np.random.default_rng(0)
    X = np.column_stack(
        [rng.normal(size=n_tasks * rows), np.repeat(range(n_tasks), rows)]
    )
    y = rng.normal(size=len(X))
    model = MultiTaskGPRegressor(max_iter=0).fit(X, y)
    assert model.rank_ == expected
    assert MultiTaskGPRegressor(rank=n_tasks, max_iter=0).fit(X, y).rank_ == n_tasks


@pytest.mark.parametrize(("common", "expected"), [(True, 0), (False, 1)])
def test_tasks_of_few_rows_share_a_function_if_bic_says_so(common, expected):
    rng = np.random.default_rng(0)
    tasks = np.repeat(np.arange(12), 6)
    x = rng.uniform(0.0, 6.0, 72)
    slopes = np.ones(12) if common else np.tile([1.0, -1.0, 2.0], 4)
    y = slopes[tasks] * np.sin(x) + 0.1 * rng.standard_normal(72)
    X = np.column_stack([x, tasks])
    model = MultiTaskGPRegressor().fit(X, y)
    assert model.rank_ == expected
    assert model.get_params()["rank"] is None
    new = np.column_stack([x, np.full(72, 99)])
    with pytest.raises(ValueError, match=r"Unknown task 99.* shared=True"):
        model.predict(new)  # nobody asked for it
    if common:
        joined = model.add_task(new[:3], y[:3])
        assert joined.rank_ == 0
        np.testing.assert_allclose(joined.predict(new), np.sin(x), atol=0.3)
        model.set_params(shared=True, rank=0).fit(X, y)
        np.testing.assert_allclose(model.predict(new), np.sin(x), atol=0.3)
