import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from skmtgp.datasets import _store as store


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    return {"x": rng.normal(size=(5, 3)), "labels": np.arange(4, dtype=np.uint8)}


@pytest.fixture
def path(tmp_path, arrays):
    store.write(tmp_path / "folder" / "file.npz", arrays)
    return tmp_path / "folder" / "file.npz"


def same(first, second):
    return first.keys() == second.keys() and all(
        first[k].dtype == second[k].dtype and np.array_equal(first[k], second[k])
        for k in first
    )


@pytest.mark.parametrize("compress", [False, True])
def test_what_is_written_is_read(tmp_path, arrays, compress):
    store.write(tmp_path / "a.npz", arrays, compress=compress)
    assert same(store.read(tmp_path / "a.npz"), arrays)


def test_writing_is_deterministic(tmp_path, path, arrays):
    store.write(tmp_path / "again.npz", arrays)
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_the_file_is_an_ordinary_npz_that_others_may_read(path, arrays):
    with np.load(path) as archive:
        np.testing.assert_array_equal(archive["x"], arrays["x"])
    probe = path.with_name("probe")
    probe.touch()
    assert path.stat().st_mode == probe.stat().st_mode


def test_a_changed_byte_is_noticed_wherever_it_matters(path, arrays):
    content = path.read_bytes()
    noticed = 0
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 0x5A
        path.write_bytes(damaged)
        try:
            # Some bytes, such as a date, mean nothing to the arrays.
            assert same(store.read(path), arrays)
        except store.DamagedFileError:
            noticed += 1
    assert noticed > 0.5 * len(content)


def test_a_short_file_is_noticed(path):
    content = path.read_bytes()
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        with pytest.raises(store.DamagedFileError, match=r"file.npz"):
            store.read(path)


def comment_of(path):
    with zipfile.ZipFile(path) as archive:
        return archive.comment


def with_comment(path, comment):
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = comment


def test_the_checksum_is_not_among_the_arrays(path, arrays):
    with np.load(path) as archive:
        assert sorted(archive.files) == sorted(arrays)
    assert comment_of(path).decode().endswith(store.digest(arrays))


@pytest.mark.parametrize(
    "change",
    [
        {"x": np.zeros((5, 3))},
        {"x": np.random.default_rng(0).normal(size=(5, 3)) + 1e-15},
        {"labels": np.arange(4, dtype=np.int8)},
        {"labels": np.arange(4, dtype=np.uint8).reshape(2, 2)},
        {"more": np.zeros(1)},
    ],
    ids=["values", "last digits", "type", "shape", "another array"],
)
def test_other_arrays_with_the_checksum_are_noticed(path, arrays, change):
    comment = comment_of(path)
    np.savez(path, **arrays | change)
    with_comment(path, comment)
    with pytest.raises(store.DamagedFileError, match="does not have the checksum"):
        store.read(path)


def test_an_array_less_is_noticed(path, arrays):
    comment = comment_of(path)
    np.savez(path, x=arrays["x"])
    with_comment(path, comment)
    with pytest.raises(store.DamagedFileError, match="does not have the checksum"):
        store.read(path)


def test_a_file_of_other_data_is_noticed(tmp_path, arrays):
    store.write(tmp_path / "a.npz", arrays, "seed 1")
    assert same(store.read(tmp_path / "a.npz", "seed 1"), arrays)
    with pytest.raises(store.DamagedFileError, match=r"the checksum of seed 0: it is"):
        store.read(tmp_path / "a.npz", "seed 0")


def test_a_file_of_another_format_is_noticed(monkeypatch, path):
    monkeypatch.setattr(store, "FORMAT", "skmtgp.datasets 3")
    with pytest.raises(store.DamagedFileError, match="or of another version"):
        store.read(path)


def test_a_file_without_a_checksum_is_noticed(path, arrays):
    np.savez(path, **arrays)
    with pytest.raises(store.DamagedFileError, match="does not have the checksum"):
        store.read(path)


