"""Terms that are grown one after another."""

from functools import partial
from itertools import chain

import building
import numpy as np
import pytest
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.kernels import Columns
from skmtgp.learning.growing import learn_forms
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.terms import joined, learn_terms, nest_terms
from skmtgp.model.several import Forms
from skmtgp.model.task_covariance import low_rank

M, NOISE = 3, 0.1
WIDE = (1e-2, 1e2)
SLOW, FAST = 2.5, 0.3
ONE = low_rank(M, 1)
LEARN = partial(
    learn_forms, learn_ranks, n_jobs=None, progress=lambda *of, **more: None
)


def draw(seed, n=120, noise=NOISE):
    """Rows of two terms of rank 1, the problem without terms, and the truth's theta."""
    rng = np.random.default_rng(seed)
    X, tasks = rng.uniform(0.0, 10.0, (n, 1)), np.sort(rng.integers(0, M, n))
    factors, K = [], 0.0
    for length_scale in (SLOW, FAST):
        factors.append(rng.standard_normal(M))
        of_tasks = np.outer(factors[-1], factors[-1])[np.ix_(tasks, tasks)]
        K = K + of_tasks * RBF(length_scale)(X)
    root = np.linalg.cholesky(K + 1e-8 * np.eye(n))
    y = root @ rng.standard_normal(n) + noise * rng.standard_normal(n)
    scale = float(np.sqrt(np.square(y).mean()))
    observations = building.data(X, tasks, y, M)
    truth = np.log([SLOW, FAST]), *factors, np.log([noise**2])
    return observations, scale, np.concatenate(truth)


def make(seed, terms, **options):
    observations, scale, truth = draw(seed, **options)
    problem = building.problem(*terms[0], observations, scale=scale, noise=0.01)
    return of_terms(problem, terms), truth


def of_terms(problem, terms):
    return building.replace(problem, prior=problem.prior.with_terms(terms))


def learn(problem):
    [[mode]] = learn_terms(LEARN, [problem], [problem.prior.task_covariance])
    return mode


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))]
)
def test_no_worse_than_the_truth(seed):
    problem, truth = make(seed, [(RBF(1.0, WIDE), ONE)] * 2)
    mode, likelihood = learn(problem), problem.likelihood()
    assert mode.value == pytest.approx(likelihood.value(mode.theta), abs=1e-8)
    assert mode.value > likelihood.value(truth)
    # the first of equal kernels is the slower one
    assert mode.theta[0] > mode.theta[1]


@pytest.mark.long
def test_a_first_term_that_was_led_astray():
    """Alone, a term of a low rank takes what varies slowly for constants."""
    problem, truth = make(3, [(RBF(2.9, WIDE), ONE)] * 2, n=600, noise=0.3)
    mode = learn(problem)
    assert mode.value > problem.likelihood().value(truth)
    np.testing.assert_allclose(mode.theta[:2], truth[:2], atol=0.4)


@pytest.mark.long
def test_no_worse_than_with_fewer_terms():
    terms = [
        (RBF(1.0, WIDE), low_rank(M, 2, diagonal=True)),
        (Matern(1.0, WIDE, nu=1.5), low_rank(M, 1, shared=True)),
    ]
    problem, _ = make(5, terms)
    values = []
    for term in terms:
        alone = of_terms(problem, [term])
        [[mode]] = LEARN([alone], [alone.prior.task_covariance])
        values.append(mode.value)
    both = learn(problem)
    assert both.value >= max(values)
    assert both.n_evaluations > 0
    assert both.seconds > 0


def test_terms_take_the_places_where_they_began():
    terms = [(RBF(0.2, WIDE), ONE), (RBF(4.0, WIDE), ONE)]
    mode = learn(make(0, terms)[0])
    assert mode.theta[0] < mode.theta[1]
    # unless bounds forbid it
    terms = [(RBF(2.0, (1.0, 100.0)), ONE), (RBF(4.0, (0.01, 10.0)), ONE)]
    problem, _ = make(0, terms)
    mode, (lower, upper) = learn(problem), problem.prior.bounds()
    assert (lower <= mode.theta).all()
    assert (mode.theta <= upper).all()


