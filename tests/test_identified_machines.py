"""Machines whose response grows with their age: streams, pipelines, odd samples."""

import numpy as np
import pytest
from scipy.special import logsumexp
from sklearn.gaussian_process.kernels import RBF

from skmtgp import MultiTaskGPRegressor, TaskIdentifier

AGE = np.array([1.0, 3.0, 6.0, 9.0])
MACHINE = np.repeat(np.arange(4), 20)
RNG = np.random.default_rng(0)
X = RNG.uniform(0.0, 6.0, 80)
Y = AGE[MACHINE] * np.sin(X) + 0.03 * RNG.standard_normal(80)
OPTIONS = {"kernel": RBF(1.0), "rank": 1, "task_levels": False, "max_iter": 30}
OPTIONS |= {"normalize_y": "shared", "noise": "shared", "learning": "staged"}


def fitted(labels=MACHINE, **options):
    """A model of them, with these labels."""
    model = MultiTaskGPRegressor(**OPTIONS, task_descriptors=[1], **options)
    return model.fit(np.column_stack([X, AGE[MACHINE], labels]), Y)


@pytest.fixture(scope="module")
def model():
    return fitted()


@pytest.mark.parametrize("switching", [0.0, 1.0])
def test_a_stream_that_never_or_always_switches(model, switching):
    """All samples count, or the last one alone, however little is left of a class."""
    identifier, rng = (
        TaskIdentifier(model, switching=switching),
        np.random.default_rng(1),
    )
    x, each = rng.uniform(0.0, 6.0, (4, 150, 1)), []
    for x_of_part, machine in zip(x, [3, 3, 1, 1], strict=True):
        y = AGE[machine] * np.sin(x_of_part[:, 0]) + 0.03 * rng.standard_normal(150)
        identifier.partial_fit(x_of_part, y)
        each.append(identifier._outputs(x_of_part, y)[0][0].each())
        assert np.isfinite(identifier.path_).all()
    np.testing.assert_allclose(identifier.path_.sum(axis=1), 1.0)
    told = each[-1][-1] if switching else np.concatenate(each).sum(axis=0)
    expected = np.exp(told - logsumexp(told))
    np.testing.assert_allclose(identifier.responsibilities_, expected, atol=1e-9)
