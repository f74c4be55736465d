"""Tasks that join whose level is far from those of all others."""

import numpy as np
import pytest
from sklearn.gaussian_process.kernels import DotProduct
from streams import close, fresh, refitted, told

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    TaskIdentifier,
    compile_predictor,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.NarrowIntervalsWarning"),
]


def tasks(levels, n, labels=None, seed=0):
    """Rows of levels and multiples of a sine, the label in the last column."""
    rng = np.random.default_rng(seed)
    codes = np.repeat(np.arange(len(levels)), n)
    labels = np.arange(len(levels)) if labels is None else np.asarray(labels)
    x = rng.uniform(0.0, 6.0, len(codes))
    size = rng.uniform(0.5, 1.5, len(levels))
    y = np.asarray(levels)[codes] + size[codes] * np.sin(x)
    y += 0.1 * rng.standard_normal(len(x))
    return np.column_stack([x, labels[codes]]), y


X, Y = tasks([9.0, 12.0, 10.5, 11.0, 9.5], 16)
X_NEW, Y_NEW = tasks([0.0], 4, labels=[7], seed=1)
GRID = np.column_stack([np.linspace(0.0, 6.0, 30), np.full(30, 7)])


def error(model, level):
    """Of predictions of the new task, whose function is a multiple of a sine."""
    y = model.predict(GRID) - level
    size = y @ np.sin(GRID[:, 0]) / np.square(np.sin(GRID[:, 0])).sum()
    return np.std(y - size * np.sin(GRID[:, 0]))


@pytest.fixture(scope="module")
def known():
    return MultiTaskGPRegressor().fit(X, Y)


@pytest.mark.parametrize("level", [40.0, 1e3, -1e5])
@pytest.mark.parametrize("prior", ["tasks", None])
def test_the_level_is_no_part_of_its_function(known, level, prior):
    joined = known.add_task(X_NEW, level + Y_NEW, prior=prior)
    assert error(joined, level) < 0.4
    assert joined.task_level_[-1] == pytest.approx(level, abs=1.0)
    close(told(joined, GRID), told(refitted(joined), GRID))


def test_the_distance_does_not_matter(known):
    """Once it is far it makes no difference how far."""
    near, far = (known.add_task(X_NEW, level + Y_NEW) for level in (1e3, 1e6))
    difference = far.predict(GRID) - near.predict(GRID)
    np.testing.assert_allclose(difference, 1e6 - 1e3, rtol=1e-10)
    std = [of.predict(GRID, return_std=True)[1] for of in (near, far)]
    np.testing.assert_allclose(*std, rtol=1e-6)


def test_others_are_told_the_same(known):
    joined = known.add_task(X_NEW, 1e3 + Y_NEW)
    before, after = (of.predict(X, return_std=True) for of in (known, joined))
    np.testing.assert_allclose(after[0], before[0], atol=0.05)
    assert known.predict(X) == pytest.approx(before[0], rel=0.0)


def test_a_level_among_the_others_has_no_centre(known):
    joined = known.add_task(X_NEW, 10.0 + Y_NEW)
    assert not joined._units.own_centres
    assert np.ndim(joined.y_mean_) == 0


def test_a_stream_stays_there(known):
    model = fresh(known)
    for rows in (slice(0, 2), [2], [3]):
        model.partial_fit(X_NEW[rows], 1e3 + Y_NEW[rows])
        close(told(model, GRID), told(refitted(model), GRID))
    assert error(model, 1e3) < 0.4


def test_the_centre_is_that_of_all_rows():
    """It is taken anew with the relation."""
    known = MultiTaskGPRegressor(rank=1).fit(X, Y)
    at_once = known.add_task(X_NEW[:3], 1e3 + Y_NEW[:3])
    model = known.add_task(X_NEW[:2], 1e3 + Y_NEW[:2])
    model.partial_fit(X_NEW[[2]], 1e3 + Y_NEW[[2]])
    close([model.predict(GRID)], [at_once.predict(GRID)], digits=6)


def test_more_rows_move_the_centre():
    """The first two were 30 too high, as more of them show."""
    known = MultiTaskGPRegressor(rank=1).fit(X, Y)
    y = 100.0 + Y_NEW
    model = known.add_task(X_NEW[:2], 30.0 + y[:2])
    assert model._units.centre[0, -1] == pytest.approx(130.0, abs=3.0)
    model.partial_fit(X_NEW[[2]], y[[2]])
    assert model._units.centre[0, -1] == pytest.approx(120.0, abs=3.0)
    close(told(model, GRID), told(refitted(model), GRID))


