"""Dask collections that are refused, and what is drawn of their rows."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from far_rows import QUICK, ROWS, N, on_dask
from numpy.testing import assert_allclose, assert_array_equal
from sklearn import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.pipeline import Pipeline
from sparse_models import SPARSE, M, draw

from skmtgp import (
    BayesianLinearRegression,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp._data.dask import is_dask
from skmtgp._data.subsets import draw_rows, shares_of
from skmtgp.exceptions import UnderflowWarning
from skmtgp.kernels import inverse_dynamics_kernel
from skmtgp.preprocessing import InverseDynamicsFeatures

dask = pytest.importorskip("dask")
da = pytest.importorskip("dask.array")
pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


@pytest.fixture(autouse=True)
def without_cluster():
    """Dask's scheduler of one thread."""
    with dask.config.set(scheduler=dask.get):
        yield


class TestPaperPipeline:
    """Its features are learned from rows in memory, and mapped over the partitions."""

    @pytest.fixture
    def frame(self):
        names = [f"{part}{j}" for part in ("q", "qd", "qdd") for j in (1, 2)]
        x = np.random.default_rng(0).standard_normal((N, 6))
        frame = pd.DataFrame(x, columns=names)
        frame.insert(0, "load", np.array(["a", "b", "c"])[np.arange(N) % M])
        return frame.assign(torque=np.sin(x[:, 0]) + 0.3 * np.sign(x[:, 2]))

    def test_refuses(self, frame):
        dd = pytest.importorskip("dask.dataframe")
        far = dd.from_pandas(frame, npartitions=3)
        model = make_inverse_dynamics_regressor(
            clone(QUICK).set_params(kernel=None), n_joints=2, task_feature="load"
        )
        states = far.drop(columns="torque")
        match = (
            r"X is a collection.* X\.map_partitions\(features\.transform, .*user gui"
        )
        with pytest.raises(TypeError, match=match):
            model.fit(states, far["torque"])
        features = model[0].fit(frame.drop(columns="torque"))
        with pytest.raises(TypeError, match=match):
            features.transform(states)

    def test_by_its_steps(self, frame):
        dd = pytest.importorskip("dask.dataframe")
        far = dd.from_pandas(frame, npartitions=3)
        states, here = far.drop(columns="torque"), frame.drop(columns="torque")
        features = InverseDynamicsFeatures(task_feature="load")
        part = states.get_partition(0).compute()
        meta = features.set_output(transform="pandas").fit_transform(part)[:0]
        regressor = clone(QUICK).set_params(
            kernel=inverse_dynamics_kernel(2), task_feature="load"
        )
        mapped = states.map_partitions(features.transform, meta=meta)
        pd.testing.assert_frame_equal(
            mapped.compute(), features.transform(here), check_dtype=False
        )
        regressor.fit(mapped, far["torque"])
        model = Pipeline([("features", features), ("regressor", regressor)])
        found = states.map_partitions(model.predict, meta=("torque", float)).compute()
        assert_allclose(found, model.predict(here), rtol=1e-12, atol=1e-12)


