"""Estimators whose hyperparameters are drawn, or have weak priors."""

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, Matern
from waves import draw

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.exceptions import (
    FixedCorrelationWarning,
    InsufficientMemoryError,
    SamplingWarning,
)
from skmtgp.learning import sampling
from skmtgp.learning.sampling import N_CHAINS

pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
SAMPLED = {"hyperparameters": "sampled", "n_draws": 8}


X, y = draw()
Z = np.column_stack([np.linspace(0.0, 7.0, 6), [0, 1, 2, 0, 1, 2]])
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **SAMPLED),
    "independent": IndependentGP(**SAMPLED),
    "pooled": PooledGP(**SAMPLED),
    "single": SingleTaskGP(**SAMPLED),
}


@pytest.fixture(scope="module")
def model():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        return MultiTaskGPRegressor(rank=1, random_state=0, **SAMPLED).fit(X, y)


@pytest.fixture(scope="module")
def mode():
    """The same without draws."""
    return MultiTaskGPRegressor(rank=1).fit(X, y)


@pytest.fixture(scope="module", params=MODELS.values(), ids=MODELS)
def any_model(request):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        return clone(request.param).fit(X, y)


def test_predictions_are_those_of_the_mixture(any_model):
    model = any_model
    means, variances = model._components(Z[:, :1], Z[:, 1].astype(int), True)
    assert len(means) == 8
    assert np.ptp(means, axis=0).max() > 0.0
    mean, std = model.predict(Z, return_std=True, include_noise=True)
    np.testing.assert_allclose(mean, means[..., 0].mean(axis=0))
    second = (variances + means**2).mean(axis=0)[:, 0]
    np.testing.assert_allclose(std**2, second - mean**2, rtol=1e-8)
    _, cov = model.predict(Z, return_cov=True, include_noise=True)
    np.testing.assert_allclose(np.diagonal(cov), std**2, rtol=1e-8)


def test_attributes_are_those_of_the_mode(any_model):
    sampled = any_model
    mode = clone(sampled).set_params(hyperparameters="mode").fit(X, y)
    np.testing.assert_array_equal(sampled.theta_, mode.theta_)
    value = mode.log_marginal_likelihood_value_
    assert sampled.log_marginal_likelihood_value_ == value
    assert sampled.n_hyperparameters_ == mode.n_hyperparameters_


def test_what_was_drawn(model, mode):
    assert model.theta_samples_.shape == (8, len(model.theta_))
    assert model.effective_sample_size_ > 0.0
    assert model.r_hat_ >= 1.0
    assert model.n_divergences_ >= 0
    n_trajectories = N_CHAINS * (sampling.N_WARM + 2 * sampling.THINNED)
    assert model.n_evaluations_ > mode.n_evaluations_ + n_trajectories
    for name in ("theta_samples_", "effective_sample_size_", "r_hat_"):
        assert not hasattr(mode, name)


def test_each_draw_predicts_as_its_posterior(model):
    likelihood = model._likelihoods[0]
    posterior = likelihood.posterior(model.theta_samples_[3])
    rows = Z[:, :1], Z[:, 1].astype(int)
    means, variances = model._components(*rows, False)
    centre, scale = model.y_mean_, model.y_scale_
    np.testing.assert_allclose(means[3, :, 0], posterior.mean(*rows) * scale + centre)
    np.testing.assert_allclose(variances[3, :, 0], posterior.variance(*rows) * scale**2)


def test_draws_of_f_have_the_moments_of_predictions(model):
    mean, std = model.predict(Z, return_std=True)
    draws = model.sample_y(Z, 4000, random_state=1)
    np.testing.assert_allclose(draws.mean(axis=1), mean, atol=0.1 * std.max())
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=0.15)


