"""Intervals that leave-one-out errors scale."""

import numpy as np
import pandas as pd
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
    WideRegressor,
    add_task,
)

# Noise with heavy tails has outliers.
pytestmark = pytest.mark.filterwarnings("ignore::skmtgp.exceptions.OutlierWarning")
NAMES = np.array(["a", "b"])
FAST = {"learning": "staged", "hyperparameters": "mode"}


def draw(n, seed, b=4.0):
    """Rows whose noise has heavy tails, and at b so many times the deviation of a."""
    rng = np.random.default_rng(seed)
    x, site = rng.uniform(0.0, 6.0, n), rng.integers(2, size=n)
    y = np.sin(x) * (1 - 2 * site) + 0.1 * b**site * rng.standard_t(2, n)
    return pd.DataFrame({"x": x, "task": NAMES[site]}), y


DATA = draw(60, 0)
MANY = draw(300, 2)  # for which errors do not grow without what was learned from them
NEW, _ = draw(20, 1)


def quantile(errors, level):
    """The ceil(level (n + 1))-th smallest."""
    return np.sort(errors)[int(np.ceil(level * (len(errors) + 1))) - 1]


def from_left_out(model, X, y, new, level, by_task):
    """The interval by its definition, from what loo_predict and predict give."""
    mean, std = model.loo_predict(include_noise=True)
    errors = np.abs(y - mean) / std
    q = np.full(len(new), quantile(errors, level))
    for task in NAMES if by_task else ():
        q[new["task"] == task] = quantile(errors[X["task"] == task], level)
    mean, std = model.predict(new, return_std=True, include_noise=True)
    factor = getattr(model, "best_estimator_", model).variance_factor_
    if isinstance(model, SingleTaskGP):
        factor = factor[(new["task"] == "b").to_numpy(dtype=int)]
    std = std / np.sqrt(factor)
    return mean - q * std, mean + q * std


@pytest.mark.parametrize("by_task", [False, True])
@pytest.mark.parametrize("level", [0.5, 0.9])
@pytest.mark.parametrize(
    "model",
    [
        MultiTaskGPRegressor(rank=1, **FAST),
        MultiTaskGPRegressor(rank=1, hyperparameters="sampled", n_draws=4),
        MultiTaskGPRegressor(rank=1, inference="sparse", n_inducing=20, **FAST),
        SingleTaskGP(),
        IndependentGP(),
        RankSearchIC(MultiTaskGPRegressor(**FAST), ranks=(0, 1)),
    ],
)
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_the_definition(model, level, by_task):
    fitted = model.fit(*MANY)
    expected = from_left_out(fitted, *MANY, NEW, level, by_task)
    found = fitted.conformal_interval(NEW, level, by_task=by_task)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        {"max_iter": 0},
        {"kernel": [RBF(1.0), RBF(0.1)], "learning": "annealed"},
        {"hyperparameters": "sampled", "n_draws": 20},
    ],
)
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
def test_errors_that_do_not_grow(options):
    """Nothing was learned, or nothing is told of it, or draws are weighed instead."""
    model = MultiTaskGPRegressor(rank=1, **FAST | options).fit(*DATA)
    expected = from_left_out(model, *DATA, NEW, 0.9, False)
    np.testing.assert_allclose(model.conformal_interval(NEW, 0.9), expected, rtol=1e-9)


@pytest.mark.parametrize("options", [FAST, {"hyperparameters": "laplace"}])
def test_errors_grow_where_rows_are_few(options):
    model = MultiTaskGPRegressor(rank=1, **options).fit(*DATA)
    plain = from_left_out(model, *DATA, NEW, 0.9, False)
    ratio = np.subtract(*model.conformal_interval(NEW, 0.9)) / np.subtract(*plain)
    assert 1.01 < ratio.min() < 1.3


