"""Kernels that are covariances, and kernels that are none, which fit refuses."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Exponentiation,
    ExpSineSquared,
    Matern,
    PairwiseKernel,
    RationalQuadratic,
    Sum,
    WhiteKernel,
)

from skmtgp import MultiTaskGPRegressor, PooledGP, RankSearchIC, SingleTaskGP
from skmtgp.kernels import (
    ARDLinear,
    Columns,
    Spherical,
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.model._nodes import compile_kernel, is_foreign
from skmtgp.model.kernel_check import SAMPLED, check_covariance, check_kernel


def rows(n=60, d=3, seed=0):
    return np.random.default_rng(seed).standard_normal((n, d))


INPUTS = {
    "normal": rows(),
    "many": rows(1000),
    "one": rows(1),
    "two": rows(2),
    "repeated": np.repeat(rows(20), 4, axis=0),
    "constant": np.ones((30, 3)),
    "zero": np.zeros((30, 3)),
    "wide": 1e6 * rows(),
    "narrow": 1e-9 * rows(),
    "off the origin": 1e4 + rows(),
    "seconds of ten years": np.random.default_rng(0).uniform(0.0, 3e8, (60, 3)),
}
COVARIANCES = {
    "rbf": ConstantKernel(2.0) * RBF([0.5, 1.0, 2.0]),
    "fixed": RBF(1.0, "fixed"),
    "infinite length-scale": RBF([1.0, np.inf, 1.0], "fixed"),
    **{f"matern {nu}": Matern(nu=nu) for nu in (0.3, 0.5, 1.5, 2.5, 3.5, 15, np.inf)},
    "rational": RationalQuadratic(1.2, 0.6),
    "linear": ARDLinear([1.0, 0.0, 2.0], 0.0, "fixed", "fixed"),
    "paper": Columns(inverse_dynamics_kernel(1), [0, 1, 2, 0]),
    "geometric": Columns(geometric_inverse_dynamics_kernel("P"), [0, 1, 2, 0]),
    "cubic": DotProduct(1.0) ** 3,
    "constant": ConstantKernel(3.0),
    "white": RBF() + WhiteKernel(0.1),
    "white alone": WhiteKernel(),
    "periodic": Columns(ExpSineSquared(1.0, 3.0), [-1]),
    "short period": Columns(ExpSineSquared(1.0, 1e-3), [0]) * RBF(),
    "root": Exponentiation(RBF() + RBF(3.0), 1.0) * RBF() ** 0.5,
    "pairwise": PairwiseKernel(metric="laplacian"),
}


@pytest.mark.parametrize("kernel", COVARIANCES.values(), ids=COVARIANCES)
@pytest.mark.parametrize("X", INPUTS.values(), ids=INPUTS)
def test_covariances_are_accepted(kernel, X):
    check_kernel(kernel, X)


class Toy(RBF):
    """A kernel of a user's, with no fast form."""

    def __repr__(self):
        return f"{type(self).__name__}()"


class OwnNoise(Toy):
    """It tells a sample and itself from two samples at one input."""

    def __call__(self, X, Y=None, eval_gradient=False):
        found = super().__call__(X, Y, eval_gradient)
        if Y is not None:
            return found
        K = found[0] if eval_gradient else found
        K[np.diag_indices_from(K)] += 0.5
        return found

    def diag(self, X):
        return np.full(len(X), 1.5)


class SinglePrecision(Toy):
    def __call__(self, X, Y=None, eval_gradient=False):
        found = super().__call__(X, Y, eval_gradient)
        if eval_gradient:
            return tuple(part.astype(np.float32) for part in found)
        return found.astype(np.float32)


class InTheMean(Toy):
    """Its gradient is by differences of some digits."""

    def __call__(self, X, Y=None, eval_gradient=False):
        if not eval_gradient:
            return super().__call__(X, Y)
        ahead = RBF(1.001 * self.length_scale)(X)
        K = super().__call__(X)
        return K, ((ahead - K) / 1e-3)[..., None]


@pytest.mark.parametrize("kind", [Toy, OwnNoise, SinglePrecision, InTheMean])
@pytest.mark.parametrize("X", INPUTS.values(), ids=INPUTS)
def test_kernels_of_users_are_accepted(kind, X):
    check_kernel(kind() + RBF(), X)


