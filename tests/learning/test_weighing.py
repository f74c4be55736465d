"""Which form of K^rho is taken: eq. 8, the prior of the noise, and the evidence."""

from dataclasses import replace

import building
import numpy as np
import pytest
import textbook
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC, model_selection
from skmtgp.inference.engines import Sparse
from skmtgp.learning import weighing
from skmtgp.learning.climbing import climb
from skmtgp.learning.evidence import evidence_around
from skmtgp.learning.tuning import TUNING, Tuning
from skmtgp.learning.weighing import (
    best_of_forms,
    corrections,
    evidences,
    evidences_in_reach,
    few_hyperparameters,
    is_overexplained,
    is_unrelated,
    is_weighed,
    log_odds,
    may_be_weighed,
    near_best,
    noise_penalty,
    overpriced,
    penalties,
    plausible,
    simplest,
    worths_of,
)
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.several import Forms
from skmtgp.model.task_covariance import low_rank

M, KERNEL = 3, RBF(1.0)


@pytest.fixture(scope="module")
def learned():
    """Problems of ranks 1 to 3, of data of rank 1, and their modes."""
    rng = np.random.default_rng(3)
    tasks = np.repeat(np.arange(M), 15)
    X = rng.uniform(0.0, 6.0, (len(tasks), 1))
    K = textbook.covariance(KERNEL, np.ones((M, M)), 0.01, X, tasks)
    y = np.linalg.cholesky(K) @ rng.standard_normal(len(tasks))
    data = building.data(X, tasks, y, M)
    problems = [[building.problem(KERNEL, low_rank(M, r), data)] for r in (1, 2, 3)]
    modes = [[climb(of, of.theta(K_rho=0.1 * np.eye(M) + 1.0))] for [of] in problems]
    return problems, modes


def tuned(problems, **changes):
    """The same problems with other constants."""
    return [[replace(of, tuning=Tuning(**changes))] for [of] in problems]


def without_noise(modes, log_noise=-23.0):
    """The same modes with almost no noise."""
    changed = [mode.theta.copy() for [mode] in modes]
    for theta in changed:
        theta[-1] = log_noise
    pairs = zip(modes, changed, strict=True)
    return [[mode._replace(theta=theta)] for [mode], theta in pairs]


def test_penalty_is_the_prior_of_the_noise(learned):
    [[problem], *_], [[mode], *_] = learned
    prior = problem.prior
    hyperprior, other = Hyperprior(prior), mode.theta.copy()
    other[-1] = -20.0
    at_centre = mode.theta.copy()
    at_centre[-1] = hyperprior.centre[-1]
    assert noise_penalty(prior, at_centre) == 0.0
    gap = hyperprior.log_density(at_centre)[0] - hyperprior.log_density(other)[0]
    assert noise_penalty(prior, other) == pytest.approx(gap)


def test_weak_priors_have_it_already(learned):
    problems, modes = learned
    weak = [[replace(of, weak_priors=True)] for [of] in problems]
    assert penalties(weak, without_noise(modes)).tolist() == [0.0] * 3
    assert (penalties(problems, without_noise(modes)) > 10.0).all()


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
    least = weighing.worth(problem, mode) - 1.5 * problem.prior.n_hyperparameters
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


def test_eq_8_may_price_numbers_of_tasks_too_high(learned):
    """Those of one of three tasks are told by a third of the rows."""
    problems, modes = learned
    numbers = np.array([3, 5, 6])  # of ranks 1 to 3
    np.testing.assert_allclose(overpriced(problems), 0.5 * numbers * np.log(3.0))
    gap = np.ptp(plausible(problems, modes)[:2]) - np.log(3.0)  # two numbers more
    for within, near in ((gap - 1e-6, [0]), (gap + 1e-6, [0, 1])):
        assert near_best(tuned(problems, weighed_within=within), modes) == near
    # larger ones would take too long, but for those that eq. 8 itself is for
    within = {"weighed_within": gap + 1e-6}
    large = tuned(problems, **within, most_weighed=(6, 6))
    assert near_best(large, modes) == [0]
    # and one that did not end must not keep the others from their evidence
    stopped = [modes[0], [modes[1][0]._replace(converged=False)], modes[2]]
    assert near_best(tuned(problems, **within), stopped) == [0]


