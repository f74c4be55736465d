"""What the Gaussian process regressors share: parameters, and how they are fitted."""

from __future__ import annotations

from abc import ABCMeta, abstractmethod
from dataclasses import replace
from functools import partial
from itertools import chain
from numbers import Integral, Real
from time import time
from typing import Self

from numpy.typing import ArrayLike

from skmtgp._data.trend import NAMED
from skmtgp._estimators.deciding import decide
from skmtgp._estimators.doubts import (
    warn_of_doubts,
    warn_of_duration,
    warn_of_few_rows,
    warn_of_small_tasks,
)
from skmtgp._estimators.estimator import Estimator, fitting, public
from skmtgp._estimators.joining import JoiningGP
from skmtgp._estimators.named_kernels import KERNEL, named_kernel
from skmtgp._estimators.posing import pose
from skmtgp._estimators.reading import names_of_inputs, read, tell_counts
from skmtgp._estimators.revising import revise
from skmtgp._estimators.skew import warn_of_skew
from skmtgp._numerics.parallel import limit_threads
from skmtgp._support.progress import say
from skmtgp._support.sklearn_compat import (
    HasMethods,
    Interval,
    StrOptions,
    fit_context,
    with_callbacks,
)
from skmtgp.inference.engine import Engine
from skmtgp.inference.engines import ENGINES
from skmtgp.learning.forecast import foresee
from skmtgp.learning.problem import Budget
from skmtgp.learning.ranges import along_ranges
from skmtgp.learning.telling import about, in_words
from skmtgp.learning.tuning import TUNING
from skmtgp.model.task_covariance import low_rank

TRANSFORMER = "fit", "transform", "inverse_transform"


