"""What rigid bodies leave of a joint's torque: a Gaussian process of a few features."""

from time import perf_counter
from typing import NamedTuple

import numpy as np
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, Matern

from skmtgp._numerics.linalg import Cholesky, cholesky_with_jitter
from skmtgp._support.warnings import collect_warnings
from skmtgp.exceptions import LongFitWarning
from skmtgp.kernels import Columns
from skmtgp.multitask import MultiTaskGPRegressor
from skmtgp.robot._columns import FRICTION, check_words

# Length-scales in units of a feature's size: shorter ones than a tenth fit noise.
LENGTH_SCALE, BOUNDS = 3.0, (0.1, 10.0)
# Those of errors that neighbours have in common. Rows tell only how fast these begin to
# differ. Longer ones would make them a constant of each direction, which is friction.
NEAR, NEAR_BOUNDS = 0.5, (0.02, 10.0)
SHARE, SHARE_BOUNDS = 0.1, (1e-5, 1e5)  # of the second part of a sum
NONE = "none"
THOROUGH = "annealed"
# Evaluations that a quick and a thorough search take, roughly; what one takes, in
# decompositions and inverses of its matrix; and the rows with which these are timed.
QUICK, FULL, EACH, SAMPLE = 50, 200, 1.6, 500


class Inputs(NamedTuple):
    """What a part of the rest depends on.

    Attributes
    ----------
    parts : list of ndarray of shape (n_samples, n_columns)
        Each has one unit.
    factor : ndarray of shape (n_samples, n_factors)
        Products of its rows multiply the kernel; without columns nothing does.
    """

    parts: list
    factor: np.ndarray


def _friction(dynamics, state, link, joint, asymmetric):
    """Speed and the torque along it, times the direction: friction turns with it."""
    _, qd, qdd = state
    sign = FRICTION["coulomb"]["coulomb"](qd[:, [joint]], qdd[:, [joint]])
    parts = [np.abs(qd[:, [joint]]), sign * link[:, None]]
    return Inputs(parts + [sign] * asymmetric, sign)


def _states(dynamics, state, link, joint, asymmetric):
    """All positions, those of joints that turn as cosine and sine, and rates."""
    q, qd, qdd = state
    turns = ~np.array(dynamics.slides)
    parts = q[:, ~turns], np.cos(q[:, turns]), np.sin(q[:, turns]), qd, qdd
    columns = np.hstack(parts)
    return Inputs(np.hsplit(columns, columns.shape[1]), columns[:, :0])


def _neighbours(dynamics, state, link, joint, asymmetric):
    """The same, in parts that have one unit, of rows in which the joint moves alike."""
    q, qd, qdd = state
    slides = np.array(dynamics.slides)
    turned = np.hstack([np.cos(q[:, ~slides]), np.sin(q[:, ~slides])])
    rates = [rate[:, of] for rate in (qd, qdd) for of in (slides, ~slides)]
    parts = [part for part in (q[:, slides], turned, *rates) if part.shape[1]]
    sign = FRICTION["coulomb"]["coulomb"](qd[:, [joint]], qdd[:, [joint]])
    return Inputs(parts, np.equal(sign, [-1.0, 0.0, 1.0]).astype(np.float64))


def _smooth(width):
    """A length-scale for each feature."""
    return RBF(np.full(width, LENGTH_SCALE), BOUNDS)


def _rough(width):
    """One length-scale: what is not white along a path, of any shape."""
    return Matern(NEAR, NEAR_BOUNDS, nu=0.5)


KINDS = {
    "friction": (_friction, _smooth),
    "states": (_states, _smooth),
    "neighbours": (_neighbours, _rough),
}
WORDS = [*KINDS, "friction+neighbours"]


def check_rest(rest):
    """The words of what may be left of a torque.

    Parameters
    ----------
    rest : str, sequence of str or None
        Of `WORDS`; None: nothing.

    Returns
    -------
    words : list of str
        Without repetitions.

    Raises
    ------
    TypeError, ValueError
        If they are none of these.
    """
    return check_words("rest", rest, WORDS)


