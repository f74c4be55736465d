"""Sparse inference from the rows of Dask collections, which stay where they are."""

import contextlib
import os
import pickle
from functools import partial
from importlib import import_module
from time import monotonic, sleep

import building
import numpy as np
import pandas as pd
import pytest
from far_rows import QUICK, ROWS, N, on_dask
from numpy.testing import assert_allclose, assert_array_equal
from sklearn import clone
from sklearn.gaussian_process.kernels import RBF
from sparse_models import FACTOR, GPS, SPARSE, M, draw

from skmtgp import (
    BayesianLinearRegression,
    MultiTaskGPRegressor,
    RankSearchIC,
    SingleTaskGP,
)
from skmtgp.inference import sums
from skmtgp.learning import summarised
from skmtgp.model.several import Forms, Kernels
from skmtgp.model.task_covariance import low_rank

dask = pytest.importorskip("dask")
da = pytest.importorskip("dask.array")
distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(autouse=True)
def without_cluster(request):
    """Dask's scheduler of one thread, where no cluster is asked for."""
    if "client" in request.fixturenames:
        yield
    else:
        with dask.config.set(scheduler=dask.get):
            yield


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


ONE = RBF([0.8, 1.3]), low_rank(M, 2)
TWO = (
    Kernels([RBF([0.8, 1.3]), RBF(0.3)]),
    Forms([low_rank(M, 1, diagonal=True), low_rank(M, 2)]),
)


def bounds(chunks, n_noise=1, model=ONE):
    """The same bound over arrays and over Dask's, and parameters."""
    X, y = draw(N)
    rows = X[:, :2], X[:, 2].astype(int), y
    far = [da.from_array(a, chunks=(chunks, *a.shape[1:])).persist() for a in rows]
    Z, K_rho = X[:20, :2], FACTOR @ FACTOR.T
    here, far = (building.sparse(*model, *of, Z, n_noise) for of in (rows, far))
    return here, far, here.prior.theta(K_rho=K_rho, log_noise=np.log(0.05))


def assert_same_bound(here, far, theta):
    """To 1e-10, relative."""
    assert_allclose(far.value(theta), here.value(theta), rtol=1e-10)
    for found, expected in zip(
        far.value_and_grads(theta), here.value_and_grads(theta), strict=True
    ):
        assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.max(abs(expected)))
    assert_allclose(
        far.fisher_information(theta), here.fisher_information(theta), rtol=1e-10
    )
    X, tasks = np.random.default_rng(1).uniform(-2.0, 2.0, (9, 2)), np.arange(9) % M
    for found, expected in zip(
        *(
            (p.log_likelihood, p.mean(X, tasks), p.covariance(X, tasks))
            for p in (bound.posterior(theta) for bound in (far, here))
        ),
        strict=True,
    ):
        assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


class TestBound:
    @pytest.mark.parametrize("n_noise", [1, M])
    @pytest.mark.parametrize("chunks", [ROWS, (N,), (1,) * 7 + (N - 7,)])
    def test_same_as_in_memory(self, chunks, n_noise):
        assert_same_bound(*bounds(chunks, n_noise))

    @pytest.mark.parametrize("chunks", [ROWS, (1,) * 7 + (N - 7,)])
    def test_several_terms(self, chunks):
        assert_same_bound(*bounds(chunks, M, TWO))

    @pytest.mark.long
    def test_on_a_cluster(self, client):
        here, far, theta = bounds(ROWS)
        assert_same_bound(here, far, theta)
        assert far.value(theta) == far.value(theta)  # whoever is done first

    @pytest.mark.long
    def test_large_arguments(self, client, monkeypatch):
        """Dask's warning of a large graph would come in each step."""
        key = "distributed.admin.large-graph-warning-threshold"
        here, far, theta = bounds(ROWS)
        with dask.config.set({key: "1 kB"}):
            assert_allclose(far.value(theta), here.value(theta), rtol=1e-10)


