"""Which form of K^rho is taken: by its evidence, or by eq. 8."""

from dataclasses import replace

import building
import numpy as np
import of_ranks
import pytest
import textbook
from of_ranks import KERNEL, M, of_terms, tuned, without_noise
from sklearn.base import clone

from skmtgp import MultiTaskGPRegressor, RankSearchIC, model_selection
from skmtgp.inference.engines import Sparse
from skmtgp.learning import contenders, weighing
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import (
    is_weighed,
    may_be_weighed,
    near_best,
    penalties,
    worths_of,
)
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.weighing import (
    best_of_forms,
    corrections,
    evidences,
    evidences_in_reach,
    is_unrelated,
    log_odds,
    simplest,
)
from skmtgp.model.task_covariance import low_rank


@pytest.fixture(scope="module", name="learned")
def _learned():
    return of_ranks.learned()


@pytest.mark.parametrize("noise", [1e-1, 1e-7])
def test_evidence_is_not_far_below_eq_8(noise):
    """With little noise each number costs some six nats by Laplace's method."""
    rng, tasks = np.random.default_rng(0), np.repeat(np.arange(M), 12)
    X, F = rng.uniform(0.0, 6.0, (len(tasks), 1)), rng.standard_normal((M, 2))
    K = textbook.covariance(KERNEL, F @ F.T, noise, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(tasks))
    data = building.data(X, tasks, y, M)
    problem = building.problem(KERNEL, low_rank(M, 2), data, noise=noise)
    mode = climb(problem, problem.theta(K_rho=F @ F.T))
    least = contenders.worth(problem, mode) - 1.5 * problem.prior.n_hyperparameters
    found = evidence_around(problem.likelihood(), mode.theta)
    assert (found < least) == (noise < 1e-3)
    assert weighing.evidence_of_form(problem, mode) == max(found, least)


def test_only_those_near_the_best_have_their_evidence(learned):
    problems, modes = learned
    problems = tuned(problems, weighed_within=3.0)
    near = near_best(problems, modes)
    assert near == [0, 1]
    found = worths_of(problems, modes) + corrections(problems, modes)
    told = evidences([problems[k] for k in near], [modes[k] for k in near])
    assert found[0] - found[1] == pytest.approx(told[0] - told[1], abs=1e-6)
    assert found.argmax() == np.argmax(told) == 0
    assert found[2] < found[0] - 4.5


def test_evidences_that_cannot_be_the_highest_are_not_computed(learned, monkeypatch):
    problems, modes = learned
    told = evidences(problems, modes)
    assert evidences_in_reach(problems, modes) == pytest.approx(told)
    worse = [modes[0], *([of._replace(value=-50.0)] for [of] in modes[1:])]
    monkeypatch.setattr(weighing, "evidences", lambda of, *_: told[:1])
    assert evidences_in_reach(problems, worse).tolist() == [told[0], -np.inf, -np.inf]


def test_the_evidence_chooses_among_all(learned, monkeypatch):
    """Also what eq. 8 puts far below forms of which the evidence is not asked."""
    problems, modes = learned
    low = -50.0 - np.arange(2.0)
    monkeypatch.setattr(weighing, "weighed", lambda *_, **__: [1, 2])
    monkeypatch.setattr(weighing, "evidences_in_reach", lambda *_: low)
    found = worths_of(problems, modes) + corrections(problems, modes)
    assert found[1] == pytest.approx(found.max())
    assert found[2] == pytest.approx(found.max() - 1.0)


def test_one_alone_needs_no_evidence(learned, monkeypatch):
    problems, modes = learned
    problems = tuned(problems, weighed_within=0.0)
    monkeypatch.setattr(weighing, "evidences_in_reach", None)
    assert corrections(problems, modes).tolist() == (-penalties(*learned)).tolist()
    assert weighing.weighed(problems, modes, every=True) == [0, 1, 2]  # told before


@pytest.mark.parametrize("why", ["noise", "unfinished", "large", "terms"])
def test_eq_8_chooses_otherwise(learned, why, monkeypatch):
    problems, modes = learned
    assert is_weighed(problems, modes)
    assert may_be_weighed(problems)
    if why == "noise":
        modes = without_noise(modes)
    elif why == "unfinished":
        modes = [[mode._replace(converged=False)] for [mode] in modes]
    elif why == "large":
        problems = tuned(problems, most_weighed=(3, 3))
    else:
        monkeypatch.setattr(contenders, "Forms", type(low_rank(M, 1)))
    assert corrections(problems, modes).tolist() == [0.0] * 3


