"""Random public calls on random small inputs: a right answer or a clear error.

A case is one estimator, one table and the calls that can be made with them, all drawn
from the case's own seed: `--case K` runs one alone. What is legal must work, whatever
is not must end in an error of a documented class, and neither may print, warn of
anything but the package's own, or change what it should not.
"""

import argparse
import contextlib
import pickle
import signal
import sys
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from fuzz_book import by_the_book
from fuzz_calls import ERRORS, Wrong, attempt, require, watched
from fuzz_inputs import make_estimator, make_problem
from fuzz_wide import WideCase
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import Pipeline

from skmtgp import add_task, exceptions, metrics
from skmtgp._estimators.base import BaseMultiTaskGP
from skmtgp._numerics import memory as _memory
from skmtgp._numerics.parallel import ONE_THREAD
from skmtgp.model_selection import TaskStratifiedKFold

# Seconds of the processor for a case, with draws three times; on the clock ten times
LONGEST = 30


def blas_threads():
    return [library.num_threads for library in ONE_THREAD.libraries]


def quietly(call, *args):
    """Call, whatever it warns of."""
    with contextlib.suppress(ERRORS):
        call(*args)


def shape_of(values):
    """What np.shape says, also of rows of several lengths."""
    try:
        return np.shape(values)
    except ValueError:
        return f"{len(values)} rows of several lengths"


