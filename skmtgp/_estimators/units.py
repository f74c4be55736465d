"""The units in which targets are learned: what they are taken off and divided by."""

from functools import partial
from typing import NamedTuple

import numpy as np

from skmtgp._data.dask import is_dask, map_parts, sum_parts
from skmtgp._numerics.linalg import RESOLVED

FEWEST = 3  # rows of a task, whose deviation is taken for its unit
# Deviations within tasks from which on levels are reduced, and multiples of which are
# taken off: beside larger ones noise may be less than its bounds, and from 1e6 on the
# likelihood has no digits left.
FAR, STEP = 300.0, 100.0
UNLIKELY = 5.0  # deviations of a new task's mean from where the others let it be


class Units(NamedTuple):
    """Centres and scales of the targets.

    Attributes
    ----------
    centre : ndarray of shape (n_outputs, 1) or (n_outputs, n_tasks)
        Is taken off the targets of all tasks, or of each.
    scale : ndarray of shape (n_outputs, 1) or (n_outputs, n_tasks)
        They are divided by this. If tasks have scales, they have centres, too.
    """

    centre: np.ndarray
    scale: np.ndarray

    @property
    def own_centres(self):
        """Whether tasks have centres of their own."""
        return self.centre.shape[1] > 1

    @property
    def own_scales(self):
        """Whether tasks have scales of their own, and not centres alone."""
        return self.scale.shape[1] > 1

    @property
    def name(self):
        """Whose units these are, as the parameter `normalize_y` has it."""
        return "per_task" if self.own_scales else "shared"

    def scaled(self, Y, codes):
        """Targets in these units, from rows in those of y."""
        return (Y - self.of_rows(self.centre, codes)) / self.of_rows(self.scale, codes)

    def unscaled(self, means, codes):
        """Means in the units of y."""
        centre, scale = (self.of_rows(of, codes) for of in self)
        return means * scale + centre

    def of_rows(self, of_tasks, codes):
        """For each row, of shape (n_samples, n_outputs), or (1, n_outputs)."""
        if of_tasks.shape[1] == 1:
            return of_tasks.T
        if not is_dask(codes) and codes.max(initial=0) >= of_tasks.shape[1]:
            unseen = np.append(of_tasks, _commonest(of_tasks)[:, None], axis=1)
            return unseen.T[np.minimum(codes, of_tasks.shape[1])]
        if is_dask(codes):
            chunks = codes.chunks[0], (len(of_tasks),)
            options = {"new_axis": 1, "chunks": chunks, "dtype": float}
            return codes.map_blocks(lambda some: of_tasks.T[some], **options)
        return of_tasks.T[codes]

    def log_jacobian(self, counts):
        """Log density of targets in units of y less that in these, for each output."""
        counts = counts if self.own_scales else counts.sum()
        return -(np.log(self.scale) * counts).sum(axis=1)

    def without_levels(self, Y, codes, n_tasks, known=None):
        """The same centres, with the deviation of targets around those of the tasks.

        Where there is none, as of tasks with one row each, the scale stays.
        """
        n = count_tasks(codes, n_tasks, known)
        return self._around(n, *_moments(Y, codes, n_tasks, known))

    def _around(self, counts, mean, square):
        """The same from the moments of the tasks."""
        spread = np.sqrt(square @ counts / counts.sum())[:, None]
        told = spread > RESOLVED * np.abs(mean).max(axis=1, keepdims=True)
        return self._replace(scale=np.where(told, spread, self.scale))

    def without_far_levels(self, Y, codes, n_tasks, known=None):
        """The same, with centres of tasks where means of an output are far apart.

        What is left of a level is at most half a step, and is learned. So only its
        coarse size is taken from the rows.
        """
        far = self.far_levels(Y, codes, n_tasks, known)[:, None] > FAR
        if not far.any():
            return self
        step = STEP * self.scale
        mean, _ = _moments(Y, codes, n_tasks, known)
        away = step * np.rint((mean - self.centre) / step)
        return self._replace(centre=self.centre + np.where(far, away, 0.0))

    def far_levels(self, Y, codes, n_tasks, known=None):
        """Deviation of the tasks' means over the scale, for each output."""
        mean, _ = _moments(Y, codes, n_tasks, known)
        return mean.std(axis=1) / self.scale[:, 0]

    def with_task(self, Y, position, n_tasks, expected=None, known=None):
        """The units of one more task.

        Parameters
        ----------
        Y : ndarray of shape (n_samples, n_outputs)
            Its targets.
        position : int
            Where it goes among the others.
        n_tasks : int
            Number of these.
        expected : tuple of (mean, deviation), default=None
            Of the mean of the targets around the centre, as the others let it be:
            arrays of shape (n_outputs,). What is far from there becomes a centre of the
            task's own; as a level it would be a part of a function that is far too
            large. None without levels.
        known : Known, default=None
            How many measurements a row stands for, and their variance.

        Returns
        -------
        units : Units
        """
        usual = np.exp(np.log(self.scale).mean(axis=1))
        of_task, spread = _of_one(Y, usual, known)
        if self.own_scales:
            scale = np.insert(self.scale, position, spread, axis=1)
            return Units(np.insert(self.centre, position, of_task, axis=1), scale)
        own = self._nearest(of_task)
        if expected is not None:
            mean, deviation = expected
            away = of_task - own - mean
            own = own + np.where(np.abs(away) > UNLIKELY * deviation, away, 0.0)
        centre = self.centre
        if not self.own_centres:
            if (own == centre[:, 0]).all():
                return self
            centre = np.repeat(centre, n_tasks, axis=1)
        return self._replace(centre=np.insert(centre, position, own, axis=1))

    def _nearest(self, mean):
        """Of the centres that tasks may have, the nearest to a mean."""
        usual, step = _commonest(self.centre), STEP * self.scale[:, 0]
        alike = np.ptp(self.centre, axis=1) == 0.0
        return usual + np.where(alike, 0.0, step * np.rint((mean - usual) / step))

    def without_task(self, position):
        """The units of the other tasks; centres that are all the same are one."""
        centre, scale = (
            np.delete(of, position, axis=1) if of.shape[1] > 1 else of for of in self
        )
        alike = scale.shape[1] == 1 and (np.ptp(centre, axis=1) == 0.0).all()
        return Units(centre[:, :1] if alike else centre, scale)