def test_how_many_hyperparameters_do_not_take_too_long(learned):
    problems, _ = learned  # of 45 rows, with 5, 7 and 8
    for most, few in ((8, True), (7, False)):
        assert few_hyperparameters(tuned(problems, most_weighed=(most, 0))) == few
        work = {"most_weighed": (300, 0), "weighed_work": 45 * most}
        assert few_hyperparameters(tuned(problems, **work)) == few
        work["most_weighed"] = (300, 8)  # whatever the number of rows
        assert few_hyperparameters(tuned(problems, **work))


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
        monkeypatch.setattr(weighing, "Forms", type(low_rank(M, 1)))
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
    several = _of_terms()
    assert log_odds([[several]], [modes], 1).tolist() == [0.0]
    apart = problem.with_form(low_rank(M, 0, True))
    sparse = replace(apart, engine=Sparse())
    assert log_odds([[sparse]], [modes], 1).tolist() == [0.0]
    assert log_odds([[apart]], [modes], 1).tolist() == [-3.0]


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


def test_several_terms():
    assert not may_be_weighed(
        [[building.problem(KERNEL, low_rank(M, 1), None)], [_of_terms()]]
    )


def test_many_rows_are_left_to_bic(learned):
    problems, _ = learned
    most = max(of.prior.n_hyperparameters for [of] in problems)
    assert may_be_weighed(problems)
    assert may_be_weighed(problems, TUNING.rows_weighed * most)
    assert not may_be_weighed(problems, TUNING.rows_weighed * most + 1)


def _of_terms():
    problem = building.problem(KERNEL, low_rank(M, 1), None)
    prior = replace(problem.prior, task_covariance=Forms([low_rank(M, 1)] * 2))
    return replace(problem, prior=prior)


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


def test_a_factor_of_zeros_has_a_likelihood_but_no_prior():
    """As where nothing is learned."""
    rng = np.random.default_rng(0)
    observations = building.data(
        rng.normal(size=(9, 1)), np.arange(9) // 3, rng.normal(size=9), 3
    )
    plain = building.problem(RBF(1.0), low_rank(3, 1), observations)
    theta = plain.theta(K_rho=np.zeros((3, 3)))
    penalised = replace(plain, weak_priors=True)
    mode = climb(plain, theta)._replace(theta=theta, value=-np.inf)
    assert penalised.likelihood().value(theta) == -np.inf
    found = penalised.log_likelihood(mode)
    assert found == pytest.approx(plain.likelihood().value(theta))
    assert weighing.worth(penalised, mode, times=4.0) == -np.inf


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


def test_whether_few_rows_are_explained_too_well(learned):
    problems, modes = learned
    rows = tuned(problems, rows_told=5)
    sizes = [of.prior.n_hyperparameters for [of] in problems]
    assert not is_overexplained(rows, modes, 5 * sizes[0])
    assert is_overexplained(rows, modes, 5 * sizes[0] - 1)
    # what no form takes for noise is none
    assert not is_overexplained(rows, without_noise(modes), 5)
    form = low_rank(M, 0, "equal", shared=True)
    [[problem], *_], [[mode], *_] = rows, modes
    small = problem.with_form(form)
    rho = form.parameters(problem.prior.K_rho_at(mode.theta))
    noisy = mode._replace(theta=small.prior.with_rho(mode.theta, rho), value=-1e3)
    with_small = [[small], *rows], [[noisy], *without_noise(modes)]
    assert is_overexplained(*with_small, 5)
    sizes = [small.prior.n_hyperparameters, *sizes]
    for n in (4, 9):  # forms with more than half as many are left out, if not all
        most = max(n // 2, sizes[0] + 1)
        expected = [k for k, size in enumerate(sizes) if size <= most]
        assert near_best(*with_small, n) == expected
