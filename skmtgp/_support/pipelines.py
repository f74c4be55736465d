"""The model at the end of pipelines and searches, and its rows."""

from sklearn.frozen import FrozenEstimator
from sklearn.pipeline import Pipeline


def end_of(model):
    """The model at the end of pipelines, and what searches have found."""
    return at_the_end(model, None)[0]


def at_the_end(model, X):
    """The same, and X as it takes them; None stays None.

    A Pipeline has only the methods of scikit-learn, and with metadata routing it passes
    `return_std` on only if that was requested.
    """
    while True:
        if isinstance(model, Pipeline):
            if X is not None and len(model) > 1:
                X = model[:-1].transform(X)
            model = model[-1]
        elif hasattr(model, "best_estimator_"):
            model = model.best_estimator_
        elif isinstance(model, FrozenEstimator):
            model = model.estimator
        else:
            return model, X


def instead_of(model):
    """What to pass in place of a model that holds another one, as an error says it."""
    if hasattr(model, "best_estimator_"):
        return " Pass its best_estimator_."
    return " Pass its estimator." * isinstance(model, FrozenEstimator)
