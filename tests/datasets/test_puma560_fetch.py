import errno
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from skmtgp.datasets import _store as store
from skmtgp.datasets import _whole, fetch_puma560

# Table 1 of the paper: rows are paths, columns are speeds.
TABLE_1 = [[1, 7, 13, 14], [6, 12, None, 5], [11, 3, 4, 10], [2, 8, 9, 15]]


@pytest.fixture(scope="module")
def fetch(data_home):
    def fetch(**options):
        return fetch_puma560(data_home=data_home, **options)

    return fetch


@pytest.fixture(scope="module")
def subsets(fetch):
    names = ("train", "interpolation", "extrapolation")
    return {name: fetch(subset=name) for name in names}


def rows_of(puma, load):
    """Rows of a load as byte strings, which can be put into sets."""
    chosen = puma.data[puma.data[:, -1] == load]
    return [row.tobytes() for row in chosen]


def test_shapes_and_names(subsets):
    counts = {name: puma.data.shape for name, puma in subsets.items()}
    assert counts == {
        "train": (60_000, 19),
        "interpolation": (60_000, 19),
        "extrapolation": (900_000, 19),
    }
    puma = subsets["train"]
    assert puma.target.shape == (60_000, 6)
    assert puma.trajectory.shape == (60_000,)
    assert puma.data.dtype == puma.target.dtype == np.float64
    assert puma.feature_names[::6] == ["q1", "qd1", "qdd1", "load"]
    assert len(puma.feature_names) == 19
    assert puma.target_names == [f"tau{j}" for j in range(1, 7)]
    assert puma.loads.shape == (15, 21)
    assert puma.frame is None
    assert "Puma 560" in puma.DESCR


