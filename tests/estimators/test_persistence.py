"""What scikit-learn users do with regressors, done with those of the package."""

import pickle
import subprocess
import sys

import joblib
import numpy as np
import pytest
from citizens import ESTIMATORS, FRAME, Y, assert_same_bits, spreads
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


KERNELS = "sklearn.gaussian_process.kernels."
TERMS = "skmtgp.model._nodes.terms."
POSTERIOR = {
    f"{KERNELS}Hyperparameter",
    f"{KERNELS}RBF",
    "skmtgp._estimators.units.Units",
    "skmtgp._numerics.linalg.Cholesky",
    "skmtgp.inference.dense.DenseLikelihood",
    "skmtgp.inference.dense.DensePosterior",
    "skmtgp.inference.engines.Dense",
    "skmtgp.model.prior.Prior",
}
LOW_RANK = {
    *POSTERIOR,
    "skmtgp.multitask.MultiTaskGPRegressor",
    "skmtgp.model.task_covariance.LowRank",
}
FIXED = {
    *POSTERIOR,
    f"{KERNELS}ConstantKernel",
    f"{KERNELS}Product",
    "skmtgp.model.task_covariance.FixedTaskCovariance",
}
DENSE = {
    "skmtgp.inference.engines.Dense",
    "skmtgp.inference.dense.DenseLikelihood",
    "skmtgp.inference.dense.DensePosterior",
}
BY_INDUCING_INPUTS = {
    f"{TERMS}BoundStationary",
    f"{TERMS}StationaryNode",
    f"{TERMS}_rbf",
    "skmtgp.model._nodes.differences.Differences",
    "skmtgp.inference.engines.Sparse",
    "skmtgp.inference.features.Features",
    "skmtgp.inference.features.TermFeatures",
    "skmtgp.inference.loadings.Loadings",
    "skmtgp.inference.sparse.SparseBound",
    "skmtgp.inference.sparse_posterior.SparsePosterior",
    "skmtgp.inference.weights.Covariances",
}
WIDER = {"skmtgp.inference.leeway.Scaled", "skmtgp.inference.leeway.OfAll"}
APART = {"skmtgp.inference.apart.ApartLikelihood"}  # of tasks that share nothing
ONE_MATRIX = {"skmtgp.inference.dense.DenseLikelihood"}
# What skops must be told to trust, for each estimator with its default kernel; another
# kernel adds itself and its node in skmtgp.model._nodes.
TRUSTED = {
    "MultiTaskGPRegressor": LOW_RANK,
    "IndependentGP": FIXED - ONE_MATRIX | APART | {"skmtgp.baselines.IndependentGP"},
    "PooledGP": {*FIXED, "skmtgp.baselines.PooledGP"},
    "SingleTaskGP": {
        *FIXED,
        "skmtgp.baselines.PooledGP",
        "skmtgp.single_task.SingleTaskGP",
    },
    "BayesianLinearRegression": {
        "skmtgp.linear.BayesianLinearRegression",
        "skmtgp.inference.linear.LinearPosterior",
    },
    "RankSearchIC": {*LOW_RANK, "skmtgp.model_selection.RankSearchIC"},
}


def ours(types):
    """Those of the package: a later skops may trust scikit-learn's by itself."""
    return {name for name in types if name.startswith("skmtgp.")}


ELSEWHERE = """
import sys, joblib
models, table = joblib.load(sys.argv[1])
found = {
    name: model.predict(table, return_std=True) for name, model in models.items()
}
joblib.dump(found, sys.argv[2])
"""


SMOOTH, ROUGHER = {f"{KERNELS}RBF"}, {f"{KERNELS}Matern"}


class TestPersistence:
    def test_pickle(self, fitted):
        again = pickle.loads(pickle.dumps(fitted))
        assert repr(again) == repr(fitted)
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    @pytest.mark.parametrize("compress", [0, 3])
    def test_joblib(self, fitted, compress, tmp_path):
        joblib.dump(fitted, tmp_path / "model", compress=compress)
        again = joblib.load(tmp_path / "model")
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    @pytest.mark.parametrize("as_pipeline", [False, True])
    def test_skops(self, fitted, as_pipeline):
        skops = pytest.importorskip("skops.io")
        data = skops.dumps(make_pipeline(fitted) if as_pipeline else fitted)
        trusted = TRUSTED[type(fitted).__name__]
        if getattr(fitted, "inference_", None) == "sparse":
            trusted = trusted - DENSE - APART | BY_INDUCING_INPUTS
        if np.max(getattr(fitted, "variance_factor_", 1.0)) > 1.0:
            trusted = trusted | WIDER
        if getattr(fitted, "diagonal_", False):  # BIC has chosen independent tasks
            trusted = trusted | {"skmtgp.model.task_covariance.WithDiagonal"}
        found = set(skops.get_untrusted_types(data=data))
        if ROUGHER & found:  # the data have chosen another kernel
            trusted = trusted - SMOOTH | ROUGHER
        assert found <= trusted
        assert ours(found) == ours(trusted)
        again = skops.loads(data, trusted=sorted(trusted))
        assert_same_bits(spreads(again, FRAME), spreads(fitted, FRAME))

    def test_another_process_predicts_the_same_bits(self, tmp_path):
        models = {k: clone(v).fit(FRAME, Y) for k, v in ESTIMATORS.items()}
        paths = tmp_path / "models", tmp_path / "found"
        joblib.dump((models, FRAME), paths[0])
        command = [sys.executable, "-W", "error", "-c", ELSEWHERE, *map(str, paths)]
        subprocess.run(command, check=True, timeout=60)
        found = joblib.load(paths[1])
        for name, model in models.items():
            assert_same_bits(found[name], model.predict(FRAME, return_std=True))
