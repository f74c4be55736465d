import pytest


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Tests have no examples in docstrings, and several files are called conftest."""
    collectors = yield
    return [each for each in collectors if type(each).__name__ != "DoctestModule"]
