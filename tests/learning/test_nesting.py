import building
import numpy as np
import pytest
import textbook
from drawn import (
    FACTOR,
    KERNEL,
    TRUTH,
    M,
    is_stationary,
    mode_at,
    pose,
    start_of,
)

from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning import nesting
from skmtgp.learning.climbing import climb
from skmtgp.learning.nesting import descend, detour, nest, with_columns
from skmtgp.learning.stages import first_stage
from skmtgp.model.task_covariance import identity, low_rank


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "diagonal"])
def forms(request):
    return [low_rank(M, rank, request.param) for rank in (1, 2, 3)]


def pose_each(data, forms, **changes):
    return [pose(data, form, **changes) for form in forms]


def poor(problem):
    """A mode of noise alone."""
    return mode_at(problem, np.r_[start_of(problem)[:-1], 5.0])


@pytest.fixture(scope="module")
def modes(data, forms):
    first, *others = pose_each(data, forms)
    good = climb(first, start_of(first))
    bad = [poor(problem) for problem in others]
    assert all(mode.value < good.value for mode in bad)
    return [good, *bad]


class TestNest:
    """The higher ranks' modes are deliberately bad."""

    @pytest.mark.parametrize("max_iter", [0, 1, 200])
    @pytest.mark.parametrize("ranks", [(0, 1, 2), (0, 2)], ids=["steps", "leap"])
    def test_values_do_not_fall(self, data, forms, modes, max_iter, ranks):
        forms, modes = [forms[k] for k in ranks], [modes[k] for k in ranks]
        problems = pose_each(data, forms, max_iter=max_iter)
        before = list(modes)
        nested = nest(problems, modes)
        assert all(a is b for a, b in zip(modes, before, strict=True))
        assert nested[0] is modes[0]
        assert (np.diff([mode.value for mode in nested]) >= 0.0).all()
        for problem, mode in zip(problems, nested, strict=True):
            value = problem.likelihood().value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_higher_rank_is_learned_from_the_lower_one(self, data, forms, modes):
        problems = pose_each(data, forms[:2], tol=1e-6, max_iter=1000)
        nested = nest(problems, modes[:2])
        assert nested[1].value > nested[0].value + 1.0
        assert nested[1].seconds > modes[1].seconds
        assert nested[1].n_iter > modes[0].n_iter > 0  # the way to it began there
        assert is_stationary(problems[1], nested[1].theta)

    def test_new_columns_are_those_that_the_gradient_asks_for(self, data, forms, modes):
        problems = pose_each(data, forms[:2], max_iter=0)  # the start alone
        nested = nest(problems, modes[:2])
        assert nested[1].value > nested[0].value + 0.01

    def test_from_where_nothing_can_be_told(self, data, forms, modes, monkeypatch):
        """As where the whole climb of the lower rank has failed."""

        def fail(*_):
            raise NotPositiveDefiniteError("pivot 3 of 15 is not positive")

        monkeypatch.setattr(DenseLikelihood, "task_gradient", fail)
        problems = pose_each(data, forms[:2])
        start = with_columns(*problems, modes[0])
        value = problems[1].likelihood().value(start)
        assert value == pytest.approx(modes[0].value, rel=1e-9)
        assert nest(problems, modes[:2])[1].value >= modes[0].value - 1e-9

    def test_the_lower_mode_is_the_last_resort(self, data, forms, modes, monkeypatch):
        monkeypatch.setattr(nesting, "climb", lambda *args: modes[1])
        problems = pose_each(data, forms[:2])
        nested = nest(problems, modes[:2])
        assert nested[1].value == modes[0].value
        value = problems[1].likelihood().value(nested[1].theta)
        np.testing.assert_allclose(value, modes[0].value, rtol=1e-12)

    def test_good_modes_are_kept(self, data, forms, modes):
        rising = [mode._replace(value=float(k)) for k, mode in enumerate(modes)]
        nested = nest(pose_each(data, forms), rising)
        assert all(a is b for a, b in zip(nested, rising, strict=True))


