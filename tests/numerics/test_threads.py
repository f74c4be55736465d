"""Estimators in any number of threads at once, and their threads of BLAS."""

import linecache
import os
import re
import subprocess
import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import joblib
import numpy as np
import pytest
from samples import draw
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_limits

import skmtgp
from skmtgp import (
    BayesianLinearRegression,
    IndependentGP,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp._numerics import parallel as _parallel
from skmtgp._numerics.parallel import ONE_THREAD
from skmtgp.inference import engines, likelihood
from skmtgp.inference.tiles import TiledLikelihood

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.usefixtures("two_threads"),
]
PACKAGE = str(Path(skmtgp.__file__).parent)
LINEAR = re.compile(
    r" @ |\b(eigh|inv|solve|cholesky|Cholesky|qr|lstsq|tensordot|svd|cho_\w+|dpotr."
    r"|dtr\w+|dsyr|dlauum|draw_normal|half_solve|solve_triangular)\("
)
VECTORS = re.compile(r"(s|y|g|direction) @ (\(x - |(q|s|y|g|direction|Bs)\b)")
X, y = draw(per_task=8)
Z = X[::3] + [0.3, 0.1, 0.0]


def blas_threads():
    return max(library.num_threads for library in ONE_THREAD.libraries)


@pytest.fixture
def two_threads():
    """BLAS has two threads, which must be so again at the end."""
    with threadpool_limits(2, user_api="blas"):
        yield
        assert {library.num_threads for library in ONE_THREAD.libraries} == {2}


COMPLETE = np.column_stack([np.tile(X[:8, :2], (3, 1)), np.repeat([0, 1, 2], 8)])
STAGED = {"learning": "staged", "max_iter": 1}  # from one start; "ranks" has them all
SPARSE = {"inference": "sparse", "n_inducing": 5, **STAGED}
MODELS = {
    "dense": (MultiTaskGPRegressor(rank=2, **STAGED), X),
    "diagonal": (MultiTaskGPRegressor(rank=1, diagonal=True, **STAGED), X),
    "kronecker": (MultiTaskGPRegressor(rank=2, **STAGED), COMPLETE),
    "sparse": (MultiTaskGPRegressor(rank=2, **SPARSE), X),
    "optimised": (MultiTaskGPRegressor(inducing_inputs="optimised", **SPARSE), X),
    "k-means": (MultiTaskGPRegressor(inducing_inputs="k-means", **SPARSE), X),
    "ranks": (RankSearchIC(MultiTaskGPRegressor(max_iter=1), ranks=(1, 2)), X),
    "fixed": (IndependentGP(max_iter=2, diagonal=True), X),
    "single": (SingleTaskGP(max_iter=1), X),
    "linear": (BayesianLinearRegression(), X),
}
every_model = pytest.mark.parametrize("name", MODELS)


def fitted(name):
    model, table = MODELS[name]
    return model.fit(table, y[: len(table)])


def use(model):
    """What a model tells, all of it."""
    mean, std = model.predict(Z, return_std=True)
    found = [mean, std, model.predict(Z, return_cov=True)[1]]
    found.append(model.sample_y(Z, 2, random_state=0))
    if hasattr(model, "loo_predict"):
        found.extend(model.loo_predict())
        found.append(model.log_marginal_likelihood())
    if not hasattr(model, "add_task"):
        return found
    new = np.column_stack([X[:4, :2], np.full(4, 9)])
    extended = model.add_task(new, y[:4])
    return [*found, extended.predict(new)]


class Watch:
    """The lines of linear algebra, of some files, that BLAS had two threads for."""

    def __init__(self, *files):
        self.files = [f"{PACKAGE}/{file}" for file in files]
        self.seen, self.found = set(), set()

    def __enter__(self):
        self.before = sys.gettrace()
        threading.settrace(self.trace)
        sys.settrace(self.trace)
        return self

    def __exit__(self, *exception):
        sys.settrace(self.before)
        threading.settrace(self.before)

    def trace(self, frame, event, arg):
        if not frame.f_code.co_filename.startswith(tuple(self.files)):
            return None
        if event == "line":
            place = frame.f_code.co_filename, frame.f_lineno
            line = linecache.getline(*place).strip()
            line = VECTORS.sub("", line.split("#")[0])
            if LINEAR.search(line) and not line.startswith("def "):
                self.seen.add((*place, line))
                if blas_threads() > 1:
                    self.found.add((*place, line))
        return self.trace


class TestSmallMatricesTakeOneThread:
    """Beside a busy process two are tens of times slower."""

    @every_model
    def test_of_small_data(self, name, monkeypatch):
        monkeypatch.setattr(engines, "check_differentiable", lambda kernel, x: None)
        with Watch("") as watch:
            use(fitted(name))
        assert not watch.found
        assert len(watch.seen) > 5

    def test_of_large_data(self, monkeypatch):
        """Those beside its likelihood, and the border of a new task."""
        monkeypatch.setattr(_parallel, "SMALL", 12)
        monkeypatch.setattr(likelihood, "FISHER_ROWS", 8)
        monkeypatch.setattr(likelihood, "FISHER_ROWS_PER_TASK", 0)
        beside = "_numerics/bfgs", "inference/information", "inference/border"
        with Watch(*beside) as watch:
            use(fitted("dense"))
        assert not watch.found
        assert len({file for file, *_ in watch.seen}) == 3
        with Watch("_numerics/linalg") as watch:
            fitted("dense")
        assert watch.found  # there are two for large ones


