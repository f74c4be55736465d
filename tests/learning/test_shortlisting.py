"""The default model's rank: chosen from sketches of all candidates."""

from functools import cache
from math import comb
from types import SimpleNamespace

import building
import numpy as np
import pytest
from scipy.special import gammaln
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._data.data import Data
from skmtgp._estimators.forms import rows_for
from skmtgp.inference.engines import Dense
from skmtgp.learning import shortlisting
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import worth
from skmtgp.learning.problem import Budget, Problem
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank


def functions(x, n):
    """Some that are alike in smoothness and otherwise unrelated."""
    phases = np.arange(n)[:, None]
    return np.sin((1.0 + 0.23 * phases) * x + phases**2)


def drawn(weights, per_task=20, noise=0.1, seed=0):
    """Tasks that mix functions; each row of the weights is a task."""
    weights = np.asarray(weights, dtype=float)
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(len(weights)), per_task)
    x = rng.uniform(0.0, 6.0, len(task))
    y = (weights[task].T * functions(x, weights.shape[1])).sum(axis=0)
    y += noise * rng.standard_normal(len(y)) + np.arange(len(weights))[task]
    return np.column_stack([x, task]), y


WEIGHTS = np.random.default_rng(1).standard_normal((6, 2))
ALONE = np.column_stack([[1.0, -1.5, 2.0, 0.7, -1.0, 0.0], [0.0] * 5 + [1.3]])
CASES = {
    "rank 1": WEIGHTS[:, :1],
    "rank 2": WEIGHTS,
    "independent": np.eye(4),
    "shared": np.ones((5, 1)),
    "compound symmetry": np.column_stack([np.ones(5), 0.5 * np.eye(5)]),
    "rank 1 and diagonal": ALONE,
}


def name(model):
    return str(model._likelihoods[0].prior.task_covariance)


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """The true form, the data, and the model that was chosen."""
    X, y = drawn(CASES[request.param])
    return request.param, X, y, MultiTaskGPRegressor().fit(X, y)


def test_the_true_form_is_chosen(case):
    truth, *_, model = case
    assert name(model) == truth


def test_the_form_is_told(case):
    *_, model = case
    form = model._likelihoods[0].prior.task_covariance
    assert (model.rank_, model.shared_) == (form.rank, form.shared)
    assert model.diagonal_ == ("equal" if getattr(form, "equal", 0) else form.n_own > 0)
    params = {"rank": None, "shared": False, "diagonal": False}
    assert params.items() <= model.get_params().items()


def test_likelihood_is_that_of_the_form_alone(case):
    """What was sketched is learned as well as if it had been asked for."""
    _, X, y, model = case
    asked = {
        name: getattr(model, f"{name}_") for name in ("rank", "shared", "diagonal")
    }
    asked |= {"normalize_y": model.normalize_y_, "noise": model.noise_}
    alone = MultiTaskGPRegressor(**asked).fit(X, y)
    value = model.log_marginal_likelihood_value_
    assert value == pytest.approx(alone.log_marginal_likelihood_value_, abs=0.5)


# of the other forms a search, which takes long, has nothing else to do
@pytest.mark.parametrize(
    "case",
    [
        pytest.param("rank 2", marks=pytest.mark.long),
        "compound symmetry",
        pytest.param("rank 1 and diagonal", marks=pytest.mark.long),
    ],
    indirect=True,
)
def test_search_chooses_the_same(case):
    truth, X, y, model = case
    options = {"ranks": range(4), "simpler": True}
    if truth == "rank 1 and diagonal":  # which is tried with the usual ranks alone
        options = {}
    search = RankSearchIC(**options).fit(X, y)
    found = search.results_.loc[lambda of: of["model"] != "single tasks"]
    best = found.loc[found["bic"].idxmin()]
    assert best["model"] == name(model)
    value = model.log_marginal_likelihood_value_
    assert best["log_marginal_likelihood"] == pytest.approx(value, abs=0.5)