class Wrong(Toy):
    """Values or gradients that are changed by ``change(found, X, Y)``."""

    def __call__(self, X, Y=None, eval_gradient=False):
        return self.change(super().__call__(X, Y, eval_gradient), X, Y)


def wrong_values(change):
    """A kernel whose values, not its gradient, are ``change(K, X, Y)``."""

    def apply(self, found, X, Y):
        if isinstance(found, tuple):
            return change(found[0], X, Y), found[1]
        return change(found, X, Y)

    return type("Wrong", (Wrong,), {"change": apply})()


def wrong_gradient(change):
    def apply(self, found, X, Y):
        return (found[0], change(found[1])) if isinstance(found, tuple) else found

    return type("Wrong", (Wrong,), {"change": apply})()


def wrong_diag(change):
    diag = {"diag": lambda self, X: change(RBF.diag(self, X))}
    return type("Wrong", (Toy,), diag)()


def raises(error):
    def change(K, X, Y):
        if len(X) > 1:
            raise error
        return K

    return wrong_values(change)


ROW = r"\[ ?-?\d.*\]"
NONE = {
    "wrong diag": (
        wrong_diag(lambda d: 0.5 * d),
        rf"kernel=Wrong\(\) contradicts .* its diag is 0\.5 and its value 1 for {ROW}",
    ),
    "one wrong in diag": (
        wrong_diag(lambda d: np.where(np.arange(len(d)) == 3, 1.1, d)),
        r"diag is 1\.1 and its value 1 for .* mend the kernel's diag",
    ),
    "a number for diag": (
        wrong_diag(lambda d: 1.0),
        r"diag of kernel=Wrong\(\) gives an array of shape \(\) for 24 samples",
    ),
    "NaN in diag": (wrong_diag(lambda d: np.nan * d), "its diag is nan and its value"),
    "not symmetric": (
        wrong_values(
            lambda K, X, Y: K * (1.0 + (X[:, :1] > (X if Y is None else Y)[:, 0]))
        ),
        rf"kernel=Wrong\(\) contradicts itself: .*k\(x', x\) = .* for {ROW} and {ROW}, "
        "which are rows of X. A covariance is a symmetric function",
    ),
    "another between two sets": (
        wrong_values(lambda K, X, Y: K if Y is None else 0.9 * K),
        "contradicts itself: .* among the rows of X, but .* between two sets of them",
    ),
    "of the whole set": (
        wrong_values(lambda K, X, Y: K ** (1.0 / len(X))),
        "contradicts itself: .* among the rows of X, but .* between two sets of them",
    ),
    "shape": (
        wrong_values(lambda K, X, Y: K[:, :1]),
        r"type Wrong gives an array of shape \(24, 1\) for 24 and 24 samples; a covar",
    ),
    "NaN": (
        wrong_values(lambda K, X, Y: np.where(K < 1e-2, np.nan, K)),
        rf"kernel=Wrong\(\) is nan between {ROW} and {ROW}, which are rows of X; a",
    ),
    "not positive": (
        wrong_values(lambda K, X, Y: 2.0 * K - 1.0),
        r"kernel=Wrong\(\) is not positive semi-definite, as a .* between 24 rows of X",
    ),
    "part of a sum": (
        RBF() + wrong_values(lambda K, X, Y: -2.0 * K),
        r"kernel=RBF\(length_scale=1\) \+ Wrong\(\) .*",
    ),
    "error": (raises(KeyError("no such row")), r"Wrong\(\) cannot .* 'no such row'"),
    "zero division": (raises(ZeroDivisionError("by 0")), r"cannot take X, .*by 0"),
    "sigmoid": (PairwiseKernel(metric="sigmoid"), "is not positive semi-definite"),
    "no such metric": (PairwiseKernel(metric="foo"), r"metric=foo\) cannot take X"),
    "a root of a linear kernel": (DotProduct() ** 0.5, r"\*\* 0.5 is nan between"),
    "a negative power": (RBF() ** -1.0, "is not positive semi-definite"),
    "a power that is NaN": (RBF() ** np.nan, "is nan between"),
    "alpha below 0": (
        RationalQuadratic(1.0, -1.0, alpha_bounds="fixed"),
        "is not positive semi-definite",
    ),
    "variance below 0": (
        ConstantKernel(-2.0, "fixed"),
        "is not positive semi-definite",
    ),
    "NaN in the gradient": (
        wrong_gradient(lambda G: np.where(G == 0.0, np.nan, G)),
        r"gradient of kernel=Wrong\(\) by theta\[0\] is not finite for rows of X. Mend",
    ),
    "too few gradients": (
        RBF() + wrong_gradient(lambda G: G[..., :0]),
        r"kernel=Wrong\(\) has shape \(24, 24, 0\), not \(24, 24, 1\): for 24 rows",
    ),
    "too many gradients": (
        Columns(wrong_gradient(lambda G: np.repeat(G, 2, axis=2)), [0]),
        r"kernel=Wrong\(\) has shape \(24, 24, 2\), not \(24, 24, 1\)",
    ),
    "a matrix for a gradient": (
        wrong_gradient(lambda G: G[..., 0]),
        r"kernel=Wrong\(\) has shape \(24, 24\), not \(24, 24, 1\)",
    ),
    "gradient of another sign": (
        2.0 * wrong_gradient(lambda G: -G),
        r"gradient of kernel=Wrong\(\) is not the derivative of its values by theta",
    ),
    "gradient that is missing": (
        wrong_gradient(lambda G: 0.0 * G),
        "it is 0 along a direction in which they change by .*or fix the hyperparam",
    ),
}
GPS = {
    "MultiTaskGPRegressor": MultiTaskGPRegressor(),
    "complete": MultiTaskGPRegressor(inference="kronecker"),
    "sparse": PooledGP(inference="sparse"),
    "RankSearchIC": RankSearchIC(MultiTaskGPRegressor()),
}


