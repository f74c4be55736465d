"""The models, and what is noted of a fit."""

import time
from functools import partial

from sklearn.pipeline import Pipeline

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)

ALONE = {"LR": BayesianLinearRegression}
# One mean, one unit and one noise variance for all loads
PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
GAUSSIAN = {
    "sGP": SingleTaskGP,
    "iGP": partial(IndependentGP, **PAPER),
    "pGP": partial(PooledGP, noise="shared"),
    "mGP": partial(MultiTaskGPRegressor, **PAPER),
}
ATTRIBUTES = (
    "log_marginal_likelihood_value_",
    "n_hyperparameters_",
    "n_iter_",
    "n_evaluations_",
)


def make(name, max_iter=None, **options):
    """A model by its name, with the features and the kernel of the paper."""
    if name in ALONE:
        return make_inverse_dynamics_regressor(ALONE[name](**options))
    options |= {} if max_iter is None else {"max_iter": max_iter}
    return make_inverse_dynamics_regressor(GAUSSIAN[name](**options))


def make_search(ranks, max_iter=None):
    """The multi-task model at several ranks, all of which are kept."""
    options = {} if max_iter is None else {"max_iter": max_iter}
    model = GAUSSIAN["mGP"](**options)
    search = RankSearchIC(
        model, ranks=list(ranks), criterion="bic", keep_estimators=True
    )
    return make_inverse_dynamics_regressor(search)


def timed(function, *arguments):
    """What a function returns, and the seconds it took."""
    begin = time.perf_counter()
    result = function(*arguments)
    return result, time.perf_counter() - begin


def by_rank(search):
    """Each rank of a fitted search, and its model with the same features."""
    features, fitted = search[0], search[-1]
    ranks = fitted.results_["rank"].tolist()
    for rank, model in zip(ranks, fitted.estimators_, strict=True):
        yield rank, Pipeline([("features", features), ("regressor", model)])


def facts(model):
    """Likelihood, number of hyperparameters, iterations and evaluations of a fit."""
    found = {name: getattr(model[-1], name, None) for name in ATTRIBUTES}
    names = (name.removesuffix("_").removesuffix("_value") for name in found)
    return dict(zip(names, found.values(), strict=True))
