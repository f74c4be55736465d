"""A novel task, the paper's section 3.3: theta^x and sigma^2 are frozen.

"It is only this new border which needs to be learned by maximising the marginal
likelihood": with the rank constraint the new task's row of the factor of K^rho, without
it also what the task shares with no other. One or two samples do not determine a row;
unless told otherwise we add what the rows of the tasks so far tell of it.
"""

from functools import cached_property, partial
from time import perf_counter

import numpy as np

from skmtgp._data.known import noise_of
from skmtgp._numerics.bfgs import minimize
from skmtgp._numerics.hmc import sample
from skmtgp._numerics.newton import minimize_all
from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.border import BorderLikelihood
from skmtgp.inference.open_rows import OfRow, axes_of
from skmtgp.learning.problem import Mode
from skmtgp.learning.tuning import TUNING
from skmtgp.model.population import factors_of, mean_square, scale_of_rows

N_WARM, N_DRAWS = 20, 5  # trajectories of a border that is drawn; the last one counts


def learn_novel(
    likelihood,
    posterior,
    theta,
    X,
    y,
    *,
    position,
    own,
    own_noise,
    informed,
    budget,
    known=None,
    trend=None,
    leeway=(),
    rng=None,
):
    """Extend a model by a task of which little is known.

    Parameters
    ----------
    likelihood : Likelihood
        Of the tasks so far.
    posterior : Posterior
        The same at theta.
    theta : ndarray of shape (n_theta,)
        What was learned of them.
    X : ndarray of shape (n_samples, n_features)
        Inputs of the novel task.
    y : ndarray of shape (n_samples,)
        Its targets.
    position : int
        Where it goes among the tasks.
    own : bool, or a list of one for each term
        Whether it may have something that it shares with no other task.
    own_noise : bool
        Whether tasks have noise variances of their own. The new one gets the geometric
        mean of the others', each counted as often as it has rows.
    informed : bool
        Whether the border has the prior of `Population`; maximum likelihood otherwise.
    budget : Budget
        As for the estimators.
    known : Known, default=None
        What is known of the noise of its rows.
    trend : Trend, default=None
        Of all tasks, the novel one counted, if there is a trend.
    leeway : tuple of OfTheta or OfRow, default=()
        What is open of theta and of rows of F.
    rng : Generator, default=None
        Where an informed border is drawn from its posterior, not the mode: the source
        of randomness.

    Returns
    -------
    prior : Prior
        Of one more task.
    mode : Mode
        All parameters of that model; its value is log p(y | the other tasks' targets).

    Raises
    ------
    ValueError
        If the form of K^rho has no factor that a task can be added to.
    """
    begin, prior = perf_counter(), likelihood.prior
    log_noise = likelihood.usual_log_noise(theta)
    factors, shared, equal = shares_of(prior, theta)
    owns = own if isinstance(own, list) else [own]
    of_terms = {"own": owns, "shared": shared, "equal": equal}
    level = prior.values(theta).level
    if trend is not None:
        of_terms["trend"] = trend.rows_of(position, X)
    noise = noise_of(known, np.full(len(y), np.exp(log_noise)))
    with limit_threads(len(y)):
        border = BorderLikelihood(
            posterior, factors, X, y, noise, level=level, **of_terms
        )
        posed = Posed(border, np.hstack(factors))
        best = learn_border(posed, budget, informed=informed, rng=rng)
        value = border.value(best.x)
        of_row = ()
        if informed and rng is None:
            of_row = leeway_of(posed, best.x, position)
    rows, of_own = by_terms(border, best.x, len(factors))
    log_noise = log_noise if own_noise else None
    new = rows, of_own, position, log_noise
    leeway = tuple(of.bordered(prior, theta, *new) for of in leeway) + of_row
    prior, theta = prior.bordered(theta, *new)
    seconds = perf_counter() - begin
    return prior, Mode(theta, value, *best[2:], seconds, len(y), leeway=leeway)


