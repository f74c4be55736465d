"""Cases of the fuzz with a column for each task, and gaps."""

import pickle
from dataclasses import dataclass

import numpy as np
import pandas as pd
from fuzz_calls import attempt, require
from fuzz_inputs import Problem, fixed_model, make_features, multi_model, single_model
from sklearn.base import clone

from skmtgp import WideRegressor, stack_tasks, unstack_tasks

FAULTS = {
    "no value": lambda Y: np.where(np.arange(Y.shape[1]) == 0, np.nan, Y),
    "infinity": lambda Y: np.where(np.arange(len(Y))[:, None] == 0, np.inf, Y),
    "short y": lambda Y: Y[:-1],
    "complex y": lambda Y: Y + 1j,
    "y in three dimensions": lambda Y: Y[:, :, None],
    "no columns": lambda Y: Y[:, :0],
    "text": lambda Y: np.full(Y.shape, "a"),
    "twice": lambda Y: pd.DataFrame(Y, columns=["a"] * Y.shape[1]),
}


@dataclass
class WideCase:
    """A WideRegressor, and its data.

    Attributes
    ----------
    seed : list of int
        Where all of it comes from.
    rng : numpy.random.Generator
        Draws the rest.
    X, Y : array-like
        Inputs without tasks, and targets with NaN.
    problem : Problem
        The same in rows.
    estimator : WideRegressor
        Not fitted.
    fault : str or None
        What is wrong with Y.
    """

    seed: list

    def __post_init__(self):
        self.rng = rng = np.random.default_rng(self.seed)
        n, p, n_tasks = (int(rng.integers(2, most)) for most in (20, 4, 5))
        F, Y = make_features(rng, n, p), rng.normal(size=(n, n_tasks))
        Y[rng.random(Y.shape) < rng.choice([0.0, 0.05, 0.4])] = np.nan
        Y[0] = rng.normal(size=n_tasks)
        rows, codes = np.nonzero(~np.isnan(Y))
        names = np.arange(n_tasks + 1)
        stacked = F[rows], codes, names, Y[rows, codes], p, "array"
        self.problem, self.fault = Problem(*stacked), None
        makes = [multi_model, multi_model, fixed_model, single_model]
        model = makes[rng.integers(4)](rng, self.problem)
        self.estimator = WideRegressor(model.set_params(task_feature=-1))
        if rng.integers(4) == 0:
            self.fault = list(FAULTS)[rng.integers(len(FAULTS))]
            Y = FAULTS[self.fault](Y)
        self.X, self.Y = self._formed(F, Y)

    def _formed(self, F, Y):
        """The data as a user may have them."""
        way = self.rng.integers(3)
        if way == 0 or self.fault is not None:
            return F, Y
        if way == 1:
            return F.tolist(), [[None if v != v else v for v in y] for y in Y.tolist()]
        columns = [f"x{j}" for j in range(F.shape[1])]
        X = pd.DataFrame(F, columns=columns)
        names = [[f"y{j}" for j in range(Y.shape[1])], range(Y.shape[1])]
        return X, pd.DataFrame(Y, columns=names[self.rng.integers(2)])

    def __str__(self):
        kind = self.fault or ("doubtful" if self.problem.doubtful else "legal")
        return f"{self.estimator!r} on {len(self.X)} rows, {kind}"

    def run(self):
        """Make the calls; raises Wrong."""
        legal = self.fault is None and not self.problem.doubtful
        attempt("predict before fit", self.estimator.predict, self.X, legal=False)
        model = attempt("fit", self.estimator.fit, self.X, self.Y, legal=legal)
        require(self.fault is None or model is None, f"{self.fault} was taken")
        if model is None:
            return
        before = pickle.dumps(model)
        self.check_predictions(model)
        self.check_copies(model)
        self.check_frames(model)
        require(pickle.dumps(model) == before, "a call changed the model")
        again = attempt("fit", clone(model).fit, self.X, self.Y)
        same = np.allclose(again.predict(self.X), model.predict(self.X), rtol=1e-6)
        require(same or self.problem.random, "fit depends on what was fitted before")

    def check_predictions(self, model):
        """They are the model's of the rows, one task after another."""
        n, n_tasks = len(self.X), len(model.outputs_)
        mean, std = attempt("predict", model.predict, self.X, return_std=True)
        lower, upper = attempt("interval", model.predict_interval, self.X)
        draws = attempt("sample_y", model.sample_y, self.X, 2)
        require(mean.shape == std.shape == (n, n_tasks), "the shape is wrong")
        require(draws.shape == (n, n_tasks, 2), "the shape of draws is wrong")
        require((lower <= mean).all() and (mean <= upper).all(), "no interval")
        require(np.isfinite([mean, std]).all() and (std >= 0.0).all(), "not finite")
        F = np.asarray(self.X, dtype=np.float64)
        rows = np.column_stack([np.tile(F, (n_tasks, 1)), np.repeat(range(n_tasks), n)])
        if isinstance(self.X, pd.DataFrame):
            names = np.repeat(model.outputs_, n)
            rows = pd.concat([self.X] * n_tasks).assign(task=names)
        of_rows = model.estimator_.predict(rows).reshape(n_tasks, n)
        require(np.array_equal(of_rows.T, mean), "the mean is not that of the model")
        attempt("predict", model.predict, F[:, :0], legal=False)

    def check_copies(self, model):
        copy = pickle.loads(pickle.dumps(model))
        same = np.array_equal(copy.predict(self.X), model.predict(self.X))
        require(same, "a pickled model predicts something else")
        require(repr(clone(model)) == repr(model), "the clone is another estimator")
        score = attempt("score", model.score, self.X, self.Y)
        counts = np.sum(~pd.isna(pd.DataFrame(self.Y)).to_numpy(), axis=0)
        require(counts.min() < 2 or np.isfinite(score), f"the score is {score}")

    def check_frames(self, model):
        """A frame that was stacked comes back."""
        if not isinstance(self.X, pd.DataFrame):
            return
        columns = list(self.Y.columns)
        X, y = attempt("stack_tasks", stack_tasks, self.X.join(self.Y), columns)
        back = attempt("unstack_tasks", unstack_tasks, X, y)
        whole = self.Y.loc[back.index]
        require(back[columns].equals(whole), "a frame came back another one")
