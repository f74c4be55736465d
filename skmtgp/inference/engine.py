"""Protocol of the engines, the methods of inference.

An engine says which data and priors it takes and how much memory they need. It makes
the likelihood, whose method ``posterior`` makes the posterior, and it lets tasks join.
The estimators' parameter `inference` takes an instance of any subclass.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from skmtgp._support.guide import INFERENCE


@dataclass(frozen=True)
class Demand:
    """Sizes of a fit, from which an engine computes the memory it needs.

    Attributes
    ----------
    n_samples, n_tasks, n_outputs : int
        Sizes of the data.
    rank : int
        Number of latent functions that the tasks share.
    n_kept : int
        Number of posteriors that are kept.
    n_climbs, n_exact_climbs : int
        Number of simultaneous likelihoods: those of all data and, if an approximation
        begins with some of the rows, the exact ones of these rows.
    n_parameters : int
        Number of parameters of the tasks.
    alone : bool
        Whether the rows are those of a single task.
    n_missing : int
        Number of cells without a row, in data that are otherwise complete.
    n_coefficients : int
        Coefficients of a trend.
    """

    n_samples: int
    n_tasks: int = 1
    n_outputs: int = 1
    rank: int = 1
    n_kept: int = 1
    n_climbs: int = 1
    n_exact_climbs: int = 1
    n_parameters: int = 0
    alone: bool = False
    n_missing: int = 0
    n_coefficients: int = 0


class Engine(ABC):
    """A method of inference.

    Attributes
    ----------
    name : str
        Name for `inference_`.
    sorts : bool, default=True
        Whether the engine takes rows sorted by task. Otherwise they keep their order.
    uses_design : bool, default=False
        Whether it makes use of complete data, with some cells missing.
    n_exact : int or None, default=None
        For an approximation, the number of rows that are learned from exactly first.
    drops : bool, default=False
        Whether its posteriors can tell which rows are least informative, so that they
        can be dropped.
    takes_terms : bool, default=False
        Whether it takes priors of several terms.
    takes_trend : bool, default=False
        Whether it takes priors with a trend.
    takes_known : bool, default=False
        Whether it takes data with known noise, `Data.known`.

    Examples
    --------
    Dense inference that counts its likelihoods:

    >>> import numpy as np
    >>> from skmtgp import PooledGP
    >>> from skmtgp.inference.engines import Dense
    >>> class Counting(Dense):
    ...     name = "counting"
    ...     n_made = 0
    ...     def likelihood(self, prior, data):
    ...         Counting.n_made += 1
    ...         return super().likelihood(prior, data)
    >>> X = np.column_stack([np.linspace(0, 6, 20), np.tile([0, 1], 10)])
    >>> model = PooledGP(inference=Counting()).fit(X, np.sin(X[:, 0]))
    >>> model.inference_, Counting.n_made > 0
    ('counting', True)
    """

    name = "own"
    sorts = True
    uses_design = False
    n_exact = None
    drops = False
    takes_terms = False
    takes_trend = False
    takes_known = False

    @property
    def exact(self):
        """Whether the engine is exact."""
        return self.n_exact is None

    def n_told(self, n):
        """Return how many of n rows determine which parameters can be learned.

        These are the rows with exact inference, with which learning begins.
        """
        return n if self.exact else min(n, self.n_exact)

    def check(self, prior, data, tasks):  # noqa: B027
        """Raise a ValueError if the engine cannot take the prior or the data.

        Parameters
        ----------
        prior : Prior
            The model.
        data : Data
            Observations.
        tasks : ndarray of shape (n_tasks,)
            Labels of the tasks, for error messages.
        """

    def check_form(self, form):  # noqa: B027
        """Raise a ValueError if the engine cannot take a form of K^rho.

        Parameters
        ----------
        form : FixedTaskCovariance, LowRank or another, or Forms
            Form of K^rho, or the forms of several terms.
        """

    def check_memory(self, demand, tiles):  # noqa: B027
        """Raise an InsufficientMemoryError if memory is too small.

        Parameters
        ----------
        demand : Demand
            Sizes of the fit.
        tiles : TileMemory
            Memory that the kernel takes.
        """

    def check_joining(self, demand, tiles, n_before, n_new):
        """Raise an InsufficientMemoryError if memory is too small for a new task.

        Parameters
        ----------
        demand, tiles
            As in `check_memory`, for all tasks.
        n_before, n_new : int
            Number of rows of the likelihood's matrices before, and of the new task.
        """
        self.check_memory(demand, tiles)

    @abstractmethod
    def likelihood(self, prior, data):
        """Return the likelihood of the data.

        Parameters
        ----------
        prior : Prior
            The model.
        data : Data
            Observations.

        Returns
        -------
        likelihood : Likelihood
        """

    def joined(self, likelihood, prior, data, position, kernel):
        """Return the likelihood with one more task, of the same engine if possible.

        Parameters
        ----------
        likelihood : Likelihood
            Likelihood of the known tasks, made by this engine.
        prior : Prior
            Model with one more task.
        data : Data
            All observations.
        position : int
            Position of the new task among all tasks.
        kernel : Kernel or Kernels
            The learned k^x.

        Returns
        -------
        likelihood : Likelihood
        """
        return self.likelihood(prior, data)

    def extends(self, likelihood, codes):
        """Return whether rows can join a likelihood without asking for another engine.

        Parameters
        ----------
        likelihood : Likelihood
            Likelihood of the rows so far, made by this engine.
        codes : ndarray of shape (n_new,)
            Tasks of the new rows.

        Returns
        -------
        extends : bool
        """
        return not self.uses_design

    def lacks_cells(self, likelihood, n_samples, n_tasks):
        """Return whether data are surely too incomplete to look for their design.

        Parameters
        ----------
        likelihood : Likelihood
            Likelihood of fewer rows or tasks, made by this engine.
        n_samples, n_tasks : int
            Numbers of the rows and tasks now.

        Returns
        -------
        lacks_cells : bool
        """
        return False

    def grown(self, likelihood, data):
        """Return the likelihood of other rows at the same prior.

        Parameters
        ----------
        likelihood : Likelihood
            Likelihood of the rows so far.
        data : Data
            All observations.

        Returns
        -------
        likelihood : Likelihood
        """
        data = data if self.exact else replace(data, Z=likelihood.inputs)
        return self.likelihood(likelihood.prior, data)

    def updated(self, posterior, likelihood, theta, origin):
        """Return the posterior of a likelihood that shares rows with another one.

        Parameters
        ----------
        posterior : Posterior
            Posterior of the other likelihood, made by this engine at the same
            parameters, except for those of tasks that have joined.
        likelihood : Likelihood
            Likelihood of all rows, made by this engine.
        theta : ndarray of shape (n_theta,)
            Parameters.
        origin : ndarray of shape (n_samples,)
            For each row its position in the other likelihood; -1 for new rows.

        Returns
        -------
        posterior : Posterior
            Posterior of the likelihood, computed from the other one if that is faster.
        """
        return likelihood.posterior(theta)

    def side(self, data):
        """Rows of the largest matrices that learning decomposes."""
        return max(len(data), data.n_tasks)


def refuse_own_noise(name, prior, data):
    """Raise a ValueError where k^x is not a function of the inputs alone."""
    if not prior.depends_on_inputs_only(data.X):
        raise ValueError(
            f"inference={name!r} needs a kernel of the inputs alone, but "
            f"kernel={prior.kernel} has noise of its own for each sample, such as a "
            "WhiteKernel. Leave it to noise_variance, or set inference='auto'. "
            f"{INFERENCE}"
        )


def check_terms(engine, prior):
    """Raise a ValueError where an engine cannot take several terms K^rho x k^x."""
    if prior.n_terms > 1 and not engine.takes_terms:
        raise ValueError(
            f"inference={engine.name!r} takes one term K^rho x k^x, but kernel is a "
            f"list of {prior.n_terms} kernels. Set inference='dense' or 'auto', which "
            "are exact, or 'sparse' where rows are too many; or give one kernel, such "
            f"as their sum. {INFERENCE}"
        )


def check_trend(engine, prior):
    """Raise a ValueError where an engine cannot take a trend."""
    if prior.trend is not None and not engine.takes_trend:
        why = {
            "kronecker": "K without what the trend explains is no Kronecker product",
        }.get(engine.name, "this engine knows nothing of trends")
        raise ValueError(
            f"inference={engine.name!r} takes no trend, and trend has "
            f"{prior.n_coefficients} coefficients: {why}. Set inference='dense' "
            "or 'auto', which are exact, or 'sparse' where rows are too many; or leave "
            f"the trend out. {INFERENCE}"
        )


def check_known(engine, prior, known, X):
    """Raise a ValueError where an engine cannot take what is known of the noise.

    Neither can k^x with noise of its own take rows that stand for several measurements:
    each of these would have another one.
    """
    if known is None:
        return
    if known.counts.max() > 1.0 and not prior.depends_on_inputs_only(X):
        raise ValueError(
            f"sample_weight counts repeats, but kernel={prior.kernel} has noise of its "
            "own for each sample, such as a WhiteKernel. Means do not determine that "
            "noise. Leave it to noise_variance, or give all rows."
        )
    if not engine.takes_known:
        why = {
            "kronecker": "with noise that differs between inputs K is no Kronecker "
            "product",
            "sparse": "its sums over the rows take one noise variance for each task",
        }.get(engine.name, "this engine knows nothing of it")
        weights = "no sample_weight" if engine.uses_design else "only whole weights"
        raise ValueError(
            f"inference={engine.name!r} takes no alpha, and {weights}: {why}. "
            f"Set inference='dense' or 'auto', or leave them out. {INFERENCE}"
        )


def check_kept(engine, likelihood, data):
    """Raise a ValueError where a user's engine forgets what is known of the noise."""
    if data.known is not None and likelihood.known is None:
        raise ValueError(
            f"inference={engine.name!r} makes a likelihood without `data.known`, what "
            "alpha and sample_weight tell. Hand it on, or set `takes_known = False` of "
            "the engine."
        )
