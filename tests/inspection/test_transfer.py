import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pictured import QUICK, X, Y, texts, y
from scipy.stats import norm, ttest_1samp
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.pipeline import make_pipeline

from skmtgp import IndependentGP, MultiTaskGPRegressor, PooledGP, SingleTaskGP
from skmtgp._estimators.posing import kernel_made
from skmtgp.datasets import make_sites
from skmtgp.exceptions import SamplingWarning
from skmtgp.inspection import TransferDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
COLUMNS = [
    "rows",
    "log_density",
    "log_density_alone",
    "gain",
    "gain_std",
    "error",
    "error_alone",
    "verdict",
]


def related(seed=0, rows=24, noise=0.2):
    """Five multiples of one function, and another one."""
    rng = np.random.default_rng(seed)
    task = np.repeat(np.arange(6), rows)
    x = rng.uniform(0.0, 6.0, len(task))
    y = np.array([1.0, -1.2, 0.8, 1.4, -0.9, 0.0])[task] * np.sin(2 * x)
    y += np.where(task == 5, np.cos(x**2 / 3), 0.0) + task
    return np.column_stack([x, task]), y + noise * rng.standard_normal(len(task))


@pytest.fixture(scope="module")
def compared():
    model = MultiTaskGPRegressor(rank=1, learning="staged").fit(*related())
    return model, TransferDisplay.from_estimator(model)


