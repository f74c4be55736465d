"""A model for each task alone: the paper's sGP."""

from __future__ import annotations

from collections import defaultdict
from functools import reduce
from operator import add
from typing import Literal, Self, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import ConstantKernel, Kernel
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_theta, check_training
from skmtgp._data.data import Data
from skmtgp._data.known import read_known, weighed_rows
from skmtgp._data.labels import name_tasks, rows_by_code
from skmtgp._data.oddities import FEW_ROWS as ALL_FEW
from skmtgp._data.oddities import is_binary, warn_of_binary
from skmtgp._data.skewness import is_skewed
from skmtgp._data.task_column import locate
from skmtgp._data.trend import ReadTrend, read_trend
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._estimators.conformal import ConformalMixin
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.doubts import warn_of_constants_alone, warn_of_duration
from skmtgp._estimators.estimator import Estimator, fitting
from skmtgp._estimators.fitted import COEFFICIENTS
from skmtgp._estimators.named_kernels import with_positions
from skmtgp._estimators.posing import kernel_made, pose
from skmtgp._estimators.reading import gathered, tell_copies, tell_counts
from skmtgp._estimators.sampled import n_posteriors
from skmtgp._estimators.skew import inputs_far_apart, tell_skewed
from skmtgp._estimators.slopes import TrendOf, check_alone
from skmtgp._estimators.targets import TargetTransform, fit_target
from skmtgp._estimators.training import FEW_ROWS, equal_in_tasks
from skmtgp._numerics.parallel import at_a_time, run
from skmtgp._support.progress import part, say
from skmtgp._support.sklearn_compat import fit_context, with_callbacks
from skmtgp._support.warnings import collect_warnings, warn
from skmtgp.baselines import PooledGP
from skmtgp.exceptions import (
    BinaryTargetWarning,
    ConstantTargetWarning,
    LongFitWarning,
    RepeatedRowsWarning,
    SkewedInputWarning,
    TargetScaleWarning,
)
from skmtgp.inference.engine import Demand, Engine
from skmtgp.inference.engines import alone, of_one_task, repeats_rows
from skmtgp.inference.memory import TileMemory
from skmtgp.learning.forecast import FEW, foresee
from skmtgp.model.kernel_check import check_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.task_covariance import ones

# What is said once of all tasks, and not of each.
OF_ALL = (
    BinaryTargetWarning,
    ConstantTargetWarning,
    LongFitWarning,
    RepeatedRowsWarning,
    SkewedInputWarning,
)


