r"""The Fisher information of parameters of the covariance K of a normal distribution.

.. math:: I_{pq} = \tfrac12 \mathrm{tr}(K^{-1}\, dK_p\, K^{-1}\, dK_q)

Parameters that the tasks have one each of are taken together. The derivative by that of
task m is zero but in the rows and columns of m: with E_m, which is diagonal and has
ones at those,

.. math:: dK_m = E_m H + H^T E_m

with the same H for all tasks. Between two such sets of parameters

.. math:: I_{mn} = \sum_{i \in m, j \in n}
    (H K^{-1})_{ij} (H' K^{-1})_{ji} + K^{-1}_{ij} (H K^{-1} H'^T)_{ij}.
"""

import numpy as np

from skmtgp._numerics.linalg import symmetric_inverse
from skmtgp.model.task_covariance import OfTasks


def information(K, tasks, derivatives):
    """Fisher information.

    Parameters
    ----------
    K : ndarray of shape (n_samples, n_samples)
        Covariance.
    tasks : ndarray of shape (n_samples,)
        Task of each sample, ascending.
    derivatives : list of lists of ndarray, float or OfTasks
        Those of K by the parts of its parameters, in order: matrices; diagonals of
        them; numbers that are alike between all samples of a task, and 0 elsewhere. The
        positions in an OfTasks are those in the part; its half may be a diagonal.

    Returns
    -------
    information : ndarray of shape (n_parameters, n_parameters)
        I. Zero for the parameters of tasks without a sample.

    Raises
    ------
    LinAlgError
        If K is singular.
    """
    inverse = symmetric_inverse(K)
    at, single, of_tasks, n_parameters = _sorted_out(derivatives)
    found = np.zeros((n_parameters, n_parameters))
    present, starts, places = np.unique(tasks, return_index=True, return_inverse=True)
    scores = np.empty((len(single), *K.shape))
    for of, score in zip(single, scores, strict=True):
        _put_score(score, inverse, of, starts, places)
    flat = scores.reshape(len(single), K.size)
    transposed = scores.swapaxes(1, 2).reshape(flat.shape)
    found[np.ix_(at, at)] = 0.5 * (flat @ transposed.T)
    products = [_times(H, inverse) for _, H in of_tasks]
    for a, ((positions, H), left) in enumerate(zip(of_tasks, products, strict=True)):
        rows = positions[present]
        of_rows = np.einsum("ij,kij->ik", left, scores)
        _put(found, rows, at, np.add.reduceat(of_rows, starts, axis=0))
        for (others, other), right in zip(of_tasks[: a + 1], products, strict=False):
            of_pairs = left * right.T
            of_pairs += inverse * _both_sides(H, left, other, right)
            of_tasks_and_samples = np.add.reduceat(of_pairs, starts, axis=0)
            block = np.add.reduceat(of_tasks_and_samples, starts, axis=1)
            _put(found, rows, others[present], block)
    return found


def _put_score(score, inverse, derivative, starts, places):
    """K^{-1} dK in an array, by what a derivative is."""
    if np.ndim(derivative) == 2:
        np.matmul(inverse, derivative, out=score)
    elif np.ndim(derivative) == 1:
        np.multiply(inverse, derivative, out=score)
    else:
        sums = derivative * np.add.reduceat(inverse, starts, axis=1)
        np.take(sums, places, axis=1, out=score, mode="clip")


def _times(H, inverse):
    """H K^{-1}, where H may be a diagonal."""
    return H @ inverse if np.ndim(H) == 2 else H[:, None] * inverse


def _both_sides(H, left, other, right):
    """H K^{-1} H'^T, from both matrices and their products with K^{-1}."""
    if np.ndim(other) == 1:
        return left * other
    return left @ other.T if np.ndim(H) == 2 else H[:, None] * right.T


def _sorted_out(derivatives):
    """Positions and derivatives by single parameters, the others, and a count."""
    at, single, of_tasks, n_parameters = [], [], [], 0
    for part in derivatives:
        begin = n_parameters
        for derivative in part:
            if isinstance(derivative, OfTasks):
                of_tasks.append((begin + derivative.positions, derivative.half))
                n_parameters += len(derivative.positions)
            else:
                at.append(n_parameters)
                single.append(derivative)
                n_parameters += 1
    return np.array(at, dtype=int), single, of_tasks, n_parameters


def _put(matrix, rows, columns, block):
    """A block into a symmetric matrix, on both sides of its diagonal."""
    matrix[np.ix_(rows, columns)] = block
    matrix[np.ix_(columns, rows)] = block.T
