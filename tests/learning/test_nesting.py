import numpy as np
import pytest
from drawn import M, configure, is_stationary, mode_at, start_of

from skmtgp.learning import nesting
from skmtgp.learning.climbing import climb
from skmtgp.learning.nesting import descend, nest
from skmtgp.model.task_covariance import low_rank


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "diagonal"])
def forms(request):
    return [low_rank(M, rank, request.param) for rank in (1, 2, 3)]


@pytest.fixture(scope="module")
def modes(data, forms):
    settings = configure()
    good = climb(data, settings, forms[0], start_of(settings, forms[0]))
    bad = [
        mode_at(data, settings, form, np.r_[start_of(settings, form)[:-1], 5.0])
        for form in forms[1:]
    ]
    assert all(mode.value < good.value for mode in bad)
    return [good, *bad]


class TestNest:
    """The higher ranks' modes are deliberately bad."""

    @pytest.mark.parametrize("max_iter", [0, 1, 200])
    @pytest.mark.parametrize("ranks", [(0, 1, 2), (0, 2)], ids=["steps", "leap"])
    def test_values_do_not_fall(self, data, forms, modes, max_iter, ranks):
        settings = configure(max_iter=max_iter)
        forms, modes = [forms[k] for k in ranks], [modes[k] for k in ranks]
        before = list(modes)
        nested = nest(data, settings, forms, modes)
        assert all(a is b for a, b in zip(modes, before, strict=True))
        assert nested[0] is modes[0]
        assert (np.diff([mode.value for mode in nested]) >= 0.0).all()
        for form, mode in zip(forms, nested, strict=True):
            value = settings.likelihood(data, form).value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_higher_rank_is_learned_from_the_lower_one(self, data, forms, modes):
        settings = configure(tol=1e-6, max_iter=1000)
        nested = nest(data, settings, forms[:2], modes[:2])
        assert nested[1].value > nested[0].value + 1.0
        assert nested[1].seconds > modes[1].seconds
        assert nested[1].n_iter > modes[0].n_iter > 0  # the way to it began there
        assert is_stationary(data, settings, forms[1], nested[1].theta)

    def test_new_columns_are_those_that_the_gradient_asks_for(self, data, forms, modes):
        settings = configure(max_iter=0)  # the start alone
        nested = nest(data, settings, forms[:2], modes[:2])
        assert nested[1].value > nested[0].value + 0.01

    def test_the_lower_mode_is_the_last_resort(self, data, forms, modes, monkeypatch):
        monkeypatch.setattr(nesting, "climb", lambda *args: modes[1])
        nested = nest(data, configure(), forms[:2], modes[:2])
        assert nested[1].value == modes[0].value
        likelihood = configure().likelihood(data, forms[1])
        value = likelihood.value(nested[1].theta)
        np.testing.assert_allclose(value, modes[0].value, rtol=1e-12)

    def test_good_modes_are_kept(self, data, forms, modes):
        rising = [mode._replace(value=float(k)) for k, mode in enumerate(modes)]
        nested = nest(data, configure(), forms, rising)
        assert all(a is b for a, b in zip(nested, rising, strict=True))


class TestDescend:
    """The lower ranks' modes are deliberately bad."""

    @pytest.fixture
    def rising(self, data, forms):
        settings = configure()
        good = climb(data, settings, forms[2], start_of(settings, forms[2]))
        bad = [
            mode_at(data, settings, form, np.r_[start_of(settings, form)[:-1], 5.0])
            for form in forms[:2]
        ]
        assert all(mode.value < good.value for mode in bad)
        return [*bad, good]

    def test_lower_ranks_are_learned_from_the_higher_one(self, data, forms, rising):
        settings = configure(tol=1e-6, max_iter=1000)
        before = list(rising)
        better = descend(data, settings, forms, rising)
        assert all(a is b for a, b in zip(rising, before, strict=True))
        assert better[2] is rising[2]
        for form, mode, old in zip(forms[:2], better, rising, strict=False):
            assert mode.value > old.value + 1.0
            assert mode.seconds > old.seconds
            assert is_stationary(data, settings, form, mode.theta)
            value = settings.likelihood(data, form).value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_iterations_are_those_of_the_way(self, data, forms, rising, monkeypatch):
        again = rising[1]._replace(value=1e9, n_iter=7)
        monkeypatch.setattr(nesting, "climb", lambda *args: again)
        lower, highest = descend(data, configure(), forms[1:], rising[1:])
        assert lower.n_iter == highest.n_iter + 7 > 7

    def test_none_is_worse(self, data, forms, rising, monkeypatch):
        worst = rising[0]._replace(value=-1e9)
        monkeypatch.setattr(nesting, "climb", lambda *args: worst)
        better = descend(data, configure(), forms, rising)
        assert [m.value for m in better] == [m.value for m in rising]

    def test_good_modes_are_kept(self, data, forms, rising):
        falling = [mode._replace(value=-float(k)) for k, mode in enumerate(rising)]
        better = descend(data, configure(), forms, falling)
        assert all(a is b for a, b in zip(better, falling, strict=True))
