"""Which task samples come from, and what describes it."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal, norm
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import MultiTaskGPRegressor, PooledGP, RankSearchIC, TaskIdentifier
from skmtgp.identification import _population
from skmtgp.learning.identifying import Unknown, follow, identify

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
M, N, NOISE = 6, 120, 0.1
AGE = np.array([0.5, 4.0, 9.0, 6.0, 2.2, 7.7])
SIZE = np.array([1.2, 1.9, 1.0, 1.4, 1.7, 1.1])
PLAIN = {"normalize_y": "shared", "noise": "shared", "task_levels": False}
OPTIONS = PLAIN | {"kernel": RBF(1.0), "rank": 2, "learning": "staged", "max_iter": 60}
DESCRIBED = OPTIONS | {"task_descriptors": [1, 2]}


def f(x, age, size):
    return np.column_stack(
        [(1.0 + 0.3 * age) * np.sin(x) + size * np.cos(x), size * np.sin(2.0 * x)]
    )


def draw(x, age, size, seed=0, noise=NOISE):
    rng = np.random.default_rng(seed)
    y = f(x, age, size)
    return y + noise * rng.standard_normal(y.shape)


RNG = np.random.default_rng(1)
TASK, STATES = np.arange(N) % M, RNG.uniform(0.0, 6.0, N)
X = np.column_stack([STATES, AGE[TASK], SIZE[TASK], TASK])
Y = draw(STATES, AGE[TASK], SIZE[TASK])
NEW = np.array([0.4, 1.3, 2.0, 3.1, 4.4, 5.2])
ANOTHER = np.array([5.0, 1.5])
Y_NEW = draw(NEW, *ANOTHER, seed=2)


@pytest.fixture(scope="module")
def model():
    return MultiTaskGPRegressor(**DESCRIBED).fit(X, Y)


@pytest.fixture(scope="module")
def undescribed():
    return MultiTaskGPRegressor(**OPTIONS).fit(X[:, [0, 3]], Y)


def by_the_book(model, X_of_task, y):
    """Log density of samples of a task whose label and descriptors are given."""
    mean, cov = model.predict(X_of_task, return_cov=True, include_noise=True)
    outputs = zip(y.T, mean.T, np.moveaxis(cov, 2, 0), strict=True)
    return sum(multivariate_normal.logpdf(y, m, c) for y, m, c in outputs)


def with_task(x, age, size, label):
    return np.column_stack([x, np.full((len(x), 3), [age, size, label])])


def test_known_tasks_by_the_book(model):
    found = TaskIdentifier(model, floor=0.0, inflation=1.0).predict_proba(
        NEW[:1, None], Y_NEW[:1]
    )
    expected = np.array(
        [
            by_the_book(model, with_task(NEW[:1], AGE[m], SIZE[m], m), Y_NEW[:1])
            for m in range(M)
        ]
    )
    assert found.sum() == pytest.approx(1.0)
    known = found[:-1] / found[:-1].sum()
    expected = np.exp(expected - expected.max())
    np.testing.assert_allclose(known, expected / expected.sum(), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("task", range(M))
def test_known_tasks_are_recognised(model, undescribed, task):
    y = draw(NEW, AGE[task], SIZE[task], seed=task)
    for of, x in [(model, NEW[:, None]), (undescribed, NEW[:, None])]:
        identifier = TaskIdentifier(of)
        probabilities = identifier.predict_proba(x, y)
        assert identifier.classes_.tolist() == [*range(M), None]
        assert probabilities.argmax() == task
        assert probabilities[task] > 0.8
        assert identifier.predict(x, y) == task


def test_another_task_is_none_of_them(model, undescribed):
    x = np.linspace(0.4, 5.2, 12)
    y = draw(x, *ANOTHER, seed=2)
    for of in (model, undescribed):
        probabilities = TaskIdentifier(of).predict_proba(x[:, None], y)
        assert probabilities[-1] > 0.99
        assert TaskIdentifier(of).predict(x[:, None], y) is None


def test_a_known_task_errs_by_what_noisy_rows_leave_open(undescribed):
    x, y = NEW[:, None], draw(NEW, AGE[1], SIZE[1], seed=3)
    outputs, _ = TaskIdentifier(undescribed)._outputs(x, y)
    scale, variances = undescribed._units.scale, undescribed.y_train_.var(axis=0)
    found = undescribed.predict(X[:, [0, 3]], return_std=True)[1]
    for j, output in enumerate(outputs):
        prior = undescribed._posteriors[j].K_rho.diagonal()
        own = output.error[:-1] * prior.mean() * scale[j, 0] ** 2
        rows = np.square(found[:, j]).mean()
        np.testing.assert_allclose(own, 4.0 * rows, rtol=1e-6)
        assert output.error[-1] < 1e-4 * output.error[0] * variances[j] / rows


def density(model, widening, descriptors):
    """Log density of the samples and descriptors, by the book."""
    centre, scale = _population(model._descriptors, widening)
    prior = multivariate_normal.logpdf(descriptors, centre, scale @ scale.T)
    return prior + by_the_book(model, with_task(NEW, *descriptors, 99), Y_NEW)


def test_descriptors_are_the_mode_of_their_density(model):
    mean, covariance = TaskIdentifier(model, floor=0.0, inflation=1.0).estimate(
        NEW[:, None], Y_NEW
    )
    best = density(model, 2.0, mean.to_numpy())
    deviations = np.sqrt(np.diagonal(covariance))
    rng = np.random.default_rng(0)
    for _ in range(20):
        away = 0.1 * deviations * rng.standard_normal(2)
        assert density(model, 2.0, mean.to_numpy() + away) < best
    z = (mean - ANOTHER) / deviations
    assert np.abs(z).max() < 3.0
    assert deviations.max() < 0.5


def test_the_covariance_is_the_curvature_of_the_density(model):
    mean, covariance = TaskIdentifier(model, floor=0.0, inflation=1.0).estimate(
        NEW[:, None], Y_NEW
    )
    mean, covariance = mean.to_numpy(), covariance.to_numpy()
    steps = 0.05 * np.linalg.cholesky(covariance).T
    best = density(model, 2.0, mean)
    for step in steps:
        ends = [density(model, 2.0, mean + sign * step) for sign in (-1.0, 1.0)]
        curvature = (sum(ends) - 2.0 * best) / 0.05**2
        assert curvature == pytest.approx(-1.0, rel=0.25)  # expected, not observed


def test_the_probability_of_none_is_the_density_without_descriptors(model):
    """Descriptors integrated out by draws; Laplace's method is near."""
    identifier = TaskIdentifier(model, floor=0.0, inflation=1.0)
    found = identifier.predict_proba(NEW[:2, None], Y_NEW[:2])
    centre, scale = _population(model._descriptors, 2.0)
    rng = np.random.default_rng(0)
    drawn = centre + rng.standard_normal((600, 2)) @ scale.T
    values = [
        by_the_book(model, with_task(NEW[:2], *of, 99), Y_NEW[:2]) for of in drawn
    ]
    known = [
        by_the_book(model, with_task(NEW[:2], AGE[m], SIZE[m], m), Y_NEW[:2])
        for m in range(M)
    ]
    expected = np.log(np.mean(np.exp(values))) - known[1]
    assert np.log(found[-1] / found[1]) == pytest.approx(expected, abs=0.7)


