"""Whether the deviations of identified descriptors are those of their errors."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, TaskIdentifier
from skmtgp.identification import _population

pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.PrecisionWarning")
AGES = np.array([1.0, 2.0, 3.5, 5.0, 7.0, 9.0])
SIZES = np.array([1.2, 1.9, 1.0, 1.4, 1.7, 1.1])
PLAIN = {
    "normalize_y": False,
    "task_levels": False,
    "learning": "staged",
    "max_iter": 120,
}
RNG = np.random.default_rng(0)
TASK, STATES = np.arange(90) % len(AGES), RNG.uniform(0.0, 6.0, 90)


def fitted(noise, **options):
    """A model of two outputs that are linear in two descriptors."""
    age, size = AGES[TASK], SIZES[TASK]
    X = np.column_stack([STATES, age, size, TASK])
    first = (1.0 + 0.3 * age) * np.sin(STATES) + size * np.cos(STATES)
    Y = np.column_stack([first, size * np.sin(2.0 * STATES)])
    options = {"rank": 2, "task_descriptors": [1, 2]} | PLAIN | options
    model = MultiTaskGPRegressor(RBF(1.0), **options)
    return model.fit(X, Y + noise * RNG.standard_normal(Y.shape))


def draw(identifier, u, x, rng):
    """Samples as the identifier has them, with errors that carry over, of this u."""
    model = identifier.model
    outputs, _ = identifier._outputs(x[:, None], np.zeros((len(x), 2)))
    samples = []
    for output in outputs:
        c, A = output.row
        border, learned = output.border(), output.learned
        border.carry(learned.shares(u), learned.factor)
        covariance, _ = border._covariance(c + A @ u)
        mean = (c + A @ u) @ border.means
        samples.append(rng.multivariate_normal(mean, covariance, method="cholesky"))
    return model._units.centre.T + model._units.scale.T * np.transpose(samples)


@pytest.mark.parametrize(
    ("noise", "n"),
    [(0.1, 1), (0.0, 6)],
    ids=["noisy", "exact"],
)
@pytest.mark.long
def test_tasks_from_the_prior(noise, n):
    """What is drawn from the model is within two deviations as often as it must be.

    The share of 400 has a standard deviation of 0.015 where the two descriptors of each
    task go together, and their mean square one of 0.1. Three of these are allowed.
    """
    model = fitted(noise)
    rng, identifier = np.random.default_rng(n), TaskIdentifier(model)
    centre, scale = _population(model._descriptors, identifier.widening)
    z = []
    for _ in range(200):
        u, x = rng.standard_normal(2), rng.uniform(0.0, 6.0, n)
        y = draw(identifier, u, x, rng)
        mean, covariance = identifier.estimate(x[:, None], y)
        z.extend((mean - centre - scale @ u) / np.sqrt(np.diagonal(covariance)))
    assert np.mean(np.abs(z) < 2.0) == pytest.approx(0.954, abs=0.045)
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.3)


def one_descriptor(kernel):
    """A model of tasks whose functions are in proportion to their ages."""
    X = np.column_stack([STATES, AGES[TASK], TASK])
    options = {"rank": 1, "task_descriptors": [1]} | PLAIN
    model = MultiTaskGPRegressor(kernel, **options)
    return model.fit(X, AGES[TASK] * np.sin(STATES))


def relative_deviation(model, age, floor):
    """Deviation of the age, from a sample where the function is at its maximum."""
    x = np.array([0.5 * np.pi])
    mean, covariance = TaskIdentifier(model, floor=floor).estimate(
        x[:, None], age * np.sin(x)
    )
    assert mean.iloc[0] == pytest.approx(age, rel=5.0 * floor)
    return np.sqrt(covariance.iloc[0, 0]) / age


def test_the_floor_is_in_proportion_to_the_task():
    """Not to the average task: half of the error of a machine of half the age."""
    model = one_descriptor(RBF(1.0))
    found = [relative_deviation(model, age, 0.02) for age in (1.5, 3.0, 6.0, 12.0)]
    np.testing.assert_allclose(found, found[0], rtol=0.01)


@pytest.mark.parametrize("length_scale", [0.5, 1.0, 3.0])
def test_the_floor_is_relative_to_the_targets(length_scale):
    """Not to the prior, whose variance is large if the kernel is far too smooth."""
    model = one_descriptor(RBF(length_scale, length_scale_bounds="fixed"))
    targets = model.y_train_
    prior = np.diagonal(model.task_covariance_).mean()
    assert (prior > 10.0 * targets.var()) == (length_scale == 3.0)
    root_mean_square = np.sqrt(np.square(AGES).mean())
    expected = 0.02 * targets.std() / root_mean_square
    assert relative_deviation(model, 4.0, 0.02) == pytest.approx(expected, rel=0.01)
