"""What may be left of a torque: its features, and which one is chosen."""

from types import SimpleNamespace

import numpy as np
import pytest
from rigid import states, two_joints
from sklearn.gaussian_process.kernels import RBF, Matern

from skmtgp import MultiTaskGPRegressor
from skmtgp.robot._rest import NONE, Features, check_rest, choose

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def dynamics():
    from skmtgp.robot._dynamics import Dynamics

    return Dynamics(two_joints())  # the second slides


def scaled(*parts):
    """Parts of one unit, each divided by its root mean square."""
    return np.hstack([part / np.sqrt(np.square(part).mean()) for part in parts])


def turned_back(x, link):
    """The same states, in which the robot moves the other way and torques point so."""
    x = x.copy()
    x[:, 2:4] *= -1.0
    return x, -link


@pytest.mark.parametrize("asymmetric", [False, True])
def test_friction_depends_on_speed_and_the_torque_along_it(dynamics, asymmetric):
    x, link = states(50, 2)[:, :-1], np.linspace(-3, 5, 50)
    features = Features("friction", dynamics, 1, x, link, asymmetric=asymmetric)
    sign = np.sign(x[:, [3]])
    parts = [np.abs(x[:, [3]]), sign * link[:, None]]
    parts += [sign] * asymmetric
    expected = np.hstack([scaled(*parts), sign])
    np.testing.assert_allclose(features(x, link), expected)
    scales = [3.0] * len(parts)
    smooth = RBF(scales)(expected[:, :-1])
    np.testing.assert_allclose(features.kernel()(expected), sign * sign.T * smooth)


def test_symmetric_friction_is_odd(dynamics):
    x, link = states(50, 2)[:, :-1], np.linspace(-3, 5, 50)
    features = Features("friction", dynamics, 0, x, link)
    kernel, here = features.kernel(), features(x, link)
    back = features(*turned_back(x, link))
    np.testing.assert_allclose(kernel(back, here), -kernel(here))
    np.testing.assert_allclose(kernel(back), kernel(here))


@pytest.mark.parametrize("asymmetric", [False, True])
def test_a_direction_that_no_row_has_is_the_other_one_turned(dynamics, asymmetric):
    x, link = states(50, 2)[:, :-1], np.linspace(-3, 5, 50)
    x[:, 2:4] = np.abs(x[:, 2:4])
    features = Features("friction", dynamics, 0, x, link, asymmetric=asymmetric)
    here, back = features(x, link), features(*turned_back(x, link))
    np.testing.assert_array_equal(back[:, :-1], here[:, :-1])
    np.testing.assert_array_equal(back[:, -1], -here[:, -1])


def test_states_have_cosines_of_joints_that_turn(dynamics):
    x = states(50, 2)[:, :-1]
    features = Features("states", dynamics, 1, x, np.zeros(50))
    parts = [x[:, 1], np.cos(x[:, 0]), np.sin(x[:, 0]), *x[:, 2:].T]
    expected = scaled(*(part[:, None] for part in parts))
    np.testing.assert_allclose(features(x, np.zeros(50)), expected)


def test_features_stay_where_rows_have_been(dynamics):
    x, link = states(50, 2)[:, :-1], np.linspace(-3, 5, 50)
    features = Features("friction", dynamics, 0, x, link)
    far, edge = 9.0 * x[:1], x[:1].copy()
    far[0, 2], edge[0, 2] = 50.0, np.abs(x[:, 2]).max()
    np.testing.assert_array_equal(
        features(far, np.array([80.0])), features(edge, np.array([5.0]))
    )


def test_neighbours_have_one_length_scale_and_parts_of_one_unit(dynamics):
    x = states(50, 2)[:, :-1]
    features = Features("neighbours", dynamics, 1, x, np.zeros(50))
    turned = np.column_stack([np.cos(x[:, 0]), np.sin(x[:, 0])])
    expected = scaled(x[:, [1]], turned, *(x[:, [i]] for i in (3, 2, 5, 4)))
    found = features(x, np.zeros(50))
    np.testing.assert_allclose(found[:, :-3], expected)
    np.testing.assert_array_equal(found[:, -3:].sum(axis=1), 1.0)
    assert features.kernel().k1.kernel == Matern(0.5, (0.02, 10.0), nu=0.5)


def test_neighbours_move_in_the_same_direction(dynamics):
    x = states(50, 2)[:, :-1]
    x[:5, 3] = 0.0
    features = Features("neighbours", dynamics, 1, x, np.zeros(50))
    z, sign = features(x, np.zeros(50)), np.sign(x[:, 3])
    distance = np.linalg.norm(z[:, None, :-3] - z[:, :-3], axis=2)
    expected = np.exp(-distance / 0.5) * (sign[:, None] == sign)
    np.testing.assert_allclose(features.kernel()(z), expected)


def test_what_neighbours_have_in_common_ends_where_rows_end(dynamics):
    x, link = states(50, 2)[:, :-1], np.zeros(50)
    features = Features("friction+neighbours", dynamics, 0, x, link)
    far, farther = 9.0 * x[:1], 90.0 * x[:1]
    near, rough = np.split(
        features(farther, link[:1]) - features(far, link[:1]), [3], 1
    )
    assert (near == 0.0).all()
    assert (rough[0, -7:-3] != 0.0).all()


