"""The fitted model, its predictions, and the course of fit."""

import pickle

import numpy as np
import pytest
import textbook
from samples import draw, log_densities, outputs, posteriors, split
from scipy.stats import multivariate_normal
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    multitask,
)
from skmtgp.exceptions import PrecisionWarning
from skmtgp.inference import posterior
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning import paper, problem, ranks
from skmtgp.learning.paper import learn_simultaneously, learn_staged
from skmtgp.learning.ranks import learn_ranks

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
QUICK = {"max_iter": 5}
MODELS = {
    "full rank": {},
    "rank 1": {"rank": 1},
    "rank 2": {"rank": 2},
    "diagonal": {"rank": 2, "diagonal": True},
    "noise of each task": {"rank": 2, "noise": "per_task"},
    "not normalised": {"rank": 2, "normalize_y": False},
    "all": {"diagonal": True, "noise": "per_task", "normalize_y": False},
    "amplitude": {"kernel": ConstantKernel(2.0) * RBF([1.0, 3.0])},
}


@pytest.fixture(params=[None, 2], ids=["one output", "two outputs"])
def data(request):
    return draw(n_outputs=request.param)


@pytest.fixture(params=MODELS.values(), ids=MODELS)
def model(request, data):
    return MultiTaskGPRegressor(**request.param, **QUICK).fit(*data)


@pytest.fixture(scope="module")
def fitted():
    """A model that tests share and leave alone."""
    with pytest.warns(ConvergenceWarning):
        return MultiTaskGPRegressor(rank=2, **QUICK).fit(*draw())


def test_attributes_reproduce_the_likelihood(model, data):
    X, y = data
    expected = log_densities(model, X, y)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-9)
    assert model.log_marginal_likelihood_value_ == pytest.approx(np.sum(expected))
    assert model.log_marginal_likelihood() == pytest.approx(np.sum(expected))
    assert type(model.log_marginal_likelihood_value_) is float


def test_attributes_reproduce_the_likelihood_of_scipy():
    X, y = draw()
    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
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
    noise = [np.broadcast_to(part[2], 3)[tasks] for part in outputs(model)]
    added = np.squeeze(np.transpose(noise)) if std.ndim == 1 else np.transpose(noise)
    np.testing.assert_allclose(noisy**2 - std**2, added, rtol=1e-6)
    rows = np.arange(len(Z))
    cov[rows, rows] += added
    np.testing.assert_allclose(noisy_cov, cov)


def test_factor_is_a_lower_trapezoid_of_the_task_covariance(model):
    rank = model.rank or 3
    assert model.rank_ == rank
    factors = model.task_factor_.reshape(-1, 3, rank)
    for (_, K_rho, *_), L in zip(outputs(model), factors, strict=True):
        assert (L[np.triu_indices(3, 1, rank)] == 0.0).all()
        assert (np.diagonal(L) >= 0.0).all()
        rest = K_rho - L @ L.T
        assert (np.diag(rest) > 0.0).all() or not model.diagonal
        rest -= np.diag(np.diag(rest)) * model.diagonal
        np.testing.assert_allclose(rest, 0.0, atol=1e-10 * np.abs(K_rho).max())


def test_theta_is_as_documented(model):
    rank, scales = model.rank_, np.atleast_1d(model.y_scale_)
    if not model.normalize_y:
        scales = np.atleast_1d(np.sqrt(np.square(model.y_train_).mean(axis=0)))
    parts = np.split(model.theta_, len(scales))
    for theta, scale, (kernel, K_rho, noise, _) in zip(
        parts, scales, outputs(model), strict=True
    ):
        d, n_noise = kernel.n_dims, np.size(noise)
        np.testing.assert_allclose(theta[:d], kernel.theta, rtol=1e-12)
        F = theta[d : d + 3 * rank].reshape(3, rank)
        kappa = np.exp(theta[d + 3 * rank : -n_noise]) if model.diagonal else None
        np.testing.assert_allclose(
            K_rho, textbook.low_rank(F, kappa) * scale**2, atol=1e-12 * scale**2
        )
        np.testing.assert_allclose(noise, np.exp(theta[-n_noise:]) * scale**2)


