"""Descriptors of the present task, followed sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skmtgp.predictor import CompiledPredictor

__all__ = ["DescriptorTracker"]

RIDGE = 1e-6  # of the variance of a descriptor, where the known tasks do not differ


class DescriptorTracker:
    r"""Track the descriptors of a task that may change at any time.

    A robot picks up an unknown load. In each period it measures its state and its
    torques, and asks what it carries. If a model has `task_descriptors`, such as the
    load's mass and moments, its predictions are linear in them. So each sample gives a
    few linear equations. A Kalman filter solves them as they come, in microseconds. If
    no small change of the descriptors explains a sample, the task must be another one,
    and the tracker forgets what it knew.

    Parameters
    ----------
    predictor : CompiledPredictor
        Models with `task_descriptors`, compiled for all tasks. Any object with the
        method `by_descriptors` and the attribute `descriptors` will do.
    noise : float or array-like of shape (n_outputs,)
        Standard deviation of the samples around the model, in units of y. It includes
        noise and the model's own error.
    start : int, str or array-like of shape (n_descriptors,), default=None
        First task: a label that the predictor knows, or descriptors, which then count
        as known exactly. None means that any task is possible.
    widening : float, default=3.0
        Standard deviation of an unknown task's descriptors around those of the known
        tasks, in units of their standard deviation.
    surprise : float, default=10.0
        How large the error of a sample must be for the task to count as another one: a
        root mean square over the outputs, in standard deviations.
    memory : float, default=1000.0
        Number of samples after which what was learned has faded to 1 / e. With infinity
        it does not fade.

    Attributes
    ----------
    descriptors : ndarray of shape (n_descriptors,)
        Present estimate of the descriptors.
    covariance : ndarray of shape (n_descriptors, n_descriptors)
        Its covariance. It is rather too small, because consecutive samples tell nearly
        the same, and the model's errors do, too.
    n_changes : int
        How many times the tracker has found another task.

    Raises
    ------
    ValueError
        If the models of the predictor have no descriptors, or a number is out of range.

    See Also
    --------
    TaskIdentifier : Finds which task samples come from. It uses the model's own
        uncertainty; slower.

    Notes
    -----
    Let c and A be the constants and slopes of `by_descriptors`, R the standard
    deviations of a sample, and :math:`\lambda = 1 - 1 / memory`. The tracker is the
    information filter

    .. math::
        \Lambda \leftarrow \lambda \Lambda + (1 - \lambda) \Lambda_0 + A^T R^{-2} A,
        \quad d \leftarrow d + \Lambda^{-1} A^T R^{-2} (y - c - A d).

    :math:`\Lambda_0^{-1}` is the widened covariance of the known tasks' descriptors.
    What fades approaches it, so the tracker never forgets more than that.

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
        """Covariance of the descriptors, of shape (n_descriptors, n_descriptors)."""
        scaled = np.linalg.inv(self._information)
        return scaled * np.outer(self._scale, self._scale)

    def update(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Learn from one sample.

        Parameters
        ----------
        x : array-like of shape (n_features_in,)
            A state, as the predictor takes it.
        y : array-like of shape (n_outputs,)
            Measurements at this state. NaN for outputs that were not measured, or
            cannot be trusted.

        Returns
        -------
        descriptors : ndarray of shape (n_descriptors,)
            Present estimate of the descriptors.

        Raises
        ------
        ValueError
            If x or y has a wrong length, y is infinite, or the predictions at x are
            not finite.
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
            told = ~np.isnan(y)
            off, slopes, variances = off[told], slopes[told], variances[told]
            if not np.isfinite(off).all():
                raise ValueError(
                    f"The predictions at x={x} are not finite. Give finite numbers; "
                    "where a state was not measured, do not call update."
                )
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
                f"start={start!r} is not a task of the predictor, such as "
                f"{list(known.index)[:5]}."
            )
        return known.loc[start].to_numpy(dtype=float)
    start = np.asarray(start, dtype=float)
    if start.shape != known.shape[1:] or not np.isfinite(start).all():
        raise ValueError(
            f"start={start} must be finite numbers, one for each of "
            f"{list(known.columns)}."
        )
    return start