def test_more_samples_tell_more(model):
    identifier = TaskIdentifier(model)
    spreads = [
        np.trace(identifier.estimate(NEW[:n, None], Y_NEW[:n])[1]) for n in (1, 3, 6)
    ]
    assert spreads[0] > spreads[1] > spreads[2]


def test_calibration(model):
    """Descriptors of tasks that are drawn are within two deviations, mostly."""
    rng, z = np.random.default_rng(3), []
    identifier = TaskIdentifier(model)
    for seed in range(40):
        truth = rng.uniform([1.0, 1.0], [8.0, 1.9])
        x = rng.uniform(0.0, 6.0, 4)
        mean, covariance = identifier.estimate(x[:, None], draw(x, *truth, seed=seed))
        z.extend((mean - truth) / np.sqrt(np.diagonal(covariance)))
    assert 0.85 <= np.mean(np.abs(z) < 2.0) <= 1.0


def test_many_samples_without_noise_do_not_feign_certainty():
    y = f(STATES, AGE[TASK], SIZE[TASK])
    model = MultiTaskGPRegressor(**DESCRIBED).fit(X, y)
    x = np.linspace(0.1, 5.9, 50)
    deviations = []
    for floor in (0.0, 2e-2):
        found = TaskIdentifier(model, floor=floor).estimate(x[:, None], f(x, *ANOTHER))
        deviations.append(np.sqrt(np.diagonal(found[1])))
        assert np.abs(found[0] - ANOTHER).max() < 0.05
    assert (deviations[1] > 1e-3 * np.array([AGE.std(), SIZE.std()])).all()
    assert (deviations[1] > 3.0 * deviations[0]).all()


