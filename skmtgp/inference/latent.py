"""Latent functions behind a task covariance: shared ones, and tasks' own."""

import numpy as np

from skmtgp.task_covariance import LowRank, WithDiagonal


def latent_functions(form, parameters):
    """How the tasks share latent functions: K^rho = F F^T + diag(kappa).

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank or WithDiagonal
        Form of K^rho.
    parameters : ndarray of shape (n_parameters,)
        Its parameters.

    Returns
    -------
    F : ndarray of shape (n_tasks, rank)
        A column of zeros where tasks share nothing.
    kappa : ndarray of shape (n_tasks,)
        Variances of the tasks' own functions.
    """
    if isinstance(form, WithDiagonal):
        inner, log_kappa = np.split(parameters, [form.form.n_parameters])
        F, kappa = latent_functions(form.form, inner)
        return F, kappa + np.exp(log_kappa)
    if isinstance(form, LowRank):
        return form.columns(parameters), np.zeros(form.n_tasks)
    K_rho = form.matrix(parameters)
    if (K_rho == np.diag(np.diagonal(K_rho))).all():
        return np.zeros((form.n_tasks, 1)), np.diagonal(K_rho)
    return form.factor(parameters), np.zeros(form.n_tasks)


def pull_back(form, parameters, d_F, d_kappa):
    """Gradient of the parameters of K^rho, from those of F and kappa."""
    if isinstance(form, WithDiagonal):
        inner, log_kappa = np.split(parameters, [form.form.n_parameters])
        gradient = pull_back(form.form, inner, d_F, d_kappa)
        return np.concatenate([gradient, d_kappa * np.exp(log_kappa)])
    return d_F.ravel() if isinstance(form, LowRank) else np.empty(0)
