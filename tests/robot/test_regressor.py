"""Least squares on rigid bodies, against the robot that made the data."""

import pickle

import numpy as np
import pandas as pd
import pytest
from rigid import rnea, states, two_joints
from scipy.stats import multivariate_normal
from sklearn.base import clone
from sklearn.linear_model import BayesianRidge

from skmtgp import TaskIdentifier
from skmtgp.exceptions import UnidentifiedNoiseWarning
from skmtgp.robot import RigidBodyFeatures, RigidBodyRegressor
from skmtgp.robot._dynamics import INERTIAL
from skmtgp.robot._solving import evidence, least_squares, solve

pin = pytest.importorskip("pinocchio")
PAIR = "shoulder", "slide"
PRIOR = pytest.mark.parametrize("prior", [None, "evidence"])


@pytest.fixture(scope="module")
def fitted(puma, moved):
    """With half of the rows."""
    X, Y, _ = moved
    return RigidBodyRegressor(puma, empty_task=1).fit(X[::2], Y[::2])


def noisy(Y, sizes=1.0, seed=0):
    return Y + sizes * np.random.default_rng(seed).normal(size=Y.shape)


@PRIOR
@pytest.mark.parametrize("joint", [None, 0, 5])
def test_it_is_exact_where_its_friction_is_the_robots(puma, moved, prior, joint):
    X, Y, _ = moved
    Y = Y if joint is None else Y[:, joint]
    model = RigidBodyRegressor(puma, prior=prior, joint=joint).fit(X[::2], Y[::2])
    found = model.predict(X[1::2])
    assert found.shape == Y[1::2].shape
    np.testing.assert_allclose(found, Y[1::2], rtol=0, atol=1e-8)


def test_loads_are_those_of_the_data(fitted, moved):
    loads = moved[2]
    expected = loads[INERTIAL].to_numpy() - loads[INERTIAL].to_numpy()[0]
    found = fitted.load_parameters_
    assert found.columns.tolist() == INERTIAL
    assert found.index.tolist() == fitted.tasks_.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert fitted.load_covariance_.shape == (4, 10, 10)
    assert not fitted.load_covariance_[0].any()  # the empty hand is known


def test_without_an_empty_hand_loads_are_relative_to_their_mean(puma, moved):
    X, Y, loads = moved
    model = RigidBodyRegressor(puma).fit(X, Y)
    values = loads[INERTIAL].to_numpy()
    expected = values - values.mean(axis=0)
    np.testing.assert_allclose(model.load_parameters_, expected, rtol=0, atol=1e-9)


def test_links_and_friction_are_those_of_the_robot(puma):
    X = states(200)
    Y = rnea(pin.buildModelFromXML(puma), X)
    Y += 2.0 * X[:, 6:12] + np.where(X[:, 6:12] > 0, 0.3, -0.7) + 0.1 * X[:, 12:18]
    model = RigidBodyRegressor(puma).fit(X, Y)
    value = model.parameters_["value"]
    words = {"viscous": 2.0, "coulomb+": 0.3, "coulomb-": 0.7}
    for word, expected in words.items():
        names = [f"{word}(joint{j})" for j in range(1, 7)]
        np.testing.assert_allclose(value[names], expected, atol=1e-10)
    for j in (3, 4, 5, 6):
        assert value[f"rotor(joint{j})"] == pytest.approx(0.1, abs=1e-9)
    nominal = RigidBodyFeatures(puma, joint=5).fit(X)
    names = nominal.get_feature_names_out()[:-1]
    for name, expected in zip(names, nominal.nominal_, strict=True):
        if name in ("mc_x(joint6)", "mc_y(joint6)", "I_xy(joint6)"):
            assert value[name] == pytest.approx(expected, abs=1e-9)


