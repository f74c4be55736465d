"""What the Gaussian process regressors share: reading, what to learn, fitting."""

from __future__ import annotations

from abc import ABCMeta, abstractmethod
from dataclasses import replace
from itertools import chain
from numbers import Integral, Real
from time import time
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from skmtgp._data.checks import FEW_ROWS, check_training, locate, warn_of_constants
from skmtgp._data.dask import is_dask
from skmtgp._data.descriptors import locate_descriptors, read_descriptors
from skmtgp._data.known import read_known, weighed_rows
from skmtgp._data.labels import Labels
from skmtgp._data.partitions import check_partitions
from skmtgp._data.trend import NAMED, read_trend
from skmtgp._estimators.deciding import decide, decide_rest
from skmtgp._estimators.doubts import (
    warn_of_doubts,
    warn_of_duration,
    warn_of_small_tasks,
)
from skmtgp._estimators.estimator import public
from skmtgp._estimators.joining import JoiningGP
from skmtgp._estimators.named_kernels import (
    DEFAULT,
    KERNEL,
    named_kernel,
    with_positions,
)
from skmtgp._estimators.sampled import n_posteriors
from skmtgp._estimators.slopes import Slopes
from skmtgp._estimators.targets import fit_target
from skmtgp._estimators.training import Training
from skmtgp._estimators.units import variance_of_means
from skmtgp._numerics.parallel import at_a_time, limit_threads
from skmtgp._support.progress import fitting, say
from skmtgp._support.sklearn_compat import (
    HasMethods,
    Interval,
    StrOptions,
    fit_context,
    with_callbacks,
)
from skmtgp.inference.engine import (
    Demand,
    Engine,
    check_known,
    check_terms,
    check_trend,
)
from skmtgp.inference.engines import ENGINES, choose, leaves_rows, repeats_rows
from skmtgp.inference.memory import TileMemory
from skmtgp.learning.forecast import foresee
from skmtgp.learning.problem import THE_OUTPUT, Budget, Problem
from skmtgp.learning.ranges import along_ranges, begun_in_sight
from skmtgp.learning.telling import about, in_words
from skmtgp.model.kernel_check import check_kernel
from skmtgp.model.prior import Prior
from skmtgp.model.several import Kernels, terms_of
from skmtgp.model.task_covariance import identity

