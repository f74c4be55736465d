"""Tasks that join a fitted model, of whose noise something is known."""

import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_rows import ALPHA, X, Y, agree, noise_of, told, told_of
from samples import outputs
from scipy.optimize import minimize
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, RankSearchIC

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore:The rows do not tell the noise variance"),
    pytest.mark.usefixtures("certain_theta"),  # variances are those of the textbook
]
RNG = np.random.default_rng(1)
NEW_X = np.column_stack([RNG.uniform(0, 6, 6), np.full(6, 3)])
NEW_Y = 2.5 * np.sin(NEW_X[:, 0]) + 0.5 + 0.2 * RNG.standard_normal(6)
KNOWN = {
    "alpha": np.array([0.01, 0.3, 4.0, 0.0, 0.1, 0.02]),
    "sample_weight": np.array([1.0, 3.0, 2.0, 1.0, 5.0, 1.0]),
    "repeat_variance": np.array([0.0, 0.2, 0.1, 0.0, 0.05, 0.0]),
}
AT = np.array([[0.5, 0], [2.5, 1], [5.0, 2], [1.0, 3], [4.5, 3]])
ALL_X, ALL_Y = np.vstack([X, NEW_X]), np.append(Y, NEW_Y)
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, normalize_y="shared", max_iter=5),
    "noise of each": MultiTaskGPRegressor(rank=1, noise="per_task", max_iter=5),
    "units of each": MultiTaskGPRegressor(rank=1, normalize_y="per_task", max_iter=5),
    "independent": IndependentGP(max_iter=5),
    "pooled": PooledGP(max_iter=5),
}
QUICK = MultiTaskGPRegressor(rank=1, normalize_y="shared", max_iter=0, kernel=RBF(1.3))


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    """Not to be changed."""
    return clone(MODELS[request.param]).fit(X, Y, alpha=ALPHA)


def fresh(model):
    return pickle.loads(pickle.dumps(model))


def joined(model, X=NEW_X, y=NEW_Y, **known):
    """With the new task; by maximum likelihood, if that learns anything."""
    if not isinstance(model, MultiTaskGPRegressor):
        return fresh(model).partial_fit(X, y, **known)
    return model.add_task(X, y, prior=None, **known)


def noise_of_all(known):
    nothing = {"alpha": 0.0, "sample_weight": 1.0, "repeat_variance": 0.0}
    new = noise_of(6, *(nothing | known).values())
    pairs = zip(noise_of(len(X), ALPHA), new, strict=True)
    return noise_of(len(ALL_X), *map(np.concatenate, pairs))


@pytest.mark.parametrize("n_known", [1, 2, 3])
def test_it_is_what_the_book_tells(model, n_known):
    known = dict(list(KNOWN.items())[:n_known])
    found = joined(model, **known)
    expected = told_of(outputs(found)[0], ALL_X, ALL_Y, noise_of_all(known), AT)
    agree(told(found, AT), expected)
    np.testing.assert_array_equal(found._known.variance[-6:, 0], KNOWN["alpha"])


def likelihood_of_row(model, known):
    """By the new task's element of the factor, of rank 1."""
    [output] = outputs(model)
    others = model.task_factor_[:3, 0]

    def value(row):
        factor = np.append(others, row)
        form = output._replace(K_rho=np.outer(factor, factor))
        return told_of(form, ALL_X, ALL_Y, noise_of_all(known), AT)[0]

    return value


def is_likeliest(model, known):
    """Whether the new task's row is the maximum of the likelihood."""
    value, row = likelihood_of_row(model, known), model.task_factor_[3, 0]
    best = minimize(lambda u: -value(u[0]), [row], method="Nelder-Mead", tol=1e-9)
    assert best.x[0] == pytest.approx(row, rel=2e-3)


def test_the_relation_is_learned_with_it():
    model = clone(MODELS["multi-task"]).set_params(tol=1e-6).fit(X, Y, alpha=ALPHA)
    for known in ({"alpha": KNOWN["alpha"]}, KNOWN):
        is_likeliest(joined(model, **known), known)
    plain = joined(model).task_factor_[3, 0]
    assert joined(model, **KNOWN).task_factor_[3, 0] != pytest.approx(plain, rel=0.02)


def test_it_is_learned_again_with_it():
    model = clone(MODELS["multi-task"]).set_params(tol=1e-6).fit(X, Y, alpha=ALPHA)
    first, later = (
        {k: v[rows] for k, v in KNOWN.items()} for rows in ([0, 1], [2, 3, 4, 5])
    )
    found = model.add_task(NEW_X[:2], NEW_Y[:2], prior=None, **first)
    before = found.task_factor_[3, 0]
    found.partial_fit(NEW_X[2:], NEW_Y[2:], **later)
    assert found.task_factor_[3, 0] != before
    is_likeliest(found, KNOWN)
    agree(
        told(found, AT),
        told_of(outputs(found)[0], ALL_X, ALL_Y, noise_of_all(KNOWN), AT),
    )