def test_search_counts_what_a_diagonal_has():
    """Eq. 8 without what vanished, and the choice of it; the table has all numbers."""
    X, y = drawn(ALONE)
    search = RankSearchIC(keep_estimators=True).fit(X, y)
    table = search.results_.set_index("model")
    found = table.loc["rank 1 and diagonal"]
    model = search.estimators_[table.index.get_loc("rank 1 and diagonal")]
    assert (search.best_estimator_.rank_, search.best_estimator_.diagonal_) == (1, True)
    assert found["n_hyperparameters"] == model.n_hyperparameters_
    K, factor = model.task_covariance_, model.task_factor_
    own = np.diagonal(K - factor @ factor.T) / np.diagonal(K)
    vanished = np.count_nonzero(own < 1e-3)
    assert vanished
    count = model.n_hyperparameters_ - vanished
    deviance = -2.0 * model.log_marginal_likelihood_value_
    chosen = 2.0 * np.log(comb(6, vanished))
    expected = deviance + count * np.log(len(y)) + chosen
    assert found["bic"] == pytest.approx(expected)
    assert found["aic"] == pytest.approx(deviance + 2 * count)


@pytest.mark.parametrize("case", ["rank 2", "rank 1 and diagonal"], indirect=True)
def test_order_labels_and_units_do_not_matter(case):
    _, X, y, model = case
    rng = np.random.default_rng(0)
    order, labels = rng.permutation(len(y)), rng.permutation(len(model.tasks_))
    other = np.column_stack([X[:, 0], labels[X[:, 1].astype(int)]])
    again = MultiTaskGPRegressor().fit(other[order], 1e3 * y[order] - 7.0)
    assert name(again) == name(model)
    expected, scale = model.predict(X), y.std()
    found = (again.predict(other) + 7.0) / 1e3
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * scale)


def test_vanished_numbers_of_a_diagonal_do_not_count():
    X, y = drawn(ALONE)
    model = MultiTaskGPRegressor().fit(X, y)
    [likelihood] = model._likelihoods
    K = model.task_covariance_
    own = np.diagonal(K - model.task_factor_ @ model.task_factor_.T) / np.diagonal(K)
    assert own[-1] > 0.9
    assert (own[:-1] < 0.2).all()
    # kernel, loadings, levels and noise; and the parts of their own that there are
    left = np.count_nonzero(own > 1e-3)
    counted = 1 + 6 + 1 + 1 + left
    assert counted < model.n_hyperparameters_

    [data] = model._training().data(model._engine)
    problem = Problem(likelihood.prior, data, None, Budget(1, 1.0))
    mode = SimpleNamespace(theta=model.theta_, value=0.0)
    expected = -0.5 * counted * np.log(len(y)) - np.log(comb(6, left))
    assert worth(problem, mode) == pytest.approx(expected, rel=1e-12)


def test_complete_data_by_both_engines():
    rng = np.random.default_rng(0)
    x = np.tile(rng.uniform(0.0, 6.0, 15), 5)
    task = np.repeat(np.arange(5), 15)
    y = (WEIGHTS[task].T * functions(x, 2)).sum(axis=0)
    y += 0.1 * rng.standard_normal(len(y))
    X = np.column_stack([x, task])
    models = [
        MultiTaskGPRegressor(inference=inference).fit(X, y)
        for inference in ("dense", "kronecker")
    ]
    assert name(models[0]) == name(models[1]) == "rank 2"
    values = [model.log_marginal_likelihood_value_ for model in models]
    assert values[0] == pytest.approx(values[1], abs=0.05)


def test_outputs_share_the_form():
    """One output asks for a function, the other for two."""
    X, one = drawn(WEIGHTS[:, :1])
    _, two = drawn(WEIGHTS)
    model = MultiTaskGPRegressor().fit(X, np.column_stack([one, two]))
    assert model.rank_ == 2
    assert model.task_factor_.shape == (2, 6, 2)


def test_without_noise():
    X, y = drawn(WEIGHTS, noise=0.0)
    model = MultiTaskGPRegressor().fit(X, y)
    assert model.rank_ == 2
    assert not model.diagonal_


@pytest.mark.long
def test_processes_do_not_matter():
    X, y = drawn(WEIGHTS)
    Y = np.column_stack([y, 2.0 * y + X[:, 0]])
    one, two = (MultiTaskGPRegressor(n_jobs=n).fit(X, Y) for n in (1, 2))
    np.testing.assert_array_equal(one.theta_, two.theta_)


