"""Criteria that choose among candidates: forms of K^rho, and single tasks."""

from time import perf_counter

import numpy as np
from scipy.stats import norm
from sklearn.base import clone

from skmtgp._data.complete import count_copies
from skmtgp._estimators.fitted import evidence_of
from skmtgp._estimators.ranks_of_terms import rank_column
from skmtgp._support.warnings import collect_warnings, warn
from skmtgp.exceptions import LongFitWarning
from skmtgp.learning.contenders import uncounted, weighed
from skmtgp.learning.problem import Problem
from skmtgp.learning.tuning import TUNING
from skmtgp.learning.weighing import (
    evidence_of_form,
    evidences_in_reach,
    log_density_left_out,
    summed,
)

ALONE = "single tasks"
LATER = "laplace", "sampled", "auto"  # what is done once a model is chosen


class Alone:
    """A candidate beside the forms of a multi-task model: a model of each task.

    Parameters
    ----------
    estimator : SingleTaskGP
        Is fitted. Draws of its hyperparameters, or Laplace's method, wait until it is
        chosen.
    X, y : array-like
        Training data.
    levels : bool, default=False
        Whether the mean of each task has a prior around the one that is subtracted.
    **known
        What `fit` takes of the noise of rows.
    """

    def __init__(self, estimator, X, y, *, levels=False, **known):
        self.data, self.asked = (X, y), estimator.hyperparameters
        self.levels, self.known = levels, known
        if self.asked in LATER:
            estimator.set_params(hyperparameters="mode")
        begin = perf_counter()
        with collect_warnings() as self.collected:
            self.estimator = estimator.fit(X, y, **known)
        self.seconds = perf_counter() - begin

    def chosen(self):
        """The fitted estimator; what its fit warned of is said now."""
        if self.asked in LATER:
            model = clone(self.estimator).set_params(hyperparameters=self.asked)
            return model.fit(*self.data, **self.known)
        for category, message in self.collected:
            if category is not LongFitWarning:  # it has been
                warn(message, category)
        return self.estimator

    def is_exact_by_chance(self):
        """Whether a task has no noise as rows repeat others, with their targets.

        Where those of other tasks do not, that is by chance: y has few values. Its
        likelihood is as high as the least noise lets it be.
        """
        return any(map(_exact_copies, self.estimator.estimators_))

    def leave_out(self, _):
        """Log density of each target given the others of its task, summed."""
        return sum(map(_density_of_others, self.estimator.estimators_))

    def evidence(self, training):
        """Log evidence by Laplace's method, summed over the tasks.

        Their priors are in units of each task. Where the other candidates have the same
        units for all, these count as a parameter of the task, and so does a mean that
        has no prior. One that has a prior pays for its distance from the others.
        """
        found = sum(map(evidence_of, self.estimator.estimators_))
        if training.units.own_scales:
            return found
        n_more = len(training.units.scale) * (1 if self.levels else 2)
        found -= 0.5 * n_more * np.log(np.maximum(training.measured, 1.0)).sum()
        return found - (self._spread_of_means(training.units) if self.levels else 0.0)

    def _spread_of_means(self, units):
        """Nats by which means of tasks are less likely than around one of their own.

        Their prior has the deviation of a task; beside others it is that of all means.
        """
        models = self.estimator.estimators_
        means = np.array([np.ravel(model.y_mean_) for model in models])
        if units.own_centres:  # the others have what is left of far levels
            means = means - units.centre.T
        scales = np.array([np.ravel(model.y_scale_) for model in models])
        with np.errstate(divide="ignore"):
            nats = 0.5 * (1.0 + np.log(means.var(axis=0) / scales**2))
        return float(np.maximum(nats, 0.0).sum())


def _exact_copies(estimator):
    variance = np.ravel(estimator.noise_variance_ / np.square(estimator.y_scale_))
    if variance.min() > TUNING.held:
        return False
    Y = estimator.y_train_.reshape(len(estimator.y_train_), -1)
    return count_copies(estimator.X_train_, estimator.tasks_train_, Y) > 0


def _density_of_others(estimator):
    found = estimator.loo_predict(include_noise=True)
    return float(norm.logpdf(estimator.y_train_, *found).sum())


