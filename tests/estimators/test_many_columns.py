"""One length-scale for all columns, where the rows do not tell one of each."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    WideRegressor,
)
from skmtgp._estimators.many_columns import columns_are_many
from skmtgp._estimators.named_kernels import KERNELS, named_kernel
from skmtgp.exceptions import NarrowIntervalsWarning
from skmtgp.inspection import KernelRelevanceDisplay

FEW = "ignore::skmtgp.exceptions.NarrowIntervalsWarning"
pytestmark = pytest.mark.filterwarnings(FEW)
N = 40


def spectra(n_columns=60, seed=0, unit=1.0):
    """Rows of three components by two instruments: to learn, and to predict."""
    rng = np.random.default_rng(seed)
    Z, task = rng.standard_normal((N + 200, 3)), np.arange(N + 200) % 2
    S = Z @ rng.standard_normal((3, n_columns))
    S = unit * (S + 0.05 * rng.standard_normal(S.shape))
    f = Z[:, 0] + 0.5 * Z[:, 1] * (1.0 + 0.3 * task) + task
    y, X = f + 0.05 * rng.standard_normal(len(f)), np.column_stack([S, task])
    return X[:N], y[:N], X[N:], y[N:], f[N:]


def two_that_matter(n_columns=20, n=60):
    """Columns of which two matter."""
    rng = np.random.default_rng(0)
    x, task = rng.uniform(-1, 1, (n, n_columns)), np.arange(n) % 3
    f = np.sin(3.0 * x[:, 0]) + x[:, 1] ** 2 + task
    return np.column_stack([x, task]), f + 0.1 * rng.standard_normal(n)


def n_numbers(model):
    """Of the kernel, beside an amplitude and a bias."""
    params = model.kernel_.get_params()
    names = [name for name in params if name.endswith(("length_scale", "weights"))]
    return sum(np.size(params[name]) for name in names)


@pytest.mark.parametrize(
    "model", [MultiTaskGPRegressor(rank=1), IndependentGP(), PooledGP()], ids=repr
)
def test_columns_of_spectra_have_one_length_scale(model):
    X, y, *_ = spectra()
    y = y - X[:, -1]  # pooled tasks have no levels
    assert n_numbers(model.fit(X, y)) == 1
    assert model.kernel_(X[:2, :-1]).shape == (2, 2)


def test_predictions_are_better_and_intervals_are_wide_enough():
    X, y, new, observed, truth = spectra(80, seed=2)
    found = []
    for kernel in (None, "rbf"):
        model = MultiTaskGPRegressor(kernel).fit(X, y)
        found.append(np.sqrt(np.mean((model.predict(new) - truth) ** 2)))
        if kernel is None:
            lower, upper = model.predict_interval(new)
            assert np.mean((lower <= observed) & (observed <= upper)) > 0.8
    assert found[0] < 0.7 * found[1]


def test_a_search_of_the_rank_has_one_length_scale_too():
    X, y, *_ = spectra()
    search = RankSearchIC().fit(X, y)
    assert n_numbers(search.best_estimator_) == 1


def test_it_is_the_same_in_any_unit():
    one, other = (
        MultiTaskGPRegressor(rank=1).fit(X, y).predict(new)
        for X, y, new, *_ in (spectra(), spectra(unit=1e3))
    )
    np.testing.assert_allclose(one, other, atol=1e-2)


def test_columns_that_do_not_matter_keep_length_scales_of_their_own():
    X, y = two_that_matter()
    model = MultiTaskGPRegressor(rank=1).fit(X, y)
    scales = model.kernel_.length_scale
    assert np.argsort(scales)[:2].tolist() in ([0, 1], [1, 0])


def test_columns_in_units_of_their_own_keep_length_scales_of_their_own():
    X, y, *_ = spectra()
    X[:, :-1] *= np.geomspace(1.0, 1e4, X.shape[1] - 1)
    assert n_numbers(MultiTaskGPRegressor(rank=1).fit(X, y)) == X.shape[1] - 1


@pytest.mark.parametrize("kernel", ["rbf", "linear"])
def test_names_have_a_number_for_each_column(kernel):
    X, y, *_ = spectra(n_columns=30)
    with pytest.warns(NarrowIntervalsWarning, match="The default, kernel=None"):
        model = MultiTaskGPRegressor(kernel, rank=1).fit(X, y)
    assert n_numbers(model) == 30


def test_a_fit_of_few_columns_is_told_nothing_of_length_scales():
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(size=(12, 2)), np.arange(12) % 2])
    with pytest.warns(NarrowIntervalsWarning) as caught:
        MultiTaskGPRegressor(rank=1).fit(X, rng.standard_normal(12))
    assert not any("for all columns" in str(of.message) for of in caught)


def test_rows_that_tasks_share_count_once():
    X = np.random.default_rng(0).standard_normal((40, 20))
    assert columns_are_many(X)
    assert columns_are_many(np.tile(X, (4, 1)), n_tasks=4)
    assert not columns_are_many(
        np.random.default_rng(0).standard_normal((160, 20)), n_tasks=4
    )
    assert not columns_are_many(X[:, :9])


def test_a_table_of_tasks_has_one_length_scale():
    X, y, *_ = spectra()
    y = y - X[:, -1]
    Y = np.column_stack([y, 2.0 * y - 1.0])
    Y += 0.05 * np.random.default_rng(1).standard_normal(Y.shape)
    model = WideRegressor(MultiTaskGPRegressor(rank=1)).fit(X[:, :-1], Y)
    assert n_numbers(model.estimator_) == 1


def test_the_choice_is_said(caplog):
    X, y, *_ = spectra()
    MultiTaskGPRegressor(rank=1, verbose=1).fit(X, y)
    assert "one length-scale for all features" in caplog.text


def test_relevances_of_one_length_scale_are_equal():
    pytest.importorskip("matplotlib").use("Agg")
    X, y, *_ = spectra()
    model = MultiTaskGPRegressor(rank=1).fit(X, y)
    [found] = KernelRelevanceDisplay.from_estimator(model).relevances
    assert len(found) == X.shape[1] - 1
    assert np.unique(found).size == 1


@pytest.mark.parametrize("name", sorted(set(KERNELS) - {"periodic"}))
def test_kernels_of_one_length_scale_begin_alike(name):
    X = np.random.default_rng(0).standard_normal((500, 5))
    each, alike = (named_kernel(name, X, alike=of) for of in (False, True))
    np.testing.assert_allclose(each(X[:50]), alike(X[:50]), atol=0.15)
    assert alike.n_dims < each.n_dims


def test_constant_columns_have_no_part_in_the_start():
    X = np.random.default_rng(0).standard_normal((50, 3))
    X[:, 2] = 7.0
    found = named_kernel("rbf", X, alike=True)
    assert found == RBF(np.linalg.norm(X[:, :2].std(axis=0)), found.length_scale_bounds)
    assert named_kernel("rbf", np.ones((5, 2)), alike=True).length_scale == 1.0


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_columns_in_different_units_are_to_be_scaled():
    """One length-scale for all of them is not tried before."""
    X, y, *_ = spectra()
    X[:, :30] *= 1e3
    with pytest.warns(NarrowIntervalsWarning, match="different units. Scale them"):
        MultiTaskGPRegressor(rank=1, max_iter=3).fit(X, y)
    with pytest.warns(NarrowIntervalsWarning) as caught:
        MultiTaskGPRegressor("rbf", rank=1, max_iter=3).fit(X, y)
    assert not any("different units" in str(w.message) for w in caught)
