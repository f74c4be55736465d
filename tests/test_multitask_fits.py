"""The fitted model, its predictions, and the course of fit."""

import pickle

import numpy as np
import pytest
from multitask_models import PAPER, QUICK, SHARED
from samples import draw, split
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp import IndependentGP, MultiTaskGPRegressor, RankSearchIC, multitask
from skmtgp.exceptions import PrecisionWarning
from skmtgp.learning import ranks
from skmtgp.learning.ranks import learn_ranks

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(scope="module")
def fitted():
    """A model that tests share and leave alone."""
    with pytest.warns(ConvergenceWarning):
        return MultiTaskGPRegressor(rank=2, **PAPER, **QUICK).fit(*draw())


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
        MultiTaskGPRegressor(rank=2, n_jobs=k, **SHARED, **QUICK).fit(X, y)
        for k in (1, 2)
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
    model = MultiTaskGPRegressor(rank=1, n_restarts_optimizer=3, **PAPER, **QUICK)
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


def test_verbosity(told):
    model = MultiTaskGPRegressor(rank=2, max_iter=0, verbose=1).fit(*draw(n_outputs=2))
    decided, *lines = told()
    assert decided.startswith("chosen from the data: ")
    for (j, line), value in zip(
        enumerate(lines, 1), model.log_marginal_likelihoods_, strict=True
    ):
        expected = f"output {j} of 2, rank 2: log likelihood {value:.1f}, best of 3"
        assert line.startswith(expected)
    model.set_params(verbose=0).fit(*draw())
    assert told() == []


def test_too_few_iterations_are_reported():
    model = MultiTaskGPRegressor(rank=3, max_iter=2)
    with pytest.warns(
        ConvergenceWarning, match=r"output \[1, 2\] was .* max_iter=2 iterat"
    ):
        model.fit(*draw(n_outputs=2))
    assert 2 <= model.n_iter_ <= 12  # of six climbs


def test_missing_digits_are_reported(monkeypatch):
    def stalled(problems, forms, **options):
        modes = learn_ranks(problems, forms, **options)
        return [[m._replace(stalled=True) for m in of_output] for of_output in modes]

    monkeypatch.setattr(multitask, "learn_ranks", stalled)
    match = r"Learning of output \[1, 2\] ended for lack of digits.* See the user guide"
    with pytest.warns(PrecisionWarning, match=match):
        MultiTaskGPRegressor(rank=2, **SHARED).fit(*draw(n_outputs=2))


@pytest.mark.filterwarnings("error::sklearn.exceptions.ConvergenceWarning")
def test_enough_iterations_are_not_reported():
    X, y = draw()
    model = MultiTaskGPRegressor(RBF([1.0, 1.0]), rank=1, **PAPER)
    before = clone(model).set_params(max_iter=0).fit(X, y)
    model.fit(X, y)
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


NO, YES = np.bool_(False), np.bool_(True)
BOOLS = {
    "no levels": (MultiTaskGPRegressor, {"rank": 1, "task_levels": NO}),
    "levels": (MultiTaskGPRegressor, {"rank": 1, "task_levels": YES}),
    "independent": (IndependentGP, {"task_levels": NO, "diagonal": NO}),
    "diagonal": (MultiTaskGPRegressor, {"rank": 1, "diagonal": YES}),
    "shared": (MultiTaskGPRegressor, {"rank": 1, "shared": YES, "diagonal": NO}),
    "of terms": (
        MultiTaskGPRegressor,
        {"kernel": ["rbf"] * 2, "rank": 1, "diagonal": [YES, NO], "shared": [NO, YES]},
    ),
}


@pytest.mark.parametrize(("cls", "params"), BOOLS.values(), ids=BOOLS)
def test_bools_of_numpy_are_bools(cls, params):
    plain = {name: np.array(of).tolist() for name, of in params.items()}
    numpys, plains = (
        cls(**of, **SHARED, max_iter=2).fit(*draw()) for of in (params, plain)
    )
    np.testing.assert_array_equal(numpys.theta_, plains.theta_)


def test_a_search_takes_bools_of_numpy():
    model = MultiTaskGPRegressor(task_levels=NO, diagonal=YES, **SHARED, max_iter=2)
    search = RankSearchIC(model, ranks=(1, 2), simpler=False).fit(*draw())
    assert search.best_estimator_.diagonal_ is True