def test_draws_of_observations_have_the_quantiles_of_the_mixture(model):
    """Which is no normal distribution."""
    far = np.array([[20.0, 1.0]])
    lower, upper = model.predict_interval(far, 0.98)
    draws = model.sample_y(far, 20_000, random_state=0, include_noise=True)[0]
    assert np.mean(draws < lower) == pytest.approx(0.01, abs=0.004)
    assert np.mean(draws > upper) == pytest.approx(0.01, abs=0.004)


def test_the_same_seed_the_same_model(model):
    again = clone(model).fit(X, y)
    np.testing.assert_array_equal(again.theta_samples_, model.theta_samples_)
    other = clone(model).set_params(random_state=1).fit(X, y)
    assert (other.theta_samples_ != model.theta_samples_).any()
    quick = clone(model).set_params(random_state=None, learning="staged")
    of_none = [clone(quick).fit(X, y) for _ in range(2)]
    np.testing.assert_array_equal(*(of.theta_samples_ for of in of_none))


def test_leaving_out_samples(model):
    mean, std = model.loo_predict(include_noise=True)
    assert mean.shape == std.shape == y.shape
    _, of_f = model.loo_predict()
    assert (of_f < std).all()


def test_levels_have_more_doubt_than_at_the_mode(model, mode):
    assert (model.task_level_std_ > 0.0).all()
    np.testing.assert_allclose(model.task_level_, mode.task_level_, atol=1.5)


def test_pickles_predict_the_same(model):
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(Z), model.predict(Z))


def test_a_task_joins(model, mode):
    new = np.array([[1.0, 7.0], [4.0, 7.0]])
    joined = model.add_task(new, 7.0 - np.sin(new[:, 0]))
    assert joined.theta_samples_.shape[0] == 8
    assert joined.theta_samples_.shape[1] == len(joined.theta_)
    assert joined.effective_sample_size_ == model.effective_sample_size_
    mean, std = joined.predict([[2.0, 7.0]], return_std=True)
    assert np.isfinite([mean, std]).all()
    # the rows that join are drawn, not climbed to
    of_mode = mode.add_task(new, 7.0 - np.sin(new[:, 0]))
    assert std > of_mode.predict([[2.0, 7.0]], return_std=True)[1]
    np.testing.assert_array_equal(model.tasks_, [0, 1, 2])
    assert model.theta_samples_.shape[1] == len(model.theta_)


def test_a_task_joins_without_a_prior(model):
    joined = model.add_task([[1.0, 7.0], [4.0, 7.0], [5.0, 7.0]], [1, 0, 1], prior=None)
    assert np.isfinite(joined.predict([[2.0, 7.0]])).all()


@pytest.mark.parametrize("inference", ["dense", "kronecker", "sparse"])
def test_every_engine(inference):
    x, task = np.tile(np.linspace(0.0, 6.0, 8), 3), np.repeat([0, 1, 2], 8)
    complete = np.column_stack([x, task])
    t = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
    t += 0.2 * np.random.default_rng(0).standard_normal(24)
    options = {"inference": inference, "n_inducing": 8, **SAMPLED}
    model = MultiTaskGPRegressor(rank=1, **options).fit(complete, t)
    mean, std = model.predict(Z, return_std=True)
    assert np.isfinite(mean).all()
    assert (std > 0.0).all()


def test_dense_and_kronecker_draw_the_same():
    """Of the same posterior by the same seed, but for rounding."""
    x, task = np.tile(np.linspace(0.0, 6.0, 7), 2), np.repeat([0, 1], 7)
    rows = np.column_stack([x, task])
    t = np.where(task, -1.0, 2.0) * np.sin(x)
    t += 0.2 * np.random.default_rng(0).standard_normal(14)
    found = [
        MultiTaskGPRegressor(rank=1, inference=inference, **SAMPLED).fit(rows, t)
        for inference in ("dense", "kronecker")
    ]
    spread = found[0].theta_samples_.std(axis=0).max()
    means = [of.predict(Z[Z[:, 1] < 2]) for of in found]
    np.testing.assert_allclose(*means, atol=0.5 * spread)


