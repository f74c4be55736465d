"""What tests of inference and learning build: the one place that knows how."""

from dataclasses import replace

import numpy as np

from skmtgp._data.complete import design_of
from skmtgp._data.data import Data
from skmtgp.inference.dense import DenseLikelihood
from skmtgp.inference.engines import Dense, Kronecker
from skmtgp.inference.extended import ExtendedLikelihood
from skmtgp.inference.kronecker import KroneckerLikelihood
from skmtgp.inference.sparse import BLOCK, SparseBound
from skmtgp.learning.problem import Budget, Problem
from skmtgp.learning.tuning import TUNING
from skmtgp.model.prior import Prior


def prior(kernel, form, n_noise=1, levels=False, **options):
    return Prior(kernel, form, n_noise, levels, **options)


def dense(kernel, form, X, tasks, y, n_noise=1, **options):
    return DenseLikelihood(prior(kernel, form, n_noise, **options), X, tasks, y)


def kronecker(kernel, form, X, tasks, y, n_noise=1, **options):
    return KroneckerLikelihood(prior(kernel, form, n_noise, **options), X, tasks, y)


def extended(kernel, form, X, tasks, y, n_noise, novel, **options):
    model = prior(kernel, form, n_noise, **options)
    return ExtendedLikelihood(model, X, tasks, y, novel)


def sparse(kernel, form, X, tasks, y, Z, n_noise=1, block_size=BLOCK, **options):
    model = prior(kernel, form, n_noise, **options)
    return SparseBound(model, X, tasks, y, Z, block_size)


def parts(likelihood, theta):
    """Of theta, or of a gradient: of k^x, of K^rho, of the noise."""
    prior = likelihood.prior
    return np.split(theta, [prior.kernel.n_dims, prior.n_theta - prior.n_noise])


def data(X, tasks, y, n_tasks, complete=False):
    return Data(X, tasks, y, n_tasks, design_of(X, tasks) if complete else None)


ENGINES = {"dense": Dense(), "kronecker": Kronecker()}


def problem(kernel, form, observations, *, scale=1.0, noise=0.1, **changes):
    """With the scale of the targets, and a noise variance in units of its square.

    The changes are those of the prior, the budget, the engine or the constants.
    """
    variance = scale**2
    given = {
        "prior": Prior(
            kernel,
            form,
            scale=scale,
            log_noise=float(np.log(noise * variance)),
            log_noise_bounds=tuple(np.log([1e-10 * variance, 1e3 * variance])),
        ),
        "budget": Budget(max_iter=200, tol=1e-3),
        "tuning": TUNING,
    }
    for name, part in given.items():
        known = changes.keys() & part.__dataclass_fields__.keys()
        given[name] = replace(part, **{key: changes.pop(key) for key in known})
    engine = changes.pop("engine", Dense())
    return Problem(data=observations, engine=engine, **given, **changes)