def few(seed, n_rows, n_tasks=6):
    """Rows of tasks that are multiples of one function, and new ones."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(n_tasks), n_rows + 50)
    x, of_task = rng.uniform(0.0, 6.0, len(task)), rng.standard_normal(n_tasks)
    y = of_task[task] * np.sin(x + rng.uniform(0.0, 6.0))
    y += 0.2 * rng.standard_normal(len(y))
    learned = np.tile(np.arange(n_rows + 50) < n_rows, n_tasks)
    X = np.column_stack([x, task])
    return X[learned], y[learned], X[~learned], y[~learned]


@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning")
@pytest.mark.filterwarnings("ignore::skmtgp.exceptions.UnidentifiedNoiseWarning")
def test_what_few_rows_hold():
    """Nine hyperparameters are learned from thirty rows."""
    held, plain = [], []
    for seed in range(8):
        X, y, X_new, y_new = few(seed, 5)
        model = MultiTaskGPRegressor(rank=2, **FAST).fit(X, y)
        mean, std = model.loo_predict(include_noise=True)
        q = quantile(np.abs(y - mean) / std, 0.9)
        mean, std = model.predict(X_new, return_std=True, include_noise=True)
        std = std / np.sqrt(model.variance_factor_)
        plain.append(np.mean(np.abs(y_new - mean) <= q * std))
        lower, upper = model.conformal_interval(X_new, 0.9)
        held.append(np.mean((lower <= y_new) & (y_new <= upper)))
    assert np.mean(plain) < 0.8
    assert 0.86 < np.mean(held) < 0.96


def test_what_intervals_hold():
    """The model takes the noise of both sites for the same, though that of b is larger.

    Its tails are heavy. So the model's own intervals for half of the observations hold
    more, and one width for both sites is too large at a and too small at b.
    """
    shares = []
    for seed in range(6):
        X, y = draw(200, seed)
        X_new, y_new = draw(1000, seed + 100)
        model = MultiTaskGPRegressor(rank=1, noise="shared", **FAST).fit(X, y)

        b = (X_new["task"] == "b").to_numpy()

        def held(ends, y=y_new, b=b):
            inside = (ends[0] <= y) & (y <= ends[1])
            return inside.mean(), inside[b].mean()

        ends = [model.conformal_interval(X_new, level) for level in (0.5, 0.95, 0.9)]
        ends = [*ends, model.conformal_interval(X_new, 0.9, by_task=True)]
        shares.append([*map(held, ends), held(model.predict_interval(X_new, 0.5))])
    half, most, together, by_task, own = np.mean(shares, axis=0)
    assert abs(half[0] - 0.5) < 0.05
    assert abs(most[0] - 0.95) < 0.02
    assert own[0] > 0.6
    assert abs(by_task[1] - 0.9) < 0.03
    assert together[1] < 0.87


def test_transformed_targets():
    """Errors are those of the logarithms; the ends are in units of y."""
    X, y = DATA
    logs = MultiTaskGPRegressor(rank=1, **FAST).fit(X, y)
    for sign, transform in (
        (1.0, (np.log, np.exp)),
        (-1.0, (lambda y: -np.log(y), lambda z: np.exp(-z))),
    ):
        model = MultiTaskGPRegressor(rank=1, target_transform=transform, **FAST)
        lower, upper = model.fit(X, np.exp(sign * y)).conformal_interval(NEW, 0.8)
        expected = np.exp(sign * np.array(logs.conformal_interval(NEW, 0.8)))
        np.testing.assert_allclose([lower, upper], np.sort(expected, axis=0), rtol=1e-6)


def test_outputs_have_their_own_widths():
    X, y = MANY
    Y = np.column_stack([y, np.cbrt(y)])
    together = MultiTaskGPRegressor(rank=1, **FAST).fit(X, Y)
    found = together.conformal_interval(NEW, 0.8)
    mean, std = together.loo_predict(include_noise=True)
    q = [quantile(errors, 0.8) for errors in (np.abs(Y - mean) / std).T]
    mean, std = together.predict(NEW, return_std=True, include_noise=True)
    np.testing.assert_allclose(found, [mean - q * std, mean + q * std], rtol=1e-9)


def test_no_level_is_the_median():
    model = IndependentGP().fit(*DATA)
    np.testing.assert_allclose(
        model.conformal_interval(NEW, 0.0), [model.predict(NEW)] * 2, rtol=1e-12
    )


def test_known_noise_widens():
    model = IndependentGP().fit(*DATA)
    lower, upper = model.conformal_interval(NEW, 0.9)
    wider = model.conformal_interval(NEW, 0.9, alpha=4.0)
    _, std = model.predict(NEW, return_std=True, include_noise=True)
    std = std / np.sqrt(model.variance_factor_)  # alpha is known
    ratio = np.sqrt(std**2 + 4.0) / std
    np.testing.assert_allclose(np.subtract(*wider[::-1]), ratio * (upper - lower))


def test_new_tasks_count():
    """Samples that joined are left out, too."""
    model = MultiTaskGPRegressor(rank=1, **FAST).fit(*MANY)
    X, y = draw(25, 3)
    joined = add_task(model, X.assign(task="c"), y)
    new = NEW.assign(task="c")
    found = joined.conformal_interval(new, 0.9, by_task=True)
    mean, std = (of[300:] for of in joined.loo_predict(include_noise=True))
    q = quantile(np.abs(y - mean) / std, 0.9)
    mean, std = joined.predict(new, return_std=True, include_noise=True)
    np.testing.assert_allclose(found, [mean - q * std, mean + q * std], rtol=1e-9)


def test_a_task_of_one_sample_says_nothing_alone():
    """Its mean is the sample itself, so its error of 0 is not counted."""
    X, y = DATA
    with_one = pd.concat([X, pd.DataFrame({"x": [3.0], "task": ["c"]})])
    expected = SingleTaskGP().fit(X, y).conformal_interval(NEW, 0.8)
    y_of_all = np.append(y, 1.0)
    found = SingleTaskGP().fit(with_one, y_of_all).conformal_interval(NEW, 0.8)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    not_its_mean = SingleTaskGP(normalize_y=False).fit(with_one, y_of_all)
    errors = not_its_mean._errors_left_out()
    assert np.isfinite(errors).all()
    assert errors[-1] > 0.0


@pytest.mark.parametrize("normalize_y", ["per_task", "shared"])
def test_a_task_of_one_sample_whose_mean_was_subtracted(normalize_y):
    X, y = DATA
    with_one = pd.concat([X, pd.DataFrame({"x": [3.0], "task": ["c"]})])
    model = IndependentGP(normalize_y=normalize_y).fit(with_one, np.append(y, 1.0))
    known = np.isfinite(model._errors_left_out())
    assert known[:-1].all()
    assert known[-1] == (normalize_y == "shared")


def test_too_few_samples():
    X, y = draw(18, 2)
    model = IndependentGP().fit(X, y)
    with pytest.raises(ValueError, match=r"0\.95 needs 19 left-out samples, and .* 18"):
        model.conformal_interval(NEW)
    assert np.isfinite(model.conformal_interval(NEW, 17 / 19)).all()
    with pytest.raises(ValueError, match=r"needs 19 left-out samples of task 'a', and"):
        model.conformal_interval(NEW, by_task=True)
    with pytest.raises(ValueError, match=r"level=1.0 must be one number in \[0, 1\)"):
        model.conformal_interval(NEW, 1.0)


def test_nineteen_are_enough():
    """0.95 of 20 samples, and the new one, are 19: the largest error."""
    model = IndependentGP().fit(*draw(19, 2))
    assert np.isfinite(model.conformal_interval(NEW)).all()


def test_tasks_that_nobody_saw():
    model = MultiTaskGPRegressor(rank=1, shared=True, **FAST).fit(*DATA)
    unseen = NEW.assign(task="z")
    lower, upper = model.conformal_interval(unseen, 0.9)
    assert (lower < upper).all()
    with pytest.raises(ValueError, match="Unknown task 'z'"):
        model.conformal_interval(unseen, 0.9, by_task=True)


def test_wide():
    """Each column's interval is that of its task."""
    x = np.linspace(0.0, 6.0, 25)[:, None]
    Y = np.hstack([np.sin(x), np.cos(x)])
    Y += 0.1 * np.random.default_rng(0).standard_normal(Y.shape)
    wide = WideRegressor(MultiTaskGPRegressor(rank=2, **FAST)).fit(x, Y)
    lower, upper = wide.conformal_interval(x[:4], 0.9, by_task=True)
    assert lower.shape == (4, 2)
    stacked = np.column_stack([np.tile(x[:4, 0], 2), np.repeat([0, 1], 4)])
    found = wide.estimator_.conformal_interval(stacked, 0.9, by_task=True)
    np.testing.assert_allclose((lower, upper), [of.reshape(2, 4).T for of in found])
    assert np.isfinite(wide.conformal_interval(x[:4], 0.9, alpha=0.1)).all()
