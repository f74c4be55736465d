"""What the tasks' relations are worth to the likelihood."""

from dataclasses import replace

import numpy as np

from skmtgp._numerics.parallel import limit_threads
from skmtgp.inference.engines import Kronecker, choose
from skmtgp.model.task_covariance import FixedTaskCovariance


class Apart(FixedTaskCovariance):
    """K^rho as learned, but that one task has nothing in common with the others.

    Parameters
    ----------
    form : LowRank, FixedTaskCovariance or another
        Form of K^rho.
    parameters : ndarray of shape (n_parameters,)
        As learned.
    task : int
        Which one. Its function keeps its variance.
    """

    def __init__(self, form, parameters, task):
        K = np.array(form.matrix(parameters))
        own, K[task], K[:, task] = K[task, task], 0.0, 0.0
        K[task, task] = own
        super().__init__(K)
        self.form, self.learned, self.task = form, parameters, task

    def latent(self, parameters):
        """F and kappa: the task has a function of its own alone."""
        F, kappa = map(np.array, self.form.latent(self.learned))
        F[self.task], kappa[self.task] = 0.0, self._matrix[self.task, self.task]
        return F, kappa


def evidence_of_relations(model, output):
    r"""How much likelier the targets are than if a task had no relation to others.

    Parameters
    ----------
    model : FittedGP
        Fitted, to rows that it has kept.
    output : int
        Which of its outputs.

    Returns
    -------
    evidence : ndarray of shape (n_tasks,)
        In nats: log p(y_m | y of the other tasks) - log p(y_m) for each task m, at the
        hyperparameters as learned. Of sparse inference the difference of two bounds.
    """
    training, likelihood = model._training(), model._likelihoods[output]
    theta = model._thetas()[output]
    prior, engine = likelihood.prior, model._engine
    if isinstance(engine, Kronecker):  # no more, if a task has joined
        engine = choose("auto", prior, training)
    data = training.data(engine)[output]
    data = data if engine.exact else replace(data, Z=likelihood.inputs)
    of_terms = prior.terms, prior.theta_of_terms(theta)
    terms = [(k, form, rho) for (k, form), (_, rho) in zip(*of_terms, strict=True)]
    found = []
    with limit_threads(model._side):
        for task in range(len(model.tasks_)):
            apart = prior.with_terms(
                [(kernel, Apart(form, rho, task)) for kernel, form, rho in terms]
            )
            other = engine.likelihood(apart, data)
            found.append(other.value(apart.with_rho(theta, np.empty(0))))
    return model._posteriors[output].log_likelihood - np.array(found)
