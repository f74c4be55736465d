"""Rows that join a fitted model, of whose noise something is known."""

import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_rows import (
    ALPHA,
    COUNTS,
    FIRST,
    LATER,
    NEW,
    SPREAD,
    TASK,
    N,
    X,
    Y,
    agree,
    by_the_book,
    noise_of,
    told,
    told_of,
)
from samples import Output, outputs
from sklearn import config_context
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from streams import close, refitted
from streams import told as all_told

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    compile_predictor,
)
from skmtgp._numerics.updates import UpdatedCholesky
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import Dense

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore:The rows do not tell the noise variance"),
    pytest.mark.usefixtures("certain_theta"),  # variances are those of the textbook
]
QUICK = {"max_iter": 5}
MODELS = {
    "multi-task": MultiTaskGPRegressor(rank=1, normalize_y="shared", **QUICK),
    "units of each": MultiTaskGPRegressor(rank=2, normalize_y="per_task", **QUICK),
    "noise of each": MultiTaskGPRegressor(rank=1, noise="per_task", **QUICK),
    "independent": IndependentGP(**QUICK),
    "pooled": PooledGP(normalize_y=False, **QUICK),
}
KNOWN = {"alpha": ALPHA, "sample_weight": COUNTS, "repeat_variance": SPREAD}
PLAIN = PooledGP("rbf", max_iter=0)
NAMES = "|".join(KNOWN)


def part(known, rows):
    return {name: of[rows] for name, of in known.items()}


@pytest.fixture(scope="module", params=MODELS)
def first(request):
    """Of the first rows, of which nothing is known; not to be changed."""
    return clone(MODELS[request.param]).fit(X[FIRST], Y[FIRST])


def fresh(model):
    return pickle.loads(pickle.dumps(model))


@pytest.mark.parametrize("names", [["alpha"], list(KNOWN)[:2], list(KNOWN)], ids=len)
def test_it_is_what_the_book_tells(first, names):
    known = {name: KNOWN[name] for name in names}
    model = fresh(first).partial_fit(X[LATER], Y[LATER], **part(known, LATER))
    later = [of[LATER] for of in known.values()] + [1.0, 0.0][len(names) - 1 :]
    pairs = zip(noise_of(24), noise_of(12, *later), strict=True)
    noise = noise_of(N, *map(np.concatenate, pairs))
    agree(told(model), by_the_book(model, X, Y, noise))
    assert isinstance(model._posteriors[0].cholesky, UpdatedCholesky)
    np.testing.assert_array_equal(model.theta_, first.theta_)


@pytest.mark.parametrize("name", MODELS)
def test_rows_that_were_known_stay(name):
    model = clone(MODELS[name]).fit(X[FIRST], Y[FIRST], **part(KNOWN, FIRST))
    model.partial_fit(X[24:30], Y[24:30])
    model.partial_fit(X[30:], Y[30:], **part(KNOWN, slice(30, N)))
    alpha, counts, spread = (of.copy() for of in KNOWN.values())
    alpha[24:30], counts[24:30], spread[24:30] = 0.0, 1.0, 0.0
    noise = noise_of(N, alpha, counts, spread)
    agree(told(model), by_the_book(model, X, Y, noise))
    value = model.log_marginal_likelihood(model.theta_)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-10)


def test_several_outputs():
    Y2, alpha = np.column_stack([Y, -3 * Y]), np.column_stack([ALPHA, 9 * ALPHA])
    model = PooledGP(**QUICK).fit(X[FIRST], Y2[FIRST])
    model.partial_fit(X[LATER], Y2[LATER], alpha=alpha[LATER])
    mean, std = model.predict(NEW, return_std=True)
    for j, output in enumerate(outputs(model)):
        later = np.append(np.zeros(24), alpha[LATER, j])
        expected = told_of(output, X, Y2[:, j], noise_of(N, later))
        agree([mean[:, j], std[:, j]], expected[1:3])


