"""Sparse inference behind the estimators."""

import pickle

import building
import numpy as np
import pytest
import textbook
from multitask_models import PAPER
from numpy.testing import assert_allclose, assert_array_equal
from sklearn import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sparse_models import FACTOR, GPS, NOISE, SPARSE, M, N, draw

from skmtgp import (
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.inference.border import BorderLikelihood
from skmtgp.model.task_covariance import low_rank

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
each = pytest.mark.parametrize("model", GPS.values(), ids=GPS.keys())


@each
class TestFit:
    def test_bound_is_below_the_likelihood(self, model):
        X, y = draw()
        sparse = clone(model).fit(X, y)
        exact = clone(model).set_params(inference="dense", max_iter=0).fit(X, y)
        below = sparse.log_marginal_likelihood_value_
        assert below < exact.log_marginal_likelihood(sparse.theta_)
        assert_allclose(below, sparse.log_marginal_likelihood(sparse.theta_), rtol=1e-9)
        assert sparse.inference_ == "sparse"
        assert sparse.inducing_inputs_.shape == (20, 2)

    def test_exact_where_all_inputs_are_inducing(self, model):
        X, y = draw(40)
        kernel = model.kernel if isinstance(model.kernel, list) else RBF(1.0)
        model = clone(model).set_params(n_inducing=1000, kernel=kernel)
        sparse = model.fit(X, y)
        exact = clone(model).set_params(inference="dense", max_iter=0).fit(X, y)
        theta = sparse.theta_
        value, gradient = exact.log_marginal_likelihood(theta, eval_gradient=True)
        found = sparse.log_marginal_likelihood(theta, eval_gradient=True)
        assert_allclose(found[0], value, rtol=1e-6)
        assert_allclose(
            found[1], gradient, rtol=1e-3, atol=1e-6 + 1e-3 * abs(gradient).max()
        )

    def test_order_of_rows_does_not_matter(self, model):
        X, y = draw()
        model = clone(model).set_params(max_iter=0, n_inducing=N, n_exact=N)
        order = np.random.default_rng(1).permutation(N)
        one, other = model.fit(X, y), clone(model).fit(X[order], y[order])
        assert_allclose(
            one.log_marginal_likelihood_value_,
            other.log_marginal_likelihood_value_,
            rtol=1e-9,
        )
        for a, b in zip(
            one.predict(X, return_std=True),
            other.predict(X, return_std=True),
            strict=True,
        ):
            assert_allclose(a, b, rtol=1e-6, atol=1e-8)
        for a, b in zip(one.loo_predict(), other.loo_predict(), strict=True):
            assert_allclose(a[order], b, rtol=1e-6, atol=1e-8)

    def test_predicts(self, model):
        X, y = draw(300)
        model = clone(model).set_params(n_inducing=40, max_iter=200).fit(X, y)
        X_new, y_new = draw(200, seed=1)
        mean, std = model.predict(X_new, return_std=True)
        if not isinstance(model, PooledGP):
            assert np.mean((mean - y_new) ** 2) < 0.1 * y_new.var()
        _, covariance = model.predict(X_new[:9], return_cov=True)
        assert_allclose(np.diagonal(covariance), std[:9] ** 2, rtol=1e-6, atol=1e-9)
        assert model.sample_y(X_new[:9], 3).shape == (9, 3)

    def test_pickles(self, model):
        X, y = draw(n_outputs=2)
        model = clone(model).set_params(max_iter=2).fit(X, y)
        again = pickle.loads(pickle.dumps(model))
        assert_allclose(again.predict(X), model.predict(X), rtol=0.0)
        assert [len(Z) for Z in model.inducing_inputs_] == [20, 20]


def test_dense_has_no_inducing_inputs():
    model = MultiTaskGPRegressor(rank=1, **SPARSE).fit(*draw())
    model.set_params(inference="dense").fit(*draw(20))
    assert not hasattr(model, "inducing_inputs_")


def test_single_tasks():
    X, y = draw()
    model = SingleTaskGP(**SPARSE).fit(X, y)
    assert model.inference_ == "sparse"
    alone = PooledGP(**SPARSE).fit(X[X[:, -1] == 1], y[X[:, -1] == 1])
    rows = X[:, -1] == 1
    assert_allclose(model.predict(X[rows]), alone.predict(X[rows]), rtol=1e-8)


class TestRankSearch:
    def test_likelihood_does_not_fall_with_the_rank(self):
        search = RankSearchIC(MultiTaskGPRegressor(**SPARSE), ranks=(1, 2, 3))
        search.set_params(keep_estimators=True).fit(*draw())
        values = search.results_["log_marginal_likelihood"]
        # the density of little noise, which is maximised too, is no part of them
        assert (np.diff(values) >= -0.01).all()
        found = [m.log_marginal_likelihood_value_ for m in search.estimators_]
        assert_allclose(found, values, rtol=1e-9)
        first, *others = (m.inducing_inputs_ for m in search.estimators_)
        for other in others:
            assert_array_equal(first, other)

    @pytest.mark.parametrize("noise", ["shared", "per_task"])
    def test_progress(self, told, noise):
        """Densities of the noise are no part of what is said."""
        model = MultiTaskGPRegressor(rank=1, verbose=1, noise=noise, **SPARSE)
        model.set_params(max_iter=1).fit(*draw())
        line = told()[-1]
        value = model.log_marginal_likelihood_value_
        expected = f"rank 1: lower bound on the log likelihood {value:.1f} of all"
        assert line.startswith(expected)


def scattered(seed=0):
    """A bound, parameters, and what they stand for."""
    X, y = draw(30, seed)
    kernel, form = RBF([0.8, 1.3]), low_rank(M, 2)
    theta = np.concatenate([kernel.theta, FACTOR.ravel(), [np.log(NOISE)]])
    features, tasks = X[:, :2], X[:, 2].astype(int)
    bound = building.sparse(
        kernel, form, features, tasks, y, features[:8], block_size=7
    )
    return bound, theta


class TestLeaveOneOut:
    def expected(self, bound, theta):
        """Left out one after another, with the same inducing inputs."""
        K_rho, every = FACTOR @ FACTOR.T, np.arange(len(bound.y))
        kernel, Z = bound.prior.kernel, bound.Z
        Q = kernel(bound.X, Z) @ np.linalg.solve(kernel(Z), kernel(Z, bound.X))
        between = K_rho[np.ix_(bound.tasks, bound.tasks)]
        Q, prior = Q * between, between * kernel(bound.X)
        for i in every:
            o = every[every != i]
            solved = np.linalg.solve(Q[np.ix_(o, o)] + NOISE * np.eye(len(o)), Q[o, i])
            yield bound.y[i] - solved @ bound.y[o], prior[i, i] - solved @ Q[o, i]

    @pytest.mark.parametrize("include_noise", [False, True])
    def test_leave_one_out(self, include_noise):
        bound, theta = scattered()
        found = bound.posterior(theta).leave_one_out(include_noise)
        residual, variance = np.array(list(self.expected(bound, theta))).T
        assert_allclose(found[0], residual, rtol=1e-8, atol=1e-10)
        assert_allclose(found[1], variance + NOISE * include_noise, rtol=1e-7)


class TestAddTask:
    @pytest.mark.parametrize("n", [5, 40])
    def test_latent_functions(self, n):
        """Their covariances are those of the tasks' functions, without F."""
        bound, theta = scattered()
        posterior, rank = bound.posterior(theta), FACTOR.shape[1]
        X = np.random.default_rng(2).uniform(-2.0, 2.0, (n, 2))
        means, halves = posterior.latent(X, FACTOR)
        assert halves.shape == (rank, rank * min(n, len(bound.Z)), n)
        for m, F_m in enumerate(FACTOR):
            tasks = np.full(n, m)
            assert_allclose(F_m @ means, posterior.mean(X, tasks), rtol=1e-7)
            half = np.tensordot(F_m, halves, 1)
            covariance = (F_m @ F_m) * bound.prior.kernel(X) - half.T @ half
            expected = posterior.covariance(X, tasks)
            assert_allclose(covariance, expected, rtol=1e-7, atol=1e-9)

    def test_border_where_all_inputs_are_inducing(self):
        bound, theta = scattered()
        bound = bound.with_inducing(bound.X)
        order = np.argsort(bound.tasks, kind="stable")
        exact = building.dense(
            bound.prior.kernel,
            bound.prior.task_covariance,
            *(part[order] for part in (bound.X, bound.tasks, bound.y)),
        )
        X, y = np.random.default_rng(2).uniform(-2.0, 2.0, (4, 2)), np.arange(4.0)
        row = np.array([0.3, -0.8])
        found, expected = (
            BorderLikelihood(some.posterior(theta), FACTOR, X, y, NOISE, False)
            for some in (bound, exact)
        )
        found, expected = (one.value_and_grad(row) for one in (found, expected))
        assert_allclose(found[0], expected[0], rtol=1e-5)
        assert_allclose(found[1], expected[1], rtol=1e-4)

    def test_a_novel_task(self):
        X, y = draw(400)
        known, novel = X[:, 2] < 2, np.flatnonzero(X[:, 2] == 2)
        model = MultiTaskGPRegressor(rank=2, **SPARSE | {"max_iter": 200})
        model.set_params(n_inducing=50).fit(X[known], y[known])
        before = model.predict(X[known])
        extended = model.add_task(X[novel[:10]], y[novel[:10]])
        mean = extended.predict(X[novel])
        assert np.mean((mean - y[novel]) ** 2) < 0.2 * y[novel].var()
        assert extended.inference_ == "sparse"
        assert 50 <= len(extended.inducing_inputs_) <= 60
        assert_array_equal(model.predict(X[known]), before)

    def test_a_large_novel_task(self):
        """It does not get more inducing inputs than the others have."""
        X, y = draw(200)
        known = X[:, 2] < 2
        model = MultiTaskGPRegressor(rank=1, **SPARSE).fit(X[known], y[known])
        extended = model.add_task(X[~known], y[~known])
        assert len(extended.inducing_inputs_) <= 40

    @pytest.mark.parametrize(
        "options", [{"noise": "per_task"}, {"diagonal": True}, {"learning": "staged"}]
    )
    def test_novel_task_where_all_inputs_are_inducing(self, options):
        """It is the novel task of exact inference."""
        X, y = draw(80)
        novel = X[:, 2] == 2
        found = []
        for inference in ("sparse", "dense"):
            model = MultiTaskGPRegressor(rank=1, max_iter=0, **options)
            model.set_params(inference=inference, n_inducing=len(y))
            model.fit(X[~novel], y[~novel]).set_params(max_iter=100)
            found.append(model.add_task(X[novel], y[novel]))
        assert_allclose(*(model.theta_ for model in found), rtol=1e-5, atol=1e-5)
        pairs = (model.predict(X, return_std=True) for model in found)
        means, stds = zip(*pairs, strict=True)
        assert_allclose(*means, rtol=1e-5, atol=1e-5)
        assert_allclose(*stds, rtol=1e-5)


def test_textbook_bound():
    """The estimator's value is Titsias' (2009) eq. 9, in units of y."""
    X, y = draw(40)
    options = PAPER | {"normalize_y": False}
    model = MultiTaskGPRegressor(RBF(1.0), rank=2, **options, **SPARSE).fit(X, y)
    Z, tasks, features = model.inducing_inputs_, model.tasks_train_, model.X_train_
    kernel, K_rho = model.kernel_, model.task_covariance_[np.ix_(tasks, tasks)]
    Q = kernel(features, Z) @ np.linalg.solve(kernel(Z), kernel(Z, features)) * K_rho
    noise = model.noise_variance_
    value = textbook.log_marginal_likelihood(Q + noise * np.eye(len(y)), y)
    value -= 0.5 * np.trace(kernel(features) * K_rho - Q) / noise
    assert_allclose(model.log_marginal_likelihood_value_, value, rtol=1e-7)


def test_unfinished():
    with pytest.warns(ConvergenceWarning, match="max_iter=1"):
        MultiTaskGPRegressor(rank=1, **SPARSE | {"max_iter": 1}).fit(*draw())


def test_noise_of_the_kernel_is_refused():
    model = PooledGP(RBF() + WhiteKernel(), inference="sparse")
    with pytest.raises(ValueError, match=r"inference='sparse' needs .* WhiteKernel"):
        model.fit(*draw())


@pytest.mark.parametrize("name", ["n_inducing", "n_exact"])
@pytest.mark.parametrize("value", [0, -3, 2.5, "many"])
def test_numbers_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        PooledGP(inference="sparse", **{name: value}).fit(*draw())
