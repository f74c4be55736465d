"""Whether functions that were learned as curves may be straight lines, or planes."""

from dataclasses import replace

import numpy as np
from sklearn.base import clone

from skmtgp._numerics.linalg import Cholesky, cholesky_with_jitter
from skmtgp.inference.likelihood import log_density
from skmtgp.learning.climbing import climb
from skmtgp.learning.contenders import worth
from skmtgp.learning.screening import price
from skmtgp.learning.weighing import log_density_left_out
from skmtgp.model.task_covariance import low_rank

MANY = 500  # rows, which tell noise from curves; fewer take little to be learned
MOST_LEFT_OUT = 1500  # rows
LENGTH, AMPLITUDE = "length_scale", "constant_value"  # parameters of kernels
BY_CHANCE = 5.0  # standard deviations of a variance


def may_be_lines(problem, mode):
    """Whether k^x bends little where there are rows, and planes explain the rows.

    Along an input of two values nothing bends.

    Parameters
    ----------
    problem : Problem
        Of one term, in memory, whose k^x has length-scales.
    mode : Mode
        Its mode.

    Returns
    -------
    may_be : bool
    """
    X, kernel = problem.data.X, problem.prior.kernel_at(mode.theta)
    named = kernel.get_params().items()
    scales = [of for name, of in named if name.endswith(LENGTH)]
    bends = np.array([len(np.unique(x)) > 2 for x in X.T])
    least = problem.tuning.long * X.std(axis=0) * bends
    if not all((scale > least).all() for scale in scales):
        return False
    if problem.data.known is not None or problem.prior.trend is not None:
        return True
    asks = _planes_explain if len(X) >= MANY else _planes_may_be_likelier
    return asks(problem, mode)


def as_lines(problem, mode, kernel, loss=np.inf):
    """The problem with linear functions, learned on from curves.

    The weights begin at the variance of the curves' slopes: of a length-scale l it is
    1 / l^2 of that of the values. The values of nearly straight curves vary so much
    that they explain levels, too. Lines need not do that, so their values begin as
    large as their slopes, and levels as usual.

    Parameters
    ----------
    problem, mode
        See :func:`may_be_lines`.
    kernel : Kernel
        Linear k^x, with an amplitude if the problem's has one.
    loss : float, default=inf
        Nats by which lines may be worse to be of use: with noise the climb ends where
        it cannot hope for that.

    Returns
    -------
    problem : Problem
        With that kernel.
    mode : Mode
        Its own.
    """
    prior = replace(problem.prior, kernel=kernel)
    [(_, rho)] = problem.prior.theta_of_terms(mode.theta)
    start = _slopes_of(problem.prior.kernel_at(mode.theta), kernel)
    theta = prior.with_theta_of_terms(mode.theta, [(start, rho)])
    theta, noisy = prior.with_usual_levels(theta), problem.is_noisy(mode)
    problem = replace(problem, prior=prior)
    least = mode.value - loss if noisy else -np.inf
    lines = climb(problem, theta, least=least, noisy=noisy)
    return problem, mode.then(lines)


def may_hide_lines(problem, mode):
    """Whether planes may be worth more than curves, which may have followed the noise.

    Of fewer numbers than one for each input there are none.

    Parameters
    ----------
    problem, mode
        See :func:`may_be_lines`.

    Returns
    -------
    may_hide : bool
    """
    plain = problem.data.known is None and problem.prior.trend is None
    if not (plain and problem.is_noisy(mode)):
        return False
    least = worth(problem, mode) + price(len(problem.data.X.T), len(problem.data))
    return _likeliest_planes(problem) >= least


def sketched(problem, mode, kernel):
    """What lines, learned quickly from a few hundred rows, are worth more than curves.

    Tasks share one plane, and each has one of its own.

    Parameters
    ----------
    problem, mode, kernel
        See :func:`as_lines`.

    Returns
    -------
    gain : float
        Nats of eq. 8.
    mode : Mode
        That of the lines.
    """
    few = problem.coarse_to_fine()[0]
    form = low_rank(few.prior.n_tasks, 0, shared=True, diagonal="equal")
    prior = replace(few.with_form(form).prior, kernel=kernel)
    lines = replace(few, prior=prior).quickly()
    found = climb(lines, lines.theta(), relaxed=True)
    curves = mode
    if few is not problem:
        curves = mode._replace(value=few.likelihood().value(mode.theta))
    return worth(lines, found) - worth(few, curves), found