@pytest.mark.parametrize(("likely", "kept"), [(0, {0}), (1, {1}), (2, {1, 2})])
def test_the_rank_below_is_learned_unless_it_is_one(likely, kept):
    sketches = [SimpleNamespace(form=low_rank(4, r), is_noisy=True) for r in (1, 2, 3)]
    assert shortlisting._with_lower({likely}, [sketches]) == kept


def test_ranks_end_where_two_in_a_row_are_worse(monkeypatch):
    asked, plain = [], shortlisting._sketch

    def spy(problem, start, below):
        asked.append(str(problem.prior.task_covariance))
        return plain(problem, start, below)

    monkeypatch.setattr(shortlisting, "_sketch", spy)
    X, y = drawn(np.random.default_rng(2).standard_normal((9, 1)))
    MultiTaskGPRegressor().fit(X, y)
    simpler = ["independent", "compound symmetry", "shared"]
    assert asked == [*simpler, "rank 1", "rank 2", "rank 3"]


class WithoutDiagonals(Dense):
    """An engine of a user's own."""

    def check_form(self, form):
        if form.n_own:
            raise ValueError("Diagonals are not for this engine.")


@pytest.mark.parametrize("truth", ["independent", "rank 1 and diagonal"])
def test_an_engine_says_what_it_takes(truth):
    X, y = drawn(CASES[truth])
    given = {"noise": "shared", "normalize_y": "shared"}  # a diagonal is asked of these
    model = MultiTaskGPRegressor(inference=WithoutDiagonals(), **given).fit(X, y)
    assert not model.diagonal_
    assert model.rank_ == np.linalg.matrix_rank(CASES[truth])


@pytest.mark.parametrize(
    ("diagonal", "form"), [("equal", "independent"), (True, "rank 0 and diagonal")]
)
def test_independent_tasks_with_a_diagonal_of_the_user(diagonal, form):
    X, y = drawn(CASES["independent"])
    model = MultiTaskGPRegressor(diagonal=diagonal).fit(X, y)
    assert (name(model), model.shared_, model.diagonal_) == (form, False, diagonal)


@pytest.mark.parametrize(
    ("options", "form"),
    [
        ({"shared": True}, "compound symmetry"),
        ({"diagonal": True}, "shared and diagonal"),
        ({"diagonal": "equal"}, "compound symmetry"),
        ({"rank": 2}, "rank 2"),
    ],
)
def test_what_was_asked_for_stays(options, form):
    X, y = drawn(CASES["compound symmetry"])
    assert name(MultiTaskGPRegressor(**options).fit(X, y)) == form


def test_choices_of_many_parts_of_their_own():
    """They are more than an integer of 64 bits counts."""
    prior = Prior(RBF(1.0), low_rank(139, 1, diagonal=True))
    log_own = np.repeat([-1.0, -20.0], [70, 69])
    theta = prior.with_rho(prior.theta(), np.append(np.ones(139), log_own))
    data = Data(np.ones((500, 1)), np.arange(500) % 139, np.ones(500), 139)
    problem = Problem(prior, data, None, Budget(1, 1.0))
    found = worth(problem, SimpleNamespace(theta=theta, value=0.0))
    counted = 1 + 139 + 70 + 1  # kernel, loadings, parts of their own, noise
    of_choices = gammaln([140, 71, 70]) @ [1.0, -1.0, -1.0]
    assert found == pytest.approx(-0.5 * counted * np.log(500) - of_choices)


def test_one_task():
    X, y = drawn(np.ones((1, 1)))
    assert MultiTaskGPRegressor().fit(X, y).rank_ == 1


def test_nothing_is_compared_without_learning():
    X, y = drawn(WEIGHTS)
    assert MultiTaskGPRegressor(max_iter=0).fit(X, y).rank_ == 6


def test_it_is_said_what_was_compared(told):
    X, y = drawn(WEIGHTS)
    MultiTaskGPRegressor(verbose=1).fit(X, y)
    lines = "\n".join(told())
    for form in ("independent", "compound symmetry", "shared", "rank 2"):
        assert f"{form}: log likelihood" in lines
    assert "chosen: rank 2" in lines