def test_several_outputs():
    rows, Y = draw(n_outputs=2)
    model = MultiTaskGPRegressor(rank=1, **SAMPLED).fit(rows, Y)
    mean, std = model.predict(Z, return_std=True, include_noise=True)
    assert mean.shape == std.shape == (6, 2)
    assert model.theta_samples_.shape == (8, len(model.theta_))
    with pytest.warns(FixedCorrelationWarning, match="-1 or 1 for rank 1.*rank=2"):
        lower, upper = model.task_correlation_interval()
    assert np.isin(np.round([lower, upper], 6), [-1.0, 1.0]).all()
    assert lower.index.names == ["output", "task"]
    assert (lower <= upper).all(axis=None)
    mean, std = model.predict(Z, return_std=True)
    draws = model.sample_y(Z, 2000, random_state=0)
    assert draws.shape == (6, 2, 2000)
    np.testing.assert_allclose(draws.mean(axis=2), mean, atol=0.1 * std.max())


def test_own_noise_and_units():
    rows, t = draw(rows=10)
    t = t * np.array([1.0, 100.0, 1.0])[rows[:, 1].astype(int)]
    options = {"noise": "per_task", "normalize_y": "per_task", **SAMPLED}
    model = MultiTaskGPRegressor(rank=1, **options).fit(rows, t)
    _, of_f = model.predict(Z, return_std=True)
    _, of_y = model.predict(Z, return_std=True, include_noise=True)
    noise = of_y**2 - of_f**2
    np.testing.assert_allclose(noise[[1, 4]], noise[1])
    assert noise[1] > 100.0 * noise[0]


class TestCorrelationInterval:
    @pytest.mark.long
    @pytest.mark.usefixtures("long_chains")
    def test_of_related_and_of_unrelated_tasks(self):
        rng = np.random.default_rng(0)
        x, task = rng.uniform(0.0, 12.0, 90), np.repeat(["a", "b", "c"], 30)
        t = np.where(task == "b", -np.sin(x), np.sin(x))
        t = np.where(task == "c", np.cos(1.7 * x + 1.0), t)
        t = t + 0.1 * rng.standard_normal(90)
        options = {"rank": 2, "hyperparameters": "sampled", "n_draws": 40}
        frame = pd.DataFrame({"x": x, "task": task})
        model = MultiTaskGPRegressor(task_feature="task", **options).fit(frame, t)
        lower, upper = model.task_correlation_interval(0.9)
        assert upper.loc["a", "b"] < -0.5
        assert lower.loc["a", "c"] < 0.0 < upper.loc["a", "c"]
        np.testing.assert_allclose(np.diagonal(lower), 1.0)
        narrow, _ = model.task_correlation_interval(0.2)
        assert (narrow >= lower - 1e-12).all(axis=None)

    def test_needs_draws(self, mode):
        with pytest.raises(ValueError, match="hyperparameters='sampled'"):
            mode.task_correlation_interval()

    @pytest.mark.parametrize("rank", [(1, 1), (2, 1)])
    def test_several_kernels_have_no_draws(self, rank):
        kernels = [RBF(1.0), Matern(0.5, nu=2.5)]
        model = MultiTaskGPRegressor(kernels, rank=rank, max_iter=0).fit(X, y)
        with pytest.raises(ValueError, match="several kernels do not have"):
            model.task_correlation_interval()

    @pytest.mark.parametrize("level", [0.0, 1.0, 95, "a", None])
    def test_level(self, model, level):
        with pytest.raises(ValueError, match=f"level={level!r} must be one number"):
            model.task_correlation_interval(level)


