"""Choosing the model by an information criterion, and cross-validation by task."""

from __future__ import annotations

from copy import copy
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Literal, Self, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import MetaEstimatorMixin, clone
from sklearn.utils.validation import check_is_fitted

from skmtgp._data.checks import check_stream
from skmtgp._data.complete import count_copies
from skmtgp._data.dask import is_dask
from skmtgp._data.group_splitting import TaskStratifiedGroupKFold
from skmtgp._data.splitting import TaskStratifiedKFold
from skmtgp._data.time_splitting import TaskTimeSeriesSplit
from skmtgp._estimators.base import side
from skmtgp._estimators.candidates import (
    and_own_functions,
    and_own_part,
    candidates_of,
    learn_again,
    made,
    ranks_to_draw,
    settings_of_ranks,
)
from skmtgp._estimators.conformal import ConformalMixin
from skmtgp._estimators.criteria import ALONE, Alone, criterion_of, tabulate
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.estimator import Estimator, fitting
from skmtgp._estimators.forms import MOST_RANK, ROWS, SIMPLER, usual_ladder
from skmtgp._estimators.posing import pose
from skmtgp._estimators.ranks_of_terms import (
    learn_candidates,
    ranks_to_compare,
    settings_of_terms,
    usual_ranks,
)
from skmtgp._estimators.reading import read
from skmtgp._estimators.revising import revise
from skmtgp._estimators.sampled import MOST_ROWS
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.followers import tell
from skmtgp._support.progress import say
from skmtgp._support.sklearn_compat import StrOptions, fit_context, with_callbacks
from skmtgp.learning.ranks import wary
from skmtgp.learning.weighing import is_unrelated, log_odds, preferred, simplest
from skmtgp.model.described import task_covariance
from skmtgp.model.task_covariance import low_rank
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.single_task import SingleTaskGP, alone_like

__all__ = [
    "RankSearchIC",
    "TaskStratifiedGroupKFold",
    "TaskStratifiedKFold",
    "TaskTimeSeriesSplit",
]

EVIDENCES = "laplace", "bic"  # minus half of which is a log evidence, or nearly
ROWS_IF_DRAWN = 2  # for each number of the task covariance; of modes alone, see ROWS
TOLD = 2  # rows of each task for each of its hyperparameters, to learn it alone


