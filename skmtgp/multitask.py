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
from skmtgp._estimators.doubts import warn_of_duration
from skmtgp._estimators.estimator import steady
from skmtgp._estimators.forms import (
    candidates,
    diagonal_of,
    form_of,
    rows_for,
    usual_ladder,
)
from skmtgp._estimators.named_kernels import KERNEL
from skmtgp._estimators.reading import has_descriptors
from skmtgp._estimators.slopes import TrendOf
from skmtgp._estimators.targets import TargetTransform
from skmtgp._estimators.terms import LISTS, terms_asked_for
from skmtgp._support.progress import say
from skmtgp._support.sklearn_compat import Interval, StrOptions
from skmtgp.inference.engine import Engine
from skmtgp.learning.forecast import foresee_bounds
from skmtgp.learning.growing import learn_forms, learn_upwards, with_own
from skmtgp.learning.novel import join_described, learn_again, learn_novel
from skmtgp.learning.open_rows import with_open_rows
from skmtgp.learning.paper import learn_simultaneously, learn_staged
from skmtgp.learning.ranks import learn_ranks, wary
from skmtgp.learning.settling import has_rows, settled
from skmtgp.learning.shortlisting import chosen, learn_best
from skmtgp.learning.terms import learn_terms
from skmtgp.model.described import describes
from skmtgp.model.several import Forms, terms_of

Diagonal = Literal["equal"] | bool
USUAL, GROWN = 3, 5  # rank that grows on the bound, and how many forms are learned
FEW = 8  # rows of a task on average: fewer may tell no more than what all share