@pytest.mark.parametrize(
    ("evidences", "sizes", "expected"),
    [
        ([-3.0, -1.0, -5.0], [3, 4, 2], 1),
        ([-1.5, -1.0, -5.0], [3, 4, 2], 0),
        ([-2.2, -1.0, -1.9], [2, 4, 3], 2),
        ([-3.3, 0.0], [5, 53], 0),
        ([-1.2, -1.0, -np.inf], [3, 3, 1], 1),
        ([np.inf, -1.0], [3, 3], 0),
    ],
    ids=["clear", "close", "too far", "many more", "alike", "infinite"],
)
def test_the_simplest_of_the_close(evidences, sizes, expected):
    assert simplest(np.array(evidences), sizes) == expected


def test_the_best_form_is_the_simplest_of_the_close(learned, monkeypatch):
    problems, modes = learned
    monkeypatch.setattr(
        weighing, "evidences_in_reach", lambda *_: np.array([-0.9, 0.0])
    )
    constants = {"weighed_within": 3.0, "rows_if_close": 16}
    assert best_of_forms(tuned(problems, **constants), modes) == 0
    assert best_of_forms(tuned(problems, **constants, tie=0.5), modes) == 1


CLOSE = {"evidences": [-1.5, 0.0], "by_eq_8": [-9.0, 0.0], "sizes": [3, 6]}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 1),
        ({"evidences": [0.0, -1.9]}, 1),
        ({"evidences": [0.0, -2.1]}, 0),
        ({"evidences": [-0.9, 0.0], "by_eq_8": [-0.9, 0.0]}, 0),
        ({"evidences": [-0.9, 0.0], "by_eq_8": [-1.1, 0.0]}, 1),
        ({"evidences": [0.0, -1.0], "sizes": [3, 8]}, 0),
        ({"evidences": [0.0, -np.inf]}, 0),
        ({"by_eq_8": [0.0, -9.0], "sizes": [6, 3]}, 0),
    ],
    ids=["clear", "near", "far", "alike", "gains", "large", "infinite", "smaller"],
)
def test_eq_8_decides_where_the_evidence_is_close(learned, changes, expected):
    [[problem], *_], _ = learned  # 45 rows
    found = {key: np.array(of) for key, of in {**CLOSE, **changes}.items()}
    assert weighing.preferred(problem=problem, **found) == expected


def test_eq_8_does_not_decide_where_inputs_are_apart(learned):
    """The simplest is taken: what it predicts is the least."""
    [[problem], *_], _ = learned
    found = {key: np.array(of) for key, of in CLOSE.items()}
    found["evidences"] = np.array([-0.5, 0.0])
    assert weighing.preferred(problem=problem, **found) == 1
    data = problem.data
    apart = replace(data, X=data.X % 1.0 + data.tasks[:, None])
    assert weighing.preferred(problem=problem.with_data(apart), **found) == 0


def of_forms(problem, forms):
    """Problems of some forms, and modes."""
    problems = [[problem.with_form(form)] for form in forms]
    K_rho = np.eye(M) + 1.0
    return problems, [[climb(of, of.theta(K_rho=K_rho))] for [of] in problems]


@pytest.mark.parametrize(("n", "seldom", "taken"), [(14, -3.0, -5.0), (15, 0.0, 0.0)])
def test_few_rows_a_task_have_little_of_their_own(learned, n, seldom, taken):
    """Fewer than five rows a task: unrelated tasks, functions that hide the noise."""
    [[problem], *_], _ = learned
    apart, alike = low_rank(M, 0, True), low_rank(M, 0, True, True)
    forms = [low_rank(M, 1), apart, alike, low_rank(M, 0, False, True)]
    problems, modes = of_forms(problem, forms)
    assert log_odds(problems, modes, n).tolist() == [0.0, seldom, 0.0, 0.0]
    noise = modes[3][0].theta[-1]  # of the likeliest
    for share, odds in ((0.21, 0.0), (0.19, taken)):
        [modes[2]] = without_noise([modes[2]], noise + np.log(share))
        assert log_odds(problems, modes, n).tolist() == [0.0, seldom, odds, 0.0]
    [modes[1]] = without_noise([modes[1]])
    assert log_odds(problems, modes, n).tolist() == [0.0, taken, taken, 0.0]
    assert log_odds(problems[1:3], modes[1:3], n).tolist() == [seldom, 0.0]


def test_tasks_with_inputs_of_their_own_are_unrelated(learned):
    [[problem], *_], _ = learned
    data = problem.data
    apart = replace(data, X=data.X % 1.0 + data.tasks[:, None])
    forms = [low_rank(M, 1), low_rank(M, 0, True), low_rank(M, 0, True, True)]
    problems, modes = of_forms(problem.with_data(apart), forms)
    assert log_odds(problems, modes).tolist() == [-1.0, 0.0, -1.0]
    assert log_odds(problems, modes, 14)[:2].tolist() == [-1.0, -3.0]


