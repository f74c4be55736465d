"""Ranks that some rows cannot tell are learned from all rows, by way of lower ones."""

from dataclasses import replace

import numpy as np
import pytest
from rarely import rarely
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._estimators import forms
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import read
from skmtgp._support.progress import silent
from skmtgp.learning import climbing, growing
from skmtgp.learning.growing import learn_forms, told
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.summarised import exact_part
from skmtgp.model.task_covariance import low_rank

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

M, N = 12, 480
MODEL = MultiTaskGPRegressor(
    RBF(1.0),
    inference="sparse",
    n_inducing=15,
    n_exact=60,  # as many rows tell 15 numbers of K^rho: 12 of rank 1, not 23 of rank 2
    max_iter=30,
    normalize_y="shared",
    noise="shared",
)
RUNNING = {"n_jobs": None, "progress": silent}


def draw(rank, seed=0):
    """Functions of all tasks, as many as the rank, and levels."""
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(-2.0, 2.0, N), np.arange(N) % M
    z = np.column_stack([np.sin(2.0 * x), np.cos(2.0 * x), x])[:, :rank]
    y = (rng.standard_normal((M, rank))[tasks] * z).sum(axis=1)
    y += rng.standard_normal(M)[tasks] + 0.5 * rng.standard_normal(N)
    return np.column_stack([x, tasks]), y


def asked(X, y, **changes):
    """The problems of a model, and what those of some rows are asked for."""
    model, learned = MODEL.__class__(**MODEL.get_params(deep=False) | changes), []

    def learn(parts, forms, **options):
        learned.extend((len(parts[0].data), form.rank) for form in forms)
        return learn_ranks(parts, forms, **options)

    return pose(model, decide(model, read(model, X, y))), learn, learned


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(
    ("ranks", "expected"),
    [((0, 1, 2, 3), (0, 1)), ((1,), (1,)), ((3,), (1,)), ((12,), (1,)), ((2, 3), (1,))],
)
def test_forms_that_rows_can_tell(shared, ranks, expected):
    [problem], *_ = asked(*draw(1))
    part = problem.with_data(problem.data.drawn(60))
    forms = [low_rank(M, rank, shared=shared or rank == 0) for rank in ranks]
    found = told(part, forms)
    assert [form.rank for form in found] == list(expected)
    assert all(type(form) is type(forms[-1]) for form in found if form.rank)


def test_all_forms_are_told_where_nothing_is_learned():
    [problem], *_ = asked(*draw(1), max_iter=0)
    forms = [low_rank(M, rank) for rank in (3, 12)]
    assert told(problem.with_data(problem.data.drawn(60)), forms) == forms


