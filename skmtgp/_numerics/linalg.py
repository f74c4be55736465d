"""Cholesky factorisations and eigen-decompositions, and what happens when they fail."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, blas, eigh, lapack
from scipy.linalg import svd as scipy_svd

from skmtgp._support.guide import INFERENCE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import JitterWarning, NotPositiveDefiniteError

NEGLIGIBLE = 5.0 * np.finfo(np.float64).eps  # of the largest eigenvalue, in any of them
INDEFINITE = 1e-6  # of the largest eigenvalue: more than that
RESOLVED = 10.0 * np.finfo(np.float64).eps  # of what it is part of: less is rounding
JITTERS = 1e-12, 1e-10, 1e-8, 1e-7  # of a variance, added to it to make draws
# Rows of triangles that are inverted in halves, whose copies take half as much again.
# With fewer rows calls cost more; with more LAPACK is nearly as fast
HALVED = range(65, 1500)


class Routines(NamedTuple):
    """What BLAS and LAPACK have for triangles, in one precision."""

    potrf: Callable
    lauum: Callable
    trtri: Callable
    trmm: Callable
    trsm: Callable
    trsv: Callable


DOUBLE = Routines(
    lapack.dpotrf, lapack.dlauum, lapack.dtrtri, blas.dtrmm, blas.dtrsm, blas.dtrsv
)
SINGLE = Routines(
    lapack.spotrf, lapack.slauum, lapack.strtri, blas.strmm, blas.strsm, blas.strsv
)


class Cholesky:
    """The factor of K = C C^T and what is computed from it.

    Parameters
    ----------
    K : ndarray of shape (n, n), Fortran-ordered
        Symmetric matrix of which only the lower triangle is read. It is
        overwritten by the factor.

    Attributes
    ----------
    jitter : float
        What was added to the diagonal of K so that it has a factor.

    Raises
    ------
    NotPositiveDefiniteError
        If K is not finite or not positive definite.
    """

    jitter, _routines = 0.0, DOUBLE

    def __init__(self, K):
        self._factor, info = self._routines.potrf(K, lower=1, clean=0, overwrite_a=1)
        pivots = np.diagonal(self.factor)
        if info != 0 or not (np.isfinite(pivots).all() and pivots.all()):
            raise NotPositiveDefiniteError(f"pivot {info} of {len(K)} is not positive")

    @property
    def factor(self):
        """C, of shape (n, n); above the diagonal is anything."""
        if self._factor is None:  # which BLAS would take for a matrix
            raise RuntimeError(
                "The inverse took the place of this factor: solve before `invert`."
            )
        return self._factor

    def log_det(self):
        """Log-determinant of K."""
        return 2.0 * np.log(np.diagonal(self.factor), dtype=np.float64).sum()

    def solve(self, b):
        """K^{-1} b."""
        return self.half_solve(self.half_solve(b), transposed=True)

    def half_solve(self, b, *, transposed=False):
        """C^{-1} b, or C^{-T} b."""
        if b.ndim == 1:  # a third of the time of LAPACK's solver for several b
            return self._routines.trsv(self.factor, b, lower=1, trans=transposed)
        # b^T C^{-T} takes rows as they are, and a third less time than C^{-1} b
        options = {"side": 1, "lower": 1, "trans_a": not transposed}
        return self._routines.trsm(1.0, self.factor, b.T, **options).T

    def invert(self):
        """Lower triangle of K^{-1}; it takes the place of the factor.

        Whatever is asked of the factor afterwards raises a RuntimeError.
        """
        factor, self._factor = self.factor, None
        half = invert_triangle(factor, self._routines)
        return self._routines.lauum(half, lower=1, overwrite_c=1)[0]

    def inverse_diagonal(self):
        """Diagonal of K^{-1} = C^{-T} C^{-1}; the factor stays."""
        half = invert_triangle(self.factor.copy(order="F"))
        columns = (half[j:, j] for j in range(len(half)))  # above them is anything
        return np.array([column @ column for column in columns])


class SingleCholesky(Cholesky):
    """The same computed in single precision: half the time, with seven digits.

    Parameters
    ----------
    K : ndarray of shape (n, n), Fortran-ordered
        See Cholesky. It is only overwritten by the inverse.
    """

    _routines = SINGLE

    def __init__(self, K):
        self._place = K
        with np.errstate(over="ignore", invalid="ignore"):  # above the diagonal
            rounded = K.astype(np.float32, order="F")
        super().__init__(rounded)

    def half_solve(self, b, *, transposed=False):
        """See Cholesky; in double precision, with the digits of single."""
        return super().half_solve(b, transposed=transposed).astype(np.float64)

    def invert(self):
        """See Cholesky; it takes the place of K."""
        self._place[...] = super().invert()
        return self._place


def invert_triangle(L, routines=DOUBLE):
    """Put the inverse of a lower triangle in its place; above it is anything.

    LAPACK's, to which one of few hundred rows is twice as slow, does not multiply
    matrices as large as halves are.

    Parameters
    ----------
    L : ndarray of shape (n, n), Fortran-ordered
        The triangle, or a block of one.
    routines : Routines
        Of its precision.

    Returns
    -------
    L : ndarray of shape (n, n)
        The same array.
    """
    if len(L) not in HALVED:
        L[...] = routines.trtri(L, lower=1, overwrite_c=1)[0]
        return L
    a, b = slice(len(L) // 2), slice(len(L) // 2, None)
    first, second = (invert_triangle(L[of, of], routines) for of in (a, b))
    left = routines.trmm(-1.0, second, L[b, a], lower=1)
    L[b, a] = routines.trmm(1.0, first, left, side=1, lower=1, overwrite_b=1)
    return L


def symmetric_inverse(K):
    """K^{-1} of a covariance, of shape (n, n).

    It is that of a Cholesky decomposition, unless rounding has made K indefinite.
    """
    try:
        lower = np.tril(Cholesky(K.copy(order="F")).invert())
    except NotPositiveDefiniteError:
        return np.linalg.inv(K)
    inverse = lower + lower.T
    inverse[np.diag_indices_from(inverse)] *= 0.5
    return inverse


class StackedCholesky:
    """The factors of small matrices K = C C^T, stacked, and what is made of them.

    Parameters
    ----------
    K : ndarray of shape (n_matrices, n, n)
        Of each symmetric matrix the upper triangle, and zeros below it. They are
        overwritten: by C^T, then by `invert_factors`, then by `invert`.

    Raises
    ------
    NotPositiveDefiniteError
        If one of them is not finite or not positive definite.
    """

    def __init__(self, K):
        self.K, self.pivots = K, np.einsum("kii->ki", K)
        self._lower = [of.T for of in K]  # Fortran-ordered
        for of in self._lower:
            _, info = DOUBLE.potrf(of, lower=1, clean=0, overwrite_a=1)
            if info:
                raise NotPositiveDefiniteError(f"pivot {info} is not positive")
        if not (np.isfinite(self.pivots).all() and self.pivots.all()):
            raise NotPositiveDefiniteError("a pivot is not positive")

    def log_det(self):
        """Sum of the log-determinants of all K."""
        return 2.0 * np.log(self.pivots).sum()

    def invert_factors(self):
        """C^{-T} of each, in the place of C^T."""
        for of in self._lower:
            invert_triangle(of)
        return self.K

    def invert(self):
        """Upper triangles of K^{-1}, in the place of C^{-T}."""
        for of in self._lower:
            DOUBLE.lauum(of, lower=1, overwrite_c=1)
        return self.K


def cholesky_with_jitter(build, *, first=1e-12, last=1e-4):
    """Factorise ``build()``, adding to its diagonal only if that is needed.

    Parameters
    ----------
    build : callable
        Makes the matrix, of shape (n, n) and Fortran-ordered, anew.
    first, last : float
        Smallest and largest addition tried, relative to the mean diagonal.

    Raises
    ------
    NotPositiveDefiniteError
        If the largest addition does not help either.

    Warns
    -----
    JitterWarning
        With the amount added.
    """
    try:
        return Cholesky(build())
    except NotPositiveDefiniteError:
        pass
    relative = first
    while relative <= last:
        K = build()
        jitter = relative * np.diagonal(K).mean()
        K[np.diag_indices_from(K)] += jitter
        try:
            cholesky = Cholesky(K)
        except NotPositiveDefiniteError:
            relative *= 10.0
            continue
        cholesky.jitter = jitter
        warn(
            "The covariance matrix of the training data is not positive definite in "
            f"floating point; {jitter:.1e} ({relative:.0e} of its mean diagonal) was "
            f"added to its diagonal. A larger noise_variance avoids this. {INFERENCE}",
            JitterWarning,
        )
        return cholesky
    raise NotPositiveDefiniteError(
        f"The covariance matrix of the training data is not positive definite, even "
        f"with {last:.0e} of its mean added to the diagonal. Check X and y for extreme "
        f"values, or increase noise_variance. {INFERENCE}"
    )


def eigh_semidefinite(K):
    """Eigenvalues and eigenvectors of a positive semi-definite matrix.

    Parameters
    ----------
    K : ndarray of shape (n, n), Fortran-ordered
        Symmetric matrix. It is overwritten.

    Returns
    -------
    values : ndarray of shape (n,)
        Ascending. Those that rounding may have made are 0, as those of a matrix of low
        rank are.
    vectors : ndarray of shape (n, n)
        In columns, orthonormal.

    Raises
    ------
    NotPositiveDefiniteError
        If K is not finite or is indefinite beyond rounding.
    """
    if not np.isfinite(K).all():  # LAPACK might never return
        raise NotPositiveDefiniteError("a covariance is not finite")
    try:
        # divide and conquer: vectors orthonormal to the last digits; SciPy 1.11 has no
        # work space for it with one row
        values, vectors = eigh(
            K,
            driver="evd" if len(K) > 1 else "evr",
            lower=True,
            overwrite_a=True,
            check_finite=False,
        )
    except LinAlgError as error:
        raise NotPositiveDefiniteError(str(error)) from error
    if values[0] < -INDEFINITE * values[-1]:
        raise NotPositiveDefiniteError(f"eigenvalue {values[0]:.1e} is negative")
    return np.where(values < NEGLIGIBLE * values[-1], 0.0, values), vectors


def draw_normal(mean, K, n_draws, rng):
    """Draws from a normal distribution, whose covariance may be singular.

    Parameters
    ----------
    mean : ndarray of shape (n,)
        Mean.
    K : ndarray of shape (n, n)
        Covariance; rounding may have made it indefinite.
    n_draws : int
        Number of draws.
    rng : RandomState
        Source of randomness. The first of many draws are those of few.

    Returns
    -------
    draws : ndarray of shape (n, n_draws)

    Raises
    ------
    NotPositiveDefiniteError
        If K is not finite.
    """
    z = rng.standard_normal((n_draws, len(K))).T
    draws = semidefinite_factor(K) @ z
    draws += mean[:, None]
    return draws


def semidefinite_factor(K):
    """F of K = F F^T, up to rounding, of shape (n, n), where K may be singular.

    A Cholesky factor takes a thirtieth of the time of the eigenvectors, which take its
    place where more than the largest jitter was needed. Jitter is relative to each
    variance: rows in small units get no more than others.
    """
    scale = np.sqrt(np.maximum(np.diagonal(K), 0.0))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    if not np.isfinite(K).all():  # LAPACK might never return
        raise NotPositiveDefiniteError("a covariance is not finite")
    for jitter in JITTERS:
        R = np.multiply(K, inverse[:, None], order="F")
        R *= inverse
        np.fill_diagonal(R, 1.0 + jitter)
        factor, info = DOUBLE.potrf(R, lower=1, clean=1, overwrite_a=1)
        if info == 0:
            factor *= scale[:, None]
            return factor
    driver = "evd" if len(K) > 1 else "evr"
    values, vectors = eigh(K, driver=driver, check_finite=False)
    vectors *= np.sqrt(np.maximum(values, 0.0))
    return vectors


def svd(A, *, full_matrices=False):
    """Singular value decomposition, also where LAPACK's fast way does not converge.

    Divide and conquer now and then gives up a matrix most of whose singular values are
    equal, as those of compound symmetry are.

    Parameters
    ----------
    A : ndarray of shape (m, n)
        Any matrix.
    full_matrices : bool, default=False
        Whether to return all m and n singular vectors, or as many as there are values.

    Returns
    -------
    U, s, Vt : ndarrays of shape (m, k), (k,) and (k, n), k = min(m, n)
        A = U diag(s) Vt.

    Raises
    ------
    NotPositiveDefiniteError
        If A is not finite.
    """
    if not np.isfinite(A).all():
        raise NotPositiveDefiniteError("a matrix is not finite")
    try:
        return np.linalg.svd(A, full_matrices=full_matrices)
    except LinAlgError:
        return scipy_svd(A, full_matrices=full_matrices, lapack_driver="gesvd")


def correlation(K):
    """Correlations from covariances.

    Parameters
    ----------
    K : ndarray of shape (n, n)
        Positive semi-definite.

    Returns
    -------
    R : ndarray of shape (n, n)
        With ones on the diagonal; what does not vary has no correlation with others.
    """
    scale = np.sqrt(np.clip(np.diag(K), 0.0, None))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    R = np.clip(K * inverse * inverse[:, None], -1.0, 1.0)
    np.fill_diagonal(R, 1.0)
    return R
