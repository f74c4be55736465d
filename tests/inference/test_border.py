import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp.inference.border import BorderLikelihood
from skmtgp.model.task_covariance import low_rank

M, RANK = 3, 2
KERNELS = {
    "RBF": ConstantKernel(1.5) * RBF([0.8, 1.3]),
    "white": RBF([0.8, 1.3]) + WhiteKernel(0.3),
    "constant": ConstantKernel(0.7),
}


class Problem:
    """Old tasks of a model, and a novel one of a few samples."""

    def __init__(self, *, n_new=6, own=True, diagonal=False, per_task=False, kernel):
        rng = np.random.default_rng(0)
        self.kernel, self.own = kernel, own
        self.tasks = np.repeat(np.arange(M), [7, 5, 6])
        self.X, self.X_new = rng.normal(size=(18, 2)), rng.normal(size=(n_new, 2))
        self.X_new[-1] = self.X[0]  # where an old task was observed
        self.y, self.y_new = rng.normal(size=18), rng.normal(size=n_new)
        form = low_rank(M, RANK, diagonal)
        self.F, self.kappa = rng.normal(size=(M, RANK)), np.array([0.2, 0.5, 0.1])
        self.noise = np.array([0.05, 0.1, 0.2] if per_task else [0.05])
        self.noise_new = 0.07
        likelihood = building.dense(
            kernel, form, self.X, self.tasks, self.y, n_noise=len(self.noise)
        )
        log_kappa = np.log(self.kappa) if diagonal else np.empty(0)
        theta = [kernel.theta, self.F.ravel(), log_kappa, np.log(self.noise)]
        self.posterior = likelihood.posterior(np.concatenate(theta))
        self.K_rho = textbook.low_rank(self.F, self.kappa if diagonal else None)
        self.row = rng.normal(size=RANK + own)

    def border(self, noise=None):
        noise = self.noise_new if noise is None else noise
        return BorderLikelihood(
            self.posterior, self.F, self.X_new, self.y_new, noise, self.own
        )

    def covariance(self, row):
        """Of all targets, those of the novel task last."""
        shared, w = row[:RANK], row[RANK:]
        border, corner = self.F @ shared, shared @ shared + w @ w
        K_rho = np.block([[self.K_rho, border[:, None]], [border, corner]])
        noise = np.append(np.broadcast_to(self.noise, M), self.noise_new)
        tasks = np.append(self.tasks, np.full(len(self.X_new), M))
        X = np.vstack([self.X, self.X_new])
        return textbook.covariance(self.kernel, K_rho, noise, X, tasks)

    def conditional(self, row):
        """Mean and covariance of the new targets given the old ones."""
        K, n = self.covariance(row), len(self.y)
        weights = np.linalg.solve(K[:n, :n], K[:n, n:]).T
        return weights @ self.y, K[n:, n:] - weights @ K[:n, n:]


@pytest.fixture(params=KERNELS.values(), ids=KERNELS)
def kernel(request):
    return request.param


@pytest.fixture(params=[1, 6], ids=["one sample", "six samples"])
def n_new(request):
    return request.param


@pytest.fixture(params=[False, True], ids=["shared", "own"])
def own(request):
    return request.param


@pytest.fixture
def problem(n_new, own, kernel):
    return Problem(n_new=n_new, own=own, kernel=kernel)


@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize("per_task", [False, True])
def test_value_is_the_likelihood_that_the_new_task_adds(
    n_new, own, kernel, diagonal, per_task
):
    problem = Problem(
        n_new=n_new, own=own, diagonal=diagonal, per_task=per_task, kernel=kernel
    )
    K, n = problem.covariance(problem.row), len(problem.y)
    everything = np.append(problem.y, problem.y_new)
    expected = textbook.log_marginal_likelihood(K, everything)
    expected -= textbook.log_marginal_likelihood(K[:n, :n], problem.y)
    border = problem.border()
    np.testing.assert_allclose(border.value(problem.row), expected, rtol=1e-8)
    assert border.value(problem.row) == border.value_and_grad(problem.row)[0]


def test_gradient(problem):
    border = problem.border()
    for row in (problem.row, -problem.row, np.ones_like(problem.row)):
        gradient = border.value_and_grad(row)[1]
        expected = textbook.derivative(border.value, row)
        close = {"rtol": 1e-8, "atol": 1e-8 * np.abs(expected).max()}
        np.testing.assert_allclose(gradient, expected, **close)


def test_gradient_of_w_vanishes_where_w_does():
    problem = Problem(kernel=KERNELS["RBF"])
    row = np.append(problem.row[:RANK], 0.0)
    shared = Problem(own=False, kernel=KERNELS["RBF"]).border()
    value, gradient = problem.border().value_and_grad(row)
    expected, expected_gradient = shared.value_and_grad(row[:RANK])
    assert value == expected
    np.testing.assert_array_equal(gradient, np.append(expected_gradient, 0.0))


def test_fisher_information(problem):
    """dm_p^T S^{-1} dm_q + 1/2 tr(S^{-1} dS_p S^{-1} dS_q), term by term."""
    row = problem.row
    dm = textbook.derivative(lambda row: problem.conditional(row)[0], row)
    dS = textbook.derivative(lambda row: problem.conditional(row)[1], row)
    inverse = np.linalg.inv(problem.conditional(row)[1])
    expected = [
        [
            dm[p] @ inverse @ dm[q] + 0.5 * np.trace(inverse @ dS[p] @ inverse @ dS[q])
            for q in range(len(row))
        ]
        for p in range(len(row))
    ]
    found = problem.border().fisher_information(row)
    atol = 1e-9 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=atol)
    assert np.linalg.eigvalsh(found)[0] > -atol


