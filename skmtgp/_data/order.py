"""The order of rows of pandas objects, which belong together by their positions."""

import pandas as pd

PANDAS = pd.Series, pd.DataFrame


def refuse_another_order(X, y, name="y"):
    """Raise a ValueError where X and y have the same labels in another order.

    `name` is what y is called.

    Labels that are not the same rows' say nothing: features that were scaled have often
    another index.
    """
    if not (isinstance(X, PANDAS) and isinstance(y, PANDAS)):
        return
    of_X, of_y = X.index, y.index
    if of_X.equals(of_y) or not (of_X.is_unique and of_y.is_unique):
        return
    if are_of_the_same_rows(of_X, of_y):
        raise ValueError(
            f"{name} has the index labels of X in another order: X begins with "
            f"{of_X[0]}, {name} with {of_y[0]}, and rows belong together by position. "
            f"Give {name}.loc[X.index], or reset_index(drop=True) of both if they go "
            "together by position."
        )


def are_of_the_same_rows(index, other):
    """Whether two indexes have the same labels, in whatever order."""
    if index.nlevels != other.nlevels or len(index) != len(other):
        return False
    return index.isin(other).all() and other.isin(index).all()
