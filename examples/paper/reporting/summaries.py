"""What several experiments need of their rows."""

import numpy as np

from .markdown import MISSING, table


def geometric_mean(values):
    """Of positive numbers, such as the errors of several draws."""
    return float(np.exp(np.log(values).mean()))


def select(rows, **wanted):
    """Rows with these values."""
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    return rows


def over_draws(rows, by, column, n_models):
    """Geometric means over the draws that every model has.

    Parameters
    ----------
    rows : DataFrame
        With a column model, and one row for each of `by`, draw and model.
    by : list of str
        What is kept apart.
    column : str
        What is averaged.
    n_models : int
        How many there are.

    Returns
    -------
    means : DataFrame
        Indexed by `by`, a column for each model, and the number of draws in "draws".
    """
    keys = [*by, "draw"]
    wide = rows.pivot(index=keys, columns="model", values=column)
    wide = wide.dropna() if wide.shape[1] == n_models else wide.iloc[:0]
    means = np.exp(np.log(wide).groupby(by).mean())
    return means.assign(draws=wide.groupby(by).size())


def grid(rows, columns, cell, corner):
    """A table with a line for each of `rows` and a cell for each of `columns`.

    Parameters
    ----------
    rows, columns : dict of key to str
        Names of the lines and of the columns.
    cell : callable
        Gives the text, or None where it is missing.
    corner : str
        What the lines are.
    """
    lines = [
        [name, *(cell(row, column) or MISSING for column in columns)]
        for row, name in rows.items()
    ]
    return table([corner, *columns.values()], lines)
