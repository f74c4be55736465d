"""What describes the task now: descriptors, followed sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skmtgp.predictor import CompiledPredictor

__all__ = ["DescriptorTracker"]

RIDGE = 1e-6  # of the variance of a descriptor, where the known tasks do not differ


class DescriptorTracker:
    r"""Descriptors of a task that may change at any time, sample by sample.

    A robot picks up a load that nobody told it of. Each period it measures a state and
    the torques that made it, and asks what it carries. Where a model has
    `task_descriptors`, such as the load's mass and moments, its predictions are linear
    in them: each sample is a few linear equations, and a Kalman filter solves them as
    they come, in microseconds. A sample that no small change of the descriptors
    explains says that the task is another one: what was known is then forgotten.

    Parameters
    ----------
    predictor : CompiledPredictor
        Of models with `task_descriptors`, compiled for all tasks; or what has its
        method `by_descriptors` and its attribute `descriptors`.
    noise : float or array-like of shape (n_outputs,)
        Standard deviation by which a sample is off the model: noise and the model's own
        error, in units of y.
    start : int, str or array-like of shape (n_descriptors,), default=None
        The task at first: a label that the predictor knows, or descriptors, which are
        then known exactly. None: any task.
    widening : float, default=3.0
        Deviation of the descriptors of another task from the known tasks', in units of
        their deviation.
    surprise : float, default=10.0
        Root mean square over the outputs, in deviations, by which a sample must be off
        for the task to be another one.
    memory : float, default=1000.0
        Samples after which what was learned has faded to 1 / e. Infinite: never.

    Attributes
    ----------
    descriptors : ndarray of shape (n_descriptors,)
        As they are known now.
    covariance : ndarray of shape (n_descriptors, n_descriptors)
        Theirs. Samples that follow each other closely tell the same, and so do the
        errors of the model: it is rather too small.
    n_changes : int
        How often the task was found to be another one.

    Raises
    ------
    ValueError
        If the models of the predictor have no descriptors, or a number is out of range.

    See Also
    --------
    TaskIdentifier : From samples of a task, which one it is, with a model's own
        uncertainty; slower.

    Notes
    -----
    With the constants c and slopes A of `by_descriptors`, deviations R of a sample and
    :math:`\lambda = 1 - 1 / memory` it is the information filter

    .. math::
        \Lambda \leftarrow \lambda \Lambda + (1 - \lambda) \Lambda_0 + A^T R^{-2} A,
        \quad d \leftarrow d + \Lambda^{-1} A^T R^{-2} (y - c - A d).

    :math:`\Lambda_0^{-1}` is the covariance of the known tasks' descriptors, widened:
    what fades is forgotten as far as that, and no further.

    Examples
    --------
    Machines whose response grows with their age:

    >>> import numpy as np
    >>> from skmtgp import DescriptorTracker, MultiTaskGPRegressor, compile_predictor
    >>> rng = np.random.default_rng(0)
    >>> age, machine = np.array([1.0, 3.0, 6.0, 9.0]), np.repeat([0, 1, 2, 3], 20)
    >>> x = rng.uniform(0, 6, 80)
    >>> y = age[machine] * np.sin(x) + 0.1 * rng.standard_normal(80)
    >>> X = np.column_stack([x, age[machine], machine])
    >>> model = MultiTaskGPRegressor(rank=1, task_descriptors=[1]).fit(X, y)
    >>> tracker = DescriptorTracker(compile_predictor(model), noise=0.1, start=0)
    >>> for x in (1.0, 1.5, 2.0):  # the machine is 1 year old, as it says
    ...     age = tracker.update([x], [np.sin(x)])
    >>> for x in (1.0, 1.5, 2.0):  # another one took its place, of 4.5 years
    ...     age = tracker.update([x], [4.5 * np.sin(x)])
    >>> age.round(1), tracker.n_changes
    (array([4.4]), 1)
    """

    def __init__(
        self,
        predictor: CompiledPredictor,
        noise: ArrayLike,
        start: int | str | ArrayLike | None = None,
        *,
        widening: float = 3.0,
        surprise: float = 10.0,
        memory: float = 1000.0,
    ) -> None:
        known = predictor.descriptors
        if known is None:
            raise ValueError(
                "DescriptorTracker needs a predictor of models with the same "
                "task_descriptors, compiled without `task`."
            )
        for name, value in {"widening": widening, "surprise": surprise}.items():
            if not value > 0.0:
                raise ValueError(f"{name}={value} must be above 0.")
        if not memory > 1.0:
            raise ValueError(f"memory={memory} must be above 1.")
        self.predictor, self.surprise, self.n_changes = predictor, surprise, 0
        self.fading = 1.0 - 1.0 / memory
        self._variances = _variances(noise, predictor)
        table = known.to_numpy(dtype=float)
        spread = table.std(axis=0)
        self._scale = np.where(spread > 0.0, spread, 1.0)
        scaled = (table - table.mean(axis=0)) / self._scale
        prior = widening**2 * (
            scaled.T @ scaled / len(table) + RIDGE * np.eye(len(spread))
        )
        self._widest = np.linalg.inv(prior)
        self.descriptors, self._information = table.mean(axis=0), self._widest
        if start is not None:
            self.descriptors = _started(start, known)
            self._information = self._widest / RIDGE**2

    @property
    def covariance(self) -> NDArray[np.float64]:
        """That of the descriptors, of shape (n_descriptors, n_descriptors)."""
        scaled = np.linalg.inv(self._information)
        return scaled * np.outer(self._scale, self._scale)

    def update(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Learn from one sample.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            A state, as the predictor takes it.
        y : array-like of shape (n_outputs,)
            What was measured there. NaN for outputs that were not, or that are not to
            be trusted.

        Returns
        -------
        descriptors : ndarray of shape (n_descriptors,)
            As they are known now.

        Raises
        ------
        ValueError
            If x or y has another length, or y is infinite.
        """
        y = np.asarray(y, dtype=float)
        if y.shape != self._variances.shape:
            raise self._no_sample(y)
        constants, slopes = self.predictor.by_descriptors(x)
        off = y - constants - slopes @ self.descriptors
        slopes, variances = slopes * self._scale, self._variances
        if not np.isfinite(off).all():
            if np.isinf(y).any():
                raise self._no_sample(y)
            told = ~np.isnan(off)
            off, slopes, variances = off[told], slopes[told], variances[told]
        step = self._step(off, slopes, variances)
        self.descriptors = self.descriptors + self._scale * step
        return self.descriptors

    def _no_sample(self, y):
        return ValueError(
            f"y={y} must be {len(self._variances)} finite numbers, one for each output "
            "of the predictor, or NaN."
        )

    def _step(self, off, slopes, variances):
        """The change of the scaled descriptors, and the information with the sample."""
        weighted = slopes.T / variances
        of_sample, pull = weighted @ slopes, weighted @ off
        before = self.fading * self._information + (1 - self.fading) * self._widest
        step = np.linalg.solve(before + of_sample, pull)
        squares = np.square(off) @ (1.0 / variances) - pull @ step
        if squares > len(off) * self.surprise**2:  # another task
            self.n_changes, before = self.n_changes + 1, self._widest
            step = np.linalg.solve(before + of_sample, pull)
        self._information = before + of_sample
        return step


def _variances(noise, predictor):
    """Of what each output of a sample may be off."""
    shape = (len(predictor.outputs),)
    noise = np.asarray(noise, dtype=float)
    if noise.shape not in ((), shape) or not (np.isfinite(noise) & (noise > 0.0)).all():
        raise ValueError(
            f"noise={noise} must be a number above 0, or one for each of the "
            f"{shape[0]} outputs."
        )
    return np.square(np.broadcast_to(noise, shape))


def _started(start, known):
    """The descriptors that tracking starts with."""
    if np.ndim(start) == 0:
        if start not in known.index:
            raise ValueError(
                f"start={start!r} is no task of the predictor: {list(known.index)[:5]}."
            )
        return known.loc[start].to_numpy(dtype=float)
    start = np.asarray(start, dtype=float)
    if start.shape != known.shape[1:] or not np.isfinite(start).all():
        raise ValueError(
            f"start={start} must be finite numbers, one for each of "
            f"{list(known.columns)}."
        )
    return start
