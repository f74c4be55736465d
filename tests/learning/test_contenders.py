"""Which forms of K^rho may be taken: eq. 8, the prior of the noise, few rows."""

from dataclasses import replace

import building
import numpy as np
import of_ranks
import pytest
from of_ranks import KERNEL, M, of_terms, tuned, without_noise
from sklearn.gaussian_process.kernels import RBF

from skmtgp.learning import contenders
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import (
    few_hyperparameters,
    is_overexplained,
    may_be_weighed,
    near_best,
    noise_penalty,
    overpriced,
    penalties,
    plausible,
)
from skmtgp.learning.tuning import TUNING
from skmtgp.model.hyperprior import Hyperprior
from skmtgp.model.task_covariance import low_rank


@pytest.fixture(scope="module", name="learned")
def _learned():
    return of_ranks.learned()


def test_penalty_is_the_prior_of_the_noise(learned):
    [[problem], *_], [[mode], *_] = learned
    prior = problem.prior
    hyperprior, other = Hyperprior(prior), mode.theta.copy()
    other[-1] = -20.0
    at_centre = mode.theta.copy()
    at_centre[-1] = hyperprior.centre[-1]
    assert noise_penalty(prior, at_centre) == 0.0
    gap = hyperprior.log_density(at_centre)[0] - hyperprior.log_density(other)[0]
    assert noise_penalty(prior, other) == pytest.approx(gap)


def test_weak_priors_have_it_already(learned):
    problems, modes = learned
    weak = [[replace(of, weak_priors=True)] for [of] in problems]
    assert penalties(weak, without_noise(modes)).tolist() == [0.0] * 3
    assert (penalties(problems, without_noise(modes)) > 10.0).all()


def test_eq_8_may_price_numbers_of_tasks_too_high(learned):
    """Those of one of three tasks are told by a third of the rows."""
    problems, modes = learned
    numbers = np.array([3, 5, 6])  # of ranks 1 to 3
    np.testing.assert_allclose(overpriced(problems), 0.5 * numbers * np.log(3.0))
    gap = np.ptp(plausible(problems, modes)[:2]) - np.log(3.0)  # two numbers more
    for within, near in ((gap - 1e-6, [0]), (gap + 1e-6, [0, 1])):
        assert near_best(tuned(problems, weighed_within=within), modes) == near
    # larger ones would take too long, but for those that eq. 8 itself is for
    within = {"weighed_within": gap + 1e-6}
    large = tuned(problems, **within, most_weighed=(6, 6))
    assert near_best(large, modes) == [0]
    # and one that did not end must not keep the others from their evidence
    stopped = [modes[0], [modes[1][0]._replace(converged=False)], modes[2]]
    assert near_best(tuned(problems, **within), stopped) == [0]


def test_how_many_hyperparameters_do_not_take_too_long(learned):
    problems, _ = learned  # of 45 rows, with 5, 7 and 8
    for most, few in ((8, True), (7, False)):
        assert few_hyperparameters(tuned(problems, most_weighed=(most, 0))) == few
        work = {"most_weighed": (300, 0), "weighed_work": 45 * most}
        assert few_hyperparameters(tuned(problems, **work)) == few
        work["most_weighed"] = (300, 8)  # whatever the number of rows
        assert few_hyperparameters(tuned(problems, **work))


def test_several_terms():
    assert not may_be_weighed(
        [[building.problem(KERNEL, low_rank(M, 1), None)], [of_terms()]]
    )


def test_many_rows_are_left_to_bic(learned):
    problems, _ = learned
    most = max(of.prior.n_hyperparameters for [of] in problems)
    assert may_be_weighed(problems)
    assert may_be_weighed(problems, TUNING.rows_weighed * most)
    assert not may_be_weighed(problems, TUNING.rows_weighed * most + 1)


def test_a_factor_of_zeros_has_a_likelihood_but_no_prior():
    """As where nothing is learned."""
    rng = np.random.default_rng(0)
    observations = building.data(
        rng.normal(size=(9, 1)), np.arange(9) // 3, rng.normal(size=9), 3
    )
    plain = building.problem(RBF(1.0), low_rank(3, 1), observations)
    theta = plain.theta(K_rho=np.zeros((3, 3)))
    penalised = replace(plain, weak_priors=True)
    mode = climb(plain, theta)._replace(theta=theta, value=-np.inf)
    assert penalised.likelihood().value(theta) == -np.inf
    found = penalised.log_likelihood(mode)
    assert found == pytest.approx(plain.likelihood().value(theta))
    assert contenders.worth(penalised, mode, times=4.0) == -np.inf


def test_whether_few_rows_are_explained_too_well(learned):
    problems, modes = learned
    rows = tuned(problems, rows_told=5)
    sizes = [of.prior.n_hyperparameters for [of] in problems]
    assert not is_overexplained(rows, modes, 5 * sizes[0])
    assert is_overexplained(rows, modes, 5 * sizes[0] - 1)
    # what no form takes for noise is none
    assert not is_overexplained(rows, without_noise(modes), 5)
    form = low_rank(M, 0, "equal", shared=True)
    [[problem], *_], [[mode], *_] = rows, modes
    small = problem.with_form(form)
    rho = form.parameters(problem.prior.K_rho_at(mode.theta))
    noisy = mode._replace(theta=small.prior.with_rho(mode.theta, rho), value=-1e3)
    with_small = [[small], *rows], [[noisy], *without_noise(modes)]
    assert is_overexplained(*with_small, 5)
    sizes = [small.prior.n_hyperparameters, *sizes]
    for n in (4, 9):  # forms with more than half as many are left out, if not all
        most = max(n // 2, sizes[0] + 1)
        expected = [k for k, size in enumerate(sizes) if size <= most]
        assert near_best(*with_small, n) == expected
