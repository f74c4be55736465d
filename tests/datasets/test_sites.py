"""Simulated measurements at several sites."""

import numpy as np
import pytest

from skmtgp.datasets import make_sites


def test_rows_and_columns():
    X, y = make_sites((3, 2, 1, 0, 1))
    assert X.columns.tolist() == ["site", "hour"]
    assert X["site"].tolist() == ["north"] * 3 + ["east"] * 2 + ["south", "hill"]
    assert y.name == "value"
    assert X["hour"].between(0, 24).all()


def test_noise_is_what_is_asked():
    X, y, truth = make_sites((2000, 2000, 0, 0, 0), noise=0.3, return_truth=True)
    assert (y - truth(X)).std() == pytest.approx(0.3, rel=0.05)
    X, y, truth = make_sites(noise=0.0, return_truth=True)
    np.testing.assert_array_equal(y, truth(X))


def test_sites_have_one_course():
    X, y = make_sites((10, 0, 0, 0, 10), noise=0.0)
    course = np.sin(X["hour"] * 2 * np.pi / 24)
    expected = np.where(X["site"] == "north", 2 + course, 4 + 2 * course)
    np.testing.assert_allclose(y, expected)


def test_random_state():
    first, again, other = (make_sites(random_state=seed)[1] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


@pytest.mark.parametrize("n", [(1, 2), (1, 2, 3, 4, -1), (1, 2, 3, 4, 0.5)])
def test_numbers_of_rows(n):
    with pytest.raises(ValueError, match="must be five integers of 0 or more"):
        make_sites(n)


@pytest.mark.parametrize("noise", [-1.0, np.nan])
def test_negative_noise(noise):
    with pytest.raises(ValueError, match=f"noise={noise} must be 0 or more"):
        make_sites(noise=noise)
