"""Downloads of the Kinova Gen3's recordings, from a server on this machine."""

import hashlib
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pandas as pd
import pytest

from skmtgp.datasets import _kinova_gen3 as kinova
from skmtgp.datasets import fetch_kinova_gen3

NAMES = "quadratic", "run", "repeated"


class Handler(SimpleHTTPRequestHandler):
    """Counts requests; answers may fail, or end too soon."""

    def do_GET(self):
        server = self.server
        server.asked.append(self.path)
        if server.failures:
            server.failures -= 1
            self.send_error(503)
        elif server.truncated:
            self.send_response(200)
            self.send_header("Content-Length", "1000000")
            self.end_headers()
            self.wfile.write(b"Time,Posi")
        else:
            super().do_GET()

    def log_message(self, *args):
        pass


def recording(seed, n=1201):
    """A made one, in the columns of the real ones."""
    time, j = np.arange(n) / 1000.0, np.arange(1, 8)
    phase = np.outer(time, 1.0 + 0.3 * j) + seed
    parts = {
        "Position": np.sin(phase),
        "Velocity": (1.0 + 0.3 * j) * np.cos(phase),
        "Torque": np.zeros_like(phase),
        "TorqueCur": 3.0 * np.sin(phase),
    }
    columns = {f"{k}{i + 1}": v[:, i] for k, v in parts.items() for i in range(7)}
    return pd.DataFrame({"Time": np.arange(n), **columns})


@pytest.fixture
def server(tmp_path, monkeypatch):
    """Of files as they are in the repository, with their checksums."""
    folder = tmp_path / "served"

    def put(path, text):
        file = folder / kinova.REVISION / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return kinova.Remote(path, hashlib.sha256(file.read_bytes()).hexdigest())

    remotes = {
        name: put(kinova.RECORDINGS[name].path, recording(k).to_csv(index=False))
        for k, name in enumerate(NAMES)
    }
    monkeypatch.setattr(kinova, "RECORDINGS", remotes)
    monkeypatch.setattr(kinova, "URDF", put(kinova.URDF.path, "<robot/>"))
    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), partial(Handler, directory=str(folder))
    )
    server.asked, server.failures, server.truncated = [], 0, False
    address = f"http://127.0.0.1:{server.server_port}"
    monkeypatch.setattr(kinova, "ADDRESS", address)
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def home(tmp_path):
    return tmp_path / "home"


def kept(home):
    return {p.name for p in home.rglob("*") if p.is_file()}


class TestData:
    def test_bunch(self, server, home):
        found = fetch_kinova_gen3(data_home=home, as_frame=True)
        assert found.data.shape == (3 * 81, 22)
        assert found.target.shape == (3 * 81, 7)
        assert list(found.frame) == [*found.feature_names, *found.target_names]
        assert found.feature_names[-1] == "load"
        assert (found.data["load"] == 1).all()
        assert list(pd.unique(found.recording)) == list(NAMES)
        assert found.time[:2] == pytest.approx([0.2, 0.21])
        assert "MIT" in found.DESCR
        assert found.urdf == "<robot/>"
        arrays = fetch_kinova_gen3(data_home=home)
        np.testing.assert_array_equal(arrays.data, found.data)
        np.testing.assert_array_equal(arrays.target, found.target)
        assert arrays.frame is None

    def test_columns_are_what_was_recorded(self, server, home):
        X, y = fetch_kinova_gen3(data_home=home, recordings=["run"], return_X_y=True)
        raw = recording(1).to_numpy()[200:1001:10]
        np.testing.assert_allclose(X[20:-20, :7], raw[20:-20, 1:8], atol=1e-3)
        np.testing.assert_allclose(X[20:-20, 7:14], raw[20:-20, 8:15], atol=1e-3)
        speed = 1.0 + 0.3 * np.arange(1, 8)
        expected = -(speed**2) * raw[:, 1:8]
        np.testing.assert_allclose(X[20:-20, 14:21], expected[20:-20], atol=2e-2)
        np.testing.assert_allclose(y[20:-20], 3.0 * raw[20:-20, 1:8], atol=1e-2)

    def test_order_and_rate(self, server, home):
        names = ["repeated", "quadratic"]
        found = fetch_kinova_gen3(data_home=home, recordings=names, rate=50.0)
        assert list(pd.unique(found.recording)) == names
        assert len(found.data) == 2 * 41