class TestErrors:
    @pytest.mark.parametrize("inference", ["auto", "dense", "kronecker"])
    def test_exact_inference(self, inference):
        model = clone(QUICK).set_params(inference=inference)
        with pytest.raises(ValueError, match="set inference='sparse'"):
            model.fit(*on_dask(*draw(N)))

    @pytest.mark.parametrize(
        "model", [SingleTaskGP(**SPARSE), BayesianLinearRegression()]
    )
    def test_other_estimators(self, model):
        with pytest.raises(ValueError, match="RankSearchIC learn from them where they"):
            model.fit(*on_dask(*draw(N)))

    def test_one_collection(self):
        X, y = draw(N)
        X_far, y_far = on_dask(X, y)
        with pytest.raises(ValueError, match="y is of type ndarray, but the other one"):
            clone(QUICK).fit(X_far, y)
        with pytest.raises(ValueError, match="X is of type ndarray, but the other one"):
            clone(QUICK).fit(X, y_far)

    def test_other_partitions(self):
        X, y = on_dask(*draw(N))
        match = r"X has 4 partitions and y 3.* See the user guide"
        with pytest.raises(ValueError, match=match):
            clone(QUICK).fit(X, y[:-1])
        with pytest.raises(ValueError, match=r"In partition 3: .*inconsistent"):
            clone(QUICK).fit(X, y.rechunk({0: ROWS})[:-1])

    def test_one_dimension(self):
        dd = pytest.importorskip("dask.dataframe")
        X, y = draw(40)
        far, series = da.from_array(X[:, 0], chunks=20), pd.Series(X[:, 0])
        for X_far in (far, dd.from_pandas(series, npartitions=2)):
            with pytest.raises(ValueError, match="Expected 2D array, got 1D"):
                clone(QUICK).fit(X_far, da.from_array(y, chunks=20))

    def test_no_target(self):
        match = "MultiTaskGPRegressor requires y to be passed, but the target y is None"
        with pytest.raises(ValueError, match=match):
            clone(QUICK).fit(on_dask(*draw(N))[0], None)

    def test_rows_in_another_order(self):
        """Told by the index, where X and y have one; it need not be unique."""
        dd = pytest.importorskip("dask.dataframe")
        X, y = draw(40)
        frame = pd.DataFrame(X, columns=["a", "b", "task"], index=np.arange(40) // 2)
        options = {"npartitions": 2, "sort": False}
        far, y_near = dd.from_pandas(frame, **options), pd.Series(y, frame.index)
        model = clone(QUICK).set_params(max_iter=0)
        for y_far in (y_near, y_near.to_frame()):
            model.fit(far, dd.from_pandas(y_far, **options))
            other = dd.from_pandas(y_far[::-1], **options)
            with pytest.raises(ValueError, match=r"In partition \d: .* in their index"):
                model.fit(far, other)
        model.fit(far, other.to_dask_array(lengths=True))

    def test_values_that_cannot_be_used(self):
        X, y = draw(N)
        for bad, match in [
            (np.nan, "In partition 2: Input X contains NaN"),
            (1e80, "In partition 2: X has values as large as 1.0e.80 in column 1"),
        ]:
            X[60, 1] = bad
            with pytest.raises(ValueError, match=match):
                clone(QUICK).fit(*on_dask(X, y))
        X[60] = 0.5
        with pytest.raises(
            ValueError, match="In partition 2: Column 2 cannot hold the tasks: T"
        ):
            clone(QUICK).fit(*on_dask(X, y))

    def test_labels_of_two_kinds(self):
        X, y = draw(N)
        X = X.astype(object)
        X[:150, 2] = "a"
        match = r"strings in partition 0, such as 'a' and integers in partition 3, such"
        with pytest.raises(ValueError, match=match):
            clone(QUICK).fit(*on_dask(X, y))

    def test_labels_that_differ_by_less_than_floats_tell(self):
        """Of a type in each partition that NumPy would join as floats."""
        X, y = draw(N)
        tasks, far = X[:, 2].astype(int), X.astype(object)
        far[:, 2] = [2**62 + task for task in tasks]
        far[150, 2], tasks[150] = 2**63 + 1, M
        expected = BayesianLinearRegression().fit(far, y).tasks_
        model = clone(QUICK).set_params(max_iter=0, kernel=RBF([1.0, 1.0], "fixed"))
        found = clone(model).fit(*on_dask(far, y))
        assert found.tasks_.tolist() == expected.tolist()
        assert len(found.tasks_) == M + 1
        X[:, 2] = tasks
        expected = model.fit(X, y).predict(X)
        assert_allclose(found.predict(far), expected, rtol=1e-6, atol=1e-8)

    def test_labels_that_cannot_be_used(self):
        X, y = draw(N)
        X = X.astype(object)
        X[60, 2] = (1, 2)
        match = (
            r"In partition 2: Column 2 cannot hold the tasks: .* not tuple, .* row 9"
        )
        with pytest.raises(TypeError, match=match):
            clone(QUICK).fit(*on_dask(X, y))

    def test_no_rows(self):
        X, y = on_dask(*draw(N))
        none, y = X[:, 2] > 7, y.rechunk({0: ROWS})
        with pytest.raises(ValueError, match="X has no rows"):
            clone(QUICK).fit(X[none], y[none])

    def test_underflow(self):
        X, y = draw(N)
        X[:, 1] *= 1e-170
        with pytest.warns(UnderflowWarning, match=r"feature \[2\]"):
            clone(QUICK).set_params(max_iter=0).fit(*on_dask(X, y))


class TestDrawing:
    tasks = np.random.default_rng(0).choice(3, 1000, p=[0.7, 0.298, 0.002])

    @pytest.mark.parametrize("chunks", [1000, 300, (1, 998, 1)])
    def test_same_rows_whatever_the_partitions(self, chunks):
        found = draw_rows(da.from_array(self.tasks, chunks=(chunks,)), 3, 100)
        assert_array_equal(found, draw_rows(self.tasks, 3, 100))

    def test_shares(self):
        rows = draw_rows(self.tasks, 3, 100)
        assert (np.diff(rows) > 0).all()
        shares = np.bincount(self.tasks[rows])
        assert_array_equal(shares, shares_of(np.bincount(self.tasks), 100))
        expected = np.bincount(self.tasks) / 10
        assert_allclose(shares, np.maximum(expected, 1.0), atol=1.0)
        assert_array_equal(draw_rows(self.tasks, 3, 1000), np.arange(1000))


@pytest.mark.parametrize(("graph", "expected"), [(None, False), ({}, True)])
def test_what_may_be_dask(graph, expected):
    """As xarray's arrays, in memory or not."""
    wrapper = type("DataArray", (), {"__dask_graph__": lambda self: graph})()
    assert is_dask(np.ones(1), wrapper) == expected


def test_fit_needs_no_dask():
    code = """
        import sys
        sys.modules.update(dask=None, distributed=None)
        import numpy as np
        from skmtgp import PooledGP  # without warnings, too
        x = np.arange(30.0)
        X = np.column_stack([x / 4.0, x > 14.0])
        PooledGP(inference="sparse", n_inducing=9).fit(X, np.sin(x / 4.0))
    """
    command = [
        sys.executable,
        "-W",
        "error",
        "-c",
        "\n".join(map(str.strip, code.splitlines())),
    ]
    subprocess.run(command, check=True, timeout=120)