def test_number_of_hyperparameters_is_that_of_eq_8(model):
    M, r = 3, model.rank_
    per_output = (
        outputs(model)[0][0].n_dims
        + r * (2 * M + 1 - r) // 2
        + (M if model.diagonal else 0)
        + (M if model.noise == "per_task" else 1)
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
    model = MultiTaskGPRegressor(rank=2, **QUICK)
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


@pytest.mark.parametrize("labels", [["c", "a", "b"], [7, -1, 3]])
def test_labels_of_tasks_do_not_matter(labels):
    X, y = draw()
    Z = draw(per_task=3, seed=1)[0]

    def rename(X):
        renamed = X.astype(object)
        renamed[:, -1] = [labels[m] for m in split(X)[1]]
        return renamed

    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
    other = clone(model).fit(rename(X), y)
    assert other.tasks_.tolist() == sorted(labels)
    assert_same(model, other, model.predict(Z), other.predict(rename(Z)))


def test_order_of_rows_does_not_matter():
    X, y = draw()
    Z = draw(per_task=3, seed=1)[0]
    order = np.random.default_rng(0).permutation(len(X))
    model = MultiTaskGPRegressor(rank=2, **QUICK).fit(X, y)
    other = clone(model).fit(X[order], y[order])
    assert_same(model, other, model.predict(Z), other.predict(Z))


def assert_same(model, other, mean, other_mean):
    """To 1e-6: sums in another order, carried through ten iterations."""
    value = model.log_marginal_likelihood_value_
    assert other.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(other_mean, mean, rtol=1e-6, atol=1e-6 * np.ptp(mean))


def test_methods_change_nothing(fitted):
    before = pickle.dumps(fitted)
    Z = draw(seed=1)[0]
    fitted.predict(Z, return_std=True)
    fitted.predict(Z, return_cov=True, include_noise=True)
    fitted.sample_y(Z)
    fitted.log_marginal_likelihood(fitted.theta_ + 0.1, eval_gradient=True)
    assert pickle.dumps(fitted) == before


@pytest.mark.parametrize("n_outputs", [None, 2])
def test_data_may_change_after_fit(n_outputs):
    X, y = draw(n_outputs=n_outputs)
    model = MultiTaskGPRegressor(rank=1, max_iter=0).fit(X, y)
    before = pickle.dumps(model)
    X += 1.0
    y += 1.0
    assert pickle.dumps(model) == before


def test_kernel_may_change_after_fit():
    kernel = ConstantKernel(2.0, "fixed") * RBF([1.0, 1.0])
    model = MultiTaskGPRegressor(kernel, rank=1, max_iter=0).fit(*draw())
    X, y = draw(seed=1)
    X[:, -1] = 7

    def with_task():
        return model.add_task(X, y).predict(X)

    expected = with_task()
    model.set_params(kernel__k1__constant_value=50.0)
    np.testing.assert_array_equal(with_task(), expected)


def interrupt(*_, **__):
    raise KeyboardInterrupt


FAILURES = {
    "bad y": ({}, None, ValueError),
    "bad rank": ({"rank": 9}, None, ValueError),
    "interrupted": ({}, interrupt, KeyboardInterrupt),
}


@pytest.mark.parametrize(("params", "patch", "error"), FAILURES.values(), ids=FAILURES)
@pytest.mark.parametrize("fitted_before", [False, True])
def test_failed_fit_changes_nothing(monkeypatch, params, patch, error, fitted_before):
    X, y = draw()
    model = MultiTaskGPRegressor(max_iter=0)
    if fitted_before:
        model.fit(X, y)
    model.set_params(**params)
    before = dict(vars(model))
    if patch:
        monkeypatch.setattr(ranks, "second_stage", patch)
    elif not params:
        y = np.full_like(y, np.nan)
    with pytest.raises(error):
        model.fit(np.insert(X, 0, X[:, 0], axis=1), y)
    assert vars(model).keys() == before.keys()
    assert all(vars(model)[name] is value for name, value in before.items())


def test_pickle_and_clone(fitted):
    Z = draw(seed=1)[0]
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.predict(Z), fitted.predict(Z))
    copy = clone(fitted)
    assert copy.get_params() == fitted.get_params()
    assert not hasattr(copy, "theta_")


