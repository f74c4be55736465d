"""Covariance functions k^x over the inputs, in scikit-learn's language.

Every :class:`sklearn.gaussian_process.kernels.Kernel` can be used; this module adds
two of its own and builds the kernel of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Hyperparameter,
    Kernel,
)

__all__ = ["ARDLinear", "Columns", "inverse_dynamics_kernel"]


class ARDLinear(Kernel):
    r"""Inhomogeneous linear kernel with one weight per feature.

    .. math:: k(x, x') = b + \sum_d w_d x_d x'_d

    Parameters
    ----------
    weights : float or array-like of shape (n_features,), default=1.0
        Prior variances :math:`w_d` of the coefficients, in units of one over the
        square of the feature. A float is shared by all features.
    bias : float, default=1.0
        Prior variance b of the intercept. It is not learned where `bias_bounds` is
        "fixed"; 0 with fixed bounds gives the homogeneous linear kernel.
    weights_bounds, bias_bounds : pair of floats or "fixed", default=(1e-7, 1e3)
        Bounds of the hyperparameters.

    Notes
    -----
    Automatic relevance determination as in Rasmussen and Williams (2006), sections
    4.2.2 and 5.1: a feature that does not matter gets weight zero. scikit-learn's
    ``DotProduct(sigma_0)`` is ``ARDLinear(weights=1.0, bias=sigma_0**2)``.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.kernels import ARDLinear
    >>> ARDLinear(weights=[1.0, 0.5], bias=2.0)(np.array([[1.0, 2.0]]))
    array([[5.]])
    """

    def __init__(
        self,
        weights: ArrayLike = 1.0,
        bias: float = 1.0,
        weights_bounds: ArrayLike | Literal["fixed"] = (1e-7, 1e3),
        bias_bounds: ArrayLike | Literal["fixed"] = (1e-7, 1e3),
    ) -> None:
        self.weights = weights
        self.bias = bias
        self.weights_bounds = weights_bounds
        self.bias_bounds = bias_bounds

    @property
    def hyperparameter_bias(self) -> Hyperparameter:
        """The intercept's variance, as a hyperparameter."""
        return Hyperparameter("bias", "numeric", self.bias_bounds)

    @property
    def hyperparameter_weights(self) -> Hyperparameter:
        """The weights, as a hyperparameter."""
        if np.iterable(self.weights):
            n = len(self.weights)
            return Hyperparameter("weights", "numeric", self.weights_bounds, n)
        return Hyperparameter("weights", "numeric", self.weights_bounds)

    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Covariance of X and Y, and its gradient with respect to theta.

        Parameters
        ----------
        X : ndarray of shape (n_samples_X, n_features)
            Left argument.
        Y : ndarray of shape (n_samples_Y, n_features), default=None
            Right argument; X if None.
        eval_gradient : bool, default=False
            Whether to return the gradient with respect to the log of the
            hyperparameters too. Only possible if Y is None.

        Returns
        -------
        K : ndarray of shape (n_samples_X, n_samples_Y)
            Covariance.
        K_gradient : ndarray of shape (n_samples_X, n_samples_X, n_dims)
            Its gradient. Only if `eval_gradient`.
        """
        X = np.atleast_2d(X)
        if eval_gradient and Y is not None:
            raise ValueError("The gradient can only be evaluated when Y is None.")
        Y = X if Y is None else np.atleast_2d(Y)
        K = self.bias + (X * np.asarray(self.weights)) @ Y.T
        return (K, self._gradient(X)) if eval_gradient else K

    def _gradient(self, X):
        slices = []
        if not self.hyperparameter_bias.fixed:
            slices.append(np.full((len(X), len(X), 1), float(self.bias)))
        if not self.hyperparameter_weights.fixed:
            terms = X[:, None, :] * X[None, :, :] * np.asarray(self.weights)
            ard = self.hyperparameter_weights.n_elements > 1
            slices.append(terms if ard else terms.sum(axis=2, keepdims=True))
        return np.concatenate([np.empty((len(X), len(X), 0)), *slices], axis=2)

    def diag(self, X: NDArray[Any]) -> NDArray[np.float64]:
        """Diagonal of ``self(X)``, of shape (n_samples_X,)."""
        return self.bias + np.square(X) @ np.broadcast_to(self.weights, X.shape[1])

    def is_stationary(self) -> bool:
        """Whether the kernel depends on x - x' only: no."""
        return False

    def __repr__(self) -> str:
        weights = np.array2string(np.asarray(self.weights), precision=3, threshold=10)
        return f"ARDLinear(weights={weights}, bias={self.bias:.3g})"


class Columns(Kernel):
    """A kernel that sees some of the features only.

    Parameters
    ----------
    kernel : Kernel
        The kernel of the selected features. Its hyperparameters are this kernel's.
    columns : sequence of int
        Indices of the features that it sees, the task column not counted. Negative ones
        count from the end.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.gaussian_process.kernels import RBF
    >>> from skmtgp.kernels import Columns
    >>> X = np.array([[0.0, 1.0], [0.0, 2.0]])
    >>> Columns(RBF(), [0])(X)
    array([[1., 1.],
           [1., 1.]])
    """

    def __init__(self, kernel: Kernel, columns: Sequence[int]) -> None:
        self.kernel = kernel
        self.columns = columns

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters of this kernel and, if `deep`, of the kernel inside.

        Parameters
        ----------
        deep : bool, default=True
            Whether to include the parameters of the kernel inside.

        Returns
        -------
        params : dict
            Parameter names and their values.
        """
        params = {"kernel": self.kernel, "columns": self.columns}
        if deep and isinstance(self.kernel, Kernel):
            inner = self.kernel.get_params()
            params |= {f"kernel__{name}": value for name, value in inner.items()}
        return params

    @property
    def hyperparameters(self) -> list[Hyperparameter]:
        """The hyperparameters of the kernel inside."""
        return [
            Hyperparameter(f"kernel__{h.name}", h.value_type, h.bounds, h.n_elements)
            for h in self.kernel.hyperparameters
        ]

    @property
    def theta(self) -> NDArray[np.float64]:
        """Log of the free hyperparameters, of shape (n_dims,)."""
        return self.kernel.theta

    @theta.setter
    def theta(self, theta: NDArray[np.float64]) -> None:
        self.kernel.theta = theta

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Log of the bounds of theta, of shape (n_dims, 2)."""
        return self.kernel.bounds

    def __eq__(self, other: object) -> bool:
        return (
            type(self) is type(other)
            and self.kernel == other.kernel
            and list(self.columns) == list(other.columns)
        )

    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Covariance of X and Y, and its gradient with respect to theta.

        Parameters
        ----------
        X : ndarray of shape (n_samples_X, n_features)
            Left argument.
        Y : ndarray of shape (n_samples_Y, n_features), default=None
            Right argument; X if None.
        eval_gradient : bool, default=False
            Whether to return the gradient too. Only possible if Y is None.

        Returns
        -------
        K : ndarray of shape (n_samples_X, n_samples_Y)
            Covariance.
        K_gradient : ndarray of shape (n_samples_X, n_samples_X, n_dims)
            Its gradient. Only if `eval_gradient`.
        """
        Y = None if Y is None else self.select(Y)
        return self.kernel(self.select(X), Y, eval_gradient=eval_gradient)

    def select(self, X: ArrayLike) -> NDArray[Any]:
        """Cut the features that the kernel sees.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            All features, without the task column.

        Returns
        -------
        selected : ndarray of shape (n_samples, n_columns)
            Those in `columns`.

        Raises
        ------
        ValueError
            If `columns` are not indices of features.
        """
        X = np.atleast_2d(X)
        return X[:, _positions(self.columns, X.shape[1])]

    def diag(self, X: NDArray[Any]) -> NDArray[np.float64]:
        """Diagonal of ``self(X)``, of shape (n_samples_X,)."""
        return self.kernel.diag(self.select(X))

    def is_stationary(self) -> bool:
        """Whether the kernel inside is stationary."""
        return self.kernel.is_stationary()

    @property
    def requires_vector_input(self) -> bool:
        """Whether the kernel is defined on vectors only: yes."""
        return True

    def __repr__(self) -> str:
        return f"Columns({self.kernel!r}, {list(self.columns)})"


def _positions(columns, n_features):
    """Indices of features as an array; a ValueError says what is wrong with them."""
    positions, values = np.asarray(columns), np.ravel(np.asarray(columns, object))
    if (
        positions.ndim != 1
        or not positions.size
        or positions.dtype.kind not in "iu"
        or any(isinstance(value, bool | np.bool_) for value in values)
    ):
        raise ValueError(
            f"columns={columns!r} must be a list of indices (int) of features, the "
            "task column not counted, such as [0, 2]."
        )
    for column in positions[(positions < -n_features) | (positions >= n_features)][:1]:
        raise ValueError(
            f"columns={columns!r} name column {column}, but X has {n_features} "
            "features without the task column."
        )
    return positions


def inverse_dynamics_kernel(n_joints: int) -> Kernel:
    r"""Kernel of the paper, section 6, for features (x, sgn(qd)).

    .. math::
        k^x(x, x') = b + \sum_{d=1}^{4J} w_d u_d u'_d
        + a \exp\Bigl(-\tfrac12 \sum_{d=1}^{3J} (x_d - x'_d)^2 / \ell_d^2\Bigr)

    where x = (q, qd, qdd) are the 3 J standardised positions, velocities and
    accelerations and u = (x, sgn(qd)).

    Parameters
    ----------
    n_joints : int
        Number of joints J of the robot.

    Returns
    -------
    kernel : Kernel
        Kernel on the 4 J features that
        :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` makes, with 4 J weights,
        a bias, an amplitude and 3 J length-scales, all of them equal to start with.

    Raises
    ------
    ValueError
        If `n_joints` is not a positive integer.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a sum of an inhomogeneous
    linear kernel on (x, sgn(qd)), a squared exponential kernel on x, and an independent
    noise component", the first two with automatic relevance determination. The noise is
    the estimator's, not the kernel's.

    Examples
    --------
    >>> from skmtgp.kernels import inverse_dynamics_kernel
    >>> inverse_dynamics_kernel(6).n_dims
    44
    """
    if not isinstance(n_joints, (int, np.integer)) or n_joints < 1:
        raise ValueError(f"n_joints={n_joints!r} must be a positive integer.")
    wide = np.exp([-14.0, 5.0])
    linear = ARDLinear(np.ones(4 * n_joints), 1.0, wide, wide)
    rbf = RBF(np.full(3 * n_joints, np.exp(2.0)), np.exp([-2.0, 8.0]))
    return linear + ConstantKernel(1.0, wide) * Columns(rbf, range(3 * n_joints))