class TestSearch:
    def test_draws_at_the_rank_that_was_chosen(self):
        search = RankSearchIC(MultiTaskGPRegressor(**SAMPLED), ranks=(0, 1)).fit(X, y)
        mode = RankSearchIC(ranks=(0, 1)).fit(X, y)
        assert search.best_rank_ == mode.best_rank_
        pd.testing.assert_frame_equal(
            search.results_.drop(columns="fit_time"),
            mode.results_.drop(columns="fit_time"),
        )
        assert search.best_estimator_.theta_samples_.shape[0] == 8
        with pytest.warns(FixedCorrelationWarning):
            assert len(search.task_correlation_interval()) == 2

    def test_single_tasks_are_drawn_if_chosen(self):
        """By tasks that differ in length-scale, and in nothing alike."""
        rng = np.random.default_rng(0)
        x, task = rng.uniform(0.0, 6.0, 80), np.repeat(np.arange(4), 20)
        t = 0.05 * rng.standard_normal(80)
        for m, length in enumerate((0.3, 4.0, 0.3, 4.0)):
            rows = task == m
            away = x[rows, None] - x[rows]
            K = np.exp(-0.5 * (away / length) ** 2) + 1e-9 * np.eye(20)
            t[rows] += np.linalg.cholesky(K) @ rng.standard_normal(20) + m
        options = {"noise": "shared", "normalize_y": "shared"}
        estimator = MultiTaskGPRegressor(**options, **SAMPLED)
        search = RankSearchIC(estimator, ranks=(0, 1), simpler=True)
        search.fit(np.column_stack([x, task]), t)
        assert search.best_model_ == "single tasks"
        for estimator in search.best_estimator_.estimators_:
            assert estimator.theta_samples_.shape[0] == 8


@pytest.mark.long
@pytest.mark.usefixtures("long_chains")
def test_few_rows_are_covered_where_the_mode_is_certain():
    """Of data drawn from the model: 40 test points of each of four draws.

    "known" takes the hyperparameters of the mode for certain.
    """
    shares, covered = {"mode": [], "sampled": [], "known": []}, norm.ppf(0.975)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        x, task = rng.uniform(0.0, 8.0, 55), np.arange(55) % 3
        K = np.exp(-0.5 * (x[:, None] - x) ** 2) * np.cos(task[:, None] - task)
        f = rng.multivariate_normal(np.zeros(55), K, check_valid="ignore")
        t, rows = f + 0.2 * rng.standard_normal(55), np.column_stack([x, task])
        for name in ("sampled", "mode"):
            model = MultiTaskGPRegressor(rank=2, hyperparameters=name, n_draws=20)
            model.fit(rows[:15], t[:15])
            mean, std = model.predict(rows[15:], return_std=True, include_noise=True)
            away = np.abs(t[15:] - mean) / std
            shares[name].append(np.mean(away < covered))
        known = away * np.sqrt(model.variance_factor_) < covered
        shares["known"].append(np.mean(known))
    held = {name: np.mean(found) for name, found in shares.items()}
    assert held["known"] < 0.75
    assert held["known"] + 0.05 < held["mode"] < held["sampled"] - 0.05


class TestWarning:
    def test_says_how_poor_the_chains_are(self):
        few = MultiTaskGPRegressor(rank=2, hyperparameters="sampled", n_draws=4)
        with pytest.warns(
            SamplingWarning, match="smallest effective sample size"
        ) as caught:
            few.fit(X, y)
        assert "R-hat" in str(caught[0].message)
        assert "helps: a lower rank, narrower" in str(caught[0].message)

    @pytest.mark.parametrize("model", [IndependentGP(), SingleTaskGP()])
    def test_advises_no_rank_to_models_without_one(self, model):
        few = clone(model).set_params(hyperparameters="sampled", n_draws=4)
        with pytest.warns(SamplingWarning, match="helps: narrower bounds"):
            few.fit(X, y)

    @pytest.mark.usefixtures("long_chains")
    def test_none_where_they_are_good(self):
        rows, t = draw(rows=30)
        model = IndependentGP(hyperparameters="sampled", n_draws=60)
        with warnings.catch_warnings():
            warnings.simplefilter("error", SamplingWarning)
            model.fit(rows, t)
        assert model.effective_sample_size_ > 50
        assert model.r_hat_ < 1.2


