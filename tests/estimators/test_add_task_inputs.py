"""What add_task takes, and what it says to what it does not."""

import numpy as np
import pandas as pd
import pytest
from joining import learner, split
from samples import draw
from sklearn.exceptions import NotFittedError

from skmtgp import MultiTaskGPRegressor

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


LABELS = {
    "int": ([3, 1, 2], 7, None),
    "negative": ([3, 1, 2], -1, None),
    "int8, then too large for it": ([3, 1, 2], 700, "int8"),
    "uint64": ([3, 1, 2], 7, "uint64"),
    "beyond what floats tell apart": ([2**60, 2**60 + 2, 0], 2**60 + 1, None),
    "of another type beyond that": ([2**62, 2**62 + 2, 0], 2**62 + 1, "uint64"),
    "str": (["b", "c", "a"], "d", None),
    "longer str": (["b", "c", "a"], "a longer one", None),
    "category": (["b", "c", "a"], "aa", "category"),
    "string": (["b", "c", "a"], "aa", "string"),
}


@pytest.mark.parametrize(("labels", "label", "dtype"), LABELS.values(), ids=LABELS)
def test_frames_and_labels(labels, label, dtype):
    X, y = draw(per_task=6, n_tasks=4)
    tasks, new = X[:, -1].astype(int), X[:, -1] == 3
    load = pd.Series([[*labels, label][m] for m in tasks])
    table = pd.DataFrame({"a": X[:, 0], "load": load, "b": X[:, 1]})
    old, dtype = table[~new], dtype or load.dtype
    old = old.assign(load=old["load"].astype(dtype))
    model = learner(rank=1, task_feature="load").fit(old, y[~new])
    extended = model.add_task(table[new], y[new])
    assert extended.tasks_.tolist() == sorted([*labels, label])
    assert extended.tasks_.dtype.kind == ("U" if isinstance(label, str) else "i")
    assert extended.feature_names_in_.tolist() == ["a", "load", "b"]
    codes = np.array([sorted([*labels, label]).index(name) for name in load])
    array = np.column_stack([X[:, :2], codes])
    plain = learner(rank=1).fit(array[~new], y[~new]).add_task(array[new], y[new])
    np.testing.assert_allclose(extended.predict(table), plain.predict(array), rtol=1e-7)


def test_lists_and_other_types_of_targets():
    X, y, X_new, y_new = split()
    model = learner(rank=1).fit(X, y)
    expected = model.add_task(X_new, y_new).predict(X_new)
    for given in (y_new.tolist(), pd.Series(y_new, dtype="Float64")):
        found = model.add_task(X_new.tolist(), given).predict(X_new)
        np.testing.assert_array_equal(found, expected)


X_OLD, Y_OLD, X_NEW, Y_NEW = split()
ERRORS = {
    "known": (
        X_OLD[X_OLD[:, -1] == 2],
        Y_OLD[X_OLD[:, -1] == 2],
        "Task 2 is known already. add_task takes new tasks; for more",
    ),
    "several": (
        X_NEW + np.outer(np.arange(4) % 2, [0, 0, 1]),
        Y_NEW,
        r"holds 2 labels, \[8, 9\]\. Call add_task once for each",
    ),
    "text for a number": (
        np.column_stack([X_NEW[:, :2].astype(object), ["x"] * 4]),
        Y_NEW,
        "new task 'x' is not of the type of the known ones, such as 0",
    ),
    "fractional": (X_NEW + [0, 0, 0.5], Y_NEW, "4 of 4 are fractional"),
    "missing label": (X_NEW * [1, 1, np.nan], Y_NEW, "4 missing labels"),
    "width": (np.insert(X_NEW, 0, 1.0, axis=1), Y_NEW, "X has 4 features, but Multi"),
    "NaN": (X_NEW * [np.nan, 1, 1], Y_NEW, "Input X contains NaN"),
    "infinite": (X_NEW + np.diag([np.inf] * 4)[:, :3], Y_NEW, "X contains infinity"),
    "NaN target": (X_NEW, np.full(4, np.nan), "Input y contains NaN"),
    "text target": (
        X_NEW,
        ["text"] * 4,
        "y must be numbers, but holds strings such as 'text'",
    ),
    "too many outputs": (
        X_NEW,
        np.ones((4, 2)),
        r"y has shape \(4, 2\); the model was fitted to .* shape \(n_samples,\)\.",
    ),
    "short target": (X_NEW, Y_NEW[:3], r"inconsistent numbers of samples: \[4, 3\]"),
    "no rows": (X_NEW[:0], Y_NEW[:0], r"0 sample\(s\)"),
}