class TestLaws:
    model = clone(QUICK).fit(X, Y)

    @settings(max_examples=15, deadline=None)
    @given(order=st.permutations(range(6)))
    def test_of_the_order_of_rows(self, order):
        expected = joined(self.model, **KNOWN)
        known = {name: of[order] for name, of in KNOWN.items()}
        found = joined(self.model, NEW_X[order], NEW_Y[order], **known)
        agree(told(found, AT)[:3], told(expected, AT)[:3], digits=6)

    @pytest.mark.parametrize("name", MODELS)
    @pytest.mark.parametrize("weights", [[2] * 6, [1, 3, 2, 1, 0, 4]], ids=str)
    def test_weights_count_rows(self, name, weights):
        model = clone(MODELS[name]).set_params(max_iter=0).fit(X, Y)
        rows = np.repeat(np.arange(6), weights)
        alpha = KNOWN["alpha"]
        found = joined(model, sample_weight=weights, alpha=alpha)
        expected = joined(model, NEW_X[rows], NEW_Y[rows], alpha=alpha[rows])
        for name in ("y_mean_", "y_scale_"):
            np.testing.assert_allclose(*(getattr(of, name) for of in (found, expected)))
        agree(told(found, AT)[:3], told(expected, AT)[:3], digits=5)

    @pytest.mark.parametrize("trend", [None, [0]])
    def test_units_are_those_of_all_measurements(self, trend):
        options = {"normalize_y": "per_task", "trend": trend, "max_iter": 0}
        model = MultiTaskGPRegressor("rbf", rank=1, **options).fit(X, Y)
        weights = KNOWN["sample_weight"].astype(int)
        rows, first = np.repeat(np.arange(6), weights), weights[:3].sum()
        found = joined(model, NEW_X[:3], NEW_Y[:3], sample_weight=weights[:3])
        found.partial_fit(NEW_X[3:], NEW_Y[3:], sample_weight=weights[3:])
        expected = joined(model, NEW_X[rows[:first]], NEW_Y[rows[:first]])
        expected.partial_fit(NEW_X[rows[first:]], NEW_Y[rows[first:]])
        np.testing.assert_allclose(found.y_scale_, expected.y_scale_)
        if trend is None:
            np.testing.assert_allclose(found.y_mean_, expected.y_mean_)
            np.testing.assert_allclose(found.y_mean_[3], NEW_Y[rows].mean())

    def test_no_alpha(self):
        found, expected = joined(self.model, alpha=0.0), joined(self.model)
        agree(told(found, AT), told(expected, AT), digits=7)

    def test_a_huge_one(self):
        """The others stay as they are, and the row is the mean of theirs."""
        found = self.model.add_task(NEW_X, NEW_Y + 1e3, alpha=1e12)
        agree([found.predict(AT[:3])], [self.model.predict(AT[:3])])
        assert found.y_mean_ == self.model.y_mean_
        factor = found.task_factor_[:, 0]
        assert factor[3] == pytest.approx(factor[:3].mean(), rel=1e-6)
        alone = clone(MODELS["independent"]).fit(X, Y)
        alone.partial_fit(NEW_X, NEW_Y + 1e3, alpha=1e12)
        np.testing.assert_allclose(alone.predict(AT[3:]), alone.y_mean_, atol=1e-3)


@pytest.mark.parametrize("way", ["laplace", "sampled"])
def test_of_draws_and_around_the_mode(way):
    """Each draw has a row of its own; huge noise tells none of them."""
    options = {"hyperparameters": way, "n_draws": 5, "max_iter": 2}
    model = clone(QUICK).set_params(**options).fit(X, Y)
    found = model.add_task(NEW_X, NEW_Y, **KNOWN)
    again = model.add_task(NEW_X, NEW_Y, **KNOWN)
    np.testing.assert_array_equal(found.predict(AT), again.predict(AT))
    for posterior in found._posteriors:
        learned = posterior.prior.values(posterior.theta).noise
        known = KNOWN["alpha"] / found.y_scale_**2
        expected = (learned + known) / KNOWN["sample_weight"]
        np.testing.assert_allclose(posterior.noise[-6:], expected, rtol=1e-10)
    lost = model.add_task(NEW_X, NEW_Y, alpha=1e12)
    np.testing.assert_allclose(lost.predict(AT[:3]), model.predict(AT[:3]), rtol=1e-6)


@pytest.mark.parametrize("name", ["multi-task", "units of each", "noise of each"])
def test_rows_of_several_tasks_at_once(name):
    model = clone(MODELS[name]).fit(X, Y)
    rows = np.vstack([NEW_X[:3], X[:2] + [[0.05, 0]], NEW_X[3:] + [[0, 1]]])
    y, alpha = np.append(NEW_Y[:3], [*Y[:2], *NEW_Y[3:]]), np.linspace(0.1, 0.8, 8)
    one, two, known = slice(3), slice(5, None), slice(3, 5)
    expected = fresh(model).partial_fit(rows[known], y[known], alpha=alpha[known])
    for of in (one, two):
        expected = expected.add_task(rows[of], y[of], alpha=alpha[of])
    found = model.partial_fit(rows, y, alpha=alpha)
    agree(told(found, AT), told(expected, AT), digits=10)
    order = [3, 4, 0, 1, 2, 5, 6, 7]
    np.testing.assert_array_equal(found._known.variance[-8:, 0], alpha[order])