def table():
    X = np.tile(rows(8, 2), (3, 1))
    tasks = np.repeat(np.arange(3), 8)
    return np.column_stack([X, tasks]), X.sum(axis=1) + tasks


@pytest.mark.parametrize(("kernel", "match"), NONE.values(), ids=NONE)
@pytest.mark.parametrize("model", GPS.values(), ids=GPS)
def test_others_are_refused(model, kernel, match):
    model = clone(model)
    inner = "estimator__" * isinstance(model, RankSearchIC)
    model.set_params(**{f"{inner}kernel": kernel})
    X, y = table()
    with pytest.raises(ValueError, match=match):
        model.fit(X, y)
    with pytest.raises(NotFittedError):
        model.predict(X)


def test_gradient_that_the_kernel_cannot_give():
    class NoGradient(Toy):
        def __call__(self, X, Y=None):
            return RBF.__call__(self, X, Y)

    with pytest.raises(ValueError, match=r"cannot take X, .*argument 'eval_gradient'"):
        check_kernel(NoGradient(), rows())


def test_gradient_of_a_sum_of_ones_own():
    class Half(Sum):
        def __call__(self, X, Y=None, eval_gradient=False):
            found = super().__call__(X, Y, eval_gradient)
            return (found[0], 0.5 * found[1]) if eval_gradient else found

    with pytest.raises(ValueError, match="is not the derivative of its values"):
        check_kernel(Half(RBF(), RBF(2.0)), rows())


class TestOneFeature:
    @pytest.mark.parametrize(
        "kernel",
        [ExpSineSquared(), RBF() * ExpSineSquared(), ExpSineSquared() ** 2],
        ids=str,
    )
    def test_periodic_on_several(self, kernel):
        match = r"on one feature, not on {}\. Give it one, as Columns"
        with pytest.raises(ValueError, match=match.format(3)):
            check_kernel(kernel, rows())
        with pytest.raises(ValueError, match=match.format(2)):
            check_kernel(RBF() + Columns(kernel, [0, 2]), rows())
        check_kernel(RBF() + Columns(kernel, [2]), rows())

    def test_by_its_distances(self):
        """A kernel of the same kind that is not known."""

        class Periodic(ExpSineSquared):
            pass

        check_kernel(Periodic(1.0, 2.0), rows(d=1))
        with pytest.raises(ValueError, match="is not positive semi-definite"):
            check_kernel(Periodic(1.0, 2.0), rows(d=2))


def test_matern_is_hardly_another_kernel_than_what_is_advised():
    X = rows()
    assert np.abs(Matern(nu=15)(X) - RBF()(X)).max() < 0.03