def test_parameters_and_repr():
    model = MultiTaskGPRegressor(RBF([1.0, 2.0]), rank=2)
    assert (
        repr(model) == "MultiTaskGPRegressor(kernel=RBF(length_scale=[1, 2]), rank=2)"
    )
    model.set_params(diagonal=True, kernel__length_scale=3.0)
    assert model.get_params()["diagonal"] is True
    assert model.kernel.length_scale == 3.0


def test_parameters_are_not_changed_by_fit():
    kernel = RBF([1.0, 2.0])
    model = MultiTaskGPRegressor(kernel, **QUICK).fit(*draw())
    assert model.kernel is kernel
    assert kernel == RBF([1.0, 2.0])
    assert model.kernel_ != kernel


def test_two_jobs_find_what_one_does():
    X, y = draw(n_outputs=2)
    one, two = (
        MultiTaskGPRegressor(rank=2, n_jobs=k, **QUICK).fit(X, y) for k in (1, 2)
    )
    np.testing.assert_allclose(two.theta_, one.theta_, rtol=1e-6, atol=1e-8)


def test_number_of_jobs_is_passed_on(monkeypatch):
    given = []

    def spy(*args, **kwargs):
        given.append(kwargs["n_jobs"])
        return learn_ranks(*args, **kwargs | {"n_jobs": 1})

    monkeypatch.setattr(multitask, "learn_ranks", spy)
    model = MultiTaskGPRegressor(max_iter=0, n_jobs=3).fit(*draw())
    RankSearchIC(model, ranks=[1]).fit(*draw())
    RankSearchIC(model, ranks=[1], n_jobs=2).fit(*draw())
    assert given == [3, 3, 2]


def test_restarts_are_drawn_from_the_random_state(monkeypatch):
    seeds = []

    def spy(*args, **kwargs):
        seeds.append(kwargs["seeds"])
        return learn_ranks(*args, **kwargs)

    monkeypatch.setattr(multitask, "learn_ranks", spy)
    model = MultiTaskGPRegressor(rank=1, n_restarts_optimizer=3, **QUICK)
    first, again, _ = (
        clone(model).set_params(random_state=s).fit(*draw()) for s in (0, 0, 1)
    )
    assert seeds[0] == seeds[1] != seeds[2]
    assert [len(set(drawn)) for drawn in seeds] == [3, 3, 3]
    np.testing.assert_array_equal(first.theta_, again.theta_)
    alone = clone(model).set_params(n_restarts_optimizer=0).fit(*draw())
    gain = first.log_marginal_likelihood_value_ - alone.log_marginal_likelihood_value_
    assert gain >= 0.0


def test_rank_that_is_no_number():
    with pytest.raises(TypeError, match="rank=True must be an int or None, not a bool"):
        MultiTaskGPRegressor(rank=True).fit(*draw())


def test_verbosity(capsys):
    model = MultiTaskGPRegressor(rank=2, max_iter=0, verbose=1).fit(*draw(n_outputs=2))
    lines = capsys.readouterr().out.splitlines()
    begin = [line.split(": log marginal likelihood ")[0] for line in lines]
    rank = [f"[skmtgp] output {j} of 2, rank 2" for j in (1, 2)]
    stages = ("the best of 2 starts", "shaken")
    assert begin == [f"{name}, {stage}" for stage in stages for name in rank]
    model.set_params(verbose=0).fit(*draw())
    assert capsys.readouterr() == ("", "")


