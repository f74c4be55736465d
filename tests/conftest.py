import pytest


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Tests have no examples in docstrings, and several files are called conftest."""
    collectors = yield
    return [each for each in collectors if type(each).__name__ != "DoctestModule"]


@pytest.fixture
def told(caplog):
    """Lines that fits have told since it was called last."""

    def lines():
        found = [of.getMessage() for of in caplog.records if of.name == "skmtgp"]
        caplog.clear()
        return found

    return lines
