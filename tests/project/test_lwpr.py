"""The comparator of the robots' benchmark learns as its papers say."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
lwpr = pytest.importorskip("lwpr")
sys.path.pop(0)


def test_a_plane_is_one_field():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (200, 3))
    y = 2.0 + X @ [1.0, -2.0, 0.5]
    settings = {"alpha": 0.0, "init_D": 0.1, "init_lambda": 1.0, "final_lambda": 1.0}
    model = lwpr.LWPR(**settings, add_threshold=0.99, n_epochs=20).fit(X, y)
    assert len(model.fields_) == 1
    assert model.fields_.of["n_directions"].tolist() == [3]
    new = rng.uniform(-1.0, 1.0, (50, 3))
    np.testing.assert_allclose(model.predict(new), 2.0 + new @ [1, -2, 0.5], atol=0.05)


def test_one_direction_is_that_of_partial_least_squares():
    """A field sees all: its first direction is X^T y, of centred rows."""
    rng = np.random.default_rng(1)
    X = rng.standard_normal((300, 4)) * [1.0, 2.0, 1.0, 1.0]
    y = X @ [1.0, 0.5, 0.0, -1.0] + 0.1 * rng.standard_normal(300)
    settings = {"init_lambda": 1.0, "final_lambda": 1.0, "n_epochs": 15}
    model = lwpr.LWPR(alpha=0.0, init_D=1e-8, **settings).fit(X, y)
    found = model.fields_.of["U"][0, 0]
    expected = (X - X.mean(axis=0)).T @ (y - y.mean())
    cosine = found @ expected / np.linalg.norm(found) / np.linalg.norm(expected)
    assert cosine > 0.9999


def test_fields_become_narrow_across_a_ridge():
    X, y, *_ = lwpr.cross_data(seed=0, n=200)
    y = np.exp(-50.0 * X[:, 1] ** 2)  # flat along the first input
    model = lwpr.LWPR(n_epochs=10, init_D=20.0).fit(X, y)
    M = model.fields_.of["M"]
    metric = np.diagonal(M.swapaxes(1, 2) @ M, axis1=1, axis2=2).mean(axis=0)
    assert metric[1] > 1.3 * metric[0]


@pytest.mark.long
def test_cross_function():
    X, y, grid, truth = lwpr.cross_data(seed=0)
    fixed = lwpr.LWPR(n_epochs=10, alpha=0.0).fit(X, y)
    learned = lwpr.LWPR(n_epochs=10).fit(X, y)
    assert lwpr.nmse(learned, grid, truth) < 0.06
    assert lwpr.nmse(learned, grid, truth) < 0.7 * lwpr.nmse(fixed, grid, truth)


def test_far_from_all_fields_it_predicts():
    X, y, *_ = lwpr.cross_data(seed=0, n=50)
    model = lwpr.LWPR(n_epochs=1).fit(X, y)
    assert np.isfinite(model.predict([[3.0, 3.0], [1e6, 0.0]])).all()
    assert model.predict([[1e6, 0.0]])[0] == pytest.approx(y.mean())
