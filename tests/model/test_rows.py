"""A kernel of one input at a time is what its tiles are."""

import pickle

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern
from test_contraction import KNOWN, TwiceRBF

from skmtgp.kernels import Columns, geometric_inverse_dynamics_kernel
from skmtgp.model._nodes import compile_kernel, fold, form_of
from skmtgp.model._nodes.rows import RowOfTile, row_of

N, D = 15, 4
OTHERS = {"a user's": TwiceRBF(0.9), "user's times": TwiceRBF(0.9) * RBF(1.3)}


def alone(bound, B):
    """The sums of one kernel, through a pickle."""
    folded = pickle.loads(pickle.dumps(fold([bound], B[None])))
    return lambda z: folded(z)[0]


def compare(kernel, X, z, rtol=1e-13):
    """Sums of a row by both ways."""
    bound = compile_kernel(kernel).bind(kernel.theta, X)
    B = np.random.default_rng(1).standard_normal((len(X), 3))
    folded = alone(bound, B)
    expected = bound.against(z[None]).times(slice(0, 1), slice(0, len(X)), B)[0]
    K = np.abs(kernel(z[None], X)[0])
    atol = rtol * max(K @ np.abs(B).max(axis=1), 1.0)
    np.testing.assert_allclose(folded(z), expected, rtol=0.0, atol=atol)
    np.testing.assert_allclose(folded(z), kernel(z[None], X)[0] @ B, rtol=0, atol=atol)
    assert np.shape(folded(z)) == (3,)


@pytest.mark.parametrize("name", [*KNOWN, *OTHERS])
def test_every_kernel(name):
    rng = np.random.default_rng(0)
    kernel = (KNOWN | OTHERS)[name]
    X, z = np.abs(rng.standard_normal((N, D))), np.abs(rng.standard_normal(D))
    compare(kernel, X, z)
    compare(kernel, X, X[3])


STEEP = "matern 1/2", "spherical"  # whose distances are computed with care
TOGETHER = [name for name in KNOWN if not name.startswith(STEEP)]


@pytest.mark.parametrize("name", [*TOGETHER, "a robot's"])
def test_several_kernels_together(name):
    """Those that differ in nothing but hyperparameters are what each is alone."""
    known = KNOWN | {"a robot's": geometric_inverse_dynamics_kernel("R")}
    rng, node = np.random.default_rng(0), compile_kernel(known[name])
    n = D if name in KNOWN else 5
    X, z = rng.standard_normal((N, n)), rng.standard_normal(n)
    theta = known[name].theta + 0.3 * rng.standard_normal((3, known[name].n_dims))
    bounds = [node.bind(of, X) for of in theta]
    B = rng.standard_normal((3, N, 2))
    assert len({form_of(bound) for bound in bounds}) == 1
    expected = [alone(*each)(z) for each in zip(bounds, B, strict=True)]
    np.testing.assert_allclose(fold(bounds, B)(z), expected, rtol=1e-11, atol=1e-12)


def test_kernels_of_other_forms_are_not_folded_together():
    kernels = [
        RBF(),
        Matern(nu=1.5),
        ConstantKernel() * RBF(),
        RBF() + RBF(),
        RBF() ** 2,
    ]
    kernels += [Columns(RBF(), [0]), Columns(RBF(), [1]), RBF() ** 3]
    X = np.random.default_rng(0).standard_normal((N, 2))
    forms = [form_of(compile_kernel(k).bind(k.theta, X)) for k in kernels]
    assert len(set(forms)) == len(forms)
    again = [form_of(compile_kernel(k).bind(k.theta + 0.1, X)) for k in kernels]
    assert forms == again


@pytest.mark.parametrize("types", ["RRR", "RPR"])
def test_a_robot(types):
    kernel = geometric_inverse_dynamics_kernel(types)
    n = 2 * types.count("R") + types.count("P") + 3 * len(types)
    rng = np.random.default_rng(0)
    compare(kernel, rng.standard_normal((N, n)), rng.standard_normal(n))


@pytest.mark.parametrize("kernel", [RBF([1e-3, 1.0]), Matern(1.0, nu=0.5)], ids=repr)
def test_what_needs_care_is_left_to_tiles(kernel):
    """Wide features, and kernels with a kink: see `Differences`."""
    X = np.random.default_rng(0).uniform(0.0, 100.0, (N, 2))
    bound, other = (
        compile_kernel(kernel).bind(theta, X)
        for theta in (kernel.theta, kernel.theta - 0.1)
    )
    assert isinstance(row_of([bound], N), RowOfTile)
    assert form_of(bound) != form_of(other)  # each of them is asked alone
    compare(kernel, X, X[0] + 1e-4, rtol=1e-11)


def test_far_away_is_no_number_that_is_not_one():
    bound = compile_kernel(RBF()).bind(np.zeros(1), np.zeros((3, 2)) + [[0.0, 1.0]])
    with np.errstate(over="raise", invalid="raise"):
        assert (
            fold([bound], np.ones((1, 3, 1)))(np.array([1e150, -1e150])).item() == 0.0
        )