def learn_again(
    likelihood,
    posterior,
    theta,
    X,
    y,
    *,
    task,
    informed,
    budget,
    known=None,
    leeway=(),
    rng=None,
):
    """A novel task's row of F, once there are more samples of it.

    Parameters
    ----------
    likelihood : Likelihood
        Of all tasks, without the samples of this one.
    posterior : Posterior
        The same at theta.
    theta : ndarray of shape (n_theta,)
        Parameters; the task's row of F does not matter.
    X, y, informed, budget, known, rng
        See :func:`learn_novel`.
    task : int
        Position of the task.
    leeway : tuple of OfTheta or OfRow, default=()
        What is open of theta, this row of F counted.

    Returns
    -------
    mode : Mode
        All parameters, with another row of F.
    """
    begin, prior = perf_counter(), likelihood.prior
    with limit_threads(len(y)):
        posed, alone = _posed_again(prior, posterior, theta, X, y, task, known)
        best = learn_border(posed, budget, informed=informed, rng=rng)
        value, of_row = posed.border.value(best.x), ()
        if informed and rng is None:
            of_row = leeway_of(posed, best.x, task)
    rows, own = by_terms(posed.border, best.x, prior.n_terms)
    rows = [_widened(*of) for of in zip(rows, alone, strict=True)]
    for row, w, column in zip(rows, own, alone, strict=True):
        row[column] = w
    of_row = _with_columns(of_row, alone)
    kept = (of for of in leeway if getattr(of, "task", None) != task)
    leeway = tuple(of.with_row(prior, theta, rows, own, task) for of in kept) + of_row
    theta, seconds = prior.with_row(theta, rows, own, task), perf_counter() - begin
    return Mode(theta, value, *best[2:], seconds, len(y), leeway=leeway)


def _posed_again(prior, posterior, theta, X, y, task, known=None):
    """The likelihood of a row of F, and of each term which column is its own.

    `known` is what is known of the noise of the task's rows.
    """
    factors, shared, equal = shares_of(prior, theta)
    diagonals = [form.n_own > 1 for _, form in prior.terms]
    alone = [
        _column_of(task, F) & (not diagonal)
        for F, diagonal in zip(factors, diagonals, strict=True)
    ]
    others = [F[:, ~own] for F, own in zip(factors, alone, strict=True)]
    owns = [d or bool(own.any()) for d, own in zip(diagonals, alone, strict=True)]
    of_terms = {"own": owns, "shared": shared, "equal": equal}
    if prior.trend is not None:
        of_terms["trend"] = prior.trend.rows_of(task, X)
    values = prior.values(theta)
    noise = np.broadcast_to(values.noise, prior.n_tasks)[task]
    noise = noise_of(known, np.full(len(y), noise))
    of_terms["level"] = values.level
    border = BorderLikelihood(posterior, others, X, y, noise, **of_terms)
    return Posed(border, np.delete(np.hstack(others), task, axis=0)), alone


def _with_columns(leeway, alone):
    """What is open of a row, with zeros for the columns that the task has to itself."""
    return tuple(
        of._replace(axes=[_widened(*axes) for axes in zip(of.axes, alone, strict=True)])
        for of in leeway
    )


def _column_of(task, F):
    """Which column of F the task has to itself, a mask, see `LowRank.bordered`."""
    alone = ~np.delete(F, task, axis=0).any(axis=0)
    return alone & (np.cumsum(alone) == 1)


def _widened(rows, alone):
    """Rows of F with zeros for the columns that the task has to itself."""
    whole = np.zeros((*np.shape(rows)[:-1], len(alone)))
    whole[..., ~alone] = rows
    return whole


def join_described(
    likelihood, row, position, own_noise, posterior, theta, *, leeway=(), rng=None
):
    """Extend a model by a task whose descriptors tell all: nothing is learned.

    Parameters
    ----------
    likelihood : Likelihood
        Of the tasks so far.
    row : ndarray of shape (n_rows,)
        What is known of the task, see :class:`~skmtgp.model.described.Described`.
    position, own_noise, theta, leeway
        See :func:`learn_novel`.
    posterior, rng
        Not needed.

    Returns
    -------
    prior : Prior
        Of one more task.
    mode : Mode
        All parameters of that model. Its value is not known.
    """
    prior = likelihood.prior
    own = np.sqrt(prior.unseen(theta, row[None])[1])  # of a diagonal, the mean
    log_noise = likelihood.usual_log_noise(theta) if own_noise else None
    return _joined(prior, theta, leeway, [row], [own], position, log_noise)