class OfWord:
    """Features of one word, held within the range of the training rows.

    A squared exponential falls back to 0 where it has no rows; at the edge of what it
    has seen it knows more than nothing, and there its features stay.

    Parameters
    ----------
    word : str
        Of `KINDS`.
    dynamics, joint, x, link, asymmetric
        See Features.
    """

    def __init__(self, word, dynamics, joint, x, link, asymmetric):
        self.word, self.given = word, (dynamics, joint, asymmetric)
        parts, factor = self._inputs(x, link)
        values, self.n_factors = np.hstack(parts), factor.shape[1]
        near = word == "neighbours"  # which end where the rows do
        self.lower = np.where(near, -np.inf, values.min(axis=0))
        self.upper = np.where(near, np.inf, values.max(axis=0))
        size = [np.full(of.shape[1], np.sqrt(np.square(of).mean())) for of in parts]
        size = np.concatenate(size)
        self.scale = np.where(size > 0.0, size, 1.0)

    def _inputs(self, x, link):
        dynamics, joint, asymmetric = self.given
        columns, _ = KINDS[self.word]
        return columns(dynamics, dynamics.states(x), link, joint, asymmetric)

    def __call__(self, x, link):
        """The features of some rows, then what multiplies the kernel."""
        parts, factor = self._inputs(x, link)
        inside = np.clip(np.hstack(parts), self.lower, self.upper)
        return np.hstack([inside / self.scale, factor])

    @property
    def width(self):
        """How many columns these are."""
        return len(self.scale) + self.n_factors

    def kernel(self, begin):
        """That of columns that begin there."""
        _, make = KINDS[self.word]
        end, n = begin + self.width, len(self.scale)
        kernel = Columns(make(n), list(range(begin, begin + n)))
        if not self.n_factors:
            return kernel
        factor = DotProduct(0.0, "fixed")
        return kernel * Columns(factor, list(range(begin + n, end)))


class Features:
    """Features of the rest.

    Parameters
    ----------
    kind : str
        Of `WORDS`.
    dynamics : Dynamics
        The robot.
    joint : int
        Whose torque.
    x : ndarray of shape (n_samples, 3 J)
        States in training.
    link : ndarray of shape (n_samples,)
        Torques of rigid bodies there.
    asymmetric : bool, default=False
        Whether friction may differ by direction by more than its sign.
    """

    def __init__(self, kind, dynamics, joint, x, link, *, asymmetric=False):
        given = dynamics, joint, x, link, asymmetric
        self.of_words = [OfWord(word, *given) for word in kind.split("+")]

    def __call__(self, x, link):
        """The features of some rows, of shape (n_samples, n_features)."""
        return np.hstack([of_word(x, link) for of_word in self.of_words])

    def kernel(self):
        """That of the word, or the sum of those of several."""
        ends = np.cumsum([of_word.width for of_word in self.of_words])
        begins = [0, *ends[:-1].tolist()]
        pairs = zip(self.of_words, begins, strict=True)
        first, *others = (of_word.kernel(begin) for of_word, begin in pairs)
        return sum((ConstantKernel(SHARE, SHARE_BOUNDS) * k for k in others), first)


class Rest(NamedTuple):
    """The process of one joint, and how it was chosen.

    Attributes
    ----------
    name : str
        Of `WORDS`, or `NONE`.
    features : Features or None
        What it depends on.
    model : MultiTaskGPRegressor or None
        Learned; its tasks are positions among the robot's.
    noise : float or ndarray of shape (n_tasks,)
        Variance that neither has.
    """

    name: str
    features: Features | None
    model: MultiTaskGPRegressor | None
    noise: float | np.ndarray

    def covariance(self, rows, others):
        """Between rows of features and task, of shape (n_rows, n_others)."""
        (z, tasks), (w, columns) = rows, others
        relation = self.model.task_covariance_[np.ix_(tasks, columns)]
        return relation * self.model.kernel_(z, w)

    def factor(self, rows):
        """Cholesky decomposition of the covariance of targets."""

        def build():
            K = np.asfortranarray(self.covariance(rows, rows))
            K[np.diag_indices_from(K)] += self.noise_of(rows[1])
            return K

        return cholesky_with_jitter(build)

    def joined(self, rows, left):
        """With a task more, of which these rows are what rigid bodies leave."""
        if self.model is None:
            return self
        model = self.model.add_task(np.column_stack(rows), left)
        return self._replace(model=model, noise=model.noise_variance_)

    def variance(self, rows):
        """Prior variance of rows."""
        z, tasks = rows
        return np.diag(self.model.task_covariance_)[tasks] * self.model.kernel_.diag(z)

    def noise_of(self, tasks):
        """Noise variance of each row."""
        noise = np.asarray(self.noise)
        return noise[tasks] if noise.ndim else np.full(len(tasks), noise)


