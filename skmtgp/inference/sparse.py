r"""Sparse inference: a lower bound on the marginal likelihood from inducing variables.

The inducing variables are values u_alpha = z_alpha(Z) of the latent functions of
eq. 3 of the paper, the same inputs Z for all of them, and for those of all terms.
Titsias, *Variational learning of inducing variables in sparse Gaussian processes*
(AISTATS 2009), eq. 9, is then

.. math::
    \log N(y; 0, Q + \Lambda) - \sum_q \sum_m \frac{K^{\rho_q}_{mm}}{2 \sigma_m^2}
    \sum_{i \in m} \bigl(k_q(x_i, x_i) - |\phi_{qi}|^2\bigr),
    \quad Q_{ij} = \sum_q K^{\rho_q}_{m_i m_j} \phi_{qi}^T \phi_{qj}, \quad
    \phi_{qi} = L_q^{-1} k_q(Z, x_i)

with the Cholesky factors L_q of k_q(Z, Z). It never lies above the log marginal
likelihood, and equals it where Z holds all inputs.
"""

from copy import copy
from functools import partial

import numpy as np

from skmtgp._data.dask import sum_parts
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.guide import INFERENCE
from skmtgp.exceptions import NotPositiveDefiniteError
from skmtgp.inference.features import Features
from skmtgp.inference.gradients import Gradients
from skmtgp.inference.likelihood import Likelihood
from skmtgp.inference.loadings import Loadings
from skmtgp.inference.restricted import Columns
from skmtgp.inference.sparse_posterior import SparsePosterior
from skmtgp.inference.sums import (
    blocks,
    sum_blocks,
    sum_features,
    sum_gradients,
    sum_residuals,
)
from skmtgp.inference.weights import Weights
from skmtgp.model.several import terms_of

BLOCK = 1024  # rows
LATENT = "latent", "pull_back_latent"