@pytest.fixture(scope="module")
def model():
    return learner(rank=1).fit(X_OLD, Y_OLD)


@pytest.mark.parametrize(("X", "y", "match"), ERRORS.values(), ids=ERRORS)
def test_bad_data(model, X, y, match):
    with pytest.raises(ValueError, match=match):
        model.add_task(X, y)


@pytest.mark.parametrize("n_terms", [1, 2])
@pytest.mark.parametrize(
    "params",
    [
        {"kernel": ["rbf", "matern", "rbf"]},
        {"kernel": "matern"},
        {"kernel": "unknown"},
        {"rank": [1, 1, 1]},
        {"rank": None},
        {"diagonal": [True] * 3},
        {"task_descriptors": [0]},
    ],
    ids=str,
)
def test_parameters_that_were_set_after_the_fit_do_not_matter(params, n_terms):
    kernel = ["rbf"] * n_terms if n_terms > 1 else "rbf"
    settings = {"normalize_y": "shared", "noise": "shared", "max_iter": 2}
    model = MultiTaskGPRegressor(kernel, rank=2, **settings).fit(X_OLD, Y_OLD)
    expected = model.add_task(X_NEW, Y_NEW).predict(X_NEW)
    model.set_params(**params)
    np.testing.assert_array_equal(model.add_task(X_NEW, Y_NEW).predict(X_NEW), expected)
    joined = model.partial_fit(X_NEW, Y_NEW)
    np.testing.assert_array_equal(joined.predict(X_NEW), expected)


def test_no_targets(model):
    with pytest.raises((ValueError, TypeError)):
        model.add_task(X_NEW, None)


def test_a_number_for_text():
    X = np.column_stack([X_OLD[:, :2].astype(object), np.repeat(["a", "b"], 12)])
    model = learner(rank=1).fit(X, Y_OLD)
    with pytest.raises(
        ValueError, match=r"new task 8 is not .* known ones, such as 'a'"
    ):
        model.add_task(X_NEW, Y_NEW)


@pytest.mark.parametrize("y", [Y_NEW, np.ones((4, 1)), np.ones((4, 3))])
def test_other_numbers_of_outputs(y):
    X, Y, *_ = split(2)
    model = learner(rank=1).fit(X, Y)
    with pytest.raises(ValueError, match=r"fitted to .* shape \(n_samples, 2\)"):
        model.add_task(X_NEW, y)


def test_columns_of_other_names():
    table = pd.DataFrame(X_OLD, columns=["a", "b", "load"])
    model = learner(rank=1).fit(table, Y_OLD)
    other = pd.DataFrame(X_NEW, columns=["a", "c", "load"])
    with pytest.raises(ValueError, match="feature names should match those"):
        model.add_task(other, Y_NEW)


@pytest.mark.parametrize("prior", ["x", "Tasks", False, 1])
def test_bad_prior(model, prior):
    with pytest.raises(ValueError, match=f"prior={prior!r} must be 'tasks' or None"):
        model.add_task(X_NEW, Y_NEW, prior=prior)


def test_a_model_that_is_not_fitted():
    with pytest.raises(NotFittedError):
        MultiTaskGPRegressor().add_task(X_NEW, Y_NEW)
