import numpy as np
import pytest
import textbook
from samples import draw, log_densities, posteriors, split
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp.learning import stages

KERNEL = ConstantKernel(2.0) * RBF([0.7, 1.5])
X, y = draw()
Y = draw(n_outputs=2)[1]
Z = draw(per_task=4, seed=1)[0]
FIXED = {"kernel": KERNEL, "noise_variance": 0.05, "max_iter": 0}
BOTH = pytest.mark.parametrize("cls", [IndependentGP, PooledGP])


def same_by_scikit_learn(features, y):
    """GaussianProcessRegressor at the hyperparameters of FIXED."""
    model = GaussianProcessRegressor(
        KERNEL, alpha=0.05, optimizer=None, normalize_y=True
    )
    return model.fit(features, y)


def log_likelihood(model, y):
    """Of y itself: scikit-learn's is that of y divided by its scale."""
    return model.log_marginal_likelihood_value_ - len(y) * np.log(y.std())


def test_pooled_is_scikit_learns():
    reference = same_by_scikit_learn(split(X)[0], y)
    pooled = PooledGP(**FIXED).fit(X, y)
    found = pooled.predict(Z, return_std=True)
    expected = reference.predict(split(Z)[0], return_std=True)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    cov = reference.predict(split(Z)[0], return_cov=True)[1]
    close = {"rtol": 1e-8, "atol": 1e-10 * cov.max()}
    np.testing.assert_allclose(pooled.predict(Z, return_cov=True)[1], cov, **close)
    value = pooled.log_marginal_likelihood_value_
    assert value == pytest.approx(log_likelihood(reference, y), rel=1e-12)


def test_independent_is_one_of_scikit_learns_for_each_task():
    (x, tasks), (z, tasks_of_Z) = split(X), split(Z)
    model = IndependentGP(task_levels=False, **FIXED).fit(X, y)
    mean, std = model.predict(Z, return_std=True)
    scale, value = y.std(), 0.0
    for m in range(3):
        reference = GaussianProcessRegressor(KERNEL, alpha=0.05, optimizer=None)
        own, rows = tasks == m, tasks_of_Z == m
        reference.fit(x[own], (y[own] - y.mean()) / scale)
        expected = reference.predict(z[rows], return_std=True)
        np.testing.assert_allclose((mean[rows] - y.mean()) / scale, expected[0])
        np.testing.assert_allclose(std[rows] / scale, expected[1])
        value += reference.log_marginal_likelihood_value_ - own.sum() * np.log(scale)
    assert model.log_marginal_likelihood_value_ == pytest.approx(value, rel=1e-12)


@BOTH
@pytest.mark.parametrize("target", [y, Y], ids=["one output", "two outputs"])
@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize("noise", ["shared", "per_task"])
def test_attributes_reproduce_likelihood_and_predictions(cls, target, noise, diagonal):
    model = cls(noise=noise, diagonal=diagonal).fit(X, target)
    expected = log_densities(model, X, target)
    np.testing.assert_allclose(model.log_marginal_likelihoods_, expected)
    mean, std = model.predict(Z, return_std=True)
    for j, (f, K) in enumerate(posteriors(model, X, target, Z)):
        np.testing.assert_allclose(mean.reshape(len(Z), -1)[:, j], f, rtol=1e-7)
        variances = std.reshape(len(Z), -1)[:, j] ** 2
        K = K * np.ravel(model.variance_factor_)[j]
        np.testing.assert_allclose(variances, np.diag(K), atol=1e-9 * K.max())
    n_noise = 3 if noise == "per_task" else 1
    levels = cls is IndependentGP  # one function has one level
    per_output = 3 + n_noise + (3 if diagonal else 0) + levels
    assert model.n_hyperparameters_ == len(expected) * per_output


def test_task_covariances():
    square = y.var()
    alone = IndependentGP(max_iter=0, task_levels=False).fit(X, y)
    np.testing.assert_allclose(alone.task_covariance_, square * np.eye(3))
    np.testing.assert_allclose(alone.task_factor_, np.sqrt(square) * np.eye(3))
    pooled = PooledGP(max_iter=0).fit(X, y)
    np.testing.assert_allclose(pooled.task_covariance_, np.full((3, 3), square))
    np.testing.assert_allclose(pooled.task_factor_, np.full((3, 1), np.sqrt(square)))


