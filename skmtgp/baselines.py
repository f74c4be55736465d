"""Task covariances that are fixed: the paper's iGP and pGP."""

from __future__ import annotations

from typing import Literal

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

    def _named_kernel(self, name, features):
        return ConstantKernel(1.0, (1e-3, 1e3)) * named_kernel(name, features)

    def _learns_amplitude(self):
        return self.kernel is None or isinstance(self.kernel, str)

    def _learn(self, problems, progress):
        form = self._form(problems[0].prior.n_tasks, self.diagonal)
        problems = [problem.with_form(form) for problem in problems]

        def describe(j, mode):
            found = in_words(problems[j], mode.value)
            return f"{about(problems[j])}{found} after {mode.n_iter} iterations"

        jobs = [(problem,) for problem in exact_part(problems, [form])]
        report = progress("learning", len(jobs), describe)
        modes = [[m] for m in run(learn_fixed, jobs, n_jobs=self.n_jobs, report=report)]
        options = {"n_jobs": self.n_jobs, "progress": progress}
        modes = learn_rest(problems, [form], modes, **options)
        return problems, [mode for [mode] in modes]


class IndependentGP(_FixedTaskCovarianceGP):
    r"""Independent Gaussian processes of the tasks that share their kernel, iGP.

    The multi-task model of eq. 6 with :math:`K^\rho = I`, and a level of each task:
    tasks tell each other nothing but the hyperparameters, which are learned from all of
    them.

    Parameters
    ----------
    kernel : Kernel, str or None, default=None
        Kernel over the columns of X without the task column, with its starting values
        and bounds. Or the name of one, which gets an amplitude and a length-scale for
        each feature, started and bounded relative to the feature's standard deviation:
        "rbf", the squared exponential, which None is too, "exponential", "matern" and
        "matern52" (Matern's of nu = 1/2, 3/2 and 5/2), "periodic" or "linear".
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, one variance for each
        task: how much more the functions of some tasks vary than those of others.
    task_levels : bool, default=True
        Whether each task has a level: a constant that is added to its function, drawn
        from N(0, v). The variance v is learned. Levels are integrated out exactly.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
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
        data, see :class:`MultiTaskGPRegressor`.
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
        the data, see :class:`MultiTaskGPRegressor`. With False the model's mean is
        zero.
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
        its square.
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
    verbose : int, default=0
        1 prints a line for each of them and, where one takes long, every few seconds
        how far it is; 2 more of them during each climb.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The kernel as learned.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        The identity (plus the diagonal) times the squared scale of y, of each task
        where they have units of their own.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Its factor.
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
        Number of hyperparameters of the kernels, the diagonals, the levels (1 for all
        tasks) and the noise.
    theta_ : ndarray of shape (n_theta,)
        Theta of the kernel, logarithms of the diagonal, of the levels' variance and of
        the noise variances of the scaled target, for each output. A target is scaled by
        `y_scale_`; without `normalize_y`, if the kernel is the default, by its root
        mean square, with `task_levels` by the deviation around the means of the tasks.
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
        Likelihoods and gradients that learning took, summed over the outputs.
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
        Training inputs without the task column. Not there, nor are the next two and
        `complete_`, if X was a Dask collection.
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
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a collection of
    independent GPs for the contexts, but sharing kernel parameters". The paper's has
    ``task_levels=False, normalize_y="shared", noise="shared"``.

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
        hyperparameters: Literal["mode", "map", "sampled", "auto"] = "mode",
        n_draws: int = 100,
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
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
        self.verbose = verbose


class PooledGP(_FixedTaskCovarianceGP):
    r"""One Gaussian process for the samples of all tasks, pGP.

    The multi-task model of eq. 6 with :math:`K^\rho = 1 1^T`: the tasks are taken to be
    one and the same function. It predicts tasks that `fit` has not seen, too.

    Parameters
    ----------
    kernel : Kernel, str or None, default=None
        Kernel over the columns of X without the task column, with its starting values
        and bounds. Or the name of one, which gets an amplitude and a length-scale for
        each feature, started and bounded relative to the feature's standard deviation:
        "rbf", the squared exponential, which None is too, "exponential", "matern" and
        "matern52" (Matern's of nu = 1/2, 3/2 and 5/2), "periodic" or "linear".
    diagonal : bool, default=False
        Whether to add a learned diagonal to the task covariance, one variance for each
        task: how much its function deviates from the common one.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels (int or str).
    trend : {"constant", "linear"}, sequence of int or str, or transformer, default=None
        A trend that is added to the functions of the tasks, of columns of X that stay
        inputs of :math:`k^x`: their positions or names; or a transformer of
        scikit-learn, such as PolynomialFeatures, which is cloned and makes the columns
        of X without that of the task; "linear" is a constant and all columns, and
        "constant" a constant alone. The coefficients have a flat prior and are
        integrated out, exactly: universal kriging. Inference is dense, or sparse where
        that is asked for. See :doc:`/guide/trend`.
    noise : {"auto", "shared", "per_task"}, default="auto"
        Whether the tasks share one noise variance or have one each. "auto" asks the
        data, see :class:`MultiTaskGPRegressor`.
    noise_variance : float, default=1e-2
        Where learning starts, relative to the variance of the target, of each task if
        they have units of their own.
    noise_variance_bounds : pair of floats or "fixed", default=(1e-10, 1e3)
        Bounds of the noise variance, relative to the same. "fixed" with
        ``noise_variance=0`` leaves all noise to the `alpha` of `fit`.
    normalize_y : {"shared"} or bool, default="shared"
        Whether to take each output off its mean and to divide it by its standard
        deviation before learning. "shared" is True. With False the model's mean is
        zero. One function has one level and one unit: those of all tasks.
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
        its square.
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
    verbose : int, default=0
        1 prints a line for each of them and, where one takes long, every few seconds
        how far it is; 2 more of them during each climb.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The kernel as learned.
    task_covariance_ : ndarray of shape ([n_outputs,] n_tasks, n_tasks)
        The matrix of ones (plus the diagonal) times the squared scale of y.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Its factor.
    coef_, coef_std_ : ndarray of shape ([n_outputs,] n_trend)
        Coefficients of the trend given the data, in units of y for one of their column,
        and their standard deviations. This and the next two only with `trend`.
    trend_names_ : ndarray of shape (n_trend,)
        Names of the trend's columns.
    trend_mean_ : ndarray of shape ([n_tasks,] n_trend)
        What the columns are taken off, as the targets are off `y_mean_`.
    noise_variance_ : float or ndarray of shape ([n_outputs,] [n_tasks])
        Noise variance in squared units of y. One for each task where they have noise
        of their own.
    y_mean_, y_scale_ : float or ndarray of shape (n_outputs,)
        What was taken off the targets, and what they were divided by. 0 and 1 without
        `normalize_y`.
    normalize_y_ : {"shared"} or False
        The units that were used.
    level_variance_ : float or ndarray of shape (n_outputs,)
        0: the function has no levels.
    task_level_, task_level_std_ : ndarray of shape ([n_outputs,] n_tasks)
        `y_mean_` and 0, for each task.
    noise_ : {"shared", "per_task"}
        The noise that was used, chosen if `noise` is "auto".
    log_marginal_likelihood_value_ : float
        Log density of y in its own units (a lower bound of it where inference is
        sparse), summed over the outputs. With `trend` it is that of what the trend
        leaves of y: models of other trends do not compare.
    log_marginal_likelihoods_ : ndarray of shape (n_outputs,)
        The same for each output.
    n_hyperparameters_ : int
        Number of hyperparameters of the kernels, the diagonals and the noise.
    theta_ : ndarray of shape (n_theta,)
        Theta of the kernel, logarithms of the diagonal and of the noise variances of
        the scaled target, for each output. A target is scaled by `y_scale_`; without
        `normalize_y` it is scaled by its root mean square if the kernel is the default.
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
        Likelihoods and gradients that learning took, summed over the outputs.
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
        Training inputs without the task column. Not there, nor are the next two and
        `complete_`, if X was a Dask collection.
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
    MultiTaskGPRegressor : Learns how the tasks are related.

    Notes
    -----
    Chai, Williams, Klanke and Vijayakumar (2008), section 6: "a single GP for each
    joint that learns by pooling all training data from all the contexts". The paper's
    has ``noise="shared"``.

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
        hyperparameters: Literal["mode", "map", "sampled", "auto"] = "mode",
        n_draws: int = 100,
        max_iter: int = 2000,
        tol: float = 1e-2,
        n_jobs: int | None = None,
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
        self.verbose = verbose