@pytest.mark.parametrize("n_outputs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_higher_ranks_are_learned_from_all_rows_alone(n_outputs):
    X, y = draw(2)
    Y = np.column_stack([y, y[::-1]])[:, :n_outputs]
    problems, learn, learned = asked(X, Y)
    forms = [low_rank(M, rank) for rank in (1, 2, 3)]
    modes = learn_forms(learn, problems, forms, **RUNNING)
    assert learned == [(60, 1)]
    assert [len(of_form) for of_form in modes] == [n_outputs] * 3
    for form, of_form in zip(forms, modes, strict=True):
        for problem, mode in zip(problems, of_form, strict=True):
            assert mode.n_samples == N
            data = replace(problem.data, Z=mode.Z)
            bound = problem.with_form(form).with_data(data).likelihood()
            np.testing.assert_allclose(bound.value(mode.theta), mode.value, rtol=1e-10)
    values = np.array([[mode.value for mode in of_form] for of_form in modes])
    assert (np.diff(values, axis=0) >= 0.0).all()
    assert (values[1, 0] - values[0, 0]) > 20.0  # of the first output rank 2 is true


def test_a_rank_that_is_learned_alone_begins_at_a_lower_one():
    problems, learn, learned = asked(*draw(2))
    form = low_rank(M, 2)
    [[mode]] = learn_forms(learn, problems, [form], **RUNNING)
    assert learned == [(60, 1)]
    assert len(problems[0].prior.with_form(form).values(mode.theta).rho) == 2 * M
    [_, [grown]] = learn_forms(learn, problems, [low_rank(M, 1), form], **RUNNING)
    assert mode.value == grown.value
    assert mode.n_evaluations > grown.n_evaluations


def test_ranks_of_which_none_can_be_told_begin_at_a_lower_one():
    problems, learn, learned = asked(*draw(2))
    forms = [low_rank(M, rank) for rank in (2, 3, 4)]
    modes = learn_forms(learn, problems, forms, **RUNNING)
    assert learned == [(60, 1)]
    assert len(modes) == 3
    [[alone]] = learn_forms(learn, problems, forms[:1], **RUNNING)
    assert modes[0][0].n_evaluations == alone.n_evaluations
    values = np.array([mode.value for [mode] in modes])
    assert values[0] == alone.value
    assert (np.diff(values) >= 0.0).all()


@pytest.mark.parametrize(("until_worse", "n"), [(False, 5), (True, 3)])
def test_a_search_ends_when_ranks_get_worse(until_worse, n):
    problems, learn, _ = asked(*draw(1))
    forms = [low_rank(M, rank) for rank in (1, 2, 3, 4, 5)]
    modes = learn_forms(learn, problems, forms, until_worse=until_worse, **RUNNING)
    assert len(modes) == n


def test_exact_inference_learns_all_ranks_from_all_rows(monkeypatch):
    X, y = draw(1)
    problems, learn, learned = asked(X[:60], y[:60], inference="dense", max_iter=3)
    monkeypatch.setattr(growing, "grow", None)
    forms = [low_rank(M, rank) for rank in (1, 5)]
    modes = learn_forms(learn, problems, forms, until_worse=True, **RUNNING)
    assert learned == [(60, 1), (60, 5)]
    assert len(modes) == 2


@pytest.mark.parametrize(
    ("ranks", "n"),
    [(None, 5), pytest.param((0, 1, 2, 3, 4), 5, marks=pytest.mark.long)],
)
def test_ranks_that_are_given_are_all_learned(ranks, n):
    X, y = draw(1)
    search = RankSearchIC(MODEL, ranks=ranks, keep_estimators=True).fit(X, y)
    assert len(search.results_) == len(search.estimators_) == n
    assert search.best_model_ == "rank 1"


@pytest.mark.parametrize("simpler", ["auto", False])
def test_a_search_compares_ranks_with_functions_of_their_own(simpler, monkeypatch):
    monkeypatch.setattr(forms, "MOST_RANK", 1)  # else two functions have all phases
    search = RankSearchIC(MODEL, simpler=simpler).fit(*of_their_own(0.3))
    names = search.results_["model"].tolist()
    more = ["compound symmetry"] if simpler == "auto" else []
    assert names == ["shared", "rank 1", *more]
    assert (search.best_model_ == "compound symmetry") is (simpler == "auto")


@pytest.mark.parametrize(("n_exact", "rank"), [(60, 1), (120, 2), (200, 5)])
def test_default_rank_is_one_that_the_exact_rows_tell(n_exact, rank):
    X, y = draw(2)
    options = {"n_exact": n_exact, "max_iter": 0}
    model = MultiTaskGPRegressor(**MODEL.get_params(deep=False) | options).fit(X, y)
    assert model.rank_ == rank  # which has 12, 23, 50 numbers


@pytest.mark.parametrize("rank", [1, 2])
def test_default_rank_is_chosen_from_all_rows(rank):
    """Although the exact rows tell rank 1 alone."""
    model = MultiTaskGPRegressor(**MODEL.get_params(deep=False)).fit(*draw(rank))
    assert model.rank_ == rank


def of_their_own(size, seed=0):
    """A function of all tasks, and those of the tasks' own of a size."""
    rng = np.random.default_rng(seed)
    x, tasks = rng.uniform(-2.0, 2.0, N), np.arange(N) % M
    phase = rng.uniform(0.0, 6.0, M)[tasks]
    y = np.sin(2.0 * x) + size * np.sin(2.0 * x + phase) + 0.2 * rng.standard_normal(N)
    return np.column_stack([x, tasks]), y


@pytest.mark.parametrize(("size", "own"), [(0.0, False), (0.3, "equal")])
@pytest.mark.parametrize("seed", [0, *rarely(1, 2)])
def test_tasks_may_have_functions_of_their_own(size, own, seed, monkeypatch):
    """Although the likeliest form of the exact rows has none."""
    X, y = of_their_own(size, seed)
    monkeypatch.setattr(forms, "MOST_RANK", 1)  # else two functions have all phases
    model = MultiTaskGPRegressor(**MODEL.get_params(deep=False)).fit(X, y)
    assert (model.rank_, model.shared_, model.diagonal_) == (0, True, own)
    dense = MultiTaskGPRegressor(
        RBF(1.0),
        rank=0,
        shared=True,
        diagonal=own,
        normalize_y="shared",
        noise="shared",
    ).fit(X, y)
    most = dense.log_marginal_likelihood_value_
    assert most - 1.0 < model.log_marginal_likelihood_value_ < most + 0.01


def test_own_functions_of_one_variance_are_tried_beside_those_of_several(monkeypatch):
    """The exact rows may speak for a variance of each task, which all rows do not."""
    monkeypatch.setattr(forms, "MOST_RANK", 1)
    begun = {"forms": [low_rank(M, 1, diagonal=True)]}
    learn_best = growing.learn_best
    monkeypatch.setattr(
        growing,
        "learn_best",
        lambda parts, _, **running: learn_best(parts, **begun, **running),
    )
    model = MultiTaskGPRegressor(**MODEL.get_params(deep=False))
    model.fit(*of_their_own(0.3))
    assert (model.rank_, model.shared_, model.diagonal_) == (0, True, "equal")


@pytest.mark.parametrize(
    ("form", "n_inducing", "tried"),
    [
        (low_rank(M, 0, shared=True), 15, True),
        (low_rank(M, 0, shared=True), 480, True),
        (low_rank(M, 0, shared=True, diagonal="equal"), 15, False),
        (low_rank(M, 0, diagonal="equal"), 15, False),
        (low_rank(M, 1), 15, True),
        (low_rank(M, 1, diagonal=True), 15, True),
    ],
)
def test_where_functions_of_their_own_are_tried(form, n_inducing, tried):
    [problem], *_ = asked(*draw(1), n_inducing=n_inducing)
    assert growing._may_own(problem, form) is tried


def test_functions_of_their_own_of_many_tasks_would_take_long(monkeypatch):
    monkeypatch.setattr(growing, "TIMES", 5.0)
    [problem], *_ = asked(*draw(1), n_inducing=400)
    assert not growing._may_own(problem, low_rank(M, 0, shared=True))


def test_a_higher_rank_wakes_features_that_the_lower_one_switched_off():
    """Of one feature alone there is no gradient where its length-scale is endless."""
    rng = np.random.default_rng(0)
    X, tasks = rng.uniform(-2.0, 2.0, (N, 2)), np.arange(N) * M // N
    z = np.column_stack([3.0 * np.sin(2.0 * X[:, 0]), np.square(X[:, 1]) - 1.0])
    y = (rng.standard_normal((M, 2))[tasks] * z).sum(axis=1)
    y += 0.5 * rng.standard_normal(N)
    kernel = RBF([1.0, 1.0], (1e-2, 1e4))
    [problem], _, _ = asked(np.column_stack([X, tasks]), y, kernel=kernel)
    [part] = exact_part([problem], [low_rank(M, 1)])
    one = part.with_data(problem.data).with_form(low_rank(M, 1))
    kernel = np.log([0.7, 1e3])
    K_rho = np.full((M, M), 0.1) + np.eye(M)
    mode = climbing.climb(one, one.theta(kernel=kernel, K_rho=K_rho))
    assert one.prior.values(mode.theta).kernel[1] > np.log(100.0)
    two = one.with_form(low_rank(M, 2))
    asleep = growing.grow(one, two, mode)
    awake = growing.grown_in_two_ways(one, two, mode)
    assert two.prior.values(awake.theta).kernel[1] < np.log(10.0)
    assert awake.value > asleep.value + 50.0


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_noisy_data_only_begin_to_be_learned_from_some_rows(monkeypatch, noise):
    tols, minimize = [], climbing.minimize

    def recorded(*arguments, tol, **options):
        tols.append(tol)
        return minimize(*arguments, tol=tol, **options)

    X, y = draw(1)
    y = np.sin(2.0 * X[:, 0]) + noise * np.random.default_rng(1).standard_normal(N)
    [problem], learn, _ = asked(X, y)
    monkeypatch.setattr(climbing, "minimize", recorded)

    def tols_of(problem):
        tols.clear()
        learn([problem], [low_rank(M, 1)], **RUNNING)
        return set(tols)

    exact, rough = problem.budget.tol, problem.tuning.relaxed_tol
    [part] = exact_part([problem], [low_rank(M, 1)])
    whole = replace(part, budget=replace(part.budget, only_begins=False))
    assert tols_of(whole) == {exact, rough}
    assert tols_of(part) == ({rough} if noise else {exact, rough})
