import hypothesis.strategies as st
import numpy as np
from hypothesis import given, settings
from sparse_bounds import (
    EVERY,
    FORMS,
    TASKS,
    M,
    Sample,
    dense,
    draw,
    inducing,
    make,
    parameters,
)

from skmtgp.model.task_covariance import low_rank

seeds = st.integers(0, 2**32 - 1)
quick = settings(max_examples=40, deadline=None)


def random_model(name, seed):
    rng = np.random.default_rng(seed)
    form, n_noise = FORMS[list(FORMS)[rng.integers(len(FORMS))]], rng.choice([1, M])
    theta = parameters(EVERY[name], form, n_noise, seed)
    theta += 0.5 * rng.standard_normal(len(theta))
    theta[-n_noise:] += rng.uniform(-6.0, 3.0)
    Z = inducing(rng.integers(1, 20), seed)
    return rng, theta, (EVERY[name], form, int(n_noise)), Z


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_never_above_the_likelihood(name, seed):
    _, theta, model, Z = random_model(name, seed)
    exact = dense(*model, draw(seed)).value(theta)
    assert make(*model, Z, draw(seed)).value(theta) <= exact + 1e-9 * (1 + abs(exact))


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_more_inducing_inputs_never_lower_it(name, seed):
    rng, theta, model, Z = random_model(name, seed)
    few = make(*model, Z[: rng.integers(1, len(Z) + 1)], draw(seed)).value(theta)
    many = make(*model, Z, draw(seed)).value(theta)
    assert few <= many + 1e-9 * (1 + abs(many))


@given(st.sampled_from(sorted(EVERY)), seeds, st.integers(1, 30))
@quick
def test_blocks_and_order_of_rows_do_not_matter(name, seed, block_size):
    """By no more than ten times what one rounding of the parameters does."""
    rng, theta, model, Z = random_model(name, seed)
    sample, order = draw(seed), rng.permutation(len(TASKS))
    bound = make(*model, Z, sample, block_size=100)
    one, *others = (
        np.append(*bound.value_and_grad(theta * (1.0 + k * np.finfo(float).eps)))
        for k in (0, 1, -1, 2, -2)
    )
    shuffled = Sample(*(part[order] for part in sample))
    other = make(*model, Z, shuffled, block_size=block_size).value_and_grad(theta)
    rounding = np.abs(np.subtract(others, one)).max()
    atol = 1e-11 * np.abs(one).max() + 10.0 * rounding
    np.testing.assert_allclose(np.append(*other), one, rtol=0.0, atol=atol)


@given(st.sampled_from(sorted(EVERY)), seeds)
@quick
def test_rotations_of_the_factor_do_not_matter(name, seed):
    rng, form = np.random.default_rng(seed), low_rank(M, 2)
    theta, n = parameters(EVERY[name], form), EVERY[name].n_dims
    rotation = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    rotated = theta.copy()
    rotated[n:-1] = (theta[n:-1].reshape(M, 2) @ rotation).ravel()
    bound = make(EVERY[name], form)
    np.testing.assert_allclose(bound.value(rotated), bound.value(theta), rtol=1e-11)
