"""Results for fixed hyperparameters are those that were stored."""

import json

import numpy as np
import pytest
import reference

STORED = json.loads(reference.FILE.read_text())
MODELS = {name: rest for name, *rest in reference.models()}


def test_all_are_stored():
    assert STORED.keys() == MODELS.keys()


@pytest.mark.parametrize("name", MODELS)
def test_results_are_as_before(name):
    found = reference.results_of(*MODELS[name])
    for what, expected in STORED[name].items():
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            found[what], expected, rtol=1e-10, atol=1e-10 * scale, err_msg=what
        )
