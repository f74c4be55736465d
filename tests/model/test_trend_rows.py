"""The trend's columns at any rows, and an orthonormal basis of them."""

import numpy as np
import pytest

from skmtgp.model.trend import Basis, TaskBases, Trend


def columns(X):
    return np.column_stack([X, X**2])


def trend(per_task, n_sets=1):
    centre = np.array([[1.0, 3.0]] * n_sets) + np.arange(n_sets)[:, None]
    slopes = np.array([[0.5, -1.0]] * (2 if per_task else 1))
    return Trend(columns, 2, per_task, centre, 1.0 + np.arange(n_sets), slopes)


X, TASKS = np.array([[2.0], [3.0], [1.0]]), np.array([0, 1, 0])


def test_rows_of_one_set():
    expected = [[1.0, 1.0], [2.0, 6.0], [0.0, -2.0]]
    np.testing.assert_array_equal(trend(False).rows(X, TASKS), expected)
    np.testing.assert_array_equal(trend(False).fitted(X, TASKS), [-0.5, -5.0, 2.0])


def test_rows_of_each_task():
    expected = [[1.0, 1.0, 0, 0], [0, 0, 0.5, 2.5], [0.0, -2.0, 0, 0]]
    of_tasks = trend(True, n_sets=2)
    np.testing.assert_array_equal(of_tasks.rows(X, TASKS), expected)
    np.testing.assert_array_equal(of_tasks.rows_of(1, X[[1]]), [[0.5, 2.5]])
    assert of_tasks.n_coefficients == 4


@pytest.mark.parametrize("position", [0, 1, 2])
def test_one_more_task(position):
    centre, slopes = np.array([7.0, 8.0]), np.array([9.0, 1.0])
    grown = trend(True, n_sets=2).with_task(position, centre, 4.0, slopes)
    x = np.array([[5.0]])
    expected = [(5.0 - 7.0) / 4.0, (25.0 - 8.0) / 4.0]
    np.testing.assert_array_equal(grown.rows_of(position, x), [expected])
    assert grown.n_coefficients == 6
    others = np.delete(np.arange(3), position)
    before = trend(True, n_sets=2)
    for old, new in enumerate(others):
        rows = grown.rows_of(new, x), before.rows_of(old, x)
        np.testing.assert_array_equal(*rows)
    shared = trend(False).with_task(1, None, None, None)
    np.testing.assert_array_equal(
        shared.rows(X, [2, 2, 2]), trend(False).rows(X, TASKS)
    )


def test_rounding_of_means_is_no_column():
    value = 0.1 + 0.2
    constant = Trend(
        lambda X: np.full((len(X), 1), value),
        1,
        False,
        np.array([[np.mean([value] * 7)]]),
        np.ones(1),
        np.zeros((1, 1)),
    )
    assert not constant.rows(np.zeros((3, 1)), np.zeros(3, int)).any()


@pytest.mark.parametrize("units", [1.0, [1e-12, 1.0, 1e9]])
def test_basis(units):
    rng = np.random.default_rng(0)
    T = rng.standard_normal((9, 3)) * units
    basis = Basis(T)
    np.testing.assert_allclose(basis.Q.T @ basis.Q, np.eye(3), atol=1e-14)
    beta = rng.standard_normal(3) / units
    np.testing.assert_allclose(basis.coefficients(basis.Q.T @ T @ beta), beta)
    expected = 0.5 * np.linalg.slogdet((T / units).T @ (T / units))[1]
    expected += np.log(np.broadcast_to(units, 3)).sum()
    np.testing.assert_allclose(basis.log_volume(), expected)
    assert basis.rank == 3
    assert not basis.dependent.size


def test_columns_that_others_make():
    t = np.arange(5.0)
    basis = Basis(np.column_stack([t, 1e6 * t, np.ones(5), np.zeros(5)]))
    assert basis.rank == 2
    assert 3 in basis.dependent
    assert len(basis.dependent) == 2
    assert Basis(np.zeros((4, 2))).rank == 0


def test_seconds_since_1970():
    seconds = 1.7e9 + np.linspace(0, 1e5, 50)
    assert Basis(np.column_stack([np.ones(50), seconds, seconds**2])).rank == 3


def test_the_jacobian():
    of_y = Trend(columns, 2, False, np.zeros((1, 2)), np.ones(1), np.zeros((1, 2)))
    halved = Trend(columns, 2, False, np.zeros((1, 2)), np.full(1, 2.0), of_y.slopes)
    np.testing.assert_allclose(halved.log_jacobian(X, TASKS), 2 * np.log(2.0))
    assert of_y.log_jacobian(X, TASKS) == 0.0


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_bases_of_tasks_are_one_of_all_columns(order):
    rng = np.random.default_rng(0)
    H = rng.standard_normal((14, 3)) * [1.0, 1e6, 1e-6]
    tasks = np.argsort(order)[np.arange(14) % 2]  # one of the three has no rows
    H[tasks == tasks[0], 2] = 0.0
    T = np.zeros((14, 3, 3))
    T[np.arange(14), tasks] = H
    T = T.reshape(14, 9)
    found, expected = TaskBases(H, tasks, 3), Basis(T)
    assert found.rank == expected.rank == 5
    np.testing.assert_array_equal(found.dependent, expected.dependent)
    np.testing.assert_allclose(found.log_volume(), expected.log_volume())
    projections = [of.Q @ of.Q.T for of in (found, expected)]
    np.testing.assert_allclose(*projections, atol=1e-14)
    Y = rng.standard_normal((14, 2))
    for y in (Y, Y[:, 0]):
        beta = found.least_squares(y)
        explained = [T @ beta, T @ expected.least_squares(y)]
        np.testing.assert_allclose(*explained, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.coefficients(found.Q.T @ y), beta, rtol=1e-9)


def test_times_coefficients():
    beta = np.array([[0.5, -1.0], [2.0, 3.0]])
    for per_task in (False, True):
        of = trend(per_task)
        used = beta if per_task else beta[:1]
        expected = of.rows(X, TASKS) @ used.ravel()
        np.testing.assert_allclose(of.times(X, TASKS, used), expected)
