"""Fitted models as functions of one state."""

import pickle

import numpy as np
import pandas as pd
import pytest
from multitask_models import PAPER
from samples import draw
from sklearn.base import clone
from sklearn.compose import ColumnTransformer
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Matern,
    RationalQuadratic,
    WhiteKernel,
)
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    OneHotEncoder,
    PowerTransformer,
    StandardScaler,
)

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    compile_predictor,
    make_inverse_dynamics_regressor,
)
from skmtgp._estimators import compiled
from skmtgp.datasets import load_puma560
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.preprocessing import InverseDynamicsFeatures

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning"),
]
START = {"max_iter": 0}
SPARSE = {"inference": "sparse", "n_inducing": 12, "n_exact": 20}
SAMPLED = {"hyperparameters": "sampled", "n_draws": 4, "max_iter": 2}
SHARED = {"shared": True, "normalize_y": "shared"}


def cube(z):
    return z**3


ROOTS = np.cbrt, cube
MODELS = {
    "defaults": MultiTaskGPRegressor(**START),
    "paper": MultiTaskGPRegressor(rank=2, **PAPER, **START),
    "diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **START),
    "shared": MultiTaskGPRegressor(rank=1, **SHARED, **START),
    "units of each": MultiTaskGPRegressor(rank=2, normalize_y="per_task", **START),
    "not normalised": MultiTaskGPRegressor(rank=2, normalize_y=False, **START),
    "transformed": MultiTaskGPRegressor(rank=1, target_transform=ROOTS, **START),
    "Yeo-Johnson": IndependentGP(target_transform=PowerTransformer(), **START),
    "sampled": MultiTaskGPRegressor(rank=1, **SAMPLED),
    "sampled, transformed": PooledGP(target_transform=ROOTS, **SAMPLED),
    "sparse": MultiTaskGPRegressor(rank=2, **SPARSE, **START),
    "sparse, diagonal": MultiTaskGPRegressor(rank=1, diagonal=True, **SPARSE, **START),
    "iGP": IndependentGP(**START),
    "iGP, sparse": IndependentGP(diagonal=True, **SPARSE, **START),
    "pGP": PooledGP(**START),
    "sGP": SingleTaskGP(**START),
    "sGP, transformed": SingleTaskGP(target_transform=ROOTS, **START),
    "search": RankSearchIC(MultiTaskGPRegressor(**START), ranks=(1,)),
    "two kernels": MultiTaskGPRegressor([RBF(), RBF(0.3)], rank=[2, 1], **START),
    "two kernels, shared": MultiTaskGPRegressor([RBF(), RBF(0.3)], rank=1, **SHARED),
}
KERNELS = {
    "RBF": RBF([1.0, 2.0]),
    "Matern 1/2": Matern(1.0, nu=0.5),
    "Matern 3/2": Matern([1.0, 2.0], nu=1.5),
    "Matern 5/2": Matern(1.0, nu=2.5),
    "Matern 0.8": Matern(1.0, nu=0.8),
    "rational quadratic": RationalQuadratic(1.0, 0.5),
    "linear": ARDLinear([1.0, 2.0], 0.5),
    "linear, centred": ARDLinear([1.0, 2.0], 0.5, center=[0.5, -1.5]),
    "dot product": DotProduct(),
    "white": RBF() + WhiteKernel(0.1),
    "columns": ConstantKernel(2.0) * Columns(RBF(), [1]) + Columns(ARDLinear(), [0]),
    "product": RBF() * ARDLinear() + ConstantKernel(),
    "factors, centred": Columns(ARDLinear(center=3.0), [0])
    * Columns(ARDLinear(center=-2.0), [1]),
    "power": (ARDLinear([1.0, 2.0], 0.5) * RBF()) ** 2,
}
Z = draw(per_task=2, seed=1)[0]


def close(found, expected, rtol=1e-12):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=rtol * scale)


def of_rows(predictor, Z, **options):
    """Predictions of all rows, the task last, one after another."""
    if predictor.task is not None:
        return np.array([predictor(z[:-1].astype(float), **options) for z in Z])
    return np.array([predictor(z[:-1].astype(float), z[-1], **options) for z in Z])


def stds(predictor, Z, **options):
    rows = [predictor.std(z[:-1].astype(float), z[-1], **options) for z in Z]
    return np.array(rows)