def shared_units(Y, *, centred, scaled, known=None):
    """The mean and the deviation of all targets of an output.

    Parameters
    ----------
    Y : ndarray or dask.array.Array of shape (n_samples, n_outputs)
        Targets.
    centred : bool
        Whether to take off the mean, which is zero otherwise.
    scaled : bool
        Whether to divide by the root mean square of what is left.
    known : Known, default=None
        How many measurements a row stands for, and their variance.

    Returns
    -------
    units : Units
    """
    mean, scale = np.zeros(Y.shape[1]), np.ones(Y.shape[1])
    if known is not None:
        weigh = partial(np.average, axis=0, weights=known.counts)
        mean = weigh(Y) if centred else mean
        spread = np.sqrt(weigh(np.square(Y - mean) + known.spread))
    elif centred:
        mean, spread = (np.asarray(of(axis=0)) for of in (Y.mean, Y.std))
    else:
        spread = np.sqrt(np.asarray(np.square(Y).mean(axis=0)))
    varies = (spread > RESOLVED * np.abs(mean)) & scaled
    scale[varies] = spread[varies]
    return Units(mean[:, None], scale[:, None])


def units_of_tasks(Y, codes, n_tasks, known=None):
    """The mean and the deviation of each task's targets.

    A task of one or two rows, or whose targets are all the same, has the deviation that
    the others have on average, geometrically. If all tasks are like that, it is the
    deviation of all targets around the means of their tasks or, without any, around the
    common mean.

    Parameters
    ----------
    Y : ndarray or dask.array.Array of shape (n_samples, n_outputs)
        Targets.
    codes : ndarray or dask.array.Array of shape (n_samples,)
        Task of each row.
    n_tasks : int
        Number of tasks.
    known : Known, default=None
        How many measurements a row stands for, and their variance.

    Returns
    -------
    units : Units
    """
    n = count_tasks(codes, n_tasks, known)
    mean, square = _moments(Y, codes, n_tasks, known)
    shared = shared_units(Y, centred=True, scaled=True, known=known)
    shared = shared._around(n, mean, square)
    spread = np.sqrt(square)
    told = (n >= FEWEST) & (spread > RESOLVED * np.abs(mean))
    scale = np.empty_like(mean)
    for j, (of_tasks, which) in enumerate(zip(spread, told, strict=True)):
        usual = (
            np.exp(np.log(of_tasks[which]).mean()) if which.any() else shared.scale[j]
        )
        scale[j] = np.where(which, of_tasks, usual)
    return Units(mean, scale)


