import tracemalloc

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference import likelihood
from skmtgp.inference.information import information
from skmtgp.model.task_covariance import LowRank, OfTasks, WithDiagonal, low_rank

COUNTS = (3, 0, 1, 4)  # samples of each task
TASKS = np.repeat(np.arange(4), COUNTS)


def draw(kind):
    """A covariance, and derivatives by parameters of one kind or of both."""
    rng, n = np.random.default_rng(0), len(TASKS)
    A, whole, half = rng.standard_normal((3, n, n))
    of_tasks = [
        OfTasks(np.array([0, 2, 4, 6]), half),
        OfTasks(np.array([1, 3, 5, 7]), np.diag(np.diagonal(A))),
    ]
    derivatives = {
        "single": [[whole + whole.T, np.eye(n)]],
        "of tasks": [of_tasks],
        "both": [[], [whole + whole.T], of_tasks, [np.eye(n)]],
    }[kind]
    return A @ A.T + np.eye(n), derivatives


def one_by_one(derivatives, tasks):
    """A matrix for each parameter of a part."""
    found = {}
    for derivative in derivatives:
        if not isinstance(derivative, OfTasks):
            found[len(found)] = derivative
            continue
        for m, p in enumerate(derivative.positions):
            rows = (tasks == m)[:, None] * derivative.half
            found[p] = rows + rows.T
    return [found[p] for p in range(len(found))]


@pytest.mark.parametrize("kind", ["single", "of tasks", "both"])
def test_by_the_book(kind):
    K, derivatives = draw(kind)
    matrices = [dK for part in derivatives for dK in one_by_one(part, TASKS)]
    scores = [np.linalg.solve(K, dK) for dK in matrices]
    expected = [[0.5 * np.trace(p @ q) for q in scores] for p in scores]
    found = information(K, TASKS, derivatives)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found, found.T, rtol=1e-11, atol=1e-11)


def test_of_tasks_without_a_sample_there_is_none():
    K, derivatives = draw("both")
    found, unseen = information(K, TASKS, derivatives), [3, 4]
    np.testing.assert_array_equal(found[unseen], 0.0)
    np.testing.assert_array_equal(found[:, unseen], 0.0)


def test_singular_covariance():
    with pytest.raises(np.linalg.LinAlgError, match="Singular"):
        information(np.zeros((8, 8)), TASKS, draw("both")[1])


def many_tasks(M, rank, n_noise=1, diagonal=False):
    """A likelihood of two samples of each of many tasks, and parameters."""
    rng, form = np.random.default_rng(0), low_rank(M, rank, diagonal)
    X, tasks = rng.uniform(0.0, 6.0, (2 * M, 2)), np.repeat(np.arange(M), 2)
    of_data = building.dense(RBF(), form, X, tasks, np.sin(X[:, 0]), n_noise)
    rho = rng.standard_normal(form.n_parameters)
    return of_data, np.concatenate([[0.1], rho, np.full(n_noise, np.log(0.1))])


class OneByOne(LowRank):
    """A user's form, which says nothing of tasks."""

    def derivatives(self, parameters):
        of_tasks = list(super().derivatives(parameters))
        return np.stack(one_by_one(of_tasks, np.arange(self.n_tasks)))


@pytest.mark.parametrize("n_noise", [1, 5])
@pytest.mark.parametrize("wrap", [lambda form: form, WithDiagonal])
def test_forms_may_give_a_matrix_for_each_parameter(wrap, n_noise):
    of_data, theta = many_tasks(5, 2, n_noise, diagonal=wrap is WithDiagonal)
    expected = of_data.fisher_information(theta)
    of_data.prior = of_data.prior.with_form(wrap(OneByOne(5, 2)))
    found = of_data.fisher_information(theta)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("diagonal", [False, True])
def test_many_tasks_take_little_memory(diagonal):
    """Not a matrix between the tasks for each of hundreds of parameters."""
    of_data, theta = many_tasks(300, 2, diagonal=diagonal)
    tracemalloc.start()
    found = of_data.fisher_information(theta)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.isfinite(found).all()
    assert peak < 20 * 8 * len(theta) ** 2  # of 602 or 902 parameters


def test_many_parameters_of_tasks_leave_the_rows(monkeypatch):
    """Only as many as there are matrices make it look at fewer rows."""
    of_data, theta = many_tasks(60, 2, n_noise=60, diagonal=True)
    before = of_data.fisher_information(theta)
    monkeypatch.setattr(likelihood, "FISHER_SIZE", 5 * 120**2)
    np.testing.assert_array_equal(of_data.fisher_information(theta), before)
    monkeypatch.setattr(likelihood, "FISHER_SIZE", 5 * 40**2)
    assert not np.allclose(of_data.fisher_information(theta), before)
