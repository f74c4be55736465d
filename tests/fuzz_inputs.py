"""What the fuzz draws: tables, their faults, and estimators."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import pandas as pd
from fuzz_kernels import Parabola, make_kernel, wrong_kernels
from fuzz_priors import draw_known, draw_terms, draw_trend, has_noise, pick
from scipy.sparse import csr_array
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MinMaxScaler

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)


class Site(str, Enum):  # noqa: UP042 - numpy would keep "Site."
    """Labels whose text is the value, not what print shows."""

    NORTH, SOUTH, EAST, WEST, HILL, LAKE, ROAD, WOOD, PLAIN = "NSEWHLRD-"


LABELS = {
    "int": np.arange(9) * 7 - 3,
    "numbers as text": np.array(["10", "9", "-1", "1e3", "0", "007", "7", "2.5", "x"]),
    "text": np.array(["b", "", "é", "a b", "B", "None", "nan", "z" * 40, "task"]),
    "enum": np.array(list(Site), dtype=object),
    "large": np.array([2**53 + k for k in range(-2, 7)], dtype=object),
    "larger": np.array([2**63 - k for k in range(1, 10)], dtype=object),
}


@dataclass
class Problem:
    """A table, its targets and where they come from.

    Attributes
    ----------
    features, codes, labels, y : ndarrays
        Numbers, the task of each row as a number and as a label, targets.
    names : ndarray
        Labels of the tasks; the last one is of no row.
    position : int
        Of the task column.
    container : str
        What X is.
    X : array-like
        What fit gets.
    fault : str or None
        What is wrong with X or y.
    wrong : str or None
        What every fit must refuse, by name.
    random : bool
        Whether fit may differ from time to time.
    descriptor : int or None
        Which feature describes the tasks, if one does.
    complete : bool
        Whether nearly all tasks were observed at the same inputs.
    known : dict
        Other arguments of fit.
    trend : callable or None
        Columns of the trend of some features.
    doubtful : bool
        Whether fit may refuse the data, but need not.
    """

    features: np.ndarray
    codes: np.ndarray
    names: np.ndarray
    y: np.ndarray
    position: int
    container: str
    X: object = None
    new: object = None
    fault: str = None
    wrong: str = None
    random: bool = field(default=False)
    descriptor: int = None
    complete: bool = False
    known: dict = field(default_factory=dict)
    trend: object = None
    doubtful: bool = False

    def __post_init__(self):
        self.labels = self.names[self.codes]
        self.n_tasks = len(np.unique(self.codes))
        self.X = self.table(self.features, self.labels)
        half = slice(None, None, 2)
        moved = self.features[half] + 0.1 * self.features.std(axis=0)
        if self.descriptor is not None:
            moved[:, self.descriptor] = self.features[half, self.descriptor]
        self.new = self.table(moved, self.labels[half])

    def table(self, features, labels):
        """X as the user has it."""
        width = features.shape[1] + 1
        table = np.empty((len(features), width), dtype=object)
        table[:, np.arange(width) != self.position] = features
        table[:, self.position] = labels
        if self.container == "array" and "O" not in (features.dtype, labels.dtype):
            return table.astype(float)
        if self.container == "frame":
            columns = [f"c{j}" for j in range(width)]
            return pd.DataFrame(table, columns=columns).infer_objects()
        return table.tolist() if self.container == "list" else table

    def task_feature(self, rng):
        """A way to say where the tasks are."""
        width = self.features.shape[1] + 1
        ways = [self.position, self.position - width]
        if self.container == "frame":
            ways.append(f"c{self.position}")
        return pick(rng, ways)

    def name_of(self, feature):
        """What a feature is called in X."""
        column = feature + (feature >= self.position)
        return f"c{column}" if self.container == "frame" else column

    def novel(self, rng):
        """X and y of a new task, and whether they can be added."""
        n = int(rng.integers(1, 4))
        label = self.names[[-1]] if rng.integers(4) else self.labels[:1]
        rows = rng.integers(len(self.y), size=n)
        features = self.features[rows]
        if self.descriptor is not None:
            features[:, self.descriptor] = features[0, self.descriptor]
        table = self.table(features, np.repeat(label, n))
        return table, self.y[rows], label[0] == self.names[-1]

    def bad_new(self, rng):
        """Tables that cannot be predicted."""
        nothing = np.empty((0, self.features.shape[1] + 1))
        wide = self.table(np.column_stack([self.features] * 2), self.labels)
        unknown = self.table(self.features, np.repeat(self.names[-1:], len(self.y)))
        wild = self.features * np.nan
        return [nothing, wide, unknown, self.table(wild, self.labels), None, "X", 3.0]


def make_problem(rng):
    """Data of 1 to 8 tasks, 1 to 40 rows and 1 to 4 features, often with a fault."""
    way = pick(rng, ["any"] * 6 + ["complete", "described"])
    features, codes = make_design(rng) if way == "complete" else make_rows(rng)
    descriptor = None
    if way == "described":
        descriptor = features.shape[1]
        features = np.column_stack([features, rng.normal(size=9)[codes]])
    container = pick(rng, ["array", "array", "object", "list", "frame"])
    kinds = ["int"] if container == "array" else list(LABELS)
    names = rng.permutation(LABELS[pick(rng, kinds)])
    y = make_targets(rng, features, codes)
    position = int(rng.integers(features.shape[1] + 1))
    more = {"descriptor": descriptor, "complete": way == "complete"}
    problem = Problem(features, codes, names, y, position, container, **more)
    return spoil(rng, problem) if rng.integers(4) == 0 else problem


def make_rows(rng):
    """Features and tasks in no order."""
    n_tasks, n, p = (int(rng.integers(1, most + 1)) for most in (8, 40, 4))
    return make_features(rng, n, p), rng.integers(n_tasks, size=n)


def make_design(rng):
    """Features and tasks of complete data, of which up to a tenth is missing."""
    n_tasks, n_inputs, p = (int(rng.integers(2, most)) for most in (5, 9, 4))
    cells = rng.permutation(n_tasks * n_inputs)
    cells = cells[: len(cells) - rng.integers(len(cells) // 10 + 1)]
    rows, codes = np.divmod(cells, n_tasks)
    return rng.normal(size=(n_inputs, p))[rows], codes


def make_features(rng, n, p):
    F = rng.normal(size=(n, p))
    if rng.integers(3) == 0:  # the same inputs for several rows
        F = F[rng.integers(max(1, n // 2), size=n)]
    for j in range(p):
        way = rng.integers(8)
        if way == 0:
            F[:, j] = rng.normal()
        elif way == 1:
            F[:, j] = 3.0 * F[:, 0]
        elif way == 2:
            F[:, j] = F[:, j].round()
        if way in (3, 4):
            F[:, j] = F[:, j] * 10.0 ** rng.uniform(-9, 9) + rng.choice([0.0, 1e3])
        elif way == 5 and rng.integers(2):  # seconds since 1970, far apart or close
            F[:, j] = 1.7e9 + np.round(F[:, j] * 10.0 ** rng.uniform(0, 8))
    return F


def make_targets(rng, features, codes):
    """Targets of one or several outputs, some constant, some of wild scale."""
    n_outputs = pick(rng, [None, None, 1, 2])
    slopes = rng.normal(size=(9, n_outputs or 1))
    x = features[:, :1] / (features[:, :1].std() or 1.0)
    y = slopes[codes] * np.sin(x) + rng.choice([0.0, 1e-6, 0.1, 1.0]) * rng.normal(
        size=(len(codes), n_outputs or 1)
    )
    y = y * rng.choice([0.0, 1.0, 1.0, 1.0, 10.0 ** rng.uniform(-9, 9)])
    y = y + rng.choice([0.0, 0.0, 0.1, 1e4])
    return y if n_outputs else y[:, 0]


def spoil(rng, problem):
    """The same with one fault."""
    name = pick(rng, list(FAULTS))
    features, y = problem.features.copy(), problem.y.copy()
    if name in VALUES:
        target = features if rng.integers(2) else y
        target[rng.integers(len(y))] = VALUES[name]
        problem.X, problem.y = problem.table(features, problem.labels), y
        problem.fault = name
        return problem
    problem.X, problem.y = FAULTS[name](problem)
    problem.fault = name
    return problem


VALUES = {"NaN": np.nan, "infinity": np.inf, "1e300": 1e300, "-1e308": -1e308}
FAULTS = dict.fromkeys(VALUES) | {
    "short y": lambda p: (p.X, np.append(p.y, p.y, axis=0)),
    "no y": lambda p: (p.X, None),
    "text for y": lambda p: (p.X, ["text"] * len(p.y)),
    "complex y": lambda p: (p.X, p.y + 1j),
    "y in three dimensions": lambda p: (p.X, p.y.reshape(-1, 1, 1, 1)),
    "complex X": lambda p: (p.features + 1j, p.y),
    "X in three dimensions": lambda p: (p.features[None], p.y),
    "X in one dimension": lambda p: (p.features[:, 0], p.y),
    "no rows": lambda p: (np.empty((0, 3)), p.y[:0]),
    "no features": lambda p: (np.asarray(p.X, dtype=object)[:, :0], p.y),
    "sparse X": lambda p: (csr_array(p.features), p.y),
    "text in X": lambda p: (
        p.table(np.full(p.features.shape, "u", object), p.labels),
        p.y,
    ),
    "missing label": lambda p: (
        p.table(p.features, np.array([None] * len(p.y), dtype=object)),
        p.y,
    ),
    "continuous labels": lambda p: (
        p.table(p.features, np.arange(len(p.y)) + 0.3),
        p.y,
    ),
    "mixed labels": lambda p: (
        p.table(
            np.vstack([p.features] * 2), np.array(["a", 1] * len(p.y), dtype=object)
        ),
        np.concatenate([p.y] * 2),
    ),
    "ragged X": lambda p: ([[1.0, 2.0], [1.0]], p.y[:2]),
    "a scalar": lambda p: (3.0, p.y),
    "text": lambda p: ("X", "y"),
}


NOISES = ["auto", "shared", "per_task"]


def common_params(rng, problem, n_features=None):
    fixed = {"noise_variance": 10.0 ** rng.uniform(-12, 1)}
    fixed["noise_variance_bounds"] = "fixed"
    learned = {"noise_variance": 10.0 ** rng.uniform(-9, 1)}
    kernel = make_kernel(rng, n_features or problem.features.shape[1])
    has_derivative = "ExpSineSquared" not in repr(kernel) and kernel != "periodic"
    engines = ["auto", "auto", "kronecker" if problem.complete else "sparse"]
    return pick(rng, [fixed, learned, learned, {}]) | {
        "kernel": kernel,
        "task_feature": problem.task_feature(rng),
        "normalize_y": bool(rng.integers(4)),
        "inference": "auto" if has_noise(kernel) else pick(rng, engines),
        "n_inducing": pick(rng, [1, 3, 10, 500]),
        "inducing_inputs": pick(
            rng, ["greedy", "k-means", "optimised"][: has_derivative + 2]
        ),
        "n_exact": pick(rng, [1, 7, 1100, 1100]),
        "max_iter": pick(rng, [0, 1, 3, 10, 30]),
        "tol": 10.0 ** rng.uniform(-4, 1),
    }


def level_params(rng):
    units = ["auto", "auto", "per_task", "shared", False]
    return {"normalize_y": pick(rng, units), "task_levels": bool(rng.integers(3))}


def fixed_model(rng, problem):
    cls = pick(rng, [IndependentGP, PooledGP])
    own = {"noise": pick(rng, NOISES), "diagonal": not rng.integers(3)}
    if cls is IndependentGP:
        own |= level_params(rng)
    if rng.integers(4) == 0:
        own |= draw_trend(rng, problem, per_task=cls is IndependentGP)
    return cls(**common_params(rng, problem) | own)


def single_model(rng, problem):
    return SingleTaskGP(**common_params(rng, problem))


def multi_model(rng, problem, *, piped=False):
    """One of any prior; `piped`, of one where columns are elsewhere."""
    rank = pick(rng, [None, 1, 1 + int(rng.integers(problem.n_tasks))])
    params = {
        "rank": rank,
        "noise": pick(rng, NOISES),
        "diagonal": not rng.integers(4),
        "learning": pick(rng, ["annealed", "staged", "simultaneous"]),
        "truncation": pick(rng, ["eigen", "cholesky"]),
        "n_restarts_optimizer": int(rng.integers(4) == 0),
        "random_state": pick(rng, [0, None]),
    }
    n_features, more = problem.features.shape[1], {}
    if problem.descriptor is not None and not piped and rng.integers(4):
        n_features -= 1
        most = min(2, problem.n_tasks)
        more["task_descriptors"] = [problem.name_of(problem.descriptor)]
        more["rank"] = rank if rank is None else min(rank, most)
    elif rng.integers(4) == 0:
        more |= draw_terms(rng, problem, n_features)
    if not piped and problem.descriptor is None and rng.integers(5) == 0:
        more |= draw_trend(rng, problem, per_task=True)
    problem.random = params["random_state"] is None
    common = common_params(rng, problem, n_features) | level_params(rng)
    theta = pick(rng, ["mode"] * 12 + ["map"] * 3 + ["laplace"] * 2 + ["sampled"])
    if isinstance(more.get("kernel"), list | tuple) and theta != "mode":
        theta = "map"
    more |= {"hyperparameters": theta, "n_draws": 4}
    return MultiTaskGPRegressor(**common | params | more)


def linear_model(rng, problem):
    return BayesianLinearRegression(
        task_feature=problem.task_feature(rng),
        pooled=bool(rng.integers(2)),
        fit_intercept=bool(rng.integers(4)),
        weight_variance=10.0 ** rng.uniform(-9, 9),
        noise_shape=rng.uniform(0.6, 9.0),  # up to 0.5 one row has no variance
        noise_rate=10.0 ** rng.uniform(-9, 3),
    )


def search_model(rng, problem):
    model = multi_model(rng, problem).set_params(n_restarts_optimizer=0)
    ranks = rng.integers(1, 6, size=rng.integers(1, 3)).tolist()
    if isinstance(model.kernel, list | tuple):
        most = len(model.kernel) + 1
        ranks.append((1,) * int(rng.integers(1, most)))
    criterion, keep = pick(rng, ["bic", "aic", "hqc", "loo"]), bool(rng.integers(2))
    return RankSearchIC(model, ranks=ranks, criterion=criterion, keep_estimators=keep)


def piped_model(rng, problem):
    """A pipeline that scales the features and puts the tasks last."""
    columns = np.delete(np.arange(problem.features.shape[1] + 1), problem.position)
    scaled = ColumnTransformer(
        [("scaled", MinMaxScaler(), columns.tolist())], remainder="passthrough"
    )
    model = multi_model(rng, problem, piped=True).set_params(task_feature=-1)
    return make_pipeline(scaled, model)


def robot_model(rng, problem):
    """The paper's pipeline, where there are three features: one joint."""
    if problem.features.shape[1] != 3:
        return piped_model(rng, problem)
    model = multi_model(rng, problem, piped=True)
    if isinstance(model.kernel, list | tuple):
        return piped_model(rng, problem)
    model.set_params(task_feature=-1, kernel=None)
    return make_inverse_dynamics_regressor(
        model, n_joints=1, task_feature=problem.task_feature(rng)
    )


