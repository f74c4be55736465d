"""Rigid bodies and a process of what they leave, against the textbook's formulae."""

import pickle

import numpy as np
import pandas as pd
import pytest
from rigid import rnea, states, two_joints
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.model_selection import GridSearchCV

from skmtgp import MultiTaskGPRegressor
from skmtgp.datasets import make_puma560
from skmtgp.robot import (
    RigidBodyRegressor,
    SemiparametricRegressor,
    make_semiparametric_regressor,
)

pin = pytest.importorskip("pinocchio")
QUICK = MultiTaskGPRegressor(rank=1, shared=True, noise="shared", learning="staged")
PRIOR = pytest.mark.parametrize("prior", [None, "evidence", "nominal"])


@pytest.fixture(scope="module")
def sticky():
    """Joints that stick, under three loads: states and torques."""
    options = {"stribeck": 0.5, "load_friction": 0.05, "noise": 0.02}
    made = make_puma560(n_samples=12, masses=[0.5, 1.0, 2.0], **options)
    rows = np.random.default_rng(0).permutation(len(made.data))
    return made.data[rows], made.target[rows]


@pytest.fixture(scope="module")
def fitted(puma, sticky):
    X, Y = sticky
    return SemiparametricRegressor(puma, empty_task=1).fit(X[:120], Y[:120])


def arm(n=60, seed=0, noise=0.05):
    """A robot of two joints, whose friction no law has, under two loads."""
    urdf, X = two_joints("revolute", "revolute"), states(n, 2, seed)
    X[:, -1] = np.arange(n) % 2
    Y = rnea(pin.buildModelFromXML(urdf), X)
    Y += X[:, 2:4] + 0.8 * np.sin(3.0 * X[:, 2:4]) * (1.0 + X[:, [-1]])
    return urdf, X, Y + noise * np.random.default_rng(seed).normal(size=Y.shape)


@pytest.fixture(scope="module")
def of_arm():
    urdf, X, Y = arm()
    return SemiparametricRegressor(urdf, estimator=QUICK).fit(X, Y)


def test_it_is_better_than_rigid_bodies_where_joints_stick(puma, sticky, fitted):
    X, Y = sticky
    rigid = RigidBodyRegressor(puma, empty_task=1).fit(X[:120], Y[:120])
    errors = [
        np.mean(np.square(model.predict(X[120:]) - Y[120:]), axis=0)
        for model in (fitted, rigid)
    ]
    assert (errors[0] < errors[1]).all()
    assert np.exp(np.mean(np.log(errors[0] / errors[1]))) < 0.2


def test_unknown_arguments_name_the_public_class(puma, moved):
    for cls in (RigidBodyRegressor, SemiparametricRegressor):
        match = rf"^{cls.__name__}\.fit\(\) got an unexpected keyword argument 'foo'"
        with pytest.raises(TypeError, match=match):
            cls(puma).fit(*moved[:2], foo=1)


def test_rigid_bodies_that_are_exact_stay_exact(puma, moved):
    X, Y, loads = moved
    model = SemiparametricRegressor(puma, empty_task=1).fit(X[::4], Y[::4])
    assert (model.summary()["rest"] == "none").all()
    np.testing.assert_allclose(model.predict(X), Y, rtol=0, atol=1e-8)
    expected = loads["m"].to_numpy() - loads["m"].to_numpy()[0]
    np.testing.assert_allclose(model.load_parameters_["m"], expected, atol=1e-8)


def test_noise_is_no_process(puma, moved):
    X, Y, _ = moved
    Y = Y[:, 2] + np.random.default_rng(0).normal(size=len(Y))
    model = SemiparametricRegressor(puma, joint=2).fit(X[::8], Y[::8])
    rigid = RigidBodyRegressor(puma, joint=2, prior="evidence").fit(X[::8], Y[::8])
    assert model.estimators_ == [None]
    np.testing.assert_allclose(model.predict(X), rigid.predict(X), rtol=1e-3, atol=0.01)
    assert model.noise_variance_ == pytest.approx(rigid.noise_variance_, rel=1e-2)


def dense(model, X):
    """Covariance of the torques of two sets of rows, joint after joint, without noise.

    Of the prior: coefficients of variance 1 / precision, and the processes.
    """
    codes = np.searchsorted(model.tasks_, X[:, -1])
    design = model._whole(X[:, :-1], codes) @ model._matrix
    design = design.swapaxes(0, 1).reshape(-1, design.shape[2])
    K = design / model._precision @ design.T
    parts = [
        rest.covariance(rows, rows) if rows else np.zeros((len(X), len(X)))
        for rest, rows in zip(
            model._rests, model._inputs(X[:, :-1], codes), strict=True
        )
    ]
    return K + block_diag(*parts)


