"""Machines whose response grows with their age: streams, pipelines, odd samples."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import logsumexp
from sklearn.compose import make_column_transformer
from sklearn.gaussian_process.kernels import RBF
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from skmtgp import MultiTaskGPRegressor, TaskIdentifier

AGE = np.array([1.0, 3.0, 6.0, 9.0])
MACHINE = np.repeat(np.arange(4), 20)
RNG = np.random.default_rng(0)
X = RNG.uniform(0.0, 6.0, 80)
Y = AGE[MACHINE] * np.sin(X) + 0.03 * RNG.standard_normal(80)
OPTIONS = {"kernel": RBF(1.0), "rank": 1, "task_levels": False, "max_iter": 30}
OPTIONS |= {"normalize_y": "shared", "noise": "shared", "learning": "staged"}


def fitted(labels=MACHINE, **options):
    """A model of them, with these labels."""
    model = MultiTaskGPRegressor(**OPTIONS, task_descriptors=[1], **options)
    return model.fit(np.column_stack([X, AGE[MACHINE], labels]), Y)


@pytest.fixture(scope="module")
def model():
    return fitted()


@pytest.mark.parametrize("switching", [0.0, 1.0])
def test_a_stream_that_never_or_always_switches(model, switching):
    """All samples count, or the last one alone, however little is left of a class."""
    identifier, rng = (
        TaskIdentifier(model, switching=switching),
        np.random.default_rng(1),
    )
    x, each = rng.uniform(0.0, 6.0, (4, 150, 1)), []
    for x_of_part, machine in zip(x, [3, 3, 1, 1], strict=True):
        y = AGE[machine] * np.sin(x_of_part[:, 0]) + 0.03 * rng.standard_normal(150)
        identifier.partial_fit(x_of_part, y)
        each.append(identifier._outputs(x_of_part, y)[0][0].each())
        assert np.isfinite(identifier.path_).all()
    np.testing.assert_allclose(identifier.path_.sum(axis=1), 1.0)
    told = each[-1][-1] if switching else np.concatenate(each).sum(axis=0)
    expected = np.exp(told - logsumexp(told))
    np.testing.assert_allclose(identifier.responsibilities_, expected, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"inference": "sparse", "n_inducing": 20}])
def test_a_long_stream_takes_some_samples_at_a_time(options, monkeypatch):
    """So memory is that of some rows and all training rows, and densities are equal."""
    x = np.linspace(0.0, 6.0, 50)
    (output,), _ = TaskIdentifier(fitted(**options))._outputs(x[:, None], np.sin(x))
    whole, of_class, sizes = output.each(), type(output.posterior), []
    latent = of_class.latent

    def counted(self, X, factor):
        means, halves = latent(self, X, factor)
        sizes.append(halves.size)
        return means, halves

    monkeypatch.setattr(of_class, "latent", counted)
    monkeypatch.setattr("skmtgp.learning.identifying.BLOCK_SIZE", 1000)
    np.testing.assert_allclose(output.each(), whole, rtol=1e-6)
    assert len(sizes) > 1
    assert max(sizes) <= 1000


def test_a_stream_of_as_many_other_tasks_needs_a_reset(model):
    identifier = TaskIdentifier(model).partial_fit(X[:3, None], Y[:3])
    before = identifier.responsibilities_
    identifier.model = fitted(MACHINE + 10)
    expected = r"knows 4 tasks, \[10, 11, 12, 13\], but knew 4 tasks, \[0, 1, 2, 3\]"
    for _ in range(2):
        with pytest.raises(ValueError, match=expected):
            identifier.partial_fit(X[:3, None], Y[:3])
    np.testing.assert_array_equal(identifier.responsibilities_, before)
    identifier.model = fitted()  # another one of the same tasks
    identifier.partial_fit(X[:3, None], Y[:3])
    identifier.model = fitted(MACHINE + 10)
    identifier.reset().partial_fit(X[:3, None], Y[:3])
    assert identifier.responsibilities_.argmax() == 0


@pytest.mark.parametrize("method", ["predict_proba", "estimate", "partial_fit"])
@pytest.mark.parametrize(
    ("x", "y", "match"),
    [
        (np.ones((2, 1)), [1.0, -1e160], r"y has values as large as 1.0e\+160 in .* 0"),
        (np.ones((1, 1)), pd.DataFrame({"torque": [1e80]}), "in column 'torque'"),
        (np.ones((0, 1)), [], "0 sample"),
    ],
)
def test_samples_that_are_too_large_or_none(model, method, x, y, match):
    with pytest.raises(ValueError, match=match):
        getattr(TaskIdentifier(model), method)(x, y)


class TestPipelines:
    """Transformers that know no tasks, with a task or without one."""

    FRAME = pd.DataFrame({"x": X, "age": AGE[MACHINE], "machine": MACHINE})
    ROWS = MACHINE == 2

    def scaled(self, columns, **options):
        return make_column_transformer(
            (StandardScaler(), columns),
            remainder="passthrough",
            verbose_feature_names_out=False,
            **options,
        )

    def same(self, pipeline, plain, *inputs):
        """Whether it identifies a machine as the model of scaled inputs does."""
        x, y = (X[self.ROWS] - X.mean()) / X.std(), Y[self.ROWS]
        expected = TaskIdentifier(plain).predict_proba(x[:, None], y)
        assert expected.argmax() == 2
        for of in inputs:
            found = TaskIdentifier(pipeline).predict_proba(of, y)
            np.testing.assert_allclose(found, expected, atol=1e-6)

    def plain(self, **options):
        table = self.FRAME.assign(x=(X - X.mean()) / X.std()).to_numpy()
        columns = [0, 1, 2] if options else [0, 2]
        return MultiTaskGPRegressor(**OPTIONS, **options).fit(table[:, columns], Y)

    def test_frames_with_labels_that_are_text(self):
        """The task column may be unknown or left out, or the first one."""
        names = np.array(["a", "b", "c", "d"])[MACHINE]
        frame = self.FRAME[["machine", "x"]].assign(machine=names)
        model = MultiTaskGPRegressor(**OPTIONS, task_feature="machine")
        pipeline = make_pipeline(
            self.scaled(["x"]).set_output(transform="pandas"), "passthrough", model
        )
        samples = frame[self.ROWS]
        others = samples.assign(machine="?"), samples[["x"]], samples.assign(machine=1)
        self.same(pipeline.fit(frame, Y), self.plain(), samples, *others)
        with pytest.raises(ValueError, match=r"X lacks the columns \['x'\]"):
            TaskIdentifier(pipeline).predict(frame[["machine"]], Y)

    def test_descriptors_are_those_of_no_task(self):
        frame, options = self.FRAME, {"task_descriptors": ["age"]}
        model = MultiTaskGPRegressor(**OPTIONS, task_feature="machine", **options)
        first = self.scaled(["x"]).set_output(transform="pandas")
        pipeline = make_pipeline(first, model).fit(frame, Y)
        samples = frame[self.ROWS]
        inputs = samples, samples.assign(age=77.0), samples[["x"]]
        self.same(pipeline, self.plain(task_descriptors=[1]), *inputs)
        y = 5.0 * np.sin(X[:20])
        mean, _ = TaskIdentifier(pipeline).estimate(frame[["x"]][:20], y)
        assert mean["age"] == pytest.approx(5.0, abs=0.3)

    def test_arrays(self):
        table = np.column_stack([X, MACHINE])
        model = MultiTaskGPRegressor(**OPTIONS)
        samples = table[self.ROWS]
        inputs = samples, samples[:, :1], np.insert(samples[:, :1], 1, 77, axis=1)
        pipeline = make_pipeline(self.scaled([0]), model).fit(table, Y)
        self.same(pipeline, self.plain(), *inputs, samples[:, :1].tolist())
        with pytest.raises(ValueError, match=r"must have 2 columns.*or 1, without"):
            TaskIdentifier(pipeline).predict(np.ones((3, 4)), np.ones(3))

    @pytest.mark.parametrize("label", [0, 1])
    def test_a_task_column_that_is_moved(self, label):
        """Nothing may take its place, whatever the label of the samples."""
        table = np.column_stack([MACHINE, X, X])
        model = MultiTaskGPRegressor(**OPTIONS | {"max_iter": 0})
        pipeline = make_pipeline(self.scaled([1, 2]), model).fit(table, Y)
        with pytest.raises(
            TypeError, match=r"before ColumnTransformer\. Make it the l"
        ):
            TaskIdentifier(pipeline).predict(np.insert(table[:3, 1:], 0, label, 1), Y)

    def test_a_function(self):
        table = np.column_stack([X, MACHINE])
        model = MultiTaskGPRegressor(**OPTIONS).fit(table, Y)
        pipeline = make_pipeline(FunctionTransformer(), model).fit(table, Y)
        expected = TaskIdentifier(model).predict_proba(table[:5, :1], Y[:5])
        found = TaskIdentifier(pipeline).predict_proba(table[:5, :1], Y[:5])
        np.testing.assert_allclose(found, expected)
