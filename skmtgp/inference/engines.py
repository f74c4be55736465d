"""The engines, and which of them "auto" takes."""

from dataclasses import replace

import numpy as np

from skmtgp._data.complete import (
    check_complete,
    count_missing,
    few_missing,
    nearly_complete,
)
from skmtgp._numerics.linalg import HALVED
from skmtgp._support.guide import INFERENCE
from skmtgp._support.warnings import warn
from skmtgp.exceptions import IncompleteDataWarning
from skmtgp.inference.apart import ApartLikelihood, are_apart
from skmtgp.inference.dense import IN_SINGLE, DenseLikelihood, DensePosterior
from skmtgp.inference.engine import (
    Engine,
    refuse_own_noise,
)
from skmtgp.inference.extended import ExtendedLikelihood, ExtendedPosterior
from skmtgp.inference.inducing import check_differentiable, greedy_variance
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.memory import (
    check_border_memory,
    check_memory,
    check_sparse_memory,
    of_gaps,
)
from skmtgp.inference.sparse import SparseBound, check_latent
from skmtgp.inference.sparse_posterior import SparsePosterior


class Dense(Engine):
    """Exact inference with any data.

    Parameters
    ----------
    why : str, default=""
        What little keeps the data from a faster engine.
    """

    name = "dense"
    drops = True
    takes_terms = takes_trend = takes_known = True

    def __init__(self, why=""):
        self.why = why

    def check_memory(self, demand, tiles):
        """Raise an InsufficientMemoryError where memory does not suffice.

        Warns of data that are all but complete, and many.
        """
        n = demand.n_samples
        needed = 1.5 if n in HALVED or n in IN_SINGLE else 1.0
        check_memory(demand, tiles, n, rows="samples", n_matrices=needed, why=self.why)
        if self.why and n > MANY:
            warn(
                f"{self.why} As it is, inference is dense, of {n} samples. {INFERENCE}",
                IncompleteDataWarning,
            )

    def check_joining(self, demand, tiles, n_before, n_new):
        """The same where a task joins."""
        Dense().check_memory(demand, tiles)

    def likelihood(self, prior, data):
        """The likelihood of the data."""
        of_tasks = are_apart(prior, data.tasks)
        kind = ApartLikelihood if of_tasks else DenseLikelihood
        return kind(prior, data.X, data.tasks, data.y, data.known)

    def updated(self, posterior, likelihood, theta, origin):
        """The posterior by a factor that is updated, in O(n^2) a row."""
        return DensePosterior(likelihood, theta, (posterior, origin))


