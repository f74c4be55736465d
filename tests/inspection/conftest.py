import warnings

import matplotlib
import matplotlib.pyplot as plt
import pytest
from pictured import FRAME, MODELS, QUICK, X, Y, y
from sklearn.base import clone
from sklearn.compose import make_column_transformer
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import MultiTaskGPRegressor


@pytest.fixture(autouse=True)
def close_figures():
    """Drawn without a window, and closed."""
    matplotlib.use("Agg")
    yield
    plt.close("all")


@pytest.fixture(scope="session")
def fitted():
    """Every model, learned from both outputs of an array."""
    with pytest.warns(ConvergenceWarning):
        return {name: clone(model).fit(X, Y) for name, model in MODELS.items()}


@pytest.fixture(scope="session")
def piped():
    """A pipeline that moves the task column of a frame to the end."""
    scaled = make_column_transformer(
        (StandardScaler(), ["a", "b"]), remainder="passthrough"
    )
    model = make_pipeline(scaled, MultiTaskGPRegressor(rank=1, **QUICK))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # it may be done
        return model.fit(FRAME, y)
