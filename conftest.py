"""The examples in docstrings: some need an extra, some draw, two store data."""

import pytest

EXTRAS = {  # beginnings of the names of examples
    "skmtgp.inspection": "matplotlib",
    "skmtgp.datasets._kinova_gen3.fetch": "pandas",
    "skmtgp.datasets._make.make": "pinocchio",
    "skmtgp.datasets._puma560.fetch": "pinocchio",
    "skmtgp.datasets._robot.inverse": "pinocchio",
    "skmtgp.datasets._robot.link": "pinocchio",
    "skmtgp.robot": "pinocchio",
}


@pytest.fixture(autouse=True)
def extra_of_example(request):
    """Skip an example whose extra is not there, and leave nothing behind."""
    needed = [EXTRAS[name] for name in EXTRAS if request.node.name.startswith(name)]
    for module in needed:
        pytest.importorskip(module)
        request.getfixturevalue(f"with_{module}")


@pytest.fixture
def with_matplotlib(monkeypatch):
    """Draw without a window, and close the figures."""
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    monkeypatch.setattr(plt, "show", lambda: None)
    yield
    plt.close("all")


@pytest.fixture
def with_pandas(monkeypatch):
    """Nothing is downloaded: recordings of as many rows, of a robot that rests."""
    from skmtgp.datasets import _kinova_gen3

    names = [
        f"{k}{j}" for k in ("Position", "Velocity", "TorqueCur") for j in range(1, 8)
    ]
    rows = [",".join(names), *[",".join("0" * len(names))] * 1942]
    content = "\n".join(rows).encode()
    monkeypatch.setattr(_kinova_gen3, "_fetch", lambda *args: content)


@pytest.fixture
def with_pinocchio(monkeypatch, tmp_path):
    """Data that are made do not go where the user's are."""
    monkeypatch.setenv("SCIKIT_LEARN_DATA", str(tmp_path))