@pytest.mark.parametrize("way", ["laplace", "sampled"])
def test_of_draws_and_around_the_mode(way):
    options = {"hyperparameters": way, "n_draws": 5, "max_iter": 2}
    model = MultiTaskGPRegressor(rank=1, normalize_y="shared", **options)
    model.fit(X[FIRST], Y[FIRST])
    model.partial_fit(X[LATER], Y[LATER], alpha=ALPHA[LATER])
    close(all_told(model, NEW), all_told(refitted(model), NEW))
    noise = noise_of(N, np.append(np.zeros(24), ALPHA[LATER]))
    [likelihood], scale = model._likelihoods, np.array([model.y_scale_])
    if way == "laplace":
        found = model.predict(NEW), model.log_marginal_likelihood_value_
        value, mean, *_ = by_the_book(model, X, Y, noise)
        agree(found, (mean, value))
        return
    drawn = []
    for theta in model.theta_samples_:
        kernel, K_rho, _, level, sigma2 = likelihood.prior.in_units(theta, scale)
        output = Output(kernel, K_rho, sigma2, model.y_mean_, level)
        drawn.append(told_of(output, X, Y, noise)[1:3])
    means, deviations = np.swapaxes(drawn, 0, 1)
    spread = np.sqrt(np.square(deviations).mean(axis=0) + means.var(axis=0))
    agree(model.predict(NEW, return_std=True), (means.mean(axis=0), spread))


class TestLaws:
    model = clone(PLAIN).fit(X[FIRST], Y[FIRST])

    def joined(self, rows=LATER, **known):
        return fresh(self.model).partial_fit(X[rows], Y[rows], **known)

    @settings(max_examples=15, deadline=None)
    @given(order=st.permutations(range(24, N)), scale=st.floats(0.0, 1e3))
    def test_of_the_order_of_rows(self, order, scale):
        expected = told(self.joined(**part(KNOWN, LATER) | {"alpha": ALPHA[LATER]}))
        found = told(self.joined(order, **part(KNOWN, order)))
        agree(found[:3], expected[:3])
        one = self.joined([24], alpha=scale * ALPHA[24])
        of_two = fresh(one).partial_fit(X[25:], Y[25:], alpha=scale * ALPHA[25:])
        agree(told(of_two), told(self.joined(alpha=scale * ALPHA[LATER])))

    @settings(max_examples=15, deadline=None)
    @given(rows=st.lists(st.integers(24, N - 1), min_size=1, max_size=8, unique=True))
    def test_what_no_alpha_and_a_huge_one_are(self, rows):
        agree(told(self.joined(rows, alpha=0.0)), told(self.joined(rows)), digits=10)
        found = told(self.joined(rows, alpha=1e12))
        agree(found[1:3], told(self.model)[1:3])

    @settings(max_examples=15, deadline=None)
    @given(seed=st.integers(0, 10**6))
    def test_weights_count_rows(self, seed):
        weights = np.random.default_rng(seed).integers(0, 4, N - 24)
        weights[0] = 2
        rows = np.repeat(np.arange(24, N), weights)
        found = self.joined(sample_weight=weights, alpha=ALPHA[LATER])
        expected = self.joined(rows, alpha=ALPHA[rows])
        agree(told(found)[:3], told(expected)[:3])
        assert len(found.y_train_) == 24 + np.count_nonzero(weights)