def log_density_of_inputs(problem, mode):
    """Log density of the targets at each input given those at the others, summed.

    Where tasks have rows at the same inputs these are left out together. A row alone
    would be told by what is common to all tasks there, which curves follow and lines
    take for noise, but which tells nothing of other inputs.

    Parameters
    ----------
    problem, mode
        See :func:`may_be_lines`.

    Returns
    -------
    density : float
        In the problem's units. Of many rows it is foreseen from some.
    """
    data = problem.data
    inputs, at = np.unique(np.asarray(data.X), axis=0, return_inverse=True)
    if len(inputs) == len(data) or problem.prior.trend is not None:
        return log_density_left_out(problem, mode)
    order = np.random.default_rng(0).permutation(len(inputs))
    place = np.argsort(order)[at.ravel()]  # inputs in a random order
    rows = np.argsort(place, kind="stable")[:MOST_LEFT_OUT]
    _, _, y, _, K = problem.some(mode, rows)
    cholesky = cholesky_with_jitter(lambda: np.asfortranarray(K))
    alpha, inverse = cholesky.solve(y), cholesky.invert()
    starts = np.flatnonzero(np.diff(place[rows], prepend=-1))
    found = 0.0
    for of in map(slice, starts, [*starts[1:], len(rows)]):
        left_out = Cholesky(np.asfortranarray(inverse[of, of]))  # 1 / their covariance
        half = left_out.half_solve(alpha[of])
        found += log_density(half @ half, -left_out.log_det(), len(half))
    return found * len(data) / len(rows)


def _slopes_of(curves, kernel):
    """Theta of a linear k^x with the slopes of curves, and a value to match."""
    usual, curves = kernel.get_params(), curves.get_params()
    values = {name: of for name, of in curves.items() if name.endswith(AMPLITUDE)}
    for name in (name for name in curves if name.endswith(LENGTH)):
        weights, bias = name.replace(LENGTH, "weights"), name.replace(LENGTH, "bias")
        values[weights] = curves[name] ** -2.0
        values[bias] = usual[bias] * np.max(values[weights] / usual[weights])
    return np.clip(clone(kernel).set_params(**values).theta, *kernel.bounds.T)


def _planes_explain(problem, mode):
    """Whether a plane of each task leaves no more than the noise that was learned."""
    noise = problem.likelihood_at(mode).noise_of_rows(
        np.atleast_1d(problem.prior.values(mode.theta).noise)
    )
    left = _left_by_planes(problem.data, noise)
    rest, freedom = left[:, 0].sum(), (left[:, 1] - left[:, 2]).sum()
    return rest <= freedom + BY_CHANCE * np.sqrt(2.0 * freedom)


def _planes_may_be_likelier(problem, mode):
    """Whether a plane of each task is at least as likely as the curves are."""
    return _likeliest_planes(problem) >= problem.log_likelihood(mode)


def _likeliest_planes(problem):
    """Log likelihood of a plane of each task.

    Its coefficients and noise are the likeliest, so no model of lines is likelier.
    """
    left = _left_by_planes(problem.data, np.ones(len(problem.data)))
    squares, counts, _ = left.T if problem.prior.n_noise > 1 else left.sum(axis=0)
    with np.errstate(divide="ignore"):  # planes through all rows
        logs = counts * np.log(2.0 * np.pi * np.e * squares / counts)
    return -0.5 * logs.sum()


def _left_by_planes(data, noise):
    """Of each task what the likeliest plane leaves, squared, rows, and coefficients."""
    deviation = data.X.std(axis=0)
    x = (data.X - data.X.mean(axis=0)) / np.where(deviation > 0.0, deviation, 1.0)
    columns, left = np.column_stack([np.ones(len(data)), x]), []
    for own in (data.tasks == task for task in range(data.n_tasks)):
        H, y = (
            of[own] / np.sqrt(noise[own, None]) for of in (columns, data.y[:, None])
        )
        coefficients, _, rank, _ = np.linalg.lstsq(H, y)
        left.append((np.square(y - H @ coefficients).sum(), own.sum(), rank))
    return np.array(left)