def test_means_are_those_of_the_latent_functions(kernel):
    """z_a = sum_i F[m_i, a] k^x(x, x_i) alpha_i: of them f = l @ z is made."""
    problem = Problem(kernel=kernel)
    for a, unit in enumerate(np.eye(RANK)):
        mean = problem.conditional(np.append(unit, 0.0))[0]
        np.testing.assert_allclose(problem.border().means[a], mean, rtol=1e-9)


def test_where_the_covariance_is_not_positive_definite(problem):
    border = problem.border(noise=-100.0)
    value, gradient = border.value_and_grad(problem.row)
    assert value == border.value(problem.row) == -np.inf
    assert gradient.shape == problem.row.shape
    assert np.isnan(gradient).all()
    assert np.isfinite(border.fisher_information(problem.row)).all()


def test_nothing_is_changed_by_an_evaluation():
    problem = Problem(kernel=KERNELS["RBF"])
    border, row = problem.border(), problem.row.copy()
    first = border.value(row)
    border.fisher_information(row)
    border.value_and_grad(2.0 * row)
    assert border.value(row) == first
    np.testing.assert_array_equal(row, problem.row)


def test_an_error_of_the_model(problem):
    """A function of the novel task, with a share of its prior variance."""
    row, plain, share = problem.row, problem.border(), 0.3
    border = BorderLikelihood(
        problem.posterior,
        problem.F,
        problem.X_new,
        problem.y_new,
        problem.noise_new,
        problem.own,
        error=share,
    )
    more = share * (row @ row) * problem.kernel(problem.X_new)
    np.testing.assert_allclose(
        border._covariance(row)[0], plain._covariance(row)[0] + more, rtol=1e-10
    )
    expected = textbook.derivative(border.value, row)
    close = {"rtol": 1e-8, "atol": 1e-8 * np.abs(expected).max()}
    np.testing.assert_allclose(border.value_and_grad(row)[1], expected, **close)
    dm = np.zeros((len(row), len(problem.y_new)))
    dm[:RANK] = border.means
    dS = textbook.derivative(lambda row: border._covariance(row)[0], row)
    inverse = np.linalg.inv(border._covariance(row)[0])
    information = dm @ inverse @ dm.T
    scores = inverse @ dS
    information += 0.5 * np.einsum("pij,qji->pq", scores, scores)
    np.testing.assert_allclose(
        border.fisher_information(row), information, rtol=1e-6, atol=1e-8
    )


class TestPairs:
    """All borders at once, with second derivatives."""

    @staticmethod
    def border(problem, error):
        given = problem.posterior, problem.F, problem.X_new, problem.y_new
        return BorderLikelihood(*given, problem.noise_new, problem.own, error=error)

    def rows(self, problem):
        return np.stack([problem.row, -problem.row, np.ones_like(problem.row)])

    @pytest.mark.parametrize("error", [0.0, 0.3])
    def test_values_and_gradients(self, problem, error):
        border, rows = self.border(problem, error), self.rows(problem)
        values, gradients, _ = border.pairs().evaluate(rows)
        expected = [border.value_and_grad(row) for row in rows]
        for *found, (value, gradient) in zip(values, gradients, expected, strict=True):
            np.testing.assert_allclose(found[0], value, rtol=1e-10)
            atol = 1e-10 * np.abs(gradient).max()
            np.testing.assert_allclose(found[1], gradient, rtol=1e-10, atol=atol)

    @pytest.mark.parametrize("error", [0.0, 0.3])
    def test_hessians(self, problem, error):
        border, rows = self.border(problem, error), self.rows(problem)
        for row, found in zip(rows, border.pairs().evaluate(rows)[2], strict=True):
            slope = textbook.derivative(lambda row: border.value_and_grad(row)[1], row)
            atol = 1e-7 * np.abs(slope).max()
            np.testing.assert_allclose(found, slope, rtol=0.0, atol=atol)
            np.testing.assert_allclose(found, found.T, atol=1e-9 * np.abs(found).max())

    @pytest.mark.parametrize("error", [0.0, 0.3])
    def test_fisher_information(self, problem, error):
        border, rows = self.border(problem, error), self.rows(problem)
        scale = np.tril(np.random.default_rng(1).normal(size=(rows.shape[1],) * 2))
        pairs = border.pairs(rows[0], scale)
        for u in np.vstack([np.zeros_like(rows[:1]), 0.1 * rows]):
            of_row = border.fisher_information(rows[0] + scale @ u)
            expected = scale.T @ of_row @ scale
            atol = 1e-9 * np.abs(expected).max()
            np.testing.assert_allclose(
                pairs.fisher_information(u), expected, rtol=1e-7, atol=atol
            )

    def test_coordinates(self, problem):
        """Of a row, mean + scale @ u: derivatives are those of the chain rule."""
        border, rows = self.border(problem, 0.3), self.rows(problem)
        rng = np.random.default_rng(1)
        mean = rng.normal(size=rows.shape[1])
        scale = np.tril(rng.normal(size=(len(mean), len(mean))))
        scale[np.diag_indices(len(mean))] += 3.0
        U = np.linalg.solve(scale, (rows - mean).T).T
        found = border.pairs(mean, scale).evaluate(U)
        values, gradients, hessians = border.pairs().evaluate(rows)
        np.testing.assert_allclose(found[0], values, rtol=1e-9)
        np.testing.assert_allclose(found[1], gradients @ scale, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(
            found[2], scale.T @ hessians @ scale, rtol=1e-7, atol=1e-6
        )

    def test_what_cannot_be_factorised(self, problem):
        pairs = problem.border(noise=-problem.row @ problem.row).pairs()
        values, gradients, _ = pairs.evaluate(np.zeros((1, len(problem.row))))
        assert values[0] == -np.inf
        assert np.isnan(gradients[0]).all()
