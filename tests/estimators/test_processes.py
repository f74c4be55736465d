"""What scikit-learn users do with regressors, done with those of the package."""

import joblib
import numpy as np
import pandas as pd
import pytest
from citizens import CV, ESTIMATORS, FRAME, QUICK, Y, assert_same_bits, spreads, y
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import cross_validate
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp._numerics.parallel import SMALL

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


SPREAD = {  # over what n_jobs spreads the work
    "restarts": MultiTaskGPRegressor(n_restarts_optimizer=2, random_state=0, **QUICK),
    "outputs and ranks": ESTIMATORS["RankSearchIC"],
    "tasks": ESTIMATORS["SingleTaskGP"],
    "outputs": MultiTaskGPRegressor(rank=2, **QUICK),
    "outputs, independent": ESTIMATORS["IndependentGP"],
    "outputs, pooled": ESTIMATORS["PooledGP"],
}
QUICKEST = ["outputs and ranks", "tasks"]


@pytest.mark.filterwarnings("ignore:A worker stopped while some jobs were given")
class TestProcesses:
    @pytest.mark.parametrize(
        "model",
        [
            pytest.param(of, id=name, marks=[pytest.mark.long] * (name not in QUICKEST))
            for name, of in SPREAD.items()
        ],
    )
    def test_same_bits_for_any_number(self, model):
        one, two = (clone(model).set_params(n_jobs=n).fit(FRAME, Y) for n in (1, 2))
        assert_same_bits(spreads(two, FRAME), spreads(one, FRAME))
        found, expected = (getattr(m, "best_estimator_", m) for m in (two, one))
        assert (
            found.log_marginal_likelihood_value_
            == expected.log_marginal_likelihood_value_
        )

    def test_same_bits_where_blas_may_have_threads(self):
        """From 600 samples on it may; other numbers of them would round differently."""
        large = pd.concat([FRAME] * -(-SMALL // len(FRAME)), ignore_index=True)
        targets = np.random.default_rng(0).normal(size=(len(large), 2))
        model = MultiTaskGPRegressor(rank=1, max_iter=2)
        with threadpool_limits(1), pytest.warns(ConvergenceWarning):
            one, two = (
                clone(model).set_params(n_jobs=n).fit(large, targets) for n in (1, 2)
            )
        assert_same_bits([one.theta_], [two.theta_])

    def test_the_context_sets_their_number(self):
        model = SPREAD["outputs"]
        expected = spreads(clone(model).fit(FRAME, Y), FRAME)
        with joblib.parallel_config("threading", n_jobs=2):
            found = spreads(clone(model).fit(FRAME, Y), FRAME)
        assert_same_bits(found, expected)

    def test_folds_side_by_side(self):
        found, expected = (
            cross_validate(SPREAD["tasks"], FRAME, y, cv=CV, n_jobs=n)["test_score"]
            for n in (2, 1)
        )
        np.testing.assert_array_equal(found, expected)
