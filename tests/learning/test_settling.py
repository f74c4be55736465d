"""Rows of F of tasks with few rows, as the other tasks suggest them."""

import warnings
from dataclasses import replace

import building
import numpy as np
import pytest
from rarely import rarely
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, RankSearchIC
from skmtgp._data.known import Known
from skmtgp.exceptions import SmallTaskWarning
from skmtgp.inference.engines import Dense, Sparse
from skmtgp.learning import settling
from skmtgp.learning.climbing import climb
from skmtgp.learning.novel import learn_novel
from skmtgp.learning.settling import few_rows, settled
from skmtgp.model.several import Forms
from skmtgp.model.task_covariance import low_rank

SIZES = 12, 2, 9, 10  # rows of each task; the second one is small
SMALL = 1


def observations(sizes=SIZES, seed=0, complete=False):
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(len(sizes)), sizes)
    x = np.concatenate([np.linspace(0.0, 5.0, n) for n in sizes])
    x += 0.0 if complete else 0.3 * rng.standard_normal(len(x))
    amounts = rng.normal(2.0, 0.5, len(sizes))
    y = amounts[tasks] * np.sin(x) + 0.1 * rng.standard_normal(len(x))
    return building.data(x[:, None], tasks, y, len(sizes), complete)


def problem(data, *, rank=1, diagonal=False, shared=False, **changes):
    form = low_rank(data.n_tasks, rank, diagonal, shared)
    return building.problem(RBF(1.0), form, data, **{"max_iter": 5, **changes})


def learned(problem):
    amounts = 1.0 + 0.5 * np.arange(problem.data.n_tasks)
    K_rho = np.outer(amounts, amounts) + np.diag(amounts[::-1])
    return climb(problem, problem.theta(K_rho=K_rho))


def as_joined(problem, theta, task):
    """Theta of the model that the larger tasks make and the small one joins."""
    prior, data = problem.prior, problem.data
    others = data.tasks != task
    codes = data.tasks - (data.tasks > task)
    n_tasks, form = data.n_tasks - 1, prior.task_covariance
    inner = getattr(getattr(form, "form", form), "form", getattr(form, "form", form))
    diagonal = form.n_own > 0 and ("equal" if form.equal else True)
    smaller = low_rank(n_tasks, inner.rank, diagonal, form.shared)
    kernel, rho, level, noise = prior._split(theta)
    F = np.delete(rho[: inner.n_parameters].reshape(-1, inner.rank), task, axis=0)
    rest = rho[inner.n_parameters :]
    rest = np.delete(rest, task - len(rest)) if form.n_own > 1 else rest
    noise = np.delete(noise, task) if len(noise) > 1 else noise
    less = replace(prior, task_covariance=smaller, n_noise=len(noise))
    rows = data.X[others], codes[others], data.y[others]
    likelihood = problem.engine.likelihood(less, building.data(*rows, n_tasks))
    theta = np.concatenate([kernel, F.ravel(), rest, level, noise])
    return learn_novel(
        likelihood,
        likelihood.posterior(theta),
        theta,
        data.X[~others],
        data.y[~others],
        position=task,
        own=form.n_own > 1,
        own_noise=len(noise) > 1,
        informed=True,
        budget=problem.budget,
    )[1].theta


FORMS = {
    "rank 1": {},
    "rank 2": {"rank": 2},
    "diagonal": {"diagonal": True},
    "equal": {"diagonal": "equal", "shared": True},
    "levels": {"levels": True},
    "own noise": {"n_noise": len(SIZES)},
}


@pytest.mark.parametrize("form", FORMS)
def test_a_small_task_is_as_if_it_had_joined(form):
    model = problem(observations(), **FORMS[form])
    mode = learned(model)
    found = settled(model, mode)
    assert not np.allclose(found.theta, mode.theta)
    np.testing.assert_allclose(
        found.theta, as_joined(model, mode.theta, SMALL), rtol=1e-6, atol=1e-8
    )
    assert found.value == pytest.approx(model.likelihood().value(found.theta))


def test_the_order_of_tasks_does_not_matter():
    data = observations((12, 1, 2, 9))
    order = np.array([2, 0, 3, 1])  # new positions of the tasks
    tasks = order[data.tasks]
    rows = np.argsort(tasks, kind="stable")
    moved = building.data(data.X[rows], tasks[rows], data.y[rows], data.n_tasks)
    model, other = problem(data), problem(moved)
    mode = learned(model)
    moved = mode.theta.copy()
    of_factor = model.prior.of_factor
    moved[of_factor] = mode.theta[of_factor][np.argsort(order)]
    found = settled(model, mode).theta[of_factor]
    expected = settled(other, mode._replace(theta=moved)).theta[of_factor]
    np.testing.assert_allclose(found[np.argsort(order)], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("sizes", "changes"),
    [
        ((4, 5, 6), {}),
        ((3, 2, 3), {}),
        ((9, 2), {}),
        (SIZES, {"max_iter": 0}),
        (SIZES, {"rank": 0, "shared": True}),
    ],
    ids=["large", "small", "no population", "nothing learned", "no factor"],
)
def test_nothing_to_settle(sizes, changes):
    model = problem(observations(sizes), **changes)
    mode = learned(replace(model, budget=replace(model.budget, max_iter=1)))
    assert settled(model, mode) is mode


