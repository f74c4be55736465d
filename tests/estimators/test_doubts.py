"""What a fit leaves in doubt, and says."""

import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._estimators import doubts
from skmtgp.exceptions import (
    AmbiguousFitWarning,
    ConstantTargetWarning,
    CorrelatedResidualsWarning,
    RepeatedRowsWarning,
    SmallTaskWarning,
)
from skmtgp.learning.ambiguity import Doubt

N = 100  # rows of each task
CORRELATED = "correlated between neighbouring rows.*TaskStratifiedGroupKFold"
QUICK = {"rank": 1, "learning": "staged", "normalize_y": "shared", "noise": "shared"}


def recorded(seed=0):
    """An arm that comes back to where it was, and drifting sensors."""
    rng, time = np.random.default_rng(seed), np.arange(N)
    task = np.repeat([0, 1], N)
    x = np.tile(2.0 * np.sin(0.13 * time), 2)
    drift = lfilter([1.0], [1.0, -0.9], rng.standard_normal((2, N)), axis=1)
    y = np.choose(task, [1.0, 1.5]) * np.sin(2.0 * x) + 0.15 * drift.ravel()
    return np.column_stack([x, task]), y


@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(**QUICK),
        RankSearchIC(MultiTaskGPRegressor(**QUICK), ranks=[1]),
        MultiTaskGPRegressor(**QUICK, inference="sparse", n_inducing=20, n_exact=50),
        PooledGP(normalize_y="shared", noise="shared"),
    ],
    ids=["dense", "search", "sparse", "pooled"],
)
def test_noise_along_the_rows(model):
    X, y = recorded()
    with pytest.warns(CorrelatedResidualsWarning, match=CORRELATED):
        model.fit(X, y)
    order = np.random.default_rng(0).permutation(2 * N)
    model.fit(X[order], y[order])


def test_single_tasks_are_named():
    match = f"Tasks 0, 1: The noise of the output is {CORRELATED}"
    with pytest.warns(CorrelatedResidualsWarning, match=match):
        SingleTaskGP().fit(*recorded())


def test_outputs_are_named():
    X, y = recorded()
    Y = np.column_stack([np.sin(X[:, 0]), y])
    Y[:, 0] += 0.1 * np.random.default_rng(0).standard_normal(2 * N)
    with pytest.warns(CorrelatedResidualsWarning, match="noise of output 2 of 2 is"):
        MultiTaskGPRegressor(**QUICK).fit(X, Y)


def test_nothing_is_said_of_what_was_not_learned():
    MultiTaskGPRegressor(max_iter=0).fit(*recorded())


def apart(seed=23):
    """Two tasks that are never seen at the same inputs."""
    rng = np.random.default_rng(seed)
    task = np.repeat([0, 1], 25)
    x = rng.uniform(0.0, 3.0, 50) + 3.0 * task
    y = np.sin(1.5 * x) + 2.0 * rng.standard_normal(2)[task]
    return np.column_stack([x, task]), y + 0.2 * rng.standard_normal(50)


@pytest.mark.parametrize("search", [False, True])
def test_another_mode(search):
    model = MultiTaskGPRegressor(rank=2)
    model = RankSearchIC(model, ranks=[2]) if search else model
    match = r"output is \d\.\d nats less likely .* difference is \d\.\d stand.*More"
    with pytest.warns(AmbiguousFitWarning, match=match):
        model.fit(*apart())


@pytest.mark.parametrize(
    ("nats", "less"),
    [(0.4, "0.4 nats less"), (-0.4, "0.4 nats more"), (0.01, "as"), (-0.01, "as")],
)
def test_a_mode_that_gained_too_little_is_more_likely(monkeypatch, nats, less):
    doubt = Doubt(nats, 0.5)
    monkeypatch.setattr(doubts, "doubt_about", lambda *of: doubt)
    x = np.linspace(0.0, 6.0, 20)
    X = np.column_stack([np.tile(x, 2), np.repeat([0, 1], 20)])
    # it has no rank, and no restarts: the message says whose they are
    match = f"is {less} likely .* of a MultiTaskGPRegressor, whose n_restarts"
    with pytest.warns(AmbiguousFitWarning, match=match):
        PooledGP().fit(X, np.tile(np.sin(x), 2) + 0.1 * np.cos(40.0 * X[:, 0]))


def with_small_tasks(*n_rows):
    """Two tasks of 12 rows, and others of fewer."""
    rng, n_rows = np.random.default_rng(0), (12, 12, *n_rows)
    task = np.repeat([f"site {m}" for m in range(len(n_rows))], n_rows)
    x = rng.uniform(0.0, 6.0, len(task))
    y = np.sin(x) + 0.1 * rng.standard_normal(len(task))
    return pd.DataFrame({"x": x, "site": task}), y