def test_a_single_task_has_no_load(puma):
    X = states(200)
    Y = rnea(pin.buildModelFromXML(puma), X)
    model = RigidBodyRegressor(puma).fit(X, Y)
    assert not model.load_parameters_.to_numpy().any()
    np.testing.assert_allclose(model.predict(X), Y, rtol=0, atol=1e-9)


@pytest.mark.parametrize("joint", [None, 2])
def test_noise_variances_and_standard_deviations(puma, moved, joint):
    X, Y, loads = moved
    sizes = np.array([2.0, 1.0, 0.5, 0.1, 0.05, 0.02])
    Y = noisy(Y, sizes)
    if joint is not None:
        Y, sizes = Y[:, joint], sizes[joint]
    model = RigidBodyRegressor(puma, joint=joint, empty_task=1).fit(X, Y)
    np.testing.assert_allclose(np.sqrt(model.noise_variance_), sizes, rtol=0.12)
    assert np.shape(model.noise_variance_) == np.shape(sizes)
    mean, std = model.predict(X, return_std=True)
    error = (mean - moved[1] if joint is None else mean - moved[1][:, joint]) / std
    assert 0.6 < np.sqrt(np.mean(error**2)) < 1.5
    noise = model.predict(X, return_std=True, include_noise=True)[1]
    np.testing.assert_allclose(noise**2 - std**2, model.noise_variance_ + 0 * Y)
    names = model.load_parameters_.columns
    if joint is None:
        true = loads[names].to_numpy() - loads[names].to_numpy()[0]
        of_load = np.array([c.diagonal() for c in model.load_covariance_[1:]]) ** 0.5
        z = (model.load_parameters_.to_numpy() - true)[1:] / of_load
        assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5


def test_accurate_joints_weigh_more(puma, moved):
    X, Y, loads = moved
    Y = noisy(Y, np.array([9.0, 9.0, 9.0, 9.0, 0.001, 0.001]))
    model = RigidBodyRegressor(puma, empty_task=1).fit(X, Y)
    true = loads["mc_z"].to_numpy() - loads["mc_z"].to_numpy()[0]
    np.testing.assert_allclose(model.load_parameters_["mc_z"], true, atol=0.002)


def test_what_data_do_not_show_has_no_finite_deviation(puma):
    from skmtgp.datasets import make_puma560

    made = make_puma560(n_samples=30, n_loads=2, paths=[[0.4, 0.3, 0]], speeds=[5])
    model = RigidBodyRegressor(puma, empty_task=1).fit(made.data, made.target)
    variances = np.diagonal(model.load_covariance_[1])
    assert np.isfinite(variances[:4]).all()  # the tool keeps its orientation
    assert np.isinf(variances[4:]).all()
    assert np.isinf(model.parameters_["std"]).any()
    assert np.isfinite(model.predict(made.data, return_std=True)[1]).all()
    X = states(5)
    assert np.isinf(model.predict(X, return_std=True)[1]).any()
    bayes = RigidBodyRegressor(puma, empty_task=1, prior="evidence")
    bayes.fit(made.data, made.target)
    assert np.isfinite(bayes.load_covariance_).all()
    assert np.isfinite(bayes.predict(X, return_std=True)[1]).all()


def test_fewer_rows_than_parameters(puma, moved):
    X, Y, _ = moved
    with pytest.warns(UnidentifiedNoiseWarning, match="do not tell the noise"):
        model = RigidBodyRegressor(puma).fit(X[::240], Y[::240])
    np.testing.assert_allclose(model.predict(X[::240]), Y[::240], rtol=0, atol=1e-8)


def test_an_evidence_prior_helps_where_rows_are_few(puma, moved):
    X, Y, _ = moved
    rng = np.random.default_rng(0)
    some = rng.choice(len(X), 25, replace=False)
    noisy_Y = noisy(Y, 0.3 * Y.std(axis=0))
    errors = [
        np.mean(
            np.square(
                RigidBodyRegressor(puma, prior=prior)
                .fit(X[some], noisy_Y[some])
                .predict(X)
                - Y
            )
            / Y.var(axis=0)
        )
        for prior in (None, "evidence")
    ]
    assert errors[1] < 0.7 * errors[0]


