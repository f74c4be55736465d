"""Targets that are far from all others of their task."""

import warnings

import numpy as np
import pytest

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._data.outliers import far_off
from skmtgp.exceptions import OutlierWarning

FEW = {"max_iter": 2, "kernel": "rbf"}
quick = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


def measured(n=30):
    """Two tasks of different levels, and the task of each row."""
    rng, codes = np.random.default_rng(0), np.repeat([0, 1], n)
    x = rng.uniform(0.0, 6.0, 2 * n)
    y = np.sin(x) + np.where(codes, 20.0, 1.0) + 0.1 * rng.standard_normal(2 * n)
    return x, codes, y


def found(y, codes):
    return np.flatnonzero(far_off(np.reshape(y, (len(y), -1)), codes)).tolist()


class TestFarOff:
    def test_a_few_targets_of_a_task(self):
        _, codes, y = measured()
        y[[3, 4, 5]] = -999.0
        y[40] *= 1000.0
        assert found(y, codes) == [3, 4, 5, 40]

    def test_each_output_alone(self):
        _, codes, y = measured()
        Y = np.column_stack([y, y])
        Y[3, 1] = 1e6
        assert np.argwhere(far_off(Y, codes)).tolist() == [[3, 1]]

    def test_levels_and_units_of_tasks_do_not_matter(self):
        _, codes, y = measured()
        y = np.where(codes, 1e6 + 1e3 * y, y)
        assert found(y, codes) == []
        y[3] = y[40]
        assert found(y, codes) == [3]

    def test_not_as_many_as_may_be_a_part_of_the_function(self):
        _, codes, y = measured()
        y[:4] = [-999.0, -990.0, -980.0, -970.0]
        assert found(y, codes) == []

    @pytest.mark.parametrize("n_bad", [4, 10, 14])
    def test_codes_of_up_to_half_of_the_rows(self, n_bad):
        _, codes, y = measured()
        y[:n_bad] = -999.0
        assert found(y, codes) == list(range(n_bad))
        y[1:n_bad:3] = 850.0
        assert found(y, codes) == list(range(n_bad))
        y[2:n_bad:3] = 2000.0
        assert found(y, codes) == []

    def test_two_codes_as_far_on_both_sides(self):
        y = np.r_[np.linspace(-1.0, 1.0, 31), np.tile([-99.0, 99.0], 5)]
        assert found(y, np.zeros(41, dtype=int)) == list(range(31, 41))

    def test_not_most_rows_of_a_code(self):
        _, codes, y = measured()
        y[:16] = -999.0
        assert found(y, codes) == []

    def test_not_two_that_do_not_repeat(self):
        _, codes, y = measured(12)
        y[:2] = -999.0, 850.0
        assert found(y, codes) == []

    @pytest.mark.parametrize("share", [0.2, 0.4])
    def test_not_zeros_among_amounts_limits_or_clipped_values(self, share):
        rng = np.random.default_rng(0)
        y, codes = rng.lognormal(size=4000), np.arange(4000) % 50
        none = np.where(rng.random(4000) < share, 0.0, y)
        assert found(none, codes) == []
        assert found(np.maximum(y, np.quantile(y, share)), codes) == []
        assert found(np.minimum(y, np.quantile(y, 1.0 - share)), codes) == []

    def test_not_of_a_handful_of_rows(self):
        _, codes, y = measured(9)
        y[3] = -999.0
        assert found(y, codes) == []

    def test_not_events_among_zeros(self):
        _, codes, y = measured()
        y[codes == 0] = np.r_[np.zeros(27), 0.01, 0.5, 30.0]
        assert found(y, codes) == []

    @pytest.mark.parametrize("draw", ["standard_normal", "exponential", "lognormal"])
    def test_seldom_by_chance(self, draw):
        y = getattr(np.random.default_rng(0), draw)(size=30 * 200)
        assert len(found(y, np.arange(len(y)) % 200)) <= 1