def assert_same_model(found, expected, X):
    """What is learned differs by what rounding becomes on the way."""
    assert_array_equal(found.tasks_, expected.tasks_)
    rtol = 1e-6 if found.inducing_inputs == "optimised" else 0.0
    assert_allclose(found.inducing_inputs_, expected.inducing_inputs_, rtol=rtol)
    for name in ("log_marginal_likelihoods_", "theta_", "y_mean_", "y_scale_"):
        values = getattr(found, name), getattr(expected, name)
        assert_allclose(*values, rtol=1e-6, atol=1e-6)
    assert found.n_hyperparameters_ == expected.n_hyperparameters_
    for one, other in zip(
        found.predict(X, return_std=True),
        expected.predict(X, return_std=True),
        strict=True,
    ):
        assert_allclose(one, other, rtol=1e-6, atol=1e-8)


ALIKE = ["levels", "per task", "IndependentGP", "PooledGP"]


def tasks_on(dask_scheduler):
    """How much a cluster still holds or has to do."""
    return len(dask_scheduler.tasks)


def wait_until(condition, most=20.0):
    end = monotonic() + most
    while not condition():
        assert monotonic() < end
        sleep(0.05)


class TestFit:
    @pytest.mark.parametrize(
        "model",
        [
            pytest.param(of, id=name, marks=[pytest.mark.long] * (name in ALIKE))
            for name, of in GPS.items()
        ],
    )
    def test_same_as_in_memory(self, model):
        X, y = draw(N)
        model = clone(model).set_params(max_iter=3)
        expected = clone(model).fit(X, y)
        assert_same_model(model.fit(*on_dask(X, y)), expected, X)

    @pytest.mark.parametrize(
        "n_outputs", [None, pytest.param(2, marks=pytest.mark.long)]
    )
    def test_to_the_end(self, n_outputs):
        """What rounding grows to in a whole fit: measured 8e-12 and 6e-10 at most."""
        X, y = draw(N, n_outputs=n_outputs)
        model = MultiTaskGPRegressor(rank=2, inference="sparse", n_inducing=20)
        model.set_params(n_exact=60)
        found, expected = clone(model).fit(*on_dask(X, y)), model.fit(X, y)
        values = (of.log_marginal_likelihood_value_ for of in (found, expected))
        assert_allclose(*values, rtol=0.0, atol=1e-9)
        assert_allclose(found.predict(X), expected.predict(X), rtol=0.0, atol=1e-6)

    @pytest.mark.long
    def test_outputs_on_a_cluster(self, client):
        X, y = draw(N, n_outputs=2)
        model = clone(QUICK).fit(*on_dask(X, y))
        wait_until(lambda: not client.run_on_scheduler(tasks_on))
        expected = clone(QUICK).fit(X, y)
        assert_array_equal(model.inducing_inputs_, expected.inducing_inputs_)
        assert_allclose(model.predict(X), expected.predict(X), rtol=1e-6, atol=1e-8)

    def test_without_normalisation(self):
        X, y = draw(N)
        model = clone(QUICK).set_params(normalize_y=False, kernel=None)
        assert_same_model(
            clone(model).fit(*on_dask(X, y + 3.0)), model.fit(X, y + 3.0), X
        )

    def test_few_rows(self):
        """All of them are learned from exactly at first."""
        X, y = draw(40)
        found = clone(QUICK).fit(*on_dask(X, y, (17, 23)))
        assert_same_model(found, clone(QUICK).fit(X, y), X)

    def test_columns_in_several_chunks(self):
        X, y = draw(N)
        far = da.from_array(X, chunks=(100, 1)), da.from_array(y, chunks=100)
        assert_same_model(clone(QUICK).fit(*far), clone(QUICK).fit(X, y), X)

    @pytest.mark.long
    def test_n_jobs(self):
        """The rows are shared out, and the outputs are not."""
        X, y = draw(N, n_outputs=2)
        model = clone(QUICK).set_params(max_iter=0, n_jobs=2).fit(*on_dask(X, y))
        assert model.predict(X).shape == (N, 2)

    def test_rank_search(self):
        X, y = draw(N)
        search = RankSearchIC(clone(QUICK), ranks=(1, 2), keep_estimators=True)
        found, expected = clone(search).fit(*on_dask(X, y)), search.fit(X, y)
        assert found.best_rank_ == expected.best_rank_
        assert_allclose(found.results_["bic"], expected.results_["bic"], rtol=1e-8)
        assert_same_model(found.best_estimator_, expected.best_estimator_, X)

    def test_leave_one_out_needs_the_rows(self):
        search = RankSearchIC(clone(QUICK), criterion="loo")
        with pytest.raises(ValueError, match=r"criterion='loo' .* fit to arrays"):
            search.fit(*on_dask(*draw(N)))

    def test_dataframes(self):
        """Named columns and tasks; partitions without rows, which a filter leaves."""
        dd = pytest.importorskip("dask.dataframe")
        X, y = draw(N)
        frame = pd.DataFrame(X[:, :2], columns=["a", "b"])
        frame.insert(1, "site", np.array(["x", "y", "z"])[X[:, 2].astype(int)])
        frame["y"], frame["row"] = y, np.arange(N)
        model = clone(QUICK).set_params(task_feature="site")
        far = dd.from_pandas(frame, npartitions=4)
        far, kept = (of[(of["row"] < 75) | (of["row"] >= 150)] for of in (far, frame))
        names = ["a", "site", "b"]
        expected = clone(model).fit(kept[names], kept["y"])
        for y_far in (far["y"], far["y"].to_dask_array()):
            found = clone(model).fit(far[names], y_far)
            assert_array_equal(found.feature_names_in_, names)
            assert_array_equal(found.tasks_, ["x", "y", "z"])
            assert_same_model(found, expected, kept[names])