def test_too_few_iterations_are_reported():
    model = MultiTaskGPRegressor(max_iter=2)
    with pytest.warns(
        ConvergenceWarning, match=r"output \[1, 2\] was .* max_iter=2 iterat"
    ):
        model.fit(*draw(n_outputs=2))
    assert 2 <= model.n_iter_ <= 12  # of six climbs


def test_missing_digits_are_reported(monkeypatch):
    def stalled(pairs, forms, **options):
        modes = learn_ranks(pairs, forms, **options)
        return [[m._replace(stalled=True) for m in of_output] for of_output in modes]

    monkeypatch.setattr(multitask, "learn_ranks", stalled)
    match = r"Learning of output \[1, 2\] ended for lack of digits.* See the user guide"
    with pytest.warns(PrecisionWarning, match=match):
        MultiTaskGPRegressor(rank=1).fit(*draw(n_outputs=2))


@pytest.mark.filterwarnings("error")
def test_enough_iterations_are_not_reported():
    X, y = draw()
    model = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1).fit(X, y)
    before = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, max_iter=0).fit(X, y)
    gain = model.log_marginal_likelihood_value_ - before.log_marginal_likelihood_value_
    assert gain > 1.0
    assert 0 < model.n_iter_ < model.max_iter


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("noise", ["shared", "per_task"])
def test_without_iterations_the_start_is_kept(noise):
    X, y = draw()
    kernel = RBF([0.7, 1.3])
    model = MultiTaskGPRegressor(kernel, noise=noise, noise_variance=0.05, max_iter=0)
    model.fit(X, y)
    np.testing.assert_allclose(model.kernel_.theta, kernel.theta)
    expected = np.full(3 if noise == "per_task" else (), 0.05 * y.var())
    np.testing.assert_allclose(model.noise_variance_, expected)
    assert np.shape(model.noise_variance_) == expected.shape
    assert model.n_iter_ == 0


def test_default_kernel_is_scaled_to_the_features():
    X, y = draw()
    X[:, 0] *= 1e4
    model = MultiTaskGPRegressor(max_iter=0).fit(X, y)
    expected = X[:, :2].std(axis=0) * np.sqrt(2)
    np.testing.assert_allclose(model.kernel_.length_scale, expected)


def test_noise_that_is_fixed():
    X, y = draw()
    model = MultiTaskGPRegressor(
        noise_variance=0.05, noise_variance_bounds="fixed", **QUICK
    ).fit(X, y)
    assert model.noise_variance_ == pytest.approx(0.05 * y.var())
    assert model.n_hyperparameters_ == 2 + 6
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
    model = MultiTaskGPRegressor(max_iter=0).fit(X, Y)
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
@pytest.mark.parametrize("scale", [1e-3, 1e5])
def test_targets_of_any_scale_without_normalisation(estimator, scale):
    rng = np.random.default_rng(0)
    x, task = rng.uniform(0.0, 6.0, 45), np.repeat([0, 1, 2], 15)
    X, y = np.column_stack([x, task]), np.sin(x) + 0.01 * rng.standard_normal(45)
    one = estimator(normalize_y=False).fit(X, y)
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
        "options", [{}, {"rank": 1}, {"rank": 2, "diagonal": True}]
    )
    def test_kronecker_product(self, options):
        """Sigma = K^rho (x) K^x + sigma^2 I, f-bar = (k^f_l (x) k^x_*)^T Sigma^-1 y."""
        X, y = complete()
        order = np.random.default_rng(1).permutation(len(y))  # any order of the rows
        model = MultiTaskGPRegressor(**options, **QUICK).fit(X[order], y[order])
        assert model.complete_ is True
        x, K_rho = X[:7, :2], model.task_covariance_
        Sigma = np.kron(K_rho, model.kernel_(x)) + model.noise_variance_ * np.eye(21)
        centred = y - model.y_mean_
        value = textbook.log_marginal_likelihood(Sigma, centred)
        assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-9)
        Z, _ = draw(per_task=2, seed=1)
        mean, std = model.predict(Z, return_std=True)
        for z, task, f, s in zip(*split(Z), mean, std, strict=True):
            k = np.kron(K_rho[task], model.kernel_(x, z[None])[:, 0])
            f_bar = k @ np.linalg.solve(Sigma, centred)
            np.testing.assert_allclose(f - model.y_mean_, f_bar, rtol=1e-6)
            prior = K_rho[task, task] * model.kernel_(z[None]).item()
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