def join_alike(
    likelihood, position, own_noise, posterior, theta, *, leeway=(), rng=None
):
    """Extend a model whose tasks are all related alike: nothing is learned.

    Parameters
    ----------
    likelihood : Likelihood
        Of the tasks so far, with a K^rho without a row for each task to learn.
    position, own_noise, theta, leeway
        See :func:`learn_novel`.
    posterior, rng
        Not needed.

    Returns
    -------
    prior : Prior
        Of one more task, whose part of a diagonal is the geometric mean of the others'.
    mode : Mode
        All parameters of that model. Its value is not known.

    Raises
    ------
    ValueError
        If the form of K^rho cannot be extended.
    """
    prior = likelihood.prior
    form = prior.task_covariance
    _check_extensible(form, ["bordered"], "A task that joins")
    [(_, rho)] = prior.theta_of_terms(theta)
    log_kappa = rho[len(rho) - form.n_kappa :]
    own = np.exp(0.5 * log_kappa.mean()) if len(log_kappa) else None
    log_noise = likelihood.usual_log_noise(theta) if own_noise else None
    return _joined(prior, theta, leeway, [None], [own], position, log_noise)


def stay_alike(posterior, theta, *, leeway=(), rng=None):
    """The same as `learn_again` of a task whose relation its rows do not tell.

    The mode is theta as it is. Its value is not known.
    """
    return _known(theta, leeway)


def _joined(prior, theta, leeway, *border):
    """The prior and the mode with a border that is known."""
    leeway = tuple(of.bordered(prior, theta, *border) for of in leeway)
    prior, theta = prior.bordered(theta, *border)
    return prior, _known(theta, leeway)


def _known(theta, leeway):
    """A mode that was not learned."""
    return Mode(theta, np.nan, 0, 0, True, False, 0.0, 0, leeway=leeway)


def shares_of(prior, theta):
    """What tasks have of each term, lists.

    F; what each has of a function that all share alike, None without one; the variance
    of what each has of its own, if all have the same.
    """
    shared, equal = [], []
    of_terms = zip(prior.terms, prior.theta_of_terms(theta), strict=True)
    for (_, form), (_, rho) in of_terms:
        _check_extensible(form)
        shared.append(form.unseen(rho)[0][0, 0] if form.shared else None)
        equal.append(float(np.exp(rho[-1])) if getattr(form, "equal", False) else 0.0)
    return factors_of(prior, theta), shared, equal


def by_terms(border, x, n_terms):
    """The rows l of each term, and w of each; None where there is none."""
    rows = [
        x[: border.rank][border.of_term[: border.rank] == q] for q in range(n_terms)
    ]
    own = dict(zip(border.of_term[border.rank :], x[border.rank :], strict=True))
    return rows, [own.get(q) for q in range(n_terms)]


def _check_extensible(form, needed=("columns", "bordered"), what="add_task"):
    """Raise a ValueError where a form of K^rho cannot get one more task."""
    name, missing = lacking(form, needed)
    if missing:
        raise ValueError(
            f"{what} adds a row to a factor of the task covariance, but {name} has no "
            f"{' and no '.join(missing)}. Fit the model to all tasks, or give the "
            "class these methods."
        )


def lacking(form, needed):
    """The class of a form of K^rho, the innermost one, and what it lacks."""
    while hasattr(form, "form"):
        form = form.form
    return type(form).__name__, [name for name in needed if not hasattr(form, name)]


