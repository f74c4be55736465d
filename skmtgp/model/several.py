"""Several terms K^rho_q x k_q: their kernels, and their forms of K^rho, taken together.

A prior of one term has a kernel and a form of K^rho. That of several has `Kernels` and
`Forms` in their places, whose parameters are those of the terms, one after another.
What is one matrix K^rho of one term has a leading axis of the terms here.
"""

from itertools import accumulate, pairwise

import numpy as np

from skmtgp.model._nodes import NODES, allocate, compile_kernel
from skmtgp.model._nodes.expressions import BoundJoined, JoinedNode


class Several:
    """What the terms have, one after another.

    Parameters
    ----------
    parts : iterable
        Of the terms.
    sizes : iterable of int
        Numbers of their parameters.
    """

    def __init__(self, parts, sizes):
        self.parts = tuple(parts)
        self._ends = [0, *accumulate(sizes)]

    def __iter__(self):
        return iter(self.parts)

    def __len__(self):
        return len(self.parts)

    def __getitem__(self, q):
        return self.parts[q]

    def __repr__(self):
        return f"[{', '.join(map(str, self.parts))}]"

    def split(self, parameters):
        """The parameters of each term."""
        return [parameters[a:b] for a, b in pairwise(self._ends)]

    def _of_each(self, evaluate, parameters, *others):
        """``evaluate(part, its parameters, ...)`` of each term."""
        return [
            evaluate(*of)
            for of in zip(self.parts, self.split(parameters), *others, strict=True)
        ]


class Kernels(Several):
    """The kernels k_q of several terms, with one theta.

    Parameters
    ----------
    kernels : iterable of Kernel
        Those of the terms.

    Attributes
    ----------
    theta, bounds, n_dims
        As of a Kernel: those of all of them.
    """

    def __init__(self, kernels):
        kernels = tuple(kernels)
        super().__init__(kernels, (kernel.n_dims for kernel in kernels))
        self.n_dims = self._ends[-1]

    @property
    def theta(self):
        """Theta of all kernels, of shape (n_dims,)."""
        return np.concatenate([kernel.theta for kernel in self])

    @property
    def bounds(self):
        """Its bounds, of shape (n_dims, 2)."""
        return np.vstack([kernel.bounds.reshape(-1, 2) for kernel in self])

    def clone_with_theta(self, theta):
        """The same with another theta."""
        return Kernels(self._of_each(lambda of, part: of.clone_with_theta(part), theta))


class SeveralNode(JoinedNode):
    """The fast form of several kernels."""

    def __init__(self, kernels):
        self.parts, self.bound = [compile_kernel(of) for of in kernels], BoundSeveral
        self.n_dims = kernels.n_dims
        self.n_slices = max(part.n_slices for part in self.parts)


class BoundSeveral(BoundJoined):
    """Several kernels: values, tapes and weights are tuples of theirs."""

    def __iter__(self):
        return iter(self.parts)

    def block(self, rows, cols, new=allocate):
        """The values of a tile of each kernel, and their tapes."""
        return tuple(zip(*(of.block(rows, cols, new) for of in self), strict=True))

    def contract(self, W, tape, rows, cols):
        """Contractions of each kernel with weights of its own."""
        of_each = zip(self, W, tape, strict=True)
        return np.concatenate([of.contract(w, t, rows, cols) for of, w, t in of_each])


NODES[Kernels] = SeveralNode


class Forms(Several):
    """The forms of K^rho of several terms.

    Parameters
    ----------
    forms : iterable of FixedTaskCovariance, LowRank or another
        Those of the terms, of the same tasks.

    Attributes
    ----------
    rank : list of int
        Of each term.
    """

    def __init__(self, forms):
        forms = tuple(forms)
        super().__init__(forms, (form.n_parameters for form in forms))
        self.n_tasks, self.n_parameters = forms[0].n_tasks, self._ends[-1]
        self.n_free = sum(form.n_free for form in forms)
        self.shared = any(form.shared for form in forms)

    def __str__(self):
        return " + ".join(map(str, self))

    @property
    def rank(self):
        """Rank of each."""
        return [getattr(form, "rank", 0) for form in self]

    def bounds(self, scale):
        """Bounds of the parameters, of shape (n_parameters, 2)."""
        return np.vstack([form.bounds(scale) for form in self])

    def matrix(self, parameters):
        """K^rho of each term, of shape (n_terms, n_tasks, n_tasks)."""
        return np.array(self._of_each(lambda of, part: of.matrix(part), parameters))

    def factor(self, parameters):
        """A list of the factors of each, of shape (n_tasks, rank)."""
        return self._of_each(lambda of, part: of.factor(part), parameters)

    def pull_back(self, parameters, D):
        """Gradient of the parameters, from dL / dK^rho of each term."""
        of_each = self._of_each(lambda of, *at: of.pull_back(*at), parameters, D)
        return np.concatenate(of_each)

    def derivatives(self, parameters):
        """Derivatives of each term's K^rho: a list of those of each."""
        return self._of_each(lambda of, part: list(of.derivatives(part)), parameters)

    def parameters(self, K, truncation="eigen"):
        """Parameters of matrices near these, or near equal parts of one."""
        Ks = K if np.ndim(K) == 3 else [K / len(self)] * len(self)
        pairs = zip(self, Ks, strict=True)
        return np.concatenate([form.parameters(of, truncation) for form, of in pairs])

    def unseen(self, parameters, described=None):
        """Tasks without data, of each term: see `unseen_of`."""
        return self._of_each(unseen_of, parameters)


def unseen_of(form, parameters, described=None):
    """Tasks without data of a term, see `WithShared.unseen`.

    Of tasks that are apart, and of a form that tells nothing, it is the variance alone.
    """
    own = np.diagonal(form.matrix(parameters)).mean()
    return form.unseen(parameters, described) or (np.zeros((1, 0)), own)


def factor_shape_of(form):
    """Shape of the factor that is learned of a form; of none that has none."""
    return getattr(form, "factor_shape", (form.n_tasks, 0))


def terms_of(several):
    """The kernels, or the forms, of the terms: of one term a list of it alone.

    Parameters
    ----------
    several : Kernels or Forms, or a Kernel or form
        What a prior has.

    Returns
    -------
    of_terms : list
    """
    return list(several) if isinstance(several, Several) else [several]