class TestWarning:
    @quick
    @pytest.mark.parametrize(
        ("model", "task"),
        [
            (MultiTaskGPRegressor(rank=1, **FEW), "-999 of task 1. "),
            (IndependentGP(**FEW), "-999 of task 1. "),
            (PooledGP(**FEW), "-999 of task 1. "),
            (SingleTaskGP(**FEW), "^Task 1: 2 targets are .*-999. "),
            (
                RankSearchIC(MultiTaskGPRegressor(**FEW), ranks=(1,), simpler=False),
                "-999 of task 1. ",
            ),
        ],
    )
    def test_names_value_and_task(self, model, task):
        x, codes, y = measured()
        y[[40, 50]] = -999.0
        with pytest.warns(OutlierWarning, match=f"{task}.*target_transform"):
            model.fit(np.column_stack([x, codes]), y)

    def test_a_code_in_many_rows(self):
        x, codes, y = measured()
        y[30:42] = -127.0
        model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
        with pytest.warns(OutlierWarning, match="^12 targets .*: -127 of task 1. "):
            model.fit(np.column_stack([x, codes]), y)

    def test_some_of_many(self):
        x, codes, y = measured()
        y[[3, 13, 23, 43, 53]] = 1e6 * np.arange(1.0, 6.0)
        model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
        with pytest.warns(OutlierWarning, match="5 targets .* and 2 more"):
            model.fit(np.column_stack([x, codes]), y)

    def test_with_a_map_of_the_targets(self):
        """Far is what is far in logarithms; values are those of y."""
        x, codes, y = measured()
        y = np.exp(np.sin(x))
        y[7] = 1e6
        logs = {"target_transform": (np.log, np.exp), "max_iter": 0, "rank": 1}
        X = np.column_stack([x, codes])
        with warnings.catch_warnings():
            warnings.simplefilter("error", OutlierWarning)
            MultiTaskGPRegressor("rbf", **logs).fit(X, y)
        y[7] = 1e60
        with pytest.warns(OutlierWarning, match=r"1e\+60 of task 0"):
            MultiTaskGPRegressor("rbf", **logs).fit(X, y)

    def test_not_what_the_trend_explains(self):
        x, codes, y = measured()
        x[7] = 1e3
        X, y = np.column_stack([x, codes]), 3.0 * x + codes
        model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
        with pytest.warns(OutlierWarning, match="3000 of task 0"):
            model.fit(X, y)
        model.set_params(trend=[0]).fit(X, y + np.sin(x))

    def test_not_of_weighed_rows(self):
        """What is known of their noise may say it already."""
        x, codes, y = measured()
        y[7] = -999.0
        alpha = np.where(np.arange(60) == 7, 1e6, 0.0)
        model = MultiTaskGPRegressor("rbf", rank=1, max_iter=0)
        model.fit(np.column_stack([x, codes]), y, alpha=alpha)


class TestUnforeseen:
    def fitted(self, y, alpha=None, **options):
        x, codes, _ = measured()
        X = np.column_stack([x, np.array(["a", "b"])[codes]])
        return MultiTaskGPRegressor("rbf", rank=1, **options).fit(X, y, alpha=alpha)

    def test_names_values_tasks_and_the_way_out(self):
        _, _, y = measured()
        self.fitted(y)
        y[7] = 3.3
        message = "^A target of the output is .* deviations .*: 3.3 of task 'a'. .*loo_"
        with pytest.warns(OutlierWarning, match=message):
            self.fitted(y)
        y[40] += y[7] - measured()[2][7]  # as far
        message = "^2 targets of the output are up to .*, (3.3 of task 'a'|.*'b')[.] "
        with pytest.warns(OutlierWarning, match=message):
            self.fitted(y)

    def test_rows_that_were_told_before_are_not_told_again(self):
        _, _, y = measured()
        y[7] = -999.0
        with pytest.warns(OutlierWarning, match="-999 of task 'a'") as caught:
            self.fitted(y)
        assert len(caught) == 1

    def test_known_noise_explains_them(self):
        _, _, y = measured()
        y[7] = 3.3
        self.fitted(y, alpha=np.where(np.arange(60) == 7, 4.0, 0.0))

    def test_values_are_those_of_y(self):
        _, codes, y = measured()
        y[7] = 3.3
        with pytest.warns(OutlierWarning, match="3.3 of task 'a'"):
            self.fitted(y - 15.0 * codes, target_transform=(np.exp, np.log))
