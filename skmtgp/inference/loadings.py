r"""What tasks have of the latent functions of all terms, whose features are stacked.

Term q has r_q latent functions z_a = v_a . phi_q. The weights of task m are

.. math::
    \omega_m = (\omega_{1m}, \ldots, \omega_{Qm}), \quad
    \omega_{qm} = \sum_{a \in q} F_{ma} v_a + \sqrt{\kappa_{mq}} w_{qm},

one part below the other, as the features are. Matrices between features have a block
for each pair of terms.
"""

from itertools import accumulate, pairwise, product, starmap

import numpy as np


class Loadings:
    """F and kappa of all terms.

    Parameters
    ----------
    latents : list of (ndarray, ndarray)
        Of each term F of shape (n_tasks, rank) and kappa of shape (n_tasks,).
    n_inducing : int
        Number m of features of each term.

    Attributes
    ----------
    F : ndarray of shape (n_tasks, n_latent)
        Those of the terms side by side.
    kappa : ndarray of shape (n_tasks, n_terms)
        Variances of the tasks' own functions.
    own : ndarray of shape (n_tasks, n_features)
        The same of each feature.
    columns, rows : list of slice
        Where the latent functions, and the features, of each term are.
    """

    def __init__(self, latents, n_inducing):
        of_F, of_kappa = zip(*latents, strict=True)
        self.F, self.kappa = np.hstack(of_F), np.column_stack(of_kappa)
        self.n_inducing = n_inducing
        self.own = self.of_features(self.kappa)
        self.columns = _slices(F.shape[1] for F in of_F)
        self.rows = _slices([n_inducing] * len(latents))

    @property
    def n_terms(self):
        """Number of terms."""
        return len(self.rows)

    @property
    def variances(self):
        """K^rho_mm of each term, of shape (n_tasks, n_terms)."""
        squares = np.square(self.F)
        of_F = [squares[:, columns].sum(axis=1) for columns in self.columns]
        return np.column_stack(of_F) + self.kappa

    def of_features(self, of_terms):
        """Numbers of each term, (..., n_terms), for each of its features."""
        return np.repeat(of_terms, self.n_inducing, axis=-1)

    def _pairs(self):
        """Columns and rows of each pair of terms."""
        return product(zip(self.columns, self.rows, strict=True), repeat=2)

    def mix(self, V):
        """F V: of weights of latent functions those of tasks.

        Parameters
        ----------
        V : ndarray of shape ([n_columns,] n_latent, n_inducing)
            Of the latent functions.

        Returns
        -------
        omega : ndarray of shape ([n_columns,] n_tasks, n_features)
            Of the tasks, without what they have of their own.
        """
        parts = [self.F[:, columns] @ V[..., columns, :] for columns in self.columns]
        return np.concatenate(parts, axis=-1)

    def mix_back(self, t):
        """F^T t: from (..., n_tasks, n_features) to (..., n_latent, n_inducing)."""
        pairs = zip(self.columns, self.rows, strict=True)
        parts = [self.F[:, of].T @ t[..., rows] for of, rows in pairs]
        return np.concatenate(parts, axis=-2)

    def shares(self, phi, tasks):
        """What v_a is multiplied by in f, of features in columns and their tasks.

        Returns
        -------
        shares : ndarray of shape (n_latent, n_inducing, n_samples)
        """
        return np.einsum("ia,aji->aji", self.F[tasks], self.of_latent(phi))

    def of_latent(self, phi):
        """The features of each latent function's term, (n_latent, n_inducing, ...)."""
        term = np.repeat(
            np.arange(self.n_terms), [of.stop - of.start for of in self.columns]
        )
        return phi.reshape(self.n_terms, self.n_inducing, -1)[term]

    def precision(self, T):
        """What matrices between features of each task say of the latent functions.

        Parameters
        ----------
        T : ndarray of shape (n_tasks, n_features, n_features)
            Those matrices.

        Returns
        -------
        A : ndarray of shape (n_latent * n_inducing, n_latent * n_inducing)
            sum_m F_ma F_mb times a block of T_m.
        """
        (n_tasks, rank), m = self.F.shape, self.n_inducing
        A = np.empty((rank, m, rank, m))
        for (a, rows), (b, cols) in self._pairs():
            of_pair = _products(self.F[:, a], self.F[:, b]).T
            block = of_pair @ T[:, rows, cols].reshape(n_tasks, -1)
            shape = a.stop - a.start, b.stop - b.start, m, m
            A[a, :, b] = block.reshape(shape).swapaxes(1, 2)
        return A.reshape(rank * m, rank * m)

    def covariances(self, inverse, tasks=slice(None)):
        """Covariances of F_m . v of some tasks, from those of v.

        Parameters
        ----------
        inverse : ndarray of shape (n_latent, n_latent, n_inducing, n_inducing)
            Covariances of v_a and v_b.
        tasks : slice or list of int, default=slice(None)
            Which tasks.

        Returns
        -------
        Sigma : ndarray of shape (n_tasks, n_features, n_features)
        """
        F, p, m = self.F[tasks], self.n_terms * self.n_inducing, self.n_inducing
        Sigma = np.empty((len(F), p, p))
        for (a, rows), (b, cols) in self._pairs():
            of_pair = _products(F[:, a], F[:, b])
            block = of_pair @ inverse[a, b].reshape(of_pair.shape[1], -1)
            Sigma[:, rows, cols] = block.reshape(-1, m, m)
        return Sigma

    def overlaps(self, T, inverse):
        """Traces of T_m, see `precision`, times covariances of v_a and v_b.

        Returns
        -------
        overlaps : ndarray of shape (n_tasks, n_latent, n_latent)
        """
        n_tasks, rank = self.F.shape
        found = np.empty((n_tasks, rank, rank))
        for (a, rows), (b, cols) in self._pairs():
            shape = a.stop - a.start, b.stop - b.start
            of_pair = inverse[a, b].reshape(np.prod(shape), -1)
            flat = T[:, rows, cols].reshape(n_tasks, -1) @ of_pair.T
            found[:, a, b] = flat.reshape(n_tasks, *shape)
        return found

    def with_unseen(self, unseen):
        """The same with tasks that have some of the first functions of each term.

        Parameters
        ----------
        unseen : list of (ndarray, ndarray)
            Of each term, see :class:`skmtgp.inference.unseen.WithUnseen`.

        Returns
        -------
        loadings : Loadings
        """
        latents = []
        for q, (columns, (loadings, own)) in enumerate(
            zip(self.columns, unseen, strict=True)
        ):
            F = self.F[:, columns]
            more = np.zeros((len(loadings), F.shape[1]))
            more[:, : loadings.shape[1]] = loadings
            kappa = np.append(self.kappa[:, q], own)
            latents.append((np.vstack([F, more]), kappa))
        return Loadings(latents, self.n_inducing)


def _slices(sizes):
    """Where parts of these sizes are, one after another."""
    return list(starmap(slice, pairwise([0, *accumulate(sizes)])))


def _products(F, G):
    """F_ma G_mb, of shape (n_tasks, rank of F times that of G)."""
    return np.einsum("ma,mb->mab", F, G).reshape(len(F), -1)