@pytest.mark.parametrize("joint", [None, 0])
def test_predictions_are_those_of_one_normal_distribution(of_arm, joint):
    urdf, X, Y = arm()
    test, model = arm(8, seed=1)[1], of_arm
    if joint is not None:
        Y = Y[:, joint]
        model = SemiparametricRegressor(urdf, joint=joint, estimator=QUICK).fit(X, Y)
    assert all(rest.model for rest in model._rests)
    both = np.vstack([X, test])
    J, n, m = Y.reshape(len(X), -1).shape[1], len(X), len(both)
    K = dense(model, both).reshape(J, m, J, m)
    known = K[:, :n, :, :n].reshape(J * n, J * n)
    known += np.diag(np.repeat(np.atleast_1d(model.noise_variance_), n))
    cross = K[:, n:, :, :n].reshape(-1, J * n)
    expected = cross @ np.linalg.solve(known, Y.T.ravel())
    mean, cov = model.predict(test, return_cov=True)
    np.testing.assert_allclose(mean.T.ravel(), expected, rtol=1e-5, atol=1e-6)
    posterior = K[:, n:, :, n:].reshape(J * 8, J * 8)
    posterior = posterior - cross @ np.linalg.solve(known, cross.T)
    for j in range(J):
        block = posterior[8 * j : 8 * j + 8, 8 * j : 8 * j + 8]
        found = cov if joint is not None else cov[:, :, j]
        np.testing.assert_allclose(found, block, rtol=1e-4, atol=1e-6)
    std = model.predict(test, return_std=True)[1]
    diagonal = cov if joint is not None else np.moveaxis(cov, 2, 0)
    np.testing.assert_allclose(
        std.T**2, np.diagonal(diagonal, axis1=-2, axis2=-1), rtol=1e-9
    )


def test_chunks_of_predictions_are_one(fitted, sticky, monkeypatch):
    X = sticky[0][120:150]
    expected = fitted.predict(X, return_std=True)
    monkeypatch.setattr("skmtgp.robot._semiparametric.CHUNK", 7)
    np.testing.assert_allclose(fitted.predict(X, return_std=True), expected)


def test_draws_have_the_covariance(fitted, sticky):
    X = sticky[0][120:124]
    cov = fitted.predict(X, return_cov=True)[1]
    draws = fitted.sample_y(X, 4000, random_state=0)
    assert draws.shape == (4, 6, 4000)
    for j in range(6):
        np.testing.assert_allclose(
            np.cov(draws[:, j]), cov[:, :, j], atol=0.1 * cov[:, :, j].max()
        )


def test_intervals_hold(fitted, sticky):
    X, Y = sticky[0][120:], sticky[1][120:]
    lower, upper = fitted.predict_interval(X)
    inside = ((lower < Y) & (upper > Y)).mean()
    assert 0.88 < inside <= 1.0
    std = fitted.predict(X, return_std=True)[1]
    noisy = fitted.predict(X, return_std=True, include_noise=True)[1]
    np.testing.assert_allclose(noisy**2 - std**2, fitted.noise_variance_ + 0 * Y)


def test_far_outside_the_process_keeps_its_value(of_arm):
    far = arm()[1][:1]
    far[:, 2:4] = 50.0
    farther = far.copy()
    farther[:, 2:4] = 70.0
    values = [of_arm._processes(rows[:, :-1], np.array([0])) for rows in (far, farther)]
    assert (np.abs(values[0]) > 0.1).all()
    np.testing.assert_allclose(values[0], values[1])


def test_friction_in_a_direction_that_no_row_has():
    urdf, X, Y = arm(240, noise=0.01)
    rates = X[:, 2:4]
    forward, back = ((sign * rates > 0.0).all(axis=1) for sign in (1, -1))
    options = {"rest": "friction", "friction": ["viscous", "coulomb"]}
    model = SemiparametricRegressor(urdf, estimator=QUICK, **options)
    model = model.fit(X[forward], Y[forward])
    rigid = RigidBodyRegressor(urdf, friction=options["friction"])
    rigid = rigid.fit(X[forward], Y[forward])
    own, alone = (
        np.square(of.predict(X[back]) - Y[back]).mean(axis=0) for of in (model, rigid)
    )
    assert (own < 0.2 * alone).all()