class TestFitted:
    def test_pickles_without_rows(self):
        X, y = draw(N)
        model = clone(QUICK).fit(*on_dask(X, y))
        dumped = pickle.dumps(model)
        assert b"dask" not in dumped
        assert_array_equal(pickle.loads(dumped).predict(X), model.predict(X))

    def test_predicts_where_the_rows_are(self):
        X, y = draw(N)
        model = clone(QUICK).fit(*on_dask(X, y))
        far = on_dask(X, y)[0].map_blocks(model.predict, drop_axis=1, dtype=float)
        assert_allclose(far.compute(), model.predict(X), rtol=1e-12, atol=1e-12)

    def test_what_needs_rows(self):
        X, y = draw(N)
        model = clone(QUICK).fit(X, y).fit(*on_dask(X, y))
        for name in ("X_train_", "y_train_", "tasks_train_", "complete_"):
            assert not hasattr(model, name)
        match = "needs the training rows, but the MultiTaskGPRegressor was fitted to"
        for call in (
            model.loo_predict,
            lambda: model.conformal_interval(X[:2]),
            lambda: model.log_marginal_likelihood(eval_gradient=True),
            lambda: model.add_task([[0.0, 0.0, 7]], [1.0]),
        ):
            with pytest.raises(ValueError, match=match):
                call()
        value = model.log_marginal_likelihood_value_
        assert model.log_marginal_likelihood() == value
        again = model.fit(X, y)
        assert_allclose(again.log_marginal_likelihood(again.theta_), value, rtol=1e-6)