def test_rows_count_as_measurements():
    data = observations()
    counts = np.where(data.tasks == SMALL, 2.0, 1.0)
    nothing = np.zeros(len(data))
    model = problem(replace(data, known=Known(nothing, counts, nothing)))
    mode = learned(model)
    assert settled(model, mode) is mode


def test_known_noise_counts():
    """A row of which nothing is known but by its noise says nothing of its task."""
    data = observations()
    small = data.tasks == SMALL
    known = Known(np.where(small, 1e8, 0.0), np.ones(len(data)), np.zeros(len(data)))
    model = problem(replace(data, known=known))
    mode = learned(problem(data))
    F = settled(model, mode).theta[model.prior.of_factor]
    assert F[SMALL] == pytest.approx(np.delete(F, SMALL).mean(), rel=1e-3)


def test_complete_data():
    """Most cells of a task are missing, and fast algebra needs them: left alone."""
    data = observations((60,) * 12, complete=True)
    rows = np.flatnonzero((data.tasks != SMALL) | (data.X[:, 0] < 0.1))
    rows = data.X[rows], data.tasks[rows], data.y[rows]
    data = building.data(*rows, data.n_tasks, complete=True)
    model = problem(data, engine=building.ENGINES["kronecker"])
    mode = learned(model)
    assert settled(model, mode) is mode


def test_several_terms():
    data = observations()
    form = Forms([low_rank(data.n_tasks, 1)] * 2)
    model = building.problem(RBF(1.0), low_rank(data.n_tasks, 1), data, max_iter=5)
    prior = model.prior.with_terms([(RBF(1.0), form[0]), (RBF(0.1), form[1])])
    model = replace(model, prior=prior)
    theta = prior.theta(K_rho=np.ones((data.n_tasks,) * 2))
    theta[prior.of_factor] = np.arange(1.0, 1.0 + prior.of_factor.sum())
    mode = climb(model, theta)
    found = settled(model, mode).theta
    assert (found != mode.theta).sum() == 2
    assert prior.of_factor[found != mode.theta].all()


def sites(seed):
    """Three tasks of many rows and three of few, with levels; and the same without."""
    rng = np.random.default_rng(seed)
    amounts, level = rng.normal(2.0, 0.5, 6), rng.normal(0.0, 5.0, 6)

    def draw(sizes, noise):
        task = np.repeat(np.arange(6), sizes)
        x = rng.uniform(0.0, 6.0, len(task))
        y = level[task] + amounts[task] * np.sin(x)
        return np.column_stack([x, task]), y + noise * rng.standard_normal(len(x))

    return draw([40, 30, 20, 3, 2, 1], 0.2), draw([50] * 6, 0.0)


def worst(model, test):
    X, y = test
    return np.sqrt(np.bincount(X[:, -1].astype(int), (model.predict(X) - y) ** 2) / 50)


def test_inducing_inputs():
    """As many as there are inputs: as by dense inference."""
    data = observations()
    exact = problem(data)
    bound = problem(data, engine=Sparse(n_inducing=len(data)))
    mode = learned(exact)
    found = settled(bound, mode._replace(Z=data.X)).theta
    np.testing.assert_allclose(found, settled(exact, mode).theta, rtol=1e-3)


UNEQUAL = *range(3, 8), *(20,) * 4, *(40,) * 5


@pytest.mark.parametrize(
    ("engine", "sizes", "rank", "few"),
    [
        (Sparse(), UNEQUAL, 1, 9),
        (Sparse(), UNEQUAL[:-2], 1, 1),  # too few tasks tell what they are like
        (Sparse(), UNEQUAL, 2, 1),  # 40 rows do not tell two numbers well
        (Sparse(), (*UNEQUAL, *(20,) * 9), 1, 1),  # most rows are of small tasks
        (Dense(), UNEQUAL, 1, 1),
    ],
)
def test_by_sparse_inference_more_tasks_have_few_rows(engine, sizes, rank, few):
    model = problem(observations(sizes), rank=rank, engine=engine)
    assert few_rows(model).tolist() == [k < few for k in range(len(sizes))]


