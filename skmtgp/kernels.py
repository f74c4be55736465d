"""Covariance functions k^x over the inputs, in scikit-learn's language.

You can use every :class:`sklearn.gaussian_process.kernels.Kernel`. This module adds
three kernels of its own and builds the kernel of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Hyperparameter,
    Kernel,
)

from skmtgp._data.joints import (
    are_revolute,
    check_angles,
    check_joints,
    columns_of_positions,
)

__all__ = [
    "ARDLinear",
    "Columns",
    "Spherical",
    "geometric_inverse_dynamics_kernel",
    "inverse_dynamics_kernel",
]

WIDE = np.exp([-14.0, 5.0])  # bounds of weights and amplitudes of standardised features
# The same of polynomials: Coulomb friction may be most of a torque, inertia 1e-5 of it.
# What samples do not show keeps some variance all the same: with lower bounds of e^-18
# the error of extrapolation rose 28 fold at one joint, and fell threefold at another.
WIDER = np.exp([-14.0, 12.0])
POSITION = 0.1  # where weights of positions start: a product of as many is then near 1


class ARDLinear(Kernel):
    r"""Inhomogeneous linear kernel with one weight per feature.

    .. math:: k(x, x') = b + \sum_d w_d (x_d - c_d) (x'_d - c_d)

    Parameters
    ----------
    weights : float or array-like of shape (n_features,), default=1.0
        Prior variances :math:`w_d` of the coefficients, in units of 1 / feature^2. All
        features share a float.
    bias : float, default=1.0
        Prior variance b of the value at the centre: of the intercept, if that is zero.
        It is not learned if `bias_bounds` is "fixed". 0 with fixed bounds gives the
        homogeneous linear kernel.
    weights_bounds, bias_bounds : pair of floats or "fixed", default=(1e-7, 1e3)
        Bounds of the hyperparameters.
    center : float or array-like of shape (n_features,), default=0.0
        Where c the value and the slopes are independent beforehand. For features far
        from zero, such as years, a mean. All features share a float.

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
        center: ArrayLike = 0.0,
    ) -> None:
        self.weights = weights
        self.bias = bias
        self.weights_bounds = weights_bounds
        self.bias_bounds = bias_bounds
        self.center = center

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

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[False] = False,
    ) -> NDArray[np.float64]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[True] = ...,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

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
        X = np.atleast_2d(X) - np.asarray(self.center)
        if eval_gradient and Y is not None:
            raise ValueError("The gradient can only be evaluated when Y is None.")
        Y = X if Y is None else np.atleast_2d(Y) - np.asarray(self.center)
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
        squares = np.square(X - np.asarray(self.center))
        return self.bias + squares @ np.broadcast_to(self.weights, X.shape[1])

    def is_stationary(self) -> bool:
        """Whether the kernel depends on x - x' only: no."""
        return False

    def __repr__(self) -> str:
        weights, center = (
            np.array2string(np.asarray(values), precision=3, threshold=10)
            for values in (self.weights, self.center)
        )
        where = f", center={center}" if np.any(self.center) else ""
        return f"ARDLinear(weights={weights}, bias={self.bias:.3g}{where})"


class Columns(Kernel):
    """A kernel on some of the features only.

    Parameters
    ----------
    kernel : Kernel
        Kernel of the selected features. Its hyperparameters are this kernel's.
    columns : sequence of int or str
        Indices of the features that it uses, without counting the task column. Negative
        ones count from the end. Or names of columns, in the kernel of an estimator that
        is fitted to a frame; its `kernel_` has their indices.

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

    def __init__(self, kernel: Kernel, columns: Sequence[int | str]) -> None:
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

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[False] = False,
    ) -> NDArray[np.float64]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[True] = ...,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

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
        """Select the features that the kernel uses.

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
        if not _are_positions(self.columns, X.shape[1]):
            return X[:, _positions(self.columns, X.shape[1])]
        return X[:, self.columns]

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