class TestMap:
    def test_noise_that_few_rows_would_learn_away_stays(self):
        rows, t = draw(2, 4)
        options = {"rank": 2, "normalize_y": "shared", "noise": "shared"}
        found = [
            MultiTaskGPRegressor(**more, **options).fit(rows, t)
            for more in ({"learning": "staged"}, {"hyperparameters": "map"})
        ]
        assert found[0].noise_variance_ < 1e-5
        assert found[1].noise_variance_ > 1e-3
        values = [of.log_marginal_likelihood_value_ for of in found]
        assert values[1] < values[0]

    def test_is_a_mode_of_the_posterior(self):
        from skmtgp.model.hyperprior import Hyperprior

        model = MultiTaskGPRegressor(rank=1, hyperparameters="map", tol=1e-6).fit(X, y)
        hyperprior = Hyperprior(model._likelihoods[0].prior)
        _, gradient = model.log_marginal_likelihood(model.theta_, eval_gradient=True)
        slope = hyperprior.log_density(model.theta_)[1]
        assert np.abs(slope).max() > 0.1
        np.testing.assert_allclose(gradient, -slope, atol=0.02)

    def test_many_rows_agree_with_the_mode(self):
        rows, t = draw(rows=60)
        found = [
            MultiTaskGPRegressor(rank=1, hyperparameters=name).fit(rows, t).predict(Z)
            for name in ("mode", "map")
        ]
        np.testing.assert_allclose(*found, atol=0.05)


def test_nothing_to_draw():
    kernel = RBF(1.0, "fixed")
    options = {"noise_variance_bounds": "fixed", "normalize_y": "shared"}
    model = PooledGP(kernel, **options, **SAMPLED)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SamplingWarning)
        model.fit(X, y)
    mode = clone(model).set_params(hyperparameters="mode").fit(X, y)
    np.testing.assert_allclose(model.predict(Z), mode.predict(Z), rtol=1e-10)


class TestRefusals:
    def test_dask(self):
        da = pytest.importorskip("dask.array")
        model = MultiTaskGPRegressor(inference="sparse", hyperparameters="sampled")
        with pytest.raises(ValueError, match="needs the rows in memory"):
            model.fit(da.from_array(X), da.from_array(y))

    def test_memory_for_all_draws(self, monkeypatch):
        import skmtgp._numerics.memory as memory

        monkeypatch.setattr(memory, "available_memory", lambda: 50e6)
        model = MultiTaskGPRegressor(rank=1, hyperparameters="sampled", n_draws=10**6)
        with pytest.raises(InsufficientMemoryError):
            model.fit(X, y)

    @pytest.mark.parametrize("value", ["nuts", None, True])
    def test_words(self, value):
        with pytest.raises(ValueError, match="hyperparameters"):
            MultiTaskGPRegressor(hyperparameters=value).fit(X, y)

    def test_max_iter_0_draws_nothing(self):
        model = MultiTaskGPRegressor(max_iter=0, **SAMPLED).fit(X, y)
        assert not hasattr(model, "theta_samples_")
        assert model.hyperparameters_ == "mode"


def test_a_fit_by_the_mode_forgets_draws(model):
    again = pickle.loads(pickle.dumps(model))
    again.set_params(hyperparameters="mode", learning="staged").fit(X, y)
    assert not hasattr(again, "theta_samples_")


def test_progress(told):
    MultiTaskGPRegressor(rank=1, verbose=1, **SAMPLED).fit(X, y)
    begins, *chains = [line for line in told() if "drawing" in line]
    assert ": 4 chains from" in begins
    assert chains[-1].endswith("chain 4 of 4 is done")