def test_complete_data_become_dense():
    grid = np.column_stack([np.repeat(np.arange(12.0), 3), np.arange(36) % 3])
    model = clone(QUICK).fit(grid, Y)
    plain = model.add_task(NEW_X, NEW_Y)
    found = model.add_task(NEW_X, NEW_Y, alpha=0.0)
    assert (model.inference_, plain.inference_, found.inference_) == (
        "kronecker",
        "kronecker",
        "dense",
    )
    agree(told(found, AT), told(plain, AT), digits=6)
    later = found.partial_fit(NEW_X + [[0.1, 0]], NEW_Y, alpha=0.2)
    assert later.inference_ == "dense"
    exact = clone(QUICK).set_params(inference="kronecker").fit(grid, Y)
    before = pickle.dumps(exact)
    with pytest.raises(ValueError, match="takes no alpha, and no sample_weight"):
        exact.add_task(NEW_X, NEW_Y, alpha=0.1)
    assert pickle.dumps(exact) == before


def test_the_unit_of_a_task_with_much_noise_is_not_doubted():
    """As it is where the noise is not known."""
    model = clone(QUICK).fit(X, Y)
    y = NEW_Y + 1e3 * RNG.standard_normal(6)
    with pytest.warns(match="Is it measured in another unit"):
        model.add_task(NEW_X, y)
    model.add_task(NEW_X, y, alpha=1e6)
    few = model.add_task(NEW_X[:2], y[:2], alpha=1e6)
    few.partial_fit(NEW_X[2:], y[2:], alpha=1e6)
    assert np.ndim(few.y_mean_) == 0  # its mean is no sign of another level
    with pytest.warns(match="varies less than a tenth of the noise"):
        model.add_task(NEW_X, 1e-3 * NEW_X[:, 0])
    model.add_task(NEW_X, 1e-3 * NEW_X[:, 0], sample_weight=10**6)


def test_outliers_of_a_task_with_much_noise_are_not_told():
    rows = np.column_stack([np.linspace(0, 6, 12), np.full(12, 3)])
    y = np.append(np.sin(rows[:11, 0]), 1e3)
    model = clone(QUICK).fit(X, Y)
    with pytest.warns(match="far from"):
        model.add_task(rows, y)
    model.add_task(rows, y, alpha=np.append(np.full(11, 0.1), 1e6))


def test_all_noise_may_be_known():
    options = {"noise_variance": 0, "noise_variance_bounds": "fixed"}
    model = clone(QUICK).set_params(**options).fit(X, Y, alpha=ALPHA)
    for alpha in None, KNOWN["alpha"]:
        with pytest.raises(ValueError, match="they would count as exact"):
            model.add_task(NEW_X, NEW_Y, alpha=alpha)
    known = {"alpha": KNOWN["alpha"] + 0.1}
    found = joined(model, **known)
    expected = told_of(outputs(found)[0], ALL_X, ALL_Y, noise_of_all(known), AT)
    agree(told(found, AT), expected)


def test_mistakes_are_those_of_fit_and_change_nothing():
    frame, y = pd.DataFrame(NEW_X, columns=["x", "task"]), pd.Series(NEW_Y)
    given = pd.DataFrame(X, columns=["x", "task"])
    model = clone(QUICK).fit(given, Y)
    before = pickle.dumps(model)
    for known in (
        {"alpha": -1.0},
        {"alpha": [0.1, 0.2]},
        {"alpha": np.full(6, np.nan)},
        {"sample_weight": np.zeros(6)},
        {"repeat_variance": 0.1},
        {"alpha": pd.Series(KNOWN["alpha"]).iloc[::-1]},
    ):
        with pytest.raises(ValueError, match="|".join(known)) as of_fit:
            PooledGP("rbf", max_iter=0).fit(frame, y, **known)
        with pytest.raises(ValueError, match="|".join(known)) as found:
            model.add_task(frame, y, **known)
        assert str(found.value) == str(of_fit.value)
    transformed = clone(QUICK).set_params(target_transform=(np.sinh, np.arcsinh))
    with pytest.raises(ValueError, match="are in units of y, but with target_transf"):
        transformed.fit(X, Y).add_task(NEW_X, NEW_Y, alpha=0.1)
    assert pickle.dumps(model) == before


def test_of_a_search():
    search = RankSearchIC(MultiTaskGPRegressor(max_iter=3), ranks=(1,)).fit(X, Y)
    found = search.add_task(NEW_X, NEW_Y, *KNOWN.values())
    expected = search.best_estimator_.add_task(NEW_X, NEW_Y, **KNOWN).predict(AT)
    np.testing.assert_array_equal(found.predict(AT), expected)