MODELS = [fixed_model, single_model, multi_model, linear_model, search_model]
PIPELINES = [piped_model, robot_model]
JUNK = [None, "junk", -9, 0.75, np.nan, np.inf, object(), [], (1, 2, 3), 1e9, b"x"]


def make_estimator(rng, problem):
    """An estimator, and whether its parameters are legal."""
    known = (
        MODELS if problem.fault is None else MODELS[:-1]
    )  # others' errors are theirs
    model = pick(rng, known)(rng, problem)
    chance = rng.integers(12)
    if chance == 0 and "kernel" in model.get_params(deep=False):
        kernel = pick(rng, [*wrong_kernels(problem.features.shape[1]), Parabola()])
        apart = np.ptp(problem.features, axis=0).max() > 2.0  # two rows are enough
        if type(kernel) is not Parabola or apart:
            problem.wrong = f"kernel={type(kernel).__name__}"
        return model.set_params(kernel=kernel), False
    if chance > 2:
        return model, with_known(rng, problem, model)
    names = [n for n in model.get_params(deep=False) if n not in ("steps", "n_jobs")]
    names = [n for n in names if n not in ("verbose", "memory", "transform_input")]
    if names:
        model.set_params(**{pick(rng, names): JUNK[rng.integers(len(JUNK))]})
    return model, not names


def with_known(rng, problem, model):
    """Whether fit must succeed, of some models with known noise."""
    last = model[-1] if isinstance(model, Pipeline) else model
    if isinstance(last, BayesianLinearRegression) or rng.integers(3):
        return True
    known, legal = draw_known(rng, problem, last)
    if not legal:
        problem.wrong = f"fit({', '.join(known)})"
    prefix = "" if last is model else f"{model.steps[-1][0]}__"
    problem.known = {prefix + name: value for name, value in known.items()}
    return legal
