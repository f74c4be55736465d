"""The model at the end of pipelines and searches, and its rows."""

from sklearn import get_config
from sklearn.frozen import FrozenEstimator
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import has_fit_parameter


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


def name_in_fit(model, name):
    """How an argument is called in `fit`, for the model at the end of it.

    With metadata routing it has its own name, and the model must have requested it.
    """
    if has_fit_parameter(model, name) or get_config()["enable_metadata_routing"]:
        return name
    if isinstance(model, Pipeline):
        return f"{model.steps[-1][0]}__{name_in_fit(model[-1], name)}"
    if hasattr(model, "estimator"):  # a search
        return name_in_fit(model.estimator, name)
    raise TypeError(f"{type(model).__name__} takes no {name} in fit.")


def instead_of(model):
    """What to pass in place of a model that holds another one, as an error says it."""
    if hasattr(model, "best_estimator_"):
        return " Pass its best_estimator_."
    return " Pass its estimator." * isinstance(model, FrozenEstimator)