@BOTH
def test_task_covariance_with_a_diagonal(cls):
    model = cls(diagonal=True).fit(X, y)
    rest = model.task_covariance_ - cls(max_iter=0).fit(X, y).task_covariance_
    np.testing.assert_allclose(rest, np.diag(np.diag(rest)), atol=1e-9 * y.var())
    assert (np.diag(rest) > 0.0).all()


def best_of_scikit_learn(features, y):
    kernel = KERNEL + WhiteKernel(0.05, (1e-10, 1e3))
    model = GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0, alpha=0.0
    )
    return log_likelihood(model.fit(features, y), y)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_pooled_finds_a_likelihood_no_lower_than_scikit_learns():
    model = PooledGP(KERNEL, noise_variance=0.05).fit(X, y)
    best = best_of_scikit_learn(split(X)[0], y)
    assert model.log_marginal_likelihood_value_ > best - 0.02
    before = PooledGP(**FIXED).fit(X, y).log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ > before + 1.0


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_single_finds_a_likelihood_no_lower_than_scikit_learns():
    x, tasks = split(X)
    model = SingleTaskGP(KERNEL, noise_variance=0.05).fit(X, y)
    best = sum(best_of_scikit_learn(x[tasks == m], y[tasks == m]) for m in range(3))
    assert model.log_marginal_likelihood_value_ > best - 0.05


@pytest.mark.parametrize("target", [y, Y], ids=["one output", "two outputs"])
def test_single_is_one_pooled_for_each_task(target):
    model = SingleTaskGP(KERNEL).fit(X, target)
    mean, std = model.predict(Z, return_std=True)
    cov = model.predict(Z, return_cov=True)[1]
    np.testing.assert_array_equal(mean, model.predict(Z))
    np.testing.assert_allclose(np.diagonal(cov).T, std**2, rtol=1e-6)
    value = 0.0
    for m in range(3):
        own, rows = split(X)[1] == m, split(Z)[1] == m
        alone = PooledGP(KERNEL).fit(X[own], target[own])
        found = alone.predict(Z[rows], return_std=True)
        np.testing.assert_allclose((mean[rows], std[rows]), found)
        np.testing.assert_allclose(
            cov[np.ix_(rows, rows)], alone.predict(Z[rows], return_cov=True)[1]
        )
        assert (cov[np.ix_(rows, ~rows)] == 0.0).all()
        value += alone.log_marginal_likelihood_value_
    assert model.log_marginal_likelihood_value_ == pytest.approx(value)
    assert model.n_hyperparameters_ == 3 * 4 * (target.size // len(target))


def test_single_predicts_observations_too():
    model = SingleTaskGP(**FIXED).fit(X, y)
    std, noisy = (
        model.predict(Z, return_std=True, include_noise=flag)[1]
        for flag in (False, True)
    )
    own = np.array([y[split(X)[1] == m].var() for m in range(3)])
    np.testing.assert_allclose(noisy**2 - std**2, 0.05 * own[split(Z)[1]])


def test_single_with_one_sample_of_a_task():
    rows = np.flatnonzero(split(X)[1] != 0)
    rows = np.append(rows, np.flatnonzero(split(X)[1] == 0)[0])
    model = SingleTaskGP(max_iter=20).fit(X[rows], y[rows])
    at_sample, far = X[rows[-1:]], np.array([[50.0, 50.0, 0.0]])
    np.testing.assert_allclose(model.predict(at_sample), y[rows[-1]])
    np.testing.assert_allclose(model.predict(far), y[rows[-1]])


def test_outputs_are_learned_separately():
    options = {"noise": "shared", "normalize_y": "shared"}  # else outputs decide
    joint = (cls("rbf", **options) for cls in (IndependentGP, PooledGP))
    for model in (*joint, SingleTaskGP("rbf")):
        both = clone(model).fit(X, Y).predict(Z)
        for j in range(2):
            alone = clone(model).fit(X, Y[:, j]).predict(Z)
            np.testing.assert_allclose(both[:, j], alone, rtol=1e-6)


@pytest.mark.parametrize("target", [y, Y], ids=["one output", "two outputs"])
def test_likelihood_of_single_tasks(target):
    model = SingleTaskGP(**FIXED).fit(X, target)
    assert model.log_marginal_likelihood() == model.log_marginal_likelihood_value_
    theta = model.theta_ + 0.1
    value, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == pytest.approx(model.log_marginal_likelihood(theta), rel=1e-12)
    expected = textbook.derivative(model.log_marginal_likelihood, theta)
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6)
    at_mode, _ = model.log_marginal_likelihood(eval_gradient=True)
    assert at_mode == pytest.approx(model.log_marginal_likelihood_value_, rel=1e-10)
    with pytest.raises(ValueError, match=r"theta has shape \(2,\); the model has"):
        model.log_marginal_likelihood([0.0, 0.0])


