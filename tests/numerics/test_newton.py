"""Newton's method from several points at once."""

import numpy as np
import pytest

from skmtgp._numerics.newton import minimize_all

FAR = np.full(2, 1e6)
BUDGET = {"max_iter": 200, "tol": 1e-9}


def rosenbrock(X):
    """A curved valley, whose lowest point is at (1, 1)."""
    a, b = X.T
    values = (1.0 - a) ** 2 + 100.0 * (b - a**2) ** 2
    slopes = np.stack(
        [-2.0 * (1.0 - a) - 400.0 * a * (b - a**2), 200.0 * (b - a**2)], axis=1
    )
    hessians = np.empty((len(X), 2, 2))
    hessians[:, 0, 0] = 2.0 - 400.0 * b + 1200.0 * a**2
    hessians[:, 0, 1] = hessians[:, 1, 0] = -400.0 * a
    hessians[:, 1, 1] = 200.0
    return values, slopes, hessians


def saddle(X):
    """x^2 + y^4 / 4 - y^2 / 2, which has a saddle at 0 and is lowest at y = 1, -1."""
    a, b = X.T
    values = a**2 + b**4 / 4.0 - b**2 / 2.0
    hessians = np.zeros((len(X), 2, 2))
    hessians[:, 0, 0], hessians[:, 1, 1] = 2.0, 3.0 * b**2 - 1.0
    return values, np.stack([2.0 * a, b**3 - b], axis=1), hessians


def test_each_start_finds_a_minimum():
    starts = np.array([[-1.2, 1.0], [3.0, -2.0], [1.0, 1.0], [-5.0, 20.0]])
    for start in starts:
        [optimum] = minimize_all(rosenbrock, start[None], -FAR, FAR, **BUDGET)
        np.testing.assert_allclose(optimum.x, [1.0, 1.0], atol=1e-6)
        assert optimum.converged
        assert not optimum.stalled
        assert optimum.value < 1e-9


def test_starts_that_end_apart_do_not_depend_on_each_other():
    starts = np.array([[2.0, 0.4], [3.0, -2.0]])
    together = minimize_all(saddle, starts, -FAR, FAR, **BUDGET)
    for found, start, end in zip(together, starts, (1.0, -1.0), strict=True):
        [alone] = minimize_all(saddle, start[None], -FAR, FAR, **BUDGET)
        np.testing.assert_allclose(found.x, alone.x, rtol=1e-9)
        np.testing.assert_allclose(found.x, [0.0, end], atol=1e-6)
        assert found[2:] == alone[2:]


def test_what_leads_to_the_same_place_is_not_followed_to_its_end():
    starts = np.array([[2.0, 0.4], [-1.0, 0.9], [0.5, 1.2], [3.0, -2.0]])
    optima = minimize_all(saddle, starts, -FAR, FAR, **BUDGET)
    alone = [
        minimize_all(saddle, start[None], -FAR, FAR, **BUDGET)[0] for start in starts
    ]
    counts = [sum(of.n_evaluations for of in found) for found in (optima, alone)]
    assert counts[0] < counts[1]
    best = min(optima[:3], key=lambda optimum: optimum.value)
    np.testing.assert_allclose(best.x, [0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(optima[3].x, [0.0, -1.0], atol=1e-6)
    for optimum in optima[:3]:
        assert abs(optimum.x[1] - 1.0) < 1.0


def test_nothing_follows_a_start_that_stays_on_a_saddle():
    starts = np.array([[0.0, 0.0], [0.9, 0.1]])
    _, away = minimize_all(saddle, starts, -FAR, FAR, **BUDGET)
    np.testing.assert_allclose(away.x, [0.0, 1.0], atol=1e-6)


def test_evaluations_are_counted():
    n_points = []

    def counted(X):
        n_points.append(len(X))
        return rosenbrock(X)

    starts = np.array([[-1.2, 1.0], [3.0, -2.0], [1.0, 1.0]])
    optima = minimize_all(counted, starts, -FAR, FAR, **BUDGET)
    assert sum(optimum.n_evaluations for optimum in optima) == sum(n_points)
    assert optima[2].n_evaluations == 1


def test_the_best_starts_are_followed():
    starts = np.array([[-5.0, 20.0], [1.0, 1.1], [3.0, -2.0], [0.9, 1.0]])
    order = np.argsort(rosenbrock(starts)[0])
    found = minimize_all(rosenbrock, starts, -FAR, FAR, followed=2, **BUDGET)
    expected = minimize_all(rosenbrock, starts[order[:2]], -FAR, FAR, **BUDGET)
    assert len(found) == 2
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        assert one[1:] == other[1:]


def test_a_saddle_repels():
    [optimum] = minimize_all(saddle, np.array([[2.0, 1e-3]]), -FAR, FAR, **BUDGET)
    np.testing.assert_allclose(optimum.x, [0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("upper", [[0.5, 9.0], [9.0, 0.0]])
def test_bounds(upper):
    starts, upper = np.array([[-1.2, -1.0]]), np.array(upper)
    [optimum] = minimize_all(rosenbrock, starts, -FAR, upper, **BUDGET)
    at_bound = optimum.x == upper
    assert at_bound.tolist() == (upper < 1.0).tolist()
    slope = rosenbrock(optimum.x[None])[1][0]
    assert slope[at_bound] < -0.1
    assert np.abs(slope[~at_bound]) < 1e-3
    assert optimum.converged


def test_what_cannot_be_evaluated_is_a_rejected_step():
    def half(X):
        values, slopes, hessians = rosenbrock(X)
        values[X[:, 0] > 2.0] = np.inf
        return values, slopes, hessians

    starts = np.array([[-1.2, 1.0], [3.0, 0.0]])
    first, second = minimize_all(half, starts, -FAR, FAR, **BUDGET)
    np.testing.assert_allclose(first.x, [1.0, 1.0], atol=1e-6)
    assert second.stalled
    assert not second.converged
    np.testing.assert_array_equal(second.x, starts[1])


def test_a_budget_that_is_spent():
    starts = np.array([[-1.2, 1.0]])
    [optimum] = minimize_all(rosenbrock, starts, -FAR, FAR, max_iter=3, tol=1e-6)
    assert optimum.n_evaluations == 4
    assert not optimum.converged
    assert not optimum.stalled
    [optimum] = minimize_all(rosenbrock, starts, -FAR, FAR, max_iter=0, tol=1e-6)
    np.testing.assert_array_equal(optimum.x, starts[0])
    assert optimum.n_iter == 0


def test_no_parameters():
    def constant(X):
        return np.ones(len(X)), X, np.empty((len(X), 0, 0))

    [optimum] = minimize_all(constant, np.empty((1, 0)), *np.empty((2, 0)), **BUDGET)
    assert optimum.value == 1.0