def choose(kinds, make, left, tasks, estimators, criterion, *, thoroughly=True):
    """The best rest of a joint, a table of all, and the warnings of the best.

    Each kind is learned from all features it may have by the first estimator, quickly.
    The best is learned by all of them.

    Parameters
    ----------
    kinds : list of str
        What may be left, beside nothing.
    make : callable
        Features that a kind may have, a list of these and their values in training.
    left : ndarray of shape (n_samples,)
        What rigid bodies leave.
    tasks : ndarray of shape (n_samples,)
        Positions of the tasks.
    estimators : list of MultiTaskGPRegressor
        Unfitted: how tasks may be related.
    criterion : {"bic", "loo"}
        By which one is chosen.
    thoroughly : bool, default=True
        Whether the best is learned as thoroughly as the estimators say.

    Returns
    -------
    rest : Rest
        The chosen one.
    table : list of dict
        A row for each kind.
    warnings : list of (type, str)
        What was warned of when the best one was learned.
    """
    options = [(kind, *given) for kind in kinds for given in make(kind)]
    scores, tried, chosen = (tasks, left, criterion), [], NONE
    if options:
        first, *others = map(_quickly, estimators)
        tried = [_candidate(first, *option, *scores) for option in options]
        best = np.argmin([row[criterion] for _, row, _ in tried])
        full = [e for e in estimators if thoroughly and e.learning == THOROUGH]
        again = [_candidate(e, *options[best], *scores) for e in full or others]
        chosen = options[best][0]
        if full:
            tried = [of for of in tried if of[0].name != chosen]
        tried += again
    none = Rest(NONE, None, None, np.mean(np.square(left)))
    found = {NONE: (none, _alone(left, criterion), [])}
    for kind in kinds:
        found[kind] = _best([of for of in tried if of[0].name == kind], criterion)
    best = _best([found[kind] for kind in (NONE, chosen)], criterion)
    table = [{**row, "chosen": row is best[1]} for _, row, _ in found.values()]
    return best[0], table, best[2]


def foresee(n_rows, n_quick, n_full):
    """Seconds that so many searches with these rows take, very roughly."""
    n, times = min(n_rows, SAMPLE), []
    for _ in range(3):  # one may be held up
        K = np.asfortranarray(np.full((n, n), 0.5) + np.eye(n))
        begin = perf_counter()
        Cholesky(K).invert()
        times.append(perf_counter() - begin)
    each = EACH * min(times) * (n_rows / n) ** 3
    return each * (QUICK * n_quick + FULL * n_full)


def _quickly(estimator):
    """The same, learned by the paper's heuristic alone."""
    quick = clone(estimator)
    return quick.set_params(learning="staged") if quick.learning == THOROUGH else quick


def _best(candidates, criterion):
    return min(candidates, key=lambda candidate: candidate[1][criterion])


def _candidate(estimator, kind, features, z, tasks, left, criterion):
    """What is learned of a kind, its row of the table, and warnings."""
    with collect_warnings() as warnings:
        model = _learn(estimator, features, np.column_stack([z, tasks]), left)
        row = _tell(kind, model, left, criterion)
    told = [of for of in warnings if of[0] is not LongFitWarning]  # that is over
    return Rest(kind, features, model, model.noise_variance_), row, told


def _learn(estimator, features, Z, left):
    """A model of what is left, whose mean is 0: a constant is a part of friction."""
    units = {"task_levels": False, "normalize_y": False, "target_transform": None}
    model = clone(estimator).set_params(task_feature=-1, **units)
    if model.kernel is None:
        model.set_params(kernel=features.kernel())
    return model.fit(Z, left)


def _alone(left, criterion):
    """How likely it is that noise is all that is left."""
    n, variance = len(left), max(np.mean(np.square(left)), np.finfo(float).tiny)
    likelihood = -0.5 * n * (np.log(2.0 * np.pi * variance) + 1.0)
    row = _row(NONE, likelihood, 1, n)
    return row | ({"loo": -2.0 * likelihood} if criterion == "loo" else {})


def _tell(kind, model, left, criterion):
    row = _row(
        kind, model.log_marginal_likelihood_value_, model.n_hyperparameters_, len(left)
    )
    if criterion == "loo":
        mean, std = model.loo_predict(include_noise=True)
        row["loo"] = np.sum(
            np.square((left - mean) / std) + np.log(2.0 * np.pi * std**2)
        )
    return row


def _row(kind, likelihood, n_hyperparameters, n):
    return {
        "rest": kind,
        "log_marginal_likelihood": float(likelihood),
        "n_hyperparameters": int(n_hyperparameters),
        "bic": float(n_hyperparameters * np.log(n) - 2.0 * likelihood),
    }


def whiten(scale, B):
    """Rows whose noise and rest have variance 1.

    Parameters
    ----------
    scale : Cholesky or float
        Of the covariance of the rows, or the standard deviation of each.
    B : ndarray of shape (n_samples, ...)
        What is linear in the targets.
    """
    return scale.half_solve(B) if isinstance(scale, Cholesky) else B / scale


def log_det(scale, n):
    """Log determinant of the covariance of n rows, of such a scale."""
    return scale.log_det() if isinstance(scale, Cholesky) else 2.0 * n * np.log(scale)