# What differs from one output to the next differs in each of these.
TWICE = ["defaults", "units of each", "Yeo-Johnson", "sampled", "sparse", "two kernels"]
CASES = {name: (name, None) for name in MODELS}
CASES |= {f"{name}, two outputs": (name, 2) for name in [*TWICE, "sGP", "search"]}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def model(request):
    name, n_outputs = request.param
    return clone(MODELS[name]).fit(*draw(n_outputs=n_outputs))


def test_it_is_what_predict_says(model):
    predictor = pickle.loads(pickle.dumps(compile_predictor(model)))
    expected = model.predict(Z).reshape(len(Z), -1)
    close(of_rows(predictor, Z), expected)
    assert predictor(Z[0, :2], 1).shape == expected.shape[1:]


def test_of_one_task(model):
    for task in (0, 2):
        predictor = compile_predictor(model, task=task)
        rows = np.column_stack([Z[:, :2], np.full(len(Z), task)])
        close(of_rows(predictor, rows), model.predict(rows).reshape(len(Z), -1))
        assert (predictor.task, predictor.n_features_in) == (task, 2)


def test_standard_deviations(model):
    predictor = pickle.loads(pickle.dumps(compile_predictor(model, std=True)))
    for noise in (False, True):
        _, expected = model.predict(Z, return_std=True, include_noise=noise)
        found = stds(predictor, Z, include_noise=noise)
        close(found, expected.reshape(len(Z), -1), rtol=1e-10)


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("params", [{}, SPARSE], ids=["exact", "sparse"])
def test_every_kernel(name, params):
    if params and name == "white":
        pytest.skip("inducing inputs cannot explain it")
    model = MultiTaskGPRegressor(KERNELS[name], rank=2, **params, **START).fit(*draw())
    close(of_rows(compile_predictor(model), Z)[:, 0], model.predict(Z))


class TestRows:
    def complete(self, inference):
        x = draw()[0][:10, :2]
        X = np.column_stack([np.tile(x, (3, 1)), np.repeat([0, 1, 2], 10)])
        y = np.sin(X[:, 0]) + X[:, 2] * X[:, 1]
        return MultiTaskGPRegressor(rank=2, inference=inference, **START).fit(X, y)

    @pytest.mark.parametrize("inference", ["dense", "kronecker"])
    def test_equal_inputs_count_once(self, inference):
        model = self.complete(inference)
        predictor = compile_predictor(model)
        [plan] = predictor._plans[0]
        assert plan.means.parts[0].B.shape[1] == 10
        close(of_rows(predictor, Z)[:, 0], model.predict(Z))

    def test_after_a_task_has_joined(self):
        model = self.complete("auto").add_task([[0.1, 0.2, 7], [0.5, 0.1, 7]], [1, 2.0])
        rows = np.vstack([Z, Z * [1.0, 1.0, 0.0] + [0.0, 0.0, 7.0]])
        close(of_rows(compile_predictor(model), rows)[:, 0], model.predict(rows))

    def test_rows_of_independent_tasks_do_not_matter(self):
        model = IndependentGP(noise="shared", **START).fit(*draw())
        small, whole = (
            compile_predictor(model, task=task)._plans for task in (1, None)
        )
        [plan] = small[1]
        assert plan.means.parts[0].B.shape[1] == 10
        assert len(pickle.dumps(small)) < len(pickle.dumps(whole))

    def test_it_keeps_little(self):
        X, y = draw(per_task=100)
        model = MultiTaskGPRegressor(rank=2, **PAPER, **START).fit(X, y)
        size = len(pickle.dumps(compile_predictor(model, task=1)))
        assert size < 8 * len(y) * 6 + 5000  # x, half its square, the weight, and room
        assert len(pickle.dumps(compile_predictor(model, task=1, std=True))) > 90_000


class TestTogether:
    """Outputs whose kernels are alike are computed together, in any order."""

    @staticmethod
    def fitted():
        X, y = draw()
        kernels = [RBF(), Matern(nu=0.5), RBF(0.3), RBF() + DotProduct(), RBF([1.0, 2])]
        models = [MultiTaskGPRegressor(k, rank=1, **START).fit(X, y) for k in kernels]
        models.append(MultiTaskGPRegressor(RBF(), rank=1, **START).fit(X[1:], y[1:]))
        models.append(clone(MODELS["transformed"]).fit(X, y))
        models.append(clone(MODELS["sGP"]).fit(X, y))
        return models, np.column_stack([model.predict(Z) for model in models])

    @pytest.mark.parametrize("most", [1, 2**14])
    def test_several_models(self, most, monkeypatch):
        monkeypatch.setattr(compiled, "TOGETHER", most)
        models, expected = self.fitted()
        predictor = compile_predictor(models)
        close(of_rows(predictor, Z), expected)
        found = [predictor.predict_tasks(z[:2])[int(z[2])] for z in Z]
        close(np.array(found), expected)

    def test_alike_is_one(self):
        models, _ = self.fitted()
        [plan] = compile_predictor([models[0], models[2]])._plans[0]
        [part] = plan.means.parts
        assert part.B.shape[0] == 2