class TestDownload:
    def test_once(self, server, home):
        fetch_kinova_gen3(data_home=home)
        assert len(server.asked) == 4
        assert all(kinova.REVISION in path for path in server.asked)
        fetch_kinova_gen3(data_home=home)
        fetch_kinova_gen3(data_home=home, download_if_missing=False)
        assert len(server.asked) == 4

    def test_only_what_is_asked_for(self, server, home):
        fetch_kinova_gen3(data_home=home, recordings="run", return_X_y=True)
        assert kept(home) == {"RunTrajectory1.csv"}

    def test_may_not(self, server, home):
        with pytest.raises(OSError, match="Set download_if_missing=True, or save http"):
            fetch_kinova_gen3(data_home=home, download_if_missing=False)
        assert server.asked == []

    def test_a_damaged_file_is_downloaded_again(self, server, home):
        first = fetch_kinova_gen3(data_home=home)
        [path] = home.rglob("RunTrajectory1.csv")
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.warns(UserWarning, match="is damaged and is downloaded again"):
            again = fetch_kinova_gen3(data_home=home)
        np.testing.assert_array_equal(again.data, first.data)
        path.write_bytes(b"")
        with (
            pytest.warns(UserWarning, match="cannot be used"),
            pytest.raises(OSError, match="is not there"),
        ):
            fetch_kinova_gen3(data_home=home, download_if_missing=False)

    def test_another_file_leaves_nothing(self, server, home, monkeypatch):
        wrong = {k: of._replace(sha256="0" * 64) for k, of in kinova.RECORDINGS.items()}
        monkeypatch.setattr(kinova, "RECORDINGS", wrong)
        with pytest.raises(OSError, match=r"checksum .* not 0000"):
            fetch_kinova_gen3(data_home=home, n_retries=0)
        assert kept(home) == set()

    def test_an_address_that_answers_late(self, server, home):
        server.failures = 2
        with pytest.warns(UserWarning, match="did not answer") as caught:
            fetch_kinova_gen3(data_home=home, delay=0.0)
        assert len(caught) == 2

    def test_half_an_answer_is_none(self, server, home):
        server.truncated = True
        with pytest.raises(OSError, match="could not be downloaded"):
            fetch_kinova_gen3(data_home=home, n_retries=0)
        assert kept(home) == set()

    def test_no_network(self, server, home, monkeypatch):
        monkeypatch.setattr(kinova, "ADDRESS", "http://127.0.0.1:9")
        with (
            pytest.warns(UserWarning, match="Trying again"),
            pytest.raises(OSError, match="Where there is no network, save it as"),
        ):
            fetch_kinova_gen3(data_home=home, n_retries=1, delay=0.0)

    def test_a_folder_that_cannot_be_written(self, server, home, monkeypatch):
        from skmtgp.datasets import _store

        def full(*args):
            raise OSError("no space left")

        monkeypatch.setattr(_store.os, "replace", full)
        with pytest.warns(UserWarning, match="cannot be kept: no space left"):
            X, _ = fetch_kinova_gen3(data_home=home, recordings="run", return_X_y=True)
        assert X.shape == (81, 22)
        assert kept(home) == set()


@pytest.mark.parametrize(
    ("changed", "error", "match"),
    [
        ({"recordings": ["walk"]}, ValueError, "'walk'; there are 'quadratic'"),
        ({"recordings": []}, ValueError, "name each once"),
        ({"recordings": ["run", "run"]}, ValueError, "name each once"),
        ({"as_frame": 1}, TypeError, "as_frame"),
        ({"download_if_missing": "no"}, TypeError, "download_if_missing"),
        ({"n_retries": -1}, ValueError, "n_retries"),
        ({"rate": 5000.0}, ValueError, "rate=5000"),
        ({"cutoff": 0.0}, ValueError, "cutoff"),
    ],
)
def test_bad_arguments(server, home, changed, error, match):
    with pytest.raises(error, match=match):
        fetch_kinova_gen3(data_home=home, **changed)
