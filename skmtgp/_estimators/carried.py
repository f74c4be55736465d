"""What the tasks of a fit tell of the errors of another one."""

from weakref import WeakKeyDictionary

import numpy as np

from skmtgp.inference.left_out import inflation
from skmtgp.inference.posterior import freedom_of_noise, residuals_of_noise
from skmtgp.learning.identifying import Learned

INFLATIONS, NOISES, FLOORS = (WeakKeyDictionary() for _ in range(3))  # of posteriors
AT_BOUND = 1e-3  # how near a logarithm must be
# Deviation of the model's own error, relative to the targets: at least, and how many
# times that of f at rows with noise (benchmarks/known_tasks.py)
FLOOR, TIMES, ROWS_ASKED = 1e-4, 2.0, 300
LEAST_SHARE = 0.01  # of the noise: with less of it covariances have too few digits


def learned_from(model, centre, scale):
    """The tasks that a model was learned from, as another one has their errors.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Fitted, with descriptors.
    centre, scale : ndarrays of shape (n_descriptors,) and (n_descriptors, n_u)
        Descriptors of the other task are centre + scale u.

    Returns
    -------
    learned : list of n_outputs Learned
    """
    descriptors = model._descriptors
    Q = descriptors.rows(descriptors.learned)
    tables = descriptors.rows(np.vstack([centre, centre + scale.T]))
    c, *others = tables @ Q.T / len(Q)  # Q^T Q is n_tasks I
    shares = c, (np.array(others) - c).T
    return [Learned(*shares, _factor(posterior, Q)) for posterior in model._posteriors]


def _factor(posterior, Q):
    """Rows of F of the tasks, without the function that all share."""
    prior = posterior.prior
    loadings, _ = prior.unseen(posterior.theta, Q)
    return loadings[:, int(prior.task_covariance.shared) :]


def inflation_of(model, j):
    """How much larger the variance of another task is than the posterior's.

    It is told once for each posterior. Without descriptors it is 1.
    """
    descriptors, posterior = model._descriptors, model._posteriors[j]
    if descriptors is None:
        return 1.0
    if posterior not in INFLATIONS:
        INFLATIONS[posterior] = inflation(
            model._likelihoods[j], posterior.theta, usual_variances(descriptors)
        )
    return INFLATIONS[posterior]


def usual_variances(descriptors):
    """Variances of errors of tasks that are left out, in units of the posterior's.

    1 - h if the coefficients were learned from the task, too, and 1 + h if not.
    """
    table, learned = descriptors.table, descriptors.learned
    h = np.square(descriptors.Q).sum(axis=1) / len(learned)
    counted = (table[:, None] == learned).all(axis=2).any(axis=1)
    return np.where(counted, np.maximum(1.0 - h, 0.0), 1.0 + h)


def errors_of(model, j, floor, told):
    """Variances of the model's own error, relative to a task's prior variance.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Fitted.
    j : int
        The output.
    floor : "auto" or float
        Deviation relative to the targets: the prior's variance may be hundreds of times
        theirs.
    told : bool
        Whether the errors of another task are told otherwise.

    Returns
    -------
    errors : ndarray of shape (n_tasks + 1,)
        Of each task, and of another one.
    """
    posterior, auto = model._posteriors[j], isinstance(floor, str)
    floors = np.full(len(model.tasks_) + 1, _floor_of(model, j) if auto else floor)
    if auto:
        floors[-1] = 0.0 if told else FLOOR
    spread = _variance_of_targets(model, j)
    of_tasks = np.diagonal(posterior.K_rho).mean()
    of_prior = of_tasks * posterior.kernel.diag(model.X_train_).mean()
    return np.square(floors) * spread / of_prior


def _variance_of_targets(model, j):
    """In the model's units."""
    targets = model.y_train_.reshape(-1, len(model._posteriors))[:, j]
    return targets.var() / np.square(model._units.scale[j, 0])


def _floor_of(model, j):
    """Deviation of the model's own error where nobody says it, told once.

    Rows with noise do not tell how wrong the model is, but it is seldom much better
    than what they tell of f.
    """
    posterior = model._posteriors[j]
    if posterior not in FLOORS:
        n = len(model.X_train_)
        some = np.arange(0, n, max(1, n // ROWS_ASKED))
        rows = model.X_train_[some], model.tasks_train_[some]
        told = posterior.variance(*rows).mean()
        told = np.sqrt(told / _variance_of_targets(model, j))
        noisy = not _at_bound(posterior).all()
        FLOORS[posterior] = max(FLOOR, TIMES * told) if noisy else FLOOR
    return FLOORS[posterior]


def _at_bound(posterior):
    """Which noise variances ended at their lower bounds."""
    prior, of_noise = posterior.prior, posterior.prior.of_noise
    return posterior.theta[of_noise] < prior.bounds()[0][of_noise] + AT_BOUND


def noise_of(model, j, more, told):
    """Noise variance of samples of each task, and of another, in the model's units.

    Parameters
    ----------
    model : MultiTaskGPRegressor
        Fitted.
    j : int
        The output.
    more : float
        Standard deviation of noise that comes on top, in units of y.
    told : bool
        Whether the other task has no more noise than residuals of the fit show.
    """
    posterior = model._posteriors[j]
    noise = posterior.prior.values(posterior.theta).noise
    of_another = noise * _share_of_noise(model, j) if told else noise
    noise = np.broadcast_to(noise, len(model.tasks_))
    usual = np.exp(np.log(np.broadcast_to(of_another, len(noise))).mean())
    return np.append(noise, usual) + np.square(more / model._units.scale[j, 0])


def _share_of_noise(model, j):
    """What residuals show of each noise variance that ended at its lower bound."""
    posterior, likelihood = model._posteriors[j], model._likelihoods[j]
    is_fixed = isinstance(model.noise_variance_bounds, str)
    if is_fixed or not model._engine.exact:
        return 1.0
    if posterior not in NOISES:
        lowest = _at_bound(posterior)
        shown = residuals_of_noise(likelihood, posterior)
        shown = shown / freedom_of_noise(likelihood, posterior)
        NOISES[posterior] = np.where(lowest, np.clip(shown, LEAST_SHARE, 1.0), 1.0)
    return NOISES[posterior]