def test_a_sum_has_the_kernels_of_its_words(dynamics):
    x, link = states(50, 2)[:, :-1], np.linspace(-3, 5, 50)
    words = "friction", "neighbours"
    single = [Features(word, dynamics, 0, x, link) for word in words]
    both = Features("+".join(words), dynamics, 0, x, link)
    parts = [features(x, link) for features in single]
    np.testing.assert_array_equal(both(x, link), np.hstack(parts))
    smooth, rough = (of.kernel()(z) for of, z in zip(single, parts, strict=True))
    np.testing.assert_allclose(both.kernel()(both(x, link)), smooth + 0.1 * rough)


def test_a_joint_at_rest_has_finite_features(dynamics):
    x = states(5, 2)[:, :-1]
    x[:, 2] = 0.0
    assert np.isfinite(
        Features("friction", dynamics, 0, x, np.ones(5))(x, np.ones(5))
    ).all()


def best_of(left, criterion):
    z = np.random.default_rng(1).uniform(-2, 2, (60, 1))
    tasks, process = np.repeat([0, 1], 30), [MultiTaskGPRegressor(rank=1, shared=True)]

    def make(kind):
        return [(SimpleNamespace(kernel=lambda: RBF([3.0], (0.1, 10.0))), z)]

    return choose(["states"], make, left(z[:, 0]), tasks, process, criterion)


def chance(z):
    return 0.1 * np.random.default_rng(0).standard_normal(len(z))


def test_chance_is_no_process():
    rest, table, warnings = best_of(chance, "bic")
    assert (rest.name, rest.model, warnings) == (NONE, None, [])
    assert rest.noise == pytest.approx(0.01, rel=0.3)
    assert [row["chosen"] for row in table] == [True, False]


@pytest.mark.parametrize("criterion", ["bic", "loo"])
def test_a_function_is_one(criterion):
    rest, table, _ = best_of(lambda z: chance(z) + np.sin(2 * z), criterion)
    assert rest.name == "states"
    assert rest.noise == pytest.approx(0.01, rel=0.5)
    assert table[0][criterion] > table[1][criterion] + 50
    assert [row["chosen"] for row in table] == [False, True]


@pytest.mark.parametrize("own", [False, True])
def test_the_relation_of_tasks_is_chosen(own):
    rng = np.random.default_rng(0)
    z, tasks = rng.uniform(-2, 2, (90, 1)), np.repeat([0, 1, 2], 30)
    amount = np.array([1.0, -1.5, 0.3])[tasks] if own else 1.0
    left = amount * np.sin(2 * z[:, 0]) + 0.1 * rng.standard_normal(90)
    relations = [MultiTaskGPRegressor(rank=rank, shared=True) for rank in (0, 1)]
    features = SimpleNamespace(kernel=lambda: RBF([3.0], (0.1, 10.0)))
    given = ["states"], lambda kind: [(features, z)], left, tasks
    rest, table, _ = choose(*given, relations, "bic")
    assert rest.model.rank == own
    assert [row["rest"] for row in table] == [NONE, "states"]
    alone = choose(*given, relations[:1], "bic")[1]
    assert (table[1]["bic"] < alone[1]["bic"]) == own


@pytest.mark.parametrize("two", [False, True])
def test_simpler_features_are_chosen_where_they_suffice(two):
    rng = np.random.default_rng(0)
    z = rng.uniform(-2, 2, (90, 2))
    left = np.sin(2 * z[:, 0]) * (np.cos(z[:, 1]) if two else 1.0)
    left += 0.1 * rng.standard_normal(90)
    of = [
        SimpleNamespace(kernel=lambda n=n: RBF([1.0] * n, (0.1, 10.0))) for n in (2, 1)
    ]
    options = [(of[0], z), (of[1], z[:, :1])]
    given = ["friction"], lambda kind: options, left, np.zeros(90, int)
    rest, table, _ = choose(*given, [MultiTaskGPRegressor(rank=1)], "bic")
    assert rest.features is of[not two]
    assert [row["rest"] for row in table] == [NONE, "friction"]


def test_none_is_the_normal_distribution_of_the_noise():
    left = np.array([1.0, -2.0, 0.5])
    _, (row,), _ = choose([], None, left, np.zeros(3, int), [None], "bic")
    variance = np.mean(left**2)
    expected = -1.5 * np.log(2 * np.pi * variance) - 1.5
    assert row["log_marginal_likelihood"] == pytest.approx(expected)
    assert "loo" not in row
    assert row["bic"] == pytest.approx(np.log(3) - 2 * expected)


@pytest.mark.parametrize(
    ("rest", "error", "message"),
    [
        ("magic", ValueError, "rest='magic' has 'magic'; it must be of 'friction', 's"),
        (["states", 3], ValueError, "has 3; it must be of"),
        (3, TypeError, "rest=3 must be None, a word or a sequence of words"),
    ],
)
def test_wrong_words(rest, error, message):
    with pytest.raises(error, match=message):
        check_rest(rest)


def test_words():
    assert check_rest(None) == []
    assert check_rest("states") == ["states"]
    assert check_rest(("friction", "states", "friction")) == ["friction", "states"]