@PRIOR
def test_a_new_load(puma, moved, prior):
    X, Y, loads = moved
    old = X[:, -1] < 4
    model = RigidBodyRegressor(puma, empty_task=1, prior=prior).fit(X[old], Y[old])
    few = np.flatnonzero(~old)[::3]
    joined = model.add_task(X[few], Y[few])
    assert model.tasks_.tolist() == [1, 2, 3]
    assert joined.tasks_.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(joined.predict(X), Y, rtol=0, atol=1e-7)
    pd.testing.assert_frame_equal(joined.parameters_, model.parameters_)
    true = loads["m"].to_numpy()[3] - loads["m"].to_numpy()[0]
    assert joined.load_parameters_.loc[4, "m"] == pytest.approx(true, abs=1e-7)
    assert joined.load_covariance_.shape == (4, 10, 10)
    with pytest.raises(ValueError, match="Task 4 is known already"):
        joined.add_task(X[few], Y[few])


@PRIOR
def test_the_first_load(puma, moved, prior):
    X, Y, loads = moved
    first, new = X[:, -1] == 1, np.flatnonzero(X[:, -1] == 4)
    model = RigidBodyRegressor(puma, prior=prior).fit(X[first], noisy(Y[first], 0.1))
    joined = model.add_task(X[new], Y[new])
    true = loads["m"].to_numpy()[3] - loads["m"].to_numpy()[0]
    assert joined.load_parameters_.loc[4, "m"] == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize("friction", [None, ["viscous", "asymmetric"]])
def test_the_first_load_of_a_robot_that_is_as_described(puma, friction):
    """Nothing differs from the description, so all priors around it are narrow."""
    robot, load = pin.buildModelFromXML(puma), pin.Inertia(1.0, np.zeros(3), np.eye(3))
    holding = robot.copy()
    holding.appendBodyToJoint(robot.njoints - 1, load, pin.SE3.Identity())
    moved = np.random.default_rng(0).uniform(-1.0, 1.0, (220, 3, robot.nv))
    X = np.column_stack([moved.reshape(220, -1), np.arange(220) >= 200])
    Y = [pin.rnea(robot, robot.createData(), *state) for state in moved[:200]]
    Y += [pin.rnea(holding, holding.createData(), *state) for state in moved[200:]]
    Y = noisy(np.array(Y), 0.05)
    model = RigidBodyRegressor(puma, prior="nominal", friction=friction)
    model = model.fit(X[:200], Y[:200]).add_task(X[200:], Y[200:])
    assert model.load_parameters_.loc[1, "m"] == pytest.approx(1.0, rel=0.05)


def test_a_new_load_by_the_book(puma, moved):
    X, Y, _ = moved
    Y = noisy(Y, 0.1)
    old = X[:, -1] < 4
    model = RigidBodyRegressor(puma, empty_task=1).fit(X[old], Y[old])
    new = X[~old][:20]
    found = model.add_task(new, Y[~old][:20], prior=None)
    empty = np.column_stack([new[:, :-1], np.ones(20)])
    left = Y[~old][:20] - model.predict(empty)
    columns = model._columns.of(new[:, :-1])[1]
    weights = 1.0 / np.sqrt(model.noise_variance_)
    A = (columns * weights[:, None]).reshape(120, 10)
    coef = np.linalg.lstsq(A, (left * weights).ravel(), rcond=None)[0]
    np.testing.assert_allclose(found.load_parameters_.loc[4], coef, rtol=1e-6)
    np.testing.assert_allclose(
        found.load_covariance_[3], np.linalg.inv(A.T @ A), rtol=1e-5, atol=1e-12
    )