def test_odds_of_few_rows_and_of_inputs_apart_add_up(learned):
    [[problem], *_], _ = learned
    data = problem.data
    apart = replace(data, X=data.X % 1.0 + data.tasks[:, None])
    forms = [low_rank(M, 1), low_rank(M, 0, True, True)]
    problems, modes = of_forms(problem.with_data(apart), forms)
    [modes[1]] = without_noise([modes[1]])
    assert log_odds(problems, modes, 14).tolist() == [-1.0, -6.0]


def test_odds_are_those_among_all_forms(learned, monkeypatch):
    """Also if the evidence chooses among some of them."""
    [[problem], *_], _ = learned
    forms = [low_rank(M, 1), low_rank(M, 0, True, True), low_rank(M, 0, True)]
    problems, modes = of_forms(problem, forms)
    problems = tuned(problems, few_rows=16, rows_if_close=16)
    [modes[1]] = without_noise([modes[1]])
    monkeypatch.setattr(weighing, "weighed", lambda *_, **__: [1, 2])
    monkeypatch.setattr(weighing, "evidences_in_reach", lambda *_: np.array([4.0, 3.0]))
    assert best_of_forms(problems, modes) == 2


def test_odds_are_of_one_term_that_is_learned_exactly(learned):
    [[problem], *_], [modes, *_] = learned
    several = of_terms()
    assert log_odds([[several]], [modes], 1).tolist() == [0.0]
    apart = problem.with_form(low_rank(M, 0, True))
    assert log_odds([[apart]], [modes], 1).tolist() == [-3.0]


def test_ranks_pay_for_a_task_by_its_own_rows_where_learning_is_not_exact(learned):
    """Beside own functions of one variance, which have no number of a task."""
    [[problem], *_], _ = learned
    own = [low_rank(M, 0, "equal"), low_rank(M, 0, "equal", shared=True)]
    forms = [*own, low_rank(M, 1), low_rank(M, 2), low_rank(M, 1, True)]
    problems = [[problem.with_form(form)] for form in forms]
    modes = [[climb(of, of.theta(K_rho=np.eye(M)))] for [of] in problems]
    best = forms[2 + np.argmax(worths_of(problems[2:], modes[2:]))]
    refund = 0.5 * best.n_free * np.log(M)
    sparse = [[replace(of, engine=Sparse())] for [of] in problems]
    odds = log_odds(sparse, modes)
    np.testing.assert_allclose(odds, [0.0, 0.0, refund, refund, refund], rtol=1e-12)


def test_little_of_their_own_by_eq_8(learned, monkeypatch):
    """The prior of a form counts where the evidence is not asked, too."""
    [[problem], *_], _ = learned
    forms = [low_rank(M, 0, False, True), low_rank(M, 0, True)]
    problems, modes = of_forms(problem, forms)
    monkeypatch.setattr(weighing, "weighed", lambda *_, **__: [])
    few = tuned(problems, few_rows=16)  # there are 15 rows a task
    assert corrections(few, modes).tolist() == [0.0, -3.0]
    monkeypatch.setattr(weighing, "worths_of", lambda *_: np.array([0.0, 2.9]))
    assert (best_of_forms(problems, modes), best_of_forms(few, modes)) == (1, 0)
    monkeypatch.setattr(weighing, "worths_of", lambda *_: np.array([0.0, 3.1]))
    assert best_of_forms(few, modes) == 1


def test_few_rows_that_are_related_by_a_hair(learned, monkeypatch):
    """Unrelated tasks of more evidence are not taken if it is not much more."""
    [[problem], *_], _ = learned
    odd = [[problem.with_form(low_rank(M, 0, True))], [problem]]
    modes = [[climb(of, of.theta(K_rho=np.eye(M)))] for [of] in odd]
    monkeypatch.setattr(weighing, "weighed", lambda *_, **__: [0, 1])
    monkeypatch.setattr(weighing, "evidences_in_reach", lambda *_: np.array([3.5, 0.0]))
    assert best_of_forms(odd, modes) == 0
    odd = tuned(odd, few_rows=20, rows_if_close=20)  # there are 15 rows a task
    assert best_of_forms(odd, modes) == 0
    monkeypatch.setattr(weighing, "evidences_in_reach", lambda *_: np.array([2.0, 0.0]))
    assert best_of_forms(odd, modes) == 1


