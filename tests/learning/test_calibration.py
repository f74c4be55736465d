"""Simulation-based calibration of the draws of hyperparameters (Talts et al., 2018)."""

from unittest.mock import patch

import numpy as np
import pytest
from joblib import Parallel, delayed
from scipy.stats import chisquare
from sklearn.gaussian_process.kernels import RBF

from skmtgp.inference.dense import DenseLikelihood
from skmtgp.learning import sampling
from skmtgp.learning.sampling import quantities, sample_hyperparameters
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import low_rank

pytestmark = pytest.mark.longest
N_SETS, N_ROWS, N_TASKS, N_BINS = 200, 5, 2, 5
SHORT = {"N_WARM": 40, "THINNED": 2, "LENGTH": 3.2, "LEAPS": 12}  # there are many sets


def share_below(seed):
    """Share of the draws below the true quantities, of a data set of true draws."""
    rng = np.random.default_rng(seed)
    prior = Prior(RBF([1.0, 1.0]), low_rank(N_TASKS, 2))
    hyperprior = Hyperprior(prior)
    theta = hyperprior.draw(rng)
    tasks = np.repeat(np.arange(N_TASKS), N_ROWS)
    X = rng.uniform(0.0, 4.0, (len(tasks), 2))
    K = prior.covariance(theta, X, tasks)
    K.flat[:: len(K) + 1] += prior.values(theta).noise[0]
    values, vectors = np.linalg.eigh(K)
    y = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(K)))
    likelihood = DenseLikelihood(prior, X, tasks, y)
    start = [(likelihood, hyperprior.draw(rng, 0.1))]
    with patch.multiple(sampling, **SHORT):
        drawn = sample_hyperparameters(start, n_draws=40, seed=[seed])
    found = np.array([quantities(prior, draw) for draw in drawn.theta])
    return np.mean(found < quantities(prior, theta), axis=0)


def test_ranks_of_the_true_parameters_are_uniform():
    """Of both length-scales, the noise, the tasks' deviations and the correlation."""
    jobs = (delayed(share_below)(seed) for seed in range(N_SETS))
    shares = np.array(Parallel(n_jobs=2)(jobs)).T
    assert len(shares) == 6
    for of_quantity in shares:
        counts, _ = np.histogram(of_quantity, N_BINS, (0.0, 1.0))
        assert chisquare(counts).pvalue > 1e-3
