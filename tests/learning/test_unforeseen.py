"""Rows that others do not foresee."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import FACTOR, KERNEL, NOISE, TRUTH, M, draw, mode_at, pose
from textbook import covariance

from skmtgp.learning.unforeseen import unforeseen
from skmtgp.model.task_covariance import low_rank

PER_TASK = 40
DEVIATION = np.sqrt(NOISE)


def at_truth(data, factor=FACTOR):
    """The problem, and its mode: the parameters that the data are drawn with."""
    problem = pose(data, low_rank(M, factor.shape[1]), noise=NOISE)
    theta = problem.theta(kernel=TRUTH, K_rho=factor @ factor.T)
    return problem, mode_at(problem, theta)


def moved(data, rows, deviations):
    y = data.y.copy()
    y[rows] += DEVIATION * np.asarray(deviations)
    return replace(data, y=y)


@pytest.fixture(scope="module")
def clean():
    return draw(FACTOR @ FACTOR.T, per_task=PER_TASK)


def found(data, **options):
    return unforeseen(*at_truth(data, **options))[0].tolist()


def test_the_farthest_come_first(clean):
    assert found(clean) == []
    assert found(moved(clean, [50, 7], [9.0, -12.0])) == [7, 50]


def test_sizes_are_errors_of_rows_left_out(clean):
    data = moved(clean, [50], [12.0])
    _, [size] = unforeseen(*at_truth(data))
    kernel = KERNEL.clone_with_theta(TRUTH)
    K = covariance(kernel, FACTOR @ FACTOR.T, NOISE, data.X, data.tasks)
    others = np.arange(len(data.y)) != 50
    weights = np.linalg.solve(K[np.ix_(others, others)], K[others, 50])
    error = data.y[50] - weights @ data.y[others]
    assert size == pytest.approx(error / np.sqrt(K[50, 50] - weights @ K[others, 50]))


def test_seldom_by_chance():
    """Of 300 draws a right model has such rows in 0.3 on average."""
    drawn = (draw(FACTOR @ FACTOR.T, seed, 15) for seed in range(300))
    assert sum(found(data) != [] for data in drawn) <= 2


def test_what_is_usual_in_a_task_is_told_by_its_rows():
    """Of tasks that are not related: rows of others would be off, too."""
    alone = draw(np.eye(M), per_task=PER_TASK)
    rows = np.flatnonzero(alone.tasks == 1)
    noisier = 4.0 * np.random.default_rng(0).standard_normal(PER_TASK)
    data = moved(alone, rows, noisier)
    assert found(data, factor=np.eye(M)) == []
    assert found(moved(data, rows[3], 60.0), factor=np.eye(M))[0] == rows[3]


@pytest.mark.parametrize("n_rows", [1, 2])
def test_not_of_a_task_of_one_or_two_rows(clean, n_rows):
    last = np.arange(2 * PER_TASK, 2 * PER_TASK + n_rows)
    parts = {name: getattr(clean, name)[: last[-1] + 1] for name in ("X", "tasks", "y")}
    data = moved(replace(clean, **parts), last, 30.0)
    assert not set(last) & set(found(data))


def test_not_of_few_rows_nor_without_noise(clean):
    data = draw(FACTOR @ FACTOR.T, per_task=9)
    assert found(moved(data, [3], [30.0])) == []
    problem, mode = at_truth(moved(clean, [3], [30.0]))
    theta = np.where(problem.prior.of_noise, np.log(1e-9), mode.theta)
    assert len(unforeseen(problem, mode)[0])
    assert not len(unforeseen(problem, mode._replace(theta=theta))[0])