class RankSearchIC(MetaEstimatorMixin, ConformalMixin, Estimator):
    r"""Multi-task GP whose rank is chosen by an information criterion.

    By default simpler models are candidates, too: independent tasks, tasks that are
    equally alike, and a model for each task. One candidate is chosen for all outputs.
    It minimises the criterion. By default this is "laplace" if the data have noise and
    the models not too many hyperparameters: -2 log p(y), with the hyperparameters
    integrated out by Laplace's method under a weak prior. Otherwise it is

    .. math::
        \mathrm{BIC}(r) = -2 \sum_j \log L_{jr}
        + \Bigl(\sum_j d_j + \tfrac J2 r (2 M + 1 - r) + J e\Bigr) \log n

    for J outputs and M tasks. Here :math:`L_{jr}` is the likelihood learned for output
    j at rank r, and :math:`d_j` is the number of hyperparameters of its kernel. e is
    the number of the other hyperparameters of an output: 1 or M of the noise, 1 of
    levels, 1 of a function that all tasks share, 1 or M of a diagonal. n is the number
    of observations, summed over the outputs. "aic" and "hqc" (Hannan-Quinn) have 2 and
    2 log log n in place of log n. "loo" is :math:`-2 \sum_i \log p(y_i | y_{-i})`, the
    density of each observation given all others, in units of y and in closed form; it
    counts no parameters.

    Parameters
    ----------
    estimator : MultiTaskGPRegressor, default=None
        Model whose rank is chosen; its own rank does not matter. None is
        ``MultiTaskGPRegressor()``.
    ranks : sequence of int, or of tuples of int, default=None
        Ranks to compare. Ranks above the highest possible one count as that: the number
        of tasks, or one more than the number of descriptors. 0 is one function of all
        tasks, ``rank=0, shared=True``.

        None tries 0, 1, 2, ... up to 6 or the number of tasks, as long as there are
        four samples for each free parameter of the task covariance. Two are enough for
        rank 1. Three are enough for up to 80 parameters of rank 2 if the evidence may
        choose (`criterion` "auto" or "laplace", exact inference), and two for any rank
        if the estimator's `hyperparameters` are "sampled", or "auto" with at most 500
        samples.
        Sparse inference stops when two ranks in a row are worse than a lower one. The
        paper has (2, 4, 5, 6, 8, 10).

        If the estimator's kernel is a list, a tuple has the rank of each term, and an
        int stands for the same rank of each. A shorter tuple has the first terms alone,
        such as ``[(2,), (1, 1), (2, 1)]``. None is then equal ranks of one term, of
        two, and so on, with a sum of at most 6.
    simpler : {"auto"} or bool, default="auto"
        Whether simpler models are candidates, too:

        - "independent": independent tasks that share their kernel, ``rank=0,
          diagonal="equal"``.
        - "compound symmetry": a function of all tasks and an independent deviation of
          each, ``rank=0, shared=True, diagonal="equal"``.
        - "single tasks": a SingleTaskGP, if inference is exact and each task has at
          least twice as many samples as hyperparameters, and targets that vary. They
          are left out if rows of one task repeat others with their targets, those of
          other tasks do not, and that task would have no noise: counts do so by chance.
        - "rank r and diagonal": the best rank with a diagonal in place of its last
          function, which one task may have to itself. It is tried if `ranks` is None,
          inference is exact and the data have noise. Criteria do not count variances of
          the diagonal that vanish.

        "auto" is True if `ranks` is None and inference is exact. With sparse inference
        it adds compound symmetry alone, if data have noise. Against it,
        `criterion="auto"` charges the numbers of a task for that task's rows alone; the
        column "bic" charges them for all. With several kernels it is False.
    criterion : {"auto", "bic", "aic", "hqc", "loo", "laplace"}, default="auto"
        Criterion that chooses. "loo" takes one more decomposition for each candidate
        and output. It needs the rows, so Dask collections are an error. "laplace" takes
        one more gradient for each hyperparameter of each candidate.

        "auto" is "laplace" if inference is exact, of one kernel and of arrays, if the
        largest candidate has at most 30 rows for each hyperparameter, and if those near
        the best have at most 300 (100 with 3000 rows and more), were learned to the end
        and one has noise: they are within 5 nats for each output of the best, by BIC
        and the prior of the noise. It chooses among these, those that BIC may price too
        high, and single tasks. A smaller model may be lower by a nat, and 0.05 nats for
        each hyperparameter that it spares. BIC decides between candidates of nearly the
        same evidence, if rows and inputs allow. Otherwise "auto" is "bic". With fewer
        than five rows a task on average, or inputs that do not overlap, "auto" holds
        some candidates for unlikely from the start (not in `results_`). See
        :doc:`/guide/rank`.
    keep_estimators : bool, default=False
        Whether to keep all models, not only the best one.
    n_jobs : int, default=None
        Number of outputs and ranks learned at the same time, or of chains if the
        estimator's hyperparameters are sampled, see :term:`n_jobs`. None is the
        estimator's. Its `random_state` gives other chains.
    verbose : int, default=0
        With 1, learning prints a line for each output and rank, and every few seconds
        how far a long one is. With 2 it prints more of these. Lines go to the logger
        "skmtgp"; without handlers they are printed.

    Attributes
    ----------
    best_rank_ : int, or tuple of int
        The chosen rank, 0 for each of the simpler models. With several kernels the rank
        of each term.
    criterion_ : str
        The criterion that has chosen.
    best_model_ : str
        Name of the chosen candidate: "rank 2", "shared" for rank 0, or the name of a
        simpler model, see `simpler`.
    best_estimator_ : MultiTaskGPRegressor or SingleTaskGP
        The chosen model, fitted. If its hyperparameters are drawn, inference is exact
        and the criterion is "laplace" or "bic", the draws are of several ranks: those
        whose BIC is within 10 of the chosen one's. The four chains are shared out among
        them by their evidence, so that an unlikely rank has none. `rank_` is then the
        highest of these ranks, of which the other attributes are. Draws of a lower rank
        have a factor with columns of zeros.
    results_ : DataFrame of n_candidates rows
        A row for each candidate, with the columns

        - rank and model (its name);
        - log_marginal_likelihood, of y in its own units, summed over outputs; with
          several outputs also output0_log_marginal_likelihood and so on. It is the
          maximum, also where tasks of one to three rows then get the prior of
          `add_task`;
        - n_hyperparameters;
        - bic, aic, hqc, and loo or laplace if that is `criterion_`, NaN where "auto"
          does not look;
        - fit_time: seconds of computing spent on it, including the first stage that all
          share;
        - chosen: whether it is `best_model_`.
    tasks_ : ndarray of shape (n_tasks,)
        Task labels, sorted.
    estimators_ : list of n_candidates estimators
        The model of each row of `results_`, fitted; of the chosen one, that is
        `best_estimator_`. Only if `keep_estimators`.
    n_features_in_ : int
        Number of columns of X, including the task column.
    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of the columns, if X has names.

    See Also
    --------
    MultiTaskGPRegressor : The model at a given rank.

    Notes
    -----
    Section 4 and eq. 8 of Chai, Williams, Klanke and Vijayakumar (2008). The stages of
    learning that do not depend on the rank are done once. All ranks have the same units
    and noise. If the estimator's `learning` is "annealed", no rank has a lower
    likelihood than a lower rank, see :mod:`skmtgp.learning`. If rank 0 or compound
    symmetry is chosen and the units are shared, tasks that `fit` has not seen can be
    predicted, too; but not if the hyperparameters are drawn at higher ranks as well,
    unless the estimator has ``shared=True``.

    For single tasks the mean of each task's samples is subtracted. With `task_levels` a
    task has a level around this mean, with the prior of unit information. Without
    levels the mean does not count as a parameter. All other hyperparameters of the
    tasks count. If single tasks are chosen, `add_task` and the displays of how tasks
    are related raise an error.

    With "loo" the hyperparameters have seen the observation that is left out, so it may
    choose a larger rank than needed. If several ranks predict nearly equally well, BIC
    and the evidence choose the smallest of them.

    The evidence of single tasks has priors in the units of each task. If the other
    models share their units, these count like parameters: half the logarithm of the
    number of rows of the task each.

    Examples
    --------
    >>> import numpy as np
    >>> from skmtgp import RankSearchIC
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 80), np.repeat([0, 1, 2, 3], 20)
    >>> y = np.array([1, 2, -1, 3])[task] * np.sin(x) + task * np.cos(x)
    >>> X = np.column_stack([x, task])
    >>> search = RankSearchIC(ranks=(1, 2, 3)).fit(X, y - y.mean())
    >>> search.best_rank_ <= 3
    True
    """

    _parameter_constraints = {
        "estimator": [MultiTaskGPRegressor, None],
        "ranks": ["array-like", None],
        "simpler": [StrOptions({"auto"}), "boolean"],
        "criterion": [StrOptions({"auto", "bic", "aic", "hqc", "loo", "laplace"})],
        "keep_estimators": ["boolean"],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
    }

    def __init__(
        self,
        estimator: MultiTaskGPRegressor | None = None,
        *,
        ranks: ArrayLike | None = None,
        simpler: Literal["auto"] | bool = "auto",
        criterion: Literal["auto", "bic", "aic", "hqc", "loo", "laplace"] = "auto",
        keep_estimators: bool = False,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.estimator = estimator
        self.ranks = ranks
        self.simpler = simpler
        self.criterion = criterion
        self.keep_estimators = keep_estimators
        self.n_jobs = n_jobs
        self.verbose = verbose

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=False)
    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
    ) -> Self:
        """Learn all candidates and keep the best one.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in the estimator's column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. Outputs are learned separately and share the rank.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known about the noise of each row, see `fit` of the estimator. BIC
            counts all measurements that rows are means of.

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
            If a rank, a feature, a label or a target cannot be used.
        """
        model = self._learner()
        with fitting(self, X, y, verbose=model.verbose) as progress:
            self._fit(model, X, y, progress, (alpha, sample_weight, repeat_variance))
        return self

    def _fit(self, model, X, y, progress, given):
        training = read(model, X, y, given)
        if len(model._terms()) > 1:
            self._fit_terms(model, decide(model, training, progress), progress)
            return
        self._check_criterion(training)
        ranks = self._check_ranks(model, training)
        simpler = len(training.tasks) > 1 and self._asks_simpler()
        n_forms = len(ranks) + (len(SIMPLER) + 1) * simpler  # and a diagonal
        foretell = partial(model._foretell, n_forms=n_forms)
        training = decide(model, training, progress, foretell)
        model.set_params(rank=ranks[-1])
        problems = pose(model, training, n_forms, self._n_kept(n_forms))
        exact, data = problems[0].engine.exact, problems[0].data
        simpler = simpler and (exact or not isinstance(self.simpler, str))
        settings = settings_of_ranks(model._terms()[0], ranks, simpler=simpler)
        forms = [task_covariance(data.n_tasks, Q=data.Q, **each) for each in settings]
        problems = model._foretell(wary(problems, forms), len(forms), training.foretold)
        described = training.descriptors is not None or training.trends is not None
        asks = simpler and exact and not described
        with limit_threads(side(problems)):
            growing = self.ranks is None
            modes = model._learn_ranks(problems, forms, progress, until_worse=growing)
            settings, forms = settings[: len(modes)], forms[: len(modes)]
            learned = [[of.with_form(form) for of in problems] for form in forms], modes
            if growing and not described and not model.diagonal:
                settings, *learned = self._and_own(model, settings, *learned, progress)
            again = partial(learn_again, model, learned[0], progress)
            told = model._tell(training, *revise(model, training, *learned, again))
            alone = _alone(model, *told[:2], X, y, given) if asks else None
            self._keep(model, settings, alone, *told)

    def _and_own(self, model, settings, problems, modes, progress):
        """The same with one candidate more, in which tasks have their own functions."""
        several = problems[0][0].data.n_tasks > 1
        if problems[0][0].engine.exact:
            if several and self._asks_simpler():
                return and_own_part(settings, problems, modes, model.n_jobs)
        elif isinstance(self.simpler, str) and model.max_iter > 0:
            running = {"n_jobs": model.n_jobs, "progress": progress}
            return and_own_functions(settings, problems, modes, **running)
        return settings, problems, modes

    def _n_kept(self, n_forms):
        """How many of the candidates have a posterior in the end."""
        return n_forms if self.keep_estimators else 1

    def _check_criterion(self, training):
        if self.criterion == "loo" and is_dask(training.features):
            raise ValueError(
                "criterion='loo' leaves out one row after another, which Dask "
                "collections do not allow. Use criterion='bic', or fit to arrays."
            )

    def _fit_terms(self, model, training, progress):
        """Learn candidates of several terms, each of which has its own prior."""
        n_terms, n_tasks = len(model._terms()), len(training.tasks)
        if self.criterion == "laplace":
            raise ValueError(
                "criterion='laplace' integrates the hyperparameters of one term out, "
                f"but kernel is a list of {n_terms}. Use criterion='bic' or 'loo'."
            )
        if self.simpler is True:
            raise ValueError(
                "simpler=True adds candidates of one kernel, but kernel is a list of "
                f"{n_terms}. Leave it 'auto'; shorter tuples in ranks have fewer terms."
            )
        if self.ranks is None:
            limits = {"most": MOST_RANK, "rows": ROWS}
            ranks = usual_ranks(n_terms, n_tasks, len(training.Y), **limits)
        else:
            ranks = ranks_to_compare(self.ranks, n_terms, n_tasks)
        settings = [settings_of_terms(model, of_terms) for of_terms in ranks]
        n_forms = len(settings)
        model.set_params(**settings[-1])
        problems = pose(model, training, n_forms, self._n_kept(n_forms))
        model._foretell(problems, n_forms)
        with limit_threads(side(problems)):
            learn = partial(learn_candidates, model, settings, progress)
            decided = revise(model, training, *learn(training), learn)
            self._keep(model, settings, None, *model._tell(training, *decided))

    def _asks_simpler(self):
        """Whether simpler models are tried; "auto" does not where they take long."""
        return self.ranks is None if isinstance(self.simpler, str) else self.simpler

    def _keep(self, model, settings, alone, training, *learned):
        """Set the fitted attributes."""
        candidates = candidates_of(settings, *learned)
        criterion, among = criterion_of(self.criterion, *learned)
        table = tabulate(training, *learned, alone, criterion, among, model.n_jobs)
        names = [str(of.form) for of in candidates]
        makes = [partial(of.fitted, model, training) for of in candidates]
        if alone is not None:
            names, makes = [*names, ALONE], [*makes, alone.chosen]
        best = self._best(table, criterion, *learned)
        # arrays, for a frame cannot be kept by skops
        self._table = table | {"chosen": np.arange(len(names)) == best}
        self.best_model_, self.best_rank_ = names[best], 0
        self.criterion_ = criterion
        if model.verbose:
            say(f"chosen by {criterion.upper()}: {names[best]}")
        drawn = ranks_to_draw(model, training, candidates, table["bic"], best)
        *lower, highest = drawn if criterion in EVIDENCES else [best]
        if lower:
            lower = [candidates[k] for k in lower]
            makes[best] = partial(makes[highest], lower=lower)
        self.best_estimator_, kept = made(makes, best, every=self.keep_estimators)
        if best < len(candidates):
            self.best_rank_ = candidates[best].rank
            (_, *of_best), compared = candidates[highest], alone is not None
            self.best_estimator_._warn_of_fit(training, *of_best, compared=compared)
        vars(self).pop("estimators_", None)
        if self.keep_estimators:
            self.estimators_ = kept

    def _best(self, table, criterion, of_forms, modes):
        """Position of what is chosen; nothing whose criterion could not be computed."""
        values = np.nan_to_num(table[criterion].astype(np.float64), nan=np.inf)
        if self.criterion != "auto":
            return int(np.argmin(values))
        odds = log_odds(of_forms, modes)
        forms = [of[0].prior.task_covariance for of in of_forms]
        # single tasks, the last, are as unrelated as independent ones
        alone = max(odds[list(map(is_unrelated, forms))], default=0.0)
        odds = np.append(odds, np.full(len(values) - len(odds), alone))
        told = odds - 0.5 * values
        if criterion == "bic":
            return int(np.argmax(told))
        sizes = table["n_hyperparameters"] / len(modes[0])  # of an output
        if simplest(told, sizes) == len(of_forms):
            return len(of_forms)
        by_eq_8 = odds - 0.5 * table["bic"]
        by_eq_8[len(of_forms) :] = -np.inf  # they do not pay for means and units
        return preferred(told, by_eq_8, sizes, of_forms[0][0])

    def _learner(self):
        """A clone of the model, with the search's own parameters."""
        model = clone(self.estimator) if self.estimator else MultiTaskGPRegressor()
        model._validate_params()
        return model.set_params(
            n_jobs=model.n_jobs if self.n_jobs is None else self.n_jobs,
            verbose=max(self.verbose, model.verbose),
        )

    def _check_ranks(self, model, training):
        """The ranks, by the number of rows that a factor has."""
        n_rows = training.n_told
        if self.ranks is None:
            ranks = range(min(n_rows, MOST_RANK) + 1)
            n, asked = len(training.Y), model.hyperparameters
            drawn = asked == "sampled" or (asked == "auto" and n <= MOST_ROWS)
            if drawn:
                free = [low_rank(n_rows, rank).n_free for rank in ranks]
                return [r for r in ranks if r < 2 or ROWS_IF_DRAWN * free[r] <= n]
            compared = self._evidence_may_choose(model, training)
            return usual_ladder(n_rows, n, compared=compared)
        tuples = any(map(np.ndim, self.ranks))  # perhaps of several lengths
        ranks = np.empty(0) if tuples else np.asarray(self.ranks)
        if ranks.ndim != 1 or not ranks.size or ranks.dtype.kind not in "iu":
            more = " Tuples are for estimators with a list of kernels." * tuples
            raise ValueError(
                f"ranks={self.ranks!r} must be a sequence of one or more integers."
                f"{more}"
            )
        if ranks.min() < 0:
            raise ValueError(f"ranks={self.ranks!r} must be 0 or more.")
        return np.unique(np.minimum(ranks, n_rows)).tolist()

    def _evidence_may_choose(self, model, training):
        """Whether the evidence may choose, which few rows of a rank mislead less."""
        exact = getattr(model.inference, "exact", model.inference != "sparse")
        may = self.criterion in ("auto", "laplace")
        return may and exact and not is_dask(training.features)

    def _model(self):
        return self.best_estimator_

    def _joint(self, method):
        """The chosen model, which must be one of all tasks."""
        check_is_fitted(self)
        if isinstance(self.best_estimator_, SingleTaskGP):
            raise TypeError(
                f"{method} needs a model of all tasks, but the search has chosen "
                f"{ALONE}, whose models best_estimator_.estimators_ has. Fit it with "
                "simpler=False for the best model of all tasks."
            )
        return self.best_estimator_

    def loo_predict(
        self, include_noise: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict each training sample from all others with the best model.

        Parameters
        ----------
        include_noise : bool, default=False
            Whether the uncertainty is that of the observation that was left out, rather
            than that of f.

        Returns
        -------
        y_mean : ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Mean of f at each training sample given the others, in units of y and in the
            order of the rows in `fit`.
        y_std : ndarray of the shape of y_mean
            Its standard deviation, without `variance_factor_`.

        Raises
        ------
        NotFittedError
            If the search was not fitted.

        Notes
        -----
        Rasmussen and Williams (2006), eqs. 5.10 to 5.12. See
        :meth:`MultiTaskGPRegressor.loo_predict`, also for scores. The rank and the
        hyperparameters stay as they are, although they were chosen with the sample that
        is left out.

        Examples
        --------
        >>> import numpy as np
        >>> from skmtgp import RankSearchIC
        >>> from skmtgp.metrics import normalized_mean_squared_error
        >>> rng = np.random.default_rng(0)
        >>> x, task = rng.uniform(0, 6, 60), np.repeat([0, 1, 2], 20)
        >>> y = np.array([1, 2, -1])[task] * np.sin(x) + 0.1 * rng.standard_normal(60)
        >>> search = RankSearchIC(ranks=(1, 2)).fit(np.column_stack([x, task]), y)
        >>> mean, std = search.loo_predict()
        >>> normalized_mean_squared_error(y, mean, tasks=task) < 0.1
        True
        """
        check_is_fitted(self)
        return self.best_estimator_.loo_predict(include_noise)

    def predict_terms(self, X: ArrayLike) -> NDArray[np.float64]:
        """Predict each term of the best model separately, and the level.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in the estimator's column `task_feature`.

        Returns
        -------
        y_terms : ndarray of shape (n_samples, [n_outputs,] n_terms + 1)
            See :meth:`MultiTaskGPRegressor.predict_terms`.

        Raises
        ------
        NotFittedError
            If the search was not fitted.
        TypeError
            If single tasks were chosen, or if X is a Dask collection.
        ValueError
            If a task was not seen in fit and cannot be predicted.
        """
        return self._joint("predict_terms").predict_terms(X)

    def summary(self) -> pd.DataFrame:
        """Return what the best model has learned of each task, as a table.

        Returns
        -------
        summary : DataFrame of n_tasks rows
            Number of rows, level, noise, share of the variance explained and closest
            task, see :meth:`MultiTaskGPRegressor.summary`.

        Raises
        ------
        NotFittedError
            If the search was not fitted.
        """
        check_is_fitted(self)
        return self.best_estimator_.summary()

    def task_correlation_interval(
        self, level: float = 0.95
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return intervals of the tasks' correlations, by the best model.

        Parameters
        ----------
        level : float, default=0.95
            Posterior probability of each interval.

        Returns
        -------
        lower, upper : DataFrame of n_tasks rows and columns
            Ends of the intervals, see
            :meth:`MultiTaskGPRegressor.task_correlation_interval`.

        Raises
        ------
        NotFittedError
            If the search was not fitted.
        TypeError
            If single tasks were chosen.
        ValueError
            If the model has no draws of its hyperparameters.
        """
        best = self._joint("task_correlation_interval")
        return best.task_correlation_interval(level)

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
        """Return the search with one more task in the best model, at its rank.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs of the new task, with its label in the estimator's column
            `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Its targets.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known of the noise of these rows, see
            :meth:`MultiTaskGPRegressor.add_task`.
        prior : {"tasks"} or None, default="tasks"
            See :meth:`MultiTaskGPRegressor.add_task`.

        Returns
        -------
        model : RankSearchIC
            A new fitted search with another `best_estimator_`. Its `results_` do not
            have the new task. The present search does not change.

        Raises
        ------
        TypeError
            If single tasks were chosen.
        ValueError
            See :meth:`MultiTaskGPRegressor.add_task`.
        """
        best, model = self._joint("add_task"), copy(self)
        given = alpha, sample_weight, repeat_variance
        model.best_estimator_ = best.add_task(X, y, *given, prior=prior)
        model.__dict__.pop("estimators_", None)
        return model

    def partial_fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
        *,
        max_rows: int | None = None,
    ) -> Self:
        """Add rows to the best model, at its rank.

        The first call is `fit`.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in the estimator's column `task_feature`.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets.
        alpha, sample_weight, repeat_variance : array-like, default=None
            What is known of the noise of these rows, see
            :meth:`MultiTaskGPRegressor.partial_fit`.
        max_rows : int, default=None
            See :meth:`MultiTaskGPRegressor.partial_fit`.

        Returns
        -------
        self : object
            With another `best_estimator_`. Its `results_` do not have the new rows.

        Raises
        ------
        TypeError
            If single tasks were chosen, or X or y is a Dask collection.
        ValueError
            See :meth:`MultiTaskGPRegressor.partial_fit`. The search is then as it was
            before.
        """
        check_stream(X, y, max_rows)
        model, is_first = copy(self), not hasattr(self, "best_estimator_")
        given = alpha, sample_weight, repeat_variance
        if is_first:
            model.fit(X, y, *given)
        model.best_estimator_ = copy(model._joint("partial_fit"))
        if not is_first:
            model.best_estimator_.partial_fit(X, y, *given, max_rows=max_rows)
        elif max_rows is not None:
            model.best_estimator_._drop(max_rows)
        vars(model).pop("estimators_", None)
        self.__dict__ = vars(model)  # all at once, whatever fails before
        tell(self)
        return self

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
        """Log marginal likelihood of the best model.

        Parameters
        ----------
        theta : array-like of shape (n_theta,), default=None
            Parameters, as in ``best_estimator_.theta_``. None means the learned
            parameters.
        eval_gradient : bool, default=False
            Whether to return the gradient, too.

        Returns
        -------
        log_likelihood : float
            Sum over the outputs.
        gradient : ndarray of shape (n_theta,)
            Its gradient. Only if `eval_gradient`.
        """
        check_is_fitted(self)
        return self.best_estimator_.log_marginal_likelihood(theta, eval_gradient)

    @property
    def results_(self) -> pd.DataFrame:
        """Table of the candidates, computed anew."""
        check_is_fitted(self)
        return pd.DataFrame(self._table)

    @property
    def tasks_(self) -> NDArray[np.generic]:
        """Task labels that the best model knows, sorted."""
        check_is_fitted(self)
        return self.best_estimator_.tasks_

    @property
    def n_features_in_(self) -> int:
        """Number of columns of X, including the task column."""
        check_is_fitted(self)
        return self.best_estimator_.n_features_in_

    @property
    def feature_names_in_(self) -> NDArray[np.object_]:
        """Names of the columns of X."""
        check_is_fitted(self)
        return self.best_estimator_.feature_names_in_

    if not TYPE_CHECKING:  # for which an attribute that is missing stays missing

        def __getattr__(self, name):
            """Say where an attribute is that the best model alone has."""
            best = vars(self).get("best_estimator_")
            if name.endswith("_") and not name.endswith("__") and hasattr(best, name):
                raise AttributeError(
                    f"{type(self).__name__!r} object has no attribute {name!r}; see "
                    f"best_estimator_.{name}"
                )
            return self.__getattribute__(name)  # raises what it raised

    def __sklearn_is_fitted__(self):
        return "best_estimator_" in vars(self)


def _alone(model, training, of_forms, X, y, given):
    """The tasks learned alone, or None where their rows cannot tell as much."""
    alone = alone_like(model, of_forms[0][0].prior.kernels)
    learned = 0 if isinstance(model.noise_variance_bounds, str) else 1
    if training.constant.any():  # certain of y, a model of it alone would decide
        return None
    if training.counts.min() < TOLD * (alone.kernel.n_dims + learned):
        return None
    names = "alpha", "sample_weight", "repeat_variance"
    known = dict(zip(names, given, strict=True))
    levels = model._has_levels()
    alone = Alone(alone.set_params(verbose=0), X, y, levels=levels, **known)
    copies = count_copies(training.features, training.codes, training.Y)
    return None if not copies and alone.is_exact_by_chance() else alone
