"""Variances that are negative: by rounding they are 0, beyond it a warning says so."""

import warnings

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
)

from skmtgp import MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._estimators import fitted, posing
from skmtgp.exceptions import (
    ConstantTargetWarning,
    JitterWarning,
    NegativeVarianceWarning,
)
from skmtgp.inference import posterior
from skmtgp.inference.variances import rounding_of, without_negatives
from skmtgp.model.task_covariance import low_rank


class Doubled(RBF):
    """Twice as large between rows on the first axis and rows off it: indefinite."""

    def __call__(self, X, Y=None, eval_gradient=False):
        off, also_off = (
            np.asarray(of)[:, 1] != 0.0 for of in (X, X if Y is None else Y)
        )
        factor = 1.0 + (off[:, None] != also_off)
        if eval_gradient:
            K, gradient = super().__call__(X, Y, eval_gradient=True)
            return factor * K, factor[..., None] * gradient
        return factor * super().__call__(X, Y)


class HalfDiag(RBF):
    """Its diag is half of what it should be."""

    def diag(self, X):
        return 0.5 * super().diag(X)


class TestWithoutNegatives:
    def test_rounding_is_silent(self):
        variance = np.array([-2e-9, 0.5, 0.0, -1e-9])
        found = without_negatives(variance, np.array([2.0, 1.0, 0.0, 1.0]), 1e-9)
        np.testing.assert_array_equal(found, [0.0, 0.5, 0.0, 0.0])
        assert found is variance

    def test_more_is_told(self):
        variance, prior = np.array([-3e-9, 0.5, -6.0, -1e-9]), np.full(4, 2.0)
        match = (
            r"^2 of 4 variances of f are negative, down to -3\.0e\+00 of the prior's; "
            r"rounding explains only -1e-09\. .*page 'Speed and large data'"
        )
        with pytest.warns(NegativeVarianceWarning, match=match):
            found = without_negatives(variance, prior, 1e-9)
        np.testing.assert_array_equal(found, [0.0, 0.5, 0.0, 0.0])

    @pytest.mark.parametrize("prior", [0.0, -1.0])
    def test_prior_that_is_not_positive(self, prior):
        with pytest.warns(NegativeVarianceWarning, match="^1 of 2 variances"):
            without_negatives(np.array([-10.0, 0.0]), np.array([prior, prior]), 0.5)


@pytest.mark.parametrize(
    ("noise", "expected"), [(1.0, 2.2e-12), (1e-6, 2.2e-6), (1e-15, 1.0), (0.0, 1.0)]
)
def test_rounding_grows_with_the_condition(noise, expected):
    assert rounding_of(100, 10.0, noise) == pytest.approx(expected, rel=0.02)


def design(n=12, M=2):
    """Complete data on the first axis of two features, sorted by task."""
    rng = np.random.default_rng(0)
    x = np.column_stack([rng.uniform(0.0, 6.0, n), np.zeros(n)])
    X, tasks = np.tile(x, (M, 1)), np.repeat(np.arange(M), n)
    return X, tasks, np.sin(X).sum(axis=1) + tasks


def extended(kernel, form, X, tasks, y):
    kept = np.r_[: len(X) - 3]
    return building.extended(kernel, form, X[kept], tasks[kept], y[kept], 1, [1])


ENGINES = {
    "dense": building.dense,
    "kronecker": building.kronecker,
    "extended": extended,
    "sparse": lambda *data: building.sparse(*data, data[2][:12]),
}
every_engine = pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)


def posterior_of(engine, kernel, noise):
    likelihood = engine(kernel, low_rank(2, 2), *design())
    return likelihood.posterior(np.r_[kernel.theta, 1.0, 0.5, -1.0, 1.0, np.log(noise)])


def variance(p, X, tasks):
    return p.variance(X, tasks)


def covariance(p, X, tasks):
    return np.diagonal(p.covariance(X, tasks))


each_way = pytest.mark.parametrize("ask", [variance, covariance])


@every_engine
@each_way
def test_kernel_that_is_not_definite(engine, ask):
    p, (X, tasks, _) = posterior_of(engine, Doubled(), 1e-3), design()
    assert (ask(p, X, tasks) > 0.0).all()  # on the axis it is RBF
    moved = X + [0.0, 0.1]
    match = r"^24 of 24 variances of f are negative, down to -[23].*semi-definite"
    with pytest.warns(NegativeVarianceWarning, match=match):
        found = ask(p, moved, tasks)
    np.testing.assert_array_equal(found, 0.0)


