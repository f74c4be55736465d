"""Whether tasks were measured at inputs that overlap."""

import numpy as np


def share_overlapping(X, tasks):
    """Share of the rows that lie in the range of another task.

    Parameters
    ----------
    X : ndarray of shape (n_samples, n_features)
        Inputs.
    tasks : ndarray of shape (n_samples,)
        Tasks, 0 to n_tasks - 1.

    Returns
    -------
    share : float
        Between 0 and 1, of the input for which it is least. Inputs that vary within no
        task do not count.
    """
    rows, n_tasks = np.arange(len(X)), tasks.max() + 1
    shares = [1.0]
    for x in X.T:
        least, most = np.full(n_tasks, np.inf), np.full(n_tasks, -np.inf)
        np.minimum.at(least, tasks, x)
        np.maximum.at(most, tasks, x)
        if (least >= most).all():
            continue
        inside = (least <= x[:, None]) & (x[:, None] <= most)
        inside[rows, tasks] = False
        shares.append(inside.any(axis=1).mean())
    return float(min(shares))
