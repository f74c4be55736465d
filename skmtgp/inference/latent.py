"""Latent functions behind a task covariance: shared ones, and tasks' own."""

from functools import singledispatch

import numpy as np

from skmtgp._support.guide import INFERENCE
from skmtgp.model.task_covariance import FixedTaskCovariance, LowRank, WithDiagonal


@singledispatch
def latent_functions(form, parameters):
    """How the tasks share latent functions: K^rho = F F^T + diag(kappa).

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank or WithDiagonal
        Form of K^rho. Another one is registered here and with `pull_back`.
    parameters : ndarray of shape (n_parameters,)
        Its parameters.

    Returns
    -------
    F : ndarray of shape (n_tasks, rank)
        A column of zeros where tasks share nothing.
    kappa : ndarray of shape (n_tasks,)
        Variances of the tasks' own functions.

    Raises
    ------
    ValueError
        If it is not known of the form.
    """
    raise _unknown(form)


@latent_functions.register
def _(form: FixedTaskCovariance, parameters):
    K_rho = form.matrix(parameters)
    if (K_rho == np.diag(np.diagonal(K_rho))).all():
        return np.zeros((form.n_tasks, 1)), np.diagonal(K_rho)
    return form.factor(parameters), np.zeros(form.n_tasks)


@latent_functions.register
def _(form: LowRank, parameters):
    return form.columns(parameters), np.zeros(form.n_tasks)


@latent_functions.register
def _(form: WithDiagonal, parameters):
    inner, log_kappa = np.split(parameters, [form.form.n_parameters])
    F, kappa = latent_functions(form.form, inner)
    return F, kappa + np.exp(log_kappa)


@singledispatch
def pull_back(form, parameters, d_F, d_kappa):
    """Gradient of the parameters of K^rho, from those of F and kappa."""
    raise _unknown(form)


@pull_back.register
def _(form: FixedTaskCovariance, parameters, d_F, d_kappa):
    return np.empty(0)


@pull_back.register
def _(form: LowRank, parameters, d_F, d_kappa):
    return d_F.ravel()


@pull_back.register
def _(form: WithDiagonal, parameters, d_F, d_kappa):
    inner, log_kappa = np.split(parameters, [form.form.n_parameters])
    gradient = pull_back(form.form, inner, d_F, d_kappa)
    return np.concatenate([gradient, d_kappa * np.exp(log_kappa)])


def check_latent(form):
    """Raise a ValueError where the latent functions of a form are not known.

    Parameters
    ----------
    form : FixedTaskCovariance, LowRank, WithDiagonal or another
        Form of K^rho.
    """
    while isinstance(form, WithDiagonal):
        form = form.form
    for function in (latent_functions, pull_back):
        if function.dispatch(type(form)) is function.dispatch(object):
            raise _unknown(form)


def _unknown(form):
    return ValueError(
        "inference='sparse' needs the latent functions of the task covariance, which "
        f"are not known of {type(form).__name__}. Set inference='dense', or "
        "'kronecker' for complete data, or register the class with latent_functions "
        f"and pull_back of skmtgp.inference.latent. {INFERENCE}"
    )
