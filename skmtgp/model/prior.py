r"""The prior of the targets of one output, and its parameters theta.

.. math::
    \mathrm{cov}(y_i, y_j) = v\,\delta_{m_i m_j}
    + \sum_q K^{\rho_q}_{m_i m_j} k_q(x_i, x_j) + \sigma^2_{m_i} \delta_{ij}

is eq. 6 of the paper, with a level of variance v for each task m if asked for, and with
a sum of terms, usually one. A trend, if there is one, is added to the targets, and its
coefficients are integrated out. Theta is one vector: theta of k^x and the parameters of
K^rho, each term by term, log v, and the logarithms of the noise variances. Only this
module knows what is where in it.
"""

from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

from skmtgp._numerics.linalg import symmetric_inverse
from skmtgp.model._nodes import compile_kernel, is_foreign
from skmtgp.model.kernel_check import depends_on_inputs_only
from skmtgp.model.several import Forms, Kernels, factor_shape_of, terms_of
from skmtgp.model.trend import Trend

# Of k^x, in some milliseconds for some tens of parts
MADE = "node", "_last_kernel", "kernel_theta", "_kernel_bounds"
MOST_LEVEL = 1e6  # variance, relative to the targets': levels are nearly all there is


class Values(NamedTuple):
    """What theta stands for.

    Attributes
    ----------
    kernel : ndarray of shape (n_dims,)
        Theta of k^x.
    rho : ndarray of shape (n_parameters,)
        Parameters of K^rho.
    level : float
        Variance of the tasks' levels; 0 without levels.
    noise : ndarray of shape (n_noise,)
        Noise variances.
    """

    kernel: np.ndarray
    rho: np.ndarray
    level: float
    noise: np.ndarray


class InUnits(NamedTuple):
    """Hyperparameters in the units of y.

    Attributes
    ----------
    kernel : Kernel or Kernels
        k^x.
    task_covariance : ndarray of shape ([n_terms,] n_tasks, n_tasks)
        K^rho.
    task_factor : ndarray of shape (n_tasks, rank), or a list of them
        Its factor, without the diagonal.
    level_variance, noise_variance : ndarray of shape (1,) or (n_tasks,)
        Of all tasks, or of each where their units differ.
    """

    kernel: Kernel | Kernels
    task_covariance: np.ndarray
    task_factor: np.ndarray | list
    level_variance: np.ndarray
    noise_variance: np.ndarray