class TestPredictions:
    """A collection would be collected here, and its columns not be looked at."""

    CALLS = {
        "predict": lambda model, X, y: model.predict(X),
        "std": lambda model, X, y: model.predict(X, return_std=True),
        "score": lambda model, X, y: model.score(X, y),
        "sample_y": lambda model, X, y: model.sample_y(X),
        "add_task": lambda model, X, y: model.add_task(X, y),
    }

    @pytest.mark.parametrize("call", CALLS.values(), ids=CALLS.keys())
    @pytest.mark.parametrize("far", [True, False], ids=["far", "here"])
    def test_of_arrays(self, call, far):
        X, y = draw(40)
        model = clone(QUICK).set_params(max_iter=0)
        model.fit(*(on_dask(X, y, (40,)) if far else (X, y)))
        match = "X is a collection of Dask's .*(X.map_partitions|X.compute).* See the u"
        with pytest.raises((TypeError, ValueError)) as caught:
            call(model, *on_dask(X, y, (40,)))
        if not (far and call is self.CALLS["add_task"]):  # which has no rows to add to
            assert caught.type is TypeError
            caught.match(match)

    @pytest.mark.parametrize(
        "model", [SingleTaskGP(max_iter=0), BayesianLinearRegression()]
    )
    def test_of_other_estimators(self, model):
        X, y = draw(40)
        with pytest.raises(TypeError, match=r"X\.map_partitions\(model\.predict"):
            model.fit(X, y).predict(on_dask(X, y, (40,))[0])

    def test_of_a_rank_search(self):
        X, y = draw(40)
        search = RankSearchIC(clone(QUICK).set_params(max_iter=0), ranks=(1,))
        with pytest.raises(TypeError, match=r"X\.map_partitions\(model\.predict"):
            search.fit(X, y).predict(on_dask(X, y, (40,))[0])

    def test_targets_of_a_new_task(self):
        X, y = draw(40)
        model = clone(QUICK).set_params(max_iter=0).fit(X, y)
        with pytest.raises(TypeError, match="y is a collection of Dask's"):
            model.add_task([[0.0, 0.0, 7]], da.zeros(1))

    def test_columns_in_another_order(self):
        """The partitions of a dataframe have names, which are checked."""
        dd = pytest.importorskip("dask.dataframe")
        X, y = draw(40)
        frame = pd.DataFrame(X, columns=["a", "b", "task"])
        model = clone(QUICK).set_params(max_iter=0, task_feature="task").fit(frame, y)
        far = dd.from_pandas(frame, npartitions=2)
        with pytest.raises(TypeError, match=r"Dask's \(dask DataFrame\)"):
            model.predict(far[["b", "a", "task"]])
        meta = ("output", float)
        found = far.map_partitions(model.predict, meta=meta).compute()
        assert_allclose(found, model.predict(frame), rtol=1e-12, atol=1e-12)
        wrong = far[["b", "a", "task"]].map_partitions(model.predict, meta=meta)
        with pytest.raises(ValueError, match="same order as they were in fit"):
            wrong.compute()


def test_nothing_is_collected(monkeypatch):
    """What comes here is small: a sample, and sums."""
    few = partial(summarised.greedy_variance, n_candidates=300)
    monkeypatch.setattr(summarised, "greedy_variance", few)
    sizes, compute = [], dask.base.compute

    def weighed(*collections, **options):
        results = compute(*collections, **options)
        sizes.append(len(pickle.dumps(results)))
        return results

    for module in (dask, dask.base):
        monkeypatch.setattr(module, "compute", weighed)
    n, d = 20_000, 12
    X = da.random.default_rng(0).standard_normal((n, d), chunks=(n // 4, d))
    X, y = da.concatenate([X, X[:, :1] > 0.0], axis=1), da.sin(X[:, 1])
    model = MultiTaskGPRegressor(rank=1, **SPARSE | {"n_inducing": 5, "max_iter": 0})
    model.fit(X, y)
    assert model.inference_ == "sparse"
    assert max(sizes) < 300 * 8 * (d + 1)
    assert sum(sizes) < 0.1 * X.nbytes


def spring(module, name, path, calls):
    """In a worker: it dies when it is about to call a function once more."""
    module, made = import_module(module), []
    function = getattr(module, name)

    def fatal(*args, **kwargs):
        made.append(None)
        if len(made) > calls:
            with contextlib.suppress(FileExistsError):
                path.touch(exist_ok=False)
                os._exit(1)
        return function(*args, **kwargs)

    setattr(module, name, fatal)


@pytest.mark.long
def test_death_of_a_worker(client, tmp_path):
    """In the middle of a fit; its partitions are made again by the other one."""
    X, y = draw(N)
    expected = clone(QUICK).fit(X, y)
    died = tmp_path / "died"
    client.run(spring, sums.__name__, "sum_gradients", died, 5)
    found = clone(QUICK).fit(*on_dask(X, y))
    assert died.exists()
    assert_same_model(found, expected, X)
    client.wait_for_workers(2)