def test_few_rows_are_looked_at():
    """Of a file, and of rows that no kernel could hold."""

    class Counted(np.ndarray):
        taken = 0

        def __getitem__(self, index):
            found = np.asarray(self)[index]
            Counted.taken += len(found)
            return found

        def __array__(self, *args, **kwargs):
            pytest.fail("all rows are taken")

    X = np.broadcast_to(rows(1), (10**8, 3)).view(Counted)
    check_covariance(RBF(), X)
    assert 0 < Counted.taken <= SAMPLED


def test_rows_are_drawn_from_all():
    """Where they are sorted, too."""
    X = np.linspace(0.0, 1.0, 100_000)[:, None]
    kernel = wrong_values(lambda K, X, Y: K * (1.0 + (X > 0.95)))
    with pytest.raises(ValueError, match="contradicts itself"):
        check_covariance(kernel, X)


class Worn(ConstantKernel):
    """c RBF while c is small; less some of the identity where it is not."""

    def __call__(self, X, Y=None, eval_gradient=False):
        K = self.constant_value * (RBF()(X, Y) - self.loss * RBF(1e-9)(X, Y))
        return (K, K[..., None]) if eval_gradient else K

    @property
    def loss(self):
        return 0.01 * (self.constant_value > 1.5)

    def diag(self, X):
        return np.full(len(X), self.constant_value * (1.0 - self.loss))

    def __repr__(self):
        return f"Worn({self.constant_value:.1f})"


@pytest.mark.parametrize("kind", [PooledGP, SingleTaskGP])
def test_what_was_learned_is_no_covariance(kind):
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 6.0, 40)
    y = 5.0 * np.sin(x) + 0.5 * rng.standard_normal(40)
    model = kind(Worn(), normalize_y=False)
    match = r"kernel=Worn\([2-9]\d*\.\d\) is not positive .* bounds of its hyperparamet"
    with pytest.raises(ValueError, match=match):
        model.fit(np.column_stack([x, np.zeros(40)]), y)
    assert not [name for name in vars(model) if name.endswith("_")]
    model.set_params(kernel=Worn(1.0, (0.1, 1.4)))
    model.fit(np.column_stack([x, np.zeros(40)]), y)


def test_rows_of_a_novel_task_are_looked_at():
    X, y = table()
    X[:, 0] = 0.0

    class OnTheAxis(Toy):
        """A covariance of rows whose first feature is 0."""

        def __call__(self, X, Y=None, eval_gradient=False):
            off, also = (of[:, 0] != 0.0 for of in (X, X if Y is None else Y))
            factor = 1.0 + (off[:, None] != also)
            found = super().__call__(X, Y, eval_gradient)
            if eval_gradient:
                return factor * found[0], factor[..., None] * found[1]
            return factor * found

    options = {"rank": 1, "max_iter": 5, "tol": 10.0, "task_levels": False}
    options |= {"normalize_y": "shared", "noise": "shared"}
    model = MultiTaskGPRegressor(OnTheAxis(), **options).fit(X, y)
    with pytest.raises(ValueError, match="is not positive semi-definite"):
        model.add_task([[0.1, 0.0, 3.0]], [1.0])
    with pytest.raises(ValueError, match="is not positive semi-definite"):
        model.partial_fit([[0.1, 0.0, X[0, -1]]], [1.0])


def test_spherical_of_many_features():
    X = np.random.default_rng(0).standard_normal((9, 5))
    y = X[:, 0]
    X[:, -1] = 0.0
    with pytest.raises(ValueError, match=r"up to three features, not on 4\. Give it"):
        PooledGP(1.0 * Spherical()).fit(X, y)
    PooledGP(1.0 * Columns(Spherical(), [0, 1, 2]), max_iter=0).fit(X, y)


class Lopsided(RBF):
    """A user's kernel, which is another one between two sets of rows."""

    def __call__(self, X, Y=None, eval_gradient=False):
        found = super().__call__(X, Y, eval_gradient)
        return found if Y is None else 2.0 * found


def test_rows_that_join_are_compared_where_a_part_is_the_users():
    X = np.random.default_rng(0).standard_normal((6, 2))
    for inner, foreign in [(Lopsided(), True), (RBF(), False)]:
        kernel = Columns(inner, [0]) ** 2.0 + RBF()
        assert is_foreign(compile_kernel(kernel)) == foreign
    check_covariance(kernel, X, compile_kernel(kernel))
    kernel = Columns(Lopsided(), [0]) + RBF()
    with pytest.raises(ValueError, match="contradicts itself"):
        check_covariance(kernel, X, compile_kernel(kernel))
