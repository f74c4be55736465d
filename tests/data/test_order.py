"""y with the labels of X in another order is refused, wherever both are read."""

import numpy as np
import pandas as pd
import pytest

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
    add_task,
    average_repeats,
    partial_fit,
)
from skmtgp._data.order import refuse_another_order

rng = np.random.default_rng(0)
X = pd.DataFrame({"x": rng.uniform(0, 6, 12), "load": np.repeat([1, 2], 6)})
y = pd.Series(np.sin(X["x"]), name="y")
ORDER = rng.permutation(12)
SHUFFLED = y.iloc[ORDER]
REFUSED = r"y has the index labels of X in another order: .*y\.loc\[X\.index\], or rese"
QUICK = {"rank": 1, "noise": "shared", "normalize_y": True, "max_iter": 0}
MODEL = MultiTaskGPRegressor("rbf", **QUICK)
ESTIMATORS = [
    MODEL,
    PooledGP(max_iter=0),
    SingleTaskGP(max_iter=0),
    RankSearchIC(MODEL, ranks=(1,)),
    BayesianLinearRegression(),
    WideRegressor(PooledGP(max_iter=0), task="of"),
]


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda of: type(of).__name__)
def test_fit(estimator):
    for given in (SHUFFLED, SHUFFLED.to_frame()):
        with pytest.raises(ValueError, match=REFUSED):
            estimator.fit(X, given)
    estimator.fit(X.iloc[ORDER], SHUFFLED)  # both shuffled
    if isinstance(estimator, PooledGP):
        found = estimator.predict(X)
        same = estimator.fit(X, SHUFFLED.loc[X.index]).predict(X)
        np.testing.assert_allclose(same, found, rtol=1e-9)


def test_rows_and_tasks_that_join():
    model = PooledGP(max_iter=0).fit(X, y)
    for more in (model.partial_fit, lambda X, y: partial_fit(model, X, y)):
        with pytest.raises(ValueError, match=REFUSED):
            more(X, SHUFFLED)
    model = MultiTaskGPRegressor("rbf", **QUICK).fit(X, y)
    for join in (model.add_task, lambda X, y: add_task(model, X, y)):
        with pytest.raises(ValueError, match=REFUSED):
            join(X.assign(load=3), SHUFFLED)


def test_repeats():
    with pytest.raises(ValueError, match=REFUSED):
        average_repeats(X, SHUFFLED)


@pytest.mark.parametrize(
    ("rows", "targets"),
    [
        ([0, 1, 2], [0, 1, 2]),
        ([0, 1, 2], [2, 1, 4]),  # of other rows
        ([0, 1, 2], ["a", "b", "c"]),
        ([0, 1, 1], [1, 0, 1]),  # no label tells one
        ([0, 1, 2], [(0, 1), (1, 1), (2, 1)]),
        ([0, 1, 2], [1, 0]),  # too few, as other checks say
    ],
    ids=str,
)
def test_other_labels_say_nothing(rows, targets):
    index = pd.Index(targets)
    few = X.iloc[: len(rows)].set_axis(rows), y.iloc[: len(targets)].set_axis(index)
    refuse_another_order(*few)
    refuse_another_order(few[0].to_numpy(), few[1])
    refuse_another_order(few[0], few[1].to_numpy())