def _moments(Y, codes, n_tasks, known=None):
    """Mean and variance of the targets of each task, (n_outputs, n_tasks) each."""
    where = codes, n_tasks, known
    mean = means_of_tasks(Y, *where)
    # what is left of large targets; those of other tasks take no digits
    mean += means_of_tasks(_without(mean, Y, codes), *where)
    squares = np.square(_without(mean, Y, codes))
    return mean, means_of_tasks(
        squares if known is None else squares + known.spread, *where
    )


def _without(mean, Y, codes):
    """Targets, each taken off the mean of its task."""
    return Y - Units(mean, mean).of_rows(mean, codes)


def _commonest(of_tasks):
    """The number that most tasks have, of each output."""
    found = [np.unique(row, return_counts=True) for row in of_tasks]
    return np.array([values[counts.argmax()] for values, counts in found])


def _of_one(Y, usual, known=None):
    """Mean and deviation of the targets of one task."""
    n, counts, within = len(Y), None, 0.0
    if known is not None:
        n, counts, within = known.counts.sum(), known.counts, known.spread
    mean = np.average(Y, axis=0, weights=counts)
    squares = np.square(Y - mean) + within
    spread = np.sqrt(np.average(squares, axis=0, weights=counts))
    told = (n >= FEWEST) & (spread > RESOLVED * np.abs(mean))
    return mean, np.where(told, spread, usual)


def count_tasks(codes, n_tasks, known=None):
    """Number of rows of each task, or of the measurements that they stand for."""
    if known is not None:
        return np.bincount(codes, known.counts, n_tasks)
    return sum(map_parts(partial(np.bincount, minlength=n_tasks), codes))


def means_of_tasks(Y, codes, n_tasks, known=None):
    """Means over the rows of each task, of shape (n_outputs, n_tasks)."""
    Y = Y if known is None else Y * known.counts[:, None]
    sums = sum_parts(partial(_sum_part, n_tasks), (), (codes, Y))
    return sums / np.maximum(count_tasks(codes, n_tasks, known), 1)


def _sum_part(n_tasks, _, codes, Y):
    return np.array([np.bincount(codes, y, n_tasks) for y in np.asarray(Y).T])


def variance_of_means(y, codes, n_tasks, known=None):
    """Variance, over tasks, of the means of their targets."""
    counts = count_tasks(codes, n_tasks, known)
    [means] = means_of_tasks(y[:, None], codes, n_tasks, known)
    return float(np.var(means[counts > 0]))


def deviation_within(y, codes, n_tasks, known=None):
    """Deviation of targets about the means of their tasks, each of which takes one.

    It is zero if tasks have fewer than two measurements on average.
    """
    where = codes, n_tasks, known
    counts, mean = count_tasks(*where), means_of_tasks(y[:, None], *where)
    squares = np.square(_without(mean, y[:, None], codes))
    if known is not None:
        squares = squares + known.spread[:, None]
    [variance] = means_of_tasks(squares, *where)
    present = np.count_nonzero(counts)
    free = counts.sum() - present
    return float(np.sqrt((counts * variance).sum() / free)) if free >= present else 0.0
