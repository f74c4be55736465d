"""Task covariances that are fixed: the paper's iGP and pGP."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from sklearn.gaussian_process.kernels import ConstantKernel, Kernel

from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._estimators.named_kernels import named_kernel
from skmtgp._estimators.slopes import TrendOf
from skmtgp._estimators.targets import TargetTransform
from skmtgp._numerics.parallel import run
from skmtgp._support.sklearn_compat import StrOptions
from skmtgp.inference.engine import Engine
from skmtgp.learning.stages import learn_fixed
from skmtgp.learning.summarised import exact_part, learn_rest
from skmtgp.learning.telling import about, in_words
from skmtgp.model.task_covariance import identity, ones


class _FixedTaskCovarianceGP(BaseMultiTaskGP):
    """A Gaussian process whose task covariance is fixed, but for a diagonal."""

    _parameter_constraints = {
        **BaseMultiTaskGP._parameter_constraints,
        "diagonal": ["boolean"],
    }

    def _named_kernel(self, name, features, *, alike=False):
        kernel = named_kernel(name, features, alike=alike)
        return ConstantKernel(1.0, (1e-3, 1e3)) * kernel

    def _learns_amplitude(self):
        return self.kernel is None or isinstance(self.kernel, str)

    def _learn(self, problems, progress):
        form = self._form(problems[0].prior.n_tasks, self.diagonal)
        problems = [problem.with_form(form) for problem in problems]

        def describe(j, mode):
            found = in_words(problems[j], mode.theta, mode.value)
            return f"{about(problems[j])}{found} after {mode.n_iter} iterations"

        jobs = [(problem,) for problem in exact_part(problems, [form])]
        report = progress("learning", len(jobs), describe)
        modes = [[m] for m in run(learn_fixed, jobs, n_jobs=self.n_jobs, report=report)]
        options = {"n_jobs": self.n_jobs, "progress": progress}
        modes = learn_rest(problems, [form], modes, **options)
        return problems, [mode for [mode] in modes]


class IndependentGP(_FixedTaskCovarianceGP):
    r"""Independent Gaussian processes of the tasks with a shared kernel, iGP.

    This is the multi-task model of eq. 6 with :math:`K^\rho = I`, and a level for each
    task. The tasks share only the hyperparameters, which are learned from all of them.

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
        that is clearly likelier, all have one length-scale. The kernel that was chosen
        is in `kernel_`.
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, with a variance for
        each task. The functions of some tasks may then vary more than those of others.
    task_levels : bool, default=True
        Whether each task has a level: a constant that is added to its function. Levels
        have the prior N(0, v) with a learned variance v, and are integrated out
        exactly.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels, which are integers or
        strings.
    trend : {"constant", "linear"}, sequence of int or str, or transformer, default=None
        Trend that is added to the functions of the tasks, also called universal
        kriging:

        - "constant" is a constant alone;
        - "linear" is a constant and all features;
        - a sequence has positions or names of columns of X, such as ``["elevation"]``;
        - a transformer of scikit-learn, such as PolynomialFeatures, makes the trend's
          columns from X without the task column. It is cloned.

        The columns remain inputs of :math:`k^x`. The coefficients have a flat prior and
        are integrated out exactly. Inference is dense, or sparse if you
        ask for it. See :doc:`/guide/trend`.
    trend_per_task : bool, default=False
        Whether each task has its own coefficients of the trend. By default all tasks
        share them.
    noise : {"auto", "shared", "per_task"}, default="auto"
        Whether the tasks share one noise variance or have one each. "auto" decides by
        the data, see :class:`MultiTaskGPRegressor`.
    noise_variance : float, default=1e-2
        Starting value of the noise variance, relative to the variance of the target. If
        tasks have their own units, it is relative to the variance of each task. Far
        less noise is unlikely a priori. For data with almost no noise give a lower one.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the same variance. "fixed" keeps
        `noise_variance`. "fixed" with ``noise_variance=0`` leaves all noise to the
        `alpha` of `fit`. With the default, targets that are rounded mostly have the
        noise of rounding at least, see the user guide.
    normalize_y : {"auto", "per_task", "shared"} or bool, default="auto"
        Units in which the targets are learned:

        - "shared", or True, subtracts the mean of all targets of an output and divides
          by their standard deviation. With `task_levels` this is the standard deviation
          around the means of the tasks. If these means are more than 300 such
          deviations apart, most of each is subtracted from its task: a multiple of 100
          deviations. What is left is learned as a level.
        - "per_task" subtracts each task's own mean and divides by its own standard
          deviation. A task with one or two rows, or with equal targets, is divided by
          the geometric mean of the other tasks' standard deviations.
        - "auto" decides between these two by the data, see
          :class:`MultiTaskGPRegressor`.
        - False leaves the targets as they are; the model's mean is then zero.
    target_transform : transformer or pair of functions, default=None
        Transformation that is applied to each output before anything else. It is a
        transformer of scikit-learn with an inverse, which is cloned, or a function and
        its inverse, such as ``(np.log, np.exp)``. It must be strictly monotone.
        Predictions, intervals and draws are in units of y. Likelihoods and learned
        attributes are those of the transformed targets. See :doc:`/guide/intervals`.
    inference : {"auto", "dense", "kronecker", "sparse"} or Engine, default="auto"
        How the likelihood is computed:

        - "dense" decomposes the covariance of all samples. It is exact.
        - "kronecker" decomposes the covariances of the inputs and of the tasks. It is
          exact, too, and much faster. It needs complete data: every task observed at
          the same inputs, once each. Less than half of these cells may be missing.
        - "auto" is "kronecker" if at most a tenth of the cells are missing, and "dense"
          otherwise.
        - "sparse" approximates, for large data. It maximises a lower bound on the
          likelihood from a few inducing inputs.
        - An instance of a subclass of :class:`~skmtgp.inference.engine.Engine` is your
          own method.
    n_inducing : int, default=500
        Number of inducing inputs, only for "sparse". More of them are closer to exact
        inference. Time grows with the square of their number; with many of them, with
        the cube.
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
        Number of samples for the first part of learning, only for "sparse". They are
        drawn at random and learned from exactly, before the bound is maximised: of each
        task its share or, if that is fewer than four of each, four of each of some.
        Without noise they determine most of the kernel. Time grows with the cube of
        their number, memory with its square.
    hyperparameters : {"mode", "map", "laplace", "sampled", "auto"}, default="mode"
        Which values of the hyperparameters predictions use:

        - "mode" uses the maximum of the likelihood times priors of the noise, see the
          user guide, page "Noise". With few rows for each hyperparameter variances are
          multiplied by a factor, `variance_factor_`, that errors of left-out rows
          suggest, see the page "Intervals".
        - "map" uses the maximum of the likelihood times weak priors of all
          hyperparameters, which are relative to the size of the data.
        - "laplace" predicts as "mode", with standard deviations and intervals that
          count what the rows leave open of the hyperparameters (Laplace's method, with
          the same priors). Variances have the factor, too. It takes about as long as
          "mode".
        - "sampled" averages over draws from that posterior, by Hamiltonian Monte Carlo.
          Its intervals are right even where few rows leave the hyperparameters
          uncertain. It takes ten to 300 times as long.
        - "auto" is "sampled" with at most 500 rows and at most 16 rows for each
          hyperparameter, with sparse inference, too. With more rows it is "laplace",
          or "mode" with sparse inference. With several kernels it is "mode". Rows whose
          variance is half noise count half.

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
        Number of outputs learned at the same time, or of chains if hyperparameters are
        sampled, see :term:`n_jobs`.
    random_state : int, RandomState instance or None, default=None
        Source of the chains, if hyperparameters are sampled. With None they are the
        same in each fit.
    verbose : int, default=0
        With 1, learning prints a line for each output, and every few seconds how far a
        long maximisation is. With 2 it prints more of these. Lines go to the logger
        "skmtgp"; without handlers they are printed.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The learned kernel.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        Identity matrix (plus the diagonal) times the squared scale of y. If tasks have
        their own units, each has its own scale.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Factor of `task_covariance_` without the diagonal: ``L @ L.T``.
    level_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Variance of the levels around `y_mean_`, in squared units of y. 0 without
        `task_levels`. One for each task if tasks have their own units.
    task_level_, task_level_std_ : ndarray of shape ([n_outputs,] n_tasks)
        Level of each task given the data, with `y_mean_` included, and its standard
        deviation, in units of y. Without `task_levels` they are `y_mean_` and 0.
    coef_, coef_std_ : ndarray of shape ([n_outputs,] [n_tasks,] n_trend)
        Coefficients of the trend given the data, and their standard deviations, in
        units of y per unit of the trend's column. These and the next two exist only
        with `trend`.
    trend_names_ : ndarray of shape (n_trend,)
        Names of the trend's columns. Those of an array are x0, x1, ... by their
        position, and a constant is 1.
    trend_mean_ : ndarray of shape ([n_tasks,] n_trend)
        What is subtracted from the trend's columns, as `y_mean_` is from the targets.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y. One for each task if tasks have their own
        noise or units.
    y_mean_, y_scale_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        What was subtracted from the targets, and what they were divided by. One for
        each task if tasks have their own units; `y_mean_` also if their levels are far
        apart. 0 and 1 without `normalize_y`.
    normalize_y_ : {"per_task", "shared"} or False
        Units that were used. "auto" has chosen one of them.
    noise_ : {"shared", "per_task"}
        Kind of noise that was used. "auto" has chosen one of them.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over the outputs. For sparse inference
        it is a lower bound. With `trend` it is the density of what the trend leaves of
        y, so models with different trends cannot be compared by it.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of the kernels, the diagonals, the levels (1 for all
        tasks) and the noise.
    theta_ : ndarray of shape (n_theta,)
        For each output: theta of the kernel, and logarithms of the diagonal, of the
        levels' variance and of the noise variances, all of the scaled target. A target
        is scaled by `y_scale_`. Without `normalize_y` and with the default kernel it is
        scaled by its root mean square, or with `task_levels` by the standard deviation
        around the means of the tasks.
    hyperparameters_ : {"mode", "map", "laplace", "sampled"}
        Which hyperparameters predictions use. "auto" has chosen "mode", "laplace" or
        "sampled".
    variance_factor_ : float or ndarray of shape (n_outputs,)
        What variances of predictions are multiplied by, because hyperparameters were
        learned from few rows; 1 with 20 rows or more for each. Deviations of levels and
        of a trend's coefficients have it, too, `noise_variance_` has not.
    theta_samples_ : ndarray of shape (n_draws, n_theta)
        Draws of `theta_`. This and the next three exist only if hyperparameters are
        sampled.
    effective_sample_size_ : float
        Number of independent draws that are worth as much as all draws made, five for
        each that is kept. It is that of the hyperparameter with the smallest number.
    r_hat_ : float
        How much the chains disagree, for the hyperparameter where they disagree most. 1
        means that they agree.
    n_divergences_ : int
        Number of trajectories that left the region where the posterior can be computed.
    n_iter_ : int
        Number of iterations on the way to the mode, for the output with the most.
    n_evaluations_ : int
        Number of evaluations of the likelihood and its gradient during learning, summed
        over the outputs.
    complete_ : bool
        Whether every task was observed at the same inputs, once each.
    inference_ : str
        How the likelihood is computed: "dense", "kronecker", "sparse", or the name of
        your own engine.
    inducing_inputs_ : ndarray of shape (n_inducing, n_features - 1)
        The inducing inputs, or a list of n_outputs of them if y has two dimensions.
        There are fewer than `n_inducing` if more would add nothing. Only for sparse
        inference.
    X_train_ : ndarray of shape (n_samples, n_features - 1)
        Training inputs without the task column. This, the next two and `complete_` do
        not exist if X was a Dask collection.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of the task of each training sample.
    y_train_ : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Training targets, after `target_transform` if there is one.
    target_transformer_ : transformer or list of n_outputs transformers
        Fitted transformers of the outputs. Only with `target_transform`.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a collection of
    independent GPs for the contexts, but sharing kernel parameters". The paper's model
    is ``task_levels=False, normalize_y="shared", noise="shared"``.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import IndependentGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x) * np.where(task == "a", 1.0, -1.0)
    >>> IndependentGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([ 0.997, -0.997])
    """

    _parameter_constraints = {
        **_FixedTaskCovarianceGP._parameter_constraints,
        "task_levels": ["boolean"],
        "trend_per_task": ["boolean"],
    }
    _form = staticmethod(identity)

    def _form_for_screening(self, n_tasks):
        return identity(n_tasks, self.diagonal)

    def __init__(
        self,
        kernel: Kernel | str | None = None,
        *,
        diagonal: bool = False,
        task_levels: bool = True,
        task_feature: int | str = -1,
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
        hyperparameters: Literal["mode", "map", "laplace", "sampled", "auto"] = "mode",
        n_draws: int = 100,
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
        random_state: np.random.RandomState | int | None = None,
        verbose: int = 0,
    ) -> None:
        self.kernel = kernel
        self.diagonal = diagonal
        self.task_levels = task_levels
        self.task_feature = task_feature
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
        self.hyperparameters = hyperparameters
        self.n_draws = n_draws
        self.max_iter = max_iter
        self.tol = tol
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose


class PooledGP(_FixedTaskCovarianceGP):
    r"""One Gaussian process for the samples of all tasks, pGP.

    This is the multi-task model of eq. 6 with :math:`K^\rho = 1 1^T`: all tasks are the
    same function. It also predicts tasks that `fit` has not seen.

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
        that is clearly likelier, all have one length-scale. The kernel that was chosen
        is in `kernel_`.
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, with a variance for
        each task. It is how much the task's function deviates from the common one.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels, which are integers or
        strings.
    trend : {"constant", "linear"}, sequence of int or str, or transformer, default=None
        Trend that is added to the functions of the tasks, also called universal
        kriging:

        - "constant" is a constant alone;
        - "linear" is a constant and all features;
        - a sequence has positions or names of columns of X, such as ``["elevation"]``;
        - a transformer of scikit-learn, such as PolynomialFeatures, makes the trend's
          columns from X without the task column. It is cloned.

        The columns remain inputs of :math:`k^x`. The coefficients have a flat prior and
        are integrated out exactly. Inference is dense, or sparse if you
        ask for it. See :doc:`/guide/trend`.
    noise : {"auto", "shared", "per_task"}, default="auto"
        Whether the tasks share one noise variance or have one each. "auto" decides by
        the data, see :class:`MultiTaskGPRegressor`.
    noise_variance : float, default=1e-2
        Starting value of the noise variance, relative to the variance of the target.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the same variance. "fixed" keeps
        `noise_variance`. "fixed" with ``noise_variance=0`` leaves all noise to the
        `alpha` of `fit`. With the default, targets that are rounded mostly have the
        noise of rounding at least, see the user guide.
    normalize_y : {"shared"} or bool, default="shared"
        Whether to subtract the mean of each output and divide by its standard deviation
        before learning. "shared" is True. With False the model's mean is zero. All
        tasks are one function here, so they have one level and one unit.
    target_transform : transformer or pair of functions, default=None
        Transformation that is applied to each output before anything else. It is a
        transformer of scikit-learn with an inverse, which is cloned, or a function and
        its inverse, such as ``(np.log, np.exp)``. It must be strictly monotone.
        Predictions, intervals and draws are in units of y. Likelihoods and learned
        attributes are those of the transformed targets. See :doc:`/guide/intervals`.
    inference : {"auto", "dense", "kronecker", "sparse"} or Engine, default="auto"
        How the likelihood is computed:

        - "dense" decomposes the covariance of all samples. It is exact.
        - "kronecker" decomposes the covariances of the inputs and of the tasks. It is
          exact, too, and much faster. It needs complete data: every task observed at
          the same inputs, once each. Less than half of these cells may be missing.
        - "auto" is "kronecker" if at most a tenth of the cells are missing, and "dense"
          otherwise.
        - "sparse" approximates, for large data. It maximises a lower bound on the
          likelihood from a few inducing inputs.
        - An instance of a subclass of :class:`~skmtgp.inference.engine.Engine` is your
          own method.
    n_inducing : int, default=500
        Number of inducing inputs, only for "sparse". More of them are closer to exact
        inference. Time grows with the square of their number; with many of them, with
        the cube.
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
        Number of samples for the first part of learning, only for "sparse". They are
        drawn at random and learned from exactly, before the bound is maximised: of each
        task its share or, if that is fewer than four of each, four of each of some.
        Without noise they determine most of the kernel. Time grows with the cube of
        their number, memory with its square.
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
        - "auto" is "sampled" with at most 500 rows and at most 16 rows for each
          hyperparameter, with sparse inference, too. With more rows it is "laplace",
          or "mode" with sparse inference. With several kernels it is "mode". Rows whose
          variance is half noise count half.

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
        Number of outputs learned at the same time, or of chains if hyperparameters are
        sampled, see :term:`n_jobs`.
    random_state : int, RandomState instance or None, default=None
        Source of the chains, if hyperparameters are sampled. With None they are the
        same in each fit.
    verbose : int, default=0
        With 1, learning prints a line for each output, and every few seconds how far a
        long maximisation is. With 2 it prints more of these. Lines go to the logger
        "skmtgp"; without handlers they are printed.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The learned kernel.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        Matrix of ones (plus the diagonal) times the squared scale of y.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Factor of `task_covariance_` without the diagonal: ``L @ L.T``.
    coef_, coef_std_ : ndarray of shape ([n_outputs,] n_trend)
        Coefficients of the trend given the data, and their standard deviations, in
        units of y per unit of the trend's column. These and the next two exist only
        with `trend`.
    trend_names_ : ndarray of shape (n_trend,)
        Names of the trend's columns. Those of an array are x0, x1, ... by their
        position, and a constant is 1.
    trend_mean_ : ndarray of shape ([n_tasks,] n_trend)
        What is subtracted from the trend's columns, as `y_mean_` is from the targets.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y. One for each task if tasks have their own
        noise.
    y_mean_, y_scale_ : float or ndarray of shape (n_outputs,)
        What was subtracted from the targets, and what they were divided by. 0 and 1
        without `normalize_y`.
    normalize_y_ : {"shared"} or False
        Units that were used.
    level_variance_ : float or ndarray of shape (n_outputs,)
        0, because the function has no levels.
    task_level_, task_level_std_ : ndarray of shape ([n_outputs,] n_tasks)
        `y_mean_` and 0, for each task.
    noise_ : {"shared", "per_task"}
        Kind of noise that was used. "auto" has chosen one of them.
    log_marginal_likelihood_value_ : float
        Log density of y in its own units, summed over the outputs. For sparse inference
        it is a lower bound. With `trend` it is the density of what the trend leaves of
        y, so models with different trends cannot be compared by it.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of the kernels, the diagonals and the noise.
    theta_ : ndarray of shape (n_theta,)
        For each output: theta of the kernel, and logarithms of the diagonal and of the
        noise variances, all of the scaled target. A target is scaled by `y_scale_`.
        Without `normalize_y` and with the default kernel it is scaled by its root mean
        square.
    hyperparameters_ : {"mode", "map", "laplace", "sampled"}
        Which hyperparameters predictions use. "auto" has chosen "mode", "laplace" or
        "sampled".
    variance_factor_ : float or ndarray of shape (n_outputs,)
        What variances of predictions are multiplied by, because hyperparameters were
        learned from few rows; 1 with 20 rows or more for each. Deviations of levels and
        of a trend's coefficients have it, too, `noise_variance_` has not.
    theta_samples_ : ndarray of shape (n_draws, n_theta)
        Draws of `theta_`. This and the next three exist only if hyperparameters are
        sampled.
    effective_sample_size_ : float
        Number of independent draws that are worth as much as all draws made, five for
        each that is kept. It is that of the hyperparameter with the smallest number.
    r_hat_ : float
        How much the chains disagree, for the hyperparameter where they disagree most. 1
        means that they agree.
    n_divergences_ : int
        Number of trajectories that left the region where the posterior can be computed.
    n_iter_ : int
        Number of iterations on the way to the mode, for the output with the most.
    n_evaluations_ : int
        Number of evaluations of the likelihood and its gradient during learning, summed
        over the outputs.
    complete_ : bool
        Whether every task was observed at the same inputs, once each.
    inference_ : str
        How the likelihood is computed: "dense", "kronecker", "sparse", or the name of
        your own engine.
    inducing_inputs_ : ndarray of shape (n_inducing, n_features - 1)
        The inducing inputs, or a list of n_outputs of them if y has two dimensions.
        There are fewer than `n_inducing` if more would add nothing. Only for sparse
        inference.
    X_train_ : ndarray of shape (n_samples, n_features - 1)
        Training inputs without the task column. This, the next two and `complete_` do
        not exist if X was a Dask collection.
    tasks_train_ : ndarray of shape (n_samples,)
        Position in `tasks_` of the task of each training sample.
    y_train_ : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Training targets, after `target_transform` if there is one.
    target_transformer_ : transformer or list of n_outputs transformers
        Fitted transformers of the outputs. Only with `target_transform`.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a single GP for each
    joint that learns by pooling all training data from all the contexts". The paper's
    model has ``noise="shared"``.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import PooledGP
    >>> x, task = np.tile(np.linspace(0, 6, 20), 2), np.repeat(["a", "b"], 20)
    >>> X = np.column_stack([x.astype(object), task])
    >>> y = np.sin(x)
    >>> PooledGP().fit(X, y).predict([[1.5, "a"], [1.5, "b"]]).round(3)
    array([0.997, 0.997])
    """

    _parameter_constraints = {
        **_FixedTaskCovarianceGP._parameter_constraints,
        "normalize_y": ["boolean", StrOptions({"shared"})],
    }
    _form = staticmethod(ones)

    def _form_for_screening(self, n_tasks):
        return ones(n_tasks, self.diagonal)

    def _some_noise(self):
        return False  # the paper's, by maximum likelihood

    def _noise_deviation(self):
        return np.inf  # what is left of a task may be of any size: it is no noise

    def _shares(self):
        return True

    def __init__(
        self,
        kernel: Kernel | str | None = None,
        *,
        diagonal: bool = False,
        task_feature: int | str = -1,
        trend: TrendOf = None,
        noise: Literal["auto", "shared", "per_task"] = "auto",
        noise_variance: float = 1e-2,
        noise_variance_bounds: ArrayLike | Literal["fixed"] = (1e-10, 1e3),
        normalize_y: Literal["shared"] | bool = "shared",
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
        self.diagonal = diagonal
        self.task_feature = task_feature
        self.trend = trend
        self.noise = noise
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