def test_noise_of_the_samples():
    y = f(STATES, AGE[TASK], SIZE[TASK])
    model = MultiTaskGPRegressor(**DESCRIBED).fit(X, y)
    without = TaskIdentifier(model).estimate(NEW[:, None], Y_NEW)
    known = TaskIdentifier(model, noise=NOISE).estimate(NEW[:, None], Y_NEW)
    z = [np.abs(m - ANOTHER) / np.sqrt(np.diagonal(c)) for m, c in (without, known)]
    assert z[1].max() < 3.0
    assert (np.diagonal(known[1]) > np.diagonal(without[1])).all()
    each = TaskIdentifier(model, noise=[NOISE, NOISE]).estimate(NEW[:, None], Y_NEW)
    pd.testing.assert_frame_equal(each[1], known[1])


def test_an_inflated_task_is_less_certain(model, undescribed):
    """The variance of its function is larger, that of the noise is not."""
    x, y = NEW[:, None], f(NEW, *ANOTHER)
    options = [{"inflation": of} for of in (1.0, [4.0, 4.0], 4.0, "auto")]
    found = [TaskIdentifier(model, **of).estimate(x, y)[1] for of in options]
    spreads = [np.trace(of) for of in found]
    assert spreads[0] < spreads[1] == spreads[2]
    assert spreads[0] < spreads[3]
    outputs, _ = TaskIdentifier(model, inflation=4.0, floor=0.02)._outputs(x, y)
    of_model, _ = TaskIdentifier(model, inflation=1.0, floor=0.0)._outputs(x, y)
    for output, plain in zip(outputs, of_model, strict=True):
        row = output.row[0] + output.row[1] @ [0.3, -0.2]
        before, inflated = (of.border()._covariance(row)[0] for of in (plain, output))
        K_x, eye = output.posterior.kernel(output.X), output.noise[-1] * np.eye(len(x))
        own = output.error[-1] * row @ row * K_x
        expected = 4.0 * (before - eye) + own + eye
        np.testing.assert_allclose(inflated, expected, rtol=1e-8, atol=1e-12)
    told = TaskIdentifier(undescribed)._outputs(x, y)[0]
    assert [of.inflation for of in told] == [1.0, 1.0]


def test_inflation_is_told_once_for_each_posterior(model, monkeypatch):
    outputs, _ = TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)
    found = [of.inflation for of in outputs]
    assert min(found) >= 1.0
    monkeypatch.setattr("skmtgp._estimators.carried.inflation", None)
    outputs, _ = TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)
    assert [of.inflation for of in outputs] == found


def test_the_same_again(model):
    identifier = TaskIdentifier(model)
    first = identifier.estimate(NEW[:, None], Y_NEW)
    again = pickle.loads(pickle.dumps(identifier)).estimate(NEW[:, None], Y_NEW)
    pd.testing.assert_series_equal(first[0], again[0])
    pd.testing.assert_frame_equal(first[1], again[1])
    assert clone(identifier).floor == identifier.floor