def test_covariances_and_draws(puma, moved):
    X, Y, _ = moved
    model = RigidBodyRegressor(puma, empty_task=1).fit(X, noisy(Y, 0.2))
    Z = X[[0, 3, 400, 900, 1500]]
    mean, std = model.predict(Z, return_std=True)
    cov = model.predict(Z, return_cov=True)[1]
    assert cov.shape == (5, 5, 6)
    np.testing.assert_allclose(np.einsum("iij->ij", cov), std**2)
    draws = model.sample_y(Z, 4000, random_state=1)
    assert draws.shape == (5, 6, 4000)
    np.testing.assert_allclose(draws.mean(axis=2), mean, atol=0.1 * std.max())
    for j in range(6):
        np.testing.assert_allclose(
            np.cov(draws[:, j]), cov[:, :, j], atol=0.1 * cov[:, :, j].max()
        )
    lower, upper = model.predict_interval(Z, include_noise=False)
    np.testing.assert_allclose(upper - lower, 2 * 1.959964 * std, rtol=1e-5)


def test_labels_may_be_text_in_any_column(puma, moved):
    X, Y, _ = moved
    names = [f"{of}{j}" for of in ("q", "qd", "qdd") for j in range(1, 7)]
    frame = pd.DataFrame(X[:, :-1], columns=names)
    frame.insert(0, "load", np.array(["-", "a", "b", "c", "d"])[X[:, -1].astype(int)])
    options = {"task_feature": "load", "empty_task": "a"}
    model = RigidBodyRegressor(puma, **options).fit(frame, Y)
    np.testing.assert_allclose(model.predict(frame), Y, rtol=0, atol=1e-8)
    assert model.load_parameters_.index.tolist() == ["a", "b", "c", "d"]
    with pytest.raises(ValueError, match="Unknown task 'e'"):
        model.predict(frame.assign(load="e"))


def test_a_failed_fit_leaves_it_as_it_was(puma, fitted, moved):
    X, Y, _ = moved
    model = pickle.loads(pickle.dumps(fitted))
    expected = model.predict(X)
    with pytest.raises(ValueError, match="joint=9 is out of range"):
        model.set_params(joint=9).fit(X, Y[:, 0])
    np.testing.assert_array_equal(model.predict(X), expected)
    fresh = clone(fitted)
    assert not hasattr(fresh, "tasks_")
    assert fitted.score(X, Y) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("options", "columns", "message"),
    [
        ({}, [0, 1], "y has 2 columns, but must have a column for each joint.*Set j"),
        ({"joint": 1}, [0, 1], "y has 2 columns, but must have the torque of joint=1"),
        ({"empty_task": 9}, range(6), r"empty_task=9 is none of the tasks, \[1, 2, 3"),
        ({"prior": "flat"}, range(6), "The 'prior' parameter of RigidBodyRegressor mu"),
        ({"friction": "x"}, range(6), "friction='x' has 'x'"),
    ],
)
def test_errors(puma, moved, options, columns, message):
    X, Y, _ = moved
    with pytest.raises(ValueError, match=message):
        RigidBodyRegressor(puma, **options).fit(X, Y[:, columns])


def random_problem(n=60, p=4):
    rng = np.random.default_rng(1)
    A, beta = rng.normal(size=(n, p)), rng.normal(size=p)
    return A, beta, A @ beta + rng.normal(size=n)


def test_the_posterior_is_the_textbooks():
    A, _, b = random_problem()
    found = least_squares(A, b, 3.0)
    covariance = np.linalg.inv(A.T @ A + 3.0 * np.eye(4))
    np.testing.assert_allclose(found.covariance, covariance)
    np.testing.assert_allclose(found.coef, covariance @ A.T @ b)
    wide = least_squares(A[:2], b[:2], 3.0)
    covariance = np.linalg.inv(A[:2].T @ A[:2] + 3.0 * np.eye(4))
    np.testing.assert_allclose(wide.covariance, covariance)
    assert wide.blind.shape == (4, 0)
    assert least_squares(A[:2], b[:2]).blind.shape == (4, 2)


