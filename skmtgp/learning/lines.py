"""Whether functions that were learned as curves may be straight lines, or planes."""

import numpy as np

MANY = 500  # rows, which tell noise from curves
BY_CHANCE = 5.0  # standard deviations of a variance


def may_be_lines(problem, mode):
    """Whether k^x bends little where there are rows, and planes explain the rows.

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
    scales = [of for name, of in named if name.endswith("length_scale")]
    least = problem.tuning.long * X.std(axis=0)
    if not all((scale > least).all() for scale in scales):
        return False
    plain = problem.data.known is None and problem.prior.trend is None
    return len(X) < MANY or not plain or _planes_explain(problem, mode)


def _planes_explain(problem, mode):
    """Whether a plane of each task leaves no more than the noise that was learned."""
    data, rest, freedom = problem.data, 0.0, 0
    noise = problem.likelihood_at(mode).noise_of_rows(
        np.atleast_1d(problem.prior.values(mode.theta).noise)
    )
    deviation = data.X.std(axis=0)
    x = (data.X - data.X.mean(axis=0)) / np.where(deviation > 0.0, deviation, 1.0)
    columns = np.column_stack([np.ones(len(data)), x])
    for task in range(data.n_tasks):
        own = data.tasks == task
        H, y = (
            of[own] / np.sqrt(noise[own, None]) for of in (columns, data.y[:, None])
        )
        coefficients, _, rank, _ = np.linalg.lstsq(H, y)
        rest += np.square(y - H @ coefficients).sum()
        freedom += own.sum() - rank
    return rest <= freedom + BY_CHANCE * np.sqrt(2.0 * freedom)