class TestModels:
    """One model of several outputs, or one for each; pipelines; searches."""

    def test_models_of_one_output_are_the_same(self, model):
        expected = TaskIdentifier(model).estimate(NEW[:, None], Y_NEW)
        names = ["y1", "y2"]
        each = [MultiTaskGPRegressor(**DESCRIBED).fit(X, of) for of in Y.T]
        pipelines = [make_pipeline(FunctionTransformer(), of) for of in each]
        frame = pd.DataFrame(Y_NEW, columns=names)[names[::-1]]
        given = [(each, Y_NEW), (tuple(pipelines), Y_NEW)]
        named = dict(zip(names, each, strict=True))
        given += [(named, frame), (named, {name: frame[name] for name in frame})]
        for of, y in given[:1] + given[2:]:
            found = TaskIdentifier(of).estimate(NEW[:, None], y)
            np.testing.assert_allclose(found[0], expected[0], rtol=1e-5)
            np.testing.assert_allclose(found[1], expected[1], rtol=1e-4)

    @pytest.mark.parametrize(
        "options",
        [
            {"shared": True},
            {"diagonal": True},
            {"task_levels": True},
            {"noise": "per_task"},
            {"inference": "sparse", "n_inducing": 30},
        ],
        ids=str,
    )
    def test_forms_and_engines(self, options):
        of = MultiTaskGPRegressor(**DESCRIBED | {"max_iter": 30} | options)
        of = of.fit(X, Y[:, 0])
        identifier = TaskIdentifier(of)
        y = draw(NEW, AGE[2], SIZE[2], seed=5)[:, 0]
        assert identifier.predict_proba(NEW[:, None], y)[2] > 0.5
        mean, covariance = identifier.estimate(NEW[:, None], Y_NEW[:, 0])
        z = (mean - ANOTHER) / np.sqrt(np.diagonal(covariance))
        assert np.abs(z).max() < 3.5

    def test_a_search(self):
        search = RankSearchIC(MultiTaskGPRegressor(**DESCRIBED), ranks=(2,))
        search.fit(X, Y[:, 0])
        found = TaskIdentifier(search).estimate(NEW[:, None], Y_NEW[:, 0])
        best = search.best_estimator_
        expected = TaskIdentifier(best).estimate(NEW[:, None], Y_NEW[:, 0])
        pd.testing.assert_series_equal(found[0], expected[0])

    def test_a_frame_with_names(self):
        names = ["x", "age", "size", "machine"]
        frame = pd.DataFrame(X, columns=names)
        frame["machine"] = "m" + frame["machine"].astype(int).astype(str)
        options = DESCRIBED | {"task_descriptors": ["age", "size"]}
        of = MultiTaskGPRegressor(task_feature="machine", **options).fit(frame, Y)
        identifier = TaskIdentifier(of)
        mean, _ = identifier.estimate(pd.DataFrame({"x": NEW}), Y_NEW)
        assert mean.index.tolist() == ["age", "size"]
        same = identifier.estimate(pd.DataFrame({"age": 0.0, "x": NEW}), Y_NEW)[0]
        pd.testing.assert_series_equal(mean, same)
        y = draw(NEW, AGE[3], SIZE[3])
        best = identifier.predict_proba(pd.DataFrame({"x": NEW}), y).argmax()
        assert identifier.classes_[best] == "m3"
        with pytest.raises(ValueError, match=r"X lacks the columns \['x'\]"):
            identifier.estimate(pd.DataFrame({"z": NEW}), Y_NEW)

    def test_columns_of_the_task_are_not_looked_at(self, model):
        identifier = TaskIdentifier(model)
        expected = identifier.estimate(NEW[:, None], Y_NEW)[0]
        table = np.column_stack([NEW, np.full((len(NEW), 3), [1.0, 2.0, 77])])
        found = identifier.estimate(table, Y_NEW)[0]
        pd.testing.assert_series_equal(found, expected)