class BaseMultiTaskGP(JoiningGP, metaclass=ABCMeta):
    """Base of the Gaussian process regressors with a task column."""

    _parameter_constraints = {
        "kernel": list(KERNEL),
        "task_feature": [Integral, str],
        "noise": [StrOptions({"auto", "shared", "per_task"})],
        "noise_variance": [Interval(Real, 0.0, None, closed="left")],
        "noise_variance_bounds": ["array-like", StrOptions({"fixed"})],
        "normalize_y": ["boolean", StrOptions({"auto", "per_task", "shared"})],
        "trend": [
            StrOptions(set(NAMED)),
            "array-like",
            HasMethods(["fit", "transform"]),
            None,
        ],
        "target_transform": [HasMethods(list(TRANSFORMER)), tuple, None],
        "inference": [StrOptions({"auto", *ENGINES}), Engine],
        "n_inducing": [Interval(Integral, 1, None, closed="left")],
        "inducing_inputs": [StrOptions({"greedy", "k-means", "optimised"})],
        "n_exact": [Interval(Integral, 1, None, closed="left")],
        "hyperparameters": [StrOptions({"mode", "map", "laplace", "sampled", "auto"})],
        "n_draws": [Interval(Integral, 4, None, closed="left")],
        "max_iter": [Interval(Integral, 0, None, closed="left")],
        "tol": [Interval(Real, 0.0, None, closed="neither")],
        "n_jobs": [Integral, None],
        "random_state": ["random_state"],
        "verbose": ["verbose"],
    }

    _parameter_hints = {
        **Estimator._parameter_hints,
        "trend": "Columns of X are a list, such as ['east', 'north']; a quadratic "
        "trend is PolynomialFeatures(2) of scikit-learn.",
        "target_transform": "For logarithms give a function and its inverse, "
        "(np.log, np.exp).",
    }

    @abstractmethod
    def _learn(self, problems, progress):
        """The problem of each output with its form of K^rho, and its mode."""

    @public
    @with_callbacks
    @fit_context(prefer_skip_nested_validation=True)
    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        alpha: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
        repeat_variance: ArrayLike | None = None,
    ) -> Self:
        """Learn the hyperparameters by maximising the marginal likelihood.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Inputs, with the task labels in column `task_feature`. Sparse inference also
            takes Dask arrays and dataframes, whose rows stay where they are.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Targets. Outputs are learned separately. If X is a Dask collection, y has
            the same partitions.
        alpha : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Known noise variance of each sample, in squared units of y. It is added to
            the learned one. A single number holds for all samples. None is 0.
        sample_weight : array-like of shape (n_samples,), default=None
            Number of measurements that each row is the mean of, 1 or more. The noise
            variances are those of a single measurement. The likelihood and the
            posterior are those of all measurements. Rows of weight 0 are left out. None
            is 1.
        repeat_variance : array-like of the shape of y, default=None
            Variance of these measurements around their mean: the sum of squares divided
            by their number, and not by one less. It is 0 for a single measurement. None
            is 0 for all: the measurements were equal, as without noise. See
            :func:`~skmtgp.average_repeats`.

        Returns
        -------
        self : object
            Fitted estimator.

        Raises
        ------
        TypeError
            If X is sparse, or if a label, a feature or a target has a type that cannot
            be used, such as a label that is a tuple.
        ValueError
            If a parameter, a feature, a label or a target cannot be used, or if the
            kernel is not a valid covariance of the features. The estimator is then as
            it was before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            training = read(self, X, y, (alpha, sample_weight, repeat_variance))
            foretell = partial(self._foretell, n_forms=len(self._kernels()))
            training = decide(self, training, progress, foretell)
            problems = foretell(pose(self, training), told=training.foretold)
            with limit_threads(side(problems)):
                learned = ([of] for of in self._learn(problems, progress))
                learn = partial(self._learn_again, problems[0].budget, progress)
                decided = revise(self, training, *learned, learn)
                training, [problems], [modes] = self._tell(training, *decided)
                modes = list(map(along_ranges, problems, modes))
                self._store(training, problems, modes)
                self._warn_of_fit(training, problems, modes)
        return self

    def _learn_again(self, budget, progress, training):
        """Problems and modes of one form, with other units, noise and k^x."""
        problems = [replace(of, budget=budget) for of in pose(self, training)]
        return ([of] for of in self._learn(problems, progress))

    def _warn_of_fit(self, training, problems, modes, *, compared=False):
        """Say what the fit leaves in doubt, see `warn_of_doubts`."""
        sampled = self._is_sampled()
        self._warn_of_noise(problems, modes)
        if self.max_iter and not sampled:
            warn_of_small_tasks(training, problems[0].prior.task_covariance)
            [kernel, *others] = self._kernels()
            given = kernel is not None and not others
            known = {"given": given, "counted": self._counts_learning()}
            warn_of_few_rows(problems[0], self.hyperparameters_, **known)
        tell_counts(self, training.known)
        names = names_of_inputs(self)
        warn_of_skew(self, training, problems, modes, names)
        options = {"names": names, "sampled": sampled, "compared": compared}
        options["one_kernel"] = not self._may_have_more_kernels()
        warn_of_doubts(training, problems, modes, **options)

    def _may_have_more_kernels(self):
        """Whether the user leaves the kernel open, and nothing asks for one alone.

        One function that all share has one kernel: two could not be so named.
        """
        return (
            self._kernels() == [None]
            and not self._shares()
            and self.normalize_y is not False
            and self.hyperparameters in ("mode", "map")
            and getattr(self, "learning", "annealed") == "annealed"
            and self.inference in ("auto", "dense")
        )

    def _tell(self, before, training, problems, modes):
        """What was learned; says if units, noise or k^x are others than at first."""
        if self.verbose and training.chosen != before.chosen:
            say(f"chosen once all is learned: {training.chosen}")
            for of in zip(chain(*problems), chain(*modes), strict=True):
                problem, mode = of
                name = about(problem, problem.prior.task_covariance)
                say(f"{name}{in_words(problem, mode.theta, mode.value)}")
        return training, problems, modes

    def _foretell(self, problems, n_forms=1, told=False):
        """The problems with the pace of learning; where it is slow, that is said.

        Unless it was `told` before.
        """
        if self.max_iter == 0 or not problems[0].engine.exact:
            return problems
        forecast = foresee(problems, n_forms)
        learning = (
            f"Learning from {len(problems[0].data)} rows by {problems[0].engine.name} "
            "inference will take"
        )
        if self.verbose and forecast.rows and not told:
            say(f"{learning} very roughly {forecast}, on one processor")
        if not told:
            warn_of_duration(learning, forecast.seconds)
        budget = replace(problems[0].budget, pace=forecast.pace)
        return [replace(problem, budget=budget) for problem in problems]

    def _form_for_screening(self, n_tasks):
        """K^rho of the small model that says in which units to learn."""
        return low_rank(n_tasks, 0, diagonal=True)

    def _named_kernel(self, name, features, *, alike=False):
        """The kernel of a name."""
        return named_kernel(name, features, alike=alike)

    def _learns_amplitude(self):
        """Whether the model can scale itself to the targets."""
        return True

    def _rank(self, n_tasks, n, engine):
        """How many latent functions n rows of the tasks may share."""
        return 1

    def _kernels(self):
        """k^x of each term, as the user gave it."""
        return [self.kernel]

    def _n_climbs(self, n_ranks):
        """How many climbs over all rows an output has that do not wait for others."""
        return n_ranks

    def _options(self):
        """Of sparse inference."""
        names = "n_inducing", "inducing_inputs", "n_exact"
        return {name: getattr(self, name) for name in names}

    def _budget(self):
        """Of what is learned."""
        verbose = self.verbose
        return Budget(self.max_iter, self.tol, verbose=verbose, begun=time())

    def _some_noise(self):
        """Whether almost no noise is unlikely, see `SomeNoise`."""
        return True

    def _noise_deviation(self):
        """How far apart the noise variances of tasks are, see `AlikeNoise`."""
        return TUNING.noise_deviation

    def _has_levels(self):
        """Whether each task has a level of its own."""
        return bool(getattr(self, "task_levels", False))  # False of NumPy too


def side(problems):
    """Rows of the largest matrices that learning decomposes."""
    return problems[0].engine.side(problems[0].data)
