"""The paper's training and test sets: which samples, in which order."""

import numpy as np

# Table 1: the training trajectory of each load c1..c15, beside the common one.
OWN_TRAJECTORIES = (
    *("p1s1", "p4s1", "p3s2", "p3s3", "p2s4"),
    *("p2s1", "p1s2", "p4s2", "p4s3", "p3s4"),
    *("p3s1", "p2s2", "p1s3", "p1s4", "p4s4"),
)
COMMON_TRAJECTORY = "p2s3"
SUBSETS = ("train", "interpolation", "extrapolation")


def subset_rows(subset, load, labels, n_samples, seed):
    """Choose the samples of one load's subset, in their fixed random order.

    Parameters
    ----------
    subset : {"train", "interpolation", "extrapolation"}
        Which of the paper's sets.
    load : int
        Number of the load, 1..15.
    labels : ndarray of shape (n_trajectories,)
        Labels of the trajectories.
    n_samples : int
        Samples of each trajectory.
    seed : int
        Seed of the split.

    Returns
    -------
    rows : ndarray of shape (n_rows,)
        Positions in the trajectories laid end to end. "train" is half of the
        common and half of the load's own trajectory, "interpolation" the rest of
        the two, "extrapolation" all that is not "train".

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.datasets._split import subset_rows
    >>> labels = np.array(["p1s1", "p2s3"])
    >>> rows = subset_rows("train", 1, labels, 4, seed=0)
    >>> sorted((rows // 4).tolist())
    [0, 0, 1, 1]
    """
    rng = np.random.RandomState([seed, load])
    train, rest = [], []
    for label in (COMMON_TRAJECTORY, OWN_TRAJECTORIES[load - 1]):
        start = n_samples * int(np.flatnonzero(labels == label)[0])
        rows = start + rng.permutation(n_samples)
        train.append(rows[: n_samples // 2])
        rest.append(rows[n_samples // 2 :])
    orders = {
        "train": rng.permutation(np.concatenate(train)),
        "interpolation": rng.permutation(np.concatenate(rest)),
    }
    everything = np.arange(len(labels) * n_samples)
    others = np.setdiff1d(everything, orders["train"], assume_unique=True)
    orders["extrapolation"] = rng.permutation(others)
    return orders[subset]