def test_a_form_that_loses_its_noise_in_the_end():
    """Its sketch has some, so that it seems best; the forms left out are learned then.

    Six tasks of four rows, of one function in different amounts.
    """
    rng, n_tasks = np.random.default_rng(0), 6
    task = np.repeat(np.arange(n_tasks), [4] * n_tasks)
    x, x_new = rng.uniform(0.0, 5.0, len(task)), rng.uniform(0.0, 5.0, 40 * n_tasks)
    tasks, every = np.r_[task, np.repeat(np.arange(n_tasks), 40)], np.r_[x, x_new]
    K = np.exp(-0.5 * np.subtract.outer(every, every) ** 2)
    values, vectors = np.linalg.eigh(K)
    g = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(every)))
    f = rng.standard_normal(n_tasks)[tasks] * g
    y = f + 1e-3 * rng.standard_normal(len(f))
    X, k = np.column_stack([every, tasks]), len(task)
    mean, std = MultiTaskGPRegressor().fit(X[:k], y[:k]).predict(X[k:], return_std=True)
    assert np.mean(np.abs(f[k:] - mean) < 1.96 * std) > 0.6


def products(seed):
    """Tasks that are multiples of a product of two random waves, beside levels."""
    rng, task, waves = np.random.default_rng(seed), np.repeat(np.arange(6), 18), []
    for _ in range(2):
        speed, phase = rng.standard_normal(60) / 1.2, rng.uniform(0.0, 2.0 * np.pi, 60)
        size = np.sqrt(1.0 / 30.0) * rng.standard_normal(60)
        waves.append(lambda x, s=speed, p=phase, a=size: np.cos(np.outer(x, s) + p) @ a)
    factor, level = np.exp(0.7 * rng.standard_normal(6)), rng.standard_normal(6)
    x = rng.uniform(0.0, 5.0, (2, len(task)))
    f = (1.5 + waves[0](x[0])) * (1.5 + waves[1](x[1]))
    y = level[task] + factor[task] * (f + 0.1 * rng.standard_normal(len(task)))
    return np.column_stack([*x, task]), y


def test_sketches_learn_of_what_their_noise_hides():
    """All of them took the second wave for noise."""
    X, y = products(90)
    model = MultiTaskGPRegressor().fit(X, y)
    known = MultiTaskGPRegressor(rank=1).fit(X, y)
    assert model.rank_ == 1
    value = known.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ > value - 0.1


def test_a_rank_that_gains_nothing_is_sketched_again():
    """From rank 1 the sketch of rank 2 had ended where it began, 20 nats too low."""
    rng = np.random.default_rng(16)
    task = np.repeat(np.arange(5), 12)
    x, factor = rng.uniform(0.0, 8.0, 60), rng.normal(1.0, 0.3, 5)
    f = np.where(task < 4, factor[task] * np.sin(x), np.cos(2.0 * x))
    X, y = np.column_stack([x, task]), f + 0.2 * rng.standard_normal(60)
    model = MultiTaskGPRegressor().fit(X, y)
    assert model.rank_ == 2
    known = MultiTaskGPRegressor(rank=2).fit(X, y)
    value = known.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ > value - 0.1


def test_all_are_sketched_from_what_is_revealed(monkeypatch):
    X, y = products(90)
    revealed, told = shortlisting._revealed, []

    def tell(sketches):
        told.append([sketches, revealed(sketches)])
        return told[-1][1]

    monkeypatch.setattr(shortlisting, "_revealed", tell)
    MultiTaskGPRegressor(normalize_y="per_task", noise="shared").fit(X, y)
    before, after = [[of.ascent.mode.value for of in each] for each in told[0]]
    assert max(after) > max(before) + 20.0
    assert (np.array(after) >= before).all()
    assert [of.form for of in told[0][0]] == [of.form for of in told[0][1]]