FIRST_LEVEL = 1e-2  # where learning of the levels' variance starts, of the targets'
# Its least where each task was taken off its own mean: learned from such targets it
# would be zero, as if the means were known. This is the prior of unit information.
CENTRED = 1.0
TRANSFORMER = "fit", "transform", "inverse_transform"
NOTHING = None, None, None  # is known of the noise of the rows
ROUNDING = 1e-15  # of the mean of equal numbers, relative to them
NO_NOISE = 1e-200  # in place of a noise variance of 0, whose logarithm is none


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
        "hyperparameters": [StrOptions({"mode", "map", "sampled", "auto"})],
        "n_draws": [Interval(Integral, 4, None, closed="left")],
        "max_iter": [Interval(Integral, 0, None, closed="left")],
        "tol": [Interval(Real, 0.0, None, closed="neither")],
        "n_jobs": [Integral, None],
        "verbose": ["verbose"],
    }

    _parameter_hints = {
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
        ValueError
            If a parameter, a feature, a label or a target cannot be used, or if the
            kernel is not a valid covariance of the features. The estimator is then as
            it was before.
        """
        with fitting(self, X, y, verbose=self.verbose) as progress:
            given = alpha, sample_weight, repeat_variance
            X, y, given = weighed_rows(
                X, y, given, repeats=repeats_rows(self.inference)
            )
            training = self._read(X, y, progress, given)
            problems = self._problems(training)
            problems = self._foretell(problems, problems[0].prior.n_terms)
            with limit_threads(side(problems)):
                learned = self._learn(problems, progress)
                decided = decide_rest(self, training, *([of] for of in learned))
                training, [problems], [modes] = self._tell(training, *decided)
                modes = list(map(along_ranges, problems, modes))
                self._store(training, problems, modes)
                self._warn_of_fit(training, problems, modes)
        return self

    def _warn_of_fit(self, training, problems, modes):
        """Say what the fit leaves in doubt."""
        sampled = self._is_sampled()
        self._warn_of_noise(modes)
        if self.max_iter and not sampled:
            warn_of_small_tasks(training, problems[0].prior.task_covariance)
        warn_of_doubts(problems, modes, sampled=sampled)

    def _tell(self, before, training, problems, modes):
        """The same; says if the noise is another than learning began with."""
        if self.verbose and training.chosen != before.chosen:
            say(f"chosen once all is learned: {training.chosen}")
            for of in zip(chain(*problems), chain(*modes), strict=True):
                problem, mode = of
                name = about(problem, problem.prior.task_covariance)
                say(f"{name}{in_words(problem, mode.value)}")
        return training, problems, modes

    def _foretell(self, problems, n_forms=1):
        """The problems with the pace of learning; where it is slow, that is said."""
        if self.max_iter == 0 or not problems[0].engine.exact:
            return problems
        forecast = foresee(problems, n_forms)
        learning = (
            f"Learning from {len(problems[0].data)} rows by {problems[0].engine.name} "
            "inference will take"
        )
        if self.verbose and forecast.rows:
            say(f"{learning} very roughly {forecast}, on one processor")
        warn_of_duration(learning, forecast.seconds)
        budget = replace(problems[0].budget, pace=forecast.pace)
        return [replace(problem, budget=budget) for problem in problems]

    def _form_for_screening(self, n_tasks):
        """K^rho of the small model that says in which units to learn."""
        return identity(n_tasks, diagonal=True)

    def _named_kernel(self, name, features):
        """The kernel of a name."""
        return named_kernel(name, features)

    def _made(self, kernel, features, default=DEFAULT):
        """A kernel as the user gave it, or that of the name, or of the default's."""
        if kernel is None or isinstance(kernel, str):
            return self._named_kernel(kernel or default, features)
        kernel = clone(kernel)  # the user may change theirs
        return with_positions(kernel, self._names_of_inputs)

    def _names_of_inputs(self):
        """Those of the columns that the kernel sees; None without names."""
        given = getattr(self, "feature_names_in_", None)
        if given is None:
            return None
        position, names = locate(self)
        if self._describes():
            n = self.n_features_in_
            columns = locate_descriptors(self.task_descriptors, position, n, given)
            names = np.delete(names, columns)
        return names.tolist()

    def _learns_amplitude(self):
        """Whether the model can scale itself to the targets."""
        return True

    def _rank(self, n_tasks, n):
        """How many latent functions the tasks share."""
        return 1

    def _read(self, X, y, progress, given=NOTHING):
        """The training data, checked, encoded and scaled."""
        stay = is_dask(X, y) and leaves_rows(self.inference)
        if stay and self.hyperparameters == "sampled":
            raise ValueError(
                "hyperparameters='sampled' needs the rows in memory, and X is a Dask "
                "collection. Give arrays, or set hyperparameters='mode'."
            )
        if stay and self._describes():
            raise ValueError(
                "task_descriptors needs the rows in memory, and X is a Dask "
                "collection. Give arrays, or leave the descriptors out."
            )
        if stay and getattr(self, "trend", None) is not None:
            raise ValueError(
                "trend needs the rows in memory, and X is a Dask collection. Give "
                "arrays, which may be memory-mapped, or leave the trend out."
            )
        if stay and any(part is not None for part in given):
            raise ValueError(
                "alpha and sample_weight need the rows in memory, and X is a Dask "
                "collection. Give arrays, or leave them out."
            )
        check = check_partitions if stay else check_training
        training = self._scale(*check(self, X, y), given)
        report = "auto" in (self.normalize_y, self.noise) and progress(
            "units", 1, lambda _, chosen: f"chosen from the data: {chosen}"
        )
        if report:
            report(0, training.chosen)
        return training

    def _scale(self, features, codes, tasks, Y, given=NOTHING):
        single_output, Y = Y.ndim == 1, Y.reshape(len(Y), -1)
        known = read_known(*given, Y.shape)
        if known is not None:
            known.refuse_transform(self.target_transform)
        target = fit_target(self.target_transform, Y)
        Y = target.forward(Y)
        features, described = self._describe(features, codes, tasks)
        slopes = self._slopes(features, codes, tasks, **described)
        training = Training(
            features,
            codes,
            tasks,
            Y,
            single_output,
            target=target,
            slopes=slopes,
            known=known,
            **described,
        )
        if len(Y) > FEW_ROWS:
            same = np.asarray(Y.min(axis=0) == Y.max(axis=0))
            # without normalize_y one that is not zero has a size, if nothing else
            sized = not self.normalize_y and self._learns_amplitude()
            warn_of_constants(same & ~(sized & np.asarray(Y.max(axis=0) != 0.0)))
        return decide(self, training)

    def _describes(self):
        """Whether tasks have descriptors, which are columns of X."""
        return getattr(self, "task_descriptors", None) is not None

    def _describe(self, features, codes, tasks):
        """The inputs of the kernel, and the descriptors of the tasks, if any."""
        if not self._describes():
            return features, {}
        position, names = locate(self)
        columns = locate_descriptors(
            self.task_descriptors,
            position,
            self.n_features_in_,
            getattr(self, "feature_names_in_", None),
        )
        labels = Labels(tasks, codes)
        descriptors = read_descriptors(columns, names, features, labels)
        return descriptors.inputs(features), {"descriptors": descriptors}

    def _slopes(self, inputs, codes, tasks, descriptors=None):
        """The trend at the training rows, None without one."""
        trend = getattr(self, "trend", None)
        per_task = getattr(self, "trend_per_task", False)
        if trend is None:
            if per_task:
                raise ValueError(
                    "trend_per_task=True needs a trend: name its columns in trend, or "
                    "set trend='linear'."
                )
            return None
        position, names = locate(self)
        given = getattr(self, "feature_names_in_", None)
        described = None if descriptors is None else descriptors.columns
        columns = read_trend(trend, inputs, position, names, given, described)
        centred = bool(self.normalize_y)
        slopes = Slopes(columns, inputs, codes, tasks, bool(per_task), centred)
        slopes.check()
        return slopes

    def _kernels(self):
        """k^x of each term, as the user gave it."""
        return [self.kernel]

    def _kernel(self, training):
        """k^x with its starting values, of several terms those of each."""
        kernels = [self._checked(kernel, training) for kernel in self._kernels()]
        return Kernels(kernels) if len(kernels) > 1 else kernels[0]

    def _checked(self, kernel, training):
        kernel = self._made(kernel, training.features, training.kernel)
        check_kernel(kernel, training.features)
        return kernel

    def _n_climbs(self, n_ranks):
        """How many climbs over all rows an output has that do not wait for others."""
        return n_ranks

    def _problems(self, training, n_ranks=1, n_kept=1):
        """What is learned for each output, by models of so many ranks."""
        prior = self._prior(training)
        engine = choose(self.inference, prior, training, **self._options())
        check_terms(engine, prior)
        check_trend(engine, prior)
        check_known(engine, prior, training)
        if self.hyperparameters == "sampled" and prior.n_terms > 1:
            raise ValueError(
                "hyperparameters='sampled' draws those of one term K^rho x k^x, but "
                f"kernel is a list of {prior.n_terms} kernels. Set "
                "hyperparameters='map' or 'mode', or give one kernel."
            )
        self._check_memory(engine, training, prior, n_ranks, n_kept)
        of_outputs = training.data(engine)
        engine.check(prior, of_outputs[0], training.tasks)
        n = len(of_outputs)
        trends = training.trends or [None] * n
        return [
            begun_in_sight(
                Problem(
                    self._scaled(replace(prior, trend=trend), data, training.units),
                    data=data,
                    engine=engine,
                    budget=self._budget(),
                    name=f"output {j} of {n}" if n > 1 else THE_OUTPUT,
                    weak_priors=self.hyperparameters == "map",
                    log_scales=np.log(training.units.scale[j - 1]),
                )
            )
            for j, (data, trend) in enumerate(zip(of_outputs, trends, strict=True), 1)
        ]

    def _options(self):
        """Of sparse inference."""
        names = "n_inducing", "inducing_inputs", "n_exact"
        return {name: getattr(self, name) for name in names}

    def _budget(self):
        verbose = self.verbose
        return Budget(self.max_iter, self.tol, verbose=verbose, begun=time())

    def _prior(self, training):
        """The model, with K^rho = I until its form is known."""
        n_tasks = len(training.tasks)
        kernel, of_tasks = self._kernel(training), identity(n_tasks)
        prior = Prior(
            kernel,
            of_tasks,
            n_noise=n_tasks if training.noise == "per_task" else 1,
            levels=self._has_levels() and not training.has_constants,
            noise_is_fixed=isinstance(self.noise_variance_bounds, str),
            trend=training.trends and training.trends[0],
        )
        return prior.with_terms([(each, of_tasks) for each in terms_of(kernel)])

    def _has_levels(self):
        """Whether each task has a level of its own."""
        return getattr(self, "task_levels", False)

    def _scaled(self, prior, data, units):
        """The prior with starting values and bounds relative to the targets."""
        deviation, scale = data.deviation, data.size or 1.0
        if deviation < ROUNDING * scale:  # constant targets
            deviation = 1.0
        start, bounds = self.noise_variance, self._check_noise_bounds(data.known)
        start = max(start, NO_NOISE)
        bounds = (start,) * 2 if isinstance(bounds, str) else bounds
        least = CENTRED if units.per_task else prior.least_level
        level = max(least, FIRST_LEVEL) * scale**2
        if prior.levels:
            of_rows = data.y, data.tasks, data.n_tasks
            level = max(level, variance_of_means(*of_rows, data.known))
        return replace(
            prior,
            scale=scale,
            log_noise=float(np.log(start * deviation**2)),
            log_noise_bounds=tuple(np.log(np.multiply(bounds, deviation**2))),
            log_level=float(np.log(level)),
            least_level=least,
        )

    def _check_memory(self, engine, training, prior, n_ranks, n_kept):
        """Whether memory suffices."""
        (n, n_outputs), n_tasks = training.Y.shape, len(training.tasks)
        climbs = n_outputs * self._n_climbs(n_ranks)
        rank = self._rank(n_tasks, engine.n_told(n))
        demand = Demand(
            n,
            n_tasks,
            rank=rank,
            n_kept=n_outputs * n_kept * n_posteriors(self, n),
            n_climbs=at_a_time(self.n_jobs, climbs if engine.exact else n_outputs),
            n_exact_climbs=at_a_time(self.n_jobs, climbs),
            n_parameters=n_tasks * rank,
            n_missing=training.n_missing if engine.uses_design else 0,
            n_coefficients=prior.n_coefficients,
        )
        x = np.asarray(training.features[:1])
        engine.check_memory(demand, TileMemory(prior.kernel, x))

    def _check_noise_bounds(self, known):
        bounds = self.noise_variance_bounds
        told = known is not None and known.variance.min() > 0.0
        if self.noise_variance == 0.0 and not (told and isinstance(bounds, str)):
            raise ValueError(
                "noise_variance=0 leaves the noise to alpha: it needs "
                "noise_variance_bounds='fixed', and an alpha above 0 for each row. "
                "Otherwise give a small positive number."
            )
        if isinstance(bounds, str):
            return bounds
        bounds = np.asarray(bounds, dtype=object)
        if not _is_range(bounds):
            raise ValueError(
                f"noise_variance_bounds={self.noise_variance_bounds!r} must be a pair "
                "of positive numbers, the smaller one first, or 'fixed'."
            )
        if not bounds[0] <= self.noise_variance <= bounds[1]:
            raise ValueError(
                f"noise_variance={self.noise_variance} is outside "
                f"noise_variance_bounds={self.noise_variance_bounds!r}: it is where "
                "learning starts. Give one between them."
            )
        return bounds.astype(np.float64)


def _is_range(bounds):
    """Whether these are two positive numbers, the smaller one first."""
    if bounds.shape != (2,) or not all(isinstance(bound, Real) for bound in bounds):
        return False
    return bool(0.0 < bounds[0] <= bounds[1] < np.inf)


def side(problems):
    """Rows of the largest matrices that learning decomposes."""
    return problems[0].engine.side(problems[0].data)
