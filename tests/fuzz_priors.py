"""What the fuzz adds to the priors of its models: terms, trends, and known noise."""

import numpy as np
import pandas as pd
from fuzz_kernels import make_kernel
from sklearn.preprocessing import PolynomialFeatures


def pick(rng, options):
    return options[rng.integers(len(options))]


def has_noise(kernel):
    return "WhiteKernel" in repr(kernel)


def draw_terms(rng, problem, n_features):
    """Parameters of two or three terms, which dense or sparse inference takes."""
    n = int(rng.integers(2, 4))
    kernels = [make_kernel(rng, n_features) for _ in range(n)]
    ranks = [None, *range(1, problem.n_tasks + 1)]
    diagonals = [False, False, True, "equal"]
    of_terms = {
        "kernel": pick(rng, [kernels, tuple(kernels)]),
        "rank": [pick(rng, ranks) for _ in range(n)],
        "shared": [not rng.integers(3) for _ in range(n)],
        "diagonal": [pick(rng, diagonals) for _ in range(n)],
        "learning": "annealed",
        "n_restarts_optimizer": 0,
        "inducing_inputs": pick(rng, ["greedy", "k-means"]),
    }
    for name in ("rank", "shared", "diagonal"):
        if rng.integers(2):  # one value for all terms
            of_terms[name] = of_terms[name][0]
    if has_noise(kernels) or problem.complete:
        of_terms["inference"] = "auto"
    return of_terms


def draw_trend(rng, problem, *, per_task):
    """Parameters of a trend; rows may not tell its coefficients.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws it.
    problem : Problem
        Remembers the columns by the number of the feature, or that there is none such.
    per_task : bool
        Whether the model takes trends of each task.

    Returns
    -------
    params : dict
    """
    p = problem.features.shape[1]
    columns = rng.permutation(p)[: rng.integers(1, p + 1)].tolist()
    way = pick(rng, ["columns", "columns", "linear", "constant", "transformer"])
    names = [problem.name_of(j) for j in columns]
    trend = {"columns": names, "transformer": PolynomialFeatures(1)}.get(way, way)
    problem.trend = {
        "columns": lambda F: F[:, columns],
        "constant": lambda F: np.ones((len(F), 1)),
    }.get(way, lambda F: np.column_stack([np.ones(len(F)), F]))
    problem.doubtful = True
    params = {"trend": trend}
    if problem.complete:  # of which Kronecker inference takes none
        params["inference"] = pick(rng, ["auto", "dense"])
    return params | ({"trend_per_task": bool(rng.integers(2))} if per_task else {})


def draw_known(rng, problem, model):
    """Arguments of fit, None where the model must refuse them by name.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws them.
    problem : Problem
        Whose rows it is about.
    model : estimator
        A Gaussian process with these.

    Returns
    -------
    known : dict
    legal : bool
    """
    if problem.fault is not None:  # y may have any shape
        return {"alpha": 0.1}, True
    params, shape = model.get_params(), np.shape(problem.y)
    inference = params.get("inference", params.get("estimator__inference"))
    kernel = params.get("kernel", params.get("estimator__kernel"))
    n, largest = len(problem.codes), np.square(problem.y).max()
    size = max(np.var(problem.y), 1e-12 * largest, 1e-30)
    alpha = size * 10.0 ** rng.uniform(-6, 1) * rng.uniform(0.1, 1.0, shape)
    counts = rng.integers(1, 5, n)
    spread = np.where(counts.reshape(n, *[1] * (len(shape) - 1)) > 1, 0.3 * alpha, 0.0)
    way = pick(rng, ["alpha", "alpha", "weights", "repeats", "all", "wrong"])
    if way == "wrong":
        return pick(rng, [{"alpha": -alpha}, {"alpha": alpha[:-1]}, *NEVER]), False
    if way == "alpha" and rng.integers(4) == 0 and "noise_variance" in params:
        model.set_params(noise_variance=0, noise_variance_bounds="fixed")
    known = {
        "alpha": {"alpha": _formed(rng, alpha)},
        "weights": {"sample_weight": _formed(rng, counts)},
        "repeats": {"sample_weight": counts, "repeat_variance": spread},
        "all": {"alpha": alpha, "sample_weight": counts, "repeat_variance": spread},
    }[way]
    alone = inference == "sparse" and way == "weights"  # rows are repeated
    legal = inference in ("auto", "dense") or alone
    counted = way != "alpha" and not alone and np.max(known["sample_weight"]) > 1
    return known, legal and not (counted and has_noise(kernel))


NEVER = [
    {"alpha": "much"},
    {"alpha": np.nan},
    {"sample_weight": 0},
    {"sample_weight": -1.0},
    {"repeat_variance": 0.1},
    {"sample_weight": 1, "repeat_variance": 0.1},
]


def _formed(rng, values):
    """The values as a user may have them."""
    ways = [values, values.tolist(), pd.DataFrame(values), values.ravel()[0].item()]
    if values.ndim == 1:
        ways += [values[:, None], pd.Series(values), values.astype(object)]
    return ways[rng.integers(len(ways))]