class TestEngines:
    GRID = np.column_stack([np.repeat(np.arange(12.0), 3), TASK])

    def complete(self, **params):
        model = MultiTaskGPRegressor(rank=1, normalize_y="shared", **QUICK, **params)
        return model.fit(self.GRID, Y)

    def test_complete_data_become_dense(self):
        model = self.complete()
        assert model.inference_ == "kronecker"
        rows = self.GRID[:3] + [[0.5, 0]]
        model.partial_fit(rows, Y[:3], alpha=[0.1, 0.2, 0.3])
        assert model.inference_ == "dense"
        both, noise = (
            np.vstack([self.GRID, rows]),
            np.append(np.zeros(N), [0.1, 0.2, 0.3]),
        )
        expected = by_the_book(model, both, np.append(Y, Y[:3]), noise_of(N + 3, noise))
        agree(told(model), expected)
        model.partial_fit(rows + [[0.2, 0]], Y[:3])
        assert model._known.variance.ravel().tolist()[-6:] == [0.1, 0.2, 0.3, 0, 0, 0]

    def test_a_call_that_fails_leaves_complete_data(self):
        model = self.complete()
        before = pickle.dumps(model)
        with pytest.raises(ValueError, match="max_rows=1 is below the number of tasks"):
            model.partial_fit(self.GRID[:3], Y[:3], alpha=0.1, max_rows=1)
        with pytest.raises(ValueError, match="is known already"):
            model.add_task(self.GRID[:1], Y[:1], alpha=0.1)
        assert pickle.dumps(model) == before

    def test_complete_data_that_get_a_cell_stay_without(self):
        model = self.complete().partial_fit(self.GRID[:3] - [[1, 0]], Y[:3])
        assert model.inference_ == "kronecker"
        rows = self.GRID[:3] - [[2, 0]]
        model.partial_fit(
            rows, Y[:3], sample_weight=[1, 1, 1]
        )  # of which none is known
        assert (model.inference_, model._known) == ("kronecker", None)

    @pytest.mark.parametrize(
        ("params", "known"),
        [
            ({"inference": "kronecker"}, {"alpha": 0.1}),
            ({"inference": "kronecker"}, {"sample_weight": 2}),
            ({"inference": "sparse", "n_inducing": 8}, {"alpha": 0.1}),
            ({"inference": "sparse", "n_inducing": 8}, {"sample_weight": 1.5}),
        ],
        ids=str,
    )
    def test_those_that_cannot_refuse_as_in_fit(self, params, known):
        model = self.complete(**params)
        before = pickle.dumps(model)
        with pytest.raises(ValueError, match="takes no alpha, and") as of_fit:
            clone(model).fit(self.GRID, Y, **known)
        for label in (0, 7):  # a known task, and a new one
            with pytest.raises(ValueError, match="takes no alpha, and") as found:
                model.partial_fit([[20.0, label]], [0.5], **known)
            assert str(found.value) == str(of_fit.value)
        assert pickle.dumps(model) == before

    def test_sparse_inference_repeats_rows(self):
        model = PooledGP(inference="sparse", n_inducing=8, **QUICK)
        model.fit(X[FIRST], Y[FIRST])
        weights = np.tile([0, 1, 3], 4)
        rows = np.repeat(np.arange(24, N), weights)
        found = fresh(model).partial_fit(X[LATER], Y[LATER], sample_weight=weights)
        expected = model
        for row in rows:
            expected.partial_fit(X[[row]], Y[[row]])
        agree([found.predict(NEW)], [expected.predict(NEW)])

    def test_those_that_forget(self):
        class Forgetting(Dense):
            name = "forgetting"

            def likelihood(self, prior, data):
                return DenseLikelihood(prior, data.X, data.tasks, data.y)

        model = MultiTaskGPRegressor("rbf", rank=1, inference=Forgetting(), max_iter=0)
        model.fit(X[FIRST], Y[FIRST])
        for row in X[24], [1.0, 7]:
            with pytest.raises(ValueError, match="'forgetting' makes a likelihood wit"):
                model.partial_fit([row], Y[[24]], alpha=0.1)


def test_the_first_call_is_fit():
    for estimator in (PLAIN, RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=(1,))):
        found = clone(estimator).partial_fit(X, Y, **KNOWN)
        expected = clone(estimator).fit(X, Y, **KNOWN)
        np.testing.assert_array_equal(found.predict(NEW), expected.predict(NEW))
        found.partial_fit(X[:2] + [[0.1, 0]], Y[:2], alpha=[0.3, 0.4])
        best = getattr(found, "best_estimator_", found)
        assert best._known.variance[-2:, 0].tolist() == [0.3, 0.4]


def test_rows_that_tell_least_go():
    """Of new rows the one with much noise, and the others are as they were."""
    model = clone(PLAIN).fit(X[FIRST], Y[FIRST])
    alpha = np.full(12, 0.01)
    alpha[5] = 1e4
    model.partial_fit(X[LATER], Y[LATER], alpha=alpha, max_rows=35)
    assert model._known.variance[:, 0].max() == 0.01
    kept = np.delete(np.arange(N), 29)
    noise = noise_of(35, np.append(np.zeros(24), np.delete(alpha, 5)))
    agree(told(model), by_the_book(model, X[kept], Y[kept], noise))


