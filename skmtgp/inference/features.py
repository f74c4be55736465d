"""Whitened features of the inducing inputs, of each term of the prior.

With K_ZZ = L L^T for the m inducing inputs Z and the kernel k of a term, the features
of x are phi(x) = L^{-1} k(Z, x): k(x, x') is phi(x) . phi(x') and what they leave.
Those of several terms, of the same Z, are stacked: n_features is n_terms times m.
"""

import numpy as np

from skmtgp._numerics.linalg import Cholesky
from skmtgp._support.guide import INFERENCE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError
from skmtgp.model._nodes import contract_inputs

DIAGONAL = 64  # rows of a tile of which only the diagonal counts
LEAST_JITTER = 3e-17  # of its diagonal, m times: what is always added to K_ZZ
MOST_JITTERS = 12  # each ten times the last


class Features:
    """The features of all terms, at given parameters.

    Parameters
    ----------
    terms : list of (Kernel, Node, ndarray of shape (n_theta,))
        Of each term k, of which only the form matters, its fast form, its parameters.
    Z : ndarray of shape (n_inducing, n_inputs)
        Inducing inputs.

    Attributes
    ----------
    terms : list of TermFeatures
        Those of each term.
    n_theta : int
        Number of parameters of all kernels.

    Raises
    ------
    NotPositiveDefiniteError
        If no jitter helps.
    """

    def __init__(self, terms, Z):
        self.terms, self.Z = [TermFeatures(*of, Z) for of in terms], Z
        self.n_theta = sum(len(of.theta) for of in self.terms)

    def __len__(self):
        return sum(map(len, self.terms))

    def split(self, stacked):
        """What falls to each term of an array with a row for each feature."""
        m = len(self.Z)
        return [stacked[q * m : (q + 1) * m] for q in range(len(self.terms))]

    def warn_of_jitter(self):
        """Say what was added to K_ZZ of all terms, if that was more than always.

        Inducing inputs that are too close for a slow term may be there for a fast one.
        """
        min(self.terms, key=lambda of: of.jitter).warn_of_jitter()

    def tile(self, X):
        """The features of some rows, with what their gradient needs."""
        return Tile(self, X)

    def pull_back(self, phi_bar):
        """Adjoints of k(Z, X), L^{-T} phi_bar, from those of the features."""
        pairs = zip(self.terms, self.split(phi_bar), strict=True)
        return stacked([of.pull_back(part) for of, part in pairs])

    def contract(self, Omegas):
        """Gradient by theta through K_ZZ, and its adjoints.

        Parameters
        ----------
        Omegas : list of ndarray of shape (n_inducing, n_inducing)
            For each term, see `TermFeatures.contract`.

        Returns
        -------
        gradient : ndarray of shape (n_theta,)
            Its gradient.
        adjoints : list of ndarray of shape (n_inducing, n_inducing)
            Of K_ZZ of each term.
        """
        pairs = zip(self.terms, Omegas, strict=True)
        parts = [of.contract(Omega) for of, Omega in pairs]
        gradients, adjoints = zip(*parts, strict=True)
        return np.concatenate(gradients), adjoints

    def contract_inputs(self, adjoints):
        """Gradient by Z through K_ZZ of all terms."""
        pairs = zip(self.terms, adjoints, strict=True)
        return sum(of.contract_inputs(adjoint) for of, adjoint in pairs)


