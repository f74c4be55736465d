"""Length-scales at which learning begins where those given lead nowhere."""

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import read
from skmtgp.kernels import Columns, Spherical
from skmtgp.learning.climbing import climb
from skmtgp.learning.ranges import along_ranges, begun_in_sight
from skmtgp.model.task_covariance import identity

METRES = 1000.0


def places(n=60, seed=0):
    """Places on a square of 10 km, and a field with the range 3 km and a nugget."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.0, 10.0, (n, 2))
    K = Spherical(3.0)(at) + 0.2 * np.eye(n)
    return at, rng.multivariate_normal(np.zeros(n), K)


def rows(at, n_tasks=1):
    return np.column_stack([at, np.arange(len(at)) % n_tasks])


@pytest.mark.parametrize("kernel", [Matern(nu=0.5), RBF([1.0, 1.0]), Spherical()])
@pytest.mark.parametrize("cls", [MultiTaskGPRegressor, IndependentGP, SingleTaskGP])
def test_units_of_coordinates_do_not_matter(cls, kernel):
    """In metres no two places are related by a length-scale of 1."""
    at, y = places()
    values = []
    for unit in (1.0, METRES):
        given = kernel if cls is MultiTaskGPRegressor else 1.0 * kernel
        model = cls(given, noise_variance=0.1).fit(rows(unit * at), y)
        values.append(model.log_marginal_likelihood_value_)
    np.testing.assert_allclose(*values, atol=0.02)


@pytest.mark.parametrize("kernel", [Matern(nu=0.5), Spherical()])
def test_nor_do_levels(kernel):
    """Beside noise as large as they are, no function would count."""
    at, y = places()
    X, far = rows(METRES * at, 2), np.array([0.0, 200.0])
    near, model = (
        MultiTaskGPRegressor(kernel, rank=0, shared=True, noise_variance=0.1).fit(
            X, y + gap * far[X[:, -1].astype(int)]
        )
        for gap in (0.01, 1.0)
    )
    scales = [of.kernel_.length_scale for of in (near, model)]
    np.testing.assert_allclose(*scales, rtol=0.3)


def test_several_terms_keep_their_ratio():
    at, y = places()
    X, targets = rows(np.tile(METRES * at, (2, 1))), np.concatenate([y, -y])
    X[60:, 2], X[:60, 2] = 1, 0
    model = MultiTaskGPRegressor([Matern(1.5, nu=0.5), Matern(0.3, nu=0.5)], rank=1)
    [problem] = pose(model, decide(model, read(model, X, targets)))
    first, second = (of.length_scale for of in problem.prior.kernel)
    assert first == pytest.approx(5.0 * second)
    assert 300.0 < first < 30_000.0


@pytest.fixture(scope="module")
def best_of_grid():
    at, y = places()
    grid = [
        SingleTaskGP(1.0 * Spherical(a, "fixed")).fit(rows(at), y)
        for a in np.geomspace(0.5, 12.0, 10)
    ]
    return max(of.log_marginal_likelihood_value_ for of in grid)


@pytest.mark.parametrize("start", [0.01, 30.0, 1000.0])
def test_spherical_ranges_come_to_the_best_of_a_grid(start, best_of_grid):
    """Far from the range the likelihood of a spherical covariance has other modes."""
    at, y = places()
    found = SingleTaskGP(1.0 * Spherical(start)).fit(rows(at), y)
    assert found.log_marginal_likelihood_value_ > best_of_grid - 0.5


def problem(kernel, X, y, **changes):
    data = building.data(X, np.zeros(len(X), dtype=int), y, 1)
    return building.problem(kernel, identity(1), data, **changes)


def test_starts_that_relate_rows_are_kept():
    at, y = places()
    for kernel in (RBF(0.5), ConstantKernel(), Matern(METRES, "fixed")):
        given = problem(kernel, at, y)
        assert begun_in_sight(given) is given
    apart = problem(RBF(1.0, "fixed"), METRES * at, y)
    assert begun_in_sight(apart) is apart
    still = problem(RBF(1.0), METRES * at, y, max_iter=0)
    assert begun_in_sight(still) is still


def test_bounds_and_parts_of_kernels():
    at, y = places()
    narrow = Matern(1.0, (0.5, 20.0), nu=0.5)
    found = begun_in_sight(problem(narrow, METRES * at, y)).prior.kernel
    assert found.length_scale <= 20.0
    fixed = Columns(RBF(1.0, "fixed"), [1])
    part = ConstantKernel(2.0) * Columns(Matern(nu=0.5), [0]) * fixed
    along = np.sin(at[:, 0])
    found = begun_in_sight(problem(part, at * [METRES, 1e-3], along)).prior.kernel
    assert found.theta[0] == np.log(2.0)
    assert found.theta[1] > np.log(100.0)


@pytest.mark.parametrize(("seed", "gain"), [(0, 0.0), (6, 3.0), (7, 3.0)])
def test_other_ranges_are_looked_at_from_the_mode(seed, gain):
    """Where the likelihood bends, a climb may end some nats below another mode."""
    at, y = places(seed=seed)
    posed = problem(ConstantKernel() * Spherical(8.0), at, y)
    mode = climb(posed, posed.theta())
    found = along_ranges(posed, mode)
    assert found.value >= mode.value + gain
    assert found.value == posed.likelihood().value(found.theta)
    if gain:
        assert found.n_evaluations > mode.n_evaluations
    else:
        np.testing.assert_array_equal(found.theta, mode.theta)
    many = problem(ConstantKernel() * Spherical(8.0), at, y, bent=50)
    assert along_ranges(many, mode) is mode
    smooth = problem(ConstantKernel() * RBF(1.0), at, y)
    assert along_ranges(smooth, mode) is mode


def test_each_of_several_ranges_is_looked_at():
    at, y = places(seed=6)
    posed = problem(ConstantKernel() * Spherical([8.0, 8.0]), at, y)
    mode = climb(posed, posed.theta())
    assert along_ranges(posed, mode).value > mode.value + 1.0


def test_it_is_told(told):
    at, y = places(30)
    PooledGP(1.0 * RBF(1.0), verbose=1).fit(rows(METRES * at), y)
    [line] = [line for line in told() if "length-scales begin" in line]
    assert "times those of the kernel" in line


@pytest.mark.parametrize("inference", ["sparse", "kronecker"])
def test_other_inference(inference):
    at, y = places(40)
    X = rows(np.tile(METRES * at, (2, 1)))
    X[:40, 2], X[40:, 2] = 0, 1
    options = {"n_inducing": 20, "n_exact": 60} if inference == "sparse" else {}
    model = IndependentGP(1.0 * Matern(nu=0.5), inference=inference, **options)
    model.fit(X, np.concatenate([y, y + 1.0]))
    assert 100.0 < model.kernel_.k2.length_scale < 20_000.0