def test_odds_of_forms_count_in_a_search(monkeypatch):
    rng = np.random.default_rng(0)
    tasks, x = np.repeat(np.arange(4), 12), rng.uniform(0.0, 6.0, 48)
    X, y = np.column_stack([x, tasks]), np.sin(x) + 0.3 * rng.standard_normal(48)
    search = RankSearchIC(MultiTaskGPRegressor(kernel="rbf", noise="shared"))
    before = search.fit(X, y).results_
    assert search.criterion_ == "laplace"
    alike = before["chosen"].to_numpy()
    odds = np.where(alike, -1e3, 0.0)
    # of single tasks, the last, they are those of independent ones
    monkeypatch.setattr(model_selection, "log_odds", lambda *_: odds[:-1])
    after = search.fit(X, y).results_
    assert after["model"][after["chosen"]].item() != before["model"][alike].item()
    assert not after["chosen"].iloc[-1]
    np.testing.assert_allclose(after["laplace"], before["laplace"])


def test_single_tasks_have_the_odds_of_independent_ones(monkeypatch):
    rng = np.random.default_rng(0)
    tasks, x = np.repeat(np.arange(4), 12), rng.uniform(0.0, 6.0, 48)
    X, y = np.column_stack([x, tasks]), np.sin(x) + 0.3 * rng.standard_normal(48)
    told = []
    monkeypatch.setattr(
        model_selection,
        "log_odds",
        lambda problems, _: np.array(
            [-7.0 * is_unrelated(of[0].prior.task_covariance) for of in problems]
        ),
    )
    monkeypatch.setattr(
        model_selection, "preferred", lambda values, *_: told.append(values) or 0
    )
    table = RankSearchIC().fit(X, y).results_
    expected = -7.0 - 0.5 * table["laplace"].iloc[-1]
    assert table["model"].iloc[-1] == "single tasks"
    assert told[0][-1] == pytest.approx(expected)


def few_rows(seed):
    """Eight tasks of five rows each, of which rank 1 leaves no noise."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(8), 5)
    x = rng.uniform(0.0, 6.0, (len(task), 2))
    weights, levels = rng.standard_normal((2, 8))
    f = np.sin(1.2 * x[:, 0] + rng.uniform(0.0, 6.0))
    f *= np.cos(0.9 * x[:, 1] + rng.uniform(0.0, 6.0))
    y = weights[task] * f + levels[task] + 0.1 * rng.standard_normal(len(task))
    return np.column_stack([x, task]), y


@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.long)])
def test_noise_of_few_rows_does_not_vanish(seed, monkeypatch):
    """By the evidence alone; it has a prior besides."""
    monkeypatch.setattr(MultiTaskGPRegressor, "_some_noise", lambda _: False)
    X, y = few_rows(seed)
    by_bic = RankSearchIC(ranks=(0, 1), simpler=True, criterion="bic").fit(X, y)
    assert by_bic.best_estimator_.noise_variance_ < 1e-5
    search = clone(by_bic).set_params(criterion="auto").fit(X, y)
    model = MultiTaskGPRegressor().fit(X, y)
    assert search.criterion_ == "laplace"
    for best in (search.best_estimator_, model):
        assert best.noise_variance_ > 1e-3


def grown(seed, n_tasks=27):
    """Two of the four rows of each task, and the others: a line for each."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(n_tasks), 4)
    age = np.tile([8.0, 10.0, 12.0, 14.0], n_tasks)
    levels, slopes = rng.normal(17.0, 2.0, n_tasks), rng.normal(0.65, 0.1, n_tasks)
    y = levels[task] + slopes[task] * age + 1.3 * rng.standard_normal(len(age))
    train = np.argsort(rng.uniform(size=(n_tasks, 4)), axis=1).ravel() < 2
    X = np.column_stack([age, task])
    return X[train], np.round(2.0 * y[train]) / 2.0, X[~train], y[~train]


@pytest.mark.parametrize("search", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_as_many_numbers_as_rows(search, seed):
    """Rank 1 and levels explain all rows without noise: intervals would be points."""
    X, y, X_new, y_new = grown(seed)
    model = MultiTaskGPRegressor("rbf")
    model = (RankSearchIC(model) if search else model).fit(X, y)
    mean, std = model.predict(X_new, return_std=True, include_noise=True)
    assert np.mean(np.abs(y_new - mean) < 1.96 * std) > 0.8
    assert np.sqrt(np.mean((y_new - mean) ** 2)) < 2.0


def test_too_many_hyperparameters_are_no_reason_for_eq_8():
    """Rank 2 has more of them than half the rows."""
    X, y, *_ = grown(0, n_tasks=60)
    search = RankSearchIC(ranks=(1, 2), simpler=True).fit(X, y)
    assert search.criterion_ == "laplace"
    assert np.isnan(search.results_["laplace"][search.results_["rank"] == 2]).all()
    assert search.best_rank_ == 0
