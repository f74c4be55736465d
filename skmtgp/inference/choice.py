"""Which method of inference: the estimators' parameter of that name."""

import numpy as np
from sklearn.gaussian_process.kernels import WhiteKernel

from skmtgp._data.complete import (
    check_complete,
    is_complete,
    nearly_complete,
)
from skmtgp._support.guide import INFERENCE
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.inducing import greedy_variance
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import SparseBound


def choose(inference, kernel, features, codes, tasks):
    """The method for these data.

    Parameters
    ----------
    inference : {"auto", "dense", "kronecker", "sparse"}
        What the user asked for.
    kernel : Kernel
        k^x.
    features : ndarray of shape (n_samples, n_features)
        Inputs.
    codes : ndarray of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1.
    tasks : ndarray of shape (n_tasks,)
        Labels of the tasks.

    Returns
    -------
    method : {"dense", "kronecker", "sparse"}
        "auto" is "kronecker" for complete data of two tasks or more, whose
        eigen-decompositions are then faster than a Cholesky decomposition of all
        samples, and "dense" otherwise.

    Raises
    ------
    ValueError
        If `inference` is "kronecker" and would not be exact, or is "sparse" and the
        kernel has noise that no inducing variable explains.
    """
    if inference == "kronecker":
        check_complete(features, codes, tasks)
    if inference in ("kronecker", "sparse"):
        _check_inputs_are_all(inference, kernel, features)
    if inference != "auto":
        return inference
    complete = len(tasks) > 1 and is_complete(features, codes)
    if complete and depends_on_inputs_only(kernel, features):
        return "kronecker"
    return "dense"


def why_dense(kernel, features, codes):
    """What little keeps "auto" from "kronecker"; empty where it is not little."""
    if not depends_on_inputs_only(kernel, features):
        return ""
    return nearly_complete(features, codes)


def depends_on_inputs_only(kernel, features):
    """Whether k^x is a function of the inputs.

    A WhiteKernel is not: it tells samples of different tasks at one input apart.
    """
    parts = [kernel, *kernel.get_params().values()]
    if any(isinstance(part, WhiteKernel) for part in parts):
        return False
    x = features[:1]  # a user's kernel may have noise of its own
    return np.allclose(kernel(x), kernel(x, x), rtol=1e-9, atol=0.0)


def _check_inputs_are_all(inference, kernel, features):
    if not depends_on_inputs_only(kernel, features):
        raise ValueError(
            f"inference={inference!r} needs a kernel of the inputs alone, but "
            f"kernel={kernel} has noise of its own for each sample, such as a "
            "WhiteKernel. Leave it to noise_variance, or set inference='auto'. "
            f"{INFERENCE}"
        )


def extended(likelihood, task_covariance, X, tasks, y, n_noise, position, kernel):
    """The likelihood with a task at `position` added, with the same kernel.

    It stays with the likelihood's method. Where complete data are not complete any
    more, the novel tasks' rows are eliminated from their covariance, exactly. The
    inducing inputs of a bound get those of the novel task's that add to them, which
    `kernel`, k^x as learned, tells.
    """
    data = likelihood.kernel, task_covariance, X, tasks, y
    if likelihood.inference == "sparse":
        Z = np.vstack([likelihood.Z, X[np.flatnonzero(tasks == position)]])
        most = min(len(Z), 2 * len(likelihood.Z))
        return SparseBound(*data, greedy_variance(kernel, Z, most), n_noise)
    if likelihood.inference == "dense":
        return DenseLikelihood(*data, n_noise)
    data = *data, n_noise
    if is_complete(X, tasks):
        return KroneckerLikelihood(*data)
    novel = [m + (m >= position) for m in likelihood.novel]
    return ExtendedLikelihood(*data, [*novel, position])
