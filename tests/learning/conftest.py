import pytest
from drawn import FACTOR, draw


@pytest.fixture(scope="module")
def data():
    return draw(FACTOR @ FACTOR.T)