@pytest.mark.parametrize(
    "shapes", [{"x": (5, 3)}, {"x": (5, 3), "labels": (5,)}, {"y": (5, 3)}]
)
def test_other_shapes_than_expected_are_named(path, shapes):
    with pytest.raises(store.DamagedFileError, match=r"'labels': \(4,\)}, not {'"):
        store.read(path, shapes=shapes)
    assert store.read(path, shapes={"x": (5, 3), "labels": (4,)})


def test_a_missing_file_is_no_damaged_one(tmp_path):
    with pytest.raises(FileNotFoundError):
        store.read(tmp_path / "none.npz")


def test_a_full_disk_leaves_the_old_file(path, arrays):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            store.write(path, {"x": np.zeros(10_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [file.name for file in path.parent.iterdir()] == ["file.npz"]
    assert same(store.read(path), arrays)


def test_temporary_files_are_removed_once_nobody_can_be_writing_them(path):
    names = ".file.npz.0a.tmp", ".file.npz.0b.tmp", ".other.npz.0c.tmp"
    old, new, other = (path.with_name(name) for name in names)
    for file in (old, new, other):
        file.write_bytes(b"half of it")
    for file in (old, other):
        os.utime(file, (time.time() - 1.1 * store.STALE,) * 2)
    os.utime(new, (time.time() - 0.9 * store.STALE,) * 2)
    store.remove_stale(path)
    assert not old.exists()
    assert new.exists()
    assert other.exists()
    assert path.exists()


def test_a_temporary_file_that_cannot_be_removed_stays(monkeypatch, path):
    temporary = path.with_name(".file.npz.0a.tmp")
    temporary.touch()
    os.utime(temporary, (0, 0))

    def refuse(*_):
        raise PermissionError("open elsewhere")

    monkeypatch.setattr(type(path), "unlink", refuse)
    store.remove_stale(path)
    assert temporary.exists()


def test_there_may_be_no_folder_to_remove_from(tmp_path):
    store.remove_stale(tmp_path / "none" / "file.npz")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, MemoryError])
def test_an_interruption_leaves_the_old_file_or_none(monkeypatch, path, arrays, error):
    def broken(file, **_):
        file.write(b"half of it")
        raise error("interrupted")

    monkeypatch.setattr(np, "savez", broken)
    for target in (path, path.with_name("new.npz")):
        with pytest.raises(error, match="interrupted"):
            store.write(target, arrays | {"x": np.zeros(2)})
    assert [file.name for file in path.parent.iterdir()] == ["file.npz"]
    assert same(store.read(path), arrays)


def test_an_interruption_before_the_move_leaves_nothing(monkeypatch, tmp_path, arrays):
    def broken(*_):
        raise KeyboardInterrupt("interrupted")

    monkeypatch.setattr(store.os, "replace", broken)
    with pytest.raises(KeyboardInterrupt, match="interrupted"):
        store.write(tmp_path / "a.npz", arrays)
    assert list(tmp_path.iterdir()) == []


# In processes of their own the module is imported alone, which takes less time.
FOLDER = str(Path(store.__file__).parent)
KILLED = """
import os, sys
import numpy as np
sys.path.insert(0, sys.argv[2])
import _store as store
def half(file, **_):
    file.write(b"half of it")
    file.flush()
    os._exit(7)
np.savez = half
store.write(sys.argv[1], {"x": np.zeros(3)})
"""


def test_a_killed_process_leaves_the_old_file(path, arrays):
    done = subprocess.run([sys.executable, "-c", KILLED, path, FOLDER], check=False)
    assert done.returncode == 7
    assert same(store.read(path), arrays)
    store.write(path, {"x": np.ones(1)})
    assert store.read(path)["x"].tolist() == [1.0]


WRITER = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[3])
import _store as store
for _ in range(40):
    store.write(sys.argv[1], {"x": np.full(20000, float(sys.argv[2]))})
"""


def test_two_writers_and_a_reader_get_along(tmp_path):
    path = tmp_path / "shared.npz"
    store.write(path, {"x": np.full(20000, 1.0)})
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, path, value, FOLDER])
        for value in ("1", "2")
    ]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        seen |= set(np.unique(store.read(path)["x"]))
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen == {1.0, 2.0}
    assert [file.name for file in tmp_path.iterdir()] == ["shared.npz"]