class MultiTaskGPRegressor(BaseMultiTaskGP):
    r"""Multi-task Gaussian process regression with a learned task covariance.

    The tasks are related functions of the same inputs. One column of X says which task
    a row belongs to. Each output is modelled separately:

    .. math::
        \mathrm{cov}(f^m(x), f^{m'}(x'))
        = v\, \delta_{mm'} + K^\rho_{mm'}\, k^x(x, x'), \qquad
        t^m(x) \sim \mathcal N(f^m(x), \sigma_m^2)

    Here v is the variance of the tasks' levels, :math:`K^\rho` is a positive
    semi-definite task covariance of the given rank, :math:`k^x` is a kernel over the
    inputs, and :math:`\sigma_m^2` are noise variances. All of them are learned by
    maximising the marginal likelihood. Each task may be observed at any inputs.

    Parameters
    ----------
    kernel : Kernel, str or None, or list of them, default=None
        Kernel :math:`k^x` over the columns of X without the task column. It is a kernel
        of :mod:`sklearn.gaussian_process.kernels` or :mod:`skmtgp.kernels`. Its values
        are starting values, and its bounds are kept. The task covariance is its
        amplitude. A string names a kernel with a length-scale for each feature.
        Starting values and bounds are then relative to the feature's standard
        deviation:

        - "rbf": the squared exponential;
        - "exponential", "matern" and "matern52": Matérn kernels with nu = 1/2, 3/2 and
          5/2;
        - "periodic", whose periods are looked for, and "linear".

        None is "rbf" or, where that is likelier, "linear", "matern52", "matern" or
        "exponential", see Notes. If there are more than a quarter as many features as
        rows, and that is clearly likelier, all have one length-scale. The kernel that
        was chosen is in `kernel_`.

        A list has a kernel for each of several terms, see Notes. In it, None is "rbf".
    rank : int or list of int or None, default=None
        Rank of the task covariance: the number of functions that the tasks mix. It is
        at most the number of tasks, with `task_descriptors` at most one more than the
        number of descriptors.

        None lets the data choose, see Notes. `rank_`, `shared_` and `diagonal_` have
        the choice. The candidates are:

        - independent tasks, one function that all tasks share (rank 0), and compound
          symmetry (see `diagonal`);
        - ranks 1, 2, 3, ..., until two in a row are worse than the best. A task
          covariance of rank r has about r M parameters for M tasks, and needs four rows
          for each. Two are enough for rank 1, and three for up to 80 parameters of
          rank 2;
        - if the data have noise: a rank less than the best one, with a diagonal. One
          task may have a function to itself. Variances of the diagonal that vanish do
          not count.

        With sparse inference one function that all tasks share, or a rank, is chosen
        from `n_exact` of the rows. From there ranks grow by all rows, up to 6, until
        two in a row are worse. If data have noise, compound symmetry is tried, too,
        where it does not take too long. With ``max_iter=0``,
        `task_descriptors` or another `learning`, None is the highest rank that has four
        rows for each. If tasks then have fewer than eight rows on average, and
        `max_iter` is not 0, BIC compares this rank with rank 0. With `task_descriptors`
        the data then say if tasks also have functions of their own, see `diagonal`.

        Rank 0 needs ``shared=True`` or ``diagonal="equal"``. With ``shared=True`` all
        tasks have one function, and with `task_levels` each has its own level. That
        suits many tasks with a handful of rows.

        With several kernels a list has the rank of each term. None is then the highest
        rank that has enough rows.
    shared : bool or list of bool, default=False
        Whether all tasks share one function in equal amounts: :math:`K^\rho = a 1 1^T +
        L L^T`. They differ from it by functions of the given rank. A task that `fit`
        has not seen is then predicted as a draw from the population of the known tasks:
        by the shared function, and by the mean and the spread of the rows of L. With
        several terms a list has one value for each.
    diagonal : bool or "equal", or list of them, default=False
        Whether to add a learned diagonal to the task covariance. It is variation that a
        task shares with no other. True has a variance for each task, and "equal" has
        one variance for all. ``rank=0, diagonal="equal"`` makes the tasks independent.
        With ``shared=True``, too, it is compound symmetry: any two tasks are equally
        alike. False with ``rank=None`` lets the data choose: see `diagonal_`. With
        `task_descriptors` the choice is "equal" or none.
        With several terms a list has one value for each.
    task_levels : bool, default=True
        Whether each task has a level: a constant that is added to its function. Levels
        have the prior N(0, v) with a learned variance v, and are integrated out
        exactly.
    task_feature : int or str, default=-1
        Position or name of the column of X with the task labels, which are integers or
        strings.
    task_descriptors : sequence of int or str, default=None
        Positions or names of columns of X with numbers that describe the tasks, such as
        a machine's age or the mass of a robot's load. They are constant within a task,
        and are not inputs of :math:`k^x`. Instead :math:`K^\rho = D B B^\top D^\top`,
        where D has a row [1, descriptors] for each task, and B of the given rank is
        learned. A task that `fit` has not seen is then predicted from its descriptors.
        See :doc:`/guide/descriptors`.
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
        the data, see Notes.
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
        - "auto" decides between these two by the data, see Notes.
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
        their number, memory with its square. Ranks with fewer than four
        of these samples for each number of the task covariance are learned from all
        rows alone. They start at the mode of a lower rank.
    learning : {"annealed", "staged", "simultaneous"}, default="annealed"
        How the mode is searched for. "annealed" finds the best modes. "staged" follows
        section 3 of the paper to the letter. "simultaneous" learns all parameters at
        once from a random task covariance, which the paper advises against.
    truncation : {"eigen", "cholesky"}, default="eigen"
        How the first estimate of the task covariance gets its rank (section 3.2): by
        its leading eigenvectors, or by an incomplete Cholesky decomposition.
    n_restarts_optimizer : int, default=0
        Number of additional starts. The first starts from a fit of full rank, truncated
        to the given rank; the others are random. With "simultaneous" all are random.
    hyperparameters : {"mode", "map", "laplace", "sampled", "auto"}, default="mode"
        Which values of the hyperparameters predictions use:

        - "mode" uses the maximum of the likelihood times priors of the noise, see the
          user guide, page "Noise". With ``learning="annealed"`` intervals count what
          the rows leave open of a task's relation to the others. With few rows for each
          hyperparameter all variances are multiplied by a factor, `variance_factor_`,
          that errors of left-out rows suggest. See the page "Intervals".
        - "map" uses the maximum of the likelihood times weak priors of all
          hyperparameters, which are relative to the size of the data. Intervals count
          the same as with "mode".
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
        Number of processes, see :term:`n_jobs`. They share the outputs and the starts
        of each and, with ``rank=None``, the candidates. If hyperparameters are sampled,
        they then share the chains of an output.
    random_state : int, RandomState instance or None, default=None
        Source of the random starts, if `n_restarts_optimizer` is not 0 or `learning` is
        "simultaneous", and of the chains, if hyperparameters are sampled. With None the
        chains are the same in each fit.
    verbose : int, default=0
        With 1, learning prints a line for each output and stage, and every few seconds
        how far a long stage is. With 2 it prints more of these. Lines go to the logger
        "skmtgp"; without handlers they are printed.

    Attributes
    ----------
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    kernel_ : Kernel, or list of n_outputs of them
        The learned kernel :math:`k^x`. With several terms a list has the kernel of
        each.
    task_covariance_ : ndarray of shape ([n_outputs,] [n_terms,] n_tasks, n_tasks)
        The learned :math:`K^\rho`, in squared units of y. If tasks have their own
        units, an entry is in the product of the units of both tasks.
    task_correlation_ : DataFrame of n_tasks rows and columns
        Correlations of the tasks in `task_covariance_`, with their labels. With several
        outputs ``task_correlation_.loc[j]`` is that of output j. With several terms
        ``task_correlation_.loc[q]`` is that of term q. With rank 1 and no functions of
        each task's own all are -1 or 1, whatever the rows say. At rank 0 (`rank_`) the
        form fixes them, too: 0 of independent tasks, 1 of one function of all tasks,
        and the same for all pairs by compound symmetry. If tasks have functions of
        their own, correlate the curves of `predict` at the same inputs by
        `np.corrcoef`, or give a `rank` of 2 or more.
    task_descriptors_ : DataFrame of n_tasks rows
        Descriptors of each task. Only with `task_descriptors`.
    task_factor_ : ndarray of shape ([n_outputs,] n_tasks, rank)
        Lower trapezoidal factor of `task_covariance_`: ``L @ L.T``, without the
        diagonal and the shared function. With several terms it is a list, because their
        ranks may differ.
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
        Number of hyperparameters as eq. 8 counts them, summed over the outputs: those
        of the kernel, r (2 M + 1 - r) / 2 of a task covariance of rank r for M tasks, 1
        of a shared function, M of a diagonal (vanished or not), 1 of all levels, and
        the noise. With p descriptors p + 1 takes the place of M. As in the paper, the
        scale of the task covariance and an amplitude of the kernel both count. What
        `normalize_y` takes from the data does not count, nor do coefficients of a
        trend.
    theta_ : ndarray of shape (n_theta,)
        All learned parameters, output by output:

        - theta of the kernel, or of the kernels of all terms;
        - for each term the factor of the task covariance, row by row, the logarithm of
          the variance a of the shared function, and logarithms of the diagonal;
        - the logarithm of the levels' variance, and logarithms of the noise variances.

        Parts that the model does not have are left out. All are those of the scaled
        output. It is scaled by `y_scale_`; without `normalize_y` by its root mean
        square, or with `task_levels` by the standard deviation around the means of the
        tasks. The factor is a rotation of `task_factor_`: ``L @ Q`` has the same ``L @
        L.T``. With `task_descriptors` it is the factor of their coefficients, in units
        in which they are independent.
    rank_ : int, or list of int
        Rank of the task covariance, without the shared function. With several terms the
        rank of each.
    shared_ : bool, or list of bool
        Whether all tasks share one function. With several terms that of each. Tasks
        that `fit` has not seen are predicted only if you set ``shared=True`` before.
    diagonal_ : bool or "equal", or list of them
        Which diagonal the task covariance has. With several terms that of each.
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
        over the outputs. Modes that were not kept count, too. In a RankSearchIC, what
        the ranks share counts for each of them. The small model that "auto" uses does
        not count.
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
        Training inputs without the task column and the descriptors. This, the next two
        and `complete_` do not exist if X was a Dask collection.
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
    RankSearchIC : Chooses the rank by an information criterion.
    IndependentGP : Tasks that share the kernel only.
    PooledGP : Tasks that are one and the same function.
    SingleTaskGP : Each task alone.

    Notes
    -----
    The model is eq. 6 of [1]_, the rank-constrained model of its section 3, with
    additional levels and units of the tasks. The paper's model is ``task_levels=False,
    normalize_y="shared", noise="shared"``. Learning follows the paper's stages, with
    additions that :mod:`skmtgp.learning` describes.

    Let t and t' be the tasks of two samples. In units of y, ``y - y_mean_[t]`` is
    normal with mean zero and covariance ``level_variance_ * (t == t') +
    task_covariance_[t, t'] * kernel_(X, X')``, plus ``noise_variance_`` for a sample
    with itself. If an attribute has a number for each task, the one of t counts. With a
    trend of columns H, the normal quantity is ``y - y_mean_[t] - (H - trend_mean_) @
    coef_``, with coefficients of any size. Time grows with the cube of the number of
    samples, memory with its square.

    With a list of kernels the covariance has a term for each, :math:`\sum_q
    K^{\rho_q}_{mm'}\, k_q(x, x')`. This is the linear model of coregionalisation. With
    ranks 1 it is the semiparametric latent factor model. `predict_terms` predicts each
    term separately. Inference is then "dense" or, if asked for, "sparse", and
    hyperparameters are those of the mode. A list of one kernel is the same as that
    kernel. See :doc:`/guide/terms`.

    With ``rank=None`` the candidate with the highest evidence is taken: the likelihood
    with the hyperparameters integrated out under a weak prior, by Laplace's method. It
    is computed of the candidates within 5 nats for each output of the best by BIC and
    the prior of the noise, to which almost no noise is unlikely, and of those that
    would be if BIC priced the parameters of a task by its own rows. If the best by BIC
    has fewer than five rows for each hyperparameter, it is computed of all candidates
    that have two rows or more for each, for BIC takes a model that explains a few rows
    exactly for a good one. (A best one without noise must have fewer than two rows for
    each, and compound symmetry must have noise.) BIC decides between candidates of
    nearly the same evidence. With `task_descriptors`, noise and exact inference the
    candidates are the descriptors alone, and the same with ``diagonal="equal"``: what
    they do not tell of a task. BIC alone chooses if the best candidates have no noise,
    more than 300 hyperparameters (100 from 3000 rows on), or more than 30 rows for each
    of them, or were not learned to the end, and in sparse inference. With few rows a
    task some candidates are unlikely from the start. See :doc:`/guide/rank`.

    A task of one to three rows, where two or more tasks have more, gets a row of the
    factor from its samples and the prior of `add_task`: the population of the larger
    tasks' rows. Noise variances, relative to the squares of the units, have priors.
    Almost no noise is unlikely: below a hundredth of the targets' variance, or
    `noise_variance` if that is less, the mean of their logarithms has the tail of
    Student's t with four degrees of freedom. With a rank that is given and fewer than
    three rows for each hyperparameter it falls faster, with fewer than two by half a
    nat a hyperparameter for each factor of e. Noise variances of tasks are alike:
    their logarithms are normal around a common mean, with a deviation of 1, and
    exponential far from it. These are priors of the mode, not of "laplace" and
    "sampled", which have their own; "map" has the first one if it falls faster.
    Reported likelihoods are without them. Everything else is learned by maximum
    likelihood, as are the row with complete data, and both with other kinds of
    `learning`.

    The data decide what "auto" means for `normalize_y` and `noise`, before learning
    begins. A small model is fitted to a few hundred rows. Its tasks share only
    :math:`k^x`, and each has its own amplitude and level. It is fitted with shared
    units and with units of each task, with shared noise and with noise of each task.
    The criterion is BIC: each parameter costs half the logarithm of the number of rows.
    For a parameter of one task, these are the rows of this task. Noise of each task
    must gain 8 nats more than that and than its priors take off, fewer with more than
    twenty rows of a task: with few rows the gain is often chance, and intervals are
    then far too narrow.

    Three rules shorten this. If the standard deviations of the tasks' targets differ by
    no more than chance, units are shared. Noise of each task is only tried if it
    promises a gain. With ``max_iter=0`` units and noise are shared, and "fixed" noise
    is always shared. Noise is also shared if all targets of a task with more than five
    rows are equal, because the noise of that task would vanish. Such a task does not
    count in these choices, and with the default `noise_variance_bounds` the noise
    variance is at least a quarter of what the small model finds in the other tasks, if
    that is noise beyond doubt.
    After exact inference with shared noise, the choice of the noise is checked once
    more with the learned model.

    With ``kernel=None`` the same small model says how smooth the functions are: it is
    fitted with "rbf", then "matern52", "matern" and "exponential", as long as each is
    likelier than the one before. After exact inference the learned model is asked once
    more. The kernels have the same parameters, so nothing is counted. If all
    length-scales are then longer than two standard deviations of their feature, or if
    there is much noise, functions may be straight lines or planes. If some rows give
    hope of that, all is learned anew with "linear". It is taken if it is likelier (by
    the evidence, or by eq. 8), and that and its gain at left-out rows make three nats.
    This is not tried where the inputs of the tasks do not overlap. A list of kernels
    and ``max_iter=0`` keep "rbf".

    With complete data of N inputs and M tasks, time and memory grow with :math:`N^3`
    and :math:`N^2` instead of :math:`(NM)^3` and :math:`(NM)^2`, by Kronecker algebra.
    This is faster from two tasks on, even if up to a tenth of the cells are missing. It
    remains in use when `add_task` makes the data incomplete. A kernel with a
    WhiteKernel, whose noise differs between samples, needs "dense".

    Below 600 samples, results do not depend on `n_jobs`, to the last bit. With more
    samples, processes share the threads of linear algebra, and other numbers of threads
    round differently. Results then agree to about the digits that `tol` asks for. With
    one thread (``OMP_NUM_THREADS=1``) they agree to the last bit.

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
        hyperparameters: Literal["mode", "map", "laplace", "sampled", "auto"] = "mode",
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
        problems = wary(problems, forms, self.n_jobs)
        found = self._learn_one(problems, forms, progress)
        compared = len(forms) > 1 or self._asks_for_own(problems[0].engine)
        if self.verbose and compared:
            say(f"chosen: {found[0][0].prior.task_covariance}")
        return found

    def _check_rank(self, term, data):
        """Raise an error where the rank of a term cannot be."""
        rank, most, what = term.rank, data.n_tasks, "the number of tasks"
        if has_descriptors(self) and len(self.task_descriptors) < most:
            most, what = len(self.task_descriptors) + 1, "1 + the number of descriptors"
        if isinstance(rank, (bool, np.bool_)):
            raise TypeError(f"rank={rank!r} must be an int or None, not a bool.")
        if rank is not None and rank > most:
            raise ValueError(f"rank={rank} is above {what}, {most}.")
        if rank == 0 and not (term.shared or isinstance(term.diagonal, str)):
            raise ValueError(
                "rank=0 leaves tasks nothing in common. Set shared=True for one "
                "function of all tasks, diagonal='equal' for an independent function "
                "of each, or rank=1 or more."
            )

    def _forms(self, problem):
        """Forms of K^rho to choose from, by eq. 8; one if the user gave its rank."""
        data, n = problem.data, problem.engine.n_told(len(problem.data))
        terms, ranks = self._terms(), self._ranks(data.n_told, n)
        of_terms = [
            form_of(term, data, min(rank, data.n_told))
            for term, rank in zip(terms, ranks, strict=True)
        ]
        if len(terms) > 1:
            return [Forms(of_terms)]
        [term] = terms
        if term.rank is not None or self.max_iter == 0 or data.n_tasks == 1:
            return of_terms
        if self._grows(problem.engine):
            ladder = usual_ladder(data.n_told, len(data))
            return [form_of(term, data, rank) for rank in ladder]
        if not self._compares(problem.engine):
            few = n < FEW * data.n_told
            return [form_of(term, data, 0), *of_terms] if few else of_terms
        low = range(1, 1 + min(2, data.n_told))
        enough = [rank for rank in low if rows_for(data.n_told, rank) <= n]
        highest = max(ranks[0], *enough) if enough else 0
        return candidates(term, data, highest)

    def _terms(self):
        """What the user asks for in each term."""
        terms = terms_asked_for(self)
        if len(terms) > 1 and has_descriptors(self):
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
        ranks, n_terms = range(n_tasks, 1, -1), len(terms)
        rows = (n_terms * rows_for(n_tasks, rank, compared=False) for rank in ranks)
        enough = (rank for rank, least in zip(ranks, rows, strict=True) if least <= n)
        highest = next(enough, 1)
        return [highest if term.rank is None else term.rank for term in terms]

    def _some_noise(self):
        return self.learning == "annealed"  # the paper's has no such priors

    def _noise_deviation(self):
        return super()._noise_deviation() if self.learning == "annealed" else np.inf

    def _rank(self, n_tasks, n, engine):
        if self._grows(engine) and len(self._terms()) == 1:
            return usual_ladder(n_tasks, n)[-1]
        return sum(self._ranks(n_tasks, engine.n_told(n)))

    def _n_climbs(self, n_ranks):
        starts = 1 if self.learning == "annealed" else 2 + self.n_restarts_optimizer
        return starts * self._n_likely(n_ranks)

    def _foretell(self, problems, n_forms=1, told=False):
        [problem, *_], one_term = problems, len(self._terms()) == 1
        if one_term and self.max_iter and not (problem.engine.exact or told):
            self._foretell_bounds(problems, n_forms)
        return super()._foretell(problems, self._n_likely(n_forms), told)

    def _foretell_bounds(self, problems, n_forms):
        """Say how long sparse inference will take, where that is minutes."""
        data, [term] = problems[0].data, self._terms()
        n_forms = GROWN if n_forms == 1 and self._grows(problems[0].engine) else n_forms
        rank = min(USUAL if term.rank is None else term.rank, data.n_told)
        seconds = foresee_bounds(problems, form_of(term, data, rank), n_forms)
        learning = f"Learning from {len(data)} rows by sparse inference will take"
        if self.verbose and seconds:
            say(f"{learning} very roughly {seconds:.2g} s on one processor")
        warn_of_duration(learning, seconds, "A given rank or fewer n_inducing")

    def _n_likely(self, n_forms):
        """How many forms of K^rho are learned, of which it may compare more."""
        several = self.rank is None and self.learning == "annealed"
        several = several and n_forms == 1 and not has_descriptors(self)
        return 2 if several else n_forms

    def _compares(self, engine):
        """Whether all ranks are compared, where nobody asked for one."""
        annealed = self.learning == "annealed"
        return annealed and engine.exact and not has_descriptors(self)

    def _grows(self, engine):
        """Whether ranks grow on the bound over all rows, where nobody asked for one."""
        asked = self.rank is not None or has_descriptors(self) or not self.max_iter
        return not (asked or engine.exact) and self.learning == "annealed"

    def _asks_for_own(self, engine):
        """Whether the data say if tasks have more than what descriptors tell."""
        [term, *_] = self._terms()
        given = term.rank is not None or term.diagonal or not self.max_iter
        annealed = self.learning == "annealed"
        return annealed and engine.exact and has_descriptors(self) and not given

    def _learn_one(self, problems, forms, progress):
        """The problem of each output with the form that is chosen, and its mode."""
        if len(forms) > 1 and self._compares(problems[0].engine):
            return self._learn_best(learn_best, problems, forms, progress)
        if len(forms) > 1 and self._grows(problems[0].engine):
            return self._learn_best(learn_upwards, problems, forms, progress)
        asks = self._asks_for_own(problems[0].engine)
        modes = self._learn_ranks(problems, forms, progress)
        modes = list(zip(*modes, strict=True))
        found = chosen(problems, forms, modes, self.n_jobs)
        return with_own(*found, self.n_jobs, progress) if asks else found

    def _learn_best(self, learn, problems, forms, progress):
        """The same, by a learner that compares forms."""
        options = {"n_jobs": self.n_jobs, "progress": progress}
        return learn(problems, forms, seeds=self._seeds(), **options)

    def _seeds(self):
        """One for each additional start."""
        n_seeds = self.n_restarts_optimizer + (self.learning == "simultaneous")
        rng = check_random_state(self.random_state)
        return rng.randint(np.iinfo(np.int32).max, size=n_seeds).tolist()

    def _learn_ranks(self, problems, forms, progress, **options):
        """Modes for each form and output."""
        learn = {
            "annealed": learn_ranks,
            "staged": learn_staged,
            "simultaneous": learn_simultaneously,
        }[self.learning]
        options |= {"n_jobs": self.n_jobs, "progress": progress}
        learn = partial(learn_forms, learn, seeds=self._seeds(), **options)
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

    @steady
    def predict_terms(self, X: ArrayLike) -> NDArray[np.float64]:
        r"""Predict each term of f, the trend and the level; their sum is `predict`.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`.

        Returns
        -------
        y_terms : ndarray of shape (n_samples, [n_outputs,] n_terms + 1)
            Predictive means. First come the terms :math:`K^\rho_q \times k_q` in the
            order of `kernel_`, then the trend if there is one, and last the task's
            level, with `y_mean_`. They are in units of y. With `target_transform` they
            are in units of the transformed targets, in which they add up.

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

    @steady
    def add_task(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
        *,
        prior: Literal["tasks"] | None = "tasks",
    ) -> Self:
        """Return the model with one more task, from a few samples of it.

        Everything learned so far is kept: the kernel, the variances of noise and
        levels, the units, and the covariance of the known tasks. Only the new row of
        the task covariance is learned, from the marginal likelihood of all samples. It
        has as many numbers as the rank, and one more with full rank or a diagonal. The
        level of the new task follows from its samples and the levels' variance. If
        their mean is more than five deviations from where the other tasks let it be, it
        is taken off first, and `y_mean_` then has a number for each task.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs of the new task, with its label in column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Its targets.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known of the noise of these rows, see `fit` and `partial_fit`. The
            learned noise variance of the new task is as without them, see Notes.
        prior : {"tasks"} or None, default="tasks"
            "tasks" assumes that the new task is drawn from the same population as the
            known tasks. Their rows of the factor then give a prior of the new row. None
            is the paper's maximum likelihood, which one or two samples do not
            determine.

        Returns
        -------
        model : MultiTaskGPRegressor
            A new fitted estimator, which also knows the new task. The present estimator
            does not change.

        Raises
        ------
        TypeError
            If X or y is a Dask collection.
        ValueError
            If the task is already known. If X has several tasks, features other than in
            `fit`, or values that cannot be used. If y has other outputs. If what is
            known of the noise cannot be used, or the engine does not take it.

        Warns
        -----
        OutlierWarning
            If a few of ten or more targets are far from all others.
        TaskColumnWarning
            If the label differs from a known one in spaces or case alone.
        TaskUnitWarning
            If the task seems to be in another unit than all others.

        Notes
        -----
        This is section 3.3 of the paper, with a prior and levels added. A task with
        descriptors is known by them: nothing is learned, and its rows join the others.
        With `diagonal` its variance is then the mean of the others'. If tasks have
        their own noise variances, the new task gets their geometric mean, each counted
        as often as its task has rows. If they have their own units, the new task's
        targets are centred and divided by their standard deviation; with one or two
        samples, by the geometric mean of the other tasks' standard deviations.
        `n_iter_` and `n_evaluations_` are those of learning the new row.

        With ``prior="tasks"`` the variances of the new task count what its samples and
        the prior leave open of the new row.

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
        X, y, given = self._weighed(X, y, (alpha, sample_weight, repeat_variance))
        features, label, Y = check_new_task(self, X, y)
        model = copy(self)
        known = model._take_known(given, Y.shape)
        model._join_task(features, label, Y, known, prior=prior)
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
            known=data.known and data.known.part(new),
            trend=trend,
        )

    def _learns_rows(self):
        prior, trend = self._likelihoods[0].prior, self._trends()
        if trend is not None and trend[0].per_task:
            return False
        own = any(form.n_own > 1 for _, form in prior.terms)
        return has_rows(prior) or (own and not describes(prior.task_covariance))

    def _row_of(self, task, likelihood, data, informed):
        if not self._learns_rows():
            return super()._row_of(task, likelihood, data, informed)
        rows = self._rows_that_relate(data.tasks == task)
        X, _, y, known = data.some(rows)
        options = {"task": task, "informed": informed, "budget": self._budget()}
        return partial(learn_again, likelihood, X=X, y=y, known=known, **options)

    def _rank_with_task(self):
        return int(np.sum(self.rank_)) + sum(self._full())

    def _has_own(self, prior):
        """For each term whether a joining task has its own part, of any variance."""
        diagonals = [diagonal_of(form) for _, form in prior.terms]
        return [
            diagonal is True or (not diagonal and full)
            for diagonal, full in zip(diagonals, self._full(), strict=True)
        ]

    def _full(self):
        """For each term whether its task covariance is as general as it can be."""
        ranks = self.rank_ if isinstance(self.rank_, list) else [self.rank_]
        pairs = zip(self._free, ranks, strict=True)
        return [free and rank == len(self.tasks_) for free, rank in pairs]

    def _settled(self, problems, modes):
        if self.learning != "annealed":  # the paper's, by maximum likelihood
            return modes
        return list(map(settled, problems, modes))

    def _opened(self, problems, modes, posteriors):
        if self.learning != "annealed":  # the others take rows of F as known
            return modes
        return list(map(with_open_rows, problems, modes, posteriors))

    def _counts_learning(self):
        return self.learning == "annealed"  # the others are the paper's

    def _store(self, training, problems, modes, lower=()):
        super()._store(training, problems, modes, lower)
        described = has_descriptors(self)  # parameters may be others when tasks join
        self._free = [not described and term.rank is None for term in self._terms()]

    def _store_learned(self, training, engine, likelihoods, modes, posteriors):
        super()._store_learned(training, engine, likelihoods, modes, posteriors)
        form = likelihoods[0].prior.task_covariance
        self.rank_, of_terms = form.rank, terms_of(form)
        diagonals = list(map(diagonal_of, of_terms))
        shared = [bool(getattr(of_term, "shared", False)) for of_term in of_terms]
        several = isinstance(form, Forms)
        self.diagonal_ = diagonals if several else diagonals[0]
        self.shared_ = shared if several else shared[0]