def test_two_that_are_far(known):
    first = known.add_task(X_NEW, 1e3 + Y_NEW)
    X_two, y_two = tasks([30.0], 4, labels=[-1], seed=2)  # before all others
    both = first.add_task(X_two, y_two)
    assert error(both, 1e3) < 0.4
    assert np.abs(both.predict(X_two) - y_two).max() < 0.5
    X_three, y_three = tasks([10.0], 4, labels=[9], seed=3)
    three = both.add_task(X_three, y_three)
    assert np.abs(three.predict(X_three) - y_three).max() < 0.5
    close(told(three, GRID), told(refitted(three), GRID))


def test_independent_tasks():
    model = IndependentGP().fit(X, Y)
    near, far = (
        fresh(model).partial_fit(X_NEW, level + Y_NEW) for level in (10.0, 1e3)
    )
    difference = far.predict(GRID) - near.predict(GRID)
    np.testing.assert_allclose(difference, 990.0, atol=0.5)


def test_of_several_outputs_one():
    model = MultiTaskGPRegressor(rank=1).fit(X, np.column_stack([Y, Y - 10.0]))
    y = np.column_stack([1e3 + Y_NEW, Y_NEW])
    joined = model.add_task(X_NEW, y)
    centre = joined._units.centre
    assert (centre[1] == centre[1, 0]).all()
    assert (centre[0, :-1] == centre[0, 0]).all()
    assert centre[0, -1] - centre[0, 0] == pytest.approx(990.0, abs=5.0)
    found = joined.predict(GRID)
    assert np.abs(found - found.mean(axis=0)).max() < 3.0


def test_without_levels_and_centres_nothing_is_taken_off():
    for options in ({"task_levels": False}, {"normalize_y": False}):
        model = MultiTaskGPRegressor(rank=1, **options).fit(X, Y)
        assert not model.add_task(X_NEW, 1e3 + Y_NEW)._units.own_centres


def test_sampled():
    model = MultiTaskGPRegressor(
        "rbf", rank=1, hyperparameters="sampled", n_draws=6, max_iter=10
    )
    joined = model.fit(X, Y).add_task(X_NEW, 1e3 + Y_NEW)
    assert error(joined, 1e3) < 0.6


def test_labels_do_not_matter(known):
    """A far task before all others is no reference for them."""
    one = [[2.0, 50]]
    levels = []
    for label in (-1, 100):
        far = known.add_task(np.column_stack([X_NEW[:, 0], [label] * 4]), 1e3 + Y_NEW)
        joined = far.add_task(one, [13.0])
        levels.append(joined.task_level_[joined.tasks_ == 50])
    np.testing.assert_allclose(*levels, rtol=1e-9)


def test_values_that_the_kernel_explains_are_not_far():
    """A slope far from the rows of the others makes large values."""
    rng = np.random.default_rng(0)
    x, task = rng.uniform(-1.0, 1.0, 80), np.repeat([0, 1, 2, 3], 20)
    y = np.array([1.0, 2.0, -1.0, 1.5])[task] * x + 0.01 * rng.standard_normal(80)
    kernel = DotProduct(1e-3, sigma_0_bounds="fixed")
    model = MultiTaskGPRegressor(kernel, rank=1).fit(np.column_stack([x, task]), y)
    new = np.column_stack([np.linspace(50.0, 60.0, 5), np.full(5, 9)])
    joined = model.add_task(new, 2.5 * new[:, 0])
    assert joined.predict([[100.0, 9]]) == pytest.approx([250.0], rel=0.01)


def test_with_a_trend():
    model = MultiTaskGPRegressor(rank=1, trend=[0]).fit(X, Y)
    joined = model.add_task(X_NEW, 1e3 + Y_NEW)
    assert error(joined, 1e3) < 0.4
    close(told(joined, GRID), told(refitted(joined), GRID))


class TestOthersThatNobodyHasSeen:
    @pytest.fixture
    def joined(self):
        model = MultiTaskGPRegressor(rank=0, shared=True).fit(X, Y)
        return model, model.add_task(X_NEW, 1e3 + Y_NEW)

    def test_they_have_the_centre_of_the_others(self, joined):
        model, joined = joined
        at = [[1.0, 55], [2.0, 66]]
        for ask in (
            lambda of: of.predict(at),
            lambda of: np.stack(of.predict_interval(at)),
            lambda of: of.predict(at, return_std=True)[1],
        ):
            np.testing.assert_allclose(ask(joined), ask(model), rtol=0.05)
        predictor = compile_predictor(joined, task=55)
        assert predictor([1.0]) == pytest.approx(joined.predict(at)[:1], rel=1e-9)
        assert joined.sample_y(at, 3).shape == (2, 3)

    def test_they_are_identified(self, joined):
        _, joined = joined
        identifier = TaskIdentifier(joined)
        assert np.isfinite(identifier.predict_proba(X[:4, :1], Y[:4])).all()