@dataclass
class Case:
    """One estimator and its data.

    Attributes
    ----------
    seed : list of int
        Where all of it comes from.
    rng : numpy.random.Generator
        Draws the rest.
    problem : Problem
        Data, and whether they can be used.
    estimator : estimator
        Not fitted.
    usable, legal : bool
        Whether fit may succeed, and whether it must.
    """

    seed: list

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.problem = make_problem(self.rng)
        self.estimator, legal = make_estimator(self.rng, self.problem)
        self.usable = legal and self.problem.fault is None
        self.legal = self.usable and not self.problem.doubtful

    def __str__(self):
        shape = shape_of(self.problem.X), shape_of(self.problem.y)
        faults = self.problem.fault, self.problem.wrong, "illegal or doubtful"
        kind = "legal" if self.legal else next(filter(None, faults))
        return f"{self.estimator!r} on {shape[0]} and {shape[1]}, {kind}"

    def run(self):
        """Make the calls; raises Wrong."""
        self.check_unfitted()
        model = self.fit()
        wrong = self.problem.wrong
        require(not wrong or model is None, f"{wrong} was taken")
        doubtful = self.problem.doubtful and self.problem.fault is None
        if model is None or not (self.legal or (self.usable and doubtful)):
            return  # the tasks may be another column
        calls = [
            self.check_tasks,
            self.check_by_the_book,
            self.check_threads,
            self.check_memory,
            self.check_predictions,
            self.check_terms,
            self.check_more_rows,
            self.check_samples,
            self.check_likelihood,
            self.check_copies,
            self.check_new_data,
            self.check_scores,
            self.check_new_task,
            self.check_left_out,
            self.check_splits,
        ]
        for k in self.rng.permutation(len(calls)):
            before = pickle.dumps(model)
            calls[k](model)
            same = pickle.dumps(model) == before
            require(same, f"{calls[k].__name__} changed the model")
        self.check_refit(model)

    def check_unfitted(self):
        repr(self.estimator)
        attempt("repr in HTML", self.estimator._repr_html_)
        params = self.estimator.get_params()
        attempt("predict before fit", self.refused, NotFittedError)
        attempt("clone", clone, self.estimator)
        after = self.estimator.get_params()
        same = all(after[name] is value for name, value in params.items())
        require(same and after.keys() == params.keys(), "parameters changed")

    def refused(self, kind):
        try:
            self.estimator.predict(self.problem.new)
        except kind:
            return
        raise Wrong("predict worked before fit")

    def fit(self):
        """The fitted model, or None where fit was refused."""
        before = dict(vars(self.estimator))
        X, y = self.problem.X, self.problem.y
        known = self.problem.known
        model = attempt("fit", self.estimator.fit, X, y, legal=self.legal, **known)
        if model is None and not isinstance(self.estimator, Pipeline):
            after = vars(self.estimator)
            same = all(after.get(name) is value for name, value in before.items())
            require(same and after.keys() == before.keys(), "fit failed half-way")
        return model

    def fit_again(self, model):
        """A clone, fitted to the same."""
        return clone(model).fit(self.problem.X, self.problem.y, **self.problem.known)

    def check_predictions(self, model):
        noisy = {"include_noise": bool(self.rng.integers(2))}
        for X in (self.problem.X, self.problem.new):
            mean = attempt("predict", model.predict, X)
            again, std = attempt("std", model.predict, X, return_std=True, **noisy)
            third, cov = attempt("cov", model.predict, X, return_cov=True, **noisy)
            require(np.array_equal(mean, again), "the mean depends on return_std")
            require(np.array_equal(mean, third), "the mean depends on return_cov")
            for name, values in [("mean", mean), ("std", std), ("cov", cov)]:
                require(np.isfinite(values).all(), f"the {name} is not finite")
            require((std >= 0.0).all(), "a standard deviation is negative")
            n = len(mean)
            require((cov[range(n), range(n)] >= 0.0).all(), "a variance is negative")

    def check_tasks(self, model):
        tasks = (model[-1] if isinstance(model, Pipeline) else model).tasks_
        known = set(self.problem.labels.tolist())
        require(set(tasks.tolist()) == known, f"the tasks are {tasks}, not {known}")

    def check_by_the_book(self, model):
        """Exact inference is the textbook's, where that has digits.

        Variances of tasks are larger by what is open of their rows of F.
        """
        exact = isinstance(model, BaseMultiTaskGP) and model.inference_ != "sparse"
        if not exact or model.hyperparameters_ == "sampled":
            return
        found = model.predict(self.problem.new, return_std=True)
        mean, std = (of.reshape(len(of), -1).T for of in found)
        for j in range(len(mean)):
            expected = by_the_book(model, self.problem, j, self.problem.new)
            if expected is None:
                return
            more = (std[j] ** 2 - expected.variance) / expected.prior
            wide = expected.wide & (more > 0.0)
            for what, off in [
                ("mean", (mean[j] - expected.mean) / expected.size),
                ("variance", np.where(wide, 0.0, more)),
            ]:
                worst = np.abs(off).max()
                require(worst < 1e-6, f"the {what} is {worst:.1e} from the textbook's")

    def check_terms(self, model):
        """Its terms, and the trend and level, sum to a prediction."""
        if not hasattr(model, "predict_terms"):
            return
        terms = attempt("predict_terms", model.predict_terms, self.problem.new)
        mean, size = model.predict(self.problem.new), np.abs(terms).max()
        same = np.allclose(terms.sum(axis=-1), mean, rtol=1e-9, atol=1e-9 * size)
        require(same, "the terms do not sum to the prediction")

    def check_more_rows(self, model):
        """Rows that join make the posterior of all rows."""
        if not hasattr(model, "partial_fit") or self.rng.integers(2):
            return
        n, joined = int(self.rng.integers(1, 4)), pickle.loads(pickle.dumps(model))
        rows = self.problem.new[:n], self.problem.y[::2][:n]
        most = [None, len(self.problem.y)][self.rng.integers(2)]
        legal = most is None and "trend=" not in repr(model)
        legal = legal and "noise_variance=0," not in repr(model)
        if attempt(
            "partial_fit", joined.partial_fit, *rows, max_rows=most, legal=legal
        ):
            self.check_by_the_book(joined)
            mean = attempt("predict", joined.predict, self.problem.new)
            require(np.isfinite(mean).all(), "a mean is not finite after partial_fit")

    def check_threads(self, model):
        """Calls at the same time give the same bits, and leave BLAS as it was."""
        if self.rng.integers(4):
            return
        new = self.problem.new
        before, expected = blas_threads(), model.predict(new)
        with watched("threads"), ThreadPoolExecutor(3) as pool:
            fit = pool.submit(quietly, self.fit_again, model)
            calls = [pool.submit(model.predict, new) for _ in range(6)]
            found = [call.result() for call in (*calls, fit)][:-1]
        after = blas_threads()
        require(after == before, f"BLAS had {before} threads and has {after}")
        same = all(np.array_equal(expected, mean) for mean in found)
        require(same, "predictions at the same time differ")

    def check_memory(self, model):
        """Where memory does not suffice, an error says so; else nothing changes."""
        if self.rng.integers(4):
            return
        new = self.problem.new
        left = 10.0 ** self.rng.uniform(1, 6)
        with patch.object(_memory, "available_memory", lambda: left):
            again = attempt("fit", self.fit_again, model, legal=False)
        if again is not None and not self.problem.random:
            same = np.allclose(again.predict(new), model.predict(new), rtol=1e-6)
            require(same, "what memory is left changes results")

    def check_samples(self, model):
        model = model[-1] if isinstance(model, Pipeline) else model
        if model is not self.estimator:
            return
        n = int(self.rng.integers(1, 4))
        draws = attempt("sample_y", model.sample_y, self.problem.new, n)
        require(np.isfinite(draws).all(), "a draw is not finite")
        require(draws.shape[-1] == n, "the number of draws is wrong")
        bad = [-1, 0.5, None, "a"][self.rng.integers(4)]
        attempt("sample_y", model.sample_y, self.problem.new, bad, legal=False)

    def check_likelihood(self, model):
        if not hasattr(model, "log_marginal_likelihood"):
            return
        value = model.log_marginal_likelihood()
        require(np.isfinite(value), f"the likelihood is {value}")
        theta = getattr(model, "best_estimator_", model).theta_
        theta = theta + self.rng.choice([0.0, 0.1, 10.0]) * self.rng.normal(
            size=len(theta)
        )
        evaluate = model.log_marginal_likelihood
        pair = attempt("likelihood", evaluate, theta, eval_gradient=True)
        finite = np.isfinite(pair[0])
        require(finite == np.isfinite(pair[1]).all(), "the gradient is not finite")
        attempt("likelihood", evaluate, theta[1:], legal=False)

    def check_copies(self, model):
        copy = pickle.loads(pickle.dumps(model))
        X = self.problem.new
        same = np.array_equal(copy.predict(X), model.predict(X))
        require(same, "a pickled model predicts something else")
        fresh = clone(model)
        require(repr(fresh) == repr(model), "the clone is another estimator")
        require("tasks_" not in vars(fresh), "the clone is fitted")
        attempt("repr in HTML", model._repr_html_)

    def check_new_data(self, model):
        for X in self.problem.bad_new(self.rng):
            with contextlib.suppress(AttributeError):  # of a pipeline's selection
                attempt("predict", model.predict, X, legal=False)

    def check_scores(self, model):
        X, y = self.problem.X, self.problem.y
        score = attempt("score", model.score, X, y)
        require(len(y) < 2 or np.isfinite(score), f"the score is {score}")
        mean, std = model.predict(X, return_std=True, include_noise=True)
        true, tasks = np.array(y, dtype=float), {"tasks": self.problem.labels}
        nmse, msll, coverage = (
            metrics.normalized_mean_squared_error,
            metrics.mean_standardized_log_loss,
            metrics.coverage,
        )
        attempt("nMSE", nmse, true, mean, **tasks, legal=False)  # y may be constant
        options = tasks | {"y_train": true}
        attempt("MSLL", msll, true, mean, std, **options, legal=False)
        attempt("coverage", coverage, true, mean, std, **tasks, legal=False)

    def check_splits(self, model):
        """Every training set has every task, or the split is refused."""
        n_splits = int(self.rng.integers(0, 5))
        X, y = self.problem.X, self.problem.y

        def split():
            folds = TaskStratifiedKFold(n_splits, task_feature=self.problem.position)
            return list(folds.split(X, y))

        labels = self.problem.labels
        for train, _ in attempt("split", split, legal=False) or []:
            known = len(np.unique(labels[train])) == self.problem.n_tasks
            require(known, "a training set lacks a task")

    def check_new_task(self, model):
        if not hasattr(model, "add_task") and not isinstance(model, Pipeline):
            return
        X, y, legal = self.problem.novel(self.rng)
        able = hasattr(model[-1] if isinstance(model, Pipeline) else model, "add_task")
        prior = [None, "tasks"][self.rng.integers(2)]
        legal = legal and able and "trend_per_task=True" not in repr(model)
        legal = legal and "noise_variance=0," not in repr(model)
        extended = attempt("add_task", add_task, model, X, y, prior=prior, legal=legal)
        if extended is not None:
            means = attempt("predict", extended.predict, X)
            require(np.isfinite(means).all(), "the mean of a new task is not finite")

    def check_left_out(self, model):
        if not hasattr(model, "loo_predict"):
            return
        sparse = "inference='sparse'" in repr(model)  # whose digits end earlier
        warns = (exceptions.NegativeVarianceWarning,) * sparse
        legal = "trend=" not in repr(model)  # of which a row may tell all
        calls = model.loo_predict
        found = attempt("loo_predict", calls, warns=warns, legal=legal)
        if found is None:
            return
        mean, std = found
        finite = np.isfinite(mean).all() and np.isfinite(std).all()
        require(finite and (std >= 0.0).all(), "loo_predict is not finite")

    def check_refit(self, model):
        before = dict(vars(model))
        bad = np.full(len(self.problem.y), np.nan)
        attempt("fit", model.fit, self.problem.X, bad, legal=False)
        if not isinstance(model, Pipeline):
            same = all(vars(model).get(name) is v for name, v in before.items())
            require(same and vars(model).keys() == before.keys(), "fit half-failed")
        again = attempt("fit", self.fit_again, model)
        X = self.problem.new
        same = np.allclose(again.predict(X), model.predict(X), rtol=1e-6)
        require(same or self.problem.random, "fit depends on what was fitted before")