def criterion_of(asked, of_forms, modes):
    """The criterion that is to choose, and among which forms.

    Of "auto" it is laplace among those near the best, where it can be computed, and
    otherwise bic. It can where learning is exact, in memory, of one term and of few
    rows, and where the forms near the best have few hyperparameters, were learned to
    the end, and one of them has noise.
    """
    if asked != "auto":
        return asked, None
    near = weighed(of_forms, modes)
    return ("laplace", near) if near else ("bic", None)


def tabulate(training, of_forms, modes, alone, criterion, among, n_jobs=None):
    """The table of criteria, one row for each form, and one for single tasks.

    Parameters
    ----------
    training : Training
        What was learned from.
    of_forms : list of list of Problem
        For each form of K^rho and each output.
    modes : list of list of Mode
        Their modes.
    alone : Alone or None
        The tasks learned alone, if they are a candidate.
    criterion : str
        The one that chooses: what takes time is only computed for it.
    among : list of int or None
        Positions of the forms that it may choose: of the others it is NaN, and of those
        that cannot be the best. None means that it is computed of all.
    n_jobs : int, default=None
        Processes.

    Returns
    -------
    table : dict of str to ndarray of shape (n_candidates,)
    """
    jacobian = training.log_jacobian()
    pairs = zip(of_forms, modes, strict=True)
    values = np.array([list(map(Problem.log_likelihood, *of)) for of in pairs])
    values = values + jacobian
    forms = [of_form[0].prior.task_covariance for of_form in of_forms]
    names, ranks = [str(form) for form in forms], [form.rank for form in forms]
    count = [sum(of.prior.n_hyperparameters for of in of_form) for of_form in of_forms]
    spared = [_spared(*of, forms) for of in zip(of_forms, modes, strict=True)]
    seconds = [sum(mode.seconds for mode in of_rank) for of_rank in modes]
    if alone is not None:
        values = np.vstack([values, alone.estimator.log_marginal_likelihoods_])
        names, ranks = [*names, ALONE], [*ranks, 0]
        count.append(alone.estimator.n_hyperparameters_)
        spared.append([0, 0.0])
        seconds.append(alone.seconds)
    n = training.measured.sum() * len(modes[0])
    table = {"rank": rank_column(ranks), "model": names}
    table |= _information(values.sum(axis=1), np.array(count), np.array(spared), n)
    if criterion in DENSITIES:
        of_form, of_alone = DENSITIES[criterion]
        if among is None:
            scaled = summed(of_form, of_forms, modes, n_jobs)
        else:
            scaled = _chosen_from(of_forms, modes, among, n_jobs)
        beside = [] if alone is None else [of_alone(alone, training)]
        table[criterion] = -2.0 * np.append(scaled + jacobian.sum(), beside)
    table["fit_time"] = seconds
    if not training.single_output:
        table |= {_of_output(j): column for j, column in enumerate(values.T)}
    return {name: np.asarray(column) for name, column in table.items()}


def _chosen_from(of_forms, modes, among, n_jobs):
    """Evidences of the forms that they choose from; NaN of the others."""
    some = [of_forms[k] for k in among], [modes[k] for k in among]
    told = evidences_in_reach(*some, n_jobs)
    found = np.full(len(of_forms), np.nan)
    found[among] = np.where(np.isfinite(told), told, np.nan)
    return found


def _spared(problems, modes, forms):
    """Numbers of a diagonal that do not count, and what that costs.

    Where the user asks for a diagonal all forms have one, and all numbers count.
    """
    if all(getattr(form, "n_own", 0) for form in forms):
        return 0, 0.0
    return np.sum([uncounted(*of) for of in zip(problems, modes, strict=True)], axis=0)


def _information(log_likelihood, n_hyperparameters, spared, n):
    """What follows from log likelihoods, counts of hyperparameters and of targets."""
    deviance, log_n = -2.0 * log_likelihood, np.log(n)
    vanished, choices = spared.T
    count = n_hyperparameters - vanished
    return {
        "log_marginal_likelihood": log_likelihood,
        "n_hyperparameters": n_hyperparameters,
        "bic": deviance + count * log_n + 2.0 * choices,  # eq. 8
        "aic": deviance + count * 2.0,
        "hqc": deviance + count * 2.0 * np.log(max(log_n, 1.0)),
    }


def _of_output(j):
    """The column of an output's likelihood."""
    return f"output{j}_log_marginal_likelihood"


# Log densities of y: of a form of the multi-task model, and of single tasks.
DENSITIES = {
    "loo": (log_density_left_out, Alone.leave_out),
    "laplace": (evidence_of_form, Alone.evidence),
}