class Kronecker(Engine):
    """Exact inference with complete data, of which some cells may be missing.

    Tasks that join need not be observed at the same inputs.
    """

    name = "kronecker"
    uses_design = True

    def check(self, prior, data, tasks):
        """Raise a ValueError where the covariance is no Kronecker product."""
        if data.design is None:
            check_complete(data.X, data.tasks, tasks)
        refuse_own_noise(self.name, prior, data)

    def check_memory(self, demand, tiles):
        """Raise an InsufficientMemoryError where memory does not suffice."""
        n_cells = demand.n_samples + demand.n_missing
        self._check_rows(demand, tiles, n_cells // demand.n_tasks)

    def check_joining(self, demand, tiles, n_before, n_new):
        """The same where a task joins, whose inputs may be others."""
        self._check_rows(demand, tiles, n_before + n_new)

    def _check_rows(self, demand, tiles, n_rows):
        # K, and two for its eigen-decomposition; that of K^rho
        n_matrices = 3 + of_gaps(demand.n_missing, n_rows)
        rows = {"rows": "inputs of each task", "n_matrices": n_matrices}
        check_memory(demand, tiles, n_rows, **rows, n_of_tasks=1)

    def likelihood(self, prior, data):
        """The likelihood of the data."""
        return KroneckerLikelihood(prior, data.X, data.tasks, data.y, data.design)

    def joined(self, likelihood, prior, data, position, kernel):
        """The likelihood with a task more.

        The novel tasks' rows are eliminated from the covariance of the others, exactly,
        unless it is less to eliminate the cells that they lack.
        """
        novel = [m + (m >= position) for m in likelihood.novel] + [position]
        return self._extended(likelihood, prior, data, novel)

    def _extended(self, likelihood, prior, data, novel):
        """The likelihood of the same complete data and all rows of novel tasks."""
        n_novel = np.isin(data.tasks, novel).sum()
        if data.design is not None and count_missing(data.design) <= n_novel:
            return self.likelihood(prior, data)
        base = getattr(likelihood, "base", likelihood)
        return ExtendedLikelihood(prior, data.X, data.tasks, data.y, novel, base)

    def extends(self, likelihood, codes):
        """Whether rows are of novel tasks, which have no more than there are inputs.

        With more of them S takes longer than a factor of all rows that is updated.
        """
        if not likelihood.novel or not np.isin(codes, likelihood.novel).all():
            return False
        return len(likelihood.new) + len(codes) <= len(likelihood.base.inputs)

    def grown(self, likelihood, data):
        """The likelihood with more rows, which may be of novel tasks alone."""
        prior, novel = likelihood.prior, likelihood.novel
        n_base = len(data) - np.isin(data.tasks, novel).sum()
        if novel and n_base == len(likelihood.base.y):
            if n_base == len(data):  # the rows of all novel tasks have gone
                return likelihood.base
            return self._extended(likelihood, prior, data, novel)
        return self.likelihood(prior, data)

    def lacks_cells(self, likelihood, n_samples, n_tasks):
        """Whether there are more missing cells than novel rows, however these lie."""
        base = getattr(likelihood, "base", likelihood)
        n_missing = len(base.inputs) * n_tasks - n_samples
        return n_missing > n_samples - len(base.y)

    def updated(self, posterior, likelihood, theta, origin):
        """The posterior, with the other rows not decomposed again."""
        before = getattr(posterior, "base", posterior)
        base = getattr(likelihood, "base", likelihood)
        if base.rows is before.rows:
            if base is likelihood:
                return before.with_tasks(base, theta)
            return ExtendedPosterior(likelihood, theta, before)
        return likelihood.posterior(theta)

    def side(self, data):
        """Rows of the largest matrices that learning decomposes."""
        return max(data.n_inputs, data.n_tasks)


class Sparse(Engine):
    """A lower bound on the likelihood, by inducing inputs.

    Parameters
    ----------
    n_inducing : int, default=500
        Inducing inputs.
    inducing_inputs : {"greedy", "k-means", "optimised"}, default="greedy"
        Which they are.
    n_exact : int, default=1100
        Rows that are learned from exactly before.
    """

    name = "sparse"
    sorts = False
    takes_terms = takes_trend = True

    def __init__(self, n_inducing=500, inducing_inputs="greedy", n_exact=1100):
        self.n_inducing, self.inducing_inputs = n_inducing, inducing_inputs
        self.n_exact = n_exact

    def check(self, prior, data, tasks):
        """Raise a ValueError where inducing inputs cannot explain the prior."""
        refuse_own_noise(self.name, prior, data)
        if self.inducing_inputs == "optimised":
            check_differentiable(prior.kernel, np.asarray(data.X[:1]))

    def check_form(self, form):
        """Raise a ValueError where it is not known what functions tasks share."""
        check_latent(form)

    def check_memory(self, demand, tiles):
        """Raise an InsufficientMemoryError where memory does not suffice."""
        check_sparse_memory(demand, tiles, self.n_inducing, self.n_exact)

    def check_joining(self, demand, tiles, n_before, n_new):
        """The same where a task joins, whose inputs may become inducing inputs."""
        check_border_memory(n_new, n_before, demand.rank)
        n_inducing = min(n_before + n_new, 2 * n_before)
        check_sparse_memory(demand, tiles, n_inducing, n_exact=0)

    def likelihood(self, prior, data):
        """The bound for the inducing inputs of the data."""
        return SparseBound(prior, data.X, data.tasks, data.y, data.Z)

    def joined(self, likelihood, prior, data, position, kernel):
        """The bound with a task more.

        The inducing inputs get those of the novel task's that add to them.
        """
        Z = np.vstack([likelihood.Z, data.X[np.flatnonzero(data.tasks == position)]])
        most = min(len(Z), 2 * len(likelihood.Z))
        return self.likelihood(prior, replace(data, Z=greedy_variance(kernel, Z, most)))

    def updated(self, posterior, likelihood, theta, origin):
        """The posterior by sums over the rows, to which those of new ones are added."""
        return SparsePosterior(likelihood, theta, (posterior, origin))

    def side(self, data):
        """Rows of the largest matrices that learning decomposes."""
        n_rows = min(len(data), max(self.n_exact, self.n_inducing))
        return max(n_rows, data.n_tasks)


MANY = 5000  # rows, whose dense inference takes long
ENGINES = {"dense": Dense, "kronecker": Kronecker, "sparse": Sparse}


def choose(inference, prior, data, **options):
    """The engine for these data.

    Parameters
    ----------
    inference : {"auto", "dense", "kronecker", "sparse"} or Engine
        What the user asked for.
    prior : Prior
        The model.
    data : Training
        Features, codes, and the design where most tasks are at the same inputs.
    **options
        Of sparse inference.

    Returns
    -------
    engine : Engine
        "auto" is "kronecker" for complete data of two tasks or more, whose
        eigen-decompositions are then faster than a Cholesky decomposition of all
        samples, also where up to a tenth of the cells are missing, and "dense"
        otherwise. So it is with several terms: a sum of Kronecker products and noise
        has no decompositions of its factors. So it is with a trend, and where something
        is known of the noise of rows.
    """
    if isinstance(inference, Engine):
        return inference
    if inference != "auto":
        engine = ENGINES[inference]
        return engine(**options) if engine is Sparse else engine()
    dense = len(data.tasks) == 1 or prior.n_terms > 1 or prior.trend is not None
    dense = dense or data.known is not None
    if dense or not prior.depends_on_inputs_only(data.features):
        return Dense()
    if few_missing(data.design):
        return Kronecker()
    return Dense(nearly_complete(data.features, data.codes))


def alone(inference, **options):
    """The engine for each of several tasks alone."""
    return choose("dense" if inference == "auto" else inference, None, None, **options)


def of_one_task(inference):
    """The parameter for models of one task: "auto" if the engine needs several."""
    return "auto" if _engine_or_class(inference).uses_design else inference


def _engine_or_class(inference):
    return ENGINES.get(inference, Dense) if isinstance(inference, str) else inference


def repeats_rows(inference):
    """Whether rows are repeated as often as they count, as the engine takes no counts.

    One that needs each input once would refuse them as repeated.
    """
    engine = _engine_or_class(inference)
    return not (engine.takes_known or engine.uses_design)


def leaves_rows(inference):
    """Whether rows stay where they are, in Dask's partitions or in files."""
    return not _engine_or_class(inference).sorts
