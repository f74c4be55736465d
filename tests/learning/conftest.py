import pytest
from drawn import FACTOR, draw


@pytest.fixture(scope="module")
def data():
    return draw(FACTOR @ FACTOR.T)


@pytest.fixture(autouse=True, scope="module")
def length_of_chains():
    """Here they are as users have them."""