class TestTable:
    def test_one_task_has_no_others_to_help_it(self):
        X, _ = related()
        X[:, -1] = 0.0
        display = TransferDisplay.from_estimator(PooledGP().fit(X, np.sin(2 * X[:, 0])))
        assert display.transfer["verdict"].tolist() == ["neither"]

    def test_is_that_of_the_predictions(self, compared):
        model, display = compared
        X, y = related()
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * kernel_made(model, None, X[:, :1])
        alone = SingleTaskGP(kernel + ConstantKernel(1.0, "fixed")).fit(X, y)
        table = display.transfer
        assert table.columns.tolist() == [*COLUMNS, "evidence", "related"]
        assert table.index.tolist() == model.tasks_.tolist()
        assert table.index.name == "task"
        both = (of.loo_predict(include_noise=True) for of in (model, alone))
        for (mean, std), suffix in zip(both, ("", "_alone"), strict=True):
            for m, row in table.iterrows():
                r = X[:, -1] == m
                density = norm.logpdf(y[r], mean[r], std[r]).mean()
                assert row[f"log_density{suffix}"] == pytest.approx(density)
                error = np.sqrt(np.mean((y[r] - mean[r]) ** 2))
                assert row[f"error{suffix}"] == pytest.approx(error)
        gain = table["log_density"] - table["log_density_alone"]
        assert_allclose(table["gain"], gain)
        assert (table["rows"] == 24).all()

    def test_a_task_that_is_not_like_the_others(self, compared):
        table = compared[1].transfer
        assert table["related"].tolist() == [True] * 5 + [False]
        assert table["verdict"][5] == "harmed"
        assert "harmed" not in table["verdict"][:5].tolist()
        assert table["evidence"][5] < 2.0
        assert table["error"][5] > 2.0 * table["error_alone"][5]

    def test_a_task_alone_is_learned_without_the_rows_it_predicts(self):
        """Of few rows for its hyperparameters it predicts those too well."""
        rng = np.random.default_rng(10)
        slopes = [2.0, -1.2, 1.0, 0.7, 0.0, 0.0] * (1 + 0.2 * rng.normal(size=(4, 6)))
        task, Z = np.repeat(np.arange(4), 16), rng.normal(size=(64, 6))
        y = (slopes[task] * Z).sum(axis=1) + 0.8 * rng.normal(size=64)
        X = np.column_stack([Z, task])
        model = MultiTaskGPRegressor(rank=1, learning="staged").fit(X, y)
        table = TransferDisplay.from_estimator(model).transfer
        assert (table["error_alone"] > 0.8).all()
        assert "harmed" not in table["verdict"].tolist()
        seen, _ = SingleTaskGP().fit(X, y).loo_predict()
        assert np.mean(table["error_alone"] ** 2) > 1.3 * np.mean((y - seen) ** 2)

    @pytest.mark.parametrize("rows", [4, 2])
    def test_known_noise_of_few_rows(self, rows):
        """What is left out is as uncertain as measured: means of many are less so."""
        X, y = related(rows=rows)
        model = MultiTaskGPRegressor(rank=1, max_iter=3)
        found = []
        for alpha in (0.04, 4.0):
            fitted = clone(model).fit(X, y, alpha=np.full(len(y), alpha))
            found.append(TransferDisplay.from_estimator(fitted).transfer)
        certain, uncertain = (of["log_density_alone"] for of in found)
        assert np.isfinite(certain).all()
        assert np.isfinite(uncertain).all()
        assert (uncertain < -np.log(2.0)).all()  # the noise alone has a deviation of 2
        both = np.column_stack([y, y]), np.tile([4.0, 0.04], (len(y), 1))
        fitted = clone(model).fit(X, both[0], alpha=both[1])
        table = TransferDisplay.from_estimator(fitted, output=1).transfer
        assert np.isfinite(table["log_density_alone"]).all()

    def test_units_of_y_do_not_matter(self):
        X, y = related(rows=8)
        model = MultiTaskGPRegressor(rank=1, max_iter=5)
        small, large = (
            TransferDisplay.from_estimator(clone(model).fit(X, of)).transfer
            for of in (y, 8.0 * y)
        )
        for name in ("gain", "gain_std", "evidence"):
            assert_allclose(small[name], large[name], rtol=1e-6, atol=1e-8)
        assert_allclose(8.0 * small["error"], large["error"])
        assert_allclose(small["log_density"] - np.log(8.0), large["log_density"])

    def test_verdicts_are_those_of_the_t_test(self):
        rng = np.random.default_rng(0)
        tasks = np.repeat(np.arange(30), rng.integers(2, 9, 30))
        y, mean, other = rng.standard_normal((3, len(tasks)))
        shift = np.linspace(-3.0, 3.0, 30)[tasks]
        std = np.where(tasks % 2, 5.0, 1.0)  # too careful, half of them
        predicted = mean, np.exp(shift), other, std
        table = TransferDisplay.from_predictions(y, *predicted, tasks=tasks).transfer
        gain = norm.logpdf(y, *predicted[:2]) - norm.logpdf(y, *predicted[2:])
        for m, row in table.iterrows():
            found = ttest_1samp(gain[tasks == m], 0.0)
            sign = "helped" if found.statistic > 0.0 else "harmed"
            assert row["verdict"] == (sign if found.pvalue < 0.05 else "neither")
        assert set(table["verdict"]) == {"helped", "harmed", "neither"}

    def test_a_task_with_one_row(self):
        X, y = related(rows=6)
        keep = np.r_[:31]
        model = MultiTaskGPRegressor(rank=1, max_iter=3).fit(X[keep], y[keep])
        row = TransferDisplay.from_estimator(model).transfer.loc[5]
        assert row["rows"] == 1
        assert row["verdict"] == "neither"
        names = ["log_density_alone", "gain", "gain_std", "error_alone"]
        assert row[names].isna().all()
        assert np.isfinite(row["log_density"])

    def test_several_outputs(self):
        both = IndependentGP("rbf", **QUICK).fit(X, Y)
        found = TransferDisplay.from_estimator(both, output=1).transfer
        of_both = {"normalize_y": both.normalize_y_, "noise": both.noise_}
        one = IndependentGP("rbf", **QUICK, **of_both)
        expected = TransferDisplay.from_estimator(one.fit(X, Y[:, 1])).transfer
        pd.testing.assert_frame_equal(found, expected, rtol=1e-6)

    @pytest.mark.parametrize(
        "model",
        [
            MultiTaskGPRegressor(RBF([1.0, 2.0]), rank=1, **QUICK),
            MultiTaskGPRegressor(rank=1, inference="sparse", n_inducing=9, **QUICK),
            MultiTaskGPRegressor(rank=0, shared=True, **QUICK),
            PooledGP(noise="per_task", **QUICK),
        ],
    )
    def test_other_models(self, model):
        table = TransferDisplay.from_estimator(clone(model).fit(X, y)).transfer
        assert np.isfinite(table.drop(columns=["verdict", "related"])).all(axis=None)

    def test_complete_data(self):
        x = np.linspace(0.0, 6.0, 12)
        X = np.column_stack([np.tile(x, 3), np.repeat([0, 1, 2], 12)])
        model = MultiTaskGPRegressor(rank=1, **QUICK, inference="kronecker")
        y = np.sin(X[:, 0]) * (1.0 + X[:, 1]) + 0.1 * np.cos(9 * X[:, 0])
        model.fit(X, y)
        found, expected = (
            TransferDisplay.from_estimator(of).transfer
            for of in (model, clone(model).set_params(inference="dense").fit(X, y))
        )
        pd.testing.assert_frame_equal(found, expected, rtol=1e-4)

    def test_search_and_pipeline(self, fitted):
        search = fitted["RankSearchIC"]
        found = TransferDisplay.from_estimator(make_pipeline(search)).transfer
        expected = TransferDisplay.from_estimator(search.best_estimator_).transfer
        pd.testing.assert_frame_equal(found, expected)