def test_where_nothing_is_revealed_sketches_are_as_they_were(monkeypatch):
    """Other starts end early by where the noise was held up, which is kept."""
    X, y = drawn(WEIGHTS, noise=0.0)
    revealed, told = shortlisting._revealed, []

    def tell(sketches):
        told.append([sketches, revealed(sketches)])
        return told[-1][1]

    monkeypatch.setattr(shortlisting, "_revealed", tell)
    MultiTaskGPRegressor().fit(X, y)
    for before, after in zip(*told[0], strict=True):
        assert after.ascent.held is before.ascent.held
        np.testing.assert_array_equal(after.ascent.mode.theta, before.ascent.mode.theta)


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_an_output_may_hide_what_another_does_not(order, told):
    X, y = products(90)
    other = np.sin(X[:, 0]) + 0.1 * np.random.default_rng(0).standard_normal(len(X))
    Y = np.column_stack([y, other])[:, order]
    model = MultiTaskGPRegressor(verbose=1).fit(X, Y)
    assert np.isfinite(model.log_marginal_likelihood_value_).all()
    lines = [line for line in told() if line.endswith("once noise was explained")]
    assert lines
    assert all(f"output {order.index(0) + 1} of 2" in line for line in lines)


def cooled(seed):
    """Eight things at the same seven times."""
    rng = np.random.default_rng([seed, 77])
    rate, size = rng.uniform(0.03, 0.12, 8), rng.normal(64.0, 4.0, 8)
    x, task = (
        np.tile([0.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0], 8),
        np.repeat(range(8), 7),
    )
    y = size[task] * np.exp(-rate[task] * x) + 0.5 * rng.standard_normal(len(x))
    return np.column_stack([x, task]), y


@cache
def cooled_down(estimator, seed):
    """What the defaults of an estimator learn of them."""
    return estimator().fit(*cooled(seed))


@pytest.mark.parametrize("estimator", [MultiTaskGPRegressor, RankSearchIC])
def test_two_functions_of_few_rows(estimator):
    """Rank 2 has 15 numbers, for which three rows each are enough.

    It is some sixty nats likelier than compound symmetry.
    """
    fits = [cooled_down(estimator, seed) for seed in range(5)]
    ranks = [getattr(fit, "best_estimator_", fit).rank_ for fit in fits]
    assert ranks.count(2) >= 4


def test_sketches_switch_no_input_off():
    """Without the wide penalty a length-scale leaves, and with it 24 nats."""
    problem, theta = _of_four_inputs()
    quick = problem.quickly()
    free, held = (climb(quick, theta, relaxed=relaxed) for relaxed in (False, True))
    sketch = shortlisting._quick(problem, theta)
    assert sketch.ascent.mode.value == held.value > free.value + 20.0
    assert np.abs(sketch.ascent.mode.theta[:4]).max() < 3.0


def _of_four_inputs():
    """A problem of rank 1, and where it begins, without levels."""
    rng = np.random.default_rng(3)
    task, weights = np.repeat(np.arange(12), 20), rng.standard_normal((12, 2))
    X = rng.uniform(-2.0, 2.0, (len(task), 4))
    slopes, phases = rng.standard_normal((2, 4)), rng.uniform(0.0, 6.0, 2)
    y = (np.sin(X @ slopes.T + phases) * weights[task]).sum(axis=1)
    y += 0.3 * rng.standard_normal(len(y))
    y -= (np.bincount(task, y) / 20)[task]
    data = building.data(X, task, y / y.std(), 12)
    problem = building.problem(RBF(np.ones(4)), low_rank(12, 1), data, noise=0.05)
    return problem, problem.theta(K_rho=0.3 * np.eye(12))


def test_ranks_that_nobody_asked_for():
    assert [rows_for(8, rank) for rank in range(4)] == [0, 2 * 8, 3 * 15, 4 * 21]
    assert rows_for(8, 2, compared=False) == 4 * 15
    assert rows_for(125, 2) == 3 * 249
    assert rows_for(126, 2) == 4 * 251  # too many to ask for their evidence


@pytest.mark.parametrize("criterion", ["bic", "loo"])
def test_other_criteria_need_four_rows(criterion):
    """By them rank 2 of few rows would be taken without any noise."""
    X, y = cooled(0)
    assert 2 in cooled_down(RankSearchIC, 0).results_["rank"].tolist()
    ranks = RankSearchIC(criterion=criterion).fit(X, y).results_["rank"].tolist()
    assert 2 not in ranks