class Tile:
    """The features of a block of rows.

    Parameters
    ----------
    features : Features
        Theirs.
    X : ndarray of shape (n_samples, n_inputs)
        Inputs.

    Attributes
    ----------
    phi : ndarray of shape (n_features, n_samples)
        The features.
    rest : ndarray of shape (n_samples, n_terms)
        k(x, x) - |phi(x)|^2 of each term, the variance that they leave unexplained.
    """

    def __init__(self, features, X):
        self.features, self.terms, phi, rest = features, [], [], []
        for term in features.terms:
            tile = TermTile(term, X)
            self.terms.append(tile)
            phi.append(tile.phi)
            rest.append(tile.rest)
            del tile.phi  # it has its place among the others
        self.phi, self.rest = stacked(phi), np.column_stack(rest)

    def contract(self, K_bar, diagonal):
        """Gradient by theta.

        Parameters
        ----------
        K_bar : ndarray of shape (n_features, n_samples)
            Adjoints of k(Z, X) of the terms.
        diagonal : ndarray of shape (n_samples, n_terms)
            Adjoints of k(x, x).

        Returns
        -------
        gradient : ndarray of shape (n_theta,)
            Its gradient, but for K_ZZ's part.
        """
        of_terms = zip(self.terms, self.features.split(K_bar), diagonal.T, strict=True)
        return np.concatenate([tile.contract(*of) for tile, *of in of_terms])

    def contract_inputs(self, K_bar):
        """Gradient by Z through k(Z, X) of the terms."""
        pairs = zip(self.terms, self.features.split(K_bar), strict=True)
        return sum(tile.contract_inputs(adjoint) for tile, adjoint in pairs)


def stacked(parts):
    """Arrays of the terms, one below the other; that of one term is not copied."""
    return np.concatenate(parts) if len(parts) > 1 else parts[0]


class TermFeatures:
    """The features phi(x) = L^{-1} k(Z, x) of one term.

    Parameters
    ----------
    kernel : Kernel
        k; only its form matters.
    node : Node
        Its fast form.
    theta : ndarray of shape (n_theta,)
        Its parameters.
    Z : ndarray of shape (n_inducing, n_inputs)
        Inducing inputs.

    Attributes
    ----------
    jitter : float
        What was added to the diagonal of K_ZZ, relative to its mean: noise of the
        inducing variables, which leaves the bound a bound. It is never zero, see
        below.

    Raises
    ------
    NotPositiveDefiniteError
        If no jitter helps.

    Notes
    -----
    Where K_ZZ is all but singular, its rounding alone would make |phi(x)|^2 larger than
    k(x, x), by thousands of eps. The bound would be above the likelihood, the more
    so the smaller the noise, and learning would look for such parameters. A jitter of
    the size of that rounding, a fraction of m eps, prevents it.
    """

    def __init__(self, kernel, node, theta, Z):
        self.kernel, self.node = kernel.clone_with_theta(theta), node
        self.theta, self.Z = theta, Z
        bound, everywhere = node.bind(theta, Z), slice(0, len(Z))
        K, tape = bound.block(everywhere, everywhere)
        self._inducing = bound, tape, everywhere
        self.cholesky, self.jitter = _factorise(np.broadcast_to(K, (len(Z),) * 2))

    def __len__(self):
        return len(self.Z)

    def warn_of_jitter(self):
        """Say what was added to K_ZZ, if that was more than always."""
        if self.jitter > LEAST_JITTER * len(self):
            warn(
                f"The covariance of the {len(self)} inducing inputs is not positive "
                f"definite in floating point; {self.jitter:.0e} of its mean diagonal "
                "was added to its diagonal. Fewer inducing inputs avoid this. "
                f"{INFERENCE}",
                JitterWarning,
            )

    def pull_back(self, phi_bar):
        """Adjoints of k(Z, X), L^{-T} phi_bar, from those of the features."""
        return self.cholesky.half_solve(phi_bar, transposed=True)

    def means(self, X, weights):
        """k(X, Z) times the weights, which are in columns."""
        cross = self._inducing[0].against(X)
        return cross.times(slice(0, len(X)), slice(0, len(self)), weights)

    def contract(self, Omega):
        """Gradient by theta through K_ZZ, and its adjoint.

        Parameters
        ----------
        Omega : ndarray of shape (n_inducing, n_inducing)
            sum_i phibar_i phi_i^T for the adjoints phibar_i of the features, symmetric
            because no objective depends on a rotation of the features.

        Returns
        -------
        gradient : ndarray of shape (n_theta,)
            Its gradient.
        adjoint : ndarray of shape (n_inducing, n_inducing)
            -1/2 L^{-T} Omega L^{-1}, jitter included.
        """
        bound, tape, everywhere = self._inducing
        half = self.cholesky.half_solve(Omega, transposed=True)
        adjoint = -0.5 * self.cholesky.half_solve(half.T, transposed=True)
        m = len(self)
        adjoint.flat[:: m + 1] += self.jitter / m * np.trace(adjoint)
        return bound.contract(adjoint, tape, everywhere, everywhere), adjoint

    def contract_inputs(self, adjoint):
        """Gradient by Z through K_ZZ."""
        bound, tape, everywhere = self._inducing
        n_inputs = self.Z.shape[1]
        return 2.0 * contract_inputs(
            bound, adjoint, tape, everywhere, everywhere, n_inputs
        )