class SingleTaskGP(ConformalMixin, Estimator):
    """A separate Gaussian process for each task, sGP.

    Each task and output has its own hyperparameters, learned from its own samples.
    Predictions for different tasks have no covariance.

    Parameters
    ----------
    kernel : Kernel, str or None, default=None
        Kernel over the columns of X without the task column. Its values are starting
        values, and its bounds are kept. A string names a kernel with an amplitude and a
        length-scale for each feature. Starting values and bounds are then relative to
        the feature's standard deviation:

        - "rbf": the squared exponential;
        - "exponential", "matern" and "matern52": Matérn kernels with nu = 1/2, 3/2 and
          5/2;
        - "periodic", whose periods are looked for, and "linear".

        None is "rbf" or, where that is likelier, "linear", "matern52", "matern" or
        "exponential". If there are more than a quarter as many features as rows, and
        that is clearly likelier, all have one length-scale. `kernel_` of a task's model
        in `estimators_` is the one chosen.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels, which are integers or
        strings.
    trend : {"constant", "linear"}, sequence of int or str, or transformer, default=None
        Trend that is added to the function of each task, also called universal kriging:

        - "constant" is a constant alone, for ordinary kriging;
        - "linear" is a constant and all features;
        - a sequence has positions or names of columns of X, such as ``["elevation"]``;
        - a transformer of scikit-learn, such as PolynomialFeatures, makes the trend's
          columns from X without the task column. It is cloned, and fitted to the rows
          of all tasks.

        The columns remain inputs of the kernel. Each task has its own coefficients,
        which have a flat prior and are integrated out exactly. Inference is dense, or
        sparse if you ask for it. See :doc:`/guide/trend`.
    noise_variance : float, default=1e-2
        Starting value of each task's noise variance, relative to the variance of the
        task's target.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the same variance. "fixed" keeps
        `noise_variance`. "fixed" with ``noise_variance=0`` leaves all noise to the
        `alpha` of `fit`. With the default, targets that are rounded mostly have the
        noise of rounding at least, see the user guide.
    normalize_y : {"auto", "per_task", "shared"} or bool, default=True
        Whether to subtract the mean of each output and divide by its standard deviation
        before learning, for each task separately. "auto", "per_task" and "shared" mean
        the same as True. With False the model's mean is zero.
    target_transform : transformer or pair of functions, default=None
        Transformation that is applied to each output before anything else. It is a
        transformer of scikit-learn with an inverse, which is cloned, or a function and
        its inverse, such as ``(np.log, np.exp)``. It must be strictly monotone.
        Predictions, intervals and draws are in units of y. Likelihoods and learned
        attributes are those of the transformed targets. See :doc:`/guide/intervals`.
    inference : {"auto", "dense", "kronecker", "sparse"} or Engine, default="auto"
        How the likelihood is computed:

        - "dense" is a Cholesky decomposition of each task's covariance. It is exact.
        - "kronecker" is an eigen-decomposition. It is exact, too, but takes longer for
          one task alone, and needs distinct inputs.
        - "auto" is "dense".
        - "sparse" approximates, for large tasks. It maximises a lower bound on the
          likelihood from a few inducing inputs.
        - An instance of a subclass of :class:`~skmtgp.inference.engine.Engine` is your
          own method.
    n_inducing : int, default=500
        Number of inducing inputs of each task, only for "sparse".
    inducing_inputs : {"greedy", "k-means", "optimised"}, default="greedy"
        How the inducing inputs are chosen, only for "sparse":

        - "greedy" chooses training inputs one by one. Each is the one with the largest
          variance given those before.
        - "k-means" uses the means of clusters of the standardised training inputs.
        - "optimised" starts from "greedy" and moves the inputs to increase the bound.
          It takes longer, and needs a kernel with a known derivative by its inputs.

        With more than 20,000 rows the first choice is among 20,000 of them, drawn at
        random.
    n_exact : int, default=1100
        Number of samples of each task for the first part of learning, only for
        "sparse". They are drawn at random and learned from exactly, before the bound is
        maximised. Without noise they determine most of the kernel. Time grows with the
        cube of their number, memory with its square.
    hyperparameters : {"mode", "map", "laplace", "sampled", "auto"}, default="mode"
        Which values of the hyperparameters predictions use:

        - "mode" uses the maximum of the likelihood. With few rows for each
          hyperparameter variances are multiplied by a factor, `variance_factor_`, that
          errors of left-out rows suggest, see the user guide, page "Intervals".
        - "map" uses the maximum of the likelihood times weak priors, which are relative
          to the size of the data.
        - "laplace" predicts as "mode", with standard deviations and intervals that
          count what the rows leave open of the hyperparameters (Laplace's method, with
          the same priors). Variances have the factor, too. It takes about as long as
          "mode".
        - "sampled" averages over draws from that posterior, by Hamiltonian Monte Carlo.
          Its intervals are right even where few rows leave the hyperparameters
          uncertain. It takes ten to 300 times as long.
        - "auto" is "sampled" for a task with at most 500 rows and at most 16 rows for
          each hyperparameter, with sparse inference, too. With more rows it is
          "laplace", or "mode" with sparse inference. Rows whose variance is half noise
          count half.

        The attributes are those of the mode in any case, except for the levels of the
        tasks. With ``max_iter=0`` nothing is drawn.
    n_draws : int, default=100
        Number of draws that predictions average over, only if hyperparameters are
        sampled. Five times as many are drawn, and one of five is kept. Each takes as
        much memory as a fitted model.
    max_iter : int, default=2000
        Maximum number of iterations of each maximisation. 0 keeps the starting values.
    tol : float, default=1e-2
        A maximisation ends when the log likelihood gains less than this, in nats. For
        "sparse" the bound's tolerance is at least 1e-4 nats for each row, up to 10
        nats.
    n_jobs : int, default=None
        Number of tasks learned at the same time, see :term:`n_jobs`. The chains of a
        task run one after another if hyperparameters are sampled.
    random_state : int, RandomState instance or None, default=None
        Source of the chains, if hyperparameters are sampled. With None they are the
        same in each fit.
    verbose : int, default=0
        With 1, learning prints a line for each task, and every few seconds how far a
        long maximisation is. With 2 it prints more of these. Lines go to the logger
        "skmtgp"; without handlers they are printed.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    estimators_ : list of n_tasks PooledGP
        Model of each task. It was fitted to the features followed by a constant column.
        If there is a `target_transform`, it was fitted to the targets of all tasks, and
        the models to the transformed targets.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of the task of each training sample.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over tasks and outputs. For sparse
        inference it is a lower bound. With `trend` it is the density of what the trend
        leaves of y, so models with different trends cannot be compared by it.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of all kernels and noises.
    coef_, coef_std_ : ndarray of shape ([n_outputs,] n_tasks, n_trend)
        Coefficients of the trend of each task given the data, and their standard
        deviations, in units of y per unit of the trend's column. These and the next two
        exist only with `trend`.
    trend_names_ : ndarray of shape (n_trend,)
        Names of the trend's columns. Those of an array are x0, x1, ... by their
        position, and a constant is 1.
    trend_mean_ : ndarray of shape (n_tasks, n_trend)
        What is subtracted from the trend's columns, as the mean is from the targets.
    target_transformer_ : transformer or list of n_outputs transformers
        Fitted transformers of the outputs. Only with `target_transform`.
    theta_ : ndarray of shape (n_theta,)
        The `theta_` of each of `estimators_`, one after another.
    n_iter_ : int
        Number of iterations on the way to the mode, for the output with the most.
    n_evaluations_ : int
        Number of evaluations of the likelihood and its gradient during learning, summed
        over tasks and outputs.
    inference_ : str
        How the likelihood is computed: "dense", "kronecker", "sparse", or the name of
        your own engine.
    hyperparameters_ : ndarray of str of shape (n_tasks,)
        Which hyperparameters predictions of each task use: "mode", "map", "laplace" or
        "sampled". "auto" has chosen one of them.
    variance_factor_ : ndarray of shape (n_tasks,) or (n_tasks, n_outputs)
        What variances of each task's predictions are multiplied by, because its
        hyperparameters were learned from few rows; 1 with 20 rows or more for each.
        Deviations of a trend's coefficients have it, too, ``noise_variance_`` has not.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    IndependentGP : Tasks that share their kernel.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "for each context and each
    joint, we train ... a sGP model with the corresponding training data
    separately".

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import SingleTaskGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
    >>> SingleTaskGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([ 0.997, -0.997])
    """

    _parameter_constraints = {
        name: constraint
        for name, constraint in BaseMultiTaskGP._parameter_constraints.items()
        if name != "noise"
    }
    _parameter_hints = BaseMultiTaskGP._parameter_hints

    def __init__(
        self,
        kernel: Kernel | str | None = None,
        *,
        task_feature: int | str = -1,
        trend: TrendOf = None,
        noise_variance: float = 1e-2,
        noise_variance_bounds: ArrayLike | Literal["fixed"] = (1e-10, 1e3),
        normalize_y: Literal["auto", "per_task", "shared"] | bool = True,
        target_transform: TargetTransform = None,
        inference: Literal["auto", "dense", "kronecker", "sparse"] | Engine = "auto",
        n_inducing: int = 500,
        inducing_inputs: Literal["greedy", "k-means", "optimised"] = "greedy",
        n_exact: int = 1100,
        hyperparameters: Literal["mode", "map", "laplace", "sampled", "auto"] = "mode",
        n_draws: int = 100,
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
        random_state: np.random.RandomState | int | None = None,
        verbose: int = 0,
    ) -> None:
        self.kernel = kernel
        self.task_feature = task_feature
        self.trend = trend
        self.noise_variance = noise_variance
        self.noise_variance_bounds = noise_variance_bounds
        self.normalize_y = normalize_y
        self.target_transform = target_transform
        self.inference = inference
        self.n_inducing = n_inducing
        self.inducing_inputs = inducing_inputs
        self.n_exact = n_exact
        self.hyperparameters = hyperparameters
        self.n_draws = n_draws
        self.max_iter = max_iter
        self.tol = tol
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=True)
    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
    ) -> Self:
        """Learn the hyperparameters of each task.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. Outputs are learned separately.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known about the noise of each row, see `fit` of
            :class:`~skmtgp.MultiTaskGPRegressor`.

        Returns
        -------
        self : object
            Fitted estimator.

        Raises
        ------
        TypeError
            If X is sparse, or if a label, a feature or a target has a type that cannot
            be used, such as a label that is a tuple.
        ValueError
            If a parameter, a feature, a label or a target cannot be used, or if the
            kernel is not a valid covariance of the features. The estimator is then as
            it was before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            given = alpha, sample_weight, repeat_variance
            plain = all(part is None for part in given)
            repeats = repeats_rows(self.inference)
            X, y, given = weighed_rows(X, y, given, repeats=repeats)
            features, codes, tasks, Y = check_training(self, X, y)
            known = read_known(*given, Y.reshape(len(Y), -1).shape)
            if known is not None:
                known.refuse_transform(self.target_transform)
            self._fit(features, codes, tasks, Y, known, progress, plain)
        return self

    def _fit(self, features, codes, tasks, Y, known, progress, plain):
        target = fit_target(self.target_transform, Y.reshape(len(Y), -1))
        Y = target.forward(Y.reshape(len(Y), -1)).reshape(Y.shape)
        self.tasks_, self.tasks_train_ = tasks, codes
        _, rows = rows_by_code(codes)
        model = self._of_one_task(self._columns(features, rows))
        X = np.column_stack([features, np.zeros(len(features))])
        self._check_tasks(model, features, rows, Y)
        self._tell_constants(model, rows, Y, known)
        if plain:
            tell_copies(model, features, codes, Y)
        tell_counts(model, known)
        self._foretell(model, rows, features, Y, known)
        names = [self._in_words(m) for m in range(len(rows))]
        results = run(
            _fit_alone,
            [
                (model, X[r], Y[r], known and known.part(r), name)
                for r, name in zip(rows, names, strict=True)
            ],
            n_jobs=self.n_jobs,
            report=progress("learning", len(rows), self._describe),
        )
        self._warn([caught for _, caught in results])
        self._tell_skewed(features, rows, results)
        self._store([estimator for estimator, _ in results])
        self._store_target(target)

    def _columns(self, features, rows):
        """What makes the columns of the trend, told by the rows of each task."""
        if self.trend is None:
            return None
        given = getattr(self, "feature_names_in_", None)
        columns = read_trend(self.trend, features, *locate(self), given)
        for label, r in zip(self.tasks_.tolist(), rows, strict=True):
            check_alone(columns, features[r], label)
        return ReadTrend(columns)

    def _of_one_task(self, trend):
        """The model that each task gets."""
        params = {**self.get_params(deep=False), "task_feature": -1, "n_jobs": None}
        params |= {"noise": "shared", "normalize_y": bool(self.normalize_y)}
        params |= {"target_transform": None, "trend": trend}  # of all tasks
        if isinstance(self.kernel, Kernel):  # its rows have no names of columns
            params["kernel"] = with_positions(clone(self.kernel), self._names)
        model = PooledGP(**params)
        model.n_features_in_ = self.n_features_in_  # it is asked before it is fitted
        return model

    def _names(self):
        """Those of the features; None without names."""
        if not hasattr(self, "feature_names_in_"):
            return None
        return locate(self)[1].tolist()

    def _check_tasks(self, model, features, rows, Y):
        """Whether the engine takes each task, and memory suffices for them."""
        kernel = kernel_made(model, model.kernel, features)
        check_kernel(kernel, features)
        engine = alone(self.inference, **model._options())
        prior = Prior(kernel, ones(1))
        for m, r in enumerate(rows):  # while the tasks have their labels
            task = Data(features[r], np.zeros_like(r), Y[r], 1)
            engine.check(prior, task, self.tasks_[[m]])
        tiles = TileMemory(kernel, features[:1])
        n_coefficients = 0 if model.trend is None else len(model.trend.columns)
        self._check_room(engine, max(map(len, rows)), Y[:1].size, tiles, n_coefficients)

    def _tell_constants(self, model, rows, Y, known):
        """Warn of tasks whose targets do not vary, unless they are few rows.

        Also of outputs with two values, in all tasks.
        """
        Y, counts = Y.reshape(len(Y), -1), np.array(list(map(len, rows)))
        same = equal_in_tasks(Y, self.tasks_train_, counts, known)
        many = (counts > FEW_ROWS)[:, None]
        # as of other models: all of y, where each task has few rows
        many = many | ((len(Y) > ALL_FEW) & (np.ptp(Y, axis=0) == 0.0))
        # without normalize_y one that is not zero has a size, if nothing else
        sized = not self.normalize_y and model._learns_amplitude()
        first = Y[[r[0] for r in rows]]
        warn_of_constants_alone(self.tasks_, many & same & ~(sized & (first != 0.0)))
        warn_of_binary(is_binary(Y))

    def _tell_skewed(self, features, rows, results):
        """Warn of inputs whose logarithms might be better.

        Few rows of one task are skewed by chance, or leave gaps. So the rows of all
        tasks must be skewed, and half of the tasks that were learned must have gaps.
        """
        far, n_asked = np.zeros(features.shape[1]), 0
        for r, (estimator, caught) in zip(rows, results, strict=True):
            ended = ConvergenceWarning not in dict(caught)
            thetas = estimator._thetas() if estimator.n_iter_ and ended else ()
            for of, theta in zip(estimator._likelihoods, thetas, strict=False):
                far[inputs_far_apart(of.prior, theta, features[r])] += 1.0
            n_asked += len(thetas)
        most = np.flatnonzero((far > 0.0) & (far >= 0.5 * n_asked))
        tell_skewed({k for k in most if is_skewed(features[:, k])}, self._names())

    def _foretell(self, model, rows, X, Y, known):
        """Say before it begins that learning all tasks will take minutes."""
        n = max(map(len, rows))
        if n < FEW or not self.max_iter:
            return
        longest = next(r for r in rows if len(r) == n)
        with collect_warnings():  # the fit gives them
            alone = np.zeros_like(longest), np.zeros(1), Y[longest]
            given = () if known is None else (known.part(longest).arguments(),)
            training = decide(model, gathered(model, X[longest], *alone, *given))
            problems = pose(model, training)
        if problems[0].engine.exact:
            of_longest = foresee(problems).seconds
            seconds = of_longest * sum((len(r) / n) ** 3 for r in rows)
            learning = f"Learning {len(rows)} tasks of up to {n} rows will take"
            if self.verbose:
                say(f"{learning} very roughly {seconds:.0f} s on one processor")
            warn_of_duration(learning, seconds)

    def _warn(self, caught):
        """Say what the fits of the tasks warned of, once for all tasks of which it is.

        `caught` has the categories and messages of each task.
        """
        tasks, said = defaultdict(list), set(OF_ALL)
        if self.target_transform is not None:  # of which the tasks know nothing
            said.add(TargetScaleWarning)
        for m, warned in enumerate(caught):
            for warning in dict.fromkeys(warned):
                tasks[warning].append(m)
        for (category, message), of in tasks.items():
            if category in said:
                continue
            names = name_tasks(self.tasks_[of], begins=True)
            warn(f"{names}: {message}", category)

    def _check_room(self, engine, n, n_outputs, tiles, n_coefficients):
        """Whether memory suffices for tasks side by side, of at most n samples each."""
        n_climbs = at_a_time(self.n_jobs, len(self.tasks_))
        demand = Demand(
            n,
            n_kept=n_outputs * n_posteriors(self, n),
            n_climbs=n_climbs,
            n_exact_climbs=n_climbs,
            n_coefficients=n_coefficients,
            alone=True,
        )
        engine.check_memory(demand, tiles)

    def _store(self, fitted):
        """Set the fitted attributes, from the model of each task."""
        self.estimators_, self.inference_ = fitted, fitted[0].inference_
        self.theta_ = np.concatenate([e.theta_ for e in fitted])
        self.n_iter_ = max(e.n_iter_ for e in fitted)
        self.n_evaluations_ = sum(e.n_evaluations_ for e in fitted)
        self.n_hyperparameters_ = sum(e.n_hyperparameters_ for e in fitted)
        self.hyperparameters_ = np.array([e.hyperparameters_ for e in fitted])
        self.variance_factor_ = np.array([e.variance_factor_ for e in fitted])
        self.log_marginal_likelihoods_ = sum(
            e.log_marginal_likelihoods_ for e in fitted
        )
        self.log_marginal_likelihood_value_ = float(
            self.log_marginal_likelihoods_.sum()
        )
        self._store_coefficients()

    def _store_coefficients(self):
        """Those of the trend of each task, if there is one."""
        for name in COEFFICIENTS:
            vars(self).pop(name, None)
        if self.trend is None:
            return
        for name in ("coef_", "coef_std_"):
            found = [getattr(estimator, name) for estimator in self.estimators_]
            setattr(self, name, np.stack(found, axis=-2))
        self.trend_names_ = self.estimators_[0].trend_names_
        self.trend_mean_ = np.stack([e.trend_mean_ for e in self.estimators_])

    def _describe(self, m, result):
        estimator, _ = result
        value, n_iter = estimator.log_marginal_likelihood_value_, estimator.n_iter_
        found = f"log likelihood {value:.1f} after {n_iter} iterations"
        return f"{self._in_words(m)}: {found}"

    def _in_words(self, m):
        """The name of a task in lines."""
        return f"task {self.tasks_[m]} ({m + 1} of {len(self.tasks_)})"

    def _means(self, features, codes):
        means = np.empty((len(features), self._n_outputs))
        for rows, model in self._parts(codes):
            means[rows] = model._means(features[rows], np.zeros_like(rows))
        return means

    def _variances(self, features, codes, include_noise):
        variances = np.empty((len(features), self._n_outputs))
        for rows, model in self._parts(codes):
            alone = features[rows], np.zeros_like(rows)
            variances[rows] = model._variances(*alone, include_noise)
        return variances

    def _covariances(self, features, codes, include_noise):
        covariances = np.zeros((len(features), len(features), self._n_outputs))
        for rows, model in self._parts(codes):
            alone = features[rows], np.zeros_like(rows)
            block = model._covariances(*alone, include_noise)
            covariances[np.ix_(rows, rows)] = block
        return covariances

    def _draws(self, features, codes, n_draws, rng):
        draws, noise_std = np.empty((2, len(features), self._n_outputs, n_draws))
        for rows, model in self._parts(codes):
            alone = features[rows], np.zeros_like(rows)
            draws[rows], noise_std[rows] = model._draws(*alone, n_draws, rng)
        return draws, noise_std

    def _components(self, features, codes, include_noise):
        def of_task(model, rows):
            return model._components(features[rows], 0 * rows, include_noise)

        return self._mixed(codes, of_task)

    def _left_out(self, include_noise):
        """Means and variances of each training sample given the others of its task.

        Of each normal that is mixed, with its weight: (n_components, n_samples,
        n_outputs) each.
        """

        def of_task(model, rows):
            return model._left_out(include_noise)

        return self._mixed(self.tasks_train_, of_task)

    def _factors(self, codes):
        factors = np.reshape(self.variance_factor_, (len(self.tasks_), -1))
        return factors[codes]

    def _errors_left_out(self):
        errors = np.full((len(self.tasks_train_), self._n_outputs), np.nan)
        for rows, model in self._parts(self.tasks_train_):
            if len(rows) > 1 or not self.normalize_y:  # else it is the mean itself
                errors[rows] = model._errors_left_out()
        return errors

    def _mixed(self, codes, components):
        """Of all rows together, what `components` gives of each task's rows."""
        found = [(rows, components(model, rows)) for rows, model in self._parts(codes)]
        n_components = max((len(of[0]) for _, of in found), default=1)
        n_arrays = max((len(of) for _, of in found), default=2)
        together = np.empty((n_arrays, n_components, len(codes), self._n_outputs))
        for rows, of_rows in found:
            together[:, :, rows] = of_rows
        return together

    def _noise(self, codes):
        noise = np.empty((len(codes), self._n_outputs))
        for rows, model in self._parts(codes):
            noise[rows] = model._noise(np.zeros_like(rows))
        return noise

    def _parts(self, codes):
        """The rows of each task and its model."""
        for m, rows in zip(*rows_by_code(codes), strict=True):
            yield rows, self.estimators_[m]

    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict each training sample from all others of its task.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the uncertainty is that of the observation that was left out, f plus
            noise, rather than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Mean of f at each training sample given the others, in units of y and in the
            order of the rows in `fit`. With `target_transform` it is the median, as in
            `predict`.
        y_std : ndarray of the shape of y_mean
            Its standard deviation, without `variance_factor_`.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Notes
        -----
        Rasmussen and Williams (2006), eqs. 5.10 to 5.12, for each task alone. See
        :meth:`MultiTaskGPRegressor.loo_predict`, also for scores. The hyperparameters,
        the mean and the scale of each task stay as they are, although they were learned
        with the sample that is left out.

        A task with a single sample gets the prior. With `normalize_y` the mean of the
        prior is the task's `y_mean_`, which is the sample itself. Its error is zero and
        says nothing. Its `y_scale_` is 1, so the standard deviation is the kernel's
        own. Leave such tasks out of scores. Without `normalize_y` the mean is 0.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import SingleTaskGP
        >>> from skmtgp.metrics import normalized_mean_squared_error
        >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
        >>> X = np.column_stack([x.astype(object), task])
        >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
        >>> mean, std = SingleTaskGP().fit(X, y).loo_predict()
        >>> normalized_mean_squared_error(y, mean, tasks=task) < 1e-4
        True
        """
        check_is_fitted(self)
        mean, std = self._target.left_out(self, include_noise)
        return self._join(mean), self._join(std)

    def _leave_out(self, include_noise):
        """Means and standard deviations as learned, (n_samples, n_outputs) each."""
        mean, std = np.empty((2, len(self.tasks_train_), self._n_outputs))
        for rows, model in self._parts(self.tasks_train_):
            mean[rows], std[rows] = model._leave_out(include_noise)
        return mean, std

    def summary(self) -> pd.DataFrame:
        """Return what was learned of each task, as a table in units of y.

        With `target_transform` the table is in units of the transformed targets.

        Returns
        -------
        summary : DataFrame of n_tasks rows
            The task labels are the index. With several outputs the tables follow each
            other, and ``summary().loc[j]`` is that of output j. The columns are those
            of :meth:`MultiTaskGPRegressor.summary`: rows, level, level_std, noise_std,
            explained, closest and correlation. The level is the mean of the task's
            targets. No task is close to another, as each is learned by itself.

        Raises
        ------
        NotFittedError
            If the model was not fitted.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import SingleTaskGP
        >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
        >>> X = np.column_stack([x.astype(object), task])
        >>> y = np.where(task == "a", np.sin(x), np.cos(2 * x))
        >>> y += 0.1 * np.random.default_rng(0).standard_normal(40)
        >>> summary = SingleTaskGP().fit(X, y).summary()
        >>> summary[["rows", "noise_std", "explained"]].round(1)
              rows  noise_std  explained
        task
        a       20        0.1        1.0
        b       20        0.1        1.0
        """
        check_is_fitted(self)
        tables = [estimator.summary() for estimator in self.estimators_]
        if self._single_output:
            return pd.concat(tables).set_axis(pd.Index(self.tasks_, name="task"))
        outputs = range(self._n_outputs)
        of_outputs = [pd.concat([of.loc[j] for of in tables]) for j in outputs]
        names = ["output", "task"]
        index = pd.MultiIndex.from_product([outputs, self.tasks_], names=names)
        return pd.concat(of_outputs).set_axis(index)

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: Literal[False] = False
    ) -> float: ...

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: Literal[True] = ...
    ) -> tuple[float, NDArray[np.float64]]: ...

    @overload
    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, NDArray[np.float64]]: ...

    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, NDArray[np.float64]]:
        """Log marginal likelihood of the training targets, in their own units.

        With `target_transform` it is that of the transformed targets.

        Parameters
        ----------
        theta : array-like of shape (n_theta,), default=None
            Parameters, as in the attribute `theta_`. None means the learned parameters.
        eval_gradient : bool, default=False
            Whether to return the gradient, too.

        Returns
        -------
        log_likelihood : float
            Sum over tasks and outputs. It is minus infinity if a covariance of the
            targets cannot be factorised.
        gradient : ndarray of shape (n_theta,)
            Its gradient. Only if `eval_gradient`.
        """
        check_is_fitted(self)
        if theta is None and not eval_gradient:
            return self.log_marginal_likelihood_value_
        stops = np.cumsum([len(of.theta_) for of in self.estimators_])
        parts = np.split(check_theta(theta, self.theta_), stops[:-1])
        results = [
            estimator.log_marginal_likelihood(part, eval_gradient)
            for estimator, part in zip(self.estimators_, parts, strict=True)
        ]
        if not eval_gradient:
            return float(np.sum(results))
        values, gradients = zip(*results, strict=True)
        return float(np.sum(values)), np.concatenate(gradients)

    @property
    def _side(self):
        return max(estimator._side for estimator in self.estimators_)

    @property
    def _n_outputs(self):
        return len(self.log_marginal_likelihoods_)

    @property
    def _single_output(self):
        return self.estimators_[0]._single_output


def alone_like(model, kernels):
    """Models of the tasks alone that are comparable to a multi-task model.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Fitted or not.
    kernels : sequence of Kernel
        k^x of each of its terms, with their starting values.

    Returns
    -------
    alone : SingleTaskGP
        Not fitted: with the model's parameters and these kernels, each of which gets
        an amplitude, and, if the model has levels, a level around
        the mean of the task. The level has the variance of the task's targets, which is
        the prior of unit information.
    """
    kernel = reduce(add, (ConstantKernel(1.0, (1e-3, 1e3)) * of for of in kernels))
    if model._has_levels():
        kernel += ConstantKernel(1.0, "fixed")
    given = SingleTaskGP().get_params().keys() & model.get_params(deep=False).keys()
    params = {name: getattr(model, name) for name in given}
    params |= {"kernel": kernel, "normalize_y": True}
    params["inference"] = of_one_task(params["inference"])
    return SingleTaskGP(**params)


def _fit_alone(estimator, X, y, known, name):
    """A fitted clone, and what it warned of: the caller names the task."""
    with collect_warnings() as collected, part(name):
        given = () if known is None else known.arguments()
        fitted = clone(estimator).fit(X, y, *given)
    return fitted, collected
