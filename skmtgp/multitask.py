"""The multi-task Gaussian process of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from numbers import Integral
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.gaussian_process.kernels import Kernel
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_new_task, check_test
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._estimators.named_kernels import KERNEL
from skmtgp._estimators.slopes import TrendOf
from skmtgp._estimators.targets import TargetTransform
from skmtgp._estimators.terms import LISTS, terms_asked_for
from skmtgp._support.progress import say
from skmtgp._support.sklearn_compat import Interval, StrOptions
from skmtgp.inference.engine import Engine
from skmtgp.learning.growing import learn_forms
from skmtgp.learning.novel import join_described, learn_novel
from skmtgp.learning.paper import learn_simultaneously, learn_staged
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.screening import criterion
from skmtgp.learning.terms import learn_terms
from skmtgp.model.described import describes, task_covariance
from skmtgp.model.several import Forms, terms_of
from skmtgp.model.task_covariance import low_rank

Diagonal = Literal["equal"] | bool
ROWS = 4  # for each number of the task covariance, of a rank that nobody asked for
FEW = 8  # rows of a task on average: fewer may tell no more than what all share


class MultiTaskGPRegressor(BaseMultiTaskGP):
    r"""Multi-task Gaussian process regression with a learned task covariance.

    The tasks are related functions of the same inputs; one column of X says which task
    a row belongs to. For each output alone,

    .. math::
        \mathrm{cov}(f^m(x), f^{m'}(x'))
        = v\, \delta_{mm'} + K^\rho_{mm'}\, k^x(x, x'), \qquad
        t^m(x) \sim \mathcal N(f^m(x), \sigma_m^2)

    with levels of the tasks of variance v, a positive semi-definite task covariance
    :math:`K^\rho` of the given rank, a kernel :math:`k^x` over the inputs and noise
    variances, all of them learned by maximising the marginal likelihood. Any task may
    be observed at any inputs.

    Parameters
    ----------
    kernel : Kernel, str or None, or list of them, default=None
        :math:`k^x` over the columns of X without the task column: any kernel of
        :mod:`sklearn.gaussian_process.kernels` or :mod:`skmtgp.kernels`. Its values are
        where learning starts, its bounds are kept. Or the name of one, which gets a
        length-scale for each feature, started and bounded relative to the feature's
        standard deviation: "rbf", the squared exponential, which None is too,
        "exponential", "matern" and "matern52" (Matern's of nu = 1/2, 3/2 and 5/2),
        "periodic" or "linear". The task covariance is its amplitude. A list has the
        kernel of each of several terms, see Notes.
    rank : int or list of int or None, default=None
        Rank of the task covariance, 0 to the number of tasks, with `task_descriptors`
        to one more than there are of them if that is less. None is full rank, or
        the highest that leaves four rows for each number of the task covariance, of the
        `n_exact` rows where inference is sparse. Where tasks have fewer than eight of
        those on average, BIC chooses between that rank, one function that all tasks
        share (rank 0) and, if inference is exact, compound symmetry, see `diagonal`;
        `rank_` and `diagonal_` tell. Rank 0 needs ``shared=True``, one function of all
        tasks and, with `task_levels`, a level of each, for many tasks of a handful of
        rows; or ``diagonal="equal"``. With a list of kernels a list has the rank of
        each term; None is then never left to BIC.
    shared : bool or list of bool, default=False
        Whether all tasks share one function alike, and differ from it by functions of
        the given rank: :math:`K^\rho = a 1 1^T + L L^T`. A task that `fit` has not
        seen is then predicted by what all share. Of several terms a list has one value
        for each.
    diagonal : bool or "equal", or list of them, default=False
        Whether to add a learned diagonal to the task covariance: variation that a task
        shares with no other, with a variance of its own or, "equal", one that is the
        same for all. ``rank=0, diagonal="equal"`` has independent tasks, and with
        ``shared=True`` too it is compound symmetry: any two tasks are equally alike.
        Of several terms a list has one value for each.
    task_levels : bool, default=True
        Whether each task has a level: a constant that is added to its function, drawn
        from N(0, v). The variance v is learned. Levels are integrated out exactly.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    task_descriptors : sequence of int or str, default=None
        Positions or names of columns of X with numbers that describe the tasks, and are
        constant within each: a machine's age, the mass of a robot's load. They are no
        inputs of :math:`k^x`, but :math:`K^\rho = D B B^\top D^\top` with a row
        [1, descriptors] of D for each task, and B of the given rank learned in its
        place. A task that `fit` has not seen is then predicted from its descriptors.
        See :doc:`/guide/descriptors`.
    trend : {"constant", "linear"}, sequence of int or str, or transformer, default=None
        A trend that is added to the functions of the tasks, of columns of X that stay
        inputs of :math:`k^x`: their positions or names; or a transformer of
        scikit-learn, such as PolynomialFeatures, which is cloned and makes the columns
        of X without that of the task; "linear" is a constant and all columns, and
        "constant" a constant alone. The coefficients have a flat prior and are
        integrated out, exactly: universal kriging. Inference is dense, or sparse where
        that is asked for. See :doc:`/guide/trend`.
    trend_per_task : bool, default=False
        Whether each task has coefficients of its own. Tasks share them otherwise.
    noise : {"auto", "shared", "per_task"}, default="auto"
        Whether the tasks share one noise variance or have one each. "auto" asks the
        data, see Notes.
    noise_variance : float, default=1e-2
        Where learning starts, relative to the variance of the target, of each task if
        they have units of their own.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the same. "fixed" with
        ``noise_variance=0`` leaves all noise to the `alpha` of `fit`.
    normalize_y : {"auto", "per_task", "shared"} or bool, default="auto"
        Units in which the targets are learned. "shared", or True, takes an output off
        the mean of all its targets and divides it by their standard deviation, with
        `task_levels` by that around the means of the tasks. "per_task" takes each task
        off its own mean and divides it by its own deviation; one of one or two rows, or
        of equal targets, by the geometric mean of the others' deviations. "auto" asks
        the data, see Notes. With False the model's mean is zero.
    target_transform : transformer or pair of functions, default=None
        Is applied to the targets before anything else, to each output by itself: a
        transformer of scikit-learn with an inverse, which is cloned, or a function and
        its inverse, such as ``(np.log, np.exp)``. It has to be strictly monotone.
        Predictions, intervals and draws are in units of y; likelihoods and learned
        attributes are those of the transformed targets. See :doc:`/guide/intervals`.
    inference : {"auto", "dense", "kronecker", "sparse"} or Engine, default="auto"
        How the likelihood is computed. "dense" decomposes the covariance of all
        samples. "kronecker" decomposes those of the inputs and of the tasks, and needs
        complete data: every task observed at the same inputs, once each, with less than
        half of these cells missing. "auto" is "kronecker" where at most a tenth are,
        "dense" elsewhere; both are exact.
        "sparse" approximates, for data too large for them: a lower bound on the
        likelihood by inducing inputs takes its place.
        An instance of a subclass of :class:`~skmtgp.inference.engine.Engine` is a
        method of your own.
    n_inducing : int, default=500
        Number of inducing inputs, only for "sparse": more are closer to exact, and
        take time with their square or, many of them, their cube.
    inducing_inputs : {"greedy", "k-means", "optimised"}, default="greedy"
        Which they are, only for "sparse". "greedy" takes training inputs, each the one
        with the largest variance given those before. "k-means" takes the means of
        clusters of the standardised training inputs. "optimised" moves those of
        "greedy" to where the bound is higher, which takes longer and needs a kernel
        whose derivative by its inputs is known. From more than 20,000 rows the first
        choice is among as many of them, drawn at random.
    n_exact : int, default=1100
        Number of samples, drawn at random, that are learned from exactly before the
        bound is, only for "sparse". Without noise it is from them that most is learned
        of the kernel: more take time with the cube of their number, and memory with
        its square. Ranks for which they are less than four for each number of the task
        covariance are learned from all rows alone, from the mode of a lower rank.
    learning : {"annealed", "staged", "simultaneous"}, default="annealed"
        How the mode is searched for. "annealed" finds the best ones; "staged" is the
        heuristic of the paper's section 3 to the letter; "simultaneous" learns all
        parameters at once from a random task covariance, which the paper argues
        against.
    truncation : {"eigen", "cholesky"}, default="eigen"
        How the first estimate of the task covariance gets its rank, section 3.2: by its
        leading eigenvectors, or by an incomplete Cholesky decomposition.
    n_restarts_optimizer : int, default=0
        Number of additional starts. The first truncates a fit of full rank, the others
        are random; with "simultaneous" all are.
    hyperparameters : {"mode", "map", "sampled", "auto"}, default="mode"
        What predictions take for the hyperparameters. "mode" is the maximum of the
        likelihood. "map" is the maximum of the likelihood times weak priors, which are
        relative to the sizes of the data. "sampled" averages over draws from that
        posterior, by Hamiltonian Monte Carlo: its intervals hold where few rows leave
        the hyperparameters in doubt, and it takes some ten times as long. "auto" is
        "sampled" up to 500 rows, if they are at most 16 for each hyperparameter, and
        else "mode". The attributes are those of the mode all the same, but for the
        levels of the tasks. With `max_iter` 0 nothing is drawn.
    n_draws : int, default=100
        How many draws predictions average over, if there are any. Each takes as much
        memory as a fitted model. Ten times as many are drawn.
    max_iter : int, default=2000
        Most iterations of each maximisation; 0 keeps the starting values.
    tol : float, default=1e-2
        Gain in the log likelihood, in nats, under which a maximisation ends. For
        "sparse", climbs of the bound end under 1e-4 nats a row, but at most 10 nats,
        where this is more.
    n_jobs : int, default=None
        Number of outputs learned at the same time, see :term:`n_jobs`.
    random_state : int, RandomState instance or None, default=None
        Source of the random starts. Not used if `n_restarts_optimizer` is 0, unless
        `learning` is "simultaneous".
    verbose : int, default=0
        1 prints a line for each output and stage of learning and, where one takes
        long, every few seconds how far it is; 2 more of them during each climb.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        :math:`k^x` as learned; of several terms a list in its place.
    task_covariance_ : ndarray of shape ([n_outputs,] [n_terms,] n_tasks, n_tasks)
        :math:`K^\rho` as learned, in squared units of y: those of either task where
        they have units of their own.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j, with several terms
        ``task_correlation_.loc[q]`` that of term q.
    task_descriptors_ : DataFrame of n_tasks rows
        The descriptors of each task. Only with `task_descriptors`.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Its lower trapezoidal factor: ``L @ L.T``, without the diagonal and without the
        function that all share. Of several terms a list of theirs, of other ranks.
    level_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Variance of the levels around `y_mean_`, in squared units of y; 0 without
        `task_levels`. One for each task where they have units of their own.
    task_level_, task_level_std_ : ndarray of shape ([n_outputs,] n_tasks)
        Level of each task given the data, in units of y with `y_mean_` included, and
        its standard deviation. Without `task_levels` they are `y_mean_` and 0.
    coef_, coef_std_ : ndarray of shape ([n_outputs,] [n_tasks,] n_trend)
        Coefficients of the trend given the data, in units of y for one of their column,
        and their standard deviations. This and the next two only with `trend`.
    trend_names_ : ndarray of shape (n_trend,)
        Names of the trend's columns.
    trend_mean_ : ndarray of shape ([n_tasks,] n_trend)
        What the columns are taken off, as the targets are off `y_mean_`.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y. One for each task where they have noise
        or units of their own.
    y_mean_, y_scale_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        What was taken off the targets, and what they were divided by. One for each task
        where they have units of their own. 0 and 1 without `normalize_y`.
    normalize_y_ : {"per_task", "shared"} or False
        The units that were used, chosen if `normalize_y` is "auto".
    noise_ : {"shared", "per_task"}
        The noise that was used, chosen if `noise` is "auto".
    log_marginal_likelihood_value_ : float
        Log density of y in its own units (a lower bound of it where inference is
        sparse), summed over the outputs. With `trend` it is that of what the trend
        leaves of y: models of other trends do not compare.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters as eq. 8 counts them, summed over the outputs: those
        of the kernel, r (2 M + 1 - r) / 2 of the task covariance (with p descriptors
        p + 1 takes the place of M), 1 of a function that all share, M of a diagonal, 1
        of all levels, and the noise. The scale of the task covariance and an amplitude
        of the kernel count both, as in the paper.
        Means and deviations that `normalize_y` takes do not count, nor do coefficients
        of a trend.
    theta_ : ndarray of shape (n_theta,)
        All parameters as learned, for each output: the kernel's theta, of several terms
        one after another, then, term by term, the factor of
        the task covariance row by row, the logarithm of the variance a of the function
        that all share, logarithms of the diagonal, the logarithm of the levels'
        variance, logarithms of the noise variances, each if the model has it. All are
        of the scaled output. It is scaled by `y_scale_`; without `normalize_y` by its
        root mean square, with `task_levels` by the deviation around the means of the
        tasks. The factor is a rotation of `task_factor_`: ``L @ Q``, with the same
        ``L @ L.T``. With `task_descriptors` it is that of their coefficients, in
        units in which they are independent.
    rank_ : int, or list of int
        Rank of the task covariance, a function that all share not counted; of several
        terms that of each.
    diagonal_ : bool or "equal", or list of them
        Which diagonal the task covariance has; of several terms that of each.
    hyperparameters_ : {"mode", "map", "sampled"}
        What predictions take for the hyperparameters.
    theta_samples_ : ndarray of shape (n_draws, n_theta)
        Draws of `theta_`. This and the next three only if hyperparameters are sampled.
    effective_sample_size_ : float
        Of how many independent draws all that were drawn, ten for each that is kept,
        are worth, of the hyperparameter for which that is least.
    r_hat_ : float
        How far the chains disagree about the hyperparameter for which that is most; 1
        is not at all.
    n_divergences_ : int
        Trajectories that left the region where the posterior can be computed.
    n_iter_ : int
        Iterations on the way to the mode, of the output with most of them.
    n_evaluations_ : int
        Likelihoods with their gradients that learning took, those of modes that were
        not kept counted, summed over the outputs. In a RankSearchIC what the ranks
        share counts for each of them. What "auto" asks a small model does not count.
    complete_ : bool
        Whether every task was observed at the same inputs, once each.
    inference_ : str
        How the likelihood is computed: "dense", "kronecker", "sparse", or the name of
        an engine of your own.
    inducing_inputs_ : ndarray of shape (n_inducing, n_features - 1)
        The inducing inputs; a list of n_outputs of them where y has two dimensions.
        Fewer than `n_inducing` where more would add nothing. Only if inference is
        sparse.
    X_train_ : ndarray of shape (n_samples, n_features - 1)
        Training inputs without the task column, nor the descriptors. Not there, nor are
        the next two and `complete_`, if X was a Dask collection.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of each training sample's task.
    y_train_ : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Training targets, transformed by `target_transform` if there is one.
    target_transformer_ : transformer or list of n_outputs transformers
        The fitted transformers of the outputs. Only with `target_transform`.
    n_features_in_ : int
        Number of columns of X, the task column counted.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Their names, if X has any.

    See Also
    --------
    RankSearchIC : Chooses the rank by an information criterion.
    IndependentGP : Tasks that share the kernel only.
    PooledGP : Tasks that are one and the same function.
    SingleTaskGP : Each task alone.

    Notes
    -----
    The model is eq. 6 of [1]_, the rank-constrained model of its section 3, with levels
    and units of the tasks. ``task_levels=False, normalize_y="shared", noise="shared"``
    is the paper's. It is learned in stages as there, with additions that
    :mod:`skmtgp.learning` describes. In units of y and for tasks t, t' of the samples,
    ``y - y_mean_[t]`` is normal with mean zero and covariance
    ``level_variance_ * (t == t') + task_covariance_[t, t'] * kernel_(X, X')``, plus
    ``noise_variance_`` for a sample with itself. Where one of these has a number for
    each task, it is that of t. With a trend of columns H it is ``y - y_mean_[t] -
    (H - trend_mean_) @ coef_`` that is normal, with coefficients of any size. Time
    grows with the cube of the number of samples, memory with its square.

    With a list of kernels the covariance has a term for each,
    :math:`\sum_q K^{\rho_q}_{mm'}\, k_q(x, x')`: the linear model of coregionalisation,
    with ranks 1 the semiparametric latent factor model. `predict_terms` takes
    predictions apart. Inference is then "dense" or, where asked for, "sparse", and
    hyperparameters are those of the mode. A list of one kernel is that kernel. See
    :doc:`/guide/terms`.

    What "auto" means for `normalize_y` and `noise`, the data say before learning. A
    small model is asked: tasks that have nothing in common but :math:`k^x`, with an
    amplitude and a level each, learned from a few hundred rows. Its likelihoods of y,
    in shared units and in those of each task, with shared noise and with noise of each
    task, are compared after half the logarithm of the number of rows was taken off for
    each parameter; for one that a task has, of the number of its own rows. Units
    are shared without asking if the deviations of the tasks' targets differ by no more
    than chance. Noise of each task is only tried if it promises to gain; where exact
    inference has learned with shared noise, it is asked once more of what was learned.
    With `max_iter` 0 both are shared, and noise that is "fixed" is.

    With complete data of N inputs and M tasks they grow with :math:`N^3` and
    :math:`N^2` instead of :math:`(NM)^3` and :math:`(NM)^2`, by Kronecker algebra,
    which pays from two tasks on, also with up to a tenth of the cells missing. It stays
    when `add_task` makes the data incomplete.
    A kernel with a WhiteKernel, whose noise is each sample's own, is left to "dense".

    Results do not depend on `n_jobs`, to the bit below 600 samples. From there on the
    processes share the threads of linear algebra, and other numbers of threads round
    differently: results then are the same to about the digits that `tol` asks for, or
    to the bit if there is one thread only (``OMP_NUM_THREADS=1``).

    References
    ----------
    .. [1] K. M. A. Chai, C. K. I. Williams, S. Klanke and S. Vijayakumar, "Multi-task
       Gaussian Process Learning of Robot Inverse Dynamics", NIPS 21, 2008.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import MultiTaskGPRegressor
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 60), np.repeat([0, 1, 2], 20)
    >>> y = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
    >>> model = MultiTaskGPRegressor(rank=2).fit(np.column_stack([x, task]), y)
    >>> model.predict([[1.5, 0], [1.5, 1]]).round(3)
    array([ 0.997, -1.995])
    """

    _parameter_constraints = {
        **BaseMultiTaskGP._parameter_constraints,
        "kernel": [*KERNEL, *LISTS],
        "rank": [Interval(Integral, 0, None, closed="left"), *LISTS, None],
        "shared": ["boolean", *LISTS],
        "diagonal": ["boolean", StrOptions({"equal"}), *LISTS],
        "task_levels": ["boolean"],
        "task_descriptors": ["array-like", None],
        "trend_per_task": ["boolean"],
        "learning": [StrOptions({"annealed", "staged", "simultaneous"})],
        "truncation": [StrOptions({"eigen", "cholesky"})],
        "n_restarts_optimizer": [Interval(Integral, 0, None, closed="left")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        kernel: Kernel | str | Sequence[Kernel | str | None] | None = None,
        *,
        rank: int | Sequence[int | None] | None = None,
        shared: bool | Sequence[bool] = False,
        diagonal: Diagonal | Sequence[Diagonal] = False,
        task_levels: bool = True,
        task_feature: int | str = -1,
        task_descriptors: Sequence[int | str] | None = None,
        trend: TrendOf = None,
        trend_per_task: bool = False,
        noise: Literal["auto", "shared", "per_task"] = "auto",
        noise_variance: float = 1e-2,
        noise_variance_bounds: ArrayLike | Literal["fixed"] = (1e-10, 1e3),
        normalize_y: Literal["auto", "per_task", "shared"] | bool = "auto",
        target_transform: TargetTransform = None,
        inference: Literal["auto", "dense", "kronecker", "sparse"] | Engine = "auto",
        n_inducing: int = 500,
        inducing_inputs: Literal["greedy", "k-means", "optimised"] = "greedy",
        n_exact: int = 1100,
        learning: Literal["annealed", "staged", "simultaneous"] = "annealed",
        truncation: Literal["eigen", "cholesky"] = "eigen",
        n_restarts_optimizer: int = 0,
        hyperparameters: Literal["mode", "map", "sampled", "auto"] = "mode",
        n_draws: int = 100,
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
        random_state: np.random.RandomState | int | None = None,
        verbose: int = 0,
    ) -> None:
        self.kernel = kernel
        self.rank = rank
        self.shared = shared
        self.diagonal = diagonal
        self.task_levels = task_levels
        self.task_feature = task_feature
        self.task_descriptors = task_descriptors
        self.trend = trend
        self.trend_per_task = trend_per_task
        self.noise = noise
        self.noise_variance = noise_variance
        self.noise_variance_bounds = noise_variance_bounds
        self.normalize_y = normalize_y
        self.target_transform = target_transform
        self.inference = inference
        self.n_inducing = n_inducing
        self.inducing_inputs = inducing_inputs
        self.n_exact = n_exact
        self.learning = learning
        self.truncation = truncation
        self.n_restarts_optimizer = n_restarts_optimizer
        self.hyperparameters = hyperparameters
        self.n_draws = n_draws
        self.max_iter = max_iter
        self.tol = tol
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose

    def _learn(self, problems, progress):
        for term in self._terms():
            self._check_rank(term, problems[0].data)
        forms = self._forms(problems[0])
        modes = self._learn_ranks(problems, forms, progress)
        of_forms = [[of.with_form(form) for of in problems] for form in forms]
        found = zip(of_forms, modes, strict=True)
        best = max(found, key=lambda of: sum(map(criterion, *of)))
        if self.verbose and len(forms) > 1:
            say(f"chosen by BIC: {best[0][0].prior.task_covariance}")
        return best

    def _check_rank(self, term, data):
        """Raise an error where the rank of a term cannot be."""
        rank, most, what = term.rank, data.n_tasks, "the number of tasks"
        if self._describes() and len(self.task_descriptors) < most:
            most, what = len(self.task_descriptors) + 1, "1 + the number of descriptors"
        if isinstance(rank, (bool, np.bool_)):
            raise TypeError(f"rank={rank!r} must be an int or None, not a bool.")
        if rank is not None and rank > most:
            raise ValueError(f"rank={rank} is above {what}, {most}.")
        if rank == 0 and not (term.shared or isinstance(term.diagonal, str)):
            raise ValueError(
                "rank=0 leaves tasks nothing in common: set shared=True, for one "
                "function of all of them, diagonal='equal', for an independent one of "
                "each, or rank=1 or more."
            )

    def _forms(self, problem):
        """Forms of K^rho to choose from, by eq. 8; one unless tasks have few rows."""
        data, n = problem.data, problem.engine.n_told(len(problem.data))
        terms, ranks = self._terms(), self._ranks(data.n_told, n)
        of_terms = [
            _form(term, data, min(rank, data.n_told))
            for term, rank in zip(terms, ranks, strict=True)
        ]
        if len(terms) > 1:
            return [Forms(of_terms)]
        [term] = terms
        if term.rank is not None or n >= FEW * data.n_told or self.max_iter == 0:
            return of_terms
        forms = [_form(term, data, 0), *of_terms]
        if term.diagonal or not problem.engine.exact:  # to which diagonals take long
            return forms
        simplest = {"diagonal": "equal", "shared": True}
        return [task_covariance(data.n_tasks, 0, data.Q, **simplest), *forms]

    def _terms(self):
        """What the user asks for in each term."""
        terms = terms_asked_for(self)
        if len(terms) > 1 and self._describes():
            raise ValueError(
                f"task_descriptors={self.task_descriptors!r} need one kernel, and "
                f"there are {len(terms)}. Give their sum, or no descriptors."
            )
        return terms

    def _kernels(self):
        return [term.kernel for term in self._terms()]

    def _form_for_screening(self, n_tasks):
        form, n_terms = super()._form_for_screening(n_tasks), len(self._terms())
        return Forms([form] * n_terms) if n_terms > 1 else form

    def _ranks(self, n_tasks, n):
        """The rank of each term; of those not given the highest that rows tell."""
        terms = self._terms()
        ranks = range(n_tasks, 1, -1)
        free = {rank: len(terms) * low_rank(n_tasks, rank).n_free for rank in ranks}
        highest = next((rank for rank in ranks if ROWS * free[rank] <= n), 1)
        return [highest if term.rank is None else term.rank for term in terms]

    def _rank(self, n_tasks, n):
        return sum(self._ranks(n_tasks, n))

    def _n_climbs(self, n_ranks):
        starts = 1 if self.learning == "annealed" else 2 + self.n_restarts_optimizer
        return n_ranks * starts

    def _learn_ranks(self, problems, forms, progress, **options):
        """Modes for each form and output."""
        learn = {
            "annealed": learn_ranks,
            "staged": learn_staged,
            "simultaneous": learn_simultaneously,
        }[self.learning]
        n_seeds = self.n_restarts_optimizer + (self.learning == "simultaneous")
        rng = check_random_state(self.random_state)
        seeds = rng.randint(np.iinfo(np.int32).max, size=n_seeds).tolist()
        options |= {"n_jobs": self.n_jobs, "progress": progress}
        learn = partial(learn_forms, learn, seeds=seeds, **options)
        if problems[0].prior.n_terms == 1:
            return learn(problems, forms)
        if self.learning != "annealed":
            raise ValueError(
                f"learning={self.learning!r} is for one kernel, and there are "
                f"{problems[0].prior.n_terms}. Set learning='annealed'."
            )
        running = {"n_jobs": self.n_jobs, "progress": progress}
        return learn_terms(learn, problems, forms, **running)

    def _budget(self):
        return replace(super()._budget(), truncation=self.truncation)

    def predict_terms(self, X: ArrayLike) -> NDArray[np.float64]:
        r"""Predict each term of f by itself, and the level: they sum to `predict`.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.

        Returns
        -------
        y_terms : ndarray of shape (n_samples, [n_outputs,] n_terms + 1)
            Predictive means of the terms :math:`K^\rho_q \times k_q`, in the order of
            `kernel_`, and last of the task's level, with `y_mean_`. With `trend` there
            is one more, that of the trend, before the level. In the units of y; with
            `target_transform` in those of the transformed targets, in which they sum.

        Raises
        ------
        TypeError
            If X is a Dask collection.
        ValueError
            If a task was not seen in fit and cannot be predicted, see `predict`.

        Examples
        --------
        A slow function and a fast one:

        >>> import numpy as np
        >>> from sklearn.gaussian_process.kernels import RBF
        >>> from skmtgp import MultiTaskGPRegressor
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 9, 120), np.tile([0, 1, 2], 40)
        >>> slow = np.array([1.0, -2.0, 0.5])[task] * np.sin(0.5 * x)
        >>> fast = np.array([0.5, 0.4, -0.6])[task] * np.sin(6.0 * x)
        >>> y = slow + fast + 0.05 * rng.standard_normal(120)
        >>> X = np.column_stack([x, task])
        >>> model = MultiTaskGPRegressor([RBF(2.0), RBF(0.2)], rank=1).fit(X, y)
        >>> terms = model.predict_terms(X)
        >>> bool(np.allclose(terms.sum(axis=-1), model.predict(X)))
        True
        >>> bool(np.corrcoef(terms[:, 1], fast)[0, 1] > 0.99)
        True
        """
        check_is_fitted(self)
        features, codes = check_test(self, X, unseen=self._knows_unseen())
        return self._join_terms(self._means_of_terms(features, codes))

    def _join_terms(self, terms):
        """Without the axis of the outputs where y was one-dimensional."""
        return terms[:, 0] if self._single_output else terms

    def add_task(
        self, X: ArrayLike, y: ArrayLike, *, prior: Literal["tasks"] | None = "tasks"
    ) -> Self:
        """The model with one more task, of which a few samples are enough.

        The kernel, the variances of noise and levels, the units and the covariance of
        the tasks so far are kept; only the new border of the task covariance is
        learned, from the marginal likelihood of all samples: as many numbers as the
        rank, and one more if that is full or with `diagonal`. The level of the new
        task follows from its samples and the levels' variance.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs of the new task, with its label in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Its targets.
        prior : {"tasks"} or None, default="tasks"
            "tasks" takes the new task to be drawn from the same population as the
            others, whose rows of the factor give a prior of its row. None is the
            paper's maximum likelihood, which one or two samples do not determine.

        Returns
        -------
        model : MultiTaskGPRegressor
            A new fitted estimator, which knows the new task too. This one stays as it
            is.

        Raises
        ------
        TypeError
            If X or y is a Dask collection.
        ValueError
            If the task is known already, if X has several tasks, other features than in
            `fit` or values that cannot be used, or if y has other outputs.

        Notes
        -----
        Section 3.3 of the paper, but for the prior, and for levels. A task with
        descriptors is known by them: nothing is learned, its rows join those of the
        others; with `diagonal` it gets the mean of the others'. Where the tasks
        have noise variances of their own, the new one gets their geometric mean, each
        counted as often as its task has rows. Where they have units of their own, it is
        taken off the mean of its samples and divided by their deviation, of one or two
        samples by the geometric mean of the others'. `n_iter_` and `n_evaluations_` are
        those of the border.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import MultiTaskGPRegressor
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 6, 60), np.repeat([0, 1, 2], 20)
        >>> y = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
        >>> model = MultiTaskGPRegressor(rank=1, normalize_y=False)
        >>> model.fit(np.column_stack([x, task]), y).tasks_
        array([0, 1, 2])
        >>> extended = model.add_task([[1.5, 3]], 3.0 * np.sin([1.5]))
        >>> extended.predict([[4.5, 3]]).round(2)
        array([-2.93])
        """
        if prior not in ("tasks", None):
            raise ValueError(f"prior={prior!r} must be 'tasks' or None.")
        check_is_fitted(self)
        self._refuse_exact_rows()
        new_task, model = check_new_task(self, X, y), copy(self)
        model._join_task(*new_task, prior=prior)
        return model

    def _border(self, likelihood, data, training, position, informed, trend):
        """What learns the border of a new task, at a posterior and its theta."""
        new, own_noise = data.tasks == position, training.noise == "per_task"
        if describes(likelihood.prior.task_covariance):
            place = position, own_noise
            return partial(join_described, likelihood, data.Q[position], *place)
        return partial(
            learn_novel,
            likelihood,
            X=data.X[new],
            y=data.y[new],
            position=position,
            own=self._has_own(likelihood.prior),
            own_noise=own_noise,
            informed=informed,
            budget=self._budget(),
            trend=trend,
        )

    def _rank_with_task(self):
        return int(np.sum(self.rank_)) + sum(self._full())

    def _has_own(self, prior):
        """For each term whether a joining task has its own part, of any variance."""
        diagonals = [_diagonal_of(form) for _, form in prior.terms]
        return [
            diagonal is True or (not diagonal and full)
            for diagonal, full in zip(diagonals, self._full(), strict=True)
        ]

    def _full(self):
        """For each term whether its task covariance is as general as it can be."""
        ranks = self.rank_ if isinstance(self.rank_, list) else [self.rank_]
        return [
            not self._describes() and term.rank is None and rank == len(self.tasks_)
            for term, rank in zip(self._terms(), ranks, strict=True)
        ]

    def _store_learned(self, training, engine, likelihoods, modes, posteriors=None):
        super()._store_learned(training, engine, likelihoods, modes, posteriors)
        form = likelihoods[0].prior.task_covariance
        self.rank_, diagonals = form.rank, list(map(_diagonal_of, terms_of(form)))
        self.diagonal_ = diagonals if isinstance(form, Forms) else diagonals[0]


def _form(term, data, rank):
    """The form of K^rho of a term."""
    # as the user asked for: what tasks have of their own, of the same variance for all
    alone = term.rank == 0 and isinstance(term.diagonal, str)
    shared = bool(term.shared) or (rank == 0 and not alone)
    options = {"diagonal": term.diagonal, "shared": shared}
    return task_covariance(data.n_tasks, rank, data.Q, **options)


def _diagonal_of(form):
    """Which diagonal a form of K^rho has."""
    return "equal" if getattr(form, "equal", False) else bool(getattr(form, "n_own", 0))
