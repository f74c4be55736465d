"""Variances that count what is open of theta, against the textbook at other thetas."""

import pickle

import building
import numpy as np
import pytest
import textbook
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference.leeway import OfAll, OfTheta, widened
from skmtgp.inference.open_rows import OfRow
from skmtgp.model.task_covariance import low_rank

N_TASKS, RANK, ROW = 3, 2, 1
FORM = low_rank(N_TASKS, RANK)
Z, OF_Z = np.linspace(0.0, 7.0, 6)[:, None], np.array([0, 1, 2, 1, 0, 2])


def rows():
    rng = np.random.default_rng(0)
    x, tasks = np.linspace(0.0, 6.0, 6), np.repeat(np.arange(N_TASKS), 6)
    X = np.tile(x, N_TASKS)[:, None]
    return X, tasks, np.sin(X[:, 0]) * (tasks - 0.5) + 0.1 * rng.standard_normal(18)


def dense(form=FORM, **options):
    return building.dense(RBF(1.0), form, *rows(), levels=True, **options)


LIKELIHOODS = {
    "dense": dense,
    "kronecker": lambda: building.kronecker(RBF(1.0), FORM, *rows(), levels=True),
    "sparse": lambda: building.sparse(
        RBF(1.0), FORM, *rows(), rows()[0][:6], levels=True
    ),
}


def theta_of(likelihood):
    prior = likelihood.prior
    theta = np.full(prior.n_theta, -0.5)
    F = np.array([[1.0, 0.2], [-0.5, 0.8], [0.3, 0.6]])
    theta[prior.of_factor] = F.ravel()
    theta[prior.of_noise] = np.log(0.05)
    return theta


def whole(theta, n_axes=4):
    """Axes of all of theta."""
    away = 0.2 * np.random.default_rng(1).standard_normal((n_axes, len(theta)))
    return OfTheta(np.stack([theta + away, theta - away], axis=1))


OF_ROW = OfRow(ROW, [np.array([[0.3, 0.1], [-0.1, 0.2]])])


def opened(likelihood, *leeway):
    theta = theta_of(likelihood)
    return widened(likelihood.posterior(theta), likelihood, leeway)


def by_the_book(likelihood, theta):
    """Mean and covariance of f at Z."""
    prior, (X, tasks, y) = likelihood.prior, rows()
    values = prior.values(theta)
    parts = prior.kernel_at(theta), prior.K_rho_at(theta), values.noise
    return textbook.posterior(*parts, X, tasks, y, Z, OF_Z, level=values.level)


def differences(likelihood, ends):
    means = [[by_the_book(likelihood, theta)[0] for theta in pair] for pair in ends]
    return np.array([0.5 * (more - less) for more, less in means])


@pytest.mark.parametrize("name", LIKELIHOODS)
def test_all_of_theta(name):
    likelihood = LIKELIHOODS[name]()
    leeway = whole(theta_of(likelihood))
    found = opened(likelihood, leeway)
    mean, C = by_the_book(likelihood, theta_of(likelihood))
    spread = differences(likelihood, leeway.ends)
    tolerance = {"rtol": 1e-5, "atol": 1e-6} if name == "sparse" else {"rtol": 1e-8}
    np.testing.assert_allclose(found.mean(Z, OF_Z), mean, **tolerance)
    expected = C + spread.T @ spread
    assert (np.diagonal(spread.T @ spread) > 0.01 * np.diagonal(C)).any()
    np.testing.assert_allclose(
        found.variance(Z, OF_Z), np.diagonal(expected), **tolerance
    )
    np.testing.assert_allclose(
        found.covariance(Z, OF_Z), expected, **tolerance | {"atol": 1e-6}
    )


def test_both_kinds_add_up():
    likelihood = dense()
    of_theta = whole(theta_of(likelihood))
    both = opened(likelihood, of_theta, OF_ROW).variance(Z, OF_Z)
    least = likelihood.posterior(theta_of(likelihood)).variance(Z, OF_Z)
    parts = [opened(likelihood, of).variance(Z, OF_Z) for of in (of_theta, OF_ROW)]
    np.testing.assert_allclose(both, sum(parts) - least, rtol=1e-10)


@pytest.mark.parametrize("include_noise", [False, True])
def test_leave_one_out(include_noise):
    likelihood = dense()
    theta, (X, tasks, y) = theta_of(likelihood), rows()
    leeway = whole(theta, 2)
    residual, variance = opened(likelihood, leeway).leave_one_out(include_noise)
    prior, i = likelihood.prior, 7
    others = np.delete(np.arange(len(y)), i)

    def left_out(theta):
        values = prior.values(theta)
        parts = prior.kernel_at(theta), prior.K_rho_at(theta), values.noise
        given = X[others], tasks[others], y[others], X[[i]], tasks[[i]]
        mean, C = textbook.posterior(*parts, *given, level=values.level)
        noise = float(np.ravel(values.noise)[0])
        return mean[0], C[0, 0] + noise * include_noise

    mean, expected = left_out(theta)
    for more, less in leeway.ends:
        expected += 0.25 * (left_out(more)[0] - left_out(less)[0]) ** 2
    assert residual[i] == pytest.approx(y[i] - mean)
    assert variance[i] == pytest.approx(expected)


def test_levels():
    likelihood = dense()
    leeway = whole(theta_of(likelihood))
    levels = [
        [likelihood.posterior(theta).levels for theta in pair] for pair in leeway.ends
    ]
    spread = np.square([0.5 * (more - less) for more, less in levels]).sum(axis=0)
    found = opened(likelihood, leeway)
    least = found.posterior.level_variances()
    np.testing.assert_allclose(found.level_variances(), least + spread)
    np.testing.assert_array_equal(opened(likelihood, OF_ROW).level_variances(), least)