class SparseBound(Likelihood):
    """Lower bound on the log marginal likelihood of one output over all tasks.

    Parameters
    ----------
    prior : Prior
        The model; theta sets its hyperparameters. A WhiteKernel in k^x is not explained
        by any inducing variable: let the noise variance have its part.
    X : array-like of shape (n_samples, n_features)
        Inputs without the task column. It may be memory-mapped, as may `tasks` and
        `y`: a block of rows is read at a time. They may be Dask arrays, with the same
        chunks of rows: the sums over the rows are then made where those are.
    tasks : array-like of shape (n_samples,)
        Task of each row, 0 to n_tasks - 1, in any order; blocks with few tasks take
        less time.
    y : array-like of shape (n_samples,)
        Targets, of which the model takes the mean to be zero.
    Z : ndarray of shape (n_inducing, n_features)
        Inducing inputs.
    block_size : int, default=1024
        Rows that are read at a time.

    Raises
    ------
    ValueError
        If Z has not the features of X, or no row.

    Notes
    -----
    theta is that of :class:`~skmtgp.inference.dense.DenseLikelihood`. For m inducing
    inputs and rank r an evaluation takes O(n m^2 + M r^2 m^2 + (r m)^3), and O(M m^3)
    more where K^rho has a diagonal; its memory is a few arrays of block_size x m,
    M x m x m and r m x r m, not of n rows. With Q terms there are Q m features, and r
    is the sum of their ranks: O(n Q^2 m^2 + M r^2 m^2 + (r m)^3), and M x Q m x Q m.
    A trend is integrated out: the bound is on the restricted likelihood, and its p
    coefficients take O(n p m + p M m^2) more and p x M x m, with p columns of n rows.

    The rows are passed over twice. The first pass sums the Gram matrices of whitened
    features, and not those of k^x(Z, x), which would square the condition number of
    K_ZZ. The second sums the squared residuals, from which the quadratic form is
    computed: the digits that the Gram matrices lose enter it in second order. A QR
    decomposition of the features instead takes several times as long and gave no more
    digits.

    Without noise the trace term costs digits: k^x(x, x) - |phi|^2 has an error of some
    eps k^x(x, x), eps = 2e-16, and the jitter of K_ZZ adds m / 15 times that, in each
    row, multiplied by K^rho_mm / sigma^2. With m = 120, all inputs in Z and a prior
    variance of 1 the value is below exact inference by 2e-7 nats a row at a noise
    variance of 1e-8, and by 2e-5 at 1e-10; the gradient, relative to its largest
    element, is off by 3e-6 and 1e-4. Where the model fits the data the value is never
    above exact inference by more than eps K^rho_mm k^x / sigma^2 a row, which the
    jitter is for; where it does not, -2 log p takes the place of the rows. The mean of
    the posterior is refined by its residuals and keeps 10 digits. Inducing inputs so
    close that K_ZZ needs more jitter cost digits of the gradient by the kernel's theta:
    some per cent at worst, while greedily chosen ones keep 4.
    """

    def __init__(self, prior, X, tasks, y, Z, block_size=BLOCK):
        super().__init__(prior, X, tasks, y)
        self.Z, self.block_size = np.asarray(Z, dtype=float), block_size
        self.targets, self.basis = y, None
        if prior.trend is not None:
            self._set_trend(prior.trend)
        if self.Z.shape[1:] != X.shape[1:] or not len(self.Z):
            raise ValueError(
                f"Z has shape {self.Z.shape}; it needs at least one row and the "
                f"{X.shape[1]} features of X."
            )

    def _set_trend(self, trend):
        """Put the trend's columns beside the targets, if they are not all zero."""
        tasks = np.asarray(self.tasks)
        H = trend.own_rows(self.X, tasks)
        basis = Columns.of_rows(trend, H, tasks)
        if basis.rank:
            self.targets, self.basis = np.column_stack([self.y, H]), basis

    @property
    def inputs(self):
        """Between what the covariances are: the inducing inputs."""
        return self.Z

    def _evaluate(self, theta):
        """The bound; NotPositiveDefiniteError where a factorisation fails."""
        with limit_threads(self.side):
            features, weights = self.forward(theta)
            sums = self.residuals(features, weights)
        return weights.log_density(sums.squares)

    def _evaluate_with_grad(self, theta):
        """The same with the gradient by theta."""
        with limit_threads(self.side):
            return self._pull_back(theta, inputs=False)[:2]

    def value_and_grads(self, theta):
        """The bound and its gradients by theta and by the inducing inputs.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        value : float
            The bound.
        gradient : ndarray of shape (n_theta,)
            Its gradient by theta.
        d_Z : ndarray of shape (n_inducing, n_features)
            Its gradient by Z.
        """
        try:
            with limit_threads(self.side):
                return self._pull_back(theta, inputs=True)
        except NotPositiveDefiniteError:
            failed = np.full(len(theta), np.nan), np.full_like(self.Z, np.nan)
            return -np.inf, *failed

    def _pull_back(self, theta, *, inputs):
        """The bound and its gradients, that by Z only if it is asked for."""
        features, gradients, back = self._backward(theta, inputs=inputs)
        d_kernel, K_bar = features.contract(gradients.omega_bars())
        latents, d_level, d_noise = gradients.by_parameters(back)
        d_rho = self.prior.pull_back_latents(theta, latents)
        d_noise = d_noise if self.prior.n_noise > 1 else d_noise.sum(keepdims=True)
        gradient = self.prior.gradient(
            theta, back.theta + d_kernel, d_rho, d_level, d_noise
        )
        d_Z = back.Z + features.contract_inputs(K_bar) if inputs else None
        return gradients.weights.log_density(back.squares), gradient, d_Z

    def task_gradient(self, theta):
        """Derivative of the value with respect to K^rho.

        It takes O(M r m^3), and loses eps n / sigma^4, unlike the gradient by theta.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        D : ndarray of shape ([n_terms,] n_tasks, n_tasks)
            Symmetric.
        """
        with limit_threads(self.side):
            _, gradients, back = self._backward(theta)
            D = gradients.task_gradients(back)
        return D if len(D) > 1 else D[0]

    def posterior(self, theta):
        """The posterior of f given the inducing variables.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        posterior : SparsePosterior
            Where K_ZZ is singular in floating point, a JitterWarning says what was
            added to it.
        """
        return SparsePosterior(self, theta)

    def with_inducing(self, Z):
        """The same model and data with other inducing inputs."""
        other = copy(self)
        other.Z = Z
        return other

    def release(self):
        """Give back memory: none is kept between evaluations."""

    def forward(self, theta, summed=None, jitter=0.0):
        """The features and the posterior of their weights, by the first pass.

        `summed` has the sums over some of the rows, at this theta, and the others;
        `jitter` is added to the noise variance.
        """
        if not np.isfinite(theta).all():
            raise NotPositiveDefiniteError("theta is not finite")
        prior, values = self.prior, self.prior.values(theta)
        features = Features(prior.kernels_with(values.kernel), self.Z)
        sums, rows = summed or (None, None)
        n_columns = () if self.basis is None else (1 + self.basis.rank,)
        options = {"rows": rows, "n_columns": n_columns}
        more = self.over_rows(sum_features, features, prior.n_tasks, **options)
        sums = more if sums is None else sums + more
        noise = np.broadcast_to(values.noise, prior.n_tasks) + jitter
        loadings = Loadings(prior.latents(theta), len(self.Z))
        return features, Weights(sums, loadings, noise, values.level)

    def residuals(self, features, weights):
        """The second pass without the gradient."""
        means = weights.omega, weights.levels
        return self.over_rows(sum_residuals, features, *means, turn=weights.turn)

    def _backward(self, theta, *, inputs=False):
        """The features, what the gradient is made of, and the second pass."""
        features, weights = self.forward(theta)
        gradients = Gradients(weights)
        adjoint = gradients.adjoint()
        if len(self.y) > len(adjoint.C) * len(features):
            adjoint = adjoint.pulled_back(features.pull_back)
        options = {"turn": weights.turn, "inputs": inputs}
        back = self.over_rows(sum_gradients, features, adjoint, **options)
        return features, gradients, back

    def over_rows(self, function, *arguments, rows=None, turn=None, **options):
        """``function(*arguments, blocks, **options)`` of rows, wherever they are.

        The functions are those of :mod:`skmtgp.inference.sums`, whose results add up.
        With a trend targets are columns, which `turn` makes others of.
        """
        columns = self.basis if turn is None else self.basis.turned(turn)
        of_part = partial(sum_blocks, function, options, self.block_size, columns)
        parts = self.X, self.tasks, self.targets
        parts = parts if rows is None else [part[rows] for part in parts]
        return sum_parts(of_part, arguments, parts)

    def blocks(self):
        """X, tasks and targets of some rows at a time."""
        return blocks(self.X, self.tasks, self.targets, self.block_size)

    def forget_rows(self):
        """Keep what does not depend on them: no likelihood can be computed any more."""
        self.X = self.tasks = self.y = self.targets = None


def check_latent(form):
    """Raise a ValueError where the latent functions of a form are not known.

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank or another, or Forms
        Form of K^rho, perhaps inside of others; those of several terms.
    """
    for of_term in terms_of(form):
        _check_latent(of_term)


def _check_latent(inner):
    while hasattr(inner, "form"):
        inner = inner.form
    missing = [name for name in LATENT if not hasattr(inner, name)]
    if missing:
        raise ValueError(
            "inference='sparse' needs the latent functions of the task covariance, "
            f"but {type(inner).__name__} has no {' and no '.join(missing)}. Give the "
            "class these methods, or set inference='dense', or 'kronecker' for "
            f"complete data. {INFERENCE}"
        )