def test_loads_are_grouped_in_order(subsets):
    for puma in subsets.values():
        expected = np.repeat(np.arange(1, 16), len(puma.data) // 15)
        np.testing.assert_array_equal(puma.data[:, -1], expected)


def test_training_trajectories_are_those_of_table_1(subsets):
    for name in ("train", "interpolation"):
        puma = subsets[name]
        for p, row in enumerate(TABLE_1):
            for s, load in enumerate(row):
                if load is None:
                    continue
                labels = puma.trajectory[puma.data[:, -1] == load]
                found, counts = np.unique(labels, return_counts=True)
                assert found.tolist() == sorted(["p2s3", f"p{p + 1}s{s + 1}"])
                assert counts.tolist() == [2000, 2000]


def test_subsets_divide_the_samples(subsets):
    for load in (1, 6, 15):
        train, interpolation, extrapolation = (
            rows_of(puma, load) for puma in subsets.values()
        )
        assert len(train) == len(set(train)) == 4000
        assert len(interpolation) == len(set(interpolation)) == 4000
        assert len(extrapolation) == len(set(extrapolation)) == 60_000
        assert set(train).isdisjoint(extrapolation)
        assert set(interpolation) < set(extrapolation)
    labels = subsets["extrapolation"].trajectory[-60_000:]
    found, counts = np.unique(labels, return_counts=True)
    assert len(found) == 16
    assert dict(zip(found, counts, strict=True)) == {
        label: 2000 if label in ("p2s3", "p4s4") else 4000 for label in found
    }


@pytest.mark.parametrize("subset", ["train", "interpolation", "extrapolation"])
def test_rows_are_shuffled_and_smaller_sets_are_nested(fetch, subsets, subset):
    whole = subsets[subset]
    small, smaller = (fetch(subset=subset, n_per_load=n) for n in (50, 7))
    for load in range(1, 16):
        first = whole.data[:, -1] == load
        np.testing.assert_array_equal(
            small.data[small.data[:, -1] == load], whole.data[first][:50]
        )
        np.testing.assert_array_equal(
            smaller.target[smaller.data[:, -1] == load], whole.target[first][:7]
        )
    labels = small.trajectory[:50]
    assert len(set(labels)) == (16 if subset == "extrapolation" else 2) or (
        subset == "extrapolation" and len(set(labels)) > 10
    )
    assert (labels[1:] != labels[:-1]).sum() > 10


def test_loads_have_different_random_orders(fetch):
    puma = fetch(n_per_load=1)
    assert len({row.tobytes() for row in puma.data[:, :6]}) == 15


def test_torques_belong_to_their_rows(whole, subsets):
    puma = subsets["extrapolation"]
    q = {row.tobytes(): i for i, row in enumerate(whole["x"].reshape(-1, 18))}
    for row, torque in zip(puma.data[::9001], puma.target[::9001], strict=True):
        expected = whole["torque"].reshape(15, -1, 6)[int(row[-1]) - 1]
        np.testing.assert_array_equal(torque, expected[q[row[:-1].tobytes()]])


def test_chosen_loads_come_in_the_order_asked_for(fetch, subsets):
    puma = fetch(loads=["c12", 3], n_per_load=5)
    np.testing.assert_array_equal(puma.data[:, -1], [12] * 5 + [3] * 5)
    whole = subsets["train"]
    np.testing.assert_array_equal(puma.data[5:], whole.data[8000:8005])
    assert len(puma.loads) == 15


def test_frames(fetch):
    options = {"n_per_load": 3, "loads": [2, 1]}
    puma, plain = fetch(as_frame=True, **options), fetch(**options)
    assert puma.data["load"].tolist() == ["c2"] * 3 + ["c1"] * 3
    expected = [f"c{m}" for m in range(1, 16)]
    assert puma.data["load"].cat.categories.tolist() == expected
    assert puma.frame.columns.tolist() == puma.feature_names + puma.target_names
    np.testing.assert_array_equal(puma.data.iloc[:, :-1], plain.data[:, :-1])
    np.testing.assert_array_equal(puma.target, plain.target)
    X, y = fetch(as_frame=True, return_X_y=True, **options)
    assert X.equals(puma.data)
    assert y.equals(puma.target)


def test_pairs(fetch):
    X, y = fetch(n_per_load=3, return_X_y=True)
    assert X.shape == (45, 19)
    assert y.shape == (45, 6)


def test_torque_ranges_and_ranks(whole):
    torque = whole["torque"].reshape(15, -1, 6)
    low = [-33, -20, -1, -4, -2, -2]
    high = [29, 84, 36, 3, 5, 2]
    assert (torque.min(axis=(0, 1)) > low).all()
    assert (torque.max(axis=(0, 1)) < high).all()
    values = [np.linalg.svd(torque[..., j], compute_uv=False) for j in range(6)]
    assert [(v > 1e-11 * v[0]).sum() for v in values] == [4, 5, 5, 4, 4, 3]


def test_the_whole_data_is_kept_and_read_without_pinocchio(monkeypatch, data_home):
    monkeypatch.setattr(_whole, "generate", None)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert fetch_puma560(data_home=data_home, n_per_load=1).data.shape == (15, 19)
    files = list(data_home.iterdir())
    assert len(files) == 1
    assert files[0].stat().st_size < 56e6


def test_making_needs_pinocchio_and_says_so(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(ImportError, match=r'pip install "skmtgp\[puma\]"'):
        fetch_puma560(data_home=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_data_home_is_scikit_learns(monkeypatch, data_home):
    monkeypatch.setenv("SCIKIT_LEARN_DATA", str(data_home))
    monkeypatch.setattr(_whole, "generate", None)
    assert fetch_puma560(n_per_load=1).data.shape == (15, 19)


@pytest.fixture
def tiny(monkeypatch):
    """Replace the seconds of generating by a count of them."""
    seeds = []

    def generate(seed):
        seeds.append(seed)
        return {"x": np.full(3, seed)}

    monkeypatch.setattr(_whole, "generate", generate)
    monkeypatch.setattr(_whole, "SHAPES", {"x": (3,)})
    return seeds


def test_data_are_made_once_for_each_seed(tmp_path, tiny):
    for seed in (0, 1, 0, 1, 1):
        assert (_whole.stored_arrays(tmp_path, seed)["x"] == seed).all()
    assert tiny == [0, 1]


@pytest.mark.parametrize("damage", [lambda c: c[:-40], lambda c: c[:200] + c[201:]])
def test_damage_is_warned_about_and_mended(tmp_path, tiny, damage):
    expected = _whole.stored_arrays(tmp_path, 4)
    path = _whole.stored_path(tmp_path, 4)
    content = path.read_bytes()
    path.write_bytes(damage(content))
    with pytest.warns(UserWarning, match=r"seed4\.npz .* are made again"):
        mended = _whole.stored_arrays(tmp_path, 4)
    np.testing.assert_array_equal(mended["x"], expected["x"])
    assert path.read_bytes() == content
    assert tiny == [4, 4]


@pytest.mark.long
def test_a_damaged_whole_is_mended(tmp_path, data_home):
    path = _whole.stored_path(tmp_path, 0)
    content = bytearray(_whole.stored_path(data_home, 0).read_bytes())
    content[30_000_000] ^= 1
    path.write_bytes(content)
    with pytest.warns(UserWarning, match="made again"):
        found = fetch_puma560(data_home=tmp_path, n_per_load=9)
    expected = fetch_puma560(data_home=data_home, n_per_load=9)
    np.testing.assert_array_equal(found.target, expected.target)
    assert path.read_bytes() == _whole.stored_path(data_home, 0).read_bytes()


def test_shapes_are_those_of_what_is_made(whole):
    assert {name: array.shape for name, array in whole.items()} == _whole.SHAPES


WHAT = "the Puma 560 data, version 1, seed 4"
OLD = {"x": np.zeros(3), "sha256": np.array(64 * "0")}


@pytest.mark.parametrize(
    "put",
    [
        lambda path: _whole.stored_path(path.parent, 5).rename(path),
        lambda path: np.savez(path, **OLD),
        lambda path: store.write(path, {"x": np.zeros(4)}, WHAT),
        lambda path: store.write(path, {"y": np.zeros(3)}, WHAT),
        lambda path: path.write_bytes(b""),
    ],
    ids=["another seed", "older format", "another shape", "no array", "empty"],
)
def test_another_file_in_its_place_is_replaced(tmp_path, tiny, put):
    _whole.stored_arrays(tmp_path, 5)
    put(_whole.stored_path(tmp_path, 4))
    with pytest.warns(UserWarning, match=r"seed4\.npz .* are made again"):
        assert _whole.stored_arrays(tmp_path, 4)["x"].tolist() == [4, 4, 4]
    assert _whole.stored_arrays(tmp_path, 4)["x"].tolist() == [4, 4, 4]
    assert tiny == [5, 4]


NOT_KEPT = "were made, but cannot be kept: .* Pass another data_home, or they are made"


def test_a_directory_in_its_place_is_left_alone(tmp_path, tiny):
    _whole.stored_path(tmp_path, 0).mkdir()
    with pytest.warns(UserWarning, match=NOT_KEPT):
        assert _whole.stored_arrays(tmp_path, 0)["x"].tolist() == [0, 0, 0]
    assert [path.name for path in tmp_path.iterdir()] == ["puma560_v1_seed0.npz"]


def test_a_file_in_the_place_of_the_folder(tmp_path, tiny):
    (tmp_path / "home").touch()
    with pytest.warns(UserWarning, match=NOT_KEPT):
        assert _whole.stored_arrays(tmp_path / "home", 0)["x"].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("call", "number"),
    [("fsync", errno.ENOSPC), ("replace", errno.EACCES), ("open", errno.EROFS)],
)
def test_data_are_returned_where_they_cannot_be_kept(
    monkeypatch, tmp_path, tiny, call, number
):
    def refuse(name, *_):
        raise OSError(number, os.strerror(number), str(name))

    monkeypatch.setattr(store if call == "open" else os, call, refuse, raising=False)
    with pytest.warns(UserWarning, match=NOT_KEPT) as caught:
        assert _whole.stored_arrays(tmp_path, 0)["x"].tolist() == [0, 0, 0]
    assert os.strerror(number) in str(caught[0].message)
    assert list(tmp_path.iterdir()) == []


def test_the_warning_is_of_the_callers_line(tmp_path, tiny, monkeypatch):
    monkeypatch.setattr("skmtgp.datasets._puma560.select_rows", lambda *_: None)
    monkeypatch.setattr("skmtgp.datasets._puma560.package", lambda *_: "data")
    _whole.stored_path(tmp_path, 0).mkdir()
    with pytest.warns(UserWarning, match=NOT_KEPT) as caught:
        assert fetch_puma560(data_home=tmp_path) == "data"
    assert caught[0].filename == __file__


def test_what_a_killed_process_left_is_removed(tmp_path, tiny):
    for age, name in [(0.0, "live"), (2.0 * store.STALE, "killed")]:
        left = tmp_path / f".puma560_v1_seed0.npz.{name}.tmp"
        left.touch()
        os.utime(left, (time.time() - age,) * 2)
    _whole.stored_arrays(tmp_path, 0)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [".puma560_v1_seed0.npz.live.tmp", "puma560_v1_seed0.npz"]


def test_an_interrupted_fetch_is_made_again(monkeypatch, tmp_path, tiny):
    with monkeypatch.context() as patch:

        def broken(file, **_):
            file.write(b"PK half")
            raise KeyboardInterrupt("interrupted")

        patch.setattr(np, "savez", broken)
        with pytest.raises(KeyboardInterrupt, match="interrupted"):
            _whole.stored_arrays(tmp_path, 0)
    assert list(tmp_path.iterdir()) == []
    assert _whole.stored_arrays(tmp_path, 0)["x"].tolist() == [0, 0, 0]


FETCH = """
import sys
from skmtgp.datasets import _store as store
from skmtgp.datasets import fetch_puma560
puma = fetch_puma560(data_home=sys.argv[1], n_per_load=30)
print(store.digest({"x": puma.data, "y": puma.target}))
"""


@pytest.mark.long
def test_two_processes_at_once(tmp_path, fetch):
    command = [sys.executable, "-c", FETCH, tmp_path]
    runs = [
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)
    ]
    answers = [run.communicate()[0].strip() for run in runs]
    puma = fetch(n_per_load=30)
    assert answers == [store.digest({"x": puma.data, "y": puma.target})] * 2
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"subset": "test"},
            ValueError,
            "subset='test' is unknown; give one of .*'tra",
        ),
        ({"subset": None}, ValueError, "subset=None is unknown"),
        (
            {"n_per_load": 4001},
            ValueError,
            "n_per_load=4001 is more than the 4000 rows",
        ),
        ({"n_per_load": 0}, ValueError, "n_per_load=0 is too small"),
        (
            {"n_per_load": 20.0},
            TypeError,
            "n_per_load must be a whole number, got 20.0",
        ),
        ({"loads": [0]}, ValueError, r"loads holds 0, .* give whole numbers 1\.\.15"),
        ({"loads": ["c1", "c16"]}, ValueError, "loads holds 'c16', which is none"),
        ({"loads": [True]}, ValueError, "loads holds True"),
        ({"loads": "c3"}, TypeError, r"loads must be a list .* give \['c3'\]"),
        ({"loads": 3}, TypeError, r"loads must be a list of loads, got 3; give \[3\]"),
        ({"loads": []}, ValueError, r"loads=\[\] must hold at least one load"),
        (
            {"loads": [3, "c3"]},
            ValueError,
            r"loads=\[3, 'c3'\] must hold at least one load",
        ),
        (
            {"random_state": None},
            TypeError,
            "random_state must be a whole number, got N",
        ),
        ({"random_state": -1}, ValueError, "random_state=-1 must be between 0 and"),
        (
            {"return_X_y": "yes"},
            TypeError,
            "return_X_y must be True or False, got 'yes'",
        ),
    ],
)
def test_bad_arguments_are_named(tmp_path, options, error, message):
    with pytest.raises(error, match=message):
        fetch_puma560(data_home=tmp_path, **options)
    assert list(tmp_path.iterdir()) == []