class TestTasks:
    def test_labels_are_text(self):
        X, y = draw()
        frame = pd.DataFrame(X[:, :2], columns=["a", "b"])
        frame.insert(1, "load", np.array(["no", "box", "cup"])[X[:, 2].astype(int)])
        model = MultiTaskGPRegressor(rank=1, task_feature="load", **START)
        model.fit(frame, y)
        predictor = compile_predictor(model)
        found = [
            predictor([a, b], load) for a, load, b in frame.itertuples(index=False)
        ]
        close(np.ravel(found), model.predict(frame))
        one = compile_predictor(model, task="cup")
        assert one([0.1, 0.2]).item() == one([0.1, 0.2], "cup").item()
        close(one([0.1, 0.2]), predictor([0.1, 0.2], "cup"))

    @pytest.mark.parametrize("name", ["pGP", "shared"])
    def test_one_that_was_never_seen(self, name):
        model = clone(MODELS[name]).fit(*draw())
        predictor, rows = compile_predictor(model, task=99, std=True), Z.copy()
        rows[:, -1] = 99
        close(of_rows(predictor, rows)[:, 0], model.predict(rows))
        close(stds(predictor, rows)[:, 0], model.predict(rows, return_std=True)[1])

    def test_one_that_is_not_known(self):
        model = clone(MODELS["paper"]).fit(*draw())
        with pytest.raises(ValueError, match="Unknown task 99: the model knows 0, 1"):
            compile_predictor(model, task=99)
        predictor = compile_predictor(model)
        with pytest.raises(
            ValueError, match=r"task=99 is not one .* compiled for: 0, 1"
        ):
            predictor([0.0, 0.0], 99)
        with pytest.raises(ValueError, match=r"Give the task too, .*one of 0, 1"):
            predictor([0.0, 0.0])
        with pytest.raises(ValueError, match=r"task=1 is not one"):
            compile_predictor(model, task=0)([0.0, 0.0], 1)


class TestStates:
    @pytest.fixture
    def predictor(self):
        return compile_predictor(clone(MODELS["paper"]).fit(*draw()), task=1)

    @pytest.mark.parametrize("x", [[0.0], [0.0, 0.0, 1.0], [[0.0, 0.0]]], ids=repr)
    def test_wrong_lengths(self, predictor, x):
        with pytest.raises(ValueError, match=r"x has shape .*, not \(2,\): it is one"):
            predictor(x)

    def test_it_is_not_changed(self, predictor):
        x = np.array([0.5, 1.0])
        first = predictor(x)
        assert x.tolist() == [0.5, 1.0]
        assert predictor(x) is not first

    def test_deviations_have_to_be_asked_for(self, predictor):
        with pytest.raises(ValueError, match=r"need compile_predictor\(std=True\)"):
            predictor.std([0.0, 0.0])


LOADS = [1, 2, 4]
X_ROBOT, Y_ROBOT = load_puma560(n_per_load=6, loads=LOADS, return_X_y=True)
NEW_ROBOT = load_puma560(n_per_load=2, loads=LOADS, return_X_y=True)[0] + 0.01
NEW_ROBOT[:, -1] = np.repeat(LOADS, 2)


@pytest.fixture(scope="module", params=["paper", "geometric", "trigonometric"])
def joints(request):
    """A pipeline for each of three joints."""
    model = MultiTaskGPRegressor(rank=1, **PAPER, **START)
    pipeline = make_inverse_dynamics_regressor(model, kernel=request.param)
    return [clone(pipeline).fit(X_ROBOT, Y_ROBOT[:, j]) for j in range(3)]