class Spherical(RBF):
    r"""Spherical covariance of geostatistics, which is zero beyond its range.

    .. math:: k(x, x') = 1 - \tfrac32 h + \tfrac12 h^3, \qquad
        h^2 = \sum_d (x_d - x'_d)^2 / a_d^2 \le 1

    and 0 where h > 1.

    Parameters
    ----------
    length_scale : float or array-like of shape (n_features,), default=1.0
        The range a, in units of the features; an array has one for each feature, which
        is geometric anisotropy along the axes. Unlike the practical range of an
        exponential covariance, it is where the covariance ends.
    length_scale_bounds : pair of floats or "fixed", default=(1e-5, 1e5)
        Bounds of the range.

    See Also
    --------
    sklearn.gaussian_process.kernels.Matern : ``nu=0.5`` is the exponential one.

    Notes
    -----
    It is a covariance of at most three features. Its derivative by the range is
    continuous, but its likelihood has several maxima where few pairs of places are as
    far apart as the range. So learning tries ten ranges, and begins at the likeliest.
    See Chiles and Delfiner, "Geostatistics: Modeling Spatial Uncertainty" (2012),
    section 2.5.1.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp.kernels import Spherical
    >>> Spherical(2.0)(np.array([[0.0]]), np.array([[0.0], [1.0], [2.0], [3.0]]))
    array([[1.    , 0.3125, 0.    , 0.    ]])
    """

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[False] = False,
    ) -> NDArray[np.float64]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: Literal[True] = ...,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    @overload
    def __call__(
        self,
        X: ArrayLike,
        Y: ArrayLike | None = None,
        eval_gradient: bool = False,
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...

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
            Whether to return the gradient with respect to the log of the range too.
            Only possible if Y is None.

        Returns
        -------
        K : ndarray of shape (n_samples_X, n_samples_Y)
            Covariance.
        K_gradient : ndarray of shape (n_samples_X, n_samples_X, n_dims)
            Its gradient. Only if `eval_gradient`.
        """
        if eval_gradient and Y is not None:
            raise ValueError("The gradient can only be evaluated when Y is None.")
        X = np.atleast_2d(X)
        Y, scale = X if Y is None else np.atleast_2d(Y), np.asarray(self.length_scale)
        h = np.minimum(cdist(X / scale, Y / scale), 1.0)
        K = 1.0 - 1.5 * h + 0.5 * h**3
        return (K, self._gradient(X / scale, h)) if eval_gradient else K

    def _gradient(self, Z, h):
        """Dk / d log a_d = 3/2 (1 - h^2) / h (z_d - z'_d)^2."""
        if self.hyperparameter_length_scale.fixed:
            return np.empty((*h.shape, 0))
        slope = 1.5 * (1.0 - h**2)
        if not self.anisotropic:
            return (slope * h)[:, :, None]
        slope = np.divide(slope, h, out=np.zeros_like(h), where=h > 0.0)
        return slope[:, :, None] * np.square(Z[:, None] - Z[None])


def _are_positions(columns, n_features):
    """Whether this is a list of indices that needs no closer look, as it mostly is."""
    return (
        type(columns) is list
        and set(map(type, columns)) == {int}
        and -n_features <= min(columns)
        and max(columns) < n_features
    )


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
            "task column not counted, such as [0, 2]. An estimator that is fitted to a "
            "frame takes names of its columns, too."
        )
    for column in positions[(positions < -n_features) | (positions >= n_features)][:1]:
        raise ValueError(
            f"columns={columns!r} name column {column}, but X has {n_features} "
            "features without the task column."
        )
    return positions


def inverse_dynamics_kernel(
    n_joints: int,
    *,
    angles: Literal["radians", "trigonometric"] = "radians",
    joint_types: Sequence[str] | None = None,
) -> Kernel:
    r"""Kernel of the paper, section 6, for features (x, sgn(qd)).

    .. math::
        k^x(x, x') = b + \sum_{d=1}^{D+J} w_d u_d u'_d
        + a \exp\Bigl(-\tfrac12 \sum_{d=1}^{D} (x_d - x'_d)^2 / \ell_d^2\Bigr)

    Here x = (q, qd, qdd) are the D = 3 J standardised positions, velocities and
    accelerations, and u = (x, sgn(qd)).

    Parameters
    ----------
    n_joints : int
        Number of joints J of the robot.
    angles : {"radians", "trigonometric"}, default="radians"
        Whether x has the positions of joints that turn, as in the paper, or their
        cosines and sines. With cosines and sines D is one larger for each of them, and
        it does not matter where angles jump by a full turn.
    joint_types : sequence of str, default=None
        "revolute" (or "R") or "prismatic" (or "P") for each joint. None means that all
        are revolute. It only matters to trigonometric angles.

    Returns
    -------
    kernel : Kernel
        Kernel on the D + J features that
        :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` makes with the same
        `angles` and `joint_types`. It has D + J weights, a bias, an amplitude and D
        length-scales. All start at the same value.

    Raises
    ------
    TypeError
        If `joint_types` is not a sequence.
    ValueError
        If `n_joints` is not a positive integer, `angles` is neither word, or
        `joint_types` do not fit `n_joints`.

    See Also
    --------
    geometric_inverse_dynamics_kernel : Polynomials, for rigid bodies.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a sum of an inhomogeneous
    linear kernel on (x, sgn(qd)), a squared exponential kernel on x, and an independent
    noise component". The first two have automatic relevance determination. Here the
    noise belongs to the estimator, not to the kernel.

    Examples
    --------
    >>> from skmtgp.kernels import inverse_dynamics_kernel
    >>> inverse_dynamics_kernel(6).n_dims
    44
    >>> inverse_dynamics_kernel(6, angles="trigonometric").n_dims
    56
    """
    if not isinstance(n_joints, (int, np.integer)) or n_joints < 1:
        raise ValueError(f"n_joints={n_joints!r} must be a positive integer.")
    check_angles(angles)
    revolute = check_joints(joint_types, n_joints)
    n_x = 3 * n_joints + (sum(revolute) if angles == "trigonometric" else 0)
    linear = ARDLinear(np.ones(n_x + n_joints), 1.0, WIDE, WIDE)
    rbf = RBF(np.full(n_x, np.exp(2.0)), np.exp([-2.0, 8.0]))
    return linear + ConstantKernel(1.0, WIDE) * Columns(rbf, range(n_x))


def geometric_inverse_dynamics_kernel(
    joint_types: Sequence[str], *, joint: int | None = None
) -> Kernel:
    r"""Kernel of the polynomials that describe torques of rigid bodies.

    .. math::
        k^x(x, x') = \sum_{d=1}^{2J} f_d z_d z'_d
        + c \prod_{i=1}^J \Bigl(1 + \sum_{d \in i} g_d p_d p'_d\Bigr)
        + \Bigl(\sum_{i=1}^J a_i \ddot q_i \ddot q'_i
        + \bigl(\sum_{i=1}^J v_i \dot q_i \dot q'_i\bigr)^2\Bigr)
        \prod_{i=1}^J \Bigl(1 + \sum_{d \in i} w_d p_d p'_d\Bigr)^2

    Here :math:`p_d, d \in i` is the position of joint i: (cos q_i, sin q_i) if it turns
    and q_i if it slides. z = (qd, sgn(qd)). The first term is viscous and Coulomb
    friction, the second gravity, the third inertia with centrifugal and Coriolis
    forces.

    Parameters
    ----------
    joint_types : sequence of str
        "revolute" (or "R") for each joint that turns, "prismatic" (or "P") for each
        that slides, such as ``"RRPRRR"`` or ``["revolute"] * 6``. Each joint carries
        those after it.
    joint : int, default=None
        Position, from 0, of the joint whose torque is learned. The kernel then has all
        polynomials of this torque, and few that it cannot have, see Notes. None is a
        kernel for any joint.

    Returns
    -------
    kernel : Kernel
        Kernel on the features that
        :class:`~skmtgp.preprocessing.InverseDynamicsFeatures` makes with
        ``angles="trigonometric"`` and these `joint_types`. It is made of
        :class:`ARDLinear` and :class:`Columns`.

    Raises
    ------
    TypeError
        If `joint_types` is not a sequence, or `joint` is not an integer.
    ValueError
        If it is empty, or if a joint is neither revolute nor prismatic. If there is no
        such `joint`.

    See Also
    --------
    inverse_dynamics_kernel : The paper's kernel, for torques of any form.

    Notes
    -----
    Dalla Libera and Carli (2020) show that the torque of a rigid robot is a polynomial
    in these features. Its degree in the position of each joint is at most 2, whatever
    the lengths and inertias of the links. They use a product of polynomial kernels, one
    for each joint. This kernel has such polynomials only. So it extrapolates where a
    squared exponential falls back to the mean. Anything else, such as Stribeck friction
    or elastic joints, is noise to it. To learn that, add a squared exponential.

    Here gravity has its own product. The potential energy of a rigid robot has degree 1
    in the position of each joint, and its kinetic energy degree 2 (Giacomuzzo, Carli,
    Romeres and Dalla Libera, 2024). So gravity needs fewer polynomials than inertia.

    With a known `joint` j, friction is that of this joint, with an offset that has a
    variance of its own. A cosine and its sine share a weight. So it does not matter
    where an angle is zero: :math:`p_i \cdot p'_i`, the sum over d in i, is
    :math:`\cos(q_i - q'_i)`. Inertia becomes

    .. math::
        \Bigl[\sum_{i \ge j} a_i \ddot q_i \ddot q'_i + (\dot q, \dot q')_{\ge j}^2
        + P_j \Bigl(\sum_{i < j} a_i \ddot q_i \ddot q'_i
        + Q_j \, (\dot q, \dot q')_{< j} (\dot q, \dot q')_{\ne j}\Bigr)\Bigr]
        \prod_{i > j} (1 + w_i \, p_i \cdot p'_i)^2

    where :math:`(\dot q, \dot q')` is a weighted sum of :math:`\dot q_i \dot q'_i` over
    the named joints. P_j and Q_j are products of polynomials of degree 1 over the
    joints from the second one to j. The element j, k of the mass matrix depends on the
    joints after the first of both: in degree 1 up to the second, in degree 2 beyond.
    Its derivatives are the coefficients of products of velocities, and that of
    :math:`\dot q_i \dot q_j` vanishes for i < j. The last joint has no
    :math:`(\dot q, \dot q')_{\ge j}^2`: alone it has no centrifugal torque.

    References
    ----------
    .. [1] A. Dalla Libera, R. Carli, "A data-efficient geometrically inspired
       polynomial kernel for robot inverse dynamics", IEEE Robotics and Automation
       Letters 5(1), 24-31, 2020.
    .. [2] G. Giacomuzzo, R. Carli, D. Romeres, A. Dalla Libera, "A black-box
       physics-informed estimator based on Gaussian process regression for robot
       inverse dynamics identification", IEEE Transactions on Robotics 40, 2024.

    Examples
    --------
    >>> from skmtgp.kernels import geometric_inverse_dynamics_kernel
    >>> geometric_inverse_dynamics_kernel("RRRRRR").n_dims
    49
    >>> geometric_inverse_dynamics_kernel("RRRRRR", joint=4).n_dims
    36
    >>> geometric_inverse_dynamics_kernel(["revolute", "prismatic"]).n_dims
    15
    """
    positions = columns_of_positions(are_revolute(joint_types))
    J, n = len(positions), positions[-1][-1] + 1
    speeds, accelerations, signs = (
        list(range(n + k * J, n + k * J + J)) for k in range(3)
    )
    if joint is None:
        friction, shared = _linear([*speeds, *signs]), False
        motion = _linear(accelerations) + _linear(speeds) ** 2
        inertia = _times(motion, positions, degree=2, shared=False)
    else:
        j, shared = _check_joint(joint, J), True
        friction = _linear([speeds[j], signs[j]]) + ConstantKernel(1.0, WIDER)
        inertia = _inertia_at(j, positions, speeds, accelerations)
    gravity = _times(ConstantKernel(1.0, WIDER), positions, shared=shared)
    return friction + gravity + inertia


def _check_joint(joint, n_joints):
    """The position of a joint, if there is one."""
    if not isinstance(joint, Integral) or isinstance(joint, bool):
        raise TypeError(f"joint={joint!r} must be None or an integer.")
    if not 0 <= joint < n_joints:
        raise ValueError(
            f"joint={joint!r} must be from 0 to {n_joints - 1}: there are {n_joints} "
            "joints."
        )
    return int(joint)


def _inertia_at(j, positions, speeds, accelerations):
    """Inertial torques of joint j: what moves with it, and what carries it."""
    motion, between = _linear(accelerations[j:]), positions[1 : j + 1]
    if j + 1 < len(speeds):  # alone it has no centrifugal torque
        motion = motion + _linear(speeds[j:]) ** 2
    if j > 0:
        others = _linear([*speeds[:j], *speeds[j + 1 :]])
        pairs = _times(_linear(speeds[:j]) * others, between)
        motion = motion + _times(_linear(accelerations[:j]) + pairs, between)
    return _times(motion, positions[j + 1 :], degree=2)


def _times(kernel, positions, *, degree=1, shared=True):
    """A kernel times a polynomial in the position of each of some joints.

    A cosine and its sine have one weight if it is shared.
    """
    for of_joint in positions:
        weights = POSITION if shared else np.full(len(of_joint), POSITION)
        line = Columns(ARDLinear(weights, 1.0, WIDER, "fixed"), of_joint)
        kernel = kernel * (line if degree == 1 else line**degree)
    return kernel


def _linear(columns):
    """A linear kernel of some columns, with a weight for each."""
    return Columns(ARDLinear(np.ones(len(columns)), 0.0, WIDER, "fixed"), columns)
