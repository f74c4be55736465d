"""About how long learning will take, before it begins."""

from time import perf_counter

from skmtgp._numerics.parallel import limit_threads

FEW = 1500  # rows of the matrices: fits to fewer are not foreseen
SAMPLE = 500  # rows of the evaluation that is timed
COARSE, FINE = 250, 120  # evaluations that a model takes at each level, roughly


def seconds_of(problems, n_forms):
    """Seconds that learning will take about, on one processor.

    One evaluation with some of the rows is timed. Its time grows with the cube of the
    side of the matrices.

    Parameters
    ----------
    problems : list of Problem
        For each output, exact.
    n_forms : int
        Models of each.

    Returns
    -------
    seconds : float
        0 where there are few rows.
    """
    sides = [level.likelihood().side for level in problems[0].coarse_to_fine()]
    if sides[-1] < FEW:
        return 0.0
    problem = problems[0]
    data = problem.data.thinned(SAMPLE)
    likelihood = problem.with_data(data).likelihood()
    with limit_threads(likelihood.side):
        theta = problem.theta()
        likelihood.value_and_grad(theta)  # what is done once
        begin = perf_counter()
        likelihood.value_and_grad(theta)
        seconds = perf_counter() - begin
    n_evaluations = [COARSE] + [FINE] * (len(sides) - 1)
    cubes = [(side / likelihood.side) ** 3 for side in sides]
    evaluations = sum(n * cube for n, cube in zip(n_evaluations, cubes, strict=True))
    return seconds * evaluations * len(problems) * n_forms