class TestPipelines:
    def test_a_robot(self, joints):
        expected = np.column_stack([joint.predict(NEW_ROBOT) for joint in joints])
        found = of_rows(compile_predictor(joints), NEW_ROBOT)
        for j in range(3):
            close(found[:, j], expected[:, j], rtol=1e-10)
        for task in LOADS:
            rows = NEW_ROBOT[NEW_ROBOT[:, -1] == task]
            again = of_rows(compile_predictor(joints, task=task), rows)
            of_task = expected[NEW_ROBOT[:, -1] == task]
            np.testing.assert_allclose(again, of_task, rtol=1e-9)

    def test_features_are_computed_once(self, joints):
        predictor = compile_predictor(joints, task=2)
        assert len(predictor._plans[2]) == 1
        other = clone(joints[2]).fit(X_ROBOT[1:], Y_ROBOT[1:, 2])
        predictor = compile_predictor([*joints[:2], other], task=2)
        assert len(predictor._plans[2]) == 2
        expected = [of.predict(NEW_ROBOT[2:3])[0] for of in (*joints[:2], other)]
        np.testing.assert_allclose(predictor(NEW_ROBOT[2, :-1]), expected, rtol=1e-9)

    def test_named_outputs(self, joints):
        names = {f"q{j}": joint for j, joint in enumerate(joints)}
        all_of, x = compile_predictor(names, task=1, std=True), NEW_ROBOT[0, :-1]
        assert all_of.outputs == ["q0", "q1", "q2"]
        assert "task=1, outputs=['q0', 'q1', 'q2'], std=True" in repr(all_of)
        some = compile_predictor(names, task=1, outputs=["q2", "q0"], std=True)
        assert some.outputs == ["q2", "q0"]
        np.testing.assert_array_equal(some(x), all_of(x)[[2, 0]])
        np.testing.assert_array_equal(some.std(x), all_of.std(x)[[2, 0]])
        with pytest.raises(ValueError, match=r"has 'q9', but the outputs are \['q0'"):
            compile_predictor(names, outputs=["q9"])

    def test_positions_of_outputs(self, joints):
        both = clone(joints[0]).fit(X_ROBOT, Y_ROBOT[:, :2])
        predictor = compile_predictor([both, joints[2]], task=1)
        assert predictor.outputs == [0, 1, 2]
        some = compile_predictor([both, joints[2]], task=1, outputs=[2, 1])
        x = NEW_ROBOT[0, :-1]
        np.testing.assert_array_equal(some(x), predictor(x)[[2, 1]])
        named = compile_predictor({"first": both, "last": joints[2]}, task=1)
        assert named.outputs == [("first", 0), ("first", 1), "last"]

    def test_standstill(self):
        features = InverseDynamicsFeatures().fit(X_ROBOT)
        x = X_ROBOT[0].copy()
        x[6:9] = 0.0, 1e-12, -1e-12
        found = features._compile(1)(x[:-1])
        np.testing.assert_array_equal(found, features.transform(x[None])[0, :-1])

    @pytest.mark.parametrize("types", ["RPRRPR", "RRRRRR", "PPPPPP"])
    def test_cosines_and_sines(self, types):
        features = InverseDynamicsFeatures(angles="trigonometric", joint_types=types)
        features.fit(X_ROBOT)
        found = [features._compile(1)(x) for x in X_ROBOT[:, :-1]]
        expected = features.transform(X_ROBOT)[:, :-1]
        np.testing.assert_allclose(found, expected, rtol=1e-15, atol=1e-15)

    @pytest.mark.parametrize("text", [False, True])
    @pytest.mark.parametrize("frames", [False, True])
    def test_other_transformers_are_called(self, text, frames):
        X, y = draw()
        if text:
            X = X.astype(object)
            X[:, 2] = np.array(["a", "b", "c"])[X[:, 2].astype(int)]
        scale = ColumnTransformer(
            [("scale", StandardScaler(), [0, 1])], remainder="passthrough"
        )
        if frames:
            X = pd.DataFrame(X, columns=["u", "v", "task"]).infer_objects()
            scale.set_output(transform="pandas")
        model = make_pipeline(scale, MultiTaskGPRegressor(rank=1, **START)).fit(X, y)
        predictor = compile_predictor(model)
        rows = np.asarray(X)[:4]
        close(of_rows(predictor, rows)[:, 0], model.predict(X[:4]))

    def test_a_task_that_moves(self):
        X, y = draw()
        first = FunctionTransformer(np.fliplr)
        model = MultiTaskGPRegressor(rank=1, task_feature=0, **START)
        model = make_pipeline(first, model).fit(X, y)
        with pytest.raises(ValueError, match="cannot tell which column of X has the t"):
            compile_predictor(model)

    def test_transformers_that_cannot_be_pickled(self):
        X, y = draw()
        first = FunctionTransformer(lambda X: X * [2.0, 1.0, 1.0])
        model = make_pipeline(first, clone(MODELS["paper"])).fit(X, y)
        close(of_rows(compile_predictor(model), Z)[:, 0], model.predict(Z))

    def test_steps_that_do_nothing(self):
        model = Pipeline([("a", "passthrough"), ("b", clone(MODELS["paper"]))])
        model.fit(*draw())
        close(of_rows(compile_predictor(model), Z)[:, 0], model.predict(Z))


