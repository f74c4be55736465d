"""Models of all joints of a robot, by name, each at its best settings.

A model is a function of a case, and gives a function of X: mean and standard deviation
of observations, of shape (n_samples, n_joints). Put another one into `MODELS`.
"""

import numpy as np
from lwpr import LWPR
from settings import PAPER
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.model_selection import GridSearchCV

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp.kernels import ARDLinear, Columns
from skmtgp.preprocessing import InverseDynamicsFeatures
from skmtgp.robot import (
    RigidBodyFeatures,
    RigidBodyRegressor,
    make_semiparametric_regressor,
)

RANK = 5  # of many tasks; BIC takes it on the Puma, and five functions there are
WIDE = np.exp([-20.0, 8.0])
SYMMETRIC = "viscous", "coulomb", "rotor"
ASYMMETRIC = "viscous", "asymmetric", "rotor"


def both(model):
    """Predictions of observations by a model of all joints."""
    return lambda X: model.predict(X, return_std=True, include_noise=True)


def by_joint(make):
    """A model for each joint."""

    def fit(case):
        fitted = [both(make(case, j).fit(case.X, y)) for j, y in enumerate(case.Y.T)]

        def predict(X):
            found = [of_joint(X) for of_joint in fitted]
            return tuple(np.column_stack(parts) for parts in zip(*found, strict=True))

        return predict

    return fit


def rigid(friction, **options):
    return lambda case: both(
        RigidBodyRegressor(case.urdf, friction=friction, **options).fit(case.X, case.Y)
    )


def rigid_with_prior(case):
    return rigid(case.friction, prior=case.prior)(case)


def rigid_of_one(case, j):
    return RigidBodyRegressor(
        case.urdf, friction=case.friction, joint=j, prior=case.prior
    )


def semiparametric(case, **options):
    options = {"friction": case.friction, "prior": case.prior} | options
    return both(make_semiparametric_regressor(case.urdf, **options).fit(case.X, case.Y))


def with_states(case):
    return semiparametric(case, rest=("friction", "states"))


def semiparametric_of_one(case, j):
    return make_semiparametric_regressor(
        case.urdf, friction=case.friction, prior=case.prior, joint=j
    )


def multi_task(case):
    """The paper's model, of a rank that the rows can tell."""
    n_tasks = len(np.unique(case.X[:, -1]))
    return MultiTaskGPRegressor(rank=min(RANK, n_tasks), **PAPER)


def process(kernel, make):
    """A Gaussian process of the features of a kernel."""

    def of_joint(case, j):
        J = case.Y.shape[1]
        return make_inverse_dynamics_regressor(make(case), kernel=kernel, n_joints=J)

    return by_joint(of_joint)


def pooled(case):
    return PooledGP(noise="shared")


def independent(case):
    return IndependentGP(**PAPER)


def single(case):
    return SingleTaskGP()


class OneProduct:
    """One K^rho for a sum of kernels: links, friction, a squared exponential."""

    def __init__(self, case, joint):
        self.case, self.joint = case, joint

    def fit(self, X, y):
        """Learn one joint."""
        J = self.case.Y.shape[1]
        self.rigid = RigidBodyFeatures(
            self.case.urdf, joint=self.joint, friction=self.case.friction
        ).fit(X)
        self.states = InverseDynamicsFeatures(J, angles="trigonometric").fit(X)
        columns = self.rigid.transform(X)[:, :-1]
        size = np.sqrt(np.square(columns).mean(axis=0))
        self.scale = np.where(size > 1e-10 * size.max(), size, 1.0)
        names = self.rigid.get_feature_names_out()[:-1]
        n = sum(name.startswith(("viscous", "coulomb", "rotor")) for name in names)
        p, d = columns.shape[1], 4 * J
        links = Columns(ARDLinear(1.0, 0.0, WIDE, "fixed"), range(p - n))
        friction = Columns(ARDLinear(np.ones(n), 0.0, WIDE, "fixed"), range(p - n, p))
        rbf = Columns(RBF(np.full(d, 7.0), np.exp([-2.0, 8.0])), range(p, p + d))
        model = multi_task(self.case).set_params(normalize_y=False)
        model.set_params(kernel=links + friction + ConstantKernel(1e-2, WIDE) * rbf)
        self.model = model.fit(self._features(X), y)
        return self

    def _features(self, X):
        columns = self.rigid.transform(X)[:, :-1] / self.scale
        return np.hstack([columns, self.states.transform(X)])

    def predict(self, X, **options):
        """As the model of the features does."""
        return self.model.predict(self._features(X), **options)


class LocallyWeighted:
    """LWPR of each load alone, with the shape of its fields by cross-validation.

    Its deviation is that of what it errs on rows that are left out.
    """

    GRID = {"init_D": [1e-3, 1e-2, 3e-2, 0.1], "alpha": [0.0, 1.0]}
    SETTINGS = {"n_epochs": 20, "add_threshold": 0.9}

    def __init__(self, case, joint):
        self.case = case

    def fit(self, X, y):
        """Learn one joint."""
        self.features = InverseDynamicsFeatures(self.case.Y.shape[1]).fit(X)
        self.centre, self.scale, self.of_load = y.mean(), y.std(), {}
        Z, y = self.features.transform(X)[:, :-1], (y - self.centre) / self.scale
        for load in np.unique(X[:, -1]):
            rows = X[:, -1] == load
            search = GridSearchCV(
                LWPR(**self.SETTINGS), self.GRID, cv=3, scoring="neg_mean_squared_error"
            ).fit(Z[rows].astype(float), y[rows])
            self.of_load[load] = search, np.sqrt(-search.best_score_)
        return self

    def predict(self, X, **options):
        """Means, and the deviation of each load."""
        Z, (mean, std) = self.features.transform(X)[:, :-1], np.empty((2, len(X)))
        for load, (search, deviation) in self.of_load.items():
            rows = X[:, -1] == load
            if rows.any():
                mean[rows] = search.predict(Z[rows].astype(float))
            std[rows] = deviation
        return self.centre + self.scale * mean, self.scale * std


MODELS = {
    "rigid, no friction": rigid(None),
    "rigid, symmetric": rigid(SYMMETRIC),
    "rigid, asymmetric": rigid(ASYMMETRIC),
    "rigid, prior": rigid_with_prior,
    "rigid, each joint": by_joint(rigid_of_one),
    "LWPR": by_joint(LocallyWeighted),
    "pGP": process("paper", pooled),
    "iGP": process("paper", independent),
    "sGP": process("paper", single),
    "mGP paper": process("paper", multi_task),
    "mGP trigonometric": process("trigonometric", multi_task),
    "mGP geometric": process("geometric", multi_task),
    "mGP one product": by_joint(OneProduct),
    "semiparametric": semiparametric,
    "semiparametric, states": with_states,
    "semiparametric, each joint": by_joint(semiparametric_of_one),
}
# Of the one that is recommended: no other model is held against them
VARIANTS = [name for name in MODELS if name.startswith("semiparametric,")]