class TestRefusals:
    def test_estimate_needs_descriptors(self, undescribed):
        with pytest.raises(ValueError, match="Fit it with task_descriptors"):
            TaskIdentifier(undescribed).estimate(NEW[:, None], Y_NEW)

    def test_other_models(self):
        of = PooledGP(max_iter=0).fit(X, Y)
        with pytest.raises(
            TypeError, match=r"must be a MultiTaskGPRegressor.*PooledGP"
        ):
            TaskIdentifier(of).predict_proba(NEW[:, None], Y_NEW)
        with pytest.raises(ValueError, match="model is empty"):
            TaskIdentifier([]).predict_proba(NEW[:, None], Y_NEW)

    def test_several_kernels(self):
        of = MultiTaskGPRegressor([RBF(), RBF(0.2)], rank=1, max_iter=0)
        of.fit(X[:, [0, 3]], Y)
        with pytest.raises(ValueError, match="this one has 2 terms"):
            TaskIdentifier(of).predict_proba(NEW[:, None], Y_NEW)

    def test_units_of_each_task(self):
        options = OPTIONS | {"normalize_y": "per_task", "max_iter": 0}
        of = MultiTaskGPRegressor(**options).fit(X[:, [0, 3]], Y)
        with pytest.raises(ValueError, match="units of their own"):
            TaskIdentifier(of).predict_proba(NEW[:, None], Y_NEW)

    def test_models_that_are_not_alike(self, model):
        some = X[:, -1] < M - 1
        options = DESCRIBED | {"max_iter": 0}
        other = MultiTaskGPRegressor(**options).fit(X[some], Y[some])
        with pytest.raises(ValueError, match="The models know different tasks"):
            TaskIdentifier([model, other]).predict_proba(NEW[:, None], Y_NEW)
        table = X * np.array([1.0, 2.0, 1.0, 1.0])
        other = MultiTaskGPRegressor(**options).fit(table, Y)
        with pytest.raises(ValueError, match="different descriptors"):
            TaskIdentifier([model, other]).predict_proba(NEW[:, None], Y_NEW)

    @pytest.mark.parametrize(
        ("x", "y", "match"),
        [
            (NEW[:, None], Y_NEW[:, 0], "y has 1 columns, but the model has 2"),
            (NEW[:1, None], Y_NEW[0], r"2 outputs\. For one .* shape \(1, 2\)\."),
            (NEW[:3, None], Y_NEW, "X has 3 rows, but y has 6"),
            (NEW[:1], 0.5, r"y=0.5 is one number, .* predict_proba\(\[x\], \[y\]\)"),
            (np.ones((6, 2)), Y_NEW, r"must have 4 columns.*or 1, without the task"),
            (NEW[:, None], np.full((6, 2), np.nan), "NaN"),
        ],
    )
    def test_data(self, model, x, y, match):
        with pytest.raises(ValueError, match=match):
            TaskIdentifier(model).predict_proba(x, y)

    @pytest.mark.parametrize(
        ("options", "match"),
        [
            ({"noise": -1.0}, "'noise' parameter"),
            ({"noise": [0.1, 0.1, 0.1]}, "one for each of the 2 outputs"),
            ({"noise": [0.1, -0.1]}, "must be a standard deviation"),
            ({"floor": -1.0}, "'floor' parameter"),
            ({"widening": 0.0}, "'widening' parameter"),
            ({"inflation": 0.0}, "'inflation' parameter"),
            ({"inflation": "much"}, "'inflation' parameter"),
            ({"inflation": [1.0, 2.0, 1.0]}, "one for each of the 2 outputs"),
            ({"inflation": [1.0, 0.0]}, "must be 'auto', a positive number"),
            ({"switching": 1.5}, "'switching' parameter"),
        ],
    )
    def test_parameters(self, model, options, match):
        with pytest.raises(ValueError, match=match):
            TaskIdentifier(model, **options).predict_proba(NEW[:, None], Y_NEW)