@pytest.mark.parametrize("name", LIKELIHOODS)
def test_tasks_without_data(name):
    form = low_rank(N_TASKS, RANK, shared=True)
    build = {
        "dense": building.dense,
        "kronecker": building.kronecker,
        "sparse": lambda *of: building.sparse(*of, rows()[0][:6]),
    }[name]
    likelihood = build(RBF(1.0), form, *rows())
    theta = np.full(likelihood.prior.n_theta, 0.4)
    leeway, unseen = whole(theta, 2), np.full(len(Z), N_TASKS)
    found = widened(likelihood.posterior(theta), likelihood, (leeway,))
    means = [
        [likelihood.posterior(x).with_unseen(1).mean(Z, unseen) for x in pair]
        for pair in leeway.ends
    ]
    spread = np.square([0.5 * (more - less) for more, less in means]).sum(axis=0)
    larger = found.with_unseen(1)
    least = likelihood.posterior(theta).with_unseen(1).variance(Z, unseen)
    np.testing.assert_allclose(larger.variance(Z, unseen), least + spread)
    np.testing.assert_allclose(larger.variance(Z, OF_Z), found.variance(Z, OF_Z))


def test_nothing_is_computed_before_it_is_asked_for(monkeypatch):
    likelihood = dense()
    found = opened(likelihood, whole(theta_of(likelihood)))
    known = pickle.dumps(found)
    monkeypatch.setattr(type(likelihood), "posterior", None)
    found.mean(Z, OF_Z)
    monkeypatch.undo()
    variance = found.variance(Z, OF_Z)
    assert found.known
    assert pickle.dumps(found) == known
    np.testing.assert_array_equal(pickle.loads(known).variance(Z, OF_Z), variance)


def test_ends_keep_nothing_for_variances():
    likelihood = dense()
    found = opened(likelihood, whole(theta_of(likelihood), 1))
    found.variance(Z, OF_Z)
    [[more, _]] = found.known
    assert not hasattr(more, "cholesky")
    assert hasattr(found.posterior, "cholesky")


@pytest.mark.parametrize("own", [None, 0.7])
def test_a_task_joins(own):
    """At all ends it is the same sum of the others, and they are as they were."""
    likelihood = dense(low_rank(N_TASKS, RANK, diagonal=own is not None))
    prior, theta = likelihood.prior, theta_of(dense())
    theta = np.insert(theta, [-1] * 3, 0.3) if own is not None else theta
    sum_of = np.array([0.5, 0.0, -1.0])
    F = theta[prior.of_factor].reshape(N_TASKS, RANK)
    leeway, position = whole(theta), ROW
    border = [sum_of @ F], [own], position, None
    larger, _ = prior.bordered(theta, *border)
    known = [0, 2, 3]
    for end, of in zip(
        leeway.bordered(prior, theta, *border).ends.reshape(-1, larger.n_theta),
        leeway.ends.reshape(-1, prior.n_theta),
        strict=True,
    ):
        K_rho, before = larger.K_rho_at(end), prior.K_rho_at(of)
        np.testing.assert_allclose(K_rho[np.ix_(known, known)], before)
        of_F = of[prior.of_factor].reshape(N_TASKS, RANK)
        turned = F @ np.linalg.lstsq(F, of_F)[0]  # what F alone says of that end
        np.testing.assert_allclose(
            K_rho[position, known], sum_of @ turned @ of_F.T, atol=1e-10
        )
    assert OF_ROW.bordered(prior, theta, *border).task == ROW + 1
    border = *border[:2], ROW + 1, None
    assert OF_ROW.bordered(prior, theta, *border).task == ROW


class TestOfAll:
    """All variances are larger by a factor."""

    @pytest.mark.parametrize("leeway", [(), (OF_ROW,)])
    def test_variances(self, leeway):
        likelihood = dense()
        plain = opened(likelihood, *leeway)
        found = opened(likelihood, *leeway, OfAll(2.0))
        np.testing.assert_array_equal(found.mean(Z, OF_Z), plain.mean(Z, OF_Z))
        for name in ("variance", "covariance"):
            expected = 2.0 * getattr(plain, name)(Z, OF_Z)
            np.testing.assert_allclose(getattr(found, name)(Z, OF_Z), expected)
        levels = 2.0 * plain.level_variances()
        np.testing.assert_allclose(found.level_variances(), levels)
        residual, variance = plain.leave_one_out(include_noise=True)
        left_out = found.leave_one_out(include_noise=True)  # by which it was told
        np.testing.assert_array_equal(left_out, [residual, variance])

    def test_tasks_without_data(self):
        form = low_rank(N_TASKS, RANK, shared=True)
        likelihood = building.dense(RBF(1.0), form, *rows())
        theta, unseen = np.full(likelihood.prior.n_theta, 0.4), np.full(len(Z), N_TASKS)
        posterior = likelihood.posterior(theta)
        found = widened(posterior, likelihood, (OfAll(3.0),)).with_unseen(1)
        expected = 3.0 * posterior.with_unseen(1).variance(Z, unseen)
        np.testing.assert_allclose(found.variance(Z, unseen), expected)

    def test_it_can_be_pickled(self):
        found = opened(dense(), OfAll(2.0))
        again = pickle.loads(pickle.dumps(found))
        np.testing.assert_array_equal(again.variance(Z, OF_Z), found.variance(Z, OF_Z))
