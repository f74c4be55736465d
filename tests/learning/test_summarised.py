"""Learning with inducing inputs, after that from some of the rows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.gaussian_process.kernels import RBF
from sparse_models import SPARSE, M, N, draw, noisy

from skmtgp import PooledGP
from skmtgp.inference.inducing import greedy_variance
from skmtgp.learning import summarised
from skmtgp.learning.problem import Mode
from skmtgp.model.task_covariance import ones

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.3])
def test_the_climb_begins_with_no_more_noise_than_it_must(noise):
    X, y = noisy()
    y = np.sin(X[:, 0]) + noise * np.random.default_rng(1).standard_normal(len(y))
    gp = PooledGP(RBF(1.0), normalize_y=False, **SPARSE)
    [(data, settings)] = gp._pairs(gp._read(X, y))
    data = replace(data, Z=greedy_variance(RBF(1.0), data.X, 20))
    few = Mode(np.log([1.0, 1e-10]), 0.0, 0, 0, True, False, 0.0, 60)
    begun = summarised.begin_at(data, settings, ones(M), few)
    assert begun[0] == few.theta[0]
    value = settings.likelihood(data, ones(M)).value
    held = settings.with_noise(few.theta, ones(M))
    others = np.linspace(few.theta, held, summarised.NOISES)
    assert value(begun) == max(map(value, others))
    assert (begun[1] == held[1]) == (noise > 0.0)


@pytest.mark.parametrize(
    ("gain", "tol", "expected"),
    [(1e-3, 1e-2, 1e-3 * N), (1.0, 1e-2, 10.0), (1e-4, 0.5, 0.5), (1.0, 20.0, 20.0)],
)
def test_gain_under_which_climbs_of_the_bound_end(monkeypatch, gain, tol, expected):
    tols, climb = [], summarised.climb

    def told(data, settings, *arguments):
        tols.append(settings.tol)
        return climb(data, settings, *arguments)

    monkeypatch.setattr(summarised, "GAIN", gain)
    monkeypatch.setattr(summarised, "climb", told)
    PooledGP(**SPARSE | {"tol": tol, "max_iter": 1}).fit(*draw())
    assert_allclose(tols, [expected] * summarised.ROUNDS)


@pytest.mark.parametrize(
    ("noise", "expected"), [(1e-10, 1e-8), (1e-6, 1e-5), (1e-4, 1e-4)]
)
def test_the_second_climb_begins_with_a_little_more_noise(noise, expected):
    gp = PooledGP(RBF(1.0), normalize_y=False, **SPARSE)
    X, y = noisy()
    [(data, settings)] = gp._pairs(gp._read(X, y / np.sqrt(np.mean(y**2))))
    mode = Mode(np.log([1.0, noise]), 0.0, 0, 0, True, False, 0.0, 60, data.X[:5])
    begun = summarised.begin_at(data, settings, ones(M), mode)
    assert_allclose(np.exp(begun), [1.0, expected])


@pytest.mark.parametrize(("n_exact", "least"), [(1, 3), (40, 40), (1100, N)])
def test_rows_that_are_learned_from_exactly(n_exact, least):
    """Of each task its share, rounded up."""
    gp = PooledGP(**SPARSE | {"n_exact": n_exact})
    pairs = gp._pairs(gp._read(*draw()))
    [(part, _)] = summarised.exact_part(pairs, [ones(M)])
    assert least <= len(part.y) <= least + M - 1
    assert_array_equal(np.unique(part.tasks), np.arange(M))
    assert part.Z is None