class TestStream:
    """Responsibilities, sample after sample."""

    ORDER = np.repeat([1, 4, 2, 1], 15)
    STATES = np.random.default_rng(7).uniform(0.0, 6.0, 60)

    def samples(self):
        return self.STATES[:, None], draw(
            self.STATES, AGE[self.ORDER], SIZE[self.ORDER], seed=8
        )

    def test_the_task_that_it_is(self, model):
        identifier = TaskIdentifier(model).partial_fit(*self.samples())
        best = identifier.path_.argmax(axis=1).reshape(4, 15)
        right = best == self.ORDER.reshape(4, 15)
        assert right[:, 4:].mean() > 0.95
        np.testing.assert_allclose(identifier.path_.sum(axis=1), 1.0)

    def test_part_by_part_is_the_same(self, model):
        x, y = self.samples()
        whole = TaskIdentifier(model).partial_fit(x, y)
        parts, path = TaskIdentifier(model), []
        for rows in (slice(0, 1), slice(1, 20), slice(20, 60)):
            path.append(parts.partial_fit(x[rows], y[rows]).path_)
        np.testing.assert_allclose(np.vstack(path), whole.path_, atol=1e-9)
        np.testing.assert_array_equal(parts.responsibilities_, parts.path_[-1])
        parts.reset()
        assert not hasattr(parts, "responsibilities_")
        again = parts.partial_fit(x, y).path_
        np.testing.assert_allclose(again, whole.path_, atol=1e-9)

    def test_one_sample_by_the_book(self, model):
        identifier = TaskIdentifier(model, floor=0.0, inflation=1.0, switching=0.1)
        found = identifier.partial_fit(NEW[:1, None], Y_NEW[:1]).responsibilities_
        log_densities = []
        for m in range(M):
            x = with_task(NEW[:1], AGE[m], SIZE[m], m)
            mean, std = model.predict(x, return_std=True, include_noise=True)
            log_densities.append(norm.logpdf(Y_NEW[:1], mean, std).sum())
        # of another task the mean and the variance over the prior of its descriptors
        centre, scale = _population(model._descriptors, 2.0)
        drawn = centre + np.random.default_rng(0).standard_normal((4000, 2)) @ scale.T
        x = np.column_stack([np.full(4000, NEW[0]), drawn, 100 + np.arange(4000)])
        mean, std = model.predict(x, return_std=True, include_noise=True)
        variance = np.square(std).mean(axis=0) + mean.var(axis=0)
        another = norm.logpdf(Y_NEW[0], mean.mean(axis=0), np.sqrt(variance)).sum()
        weights = np.exp(np.append(log_densities, another))
        np.testing.assert_allclose(found, weights / weights.sum(), atol=0.02)

    def test_a_task_that_is_unknown(self, model):
        x = self.STATES[:20]
        identifier = TaskIdentifier(model)
        identifier.partial_fit(x[:, None], draw(x, 12.0, 3.0, seed=9))
        assert identifier.responsibilities_[-1] > 0.9

    def test_responsibilities_by_the_book(self):
        rng = np.random.default_rng(0)
        log_densities, usual = rng.standard_normal((5, 3)), np.full(3, 1.0 / 3.0)
        found = np.exp(follow(np.log(usual), log_densities, usual, 0.2))
        transition = 0.8 * np.eye(3) + 0.2 / 3.0
        state = usual
        for row, expected in zip(log_densities, found, strict=True):
            state = np.exp(row) * (state @ transition)
            state /= state.sum()
            np.testing.assert_allclose(expected, state, rtol=1e-12)

    def test_densities_far_below_do_not_underflow(self):
        log_densities = np.array([[-1e5, -2e5], [-2e5, -1e5], [-1e5, -3e5]])
        usual = np.full(2, 0.5)
        found = follow(np.log(usual), log_densities, usual, 0.01)
        np.testing.assert_array_equal(found.argmax(axis=1), [0, 1, 0])
        assert np.isfinite(found).all()

    def test_another_model_needs_a_reset(self, model):
        identifier = TaskIdentifier(model).partial_fit(NEW[:, None], Y_NEW)
        identifier.model = model.add_task(with_task(NEW, *ANOTHER, 9), Y_NEW)
        with pytest.raises(
            ValueError,
            match=r"knows 7 tasks, .*, but knew 6 tasks, .* in the last call",
        ):
            identifier.partial_fit(NEW[:, None], Y_NEW)
        identifier.reset().partial_fit(NEW[:, None], Y_NEW)
        assert identifier.responsibilities_.shape == (M + 2,)


def test_linear_steps_lead_to_the_mode_that_scoring_finds(model):
    outputs, starts = TaskIdentifier(model)._outputs(NEW[:, None], Y_NEW)
    unknown, u = Unknown(outputs), starts[0]
    unknown.carry(u)
    H, b = np.eye(len(u)), np.zeros(len(u))  # by the book, the covariances held
    for border, (c, A) in zip(unknown.borders, unknown.maps, strict=True):
        S, design = border._covariance(c + A @ u)[0], border.means.T @ A
        H += design.T @ np.linalg.solve(S, design)
        b += design.T @ np.linalg.solve(S, border.y - border.means.T @ c)
    np.testing.assert_allclose(unknown.reweight(u)[0], np.linalg.solve(H, b), rtol=1e-8)
    found, _ = identify(outputs, starts)
    unknown.carry(found.u, found.root)
    by_scoring = unknown.climb(u)
    np.testing.assert_allclose(found.u, by_scoring.u, atol=1e-3)
    assert found.log_evidence == pytest.approx(by_scoring.log_evidence, abs=1e-6)