def overdue(*_):
    raise TimeoutError("the case took too long")


def limit(seconds):
    """Let a case be overdue after so long; a busy machine does not count. 0 ends it."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.alarm(10 * seconds)


def make_case(seed, k):
    """One case of twelve is a table with a column for each task."""
    return (Case if k % 12 else WideCase)([seed, k])


def run_case(seed, k):
    """What was wrong with a case, or None."""
    case = None
    try:
        case = make_case(seed, k)
        limit(LONGEST * (3 if "sampled" in str(case) else 1))
        case.run()
    except Exception as error:
        why = str(error) if isinstance(error, Wrong) else traceback.format_exc()
        return f"case {k}: {case}\n    {why}"
    finally:
        limit(0)
    return None


def read_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=2000, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of all cases")
    parser.add_argument("--case", type=int, help="run this one alone")
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after")
    parser.add_argument("--verbose", action="store_true", help="describe each case")
    return parser.parse_args()


def main():
    options = read_arguments()
    signal.signal(signal.SIGALRM, overdue)
    signal.signal(signal.SIGPROF, overdue)
    cases = range(options.cases) if options.case is None else [options.case]
    begin, failures, done = time.perf_counter(), 0, 0
    for k in cases:
        if time.perf_counter() - begin > 60.0 * options.minutes:
            break
        if options.verbose:
            print(f"case {k}: {make_case(options.seed, k)}", flush=True)
        wrong = run_case(options.seed, k)
        done += 1
        if wrong:
            failures += 1
            print(
                f"{wrong}\n    again: python tests/fuzz.py --seed {options.seed} "
                f"--case {k}",
                flush=True,
            )
    seconds = time.perf_counter() - begin
    print(f"{done} cases in {seconds:.0f} s, {failures} failed")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
