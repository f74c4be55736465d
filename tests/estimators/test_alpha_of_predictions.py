"""`alpha` of new observations, in intervals and densities."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_rows import ALPHA, NEW, X, Y
from scipy.special import logsumexp
from scipy.stats import norm
from sklearn.base import clone

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore:The rows do not tell the noise variance"),
]
QUICK = {"max_iter": 5}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, **QUICK),
    "noise of each": MultiTaskGPRegressor(rank=1, noise="per_task", **QUICK),
    "laplace": MultiTaskGPRegressor(rank=1, hyperparameters="laplace", **QUICK),
    "sparse": PooledGP(inference="sparse", n_inducing=8, **QUICK),
    "independent": IndependentGP(**QUICK),
    "single": SingleTaskGP(**QUICK),
    "search": RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1,)),
}
KNOWN = np.array([0.5, 0.0, 2.0, 1e-3])
OBSERVED = np.array([0.3, 1.0, -2.0, 4.0])
TAILS = 0.05, 0.95


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    return clone(MODELS[request.param]).fit(X, Y)


def of_observations(model, alpha):
    """Means and deviations, from what is told of f and of the noise."""
    mean, std = model.predict(NEW, return_std=True)
    if isinstance(model, SingleTaskGP):
        noises = [of.noise_variance_ for of in model.estimators_]
        noises *= model.variance_factor_
    else:
        best = getattr(model, "best_estimator_", model)
        noises = best.noise_variance_ * best.variance_factor_
    noise = np.broadcast_to(noises, 3)[NEW[:, 1].astype(int)]
    return mean, np.sqrt(std**2 + noise + alpha)


@pytest.mark.parametrize("alpha", [KNOWN, KNOWN[:, None], 0.7], ids=np.shape)
def test_the_known_variance_is_added(model, alpha):
    mean, std = of_observations(model, np.ravel(alpha))
    found = model.log_predictive_density(NEW, OBSERVED, alpha=alpha)
    np.testing.assert_allclose(found, norm.logpdf(OBSERVED, mean, std), rtol=1e-8)
    ends = model.predict_interval(NEW, 0.9, alpha=alpha)
    for end, p in zip(ends, TAILS, strict=True):
        np.testing.assert_allclose(end, norm.ppf(p, mean, std), rtol=1e-8)


def test_none_is_zero(model):
    for alpha in (0, np.zeros(4)):
        np.testing.assert_array_equal(
            model.predict_interval(NEW, alpha=alpha), model.predict_interval(NEW)
        )
        np.testing.assert_array_equal(
            model.log_predictive_density(NEW, OBSERVED, alpha=alpha),
            model.log_predictive_density(NEW, OBSERVED),
        )


@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, SingleTaskGP])
def test_of_draws_it_is_the_mixture(estimator):
    options = {"hyperparameters": "sampled", "n_draws": 6, "max_iter": 2}
    model = estimator(**options, random_state=0).fit(X, Y)
    rows = NEW[:, :1], NEW[:, 1].astype(int)
    means, variances = (of[..., 0] for of in model._components(*rows, True))
    std = np.sqrt(variances + KNOWN)
    assert len(std) == 6
    found = model.log_predictive_density(NEW, OBSERVED, alpha=KNOWN)
    expected = logsumexp(norm.logpdf(OBSERVED, means, std), axis=0) - np.log(6)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    ends = model.predict_interval(NEW, 0.9, alpha=KNOWN)
    for end, p in zip(ends, TAILS, strict=True):
        np.testing.assert_allclose(norm.cdf(end, means, std).mean(axis=0), p)


def test_several_outputs():
    Y2 = np.column_stack([Y, -3.0 * Y])
    model = PooledGP(**QUICK).fit(X, Y2)
    mean, std = model.predict(NEW, return_std=True, include_noise=True)
    observed, known = OBSERVED[:, None] * [1.0, -3.0], KNOWN[:, None] * [1.0, 9.0]
    for alpha in (known, KNOWN, 0.2):
        each = alpha if np.ndim(alpha) == 2 else np.reshape(alpha, (-1, 1))
        expected = norm.logpdf(observed, mean, np.sqrt(std**2 + each))
        found = model.log_predictive_density(NEW, observed, alpha=alpha)
        np.testing.assert_allclose(found, expected, rtol=1e-8)
    lower, upper = model.predict_interval(NEW, alpha=known)
    assert lower.shape == upper.shape == (4, 2)


@settings(max_examples=20, deadline=None)
@given(order=st.permutations(range(4)), scale=st.floats(1e-2, 1e2))
def test_laws(order, scale):
    """Rows in another order, and targets in another unit, tell the same."""
    model = PooledGP("rbf", max_iter=0).fit(X, Y)
    lower, upper = model.predict_interval(NEW, alpha=KNOWN)
    ends = model.predict_interval(NEW[order], alpha=KNOWN[order])
    np.testing.assert_allclose(ends, [lower[order], upper[order]], rtol=1e-12)
    other = PooledGP("rbf", max_iter=0).fit(X, scale * Y)
    ends = other.predict_interval(NEW, alpha=scale**2 * KNOWN)
    np.testing.assert_allclose(np.divide(ends, scale), [lower, upper], rtol=1e-8)
    wider = model.predict_interval(NEW, alpha=KNOWN + 0.1)
    assert (wider[0] < lower).all()
    assert (wider[1] > upper).all()


class TestMistakes:
    model = PooledGP("rbf", max_iter=0)

    @pytest.mark.parametrize(
        "alpha",
        [ALPHA[:5], -ALPHA, np.where(ALPHA < 0.1, np.nan, ALPHA), 1j * ALPHA, "much"],
        ids=["length", "negative", "nan", "complex", "text"],
    )
    def test_they_are_those_of_fit(self, alpha):
        with pytest.raises(ValueError, match="alpha") as of_fit:
            clone(self.model).fit(X, Y, alpha=alpha)
        model = clone(self.model).fit(X, Y)
        for ask in (
            lambda: model.predict_interval(X, alpha=alpha),
            lambda: model.log_predictive_density(X, Y, alpha=alpha),
        ):
            with pytest.raises(ValueError, match="alpha") as found:
                ask()
            assert str(found.value) == str(of_fit.value)

    def test_labels_in_another_order(self):
        frame = pd.DataFrame(X, columns=["x", "task"])
        alpha, model = pd.Series(ALPHA), clone(self.model).fit(frame, Y)
        turned = alpha.iloc[::-1]
        with pytest.raises(ValueError, match="alpha has the labels of the rows in ano"):
            model.predict_interval(frame, alpha=turned)
        with pytest.raises(ValueError, match="alpha has the labels of the rows in ano"):
            model.log_predictive_density(frame, pd.Series(Y), alpha=turned)
        np.testing.assert_array_equal(
            model.predict_interval(frame, alpha=alpha),
            model.predict_interval(frame, alpha=ALPHA),
        )

    def test_f_has_no_noise(self):
        model = clone(self.model).fit(X, Y)
        with pytest.raises(ValueError, match="include_noise=False asks for f, which"):
            model.predict_interval(NEW, include_noise=False, alpha=0.1)

    @pytest.mark.parametrize("estimator", [PooledGP, SingleTaskGP])
    def test_transformed_targets(self, estimator):
        model = estimator("rbf", max_iter=0, target_transform=(np.sinh, np.arcsinh))
        model.fit(X, Y).set_params(target_transform=None)  # it has learned them
        with pytest.raises(ValueError, match="alpha and sample_weight are in units of"):
            model.predict_interval(NEW, alpha=0.1)
        with pytest.raises(ValueError, match="alpha and sample_weight are in units of"):
            model.log_predictive_density(NEW, OBSERVED, alpha=0.1)

    def test_a_model_whose_noise_is_integrated_out(self):
        model = BayesianLinearRegression().fit(X, Y)
        with pytest.raises(ValueError, match=r"no alpha: .*SingleTaskGP\(kernel='lin"):
            model.predict_interval(NEW, alpha=0.1)
        with pytest.raises(ValueError, match="takes no alpha"):
            model.log_predictive_density(NEW, OBSERVED, alpha=0.1)