@pytest.mark.parametrize(
    "kernels",
    [
        pytest.param(
            (Matern(0.2, WIDE, nu=2.5), Matern(4.0, WIDE, nu=0.5)),
            id="nu",
            marks=pytest.mark.long,
        ),
        pytest.param(
            (ConstantKernel(0.5, "fixed") * RBF(0.2, WIDE), ConstantKernel() * RBF(4)),
            id="fixed amplitude",
        ),
        pytest.param((RBF(4.0, "fixed"), RBF(0.2, WIDE)), id="fixed"),
        pytest.param(
            (Columns(RBF(1.0, WIDE), [0]), RBF(4.0, WIDE)),
            id="columns",
            marks=pytest.mark.long,
        ),
    ],
)
def test_other_kernels_keep_their_places(kernels):
    problem, _ = make(0, [(kernel, ONE) for kernel in kernels])
    mode = learn(problem)
    expected = problem.likelihood().value(mode.theta)
    assert mode.value == pytest.approx(expected, abs=1e-8)


def test_starts_of_a_term_that_joins():
    terms = [(RBF(1.0, WIDE), ONE), (RBF(2.0, WIDE), low_rank(M, 1, shared=True))]
    problem, _ = make(0, terms)
    fewer = of_terms(problem, terms[:1])
    theta = fewer.prior.theta(K_rho=np.ones((M, M)))
    value = problem.likelihood().value
    lower, upper = problem.prior.bounds()
    groups = joined(problem, fewer, theta)
    # faster, slower than where either began, and where it began; either half faster
    assert [len(of) for of in groups] == [7, 2, 2]
    for of_value, start in chain(*groups):
        assert of_value == value(start)
        assert (lower <= start).all()
        assert (start <= upper).all()
    # another kernel has no halves
    other, _ = make(0, [terms[0], (Matern(1.0, WIDE, nu=0.5), ONE)])
    assert [len(of) for of in joined(other, fewer, theta)] == [4, 0, 0]


def test_modes_do_not_fall_with_the_ranks():
    kernel = RBF(1.0, WIDE)
    small, _ = make(1, [(kernel, ONE)] * 2)
    large = of_terms(small, [(kernel, low_rank(M, 2)), (kernel, ONE)])
    mode = learn(small)
    poor = mode._replace(theta=large.prior.theta(), value=-1e3)
    modes = nest_terms([small, large], [mode, poor])
    assert modes[0] is mode
    assert modes[1].value >= mode.value - 1e-8
    assert modes[1].value == pytest.approx(
        large.likelihood().value(modes[1].theta), abs=1e-8
    )
    # other forms are no part of each other
    other = of_terms(small, [(kernel, low_rank(M, 2, shared=True)), (kernel, ONE)])
    assert nest_terms([other, small], [mode, poor])[1] is poor


def test_forms_know_their_terms():
    form = Forms([low_rank(M, 2), low_rank(M, 0, shared=True)])
    assert (str(form), form.rank) == ("rank 2 + shared", [2, 0])
    K = np.stack([np.diag([1.0, 2.0, 0.0]), np.ones((M, M))])
    found = form.matrix(form.parameters(K))
    np.testing.assert_allclose(found, K, atol=1e-12)


def test_a_term_grows_where_no_derivative_can_be_told(monkeypatch):
    def fail(*_):
        raise NotPositiveDefiniteError("pivot 3 of 15 is not positive")

    problem, _ = make(0, [(RBF(SLOW, WIDE), ONE), (RBF(FAST, WIDE), ONE)])
    monkeypatch.setattr(DenseLikelihood, "task_gradient", fail)
    alone = learn(of_terms(problem, problem.prior.terms[:1]))
    assert learn(problem).value > alone.value + 10.0