class Population:
    """The population of the rows of F that the novel task's is taken from.

    A row is ``mean + scale @ u``, with u of unit variance; u is what is learned. Its
    prior is a multivariate t, whose tails are heavy where there are few tasks.

    Parameters
    ----------
    factor : ndarray of shape (n_tasks, rank)
        F.
    own : bool or int
        Whether a w comes last, a standard deviation, or how many. They have no prior.
    """

    def __init__(self, factor, own):
        self.factor, (n_tasks, self.rank) = factor, factor.shape
        self.degrees_of_freedom = max(n_tasks - self.rank, 1)
        self.mean, self.scale = np.zeros(self.rank + own), np.eye(self.rank + own)
        self.mean[: self.rank] = factor.mean(axis=0)
        self.scale[: self.rank, : self.rank] = scale_of_rows(factor)
        self.lower = np.full(self.rank + own, -TUNING.farthest)
        of_own = np.arange(self.rank, self.rank + own)
        self.scale[of_own, of_own] = np.sqrt(mean_square(factor))
        self.lower[of_own] = TUNING.smallest
        self.flat = np.zeros_like(self.scale)  # the identity of what is in the prior
        self.flat[np.diag_indices(self.rank)] = 1.0

    def row(self, u):
        """The row of these coordinates."""
        return self.mean + self.scale @ u

    def coordinates(self, row):
        """The coordinates of a row, or of some, which are columns then."""
        return np.linalg.solve(self.scale, (row.T - self.mean).T)

    def log_prior(self, u):
        """Log density of u but for a constant, and its gradient."""
        shared, nu = u[: self.rank], self.degrees_of_freedom
        distance, gradient = 1.0 + shared @ shared / nu, np.zeros_like(u)
        gradient[: self.rank] = -(nu + self.rank) / nu / distance * shared
        return -0.5 * (nu + self.rank) * np.log(distance), gradient

    def log_priors(self, U):
        """The same of many u, with Hessians."""
        nu, weight = self.degrees_of_freedom, self.degrees_of_freedom + self.rank
        shared = U @ self.flat
        distance = nu + np.einsum("kp,kp->k", shared, shared)
        slopes = shared / distance[:, None]
        hessians = 2.0 * slopes[:, :, None] * slopes[:, None]
        hessians -= self.flat / distance[:, None, None]
        values = -0.5 * weight * np.log(distance / nu)
        return values, -weight * slopes, weight * hessians


class Posed:
    """A border in the coordinates of the population that its row is taken from.

    Parameters
    ----------
    border : BorderLikelihood
        The likelihood.
    factor : ndarray of shape (n_tasks, rank)
        F of the tasks so far.

    Attributes
    ----------
    border : BorderLikelihood
        The likelihood.
    rows : Population
        Of rows.
    is_small : bool
        Whether pairs of latent functions take less than the call of a function.
    """

    def __init__(self, border, factor):
        self.border, self.rows = border, Population(factor, border.own)
        size = len(border.y) * (border.rank + border.own)
        self.is_small = 0 < size <= TUNING.together

    @cached_property
    def pairs(self):
        """The likelihood by the coordinates, of many borders at once."""
        return self.border.pairs(self.rows.mean, self.rows.scale)

    def negative_density(self, informed, u):
        """What is minimised over a row's coordinates u, and its gradient."""
        value, gradient = self.border.value_and_grad(self.rows.row(u))
        gradient = self.rows.scale.T @ gradient
        if informed:
            log_prior, slope = self.rows.log_prior(u)
            value, gradient = value + log_prior, gradient + slope
        return -value, -gradient

    def negative_densities(self, informed, U):
        """The same of many u, with Hessians."""
        found = self.pairs.evaluate(U)
        if informed:
            found = map(np.add, found, self.rows.log_priors(U))
        return map(np.negative, found)

    def information(self, u):
        """Fisher's information of u, with that of the prior."""
        if self.is_small:
            return self.pairs.fisher_information(u) + np.eye(len(u))
        information = self.border.fisher_information(self.rows.row(u))
        return self.rows.scale.T @ information @ self.rows.scale + np.eye(len(u))