def test_the_prior_is_the_likeliest():
    A, _, b = random_problem()
    found = evidence(A, b).precision[0]

    def log_evidence(precision):
        covariance = A @ A.T / precision + np.eye(len(A))
        return multivariate_normal(np.zeros(len(A)), covariance).logpdf(b)

    values = [log_evidence(found * factor) for factor in (0.95, 1.0, 1.05)]
    assert values[1] > max(values[0], values[2])


def test_each_group_has_its_likeliest_prior():
    rng = np.random.default_rng(1)
    A, beta = rng.normal(size=(60, 4)), np.array([0.5, -1.0, 20.0, 10.0])
    b = A @ beta + rng.normal(size=60)
    found = evidence(A, b, groups=[np.arange(2), np.arange(2, 4)])
    np.testing.assert_array_equal(found.precision[[0, 2]], found.precision[[1, 3]])
    assert found.precision[2] != pytest.approx(found.precision[0], rel=0.1)

    def log_evidence(factors):
        covariance = A / (found.precision * np.repeat(factors, 2)) @ A.T + np.eye(
            len(A)
        )
        return multivariate_normal(np.zeros(len(A)), covariance).logpdf(b)

    best = log_evidence([1.0, 1.0])
    assert found.log_evidence == pytest.approx(best + 0.5 * len(b) * np.log(2 * np.pi))
    for factors in ([0.9, 1.0], [1.1, 1.0], [1.0, 0.9], [1.0, 1.1]):
        assert log_evidence(factors) < best


def sliding(backward, n=40):
    """An arm with friction that differs by direction, and its two levels by a prior."""
    urdf, X = two_joints("revolute", "revolute"), states(n, 2)
    X[:, -1], rates = 0.0, X[:, 2:4]
    Y = rnea(pin.buildModelFromXML(urdf), X)
    Y += rates + np.where(rates > 0.0, 2.0, -backward)
    return urdf, X, noisy(Y, 0.5)


@pytest.mark.parametrize("prior", ["evidence", "nominal"])
def test_directions_differ_by_as_much_as_rows_say(prior):
    levels = [f"coulomb{sign}({joint})" for joint in PAIR for sign in "+-"]
    gaps = []
    for backward in (2.0, 0.5):
        urdf, X, Y = sliding(backward)
        for own in (prior, None):
            value = RigidBodyRegressor(urdf, prior=own).fit(X, Y).parameters_["value"]
            gaps.append(-np.diff(value[levels].to_numpy().reshape(2, 2)).ravel())
    alike, free, differ, measured = np.abs(gaps)
    assert (alike < 0.1 * free).all()
    np.testing.assert_allclose(differ, measured, atol=0.2)


def test_a_nominal_prior_is_in_units_of_each_links_mass_and_extent(puma, moved):
    X, Y, _ = moved
    model = RigidBodyRegressor(puma, prior="nominal").fit(X[::9], Y[::9])
    columns, dynamics = model._columns, model._columns.dynamics
    m, *_, xx, _, yy, _, _, zz = dynamics.nominal.reshape(-1, 10)[2]
    extent = np.sqrt((xx + yy + zz) / (2 * m))
    expected = m * np.array([1.0, *[extent] * 3, *[extent**2] * 6])
    np.testing.assert_allclose(dynamics.sizes[20:30], expected)
    # the same torques as of links that vary on their own
    x = X[:3, :-1]
    whole = dynamics.regressor(x, range(6), range(60)).reshape(-1, 60) * dynamics.sizes
    base = columns.of(x)[0][:, :, : columns.n_links].reshape(18, -1) @ columns.spread
    np.testing.assert_allclose(base @ base.T, whole @ whole.T, rtol=1e-6, atol=1e-8)


