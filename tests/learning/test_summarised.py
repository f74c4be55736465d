"""Learning with inducing inputs, after that from some of the rows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.gaussian_process.kernels import RBF
from sparse_models import SPARSE, M, N, draw, noisy

from skmtgp import PooledGP
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import read
from skmtgp.inference.inducing import greedy_variance
from skmtgp.learning import summarised
from skmtgp.learning.problem import Mode
from skmtgp.learning.stages import learn_fixed
from skmtgp.learning.tuning import Tuning
from skmtgp.model.task_covariance import ones

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def problem_of(gp, X, y):
    """What the model learns of the only output."""
    [problem] = pose(gp, decide(gp, read(gp, X, y)))
    return problem.with_form(ones(M))


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.3])
def test_the_climb_begins_with_no_more_noise_than_it_must(noise):
    X, y = noisy()
    y = np.sin(X[:, 0]) + noise * np.random.default_rng(1).standard_normal(len(y))
    gp = PooledGP(RBF(1.0), normalize_y=False, noise="shared", **SPARSE)
    problem = problem_of(gp, X, y)
    Z = greedy_variance(RBF(1.0), problem.data.X, 20)
    problem = problem.with_data(replace(problem.data, Z=Z))
    few = Mode(np.log([1.0, 1e-10]), 0.0, 0, 0, True, False, 0.0, 60)
    begun = summarised.begin_at(problem, few)
    assert begun[0] == few.theta[0]
    value = problem.likelihood().value
    held = problem.with_noise(few.theta)
    others = np.linspace(few.theta, held, problem.tuning.noises)
    assert value(begun) == max(map(value, others))
    assert (begun[1] == held[1]) == (noise > 0.0)


@pytest.mark.parametrize(
    ("gain", "tol", "expected"),
    [(1e-3, 1e-2, 1e-3 * N), (1.0, 1e-2, 10.0), (1e-4, 0.5, 0.5), (1.0, 20.0, 20.0)],
)
def test_gain_under_which_climbs_of_the_bound_end(monkeypatch, gain, tol, expected):
    tols, climb = [], summarised.climb

    def told(problem, *arguments):
        tols.append(problem.budget.tol)
        return climb(problem, *arguments)

    monkeypatch.setattr(summarised, "climb", told)
    problem = problem_of(PooledGP(**SPARSE | {"tol": tol, "max_iter": 1}), *draw())
    problem = replace(problem, tuning=Tuning(gain=gain))
    modes = [learn_fixed(part) for part in summarised.exact_part([problem], [ones(M)])]
    summarised.climb_bounds([problem], modes)
    assert_allclose(tols, [expected] * problem.tuning.rounds)


def test_climbs_of_noisy_data_are_given_up_sooner():
    problem = problem_of(PooledGP(**SPARSE), *draw())
    theta = problem.theta()
    noisy = Mode(theta, 0.0, 0, 0, True, False, 0.0, 60)
    quiet = noisy._replace(theta=np.where(problem.prior.unexplained, -22.0, theta))
    patience = [
        summarised.with_gain(problem, mode, last=last).budget.patience
        for mode in (noisy, quiet)
        for last in (False, True)
    ]
    given, tuning = problem.budget.patience, problem.tuning
    assert patience == [tuning.sketched, tuning.noisy_patience, given, given]
    assert tuning.sketched < tuning.noisy_patience < given


@pytest.mark.parametrize(
    ("noise", "expected"), [(1e-10, 1e-8), (1e-6, 1e-5), (1e-4, 1e-4)]
)
def test_the_second_climb_begins_with_a_little_more_noise(noise, expected):
    gp = PooledGP(RBF(1.0), normalize_y=False, noise="shared", **SPARSE)
    X, y = noisy()
    problem = problem_of(gp, X, y / np.sqrt(np.mean(y**2)))
    Z = problem.data.X[:5]
    mode = Mode(np.log([1.0, noise]), 0.0, 0, 0, True, False, 0.0, 60, Z)
    begun = summarised.begin_at(problem, mode)
    assert_allclose(np.exp(begun), [1.0, expected])


@pytest.mark.parametrize(("n_exact", "tasks"), [(1, 1), (7, 2), (40, M), (1100, M)])
def test_rows_that_are_learned_from_exactly(n_exact, tasks):
    """As many as that, of all tasks if four of each can be drawn."""
    gp = PooledGP(**SPARSE | {"n_exact": n_exact})
    [problem] = summarised.exact_part([problem_of(gp, *draw())], [ones(M)])
    part = problem.data
    assert len(part) == min(n_exact, N)
    assert len(np.unique(part.tasks)) == tasks
    assert part.n_tasks == M
    assert part.Z is None