@pytest.mark.parametrize("backward", [1.0, 3.0])
def test_a_process_is_the_same_in_both_directions_unless_rows_say_more(backward):
    urdf, X, Y = arm(120, noise=0.02)
    rates = X[:, 2:4]
    Y += np.where(rates < 0.0, (backward - 1.0) * 0.8 * np.sin(3.0 * rates), 0.0)
    options = {"rest": "friction", "joint": 1, "estimator": QUICK}
    (rest,) = SemiparametricRegressor(urdf, **options).fit(X, Y[:, 1])._rests
    speed_and_torque, factor, differs = 2, 1, backward != 1.0
    assert rest.features.of_words[0].width == speed_and_torque + factor + differs


@PRIOR
def test_priors(puma, sticky, prior):
    X, Y = sticky
    model = SemiparametricRegressor(puma, joint=3, prior=prior).fit(X[:90], Y[:90, 3])
    assert model.score(X[90:], Y[90:, 3]) > 0.99


def test_summary_and_results(fitted, sticky):
    summary, results = fitted.summary(), fitted.results_
    assert summary.index.tolist() == [f"joint{j}" for j in range(1, 7)]
    columns = ["links", "friction", "load", "process", "noise", "rest", "gain"]
    assert summary.columns.tolist() == columns
    words = ["none", "friction", "neighbours", "friction+neighbours"]
    assert results["rest"].tolist() == words * 6
    assert results.groupby("joint")["chosen"].sum().eq(1).all()
    best = results[results["chosen"]].set_index("joint")
    none = results[results["rest"] == "none"].set_index("joint")
    np.testing.assert_allclose(summary["gain"], 0.5 * (none["bic"] - best["bic"]))
    assert summary["rest"].tolist() == best["rest"].tolist()
    X, Y = sticky[0][:120], sticky[1][:120]
    left = Y - fitted.predict(X)
    np.testing.assert_allclose(left.std(axis=0), summary["noise"], rtol=0.8)
    np.testing.assert_allclose(summary["noise"] ** 2, fitted.noise_variance_)
    assert [e is None for e in fitted.estimators_] == (
        summary["rest"] == "none"
    ).tolist()


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_new_load(puma, sticky):
    X, Y = sticky
    old, new = np.flatnonzero(X[:, -1] < 3)[:90], np.flatnonzero(X[:, -1] == 3)
    quick = clone(QUICK).set_params(max_iter=5)
    model = SemiparametricRegressor(puma, empty_task=1, estimator=quick)
    before = model.fit(X[old], Y[old]).predict(X[old])
    joined = model.add_task(X[new[:12]], Y[new[:12]])
    assert joined.tasks_.tolist() == [1, 2, 3]
    assert joined.load_parameters_.loc[3, "m"] == pytest.approx(1.5, abs=0.1)
    rest = new[12:]
    error = np.mean(np.square(joined.predict(X[rest]) - Y[rest]), axis=0)
    assert (error / Y[rest].var(axis=0) < 0.02).all()
    assert joined.predict(X[rest], return_std=True)[1].shape == (len(rest), 6)
    np.testing.assert_array_equal(model.predict(X[old]), before)
    assert model.tasks_.tolist() == [1, 2]
    with pytest.raises(ValueError, match="Task 3 is known already"):
        joined.add_task(X[new[:2]], Y[new[:2]])


def test_a_new_load_is_one_normal_distribution_too(of_arm):
    _, X, Y = arm()
    test, new = arm(8, seed=1)[1], arm(10, seed=2)
    X_new = new[1]
    X_new[:, -1], test[:, -1] = 7, 7
    model = of_arm.add_task(X_new, new[2])
    rows, targets = np.vstack([X, X_new]), np.vstack([Y, new[2]])
    both = np.vstack([rows, test])
    n, m = len(rows), len(both)
    K = dense(model, both).reshape(2, m, 2, m)
    known = K[:, :n, :, :n].reshape(2 * n, 2 * n)
    known += np.diag(np.repeat(model.noise_variance_, n))
    cross = K[:, n:, :, :n].reshape(-1, 2 * n)
    expected = cross @ np.linalg.solve(known, targets.T.ravel())
    found = model.predict(test).T.ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-2)


class Told(SemiparametricRegressor):
    """Keeps the deviance that each start reaches."""

    def _learned_from(self, start, *options):
        found = super()._learned_from(start, *options)
        vars(self).setdefault("told_", []).append((start, found[0]))
        return found


