"""What is uncertain of another task beside noise: errors that carry over, floors."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, TaskIdentifier
from skmtgp._estimators import carried
from skmtgp._estimators.carried import LEAST_SHARE, usual_variances
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.identification import _population
from skmtgp.learning import identifying
from skmtgp.learning.identifying import Unknown, identify

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
M, N = 6, 120
AGE = np.array([0.5, 4.0, 9.0, 6.0, 2.2, 7.7])
SIZE = np.array([1.2, 1.9, 1.0, 1.4, 1.7, 1.1])
OPTIONS = {"kernel": RBF(1.0), "rank": 2, "learning": "staged", "max_iter": 60}
OPTIONS |= {"normalize_y": "shared", "noise": "shared"}
RNG = np.random.default_rng(1)
TASK, STATES = np.arange(N) % M, RNG.uniform(0.0, 6.0, N)
NEW = np.array([0.4, 1.3, 2.0, 3.1, 4.4, 5.2])
ANOTHER = np.array([5.0, 1.5])


def f(x, age, size):
    """Two outputs that are linear in two descriptors."""
    first = (1.0 + 0.3 * age) * np.sin(x) + size * np.cos(x)
    return np.column_stack([first, size * np.sin(2.0 * x)])


def with_task(x, age, size, label):
    return np.column_stack([x, np.full((len(x), 3), [age, size, label])])


X = np.column_stack([STATES, AGE[TASK], SIZE[TASK], TASK])
Y = f(STATES, AGE[TASK], SIZE[TASK]) + 0.1 * RNG.standard_normal((N, 2))
Y_NEW = f(NEW, *ANOTHER) + 0.1 * RNG.standard_normal((len(NEW), 2))


FORMS = {
    "plain": {"task_levels": False},
    "levels, a diagonal": {"task_levels": True, "diagonal": "equal", "shared": True},
}


@pytest.fixture(scope="module", params=FORMS.values(), ids=FORMS)
def model(request):
    options = OPTIONS | {"task_descriptors": [1, 2]} | request.param
    return MultiTaskGPRegressor(**options).fit(X, Y)


@pytest.fixture(scope="module")
def undescribed():
    return MultiTaskGPRegressor(**OPTIONS).fit(X[:, [0, 3]], Y)


def test_errors_of_known_tasks_carry_over(model):
    """The row of another task is a sum of theirs, and so are its errors."""
    x = NEW[:, None]
    outputs, _ = TaskIdentifier(model)._outputs(x, Y_NEW)
    centre, scale = _population(model._descriptors, 2.0)
    Q, u = model._descriptors.Q, np.array([0.7, -1.1])
    of_u = model._descriptors.rows((centre + scale @ u)[None])[0]
    shares = np.linalg.lstsq(Q.T, of_u)[0]  # the smallest ones
    unknown = Unknown(outputs)
    unknown.carry(u)
    for output, border in zip(outputs, unknown.borders, strict=True):
        np.testing.assert_allclose(output.learned.shares(u), shares, rtol=1e-8)
        np.testing.assert_allclose(output.learned.factor, output.factor, rtol=1e-8)
        rows = zip(shares, output.factor, strict=True)
        plain = output.border()
        alone = [s**2 * (plain._covariance(row)[0] - plain.noise) for s, row in rows]
        np.testing.assert_allclose(border.carried, sum(alone), rtol=1e-6, atol=1e-12)
        row = output.row[0] + output.row[1] @ u
        whole, own = border._covariance(row)[0], plain._covariance(row)[0]
        np.testing.assert_allclose(whole, own + border.carried, rtol=1e-10)


def test_each_sample_has_the_mean_of_what_is_carried(model):
    """Descriptors are integrated out, by draws and by the book."""
    outputs, _ = TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)
    U, expected = np.random.default_rng(0).standard_normal((20_000, 2)), 0.0
    for output in outputs:
        shares = output.learned.centre + U @ output.learned.slopes.T
        squares = np.square(shares).mean(axis=0)
        found = output.learned.mean_squares(np.zeros(2), np.eye(2))
        np.testing.assert_allclose(found, squares, rtol=0.05)
        mean, variance = output._another(output.X)
        without = output._replace(learned=None)._another(output.X)
        np.testing.assert_array_equal(mean, without[0])
        border = output.border()
        border.carry(np.sqrt(found), output.learned.factor)
        expected = np.diagonal(border.carried)
        np.testing.assert_allclose(variance - without[1], expected, rtol=1e-6)


def test_far_from_the_known_tasks_little_is_certain(model):
    """What the model says does not grow so, nor does a fixed inflation."""
    ratios = []
    for factor in (1.0, 6.0):  # of the distance from the mean of the known tasks
        task = np.array([AGE.mean(), SIZE.mean()]) + factor * np.array([1.0, -0.2])
        y = f(NEW, *task)
        options = {"noise": 0.02, "widening": 10.0, "floor": 0.0}
        auto, plain = (
            TaskIdentifier(model, inflation=of, **options).estimate(NEW[:, None], y)[1]
            for of in ("auto", 1.0)
        )
        ratios.append(np.trace(auto) / np.trace(plain))
    assert ratios[1] > 1.02 * ratios[0] > 1.02


def test_the_floor_is_of_tasks_of_which_nothing_else_tells(
    model, undescribed, monkeypatch
):
    def errors(of, **options):
        output = TaskIdentifier(of, **options)._outputs(NEW[:, None], Y_NEW)[0][0]
        return output.error

    given = errors(model, floor=1e-4)
    assert given.shape == (M + 1,)
    assert np.ptp(given) == 0.0 < given[0]
    for of in (model, undescribed):  # known tasks, of what noisy rows leave open
        noisy, least = errors(of, inflation=1.0), errors(of, floor=1e-4)
        assert (noisy[:-1] > least[:-1]).all()
        assert noisy[-1] == least[-1]
    assert errors(model)[-1] == 0.0
    monkeypatch.setattr(carried, "_at_bound", lambda _: np.array([True]))
    monkeypatch.setattr(carried, "FLOORS", {})
    np.testing.assert_array_equal(errors(model, inflation=1.0), given)
    np.testing.assert_array_equal(errors(model), np.append(given[:-1], 0.0))
    without = errors(undescribed)
    np.testing.assert_array_equal(without, errors(undescribed, floor=1e-4))
    with pytest.raises(ValueError, match="floor"):
        errors(model, floor="none")


def test_leverages_of_tasks(model):
    """Those of a regression on the descriptors; a task that joined had no part."""
    D = np.column_stack([np.ones(M), AGE, SIZE])
    h = np.diagonal(D @ np.linalg.pinv(D))
    np.testing.assert_allclose(usual_variances(model._descriptors), 1.0 - h, rtol=1e-8)
    joined = model.add_task(with_task(NEW, *ANOTHER, -1), Y_NEW)  # comes first
    new = np.array([1.0, *ANOTHER])
    of_new = new @ np.linalg.solve(D.T @ D, new)
    expected = np.append(1.0 + of_new, 1.0 - h)
    np.testing.assert_allclose(
        usual_variances(joined._descriptors), expected, rtol=1e-8
    )
    assert TaskIdentifier(joined).estimate(NEW[:, None], Y_NEW)[0].shape == (2,)


def test_what_is_carried_is_the_mean_over_descriptors_that_are_not_known(model):
    """Variances are quadratic in u: the mean is that over pairs of points around it."""
    unknown = Unknown(TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)[0])
    u, root = np.array([0.7, -1.1]), np.array([[0.5, 0.0], [-0.3, 0.2]])
    points = [u + s * np.sqrt(2.0) * r for r in root.T for s in (-1.0, 1.0)]

    def covariances(at, *what):
        unknown.carry(*what)
        pairs = zip(unknown.borders, unknown.maps, strict=True)
        return np.array([border._covariance(c + A @ at)[0] for border, (c, A) in pairs])

    expected = np.mean([covariances(point, point) for point in points], axis=0)
    found = covariances(u, u, root)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-10)
    assert (np.abs(found - covariances(u, u)).max(axis=(1, 2)) > 1e-4).all()


def exact(**options):
    """A model of targets without noise, whose variance ends at its lower bound."""
    options = {"noise_variance_bounds": (1e-3, 1.0)} | OPTIONS | options
    options |= {"task_descriptors": [1, 2], "task_levels": False}
    return MultiTaskGPRegressor(**options).fit(X, f(STATES, AGE[TASK], SIZE[TASK]))


def noises(model, inflation="auto"):
    """Of each output: the variance of known tasks, and of another, in its units."""
    identifier = TaskIdentifier(model, inflation=inflation)
    outputs, _ = identifier._outputs(NEW[:, None], f(NEW, *ANOTHER))
    return np.array([of.noise[[0, -1]] for of in outputs]).T


def test_another_task_has_the_noise_that_residuals_show():
    """Those of the fit, where the variance could not be as small as they are."""
    model = exact()
    known, of_another = noises(model)
    np.testing.assert_allclose(*noises(model, inflation=1.0))
    for j, share in enumerate(of_another / known):
        posterior, likelihood = model._posteriors[j], model._likelihoods[j]
        K = likelihood.prior.covariance(posterior.theta, likelihood.X, likelihood.tasks)
        inverse = np.linalg.inv(K + known[j] * np.eye(N))
        alpha = inverse @ likelihood.y
        shown = alpha @ alpha / np.trace(inverse)  # residuals are noise times alpha
        assert share == pytest.approx(np.clip(shown, LEAST_SHARE, 1.0), rel=1e-4)
        assert share < 0.9


def test_noise_that_is_known_or_told_stays(model):
    for of in (exact(noise_variance=1e-6, noise_variance_bounds="fixed"), model):
        np.testing.assert_allclose(*noises(of))


class Singular(Unknown):
    """Samples whose covariance cannot be factorised with so little noise."""

    least = np.inf

    def __init__(self, outputs):
        super().__init__(outputs)
        self.is_singular = all(of.noise[-1] < self.least for of in outputs)

    def value_and_grad(self, u):
        if self.is_singular:
            return -np.inf, np.full(len(u), np.nan)
        return super().value_and_grad(u)


def test_samples_whose_covariance_is_singular(model, monkeypatch):
    monkeypatch.setattr(identifying, "Unknown", Singular)
    with pytest.raises(NotPositiveDefiniteError, match="Give their noise, a larger"):
        TaskIdentifier(model).estimate(NEW[:, None], Y_NEW)


@pytest.mark.parametrize("factor", [10, 100])
def test_more_noise_where_the_covariance_is_singular_without(
    model, monkeypatch, factor
):
    outputs, starts = TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)
    expected, _ = identify([of.noisier(factor) for of in outputs], starts)
    least = 0.5 * factor * max(of.noise[-1] for of in outputs)
    monkeypatch.setattr(Singular, "least", least)
    monkeypatch.setattr(identifying, "Unknown", Singular)
    with pytest.warns(JitterWarning, match=f" {factor} times the noise"):
        found, noisier = identify(outputs, starts)
    np.testing.assert_array_equal(found.u, expected.u)
    for of, given in zip(noisier, outputs, strict=True):
        np.testing.assert_allclose(of.noise, factor * given.noise)
