"""Higher ranks than a few rows spoke for."""

import numpy as np
import pytest
from drawn import draw, pose
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor
from skmtgp.kernels import Columns
from skmtgp.learning import shortlisting
from skmtgp.learning.climbing import climb
from skmtgp.learning.further import with_higher
from skmtgp.model.task_covariance import LowRank, WithShared, low_rank

M = 5
LOADINGS = np.random.default_rng(0).standard_normal((M, 3))


@pytest.fixture(scope="module")
def problem():
    """Data of rank 3."""
    data = draw(LOADINGS @ LOADINGS.T, per_task=20, kernel=RBF([1.0, 1.0]), M=M)
    return pose(data, kernel=RBF([1.0, 1.0]))


def learned(problem, form):
    return climb(problem.with_form(form), problem.with_form(form).theta())


@pytest.fixture(scope="module")
def first(problem):
    return learned(problem, low_rank(M, 1))


def test_ranks_grow_as_long_as_rows_speak_for_them(problem, first):
    forms, [modes] = with_higher([problem], [low_rank(M, 1)], [[first]], M)
    assert [form.rank for form in forms] == [1, 2, 3]
    values = [mode.value for mode in modes]
    assert values == sorted(values)
    for form, mode in zip(forms, modes, strict=True):
        likelihood = problem.with_form(form).likelihood()
        assert likelihood.value(mode.theta) == pytest.approx(mode.value)


@pytest.mark.parametrize("most", [1, 2])
def test_they_end_at_the_highest(problem, first, most):
    forms, [modes] = with_higher([problem], [low_rank(M, 1)], [[first]], most)
    assert [form.rank for form in forms] == list(range(1, most + 1))
    assert len(modes) == most


def test_a_rank_that_gains_too_little_only_counts_as_spent(problem):
    before = learned(problem, low_rank(M, 3))
    forms, [[mode]] = with_higher([problem], [low_rank(M, 3)], [[before]], M)
    assert [form.rank for form in forms] == [3]
    assert mode.n_evaluations > before.n_evaluations
    np.testing.assert_array_equal(mode.theta, before.theta)


@pytest.mark.parametrize("form", [low_rank(M, 1, True), WithShared(LowRank(M, 1))])
def test_of_another_form_nothing_is_tried(problem, form):
    before = learned(problem, form)
    forms, modes = with_higher([problem], [form], [[before]], M)
    assert forms == [form]
    assert modes == [[before]]


@pytest.mark.parametrize(
    ("kernel", "noise", "tried"),
    [
        ("rbf", 0.2, True),
        (1.0 * RBF(1.0), 0.2, True),
        ("rbf", 0.0, False),
        (Columns(RBF(1.0) + RBF(0.1), [0]), 0.2, False),
    ],
)
def test_they_are_tried_of_noisy_data(monkeypatch, kernel, noise, tried):
    """Whose forms were compared by fewer rows than usual; not of sums."""
    rng, calls = np.random.default_rng(1), []

    def record(problems, forms, modes, most, n_jobs):
        calls.append(most)
        return with_higher(problems, forms, modes, most, n_jobs)

    monkeypatch.setattr(shortlisting, "with_higher", record)
    x, task = rng.uniform(0.0, 6.0, 264), np.arange(264) % 2
    y = np.sin(x) + 0.5 * task * np.cos(x) + noise * rng.standard_normal(264)
    MultiTaskGPRegressor(kernel, tol=0.1).fit(np.column_stack([x, task]), y)
    assert bool(calls) is tried