@pytest.mark.parametrize("cls", [IndependentGP, SingleTaskGP])
def test_two_jobs_find_what_one_does(cls):
    one, two = (cls(n_jobs=k).fit(X, Y).predict(Z) for k in (1, 2))
    np.testing.assert_allclose(two, one, rtol=1e-6)


def of_learning(told):
    """What was told, but for what was decided first."""
    return [line for line in told() if "chosen from the data" not in line]


@pytest.mark.parametrize(
    ("cls", "lines"), [(IndependentGP, 2), (PooledGP, 2), (SingleTaskGP, 3)]
)
def test_verbosity(told, cls, lines):
    cls(max_iter=0).fit(X, Y)
    assert told() == []
    cls(max_iter=0, verbose=1).fit(X, Y)
    found = of_learning(told)
    for j, line in enumerate(found, 1):
        start = f"output {j} of {lines}: log likelihood "
        if cls is SingleTaskGP:
            start = f"task {j - 1} ({j} of {lines}): log likelihood "
        assert line.startswith(start)
        assert line.endswith(" after 0 iterations")
    assert len(found) == lines


@pytest.mark.parametrize("cls", [IndependentGP, PooledGP, SingleTaskGP])
def test_too_few_iterations_are_reported(cls):
    with pytest.warns(ConvergenceWarning, match="max_iter=1 iterations"):
        cls(max_iter=1, tol=1e-9).fit(X, y)


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_warnings_of_single_tasks_name_them(n_jobs):
    with pytest.warns(ConvergenceWarning) as caught:
        SingleTaskGP(max_iter=1, n_jobs=n_jobs).fit(X, y)
    told = [str(of.message) for of in caught if of.category is ConvergenceWarning]
    named = [text.split(":")[0] for text in told]
    assert named == ["Tasks 0, 1, 2"]  # once, as they say the same


@pytest.mark.parametrize("cls", [IndependentGP, PooledGP, SingleTaskGP])
def test_failed_fit_changes_nothing(monkeypatch, cls):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    model = cls(max_iter=0).fit(X, y)
    before = dict(vars(model))
    monkeypatch.setattr(stages, "climb", interrupt)
    with pytest.raises(KeyboardInterrupt):
        model.fit(np.insert(X, 0, 1.0, axis=1), y)
    assert vars(model).keys() == before.keys()
    assert all(vars(model)[name] is value for name, value in before.items())


def test_draws_of_single_tasks():
    model = SingleTaskGP(max_iter=20).fit(X, Y)
    mean, std = model.predict(Z, return_std=True)
    draws = model.sample_y(Z, n_samples=2000)
    assert draws.shape == (*mean.shape, 2000)
    error = np.abs(draws.mean(axis=-1) - mean)
    assert (error <= 5.0 * std / np.sqrt(2000) + 1e-6).all()


@BOTH
def test_verbose_prints_the_course_of_learning(told, cls):
    cls("rbf", verbose=1, noise="shared").fit(X, Y)  # else it may be learned anew
    lines = of_learning(told)
    assert [line.split(":")[0] for line in lines] == [
        "output 1 of 2",
        "output 2 of 2",
    ]
    cls(verbose=2).fit(X, y)
    lines = told()
    of_form = "tasks apart" if cls is IndependentGP else "all tasks alike"
    of_climbs = [line for line in lines if line.startswith(of_form)]
    assert sum(line.endswith("; done, no more to gain") for line in of_climbs) >= 2
    cls().fit(X, y)
    assert told() == []


@pytest.mark.parametrize("cls", [IndependentGP, PooledGP, MultiTaskGPRegressor])
@pytest.mark.parametrize("noise", [1e-2, 1e-8])
def test_without_iterations_the_starting_noise_is_kept(cls, noise):
    model = cls(max_iter=0, noise_variance=noise).fit(X, y)
    assert model.noise_variance_ == pytest.approx(noise * y.var(), rel=1e-9)