def test_small_tasks_are_learned_one_by_one():
    exact = problem(observations(UNEQUAL[::-1]), n_noise=14)
    model = replace(exact, engine=Sparse(n_inducing=20))
    mode = learned(exact)._replace(Z=np.linspace(0.0, 5.0, 20)[:, None])
    changed = settled(model, mode).theta != mode.theta
    assert changed[model.prior.of_factor].tolist() == [False] * 5 + [True] * 9
    assert changed[model.prior.of_noise].tolist() == [False] * 13 + [True]


def test_larger_tasks_do_not_speak_for_inputs_that_they_never_saw(monkeypatch):
    rng = np.random.default_rng(0)
    tasks = np.repeat(range(20), [*(60,) * 6, *(20,) * 14])
    x = rng.uniform(0.0, np.where(tasks < 6, 1.0, 6.0))
    F = rng.normal(2.0, 0.5, 20)
    y = F[tasks] * np.sin(x) + 0.3 * rng.standard_normal(len(x))
    options = {"rank": 1, "inference": "sparse", "n_inducing": 15, "noise": "shared"}
    model, X = MultiTaskGPRegressor("rbf", **options), np.column_stack([x, tasks])
    new = rng.uniform(0.0, 6.0, 300), rng.integers(6, 20, 300)
    f, errors = F[new[1]] * np.sin(new[0]), []
    for lost in (settling.LOST, np.inf):
        monkeypatch.setattr(settling, "LOST", lost)
        error = model.fit(X, y).predict(np.column_stack(new)) - f
        errors.append(np.sqrt(np.square(error).mean()))
    assert errors[0] < 0.9 * errors[1]


def unequal(seed):
    """Tasks of 5 to 400 rows, of two functions and levels, and f at new inputs."""
    rng = np.random.default_rng(seed)
    sizes = np.geomspace(5, 400, 30).astype(int)
    F, levels = rng.normal([2.0, 0.0], [0.7, 1.0], (30, 2)), rng.normal(0.0, 5.0, 30)

    def drawn(tasks):
        x = rng.uniform(-2.0, 2.0, len(tasks))
        z = np.column_stack([np.sin(1.5 * x), np.cos(2.0 * x)])
        return np.column_stack([x, tasks]), (F[tasks] * z).sum(axis=1) + levels[tasks]

    X, y = drawn(np.repeat(range(30), sizes))
    return X, y + 0.7 * rng.standard_normal(len(y)), *drawn(np.arange(600) % 30)


@pytest.mark.parametrize("seed", [2, *rarely(3, 4)])
def test_small_tasks_by_sparse_inference(seed, monkeypatch):
    X, y, X_new, f = unequal(seed)
    options = {"inference": "sparse", "n_inducing": 20, "n_exact": 500}
    model = MultiTaskGPRegressor("rbf", rank=2, noise="shared", **options)
    small, errors, held = X_new[:, 1] < 15, [], []
    for each in (0, settling.EACH):
        monkeypatch.setattr(settling, "EACH", each)
        mean, std = model.fit(X, y).predict(X_new, return_std=True)
        error = np.abs(mean - f)[small]
        errors.append(np.sqrt(np.square(error).mean()))
        held.append(np.mean(error < 1.96 * std[small]))
    assert errors[1] < 1.02 * errors[0]
    assert min(held) > 0.9


@pytest.mark.parametrize(
    "changes",
    [
        {"inference": "sparse", "n_inducing": 12},
        {"normalize_y": "per_task"},
        {"noise": "per_task"},
        {"trend": "linear"},
        {"hyperparameters": "map"},
        {"kernel": ["rbf", "matern"]},
    ],
    ids=lambda changes: next(iter(changes.values())),
)
def test_any_model(changes):
    """Of two outputs, one of which is minus the other."""
    (X, y), test = sites(1)
    model = MultiTaskGPRegressor(**{"rank": 1, "kernel": "rbf", **changes}, max_iter=30)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, np.column_stack([y, -y]))
    f, g = model.predict(test[0]).T
    np.testing.assert_allclose(f, -g, rtol=1e-3, atol=1e-3)
    assert np.isfinite(f).all()


@pytest.mark.parametrize("search", [False, True])
def test_small_tasks_are_predicted_as_others_are(search):
    train, test = sites(6)
    model = MultiTaskGPRegressor(rank=1, kernel="rbf", noise="shared")
    model = RankSearchIC(model, ranks=[1]) if search else model
    with pytest.warns(SmallTaskWarning):
        error = worst(model.fit(*train), test)
    assert error.max() < 1.2


def test_the_papers_learning_is_maximum_likelihood():
    train, test = sites(6)
    model = MultiTaskGPRegressor(
        rank=1, kernel="rbf", noise="shared", learning="staged"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert worst(model.fit(*train), test).max() > 3.0