class TestPicture:
    def test_gains(self, compared):
        table = compared[1].transfer
        display = TransferDisplay(transfer=table).plot()
        assert set(display.bars_) == set(table["verdict"])
        _, _, (bars,) = display.bars_["harmed"]
        ((x, low), (_, high)) = bars.get_segments()[0]
        assert x == 5
        assert (low + high) / 2 == pytest.approx(table["gain"][5])
        assert high < 0.0
        assert texts(display.ax_.get_xticklabels()) == list("012345")
        hollow = [of for of in display.ax_.lines if of.get_mfc() == "white"]
        assert [of.get_xdata().tolist() for of in hollow if len(of.get_xdata())] == [
            [5]
        ]
        assert "not related" in texts(display.ax_.get_legend().get_texts())

    def test_errors(self, compared):
        table = compared[1].transfer
        display = TransferDisplay(transfer=table).plot(kind="error")
        for line, name in zip(display.lines_, ("error", "error_alone"), strict=True):
            assert_array_equal(line.get_ydata(), table[name])

    def test_without_relations(self):
        rng = np.random.default_rng(0)
        y, mean, other = rng.standard_normal((3, 8))
        tasks, std = np.repeat(["v", "u"], 4), np.ones(8)
        display = TransferDisplay.from_predictions(
            y, mean, std, other, std, tasks=tasks, kind="gain"
        )
        assert display.transfer.columns.tolist() == COLUMNS
        assert display.transfer.index.tolist() == ["u", "v"]
        labels = texts(display.ax_.get_legend().get_texts())
        assert "not related" not in labels


class TestWarnings:
    @pytest.mark.filterwarnings("ignore::skmtgp.exceptions.SamplingWarning")
    def test_name_the_tasks_that_were_learned_alone(self):
        X, y = make_sites()
        X, y = X.groupby("site").head(4), y[X.groupby("site").head(4).index]
        sampled = {"hyperparameters": "sampled", "n_draws": 4}
        model = MultiTaskGPRegressor("rbf", rank=1, task_feature="site", **sampled)
        model.fit(X, y)
        match = "^Of the models of each task alone: Task '[a-z]+': The draws of"
        with pytest.warns(SamplingWarning, match=match):
            TransferDisplay.from_estimator(model)


class TestErrors:
    @pytest.mark.parametrize("name", ["SingleTaskGP", "BayesianLinearRegression"])
    def test_models_of_tasks_alone(self, fitted, name):
        with pytest.raises(TypeError, match=f"{name} has no task_cov.*to compare"):
            TransferDisplay.from_estimator(fitted[name])

    def test_unknown_kind(self, fitted):
        with pytest.raises(ValueError, match="kind='loss' must be one of 'gain', 'err"):
            TransferDisplay.from_estimator(fitted["PooledGP"], kind="loss")

    def test_deviations_that_are_not_positive(self):
        columns = np.ones((5, 4))
        columns[4, 2] = 0.0
        with pytest.raises(ValueError, match=r"y_std_alone must be positive; .* 0.0"):
            TransferDisplay.from_predictions(*columns, tasks=[0, 0, 1, 1])

    def test_dask_rows(self):
        da = pytest.importorskip("dask.array")
        model = MultiTaskGPRegressor(rank=1, inference="sparse", max_iter=0)
        model.fit(da.from_array(X, chunks=9), da.from_array(y, chunks=9))
        with pytest.raises(ValueError, match="needs the training rows"):
            TransferDisplay.from_estimator(model)