def test_the_likelier_start_is_kept():
    urdf, X, Y = arm()
    model = Told(urdf, prior="nominal", estimator=QUICK)
    starts, deviances = zip(*model.fit(X, Y).told_, strict=True)
    assert len(starts) == 2
    n = model._columns.n_links
    np.testing.assert_array_equal(starts[1][:n], model._centre[:n])
    assert model._deviance() == min(deviances)
    K = dense(model, X) + np.diag(np.repeat(model.noise_variance_, len(X)))
    left = Y - model._whole(X[:, :-1], X[:, -1].astype(int)) @ model._centre
    likelihood = multivariate_normal(np.zeros(Y.size), K).logpdf(left.T.ravel())
    chosen = model.results_[model.results_["chosen"]]
    price = np.log(len(X)) * chosen["n_hyperparameters"].sum()
    expected = price - 2.0 * likelihood - Y.size * np.log(2.0 * np.pi)
    assert model._deviance() == pytest.approx(expected)


def test_links_do_not_take_errors_that_neighbours_have_in_common():
    urdf, time = two_joints("revolute", "revolute"), np.linspace(0.0, 3.0, 80)
    angle = 1.5 * time[:, None] + [0.0, 0.3]
    q, qd, qdd = 0.6 * np.sin(angle), 0.9 * np.cos(angle), -1.35 * np.sin(angle)
    X = np.column_stack([q, qd, qdd, np.zeros(80)])
    covariance = np.exp(-np.abs(time[:, None] - time) / 0.2)
    errors = np.random.default_rng(0).multivariate_normal(np.zeros(80), covariance, 2)
    robot, Z = pin.buildModelFromXML(urdf), states(60, 2, seed=4)
    Y, Z[:, -1] = rnea(robot, X) + errors.T, 0.0
    options = {"friction": None, "prior": "nominal", "estimator": QUICK}
    models = [
        SemiparametricRegressor(urdf, rest=rest, **options).fit(X, Y)
        for rest in ("neighbours", None)
    ]
    assert models[0].summary()["rest"].tolist() == ["neighbours"] * 2
    own, alone = (np.square(m.predict(Z) - rnea(robot, Z)).mean() for m in models)
    assert own < 0.5 * alone


def test_errors_in_common_leave_coulomb_friction_to_its_law(monkeypatch):
    urdf, time = two_joints("revolute", "revolute"), np.linspace(0.0, 3.0, 80)
    angle = 2.0 * time[:, None] + [0.0, 0.3]
    q, qd, qdd = 0.6 * np.sin(angle), 1.2 * np.cos(angle), -2.4 * np.sin(angle)
    X = np.column_stack([q, qd, qdd, np.zeros(80)])
    steps = np.random.default_rng(0).standard_normal((80, 2)) / np.sqrt(80)
    Y = rnea(pin.buildModelFromXML(urdf), X) + np.cumsum(steps, axis=0) + np.sign(qd)
    options = {"friction": "coulomb", "rest": "neighbours", "prior": "nominal"}
    model = SemiparametricRegressor(urdf, estimator=QUICK, **options)
    law = model.fit(X, Y).parameters_["value"].tail(2)  # 1 is right
    monkeypatch.setattr("skmtgp.robot._rest.NEAR_BOUNDS", (0.02, 1e3))
    less = model.fit(X, Y).parameters_["value"].tail(2)
    assert (law > [0.8, 0.4]).all()
    assert less.iloc[1] < 0.6 * law.iloc[1]


def test_a_single_task_without_a_load(puma, sticky):
    X, Y = sticky
    one = np.flatnonzero(X[:, -1] == 2)
    model = SemiparametricRegressor(puma, estimator=QUICK).fit(X[one[:60]], Y[one[:60]])
    assert not model.load_parameters_.to_numpy().any()
    assert model.score(X[one[60:]], Y[one[60:]]) > 0.98


def test_copies_and_clones(fitted, sticky):
    X = sticky[0][:20]
    copied = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(copied.predict(X), fitted.predict(X))
    fresh = clone(fitted)
    assert not hasattr(fresh, "tasks_")
    with pytest.raises(NotFittedError):
        fresh.summary()
    assert fresh.get_params(deep=False) == fitted.get_params(deep=False)


def test_frames_with_named_loads():
    urdf, X, Y = arm()
    names = ["q1", "q2", "qd1", "qd2", "qdd1", "qdd2"]
    frame = pd.DataFrame(X[:, :-1], columns=names)
    frame.insert(0, "load", np.array(["empty", "full"])[X[:, -1].astype(int)])
    options = {"joint": 1, "estimator": QUICK}
    numbered = SemiparametricRegressor(urdf, empty_task=0, **options).fit(X, Y[:, 1])
    options |= {"task_feature": "load", "empty_task": "empty"}
    named = SemiparametricRegressor(urdf, **options).fit(frame, Y[:, 1])
    np.testing.assert_allclose(named.predict(frame), numbered.predict(X))
    assert named.load_parameters_.index.tolist() == ["empty", "full"]


