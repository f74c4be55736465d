import pytest
from citizens import ESTIMATORS, FRAME, Y
from sklearn.base import clone


@pytest.fixture(params=ESTIMATORS.values(), ids=ESTIMATORS)
def estimator(request):
    return clone(request.param)


@pytest.fixture(scope="session", params=ESTIMATORS.values(), ids=ESTIMATORS)
def fitted(request):
    """Fitted to two outputs of tasks with names; not to be changed."""
    return clone(request.param).fit(FRAME, Y)


@pytest.fixture
def nothing_is_printed(capsys):
    yield
    assert capsys.readouterr() == ("", "")
