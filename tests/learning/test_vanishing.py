"""Which numbers of a diagonal of K^rho have vanished."""

from math import comb, log

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning.vanishing import price_of_choice, vanished
from skmtgp.model.task_covariance import enlarged, low_rank

M = 4
FORM = enlarged(low_rank(M, 1), diagonal=True)


def test_shares_of_the_variance_are_compared():
    prior = building.prior(RBF(1.0), FORM, levels=True)
    kappa = np.log([1.0, 1e-9, 0.5, 1e-5])
    loadings = [2.0, -1.0, 0.5, 1.0]
    theta = prior.with_rho(prior.theta(), np.append(loadings, kappa))
    found = vanished(prior, theta, 1e-3)
    assert theta[found].tolist() == [kappa[1], kappa[3]]
    assert not vanished(prior, theta, 1e-12).any()
    assert price_of_choice(prior, found.sum()) == pytest.approx(log(comb(4, 2)))


@pytest.mark.parametrize(
    "form", [low_rank(M, 2), enlarged(low_rank(M, 1), diagonal="equal")], ids=str
)
def test_other_forms_have_none(form):
    prior = building.prior(RBF(1.0), form)
    theta = np.full(prior.n_theta, -30.0)
    assert not vanished(prior, theta, 1e-3).any()
    assert price_of_choice(prior, 0) == 0.0
