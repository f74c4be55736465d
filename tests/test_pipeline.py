import pickle
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import ColumnTransformer
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import RBF
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    add_task,
    compile_predictor,
    make_inverse_dynamics_regressor,
    partial_fit,
)
from skmtgp.datasets import load_puma560, puma560_urdf
from skmtgp.kernels import (
    geometric_inverse_dynamics_kernel,
    inverse_dynamics_kernel,
)
from skmtgp.preprocessing import InverseDynamicsFeatures
from skmtgp.robot import SemiparametricRegressor

LOADS = {"n_per_load": 8, "loads": [1, 2, 5]}
X, Y = load_puma560(**LOADS, return_X_y=True)
FRAME, TARGETS = load_puma560(**LOADS, return_X_y=True, as_frame=True)
QUICK = {"max_iter": 3}
STAGED = {"learning": "staged", **QUICK}  # from one start
ESTIMATORS = {
    "mGP": MultiTaskGPRegressor(rank=2, **STAGED),
    "mGP-BIC": RankSearchIC(MultiTaskGPRegressor(**STAGED), ranks=(1, 2)),
    "iGP": IndependentGP(**QUICK),
    "pGP": PooledGP(**QUICK),
    "sGP": SingleTaskGP(**QUICK),
}
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_arrays_and_frames_with_named_loads(estimator):
    model = make_inverse_dynamics_regressor(estimator)
    numbered = clone(model).fit(X, Y[:, 0]).predict(X)
    assert numbered.shape == (24,)
    assert np.ptp(numbered) > 0.1 * np.ptp(Y[:, 0])
    named = clone(model).fit(FRAME, TARGETS["tau1"])
    np.testing.assert_allclose(named.predict(FRAME), numbered, rtol=1e-12)
    fitted = getattr(named[-1], "best_estimator_", named[-1])
    assert fitted.tasks_.tolist() == ["c1", "c2", "c5"]


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_pipeline_is_its_parts(estimator):
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, :2])
    features = InverseDynamicsFeatures(6).fit(X)
    alone = clone(estimator)
    nested = isinstance(alone, RankSearchIC)
    kernel = "estimator__kernel" if nested else "kernel"
    alone.set_params(**{kernel: inverse_dynamics_kernel(6)})
    alone.fit(features.transform(X), Y[:, :2])
    found = model.predict(X, return_std=True)
    expected = alone.predict(features.transform(X), return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_default_is_the_rank_search_of_the_paper():
    model = make_inverse_dynamics_regressor()
    search = model[-1]
    assert list(model.named_steps) == ["features", "regressor"]
    assert isinstance(search, RankSearchIC)
    assert (search.ranks, search.criterion) == ((2, 4, 5, 6, 8, 10), "bic")
    assert search.estimator.kernel == inverse_dynamics_kernel(6)
    assert model[0].n_joints == 6


def test_kernels_by_name():
    geometric = make_inverse_dynamics_regressor(PooledGP(), kernel="geometric")
    assert geometric[-1].kernel == geometric_inverse_dynamics_kernel("RRRRRR")
    options = {"n_joints": 2, "joint_types": "RP"}
    trigonometric = make_inverse_dynamics_regressor(
        PooledGP(), kernel="trigonometric", **options
    )
    expected = inverse_dynamics_kernel(2, angles="trigonometric", joint_types="RP")
    assert trigonometric[-1].kernel == expected
    assert (trigonometric[0].angles, trigonometric[0].joint_types) == (
        "trigonometric",
        "RP",
    )
    paper = make_inverse_dynamics_regressor(PooledGP(), kernel="paper", **options)
    assert paper[-1].kernel == inverse_dynamics_kernel(2)
    assert paper[0].angles == "radians"


def test_kernel_of_a_joint():
    options = {"n_joints": 3, "joint_types": "RPR", "joint": 1}
    model = make_inverse_dynamics_regressor(PooledGP(), kernel="geometric", **options)
    expected = geometric_inverse_dynamics_kernel("RPR", joint=1)
    assert model[-1].kernel == expected
    for kernel in ("paper", "trigonometric"):
        message = f"joint=1 needs kernel='geometric' or 'rigid-body', not '{kernel}'"
        with pytest.raises(ValueError, match=message):
            make_inverse_dynamics_regressor(kernel=kernel, joint=1)


@pytest.mark.parametrize("kernel", ["geometric", "trigonometric"])
def test_other_kernels_learn_and_predict(kernel):
    model = MultiTaskGPRegressor(rank=2, learning="staged", max_iter=20)
    model = make_inverse_dynamics_regressor(model, kernel=kernel).fit(X, Y[:, 1])
    assert abs(model.predict(X) - Y[:, 1]).max() < 0.1 * np.ptp(Y[:, 1])
    K, n = model[-1].kernel_(model[0].transform(X)[:, :-1]), len(X)
    assert K.shape == (n, n)


def test_a_robot_that_is_described():
    pytest.importorskip("pinocchio")
    urdf, process = puma560_urdf(), MultiTaskGPRegressor(rank=2)
    model = make_inverse_dynamics_regressor(
        process, kernel="rigid-body", robot=urdf, joint=3, task_feature="load"
    )
    assert isinstance(model[-1], SemiparametricRegressor)
    found = model[-1].get_params()
    expected = {"model": urdf, "joint": 3, "task_feature": "load", "estimator__rank": 2}
    assert expected.items() <= found.items()
    model = make_inverse_dynamics_regressor(kernel="rigid-body", robot=urdf)
    model.fit(X, Y)
    assert abs(model.predict(X) - Y).max() < 1e-8
    new, torque = load_puma560(n_per_load=4, loads=[9], return_X_y=True)
    assert add_task(model, new, torque)[-1].tasks_.tolist() == [1, 2, 5, 9]


def test_only_one_kernel_has_a_robot():
    with pytest.raises(ValueError, match="'rigid-body' needs robot, a URDF or a Pin"):
        make_inverse_dynamics_regressor(kernel="rigid-body")
    with pytest.raises(ValueError, match=r"task_descriptors=\[18\] cannot go with"):
        make_inverse_dynamics_regressor(
            kernel="rigid-body", robot="arm.urdf", task_descriptors=[18]
        )
    with pytest.raises(ValueError, match="needs kernel='rigid-body', not 'paper'"):
        make_inverse_dynamics_regressor(robot="arm.urdf")
    with pytest.raises(TypeError, match="must be a MultiTaskGPRegressor or None for"):
        make_inverse_dynamics_regressor(PooledGP(), kernel="rigid-body", robot="a")


@pytest.mark.parametrize("kernel", ["rigid", "SE", None, RBF()])
def test_kernels_without_a_name(kernel):
    message = "must be one of 'paper', 'geometric', 'trigonometric'"
    with pytest.raises(ValueError, match=message):
        make_inverse_dynamics_regressor(kernel=kernel)


@pytest.mark.parametrize("kernel", ["paper", "geometric", "trigonometric"])
def test_types_of_other_joints(kernel):
    with pytest.raises(ValueError, match="of 2 joints, but there are 6"):
        make_inverse_dynamics_regressor(kernel=kernel, joint_types="RP")
    with pytest.raises(ValueError, match="n_joints='6' must be a positive integer"):
        make_inverse_dynamics_regressor(kernel=kernel, n_joints="6")


def test_kernel_of_the_user_is_kept():
    for estimator in (PooledGP(RBF()), RankSearchIC(MultiTaskGPRegressor(RBF()))):
        regressor = make_inverse_dynamics_regressor(estimator)[-1]
        assert getattr(regressor, "estimator", regressor).kernel == RBF()


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_estimator_of_the_user_is_left_alone(estimator):
    before = repr(estimator)
    regressor = make_inverse_dynamics_regressor(estimator)[-1]
    assert regressor is not estimator
    assert repr(estimator) == before
    assert getattr(estimator, "estimator", estimator).kernel is None


@pytest.mark.parametrize("pooled", [False, True])
def test_linear_regression_has_no_kernel(pooled):
    estimator = BayesianLinearRegression(pooled=pooled, task_feature=0)
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, :2])
    assert (model[-1].task_feature, estimator.task_feature) == (-1, 0)
    assert model[-1].tasks_.tolist() == [1, 2, 5]
    features = InverseDynamicsFeatures(6).fit_transform(X)
    alone = clone(estimator).set_params(task_feature=-1).fit(features, Y[:, :2])
    assert alone.coef_.shape == (2, 3, 24)  # (x, sgn(qd)); the constant is apart
    found = model.predict(X, return_std=True)
    expected = alone.predict(features, return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_other_estimators_are_refused():
    message = "must be a MultiTaskGPRegressor, .* BayesianLinearRegression or Rank"
    with pytest.raises(TypeError, match=message):
        make_inverse_dynamics_regressor(InverseDynamicsFeatures())


def test_task_in_another_column():
    moved = np.column_stack([X[:, -1], X[:, :-1]])
    last = make_inverse_dynamics_regressor(PooledGP(**QUICK))
    first = make_inverse_dynamics_regressor(PooledGP(**QUICK), task_feature=0)
    expected = last.fit(X, Y[:, 0]).predict(X)
    np.testing.assert_allclose(first.fit(moved, Y[:, 0]).predict(moved), expected)
    named = make_inverse_dynamics_regressor(PooledGP(**QUICK), task_feature="load")
    frame = FRAME[["load", *FRAME.columns[:-1]]]
    np.testing.assert_allclose(named.fit(frame, Y[:, 0]).predict(frame), expected)


@pytest.mark.parametrize(
    "estimator",
    [
        PooledGP(task_feature=0, **QUICK),
        RankSearchIC(MultiTaskGPRegressor(task_feature="load", **QUICK), ranks=[1]),
    ],
)
def test_task_is_last_for_the_regressor(estimator):
    model = make_inverse_dynamics_regressor(estimator).fit(X, Y[:, 0])
    fitted = getattr(model[-1], "best_estimator_", model[-1])
    assert fitted.tasks_.tolist() == [1, 2, 5]


def test_another_number_of_joints():
    two = X[:, [0, 1, 6, 7, 12, 13, 18]]
    model = make_inverse_dynamics_regressor(PooledGP(**QUICK), n_joints=2)
    assert model.fit(two, Y[:, 0]).predict(two).shape == (24,)
    with pytest.raises(ValueError, match="X has 19 columns, but n_joints=2 needs 7"):
        model.fit(X, Y[:, 0])


def test_grid_search_over_nested_parameters():
    rows = np.arange(24)  # both halves have samples of every load
    halves = [(rows[k::2], rows[1 - k :: 2]) for k in (0, 1)]
    model = make_inverse_dynamics_regressor(MultiTaskGPRegressor(max_iter=0))
    grid = {"regressor__rank": [1, 2], "regressor__noise_variance": [1e-3, 100.0]}
    search = GridSearchCV(model, grid, cv=halves).fit(FRAME, TARGETS["tau1"])
    assert search.best_params_["regressor__noise_variance"] == 1e-3
    assert search.best_estimator_[-1].rank_ == search.best_params_["regressor__rank"]
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()


NEW = {"n_per_load": 3, "loads": [9]}
X_NEW, Y_NEW = load_puma560(**NEW, return_X_y=True)
FRAME_NEW, TARGETS_NEW = load_puma560(**NEW, return_X_y=True, as_frame=True)


def scaled(estimator):
    """Features are scaled, the load is passed through and stays last."""
    scaler = ColumnTransformer(
        [("states", StandardScaler(), slice(18))], remainder="passthrough"
    )
    return make_pipeline(scaler, estimator)


MODELS = {
    "estimator": clone(ESTIMATORS["mGP"]),
    "search": clone(ESTIMATORS["mGP-BIC"]),
    "scaler": scaled(clone(ESTIMATORS["mGP"])),
    "scaler, search": scaled(clone(ESTIMATORS["mGP-BIC"])),
    "features": make_inverse_dynamics_regressor(ESTIMATORS["mGP"]),
    "features, search": make_inverse_dynamics_regressor(ESTIMATORS["mGP-BIC"]),
    "nested": Pipeline(
        [
            ("nothing", "passthrough"),
            ("rest", make_inverse_dynamics_regressor(ESTIMATORS["mGP"])),
        ]
    ),
    "alone in a pipeline": make_pipeline(clone(ESTIMATORS["mGP"])),
}


def last_of(model):
    """The MultiTaskGPRegressor at the end."""
    while isinstance(model, Pipeline):
        model = model[-1]
    return getattr(model, "best_estimator_", model)


class TestAddTask:
    @pytest.fixture(params=MODELS.values(), ids=MODELS)
    def model(self, request):
        return clone(request.param).fit(X, Y[:, 0])

    @pytest.mark.parametrize("prior", ["tasks", None])
    def test_of_every_model(self, model, prior):
        before = pickle.dumps(model)
        extended = add_task(model, X_NEW, Y_NEW[:, 0], prior=prior)
        assert pickle.dumps(model) == before
        assert type(extended) is type(model)
        assert last_of(model).tasks_.tolist() == [1, 2, 5]
        assert last_of(extended).tasks_.tolist() == [1, 2, 5, 9]
        transformed = X_NEW
        step = model
        while isinstance(step, Pipeline):
            transformed = step[:-1].transform(transformed) if len(step) > 1 else X_NEW
            step = step[-1]
        last = last_of(model).add_task(transformed, Y_NEW[:, 0], prior=prior)
        expected = last.predict(transformed)
        np.testing.assert_array_equal(extended.predict(X_NEW), expected)
        assert np.square(expected - Y_NEW[:, 0]).mean() < Y[:, 0].var()

    def test_steps_are_those_that_were_fitted(self):
        model = scaled(clone(ESTIMATORS["mGP"])).fit(X, Y[:, 0])
        extended = add_task(model, X_NEW, Y_NEW[:, 0])
        assert extended.named_steps.keys() == model.named_steps.keys()
        assert extended[0] is model[0]
        assert extended.steps is not model.steps
        assert extended[-1] is not model[-1]
        again = pickle.loads(pickle.dumps(extended))
        np.testing.assert_array_equal(again.predict(X), extended.predict(X))

    @pytest.mark.parametrize("name", ["mGP", "mGP-BIC"])
    @pytest.mark.parametrize("transform", ["default", "pandas"])
    def test_frames_with_named_loads(self, name, transform):
        model = make_inverse_dynamics_regressor(ESTIMATORS[name])
        model.set_output(transform=transform).fit(FRAME, TARGETS[["tau1", "tau2"]])
        extended = add_task(model, FRAME_NEW, TARGETS_NEW[["tau1", "tau2"]])
        assert last_of(extended).tasks_.tolist() == ["c1", "c2", "c5", "c9"]
        array = make_inverse_dynamics_regressor(ESTIMATORS[name]).fit(X, Y[:, :2])
        expected = add_task(array, X_NEW, Y_NEW[:, :2]).predict(X_NEW)
        np.testing.assert_allclose(extended.predict(FRAME_NEW), expected, rtol=1e-12)

    def test_one_after_another(self):
        model = make_inverse_dynamics_regressor(ESTIMATORS["mGP"]).fit(X, Y[:, 0])
        other, y = load_puma560(n_per_load=3, loads=[4], return_X_y=True)
        model = add_task(add_task(model, X_NEW, Y_NEW[:, 0]), other, y[:, 0])
        assert last_of(model).tasks_.tolist() == [1, 2, 4, 5, 9]
        assert np.isfinite(model.predict(np.vstack([X, X_NEW, other]))).all()

    @pytest.mark.parametrize(
        "model",
        [
            PooledGP(**QUICK),
            IndependentGP(**QUICK),
            SingleTaskGP(**QUICK),
            BayesianLinearRegression(),
            LinearRegression(),
            scaled(PooledGP(**QUICK)),
            Pipeline([("first", scaled(LinearRegression()))]),
            GridSearchCV(ESTIMATORS["mGP"], {"rank": [1]}),
        ],
        ids=repr,
    )
    def test_other_models_are_refused(self, model):
        if not isinstance(model, GridSearchCV):
            model.fit(X, Y[:, 0])
        message = r"must be a MultiTaskGPRegressor, a RankSearchIC or a Pipeline"
        with pytest.raises(TypeError, match=message):
            add_task(model, X_NEW, Y_NEW[:, 0])

    def test_a_search_is_named_in_short(self):
        cv = [(np.arange(24), np.arange(24))]
        search = GridSearchCV(ESTIMATORS["mGP"], {"rank": [1]}, cv=cv).fit(X, Y[:, 0])
        with pytest.raises(TypeError, match=r"GridSearchCV.* its best_est") as error:
            add_task(search, X_NEW, Y_NEW[:, 0])
        assert len(str(error.value)) < 200
        assert 9 in add_task(search.best_estimator_, X_NEW, Y_NEW[:, 0]).tasks_

    def test_bad_data(self, model):
        with pytest.raises(ValueError, match="Task 1 is known already"):
            add_task(model, X[:8], Y[:8, 0])
        with pytest.raises(ValueError, match=r"X has 18 (features|columns), but"):
            add_task(model, X_NEW[:, 1:], Y_NEW[:, 0])
        with pytest.raises(ValueError, match=r"y has shape \(3, 6\)"):
            add_task(model, X_NEW, Y_NEW)
        with pytest.raises(ValueError, match="prior='x' must be 'tasks' or None"):
            add_task(model, X_NEW, Y_NEW[:, 0], prior="x")

    @pytest.mark.parametrize("name", ["estimator", "search", "features"])
    def test_a_model_that_is_not_fitted(self, name):
        with pytest.raises(NotFittedError):
            add_task(clone(MODELS[name]), X_NEW, Y_NEW[:, 0])


class TestDescriptors:
    """A load that was never seen, from its mass and moments."""

    def test_they_go_from_the_data_to_the_model(self):
        names = ["mass", "mc_x", "mc_y", "mc_z"]
        options = {"descriptors": names, "n_per_load": 8, "as_frame": True}
        puma = load_puma560(loads=range(1, 15), **options)
        model = MultiTaskGPRegressor(
            rank=3,
            task_levels=False,
            normalize_y="shared",
            noise="shared",
            max_iter=30,
            tol=1.0,
        )
        pipeline = make_inverse_dynamics_regressor(model, task_descriptors=names)
        assert pipeline[-1].task_descriptors == [-5, -4, -3, -2]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pipeline.fit(puma.data, puma.target["tau2"])
        new = load_puma560(loads=[15], **options)
        error = pipeline.predict(new.data) - new.target["tau2"]
        assert np.square(error).mean() < 1e-2 * new.target["tau2"].var()
        table = pipeline[-1].task_descriptors_
        assert table.loc["c3"].tolist() == puma.loads.loc["c3", names].tolist()

    def test_a_search(self):
        search = RankSearchIC(ranks=(1,))
        pipeline = make_inverse_dynamics_regressor(search, task_descriptors=[-2])
        assert pipeline[-1].estimator.task_descriptors == [-2]

    def test_those_of_the_estimator_are_taken(self):
        model = MultiTaskGPRegressor(task_descriptors=["mass", "mc_x"])
        pipeline = make_inverse_dynamics_regressor(model)
        assert pipeline[0].task_descriptors == ["mass", "mc_x"]
        assert pipeline[-1].task_descriptors == [-3, -2]
        assert model.task_descriptors == ["mass", "mc_x"]

    def test_other_models_take_none(self):
        with pytest.raises(TypeError, match="task_descriptors are for a MultiTaskGP"):
            make_inverse_dynamics_regressor(PooledGP(), task_descriptors=[-2])


class TestPartialFit:
    """Rows join what ends with a model, whichever the steps."""

    FIRST, LATER = slice(0, 24, 2), slice(1, 24, 2)

    @pytest.fixture(params=MODELS.values(), ids=MODELS)
    def model(self, request):
        return clone(request.param)

    def test_of_every_model(self, model):
        assert partial_fit(model, X[self.FIRST], Y[self.FIRST, 0]) is model
        theta = last_of(model).theta_
        assert len(last_of(model).y_train_) == 12
        partial_fit(model, X[self.LATER], Y[self.LATER, 0])
        assert len(last_of(model).y_train_) == 24
        np.testing.assert_array_equal(last_of(model).theta_, theta)
        partial_fit(model, X_NEW, Y_NEW[:, 0], max_rows=20)
        assert last_of(model).tasks_.tolist() == [1, 2, 5, 9]
        assert len(last_of(model).y_train_) == 20

    def test_it_is_the_last_step_that_learns(self, model):
        first = clone(model).fit(X[self.FIRST], Y[self.FIRST, 0])
        expected = pickle.loads(pickle.dumps(first))
        rows, step = X[self.LATER], expected
        while isinstance(step, Pipeline):
            rows = step[:-1].transform(rows) if len(step) > 1 else rows
            step = step[-1]
        step.partial_fit(rows, Y[self.LATER, 0])
        partial_fit(first, X[self.LATER], Y[self.LATER, 0])
        np.testing.assert_array_equal(first.predict(X), expected.predict(X))

    def test_compiled(self, model):
        model.fit(X, Y[:, 0])
        predictor = compile_predictor(model)
        found = [predictor(x[:-1], x[-1])[0] for x in X[:6]]
        np.testing.assert_allclose(found, model.predict(X[:6]), rtol=1e-9)

    def test_a_failure_leaves_it(self, model):
        model.fit(X, Y[:, 0])
        before = pickle.dumps(model)
        for rows, y, message in [
            (X[:2, 1:], Y[:2, 0], "features|columns"),
            (X[:2], Y[:2], "y has shape"),
        ]:
            with pytest.raises(ValueError, match=message):
                partial_fit(model, rows, y)
        with pytest.raises(ValueError, match="below the number of tasks"):
            partial_fit(model, X[:2], Y[:2, 0], max_rows=1)
        assert pickle.dumps(model) == before

    def test_with_a_memory(self, tmp_path):
        model = make_inverse_dynamics_regressor(clone(ESTIMATORS["pGP"]))
        model.set_params(memory=str(tmp_path))
        partial_fit(model, X[self.FIRST], Y[self.FIRST, 0])
        partial_fit(model, X[self.LATER], Y[self.LATER, 0])
        assert np.isfinite(model.predict(X)).all()

    @pytest.mark.parametrize(
        "model",
        [
            SingleTaskGP(**QUICK),
            BayesianLinearRegression(),
            scaled(LinearRegression()),
            GridSearchCV(ESTIMATORS["mGP"], {"rank": [1]}),
        ],
        ids=repr,
    )
    def test_other_models_are_refused(self, model):
        with pytest.raises(TypeError, match=r"must be a MultiTaskGPRegressor, Indepen"):
            partial_fit(model, X, Y[:, 0])