def test_a_nominal_prior_needs_masses(moved):
    weightless = two_joints("revolute", "revolute").replace(
        'mass value="2"', 'mass value="0"'
    )
    assert weightless != two_joints("revolute", "revolute")
    with pytest.raises(
        ValueError, match="prior='nominal' needs the masses of the links"
    ):
        RigidBodyRegressor(weightless, prior="nominal").fit(
            states(20, 2), np.ones((20, 2))
        )


def test_one_joint_is_scikit_learns_bayesian_ridge():
    A, _, b = random_problem(200)
    solution, noise, _ = solve(A[:, None, :], b[:, None], evidence)
    model = BayesianRidge(
        fit_intercept=False, tol=1e-12, max_iter=10_000, alpha_1=0, alpha_2=0
    )
    model.set_params(lambda_1=0, lambda_2=0).fit(A, b)
    np.testing.assert_allclose(solution.coef, model.coef_, rtol=1e-4)
    np.testing.assert_allclose(noise, 1.0 / model.alpha_, rtol=1e-3)
    np.testing.assert_allclose(solution.covariance, model.sigma_, rtol=1e-2, atol=1e-6)


def test_what_data_do_not_show_is_the_models_own(puma):
    X = states(40)
    X[:, 6:18] = 0.0  # at rest: gravity alone
    Y = rnea(pin.buildModelFromXML(puma), X)
    near = RigidBodyRegressor(puma, friction=None, prior="nominal").fit(X, noisy(Y))
    none = RigidBodyRegressor(puma, friction=None, prior="evidence").fit(X, noisy(Y))
    Z = states(100, seed=1)
    expected = rnea(pin.buildModelFromXML(puma), Z)
    errors = [np.square(m.predict(Z) - expected).mean(axis=0) for m in (near, none)]
    assert (errors[0] < 0.1 * errors[1]).all()
    nominal = RigidBodyFeatures(puma, joint=0, friction=None).fit(X)
    names = nominal.get_feature_names_out()[:-1]
    found = near.parameters_["value"][["I_xy(joint6)"]]
    position = names.tolist().index("I_xy(joint6)")
    assert found.iloc[0] == pytest.approx(nominal.nominal_[position], abs=1e-6)


def test_variances_of_what_hardly_shows_have_a_sign(puma, moved):
    X, Y, _ = moved
    model = RigidBodyRegressor(puma, joint=0, prior="evidence").fit(X[::9], Y[::9, 0])
    mean, std = model.predict(X, return_std=True)
    assert (std >= 0.0).all()
    assert mean.shape == std.shape


def test_columns_in_another_order(puma, moved):
    """Their names tell it."""
    X, Y, _ = moved
    names = [f"{kind}{j}" for kind in ("q", "qd", "qdd") for j in range(1, 7)]
    frame = pd.DataFrame(X, columns=[*names, "load"])
    assert RigidBodyRegressor(puma).fit(frame, Y).feature_names_in_[0] == "q1"
    swapped = frame[[*names[6:12], *names[:6], *names[12:], "load"]]
    for make in (RigidBodyRegressor(puma), RigidBodyFeatures(puma, joint=0)):
        with pytest.raises(ValueError, match="positions of all joints first"):
            make.fit(swapped, Y)


def test_which_load_it_is(fitted, moved):
    """TaskIdentifier does not take it, and says what does."""
    X, Y, loads = moved
    with pytest.raises(TypeError, match=r"add_task\(X, y\).load_parameters_ tells"):
        TaskIdentifier(fitted).predict(X[:5], Y[:5])
    rows = np.flatnonzero(X[:, -1] == 3)[1::2]
    unknown = np.column_stack([X[rows, :-1], np.full(len(rows), 99)])
    found = fitted.add_task(unknown, Y[rows]).load_parameters_.loc[99]
    expected = loads[INERTIAL].to_numpy()[2] - loads[INERTIAL].to_numpy()[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