def at_once(function, n_threads=4, times=2):
    """What a function returns in threads that begin at the same time."""
    met = threading.Barrier(n_threads)

    def work(_):
        met.wait(60)
        return [function() for _ in range(times)]

    with ThreadPoolExecutor(n_threads) as pool:
        return [
            one for of_thread in pool.map(work, range(n_threads)) for one in of_thread
        ]


def assert_same(found, expected, small):
    """To the bit, but for large matrices, for which there may be one thread or two."""
    tolerance = 0.0 if small == 600 else 1e-8
    for one in found:
        for array, of_one in zip(expected, one, strict=True):
            np.testing.assert_allclose(of_one, array, rtol=tolerance, atol=tolerance)


def sizes(*large, without=None):
    """All models but one as small ones, and some as large."""
    pairs = [(name, 600) for name in MODELS if name != without]
    pairs += [(name, 10) for name in large]
    ids = [f"{name}, {'small' if small == 600 else 'large'}" for name, small in pairs]
    return pytest.mark.parametrize(("name", "small"), pairs, ids=ids)


class TestAtOnce:
    @pytest.fixture(autouse=True)
    def size(self, small, monkeypatch):
        """24 rows are small, or so many that tiles are shared out among threads."""
        monkeypatch.setattr(_parallel, "SMALL", small)

    @sizes("dense", "kronecker", "sparse")
    def test_one_model_tells_the_same(self, name, small):
        model = fitted(name)
        assert_same(at_once(lambda: use(model)), use(model), small)

    @sizes("dense", without="linear")
    def test_likelihoods_elsewhere(self, name, small):
        """Workspaces are not shared, and given back."""
        model = fitted(name)
        theta = getattr(model, "best_estimator_", model).theta_
        thetas = theta + np.linspace(-0.1, 0.1, 5)[:, None]

        def tell():
            return [model.log_marginal_likelihood(theta, True)[1] for theta in thetas]

        assert_same(at_once(tell), tell(), small)

    @sizes("dense")
    def test_fits(self, name, small):
        (model, table), filters = MODELS[name], list(warnings.filters)
        targets, expected = y[: len(table)], fitted(name).predict(Z)
        fit = lambda: [clone(model).fit(table, targets).predict(Z)]  # noqa: E731
        found = at_once(fit, times=1)
        assert_same(found, [expected], small)
        assert warnings.filters == filters

    @pytest.mark.parametrize("small", [600, 10])
    def test_fits_of_joblib_s_threads(self, small):
        filters, expected = list(warnings.filters), fitted("single").predict(Z)
        model = clone(MODELS["single"][0]).set_params(n_jobs=3)
        with joblib.parallel_config("threading"):
            assert_same([[model.fit(X, y).predict(Z)]], [expected], small)
        assert warnings.filters == filters


OVERLAPPING = """
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from threadpoolctl import threadpool_info
from skmtgp import MultiTaskGPRegressor

def now():
    return [of["num_threads"] for of in threadpool_info() if of["user_api"] == "blas"]

def work(_):
    model = MultiTaskGPRegressor(rank=1, learning="staged", max_iter=3)
    for _ in range(3):
        model.fit(X, y).predict(X, return_std=True)

x, task = np.linspace(0.0, 6.0, 60), np.arange(60) % 3
X, y, before = np.column_stack([x, task]), np.sin(x) * (1 + task), now()
with ThreadPoolExecutor(4) as pool:
    list(pool.map(work, range(4)))
print(before, now(), sep=chr(10))
"""


@pytest.mark.long
def test_blas_has_its_threads_again():
    """In a process where no test has limited them."""
    threads = {"OPENBLAS_NUM_THREADS": "2", "MKL_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", OVERLAPPING],
        env=os.environ | threads,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    before, after = done.stdout.splitlines()
    assert after == before, done.stderr


def test_the_workspace_that_another_thread_has_just_taken():
    class Taken(list):
        def __bool__(self):
            return True

    model = fitted("dense")
    (of_output,) = model._likelihoods
    assert isinstance(of_output, TiledLikelihood)
    of_output._spare = Taken()
    assert np.isfinite(model.log_marginal_likelihood(model.theta_))


def test_tasks_in_threads_name_their_own_warnings():
    model = SingleTaskGP(max_iter=1, n_jobs=3)
    with joblib.parallel_config("threading"), pytest.warns(ConvergenceWarning) as told:
        model.fit(X, y)
    told = [str(of.message) for of in told if of.category is ConvergenceWarning]
    assert [text.partition(":")[0] for text in told] == ["Tasks 0, 1, 2"]