def test_a_search_has_its_parameters():
    urdf, X, Y = arm(40)
    model = make_semiparametric_regressor(urdf, joint=1, estimator=QUICK)
    grid = {"rest": [None, "friction"], "estimator__shared": [False, True]}
    search = GridSearchCV(model, grid, cv=2, error_score="raise").fit(X, Y[:, 1])
    assert set(search.best_params_) == set(grid)
    assert search.predict(X).shape == (40,)


def test_the_process_is_the_users():
    urdf, X, Y = arm()
    process = MultiTaskGPRegressor(rank=2, noise="per_task")
    model = SemiparametricRegressor(urdf, joint=0, estimator=process).fit(X, Y[:, 0])
    (learned,) = model.estimators_
    assert (learned.rank, learned.noise_, learned.task_levels) == (2, "per_task", False)
    assert process.task_levels
    assert process.kernel is None
    std = model.predict(X[:4], return_std=True, include_noise=True)[1]
    alone = model.predict(X[:4], return_std=True)[1]
    expected = learned.noise_variance_[X[:4, -1].astype(int)]
    np.testing.assert_allclose(std**2 - alone**2, expected)
    first = X[X[:, -1] == 0][:3]  # rows of one task alone
    std = model.predict(first, return_std=True, include_noise=True)[1]
    assert (std**2 >= learned.noise_variance_[0]).all()


def test_without_a_rest_it_is_rigid_bodies(puma, sticky):
    X, Y = sticky
    model = SemiparametricRegressor(puma, rest=None, prior=None).fit(X[:90], Y[:90])
    rigid = RigidBodyRegressor(puma).fit(X[:90], Y[:90])
    np.testing.assert_allclose(
        model.predict(X), rigid.predict(X), rtol=0, atol=1e-2 * Y.std()
    )
    assert model.results_["rest"].tolist() == ["none"] * 6


def test_a_torque_of_zero_is_no_process():
    urdf, X, _ = arm()
    model = SemiparametricRegressor(urdf, joint=0).fit(X, np.zeros(len(X)))
    assert model.summary()["rest"].tolist() == ["none"]
    mean, std = model.predict(X, return_std=True, include_noise=True)
    np.testing.assert_allclose(mean, 0.0, atol=1e-9)
    assert np.isfinite(std).all()


def test_several_rests_by_leaving_out():
    urdf, X, Y = arm(40)
    rests = ["friction", "states"]
    model = SemiparametricRegressor(urdf, joint=1, rest=rests, criterion="loo")
    model.fit(X, Y[:, 1])
    assert model.results_["rest"].tolist() == ["none", *rests]
    assert model.results_["loo"].idxmin() == model.results_["chosen"].idxmax()


def test_a_failed_fit_leaves_it_as_it_was():
    urdf, X, Y = arm(40)
    model = SemiparametricRegressor(urdf, joint=1, estimator=QUICK).fit(X, Y[:, 1])
    expected = model.predict(X)
    with pytest.raises(ValueError, match="rest='x' has 'x'"):
        model.set_params(rest="x").fit(X, Y[:, 1])
    np.testing.assert_array_equal(model.predict(X), expected)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"rest": "magic"}, ValueError, "rest='magic' has 'magic'; it must be of 'fri"),
        ({"criterion": "aic"}, ValueError, "'criterion' parameter of Semiparametric"),
        ({"estimator": 3}, ValueError, "'estimator' parameter of Semiparametric"),
        ({"prior": "flat"}, ValueError, "'prior' parameter of Semiparametric"),
        ({"joint": 2}, ValueError, "joint=2 is out of range: the model has 2 joints"),
        ({"joint": 1}, ValueError, "y has 2 columns, but must have the torque of joi"),
        ({"empty_task": 5}, ValueError, "empty_task=5 is none of the tasks"),
        ({"friction": "x"}, ValueError, "friction='x' has 'x'"),
    ],
)
def test_errors(options, error, message):
    urdf, X, Y = arm(20)
    with pytest.raises(error, match=message):
        SemiparametricRegressor(urdf, **options).fit(X, Y)


def test_warnings_name_the_joint():
    urdf, X, Y = arm()
    process = MultiTaskGPRegressor(rank=1, max_iter=1)
    options = {"rest": "friction", "estimator": process}
    model = SemiparametricRegressor(urdf, joint="slide", **options)
    with pytest.warns(ConvergenceWarning, match="^Rest of 'slide': "):
        model.fit(X, Y[:, 1])
    assert model.summary()["rest"].tolist() == ["friction"]