def learn_border(posed, budget, *, informed, rng=None):
    """The border that the novel task's samples, and perhaps the prior, tell.

    Parameters
    ----------
    posed : Posed
        The likelihood and the population.
    budget : Budget
        As for the estimators.
    informed : bool
        Whether the prior counts.
    rng : Generator, default=None
        Where it does: x is a draw from the posterior.

    Returns
    -------
    optimum : Optimum
        The best of those that the best starts lead to; x is the row, with w last if
        there is one; evaluations of all.
    """
    rows, border = posed.rows, posed.border
    upper = np.full_like(rows.lower, TUNING.farthest)
    own = TUNING.first * rows.scale[-1, -1] if border.own else 0.0
    starts = rows.coordinates(_starts(border, rows.factor, own).T).T
    starts = np.clip(starts, rows.lower, upper)
    follow = _follow_together if posed.is_small else _follow_each
    optima, n_evaluations = follow(posed, informed, starts, upper, budget)
    best = min(optima, key=lambda optimum: optimum.value)
    if informed and rng is not None:
        objective = partial(posed.negative_density, informed)
        precision = posed.information(best.x)
        chain = _drawn(objective, precision, best.x, rows.lower, rng)
        n_evaluations += chain.n_evaluations
        best = best._replace(x=chain.draws[-1])
    return best._replace(x=rows.row(best.x), n_evaluations=n_evaluations)


def leeway_of(posed, x, task):
    """What the samples and the other tasks leave open of a row of F.

    Parameters
    ----------
    posed : Posed
        See :func:`learn_border`.
    x : ndarray of shape (rank,), or (rank + 1,) with w last
        The row that was learned.
    task : int
        Position of the task.

    Returns
    -------
    leeway : tuple of OfRow
        One, see :mod:`skmtgp.inference.open_rows`, or none where there is no l, or the
        information is not finite.
    """
    border, n_terms = posed.border, len(posed.border.K_x)
    information, _ = border.weighted(x)
    if not (border.rank and np.isfinite(information).all()):
        return ()
    of_l = border.of_term[: border.rank]
    variances = [np.mean(np.diagonal(K_x)) for K_x in border.K_x]
    sizes = np.where(variances, np.sqrt(variances), 1.0)[of_l]
    axes = axes_of(information, posed.rows.factor, sizes)
    return (OfRow(task, [axes[:, of_l == q] for q in range(n_terms)]),)


def _follow_together(posed, informed, starts, upper, budget):
    """Optima of the best starts by Newton's method, and the number of evaluations."""
    objective = partial(posed.negative_densities, informed)
    options = {"max_iter": budget.max_iter, "tol": budget.tol}
    options["followed"] = TUNING.followed
    optima = minimize_all(objective, starts, posed.rows.lower, upper, **options)
    n_steps = sum(optimum.n_evaluations - 1 for optimum in optima)
    return optima, len(starts) + n_steps


def _follow_each(posed, informed, starts, upper, budget):
    """The same by quasi-Newton steps, one start after another."""
    objective = partial(posed.negative_density, informed)
    options = {"metric": posed.information}
    options |= {"max_iter": budget.max_iter, "tol": budget.tol}
    optima = [
        minimize(objective, u, posed.rows.lower, upper, **options)
        for u in sorted(starts, key=lambda u: objective(u)[0])[: TUNING.followed]
    ]
    return optima, len(starts) + sum(optimum.n_evaluations for optimum in optima)


def _drawn(objective, precision, u, lower, rng):
    """A chain of the density exp(-objective) from its mode u."""

    def log_density(u):
        value, gradient = objective(u)
        if (u < lower).any() or not np.isfinite(value):
            return -np.inf, np.zeros_like(u)
        return -value, -gradient

    scale = np.linalg.inv(np.linalg.cholesky(precision)).T
    return sample(log_density, u, scale, rng, n_warm=N_WARM, n_draws=N_DRAWS)


def _starts(border, factor, own):
    """The rows of the tasks so far, their average, and the least-squares fit."""
    fitted = np.linalg.lstsq(border.means.T, border.y, rcond=None)[0]
    rows = np.vstack([factor, factor.mean(axis=0), fitted])
    return np.column_stack([rows, np.full((len(rows), border.own), own)])
