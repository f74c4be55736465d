import pytest

pytest.importorskip("pinocchio")


@pytest.fixture(scope="session")
def puma():
    """Text of the URDF."""
    from skmtgp.datasets import puma560_urdf

    return puma560_urdf()


@pytest.fixture(scope="session")
def moved():
    """Loads carried so that all of their parameters show: states, torques, loads."""
    from skmtgp.datasets import make_puma560

    masses = [0.5, 1.0, 2.0, 3.0]
    made = make_puma560(n_samples=24, masses=masses, tool="moving", random_state=3)
    return made.data, made.target, made.loads
