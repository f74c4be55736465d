"""A simulated survey of metals in the soil."""

import numpy as np
import pandas as pd
import pytest

from skmtgp.datasets import make_soil

METALS = ["cadmium", "nickel", "zinc"]


def test_rows_and_columns():
    survey = make_soil(20, n_cadmium=5)
    assert survey.columns.tolist() == ["east", "north", *METALS]
    assert survey["cadmium"].notna().tolist() == [True] * 5 + [False] * 15
    assert survey[["nickel", "zinc"]].notna().all(axis=None)
    assert survey[["east", "north"]].stack().between(0, 5).all()


def test_truth_is_a_map():
    survey, truth = make_soil(20, n_cadmium=5, return_truth=True)
    assert truth.columns.tolist() == survey.columns.tolist()
    assert truth[["east", "north"]].iloc[[0, 1, 41]].to_numpy().tolist() == [
        [0.0, 0.0],
        [0.125, 0.0],
        [0.0, 0.125],
    ]
    assert len(truth) == 41**2
    assert (truth[METALS] > 0).all(axis=None)


def test_measurements_are_the_truth_and_an_error():
    """At the nearest point of the grid the truth is close, but for the error."""
    survey, truth = make_soil(300, noise=0.0, random_state=1, return_truth=True)
    nearest = np.round(survey[["north", "east"]] / 0.125).astype(int) @ [41, 1]
    apart = np.log(survey["nickel"] / truth["nickel"].to_numpy()[nearest])
    assert apart.std() < 0.15  # of a deviation of 0.45
    noisy = make_soil(300, noise=0.3, random_state=1)
    error = np.log(noisy[METALS] / survey[METALS]).stack()
    assert error.std() == pytest.approx(0.3, rel=0.1)


def test_random_state():
    first, again, other = (make_soil(5, n_cadmium=2, random_state=s) for s in (0, 0, 1))
    pd.testing.assert_frame_equal(first, again)
    assert not np.allclose(first["zinc"], other["zinc"])


def test_bad_arguments():
    with pytest.raises(ValueError, match="n_samples=0 is too small"):
        make_soil(0)
    with pytest.raises(ValueError, match="n_cadmium=60 is more than n_samples=50"):
        make_soil(50)
    with pytest.raises(ValueError, match=r"noise=-1.0 must be 0 or more"):
        make_soil(noise=-1.0)
