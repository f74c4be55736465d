import pytest

from skmtgp.datasets import fetch_puma560
from skmtgp.datasets._whole import stored_arrays


@pytest.fixture(scope="session")
def data_home(tmp_path_factory):
    """A data home that holds the whole data."""
    pytest.importorskip("pinocchio")
    folder = tmp_path_factory.mktemp("data_home")
    fetch_puma560(data_home=folder, n_per_load=1)
    return folder


@pytest.fixture(scope="session")
def whole(data_home):
    """The whole data as arrays; not to be changed."""
    arrays = stored_arrays(data_home, 0)
    for array in arrays.values():
        array.setflags(write=False)
    return arrays