class TestSmallTasks:
    def model(self, **params):
        return MultiTaskGPRegressor(
            **{**QUICK, **params}, task_feature="site", max_iter=2
        )

    @pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
    @pytest.mark.parametrize("search", [False, True])
    def test_are_named(self, search):
        model = self.model()
        model = RankSearchIC(model, ranks=[1]) if search else model
        X, y = with_small_tasks(1, 4, 3)
        match = "^Tasks 'site 2', 'site 4': at most.*rank=0 with shared=True relates"
        with pytest.warns(SmallTaskWarning, match=match):
            model.fit(X, y)

    @pytest.mark.parametrize(
        ("params", "n_rows"),
        [
            ({}, (4,)),
            ({"rank": 0, "shared": True}, (1,)),
            ({"max_iter": 0}, (1,)),
            ({"hyperparameters": "sampled", "n_draws": 4}, (1,)),
        ],
        ids=["four rows", "no factor", "nothing learned", "sampled"],
    )
    def test_are_no_matter(self, params, n_rows):
        X, y = with_small_tasks(*n_rows)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", SmallTaskWarning)
            self.model().set_params(**params).fit(X, y)

    def test_all_tasks_are_small(self):
        X, y = with_small_tasks()
        rows = X.groupby("site").head(3).index
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", SmallTaskWarning)
            self.model().fit(X.loc[rows], y[rows])

    def test_repeats_are_rows(self):
        X, y = with_small_tasks(3)
        weight = np.where(X["site"] == "site 2", 2, 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", SmallTaskWarning)
            self.model().fit(X, y, sample_weight=weight)


class TestCopies:
    """Rows that are there twice say that there is no noise."""

    X = np.column_stack([np.linspace(0.0, 6.0, 40), np.arange(40) % 2])
    y = np.sin(X[:, 0]) + 0.3 * np.random.default_rng(0).standard_normal(40)
    FEW = {"max_iter": 2}
    quick = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

    def twice(self, n):
        rows = np.append(np.arange(40), np.arange(n))
        return self.X[rows], self.y[rows]

    @quick
    @pytest.mark.parametrize(
        "model",
        [
            MultiTaskGPRegressor(rank=1, **FEW),
            IndependentGP(**FEW),
            SingleTaskGP(**FEW),
            RankSearchIC(MultiTaskGPRegressor(**FEW), ranks=(1,), simpler=False),
        ],
    )
    def test_are_told(self, model):
        with pytest.warns(RepeatedRowsWarning, match=r"rows repeat another one.*drop_"):
            model.fit(*self.twice(8))

    @quick
    @pytest.mark.parametrize("cls", [MultiTaskGPRegressor, SingleTaskGP])
    def test_of_known_noise_are_not(self, cls):
        X, y = self.twice(8)
        with warnings.catch_warnings():
            warnings.simplefilter("error", RepeatedRowsWarning)
            cls(**self.FEW).fit(X, y, alpha=np.full(len(y), 0.1))

    @quick
    @pytest.mark.parametrize("n", [0, 2])
    def test_a_few_are_not(self, n):
        MultiTaskGPRegressor(rank=1, **self.FEW).fit(*self.twice(n))

    @quick
    def test_nor_what_is_equal_by_chance_or_counted(self):
        X, y = self.twice(8)
        MultiTaskGPRegressor(rank=1, **self.FEW).fit(X, np.append(y[:-1], 9.0))
        options = {"rank": 1, "inference": "dense"} | self.FEW
        MultiTaskGPRegressor(**options).fit(X, y, sample_weight=np.ones(48))

    @quick
    @pytest.mark.parametrize("cls", [MultiTaskGPRegressor, PooledGP, SingleTaskGP])
    def test_rows_that_count_twice_are_told(self, cls):
        X, y = self.twice(0)
        weights = np.ones(len(y))
        weights[:8] = 2
        given = {"sample_weight": weights}
        model = cls(**self.FEW)
        with pytest.warns(RepeatedRowsWarning, match="counts rows more than once"):
            model.fit(X, y, **given)
        with warnings.catch_warnings():
            warnings.simplefilter("error", RepeatedRowsWarning)
            model.fit(X, y, **given, repeat_variance=0.01 * (weights > 1))
            weights[2:] = 1  # two, as many as may be there twice
            model.fit(X, y, **given)

    def test_nor_where_noise_is_not_learned(self):
        X, y = self.twice(8)
        MultiTaskGPRegressor(rank=1, max_iter=0).fit(X, y)
        options = {"noise_variance": 0.1, "noise_variance_bounds": "fixed"}
        MultiTaskGPRegressor(rank=1, learning="staged", **options).fit(X, y)


class TestConstantsAlone:
    """Tasks that SingleTaskGP learns alone are told of as by the other models."""

    def told(self, n, *, y=None, of="hill", **params):
        rng = np.random.default_rng(0)
        x, task = rng.uniform(0.0, 5.0, 3 * n), np.repeat(["dale", "hill", "moor"], n)
        Y = rng.standard_normal((3 * n, 2)) if y is None else np.full(3 * n, y)
        Y[task == of] *= [1.0, 0.0] if y is None else 1.0
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            SingleTaskGP(max_iter=0, **params).fit(
                np.column_stack([x.astype(object), task]), Y
            )
        found = [of for of in caught if of.category is ConstantTargetWarning]
        return [str(of.message).partition(": the")[0] for of in found]

    @pytest.mark.parametrize("n", [6, 20, 30])
    def test_the_task_and_the_output_are_told(self, n):
        assert self.told(n) == ["Task 'hill': all targets of output 2 are equal"]

    def test_nothing_is_told_of_few_rows(self):
        assert self.told(5) == []

    @pytest.mark.parametrize("n", [6, 7, 24])
    def test_all_may_be_constant(self, n):
        every = "Tasks 'dale', 'hill', 'moor': all targets are equal"
        assert self.told(n, y=2.0) == [every]

    def test_a_size_is_something_without_normalize_y(self):
        assert self.told(9, y=2.0, normalize_y=False) == []
        assert len(self.told(9, y=0.0, normalize_y=False)) == 1

    def test_means_of_measurements_that_differ_are_no_constant(self):
        X = np.column_stack([np.linspace(0.0, 5.0, 12), np.repeat([0, 1], 6)])
        known = {"sample_weight": np.full(12, 2), "repeat_variance": np.ones(12)}
        with warnings.catch_warnings():
            warnings.simplefilter("error", ConstantTargetWarning)
            SingleTaskGP(max_iter=0).fit(X, np.ones(12), **known)