def _factorise(K):
    """The factor of K, and the least relative jitter with which there is one."""
    unit = np.diagonal(K).mean() * np.eye(len(K))
    for jitter in LEAST_JITTER * len(K) * 10.0 ** np.arange(MOST_JITTERS):
        try:
            return Cholesky(np.asfortranarray(K + jitter * unit)), jitter
        except NotPositiveDefiniteError:
            pass
    raise NotPositiveDefiniteError(
        f"The covariance of the {len(K)} inducing inputs is not positive definite, "
        f"even with {jitter:.0e} of its mean added to the diagonal. Choose fewer "
        f"inducing inputs, or check them for extreme values. {INFERENCE}"
    )


class TermTile:
    """The features of a block of rows, of one term.

    Parameters
    ----------
    features : TermFeatures
        Theirs.
    X : ndarray of shape (n_samples, n_inputs)
        Inputs.

    Attributes
    ----------
    phi : ndarray of shape (n_inducing, n_samples)
        The features.
    rest : ndarray of shape (n_samples,)
        k(x, x) - |phi(x)|^2, the variance that they leave unexplained.
    """

    def __init__(self, features, X):
        self.features, m = features, len(features)
        # k(Z, X) is a tile of the kernel between the rows of [Z; X]
        bound = features.node.bind(features.theta, np.vstack([features.Z, X]))
        self.bound, self.rows, self.cols = bound, slice(0, m), slice(m, m + len(X))
        K, self.tape = bound.block(self.rows, self.cols)
        self.phi = features.cholesky.half_solve(np.broadcast_to(K, (m, len(X))))
        self.rest = features.kernel.diag(X) - np.einsum("ji,ji->i", self.phi, self.phi)

    def contract(self, K_bar, diagonal):
        """Gradient by theta.

        Parameters
        ----------
        K_bar : ndarray of shape (n_inducing, n_samples)
            Adjoints of k(Z, X).
        diagonal : ndarray of shape (n_samples,)
            Adjoints of k(x, x).

        Returns
        -------
        gradient : ndarray of shape (n_theta,)
            Its gradient, but for K_ZZ's part.
        """
        gradient = self.bound.contract(K_bar, self.tape, self.rows, self.cols)
        return gradient + self._contract_diagonal(diagonal)

    def _contract_diagonal(self, diagonal):
        gradient, m = 0.0, len(self.features)
        for a in range(0, len(diagonal), DIAGONAL):
            W = np.diag(diagonal[a : a + DIAGONAL])
            rows = slice(m + a, m + a + len(W))
            tape = self.bound.block(rows, rows)[1]
            gradient = gradient + self.bound.contract(W, tape, rows, rows)
        return gradient

    def contract_inputs(self, K_bar):
        """Gradient by Z through k(Z, X)."""
        n_inputs = self.features.Z.shape[1]
        return contract_inputs(
            self.bound, K_bar, self.tape, self.rows, self.cols, n_inputs
        )