class TestDescend:
    """The lower ranks' modes are deliberately bad."""

    @pytest.fixture
    def rising(self, data, forms):
        *others, last = pose_each(data, forms)
        good = climb(last, start_of(last))
        bad = [poor(problem) for problem in others]
        assert all(mode.value < good.value for mode in bad)
        return [*bad, good]

    def test_lower_ranks_are_learned_from_the_higher_one(self, data, forms, rising):
        problems = pose_each(data, forms, tol=1e-6, max_iter=1000)
        before = list(rising)
        better = descend(problems, rising)
        assert all(a is b for a, b in zip(rising, before, strict=True))
        assert better[2] is rising[2]
        for problem, mode, old in zip(problems[:2], better, rising, strict=False):
            assert mode.value > old.value + 1.0
            assert mode.seconds > old.seconds
            assert is_stationary(problem, mode.theta)
            value = problem.likelihood().value(mode.theta)
            np.testing.assert_allclose(mode.value, value, rtol=1e-10)

    def test_iterations_are_those_of_the_way(self, data, forms, rising, monkeypatch):
        again = rising[1]._replace(value=1e9, n_iter=7)
        monkeypatch.setattr(nesting, "climb", lambda *args, **known: again)
        lower, highest = descend(pose_each(data, forms[1:]), rising[1:])
        assert lower.n_iter == highest.n_iter + 7 > 7

    def test_none_is_worse(self, data, forms, rising, monkeypatch):
        worst = rising[0]._replace(value=-1e9)
        monkeypatch.setattr(nesting, "climb", lambda *args, **known: worst)
        better = descend(pose_each(data, forms), rising)
        assert [m.value for m in better] == [m.value for m in rising]

    def test_a_climb_ends_where_it_cannot_come_as_far(self, data, monkeypatch):
        problems, told = pose_each(data, [low_rank(M, 1), low_rank(M, 2)]), []

        def spy(problem, theta, known):
            told.extend(known)
            return climb(problem, theta, known=known)

        monkeypatch.setattr(nesting, "climb", spy)
        lower = climb(problems[0], start_of(problems[0]))
        out_of_reach = lower._replace(value=lower.value + 1e4)
        higher = climb(problems[1], start_of(problems[1]))._replace(value=np.inf)
        descend(problems, [out_of_reach, higher])
        assert told == [out_of_reach]

    def test_good_modes_are_kept(self, data, forms, rising):
        falling = [mode._replace(value=-float(k)) for k, mode in enumerate(rising)]
        better = descend(pose_each(data, forms), falling)
        assert all(a is b for a, b in zip(better, falling, strict=True))


class TestDetour:
    """Past a deliberately bad mode of data with little noise."""

    @pytest.fixture
    def problem(self):
        kernel = KERNEL.clone_with_theta(TRUTH)
        rng = np.random.default_rng(3)
        X, tasks = rng.uniform(-2.0, 2.0, (36, 2)), np.repeat(np.arange(M), 12)
        K = textbook.covariance(kernel, FACTOR @ FACTOR.T, 1e-9, X, tasks)
        y = np.linalg.cholesky(K) @ rng.standard_normal(36)
        bounds = np.log([1e-10, 10.0])
        return pose(
            building.data(X, tasks, y, M),
            low_rank(M, 1),
            log_noise_bounds=tuple(bounds),
        )

    @pytest.fixture
    def start(self, problem):
        return first_stage(problem.with_form(identity(M)))

    def test_finds_what_the_mode_missed(self, problem, start):
        theta = problem.theta(K_rho=np.eye(M), log_noise=np.log(1e-6))
        poor = mode_at(problem, np.r_[theta[:-1] - 1.0, theta[-1]])
        found = detour(problem, start, poor)
        assert found.value > poor.value + 10.0
        assert found.n_evaluations > poor.n_evaluations
        value = problem.likelihood().value(found.theta)
        np.testing.assert_allclose(found.value, value, rtol=1e-8)

    def test_ends_early_where_the_next_rank_has_no_more(
        self, problem, start, monkeypatch
    ):
        theta = problem.theta(log_noise=np.log(1e-6))
        good = mode_at(problem, theta)._replace(value=1e6)
        monkeypatch.setattr(nesting, "_cut", None)  # is not called
        found = detour(problem, start, good)
        assert found.value == good.value
        assert found.n_evaluations > good.n_evaluations

    def test_of_full_rank_there_is_none(self, problem, start):
        full = problem.with_form(low_rank(M, M))
        mode = mode_at(full, full.theta())
        assert detour(full, start, mode) is mode

    def test_noisy_data_need_none(self, problem, start):
        noisy = mode_at(problem, problem.theta(log_noise=np.log(0.3)))
        assert detour(problem, start, noisy) is noisy


class TestWhatIsNoPart:
    """A form with something of each task's own is no part of one without."""

    def test_it_is_not_handed_on(self, data):
        forms = [low_rank(M, 0, "equal"), low_rank(M, 0, shared=True), low_rank(M, 1)]
        problems = pose_each(data, forms)
        good = climb(problems[0], start_of(problems[0]))
        modes = [good, poor(problems[1]), poor(problems[2])]
        nested = nest(problems, modes)
        assert nested[1] is modes[1]
        assert nested[1].value < good.value

    def test_independent_tasks_are_part_of_compound_symmetry(self, data):
        forms = [low_rank(M, 0, "equal"), low_rank(M, 0, "equal", shared=True)]
        problems = pose_each(data, forms)
        good = climb(problems[0], start_of(problems[0]))
        nested = nest(problems, [good, poor(problems[1])])
        assert nested[1].value > good.value - 0.1
        value = problems[1].likelihood().value(nested[1].theta)
        assert nested[1].value == pytest.approx(value, rel=1e-10)