LEARNERS = {
    "annealed": learn_ranks,
    "staged": learn_staged,
    "simultaneous": learn_simultaneously,
}


class TestLearning:
    @pytest.mark.parametrize("learning", LEARNERS)
    @pytest.mark.parametrize("truncation", ["eigen", "cholesky"])
    def test_learner_and_truncation_are_those_asked_for(
        self, data, monkeypatch, learning, truncation
    ):
        called = []

        def spying(name):
            def spy(pairs, forms, **options):
                called.append((name, [settings.truncation for _, settings in pairs]))
                return LEARNERS[name](pairs, forms, **options)

            return spy

        for name, learner in LEARNERS.items():
            monkeypatch.setattr(multitask, learner.__name__, spying(name))
        MultiTaskGPRegressor(learning=learning, truncation=truncation, **QUICK).fit(
            *data
        )
        assert called == [(learning, [truncation] * (data[1].size // len(data[1])))]

    def test_default(self, fitted):
        model = MultiTaskGPRegressor(
            rank=2, learning="annealed", truncation="eigen", **QUICK
        )
        np.testing.assert_array_equal(model.fit(*draw()).theta_, fitted.theta_)

    @pytest.mark.parametrize("learning", ["annealed", "staged"])
    def test_truncation_changes_where_learning_begins(self, learning):
        eigen, cholesky = (
            MultiTaskGPRegressor(rank=1, learning=learning, truncation=how, max_iter=0)
            .fit(*draw())
            .task_covariance_
            for how in ("eigen", "cholesky")
        )
        assert not np.allclose(eigen, cholesky)

    @pytest.mark.parametrize("learning", LEARNERS)
    @pytest.mark.parametrize("params", [{}, {"rank": 2, "diagonal": True}])
    def test_attributes_reproduce_the_likelihood(self, data, learning, params):
        model = MultiTaskGPRegressor(learning=learning, **params, **QUICK).fit(*data)
        expected = log_densities(model, *data)
        np.testing.assert_allclose(model.log_marginal_likelihoods_, expected, rtol=1e-9)

    @pytest.mark.parametrize("learning", LEARNERS)
    def test_random_state_determines_the_mode(self, learning):
        model = MultiTaskGPRegressor(rank=2, learning=learning, **QUICK)
        one, same, other = (
            clone(model).set_params(random_state=seed).fit(*draw()).theta_
            for seed in (0, 0, 1)
        )
        np.testing.assert_array_equal(one, same)
        assert np.array_equal(one, other) == (learning != "simultaneous")

    @pytest.mark.parametrize("learning", ["staged", "simultaneous"])
    def test_more_starts_never_hurt(self, learning):
        spent, values = [], []
        for n in (0, 1, 3):
            model = MultiTaskGPRegressor(
                rank=2,
                learning=learning,
                n_restarts_optimizer=n,
                random_state=0,
                **QUICK,
            ).fit(*draw())
            spent.append(model.n_evaluations_)
            values.append(model.log_marginal_likelihood_value_)
        assert (np.diff(spent) > 0).all()
        assert (np.diff(values) >= 0.0).all()

    def test_all_find_the_mode_where_there_is_but_one(self):
        values = [
            MultiTaskGPRegressor(rank=2, learning=learning, random_state=0)
            .fit(*draw(per_task=20))
            .log_marginal_likelihood_value_
            for learning in LEARNERS
        ]
        np.testing.assert_allclose(values, max(values), atol=0.05)

    def test_search_learns_as_its_estimator_does(self):
        for learning in LEARNERS:
            model = MultiTaskGPRegressor(
                learning=learning, truncation="cholesky", random_state=0, **QUICK
            )
            best = RankSearchIC(model, ranks=[2]).fit(*draw()).best_estimator_
            alone = clone(model).set_params(rank=2).fit(*draw())
            np.testing.assert_array_equal(best.theta_, alone.theta_)
            assert (best.learning, best.truncation) == (learning, "cholesky")

    @pytest.mark.parametrize("name", ["learning", "truncation"])
    def test_bad_value(self, name):
        model = MultiTaskGPRegressor(**{name: "bad"})
        with pytest.raises(ValueError, match=rf"'{name}' .* must be a str among"):
            model.fit(*draw())


class TestEvaluations:
    """n_evaluations_ is what fit spent: likelihoods with their gradients."""

    @pytest.fixture
    def count(self, monkeypatch):
        calls, plain = [], DenseLikelihood.value_and_grad

        def counting(self, theta):
            calls.append(len(self.y))
            return plain(self, theta)

        monkeypatch.setattr(DenseLikelihood, "value_and_grad", counting)
        return calls

    @pytest.fixture(params=[False, True], ids=["all rows", "coarse to fine"])
    def levels(self, request, monkeypatch):
        if request.param:
            monkeypatch.setattr(problem, "COARSE", 12)
            monkeypatch.setattr(problem, "COARSE_PER_TASK", 4)
            monkeypatch.setattr(problem, "REFINEMENT", 2.0)
        return request.param

    @pytest.mark.parametrize(
        "model",
        [
            MultiTaskGPRegressor(),
            MultiTaskGPRegressor(diagonal=True, noise="per_task", rank=1),
            MultiTaskGPRegressor(n_restarts_optimizer=2, random_state=0),
            MultiTaskGPRegressor(learning="staged", rank=2),
            MultiTaskGPRegressor(learning="staged", n_restarts_optimizer=2, rank=2),
            MultiTaskGPRegressor(learning="simultaneous", n_restarts_optimizer=1),
            IndependentGP(),
            PooledGP(diagonal=True),
            SingleTaskGP(),
        ],
        ids=repr,
    )
    def test_of_a_model(self, model, data, count, levels):
        model = clone(model).set_params(max_iter=8).fit(*data)
        assert model.n_evaluations_ == len(count) > 5
        whole = getattr(model, "learning", "") in ("staged", "simultaneous")
        if not isinstance(model, SingleTaskGP):  # ten rows are too few for levels
            assert (len(set(count)) > 1) == (levels and not whole)

    @pytest.mark.usefixtures("levels")
    @pytest.mark.parametrize("learning", LEARNERS)
    def test_of_a_search(self, data, count, monkeypatch, learning):
        """What the ranks share is counted for each."""
        shared = []

        def counted(plain):
            def shares(*args, **options):
                before = len(count)
                starts = plain(*args, **options)
                shared.append(len(count) - before)
                return starts

            return shares

        make_starts, hidden_starts = counted(ranks.make_starts), ranks.hidden_starts
        for module in (ranks, paper):
            monkeypatch.setattr(module, "make_starts", make_starts)
        monkeypatch.setattr(ranks, "hidden_starts", counted(hidden_starts))
        model = MultiTaskGPRegressor(learning=learning, random_state=0, max_iter=8)
        search = RankSearchIC(model, ranks=(1, 2, 3), keep_estimators=True).fit(*data)
        total = sum(model.n_evaluations_ for model in search.estimators_)
        assert total - 2 * sum(shared) == len(count)
        assert search.best_estimator_.n_evaluations_ < len(count)

    @pytest.mark.parametrize("learning", LEARNERS)
    def test_of_a_single_rank(self, data, count, learning):
        model = MultiTaskGPRegressor(learning=learning, random_state=0, max_iter=8)
        search = RankSearchIC(model, ranks=[2]).fit(*data)
        assert search.best_estimator_.n_evaluations_ == len(count)
