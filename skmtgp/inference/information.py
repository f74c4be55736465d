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

from skmtgp.model.task_covariance import OfTasks


def information(K, tasks, derivatives):
    """Fisher information.

    Parameters
    ----------
    K : ndarray of shape (n_samples, n_samples)
        Covariance.
    tasks : ndarray of shape (n_samples,)
        Task of each sample, ascending.
    derivatives : list of lists of ndarray of shape (n_samples, n_samples) or OfTasks
        Those of K by the parts of its parameters, in order. The positions in an OfTasks
        are those in the part.

    Returns
    -------
    information : ndarray of shape (n_parameters, n_parameters)
        I. Zero for the parameters of tasks without a sample.

    Raises
    ------
    LinAlgError
        If K is singular.
    """
    inverse = np.linalg.inv(K)
    at, dK, of_tasks, n_parameters = _sorted_out(derivatives, len(K))
    found = np.zeros((n_parameters, n_parameters))
    present, starts = np.unique(tasks, return_index=True)
    scores = inverse @ dK
    transposed = scores.swapaxes(1, 2)
    found[np.ix_(at, at)] = 0.5 * np.tensordot(scores, transposed, axes=((1, 2),) * 2)
    products = [H @ inverse for _, H in of_tasks]
    for a, ((positions, _), left) in enumerate(zip(of_tasks, products, strict=True)):
        rows = positions[present]
        of_rows = np.einsum("ij,kij->ik", left, scores)
        _put(found, rows, at, np.add.reduceat(of_rows, starts, axis=0))
        for (others, other), right in zip(of_tasks[: a + 1], products, strict=False):
            of_pairs = left * right.T + inverse * (left @ other.T)
            of_tasks_and_samples = np.add.reduceat(of_pairs, starts, axis=0)
            block = np.add.reduceat(of_tasks_and_samples, starts, axis=1)
            _put(found, rows, others[present], block)
    return found


def _sorted_out(derivatives, n):
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
    dK = np.array(single).reshape(-1, n, n)
    return np.array(at, dtype=int), dK, of_tasks, n_parameters


def _put(matrix, rows, columns, block):
    """A block into a symmetric matrix, on both sides of its diagonal."""
    matrix[np.ix_(rows, columns)] = block
    matrix[np.ix_(columns, rows)] = block.T