@dataclass(frozen=True)
class Prior:
    """Levels, terms K^rho x k^x, and noise.

    Parameters
    ----------
    kernel : Kernel or Kernels
        k^x with its starting values and bounds; those of several terms.
    task_covariance : FixedTaskCovariance, LowRank or another, or Forms
        Form of K^rho; those of several terms.
    n_noise : int, default=1
        1 if the tasks share a noise variance, n_tasks if they have one each.
    levels : bool, default=False
        Whether each task has its own level.
    scale : float, default=1.0
        Root mean square of the targets, to which starts and bounds are relative.
    within : float, default=inf
        Deviation of the targets about the means of their tasks, if these have levels.
    log_noise : float, default=log(0.01)
        Logarithm of the starting value of the noise variance.
    log_noise_bounds : pair of floats
        Logarithms of the bounds of the noise variance.
    noise_is_fixed : bool, default=False
        Whether the noise variance is not learned.
    log_level : float, default=log(0.1)
        Logarithm of the starting value of the levels' variance.
    least_level : float, default=1e-12
        Lower bound of the levels' variance, relative to the targets' variance.
    trend : Trend, default=None
        Trend that is added to the targets. Its coefficients have a flat prior and are
        not part of theta.
    """

    kernel: Kernel | Kernels
    task_covariance: object
    n_noise: int = 1
    levels: bool = False
    scale: float = 1.0
    within: float = np.inf
    log_noise: float = float(np.log(1e-2))
    log_noise_bounds: tuple = field(default=tuple(np.log([1e-10, 1e3])))
    noise_is_fixed: bool = False
    log_level: float = float(np.log(0.1))
    least_level: float = 1e-12
    trend: Trend | None = None

    def __str__(self):
        return str(self.task_covariance) + (", with levels" if self.levels else "")

    def __getstate__(self):  # what is cached is quickly made again
        return {of.name: getattr(self, of.name) for of in fields(self)}

    @property
    def _kernels(self):
        """What was made of k^x, which priors of the same k^x have, too."""
        return {name: vars(self)[name] for name in MADE if name in vars(self)}

    @cached_property
    def node(self):
        """The fast form of k^x."""
        return compile_kernel(self.kernel)

    @cached_property
    def kernel_theta(self):
        """Where theta of k^x starts."""
        return self.kernel.theta

    @cached_property
    def _kernel_bounds(self):
        """Its bounds, of shape (n_dims, 2)."""
        return self.kernel.bounds.reshape(-1, 2)

    def kernels_with(self, theta):
        """Of each term k^x, its fast form, and its part of theta of k^x."""
        if self.n_terms == 1:
            return [(self.kernel, self.node, theta)]
        parts = self.kernel, self.node.parts, self.kernel.split(theta)
        return list(zip(*parts, strict=True))

    @property
    def kernels(self):
        """k^x of each term."""
        return terms_of(self.kernel)

    @property
    def n_terms(self):
        """Number of terms K^rho x k^x."""
        return len(self.kernels)

    def depends_on_inputs_only(self, features):
        """Whether k^x is a function of the inputs.

        A WhiteKernel is not: it tells samples of different tasks at one input apart.
        """
        return all(depends_on_inputs_only(kernel, features) for kernel in self.kernels)

    @property
    def n_tasks(self):
        """Number of tasks M."""
        return self.task_covariance.n_tasks

    @cached_property
    def _sizes(self):
        """Of the parts of theta, in their order; scikit-learn takes time for n_dims."""
        n_rho = self.task_covariance.n_parameters
        return self.node.n_dims, n_rho, int(self.levels), self.n_noise

    @cached_property
    def _slices(self):
        """Where the parts of theta are, in their order."""
        ends = np.cumsum(self._sizes).tolist()
        return [slice(*ends_of) for ends_of in pairwise([0, *ends])]

    @property
    def n_theta(self):
        """Length of theta."""
        return sum(self._sizes)

    @property
    def n_hyperparameters(self):
        """Number of hyperparameters as eq. 8 counts them."""
        learned = 0 if self.noise_is_fixed else self.n_noise
        free = self._sizes[0] + self.task_covariance.n_free
        return free + int(self.levels) + learned

    # theta and its parts

    def _split(self, theta):
        return [theta[part] for part in self._slices]

    def values(self, theta):
        """What theta stands for.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        values : Values
            Its parts, variances not as logarithms.
        """
        kernel, rho, log_level, log_noise = self._split(theta)
        level = float(np.exp(log_level[0])) if self.levels else 0.0
        return Values(kernel, rho, level, np.exp(log_noise))

    def kernel_at(self, theta):
        """k^x at theta; the same object for the same theta, one after another."""
        theta = self._split(theta)[0]
        key, kernel = vars(self).get("_last_kernel", (None, None))
        if key != theta.tobytes():
            kernel = self.kernel.clone_with_theta(theta)
            vars(self)["_last_kernel"] = theta.tobytes(), kernel
        return kernel

    def _own_kernel_at(self, theta):
        """A copy of k^x at theta, which the user may change."""
        kernel = self.kernel_at(theta)
        if self.n_terms > 1 or is_foreign(self.node):
            return deepcopy(kernel)
        return _copied(kernel)

    def keep_kernel(self, theta, kernel):
        """Take note of k^x at theta, which is there already."""
        vars(self)["_last_kernel"] = self._split(theta)[0].tobytes(), kernel

    def K_rho_at(self, theta):
        """K^rho at theta, of shape ([n_terms,] n_tasks, n_tasks)."""
        return self.task_covariance.matrix(self._split(theta)[1])

    def terms_at(self, theta):
        """A list of (k^x, K^rho) of each term at theta."""
        kernels = terms_of(self.kernel_at(theta))
        K_rhos = self.K_rho_at(theta).reshape(-1, self.n_tasks, self.n_tasks)
        return list(zip(kernels, K_rhos, strict=True))

    def derivatives(self, theta, X, parts):
        """Of k^x of each term the values and the derivatives by its theta.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        parts : Parts
            Of them.

        Returns
        -------
        of_terms : list of (ndarray, ndarray)
            See `Node.derivatives`.
        """
        found = []
        of_terms = self.kernels_with(self._split(theta)[0])
        for k, (_, node, of_kernel) in enumerate(of_terms):
            fast = node.derivatives(of_kernel, X, parts)
            if fast is None:
                K_x, dK_x = terms_of(self.kernel_at(theta))[k](X, eval_gradient=True)
                fast = parts.stacked(K_x), parts.stacked(np.moveaxis(dK_x, 2, 0))
            found.append(fast)
        return found

    def covariance(self, theta, X, tasks):
        """Of f at X, (n_samples, n_samples), with the task of each row."""
        values, rows, K = self.values(theta), slice(0, len(X)), 0.0
        K_rhos = self.K_rho_at(theta).reshape(-1, self.n_tasks, self.n_tasks)
        of_kernels = self.kernels_with(values.kernel)
        for (_, node, of_kernel), K_rho in zip(of_kernels, K_rhos, strict=True):
            between = K_rho.take(tasks, axis=1).take(tasks, axis=0)
            K = K + between * node.bind(of_kernel, X).block(rows, rows)[0]
        return K + values.level * np.equal.outer(tasks, tasks)

    def precision(self, K, X, tasks):
        """K^{-1} of some rows, or of what is left of them without their trend.

        Parameters
        ----------
        K : ndarray of shape (n_samples, n_samples)
            Covariance of the targets.
        X : ndarray of shape (n_samples, n_features)
            Inputs.
        tasks : ndarray of shape (n_samples,)
            Tasks.

        Returns
        -------
        precision : ndarray of shape (n_samples, n_samples)
        """
        inverse = symmetric_inverse(K)
        if self.trend is None:
            return inverse
        Q = self.trend.basis(X, tasks).Q
        told = inverse @ Q
        return inverse - told @ np.linalg.solve(Q.T @ told, told.T)

    @property
    def n_coefficients(self):
        """How many coefficients of a trend are integrated out."""
        return 0 if self.trend is None else self.trend.n_coefficients

    @property
    def tells_unseen(self):
        """Whether the trend, if there is one, is known of tasks without data."""
        return self.trend is None or not self.trend.per_task

    def log_level_at(self, theta):
        """Logarithm of the levels' variance at theta, None without levels."""
        return float(self._split(theta)[2][0]) if self.levels else None

    def log_noise_at(self, theta):
        """Logarithms of the noise variances at theta, of shape (n_noise,)."""
        return self._split(theta)[3]

    def shared_loading(self, theta):
        """What each task has of a function that all share alike; None without one."""
        form = self.task_covariance
        if not form.shared:
            return None
        return form.latent(self._split(theta)[1])[0][0, 0]

    def latent(self, theta):
        """F and kappa at theta, of the latent functions of the tasks."""
        return self.task_covariance.latent(self._split(theta)[1])

    def latents(self, theta):
        """The same of each term, a list."""
        of_terms = zip(self.terms, self.theta_of_terms(theta), strict=True)
        return [form.latent(rho) for (_, form), (_, rho) in of_terms]

    def pull_back_latents(self, theta, gradients):
        """Gradient of the parameters of K^rho, from those of F and kappa.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.
        gradients : list of (ndarray, ndarray)
            Of each term by F and kappa.

        Returns
        -------
        d_rho : ndarray of shape (n_parameters,)
            Of all terms.
        """
        of_terms = zip(self.terms, self.theta_of_terms(theta), gradients, strict=True)
        return np.concatenate(
            [form.pull_back_latent(rho, *of) for (_, form), (_, rho), of in of_terms]
        )

    def unseen(self, theta, described=None):
        """Tasks without data at theta, see `WithShared.unseen`; None if unknown."""
        return self.task_covariance.unseen(self._split(theta)[1], described)

    def theta(
        self,
        *,
        kernel=None,
        K_rho=None,
        log_level=None,
        log_noise=None,
        truncation="eigen",
    ):
        """All parameters: starting values, but for what is given.

        Parameters
        ----------
        kernel : ndarray of shape (n_dims,), default=None
            Theta of k^x.
        K_rho : ndarray of shape ([n_terms,] n_tasks, n_tasks), default=None
            A matrix near which K^rho starts, of several terms their sum or one each.
            None is the identity.
        log_level : float, default=None
            Logarithm of the levels' variance, if there are levels.
        log_noise : float or ndarray of shape (n_noise,), default=None
            Logarithms of noise variances.
        truncation : {"eigen", "cholesky"}, default="eigen"
            How K_rho gets the rank of the model.

        Returns
        -------
        theta : ndarray of shape (n_theta,)
        """
        rho = self.task_covariance.parameters(
            np.eye(self.n_tasks) if K_rho is None else K_rho, truncation
        )
        level = [self.log_level if log_level is None else log_level] * self.levels
        noise = self.log_noise if log_noise is None else log_noise
        kernel = self.kernel_theta if kernel is None else kernel
        return np.concatenate([kernel, rho, level, np.full(self.n_noise, noise)])

    def centre(self, log_variance):
        """Starting values with a given logarithm of all variances in K^rho.

        Parameters
        ----------
        log_variance : float
            That of a function that all share, and of a diagonal.

        Returns
        -------
        theta : ndarray of shape (n_theta,)
            Its factor is zero.
        """
        theta, part = self.theta(), self._slices[1]
        theta[part] = log_variance
        theta[self.of_factor] = 0.0
        return theta

    def with_rho(self, theta, rho):
        """Theta of this prior from one that differs in K^rho alone, whose are given."""
        n_kernel, _, n_level, n_noise = self._sizes
        tail = theta[len(theta) - n_level - n_noise :]
        return np.concatenate([theta[:n_kernel], rho, tail])

    def widened(self, theta, other):
        """Theta of this prior from that of a lower rank: new columns of F are zero.

        Where only the other one has a function that all tasks share, it is a column.
        The tasks have no descriptors then.
        """
        form, rho = other.task_covariance, theta[other._slices[1]]
        of_factor = other.of_factor[other._slices[1]]
        F, rest = rho[of_factor].reshape(other.factor_shape), rho[~of_factor]
        if len(rest) > self._sizes[1] - self.of_factor.sum():  # before a diagonal
            F, rest = form.latent(rho)[0], rest[1:]
        wide = np.zeros(self.factor_shape)
        wide[:, : F.shape[1]] = F
        return self.with_rho(theta, np.append(wide, rest))

    def gradient(self, theta, d_kernel, d_rho, d_level, d_noise):
        """The gradient by theta, from those by what it stands for.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.
        d_kernel : ndarray of shape (n_dims,)
            By theta of k^x.
        d_rho : ndarray of shape ([n_terms,] n_tasks, n_tasks) or (n_parameters,)
            By the symmetric matrix K^rho, or by its parameters.
        d_level : float
            By the levels' variance.
        d_noise : ndarray of shape (n_noise,)
            By the noise variances.

        Returns
        -------
        gradient : ndarray of shape (n_theta,)
        """
        values = self.values(theta)
        if np.ndim(d_rho) > 1:
            d_rho = self.task_covariance.pull_back(values.rho, d_rho)
        d_level = [values.level * d_level] * self.levels
        return np.concatenate([d_kernel, d_rho, d_level, values.noise * d_noise])

    # bounds, and what is held while learning

    def levels_vanish(self, theta):
        """Whether there are levels, with a variance below that of the noise."""
        values = self.values(theta)
        vanish = self.without_levels is not None
        return vanish and bool(values.level <= values.noise.min())

    def with_least_levels(self, theta):
        """Theta with levels as small as can be, from that of the prior without."""
        return np.insert(theta, len(theta) - self.n_noise, self.log_level_bounds[0])

    def with_usual_levels(self, theta):
        """Theta whose levels, if there are any, are no smaller than they begin."""
        theta, levels = theta.copy(), slice(-1 - self.n_noise, -self.n_noise)
        if self.levels:
            theta[levels] = np.maximum(theta[levels], self.log_level)
        return theta

    def less_levels(self, theta):
        """Theta of the prior without levels."""
        return np.delete(theta, len(theta) - self.n_noise - 1)

    @property
    def without_levels(self):
        """The same without levels, if these may vanish; else None."""
        vanish = self.levels and self.least_level < 1.0
        return replace(self, levels=False) if vanish else None

    @property
    def log_level_bounds(self):
        """Logarithms of the bounds of the levels' variance."""
        return np.log(np.multiply([self.least_level, MOST_LEVEL], self.scale**2))

    def bounds(self):
        """Lower and upper bounds of theta, of shape (2, n_theta)."""
        level = self.log_level_bounds
        parts = [
            self._kernel_bounds,
            self.task_covariance.bounds(self.scale),
            np.tile(level, (int(self.levels), 1)),
            np.tile(self.log_noise_bounds, (self.n_noise, 1)),
        ]
        return np.concatenate(parts).T

    @cached_property
    def of_kernel(self):
        """Which elements of theta are those of k^x; a mask."""
        return np.arange(self.n_theta) < self._sizes[0]

    @cached_property
    def n_length_scales(self):
        """Of how many length-scales of k^x each element is one; 0 if it is none."""
        counts = np.zeros(self.n_theta, dtype=int)
        found = [
            np.full(
                part.n_elements, part.n_elements * part.name.endswith("length_scale")
            )
            for kernel in self.kernels
            for part in kernel.hyperparameters
            if not part.fixed
        ]
        counts[self.of_kernel] = np.concatenate(found) if found else 0
        return counts

    @property
    def of_length_scales(self):
        """Which are logarithms of length-scales of k^x; a mask."""
        return self.n_length_scales > 0

    @property
    def factor_shape(self):
        """Shape of the factor of K^rho in theta."""
        return factor_shape_of(self.task_covariance)

    @property
    def factor_unit(self):
        """Frobenius norm of a factor whose tasks have a variance of 1 on average."""
        return getattr(self.task_covariance, "unit", np.sqrt(self.n_tasks))

    @cached_property
    def of_factor(self):
        """Which are elements of a factor of K^rho, row by row; a mask."""
        return np.any(self.of_factors, axis=0)

    @cached_property
    def of_factors(self):
        """The same of each term, (n_terms, n_theta)."""
        masks, begin = [], self._sizes[0]
        position = np.arange(self.n_theta)
        for form in terms_of(self.task_covariance):
            end = begin + int(np.prod(factor_shape_of(form)))
            masks.append((position >= begin) & (position < end))
            begin += form.n_parameters
        return np.array(masks)

    @cached_property
    def of_noise(self):
        """Which are logarithms of noise variances; a mask."""
        return np.arange(self.n_theta) >= self.n_theta - self.n_noise

    @cached_property
    def unexplained(self):
        """Which are variances of what is unexplained, kappa and the noise; a mask."""
        mask, end = self.of_noise.copy(), self._sizes[0]
        for form in terms_of(self.task_covariance):
            end += form.n_parameters
            mask[end - form.n_kappa : end] = True
        return mask

    # other models

    def with_form(self, task_covariance):
        """The same but for the form of K^rho."""
        return replace(self, task_covariance=task_covariance)

    def with_terms(self, terms):
        """The same with other terms.

        Parameters
        ----------
        terms : sequence of (Kernel, form)
            k^x and the form of K^rho of each.

        Returns
        -------
        prior : Prior
            One of a single term is what it was without any list.
        """
        kernels, forms = zip(*terms, strict=True)
        if len(terms) > 1:
            return replace(self, kernel=Kernels(kernels), task_covariance=Forms(forms))
        return replace(self, kernel=kernels[0], task_covariance=forms[0])

    def with_trend(self, trend):
        """The same with another trend."""
        if trend is self.trend:
            return self
        prior = replace(self, trend=trend)
        vars(prior).update(self._kernels)
        return prior

    def with_node(self, node):
        """The same with another fast form of k^x."""
        prior = replace(self)
        vars(prior)["node"] = node
        return prior

    @property
    def terms(self):
        """The kernel and the form of K^rho of each term."""
        pair = self.kernel, self.task_covariance
        return list(zip(*map(terms_of, pair), strict=True))

    def theta_of_terms(self, theta):
        """Theta of k^x and the parameters of K^rho of each term, from all parameters.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Parameters.

        Returns
        -------
        of_terms : list of (ndarray, ndarray)
        """
        kernel, rho = self._split(theta)[:2]
        if self.n_terms == 1:
            return [(kernel, rho)]
        of_terms = self.kernel.split(kernel), self.task_covariance.split(rho)
        return list(zip(*of_terms, strict=True))

    def with_theta_of_terms(self, theta, of_terms):
        """Theta of this prior from one that has the same levels and noise.

        Parameters
        ----------
        theta : ndarray
            Of a prior of perhaps other terms.
        of_terms : list of (ndarray, ndarray)
            Theta of k^x and the parameters of K^rho of each term of this one.

        Returns
        -------
        theta : ndarray of shape (n_theta,)
        """
        tail = theta[len(theta) - int(self.levels) - self.n_noise :]
        kernels, rhos = zip(*of_terms, strict=True)
        return np.concatenate([*kernels, *rhos, tail])

    def bordered(self, theta, row, own, position, log_noise=None):
        """The prior of one more task and its theta, section 3.3.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Of the tasks so far.
        row, own
            See :meth:`LowRank.bordered`; lists of those of each term.
        position : int
            Where the task goes among the others.
        log_noise : float, default=None
            Logarithm of the noise variance of the task. None: all tasks have one.

        Returns
        -------
        prior : Prior
            Of one more task.
        theta : ndarray of shape (prior.n_theta,)
            Its parameters.
        """
        *_, level, log_noises = self._split(theta)
        terms, of_terms = [], []
        for (k, form), (kernel, rho), *of in zip(
            self.terms, self.theta_of_terms(theta), row, own, strict=True
        ):
            form, rho = form.bordered(rho, *of, position)
            terms.append((k, form))
            of_terms.append((kernel, rho))
        if log_noise is not None:
            log_noises = np.insert(log_noises, position, log_noise)
        prior = replace(self, n_noise=len(log_noises)).with_terms(terms)
        vars(prior).update(self._kernels)
        tail = np.concatenate([level, log_noises])
        return prior, prior.with_theta_of_terms(tail, of_terms)

    def with_row(self, theta, row, own, position):
        """Theta with another row of a task; the arguments are those of `bordered`."""
        of_terms = [
            (kernel, form.with_row(rho, *of, position))
            for (_, form), (kernel, rho), *of in zip(
                self.terms, self.theta_of_terms(theta), row, own, strict=True
            )
        ]
        return self.with_theta_of_terms(theta, of_terms)

    def with_own_noise(self, theta):
        """The prior with a noise variance for each task, and its theta: all the same.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            With shared noise.

        Returns
        -------
        prior : Prior
            With a noise variance for each task.
        theta : ndarray of shape (prior.n_theta,)
            Of the same covariance.
        """
        *parts, log_noise = self._split(theta)
        prior = replace(self, n_noise=self.n_tasks)
        return prior, np.concatenate([*parts, np.full(self.n_tasks, log_noise)])

    # the way to the units of y

    def in_units(self, theta, scale):
        """The hyperparameters in units of y.

        Parameters
        ----------
        theta : ndarray of shape (n_theta,)
            Those of targets that were divided by `scale`.
        scale : ndarray of shape (1,) or (n_tasks,)
            Of all tasks, or of each.

        Returns
        -------
        in_units : InUnits
        """
        _, rho, level, noise = self.values(theta)
        form, square = self.task_covariance, np.square(scale)
        factor, column = form.factor(rho), scale[:, None]
        several = isinstance(factor, list)
        return InUnits(
            self._own_kernel_at(theta),
            form.matrix(rho) * np.multiply.outer(scale, scale),
            [of * column for of in factor] if several else factor * column,
            level * square,
            noise * square,
        )


def _copied(kernel):
    """A deep copy of a kernel of known kinds, in a fraction of the time."""
    found = object.__new__(type(kernel))  # copy() asks how to make one, each time
    vars(found).update({name: _copied_value(of) for name, of in vars(kernel).items()})
    return found


def _copied_value(value):
    """A deep copy of what a kernel of known kinds is made of."""
    if isinstance(value, (float, int, str)):
        return value
    if isinstance(value, Kernel):
        return _copied(value)
    if type(value) in (list, tuple):
        return type(value)(map(_copied_value, value))
    if type(value) is np.ndarray and value.dtype != object:
        return value.copy()
    return deepcopy(value)