def test_all_noise_may_be_known():
    options = {"noise_variance": 0, "noise_variance_bounds": "fixed", "max_iter": 0}
    model = PooledGP("rbf", **options).fit(X[FIRST], Y[FIRST], alpha=ALPHA[FIRST])
    for alpha in None, 0.0, np.arange(12.0):
        with pytest.raises(
            ValueError, match=r"they would count as exact\. Give an alpha"
        ):
            model.partial_fit(X[LATER], Y[LATER], alpha=alpha)
    model.partial_fit(X[LATER], Y[LATER], alpha=ALPHA[LATER])
    agree(told(model), by_the_book(model, X, Y, noise_of(N, ALPHA)))


def test_predictors_follow():
    model = clone(PLAIN).fit(X[FIRST], Y[FIRST])
    predictor = compile_predictor([model], task=0)
    model.partial_fit(X[LATER], Y[LATER], alpha=ALPHA[LATER])
    np.testing.assert_allclose(predictor([0.5])[0], model.predict(NEW[:1])[0])


def test_outliers_of_which_much_noise_is_known_are_not_told():
    clone(PLAIN).fit(X, Y).partial_fit(X[:1], [1e4], alpha=1e9)


class TestMistakes:
    @pytest.mark.parametrize(
        "known",
        [
            {"alpha": ALPHA[:5]},
            {"alpha": -ALPHA},
            {"alpha": np.where(ALPHA < 0.1, np.nan, ALPHA)},
            {"alpha": 1j * ALPHA},
            {"sample_weight": np.zeros(N)},
            {"sample_weight": 0.5},
            {"repeat_variance": 0.1},
            {"sample_weight": COUNTS, "repeat_variance": np.full(N, 0.1)},
        ],
        ids=lambda known: "-".join(known),
    )
    def test_they_are_those_of_fit_and_change_nothing(self, known):
        with pytest.raises(ValueError, match=NAMES) as of_fit:
            clone(PLAIN).fit(X, Y, **known)
        model = clone(PLAIN).fit(X, Y)
        before = pickle.dumps(model)
        with pytest.raises(ValueError, match=NAMES) as found:
            model.partial_fit(X, Y, **known)
        assert str(found.value) == str(of_fit.value)
        assert pickle.dumps(model) == before

    def test_labels_in_another_order(self):
        frame, y = pd.DataFrame(X, columns=["x", "task"]), pd.Series(Y)
        model = clone(PLAIN).fit(frame, y)
        before = pickle.dumps(model)
        for name, of in KNOWN.items():
            known = {"sample_weight": 2, name: pd.Series(of).iloc[::-1]}
            with pytest.raises(ValueError, match=f"{name} has the labels of the rows"):
                model.partial_fit(frame, y, **known)
        assert pickle.dumps(model) == before

    def test_transformed_targets(self):
        model = clone(PLAIN).set_params(target_transform=(np.sinh, np.arcsinh))
        model.fit(X, Y)
        with pytest.raises(
            ValueError, match="are in units of y, but with target_trans"
        ):
            model.partial_fit(X[:1], Y[:1], alpha=0.1)

    def test_kernels_with_noise_of_their_own_take_no_counts(self):
        model = PooledGP(RBF() + WhiteKernel(), max_iter=0).fit(X[FIRST], Y[FIRST])
        with pytest.raises(
            ValueError, match="sample_weight counts repeats, but kernel"
        ):
            model.partial_fit(X[LATER], Y[LATER], sample_weight=2)
        model.partial_fit(X[LATER], Y[LATER], alpha=0.1)


def test_metadata_can_be_requested():
    with config_context(enable_metadata_routing=True):
        model = PooledGP().set_partial_fit_request(alpha=True, sample_weight=True)
        routed = model.get_metadata_routing().partial_fit.requests
    assert routed["alpha"] is routed["sample_weight"] is True
    assert routed["repeat_variance"] is None
