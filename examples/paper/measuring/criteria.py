"""The Bayesian information criterion over all joints, eq. 8."""

import numpy as np


def bic(rows, n, joints):
    """BIC(r) from a row for each joint and rank; empty until all joints are there.

    Parameters
    ----------
    rows : DataFrame
        With the columns joint, rank, log_marginal_likelihood and n_hyperparameters.
    n : int
        Number of samples, which are observations of each joint.
    joints : sequence of int
        Joints that share the rank.

    Returns
    -------
    bic : Series
        By rank, of the ranks that every joint has.
    """
    columns = ["log_marginal_likelihood", "n_hyperparameters"]
    wide = rows.pivot(index="rank", columns="joint", values=columns)
    wide = wide.reindex(columns=[(c, j) for c in columns for j in joints]).dropna()
    log_n = np.log(n * len(joints))  # n of eq. 8 counts the observations of all joints
    deviance = -2.0 * wide["log_marginal_likelihood"].sum(axis=1)
    criterion = deviance + wide["n_hyperparameters"].sum(axis=1) * log_n
    return criterion.rename(index=int)