@every_engine
def test_kernel_with_a_wrong_diagonal(engine):
    p, (X, tasks, _) = posterior_of(engine, HalfDiag(), 1e-3), design()
    with pytest.warns(NegativeVarianceWarning, match="^24 of 24 .*diag is its diag"):
        p.variance(X, tasks)


@every_engine
@each_way
@pytest.mark.parametrize("noise", [1e-2, 1e-6, 1e-10, 1e-13])
@pytest.mark.parametrize(
    "kernel",
    [
        ConstantKernel(900.0) * RBF(1.0),
        ConstantKernel(900.0) * RBF(30.0),
        DotProduct() ** 2,
    ],
    ids=["rbf", "singular", "polynomial"],
)
def test_rounding_is_never_told(engine, ask, noise, kernel):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", JitterWarning)
        p = posterior_of(engine, kernel, noise)
    X, tasks, _ = design()
    for rows in (X, X + [1e-9, 0.0], X + [0.0, 0.3]):
        assert (ask(p, rows, tasks) >= 0.0).all()
    assert (p.leave_one_out()[1] >= 0.0).all()


def test_left_out_by_a_kernel_that_is_not_definite():
    kernel = ConstantKernel(-0.1, "fixed") * RBF(1.0)
    p = posterior_of(building.dense, kernel, 5.0)
    with pytest.warns(NegativeVarianceWarning, match=r"^24 of 24 variances of f are"):
        _, variances = p.leave_one_out()
    np.testing.assert_array_equal(variances, 0.0)


def test_left_out_by_features_that_lack_digits():
    """1 - h_i, of the size of the noise, is lost by inducing inputs in any order."""
    X = np.random.default_rng(2).uniform(0.0, 6.0, (200, 2))
    tasks, y = np.zeros(200, dtype=int), np.sin(X).sum(axis=1)
    bound = building.sparse(RBF(), low_rank(1, 1), X, tasks, y, X)
    p = bound.posterior(np.r_[0.0, 1.0, np.log(1e-14)])
    with pytest.warns(NegativeVarianceWarning, match="noise variance is too small for"):
        residual, _ = p.leave_one_out()
    assert np.abs(residual).max() < 1e3


class TestPredictions:
    """What estimators tell, the kernel not being looked at before."""

    @pytest.fixture(autouse=True)
    def trusted(self, monkeypatch):
        monkeypatch.setattr(posing, "check_kernel", lambda *args: None)
        monkeypatch.setattr(fitted, "check_covariance", lambda *args: None)

    @pytest.fixture(params=[MultiTaskGPRegressor, PooledGP, SingleTaskGP])
    def model(self, request):
        X, tasks, y = design()
        model = request.param(Doubled(), max_iter=0, noise_variance=1e-3)
        return model.fit(np.column_stack([X, tasks]), y)

    def test_all_rows_are_counted_at_once(self, model, monkeypatch):
        monkeypatch.setattr(posterior, "BLOCK_SIZE", 24 * 5)
        new = np.column_stack(
            [np.linspace(0.0, 6.0, 22), np.full(22, 0.1), np.zeros(22)]
        )
        for options in ({"return_std": True}, {"return_cov": True}):
            with pytest.warns(NegativeVarianceWarning, match="^22 of 22") as caught:
                _, uncertainty = model.predict(new, **options)
            assert len(caught) == 1
            assert (np.diagonal(np.atleast_2d(uncertainty)) == 0.0).all()
        with pytest.warns(NegativeVarianceWarning, match="^22 of 22"):
            model.sample_y(new)

    def test_means_alone_need_no_variance(self, model):
        model.predict([[1.0, 0.1, 0]])


def test_a_prior_of_zero_is_no_fault():
    """What is left of two equal numbers is rounding, however small the prior is."""
    assert rounding_of(30, 0.0, 1e-3) >= np.finfo(float).eps
    X = np.column_stack([np.linspace(0.0, 1.0, 31), np.arange(31) % 3])
    y = np.zeros(31)
    with pytest.warns(ConstantTargetWarning):
        model = MultiTaskGPRegressor(max_iter=0, noise_variance=0.038).fit(X, y)
    assert (model.loo_predict()[1] >= 0.0).all()