class TestRefresh:
    def test_in_place(self):
        X, y = draw()
        model = clone(MODELS["paper"]).fit(X, y)
        predictor = compile_predictor(model, task=1, std=True, follow=False)
        x = Z[0, :2]
        before = predictor(x), predictor.std(x)
        model.partial_fit(Z, np.full(len(Z), 9.0))
        np.testing.assert_array_equal(predictor(x), before[0])  # of both the old one
        np.testing.assert_array_equal(predictor.std(x), before[1])
        assert predictor.refresh(model) is predictor
        row = [[*x, 1]]
        found = model.predict(row, return_std=True)
        close([predictor(x), predictor.std(x)], found, rtol=1e-10)
        assert predictor.std(x) < before[1]

    def test_of_a_new_task(self):
        model = clone(MODELS["paper"]).fit(*draw())
        predictor = compile_predictor(model, follow=False)
        model.partial_fit([[0.1, 0.2, 5]], [3.0])
        with pytest.raises(ValueError, match="task=5 is not one"):
            predictor([0.1, 0.2], 5)
        predictor.refresh(model)
        close(predictor([0.1, 0.2], 5), model.predict([[0.1, 0.2, 5]]))

    def test_a_failure_leaves_it(self):
        model = clone(MODELS["paper"]).fit(*draw())
        predictor = compile_predictor(model, outputs=[0], task=1)
        before = predictor([0.1, 0.2])
        with pytest.raises(NotFittedError):
            predictor.refresh(MultiTaskGPRegressor())
        np.testing.assert_array_equal(predictor([0.1, 0.2]), before)


class TestRefused:
    @pytest.mark.parametrize(
        "model", [LinearRegression(), make_pipeline(LinearRegression())], ids=repr
    )
    def test_other_models(self, model):
        model.fit(*draw())
        with pytest.raises(TypeError, match="model must be a MultiTaskGPRegressor"):
            compile_predictor(model)

    def test_models_that_are_not_fitted(self):
        with pytest.raises(NotFittedError):
            compile_predictor(MultiTaskGPRegressor())

    def test_none(self):
        with pytest.raises(ValueError, match="model is empty"):
            compile_predictor([])

    def test_states_of_different_lengths(self):
        X, y = draw()
        models = [clone(MODELS["paper"]).fit(of, y) for of in (X, X[:, 1:])]
        with pytest.raises(ValueError, match=r"states of different lengths, \[1, 2\]"):
            compile_predictor(models)

    @pytest.mark.parametrize("container", [pd.DataFrame.copy, pd.DataFrame.to_numpy])
    def test_steps_that_encode_text(self, container):
        """A state has numbers alone; of an array, they were no known category."""
        model = PooledGP("rbf", noise="shared", max_iter=0)
        X, y = (
            pd.DataFrame({"c": ["u", "v"] * 6, "x": range(12), "load": "a"}),
            range(12),
        )
        encoder = OneHotEncoder(handle_unknown="ignore", sparse_output=False)
        columns = ColumnTransformer([("c", encoder, [0])], remainder="passthrough")
        steps = make_pipeline(make_pipeline(columns), model).fit(container(X), y)
        match = "OneHotEncoder of the Pipeline was fitted to text such as 'u'. Encode"
        with pytest.raises(ValueError, match=match):
            compile_predictor(steps)
        numbers = container(X.assign(c=[1, 2] * 6))
        steps = make_pipeline(columns, model).fit(numbers, y)
        close(compile_predictor(steps, "a")([2, 3]), steps.predict(numbers[3:4]))
        columns = ColumnTransformer(
            [("code", encoder, [2]), ("all", "passthrough", [0, 1, 2])]
        )  # the task as a feature
        steps = make_pipeline(columns, model).fit(numbers, y)
        close(compile_predictor(steps, "a")([2, 3]), steps.predict(numbers[3:4]))

    def test_no_task_in_common(self):
        X, y = draw()
        models = [clone(MODELS["paper"]).fit(X + [0, 0, a], y) for a in (0, 10)]
        with pytest.raises(ValueError, match="no task in common"):
            compile_predictor(models)


def test_all_tasks_at_once(model):
    predictor = compile_predictor(model)
    expected = [predictor(Z[0, :2], task) for task in predictor.tasks]
    close(predictor.predict_tasks(Z[0, :2]), expected)
