import importlib.util
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from skmtgp.datasets import _store as store
from skmtgp.datasets import fetch_puma560, load_puma560
from skmtgp.datasets._puma560 import BUNDLED, bundled_path

RECIPE = Path(__file__).parents[2] / "datasets" / "puma560"
ROWS = {"train": 200, "interpolation": 180, "extrapolation": 340}


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("puma560_build", RECIPE / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def assert_values_agree(found, expected):
    # Mathematical libraries differ in the last digit from machine to machine.
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("subset", "n"), ROWS.items())
def test_rows_are_those_of_fetch(data_home, subset, n):
    found = load_puma560(subset=subset)
    expected = fetch_puma560(subset=subset, n_per_load=n, data_home=data_home)
    assert found.data.shape == (15 * n, 19)
    assert_values_agree(found.data, expected.data)
    assert_values_agree(found.target, expected.target)
    np.testing.assert_array_equal(found.data[:, -1], expected.data[:, -1])
    np.testing.assert_array_equal(found.trajectory, expected.trajectory)
    pd.testing.assert_frame_equal(found.loads, expected.loads, rtol=1e-12)
    assert found.keys() == expected.keys()
    assert found.feature_names == expected.feature_names
    assert found.target_names == expected.target_names
    assert found.DESCR == expected.DESCR


def test_the_bundled_file_is_what_the_script_makes(data_home, build):
    bundled, made = store.read(bundled_path(), BUNDLED), build.bundled_arrays(data_home)
    assert bundled.keys() == made.keys()
    for name, array in made.items():
        assert bundled[name].dtype == array.dtype
        if array.dtype == np.uint8:
            np.testing.assert_array_equal(bundled[name], array)
        else:
            assert_values_agree(bundled[name], array)


def test_the_script_writes_the_file(monkeypatch, tmp_path, build, capsys):
    arrays = {"x": np.arange(3)}
    monkeypatch.setattr(build, "bundled_arrays", lambda _: arrays)
    monkeypatch.setattr(sys, "argv", ["build.py", "--output", str(tmp_path / "a.npz")])
    build.main()
    assert store.read(tmp_path / "a.npz", BUNDLED)["x"].tolist() == [0, 1, 2]
    assert store.digest(arrays, BUNDLED) in capsys.readouterr().out


def test_the_bundled_file_is_small_and_has_the_cards_checksum():
    size = len(bundled_path().read_bytes())
    card = (RECIPE / "README.md").read_text(encoding="utf-8")
    assert size <= 2_000_000
    assert f"{size:,} bytes" in card
    assert store.digest(store.read(bundled_path(), BUNDLED), BUNDLED) in card


def test_no_pinocchio_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    X, y = load_puma560(return_X_y=True)
    assert X.shape == (3000, 19)
    assert y.shape == (3000, 6)


def test_smaller_sets_are_nested_and_loads_chosen():
    puma, few = load_puma560(), load_puma560(n_per_load=20, loads=["c5", 2])
    np.testing.assert_array_equal(few.data[:20], puma.data[800:820])
    np.testing.assert_array_equal(few.target[20:], puma.target[200:220])
    np.testing.assert_array_equal(few.trajectory[20:], puma.trajectory[200:220])


def test_subsets_are_disjoint():
    train, inner, outer = (
        {row.tobytes() for row in load_puma560(subset=subset).data} for subset in ROWS
    )
    assert train.isdisjoint(inner)
    assert train.isdisjoint(outer)


def test_frames():
    X, y = load_puma560(as_frame=True, return_X_y=True)
    assert X["load"].dtype == pd.CategoricalDtype([f"c{m}" for m in range(1, 16)])
    assert X.dtypes.iloc[:-1].eq(np.float64).all()
    assert y.columns.tolist() == [f"tau{j}" for j in range(1, 7)]
    puma = load_puma560(as_frame=True)
    assert puma.frame.shape == (3000, 25)
    assert puma.frame[puma.feature_names].equals(puma.data)


def test_results_can_be_changed_without_harm():
    puma = load_puma560(n_per_load=2)
    puma.data[:] = 0
    puma.feature_names.clear()
    again = load_puma560(n_per_load=2)
    assert (again.data != 0).any()
    assert len(again.feature_names) == 19


def test_more_rows_than_bundled_are_refused():
    message = (
        "n_per_load=201 is more than the 200 rows .*'train'.*fetch_puma560 has more"
    )
    with pytest.raises(ValueError, match=message):
        load_puma560(n_per_load=201)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"subset": "all"}, ValueError, "subset='all' is unknown"),
        ({"loads": ["p1"]}, ValueError, "loads holds 'p1', which is none of the loads"),
        ({"as_frame": None}, TypeError, "as_frame must be True or False, got None"),
    ],
)
def test_bad_arguments_are_named(options, error, message):
    with pytest.raises(error, match=message):
        load_puma560(**options)


def test_the_description_is_like_scikit_learns():
    description = load_puma560(n_per_load=1).DESCR
    assert description.startswith(".. _puma560_dataset:\n\n")
    for text in ("**Data Set Characteristics:**", "960,000", "not published", "N m"):
        assert text in description


class TestDescriptors:
    """Columns of the table of loads beside the states."""

    def test_they_come_before_the_load(self):
        puma = load_puma560(n_per_load=2, loads=[15, 3], descriptors=["mass", "mc_z"])
        assert puma.feature_names[-4:] == ["qdd6", "mass", "mc_z", "load"]
        expected = puma.loads.iloc[[14, 14, 2, 2]][["mass", "mc_z"]].to_numpy()
        np.testing.assert_array_equal(puma.data[:, -3:-1], expected)
        plain = load_puma560(n_per_load=2, loads=[15, 3])
        np.testing.assert_array_equal(np.delete(puma.data, [18, 19], 1), plain.data)

    def test_all_ten_in_a_frame(self):
        options = {"n_per_load": 2, "descriptors": "inertial", "as_frame": True}
        puma = load_puma560(loads=[2], **options)
        assert puma.data.columns.tolist() == puma.feature_names
        expected = puma.loads.loc["c2"].iloc[-10:]
        found = puma.data.iloc[0][expected.index].astype(float)
        np.testing.assert_array_equal(found, expected)

    @pytest.mark.parametrize("wrong", ["mass", ["weight"], ["mass", "I_zx"]])
    def test_unknown_ones(self, wrong):
        with pytest.raises(ValueError, match="must be 'inertial'"):
            load_puma560(descriptors=wrong)
