"""Frequencies at which rows of several tasks repeat: a pooled periodogram.

A classical periodogram by FFT, of rows that are put on a fine grid, is fast but leaks
where rows are unevenly spread. So it only says where the peaks are. Around these the
likelihood of the first harmonics is computed from the rows themselves, as that of
Bayesian linear regression: its noise is estimated, and the harmonics' variances are
those of a periodic kernel. It takes no multiple of a period for the period, because a
multiple has harmonics that explain nothing.
"""

import numpy as np
from scipy.special import ive

FINEST = 2**14  # most cells of the grid
CELLS, FINER = 8.0, 8  # for each cycle, and frequencies for each in the width
MOST_CYCLES = FINEST / CELLS  # of which the grid is fine enough
HARMONICS = 5  # more vary little
TAKEN_OFF = 3  # of a period that is known
SHAPES = 1.0, 0.4  # length-scales of the periodic kernel: a wave, and pulses
SIGNALS = 3.0, 30.0, 300.0  # variance of the function, of the noise's
SUMMED = 1, 3  # harmonics whose power is summed at a time
MOST_TASKS = 16  # that are told apart: the largest
# To frequencies that may be mistaken for one.
RATIOS = 2.0, 3.0, 1 / 2, 1 / 3, 2 / 3, 3 / 2
STEPS = 0.06, 0.02  # cycles, to the top of a peak
EACH = 8  # peaks that are looked at, of each sort
NEAR = 0.3  # cycles between frequencies that are one peak's
AT_ONCE = 50_000  # rows times frequencies


def frequencies(x, tasks, y, most_cycles, n_best=2):
    """Where the periodogram is highest.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Of an input, from 0 to 1.
    tasks : ndarray of shape (n_samples,)
        Task of each row, from 0.
    y : ndarray of shape (n_samples,)
        Targets. Each task's level does not matter.
    most_cycles : float
        Highest frequency, in cycles from 0 to 1.
    n_best : int, default=2
        How many are wanted, of each sort: of targets as they are, and without a slow
        part; of functions of each task, and of one function.

    Returns
    -------
    cycles : ndarray of shape (n_found,)
        Ascending, from about 1 on. Some are multiples of others.
    """
    most_cycles, found = min(most_cycles, MOST_CYCLES), []
    for degree in (0, 2):
        rest = _without_slow(x, tasks, y, degree)
        if np.abs(rest).max(initial=0.0) <= 1e-10 * np.abs(y).max(initial=0.0):
            continue
        peaks = _peaks(x, tasks, rest, most_cycles)
        for together in (False, True):
            score = _Score(x, tasks, rest, together)
            found.extend(_best(score, peaks, most_cycles, n_best))
    return _apart(np.array(found))


def without_waves(x, tasks, y, cycles):
    """Targets without the first harmonics, of each task, of some frequencies.

    Parameters
    ----------
    x, tasks, y : ndarray of shape (n_samples,)
        See `frequencies`.
    cycles : ndarray of shape (n_cycles,)
        The frequencies.

    Returns
    -------
    rest : ndarray of shape (n_samples,)
    """
    of_waves = np.outer(cycles, np.arange(1, TAKEN_OFF + 1)).ravel()
    waves = np.exp(2j * np.pi * np.outer(x, of_waves))
    V = np.column_stack([np.ones(len(x)), waves.real, waves.imag])
    return _without(V, tasks, y)


def _without_slow(x, tasks, y, degree):
    """Targets without a polynomial of each task."""
    return _without((2.0 * x[:, None] - 1.0) ** np.arange(degree + 1), tasks, y)


def _without(V, tasks, y):
    """Targets without some functions of each task."""
    G = np.zeros((tasks.max(initial=-1) + 1, *V.shape[1:] * 2))
    b = np.zeros(G.shape[:2])
    np.add.at(G, tasks, V[:, :, None] * V[:, None, :])
    np.add.at(b, tasks, V * y[:, None])
    fitted = np.linalg.pinv(G, rcond=1e-10, hermitian=True) @ b[:, :, None]
    return y - (V * fitted[tasks, :, 0]).sum(axis=1)


def _largest(tasks):
    """The tasks that are told apart."""
    counts = np.bincount(tasks)
    return [task for task in _order(counts)[:MOST_TASKS] if counts[task]]


def _peaks(x, tasks, y, most_cycles):
    """Highest peaks of the classical periodogram, in cycles."""
    n_cells = 2 ** int(np.ceil(np.log2(CELLS * max(most_cycles, 2.0))))
    cells = np.rint(x * n_cells).astype(int)  # the last has another phase than 0

    def power(rows):
        sums = np.bincount(cells[rows], y[rows], n_cells + 1)
        return np.abs(np.fft.rfft(sums, n_cells * FINER)) ** 2

    parts = [tasks == task for task in _largest(tasks)]
    of_parts = [power(rows) / rows.sum() for rows in parts]
    kinds = [np.sum(of_parts, axis=0), power(slice(None))]
    first, last = FINER, int(most_cycles * FINER)
    found = []
    for of_kind in kinds:
        for n_summed in SUMMED:
            here = _harmonics(of_kind, n_summed, last)
            inner = (here[1:-1] >= here[:-2]) & (here[1:-1] >= here[2:])
            tops = 1 + np.flatnonzero(inner)
            tops = tops[(tops >= first) & (tops <= last)]
            found.append(tops[_order(here[tops])[:EACH]])
    return _apart(np.concatenate([np.array([1.0]), np.concatenate(found) / FINER]))


def _harmonics(power, n_summed, last):
    """Power at each frequency and its multiples."""
    j = np.arange(last + 2)
    return sum(power[k * j] for k in range(1, n_summed + 1))


def _apart(cycles):
    """Ascending, without those that belong to the peak of one before."""
    kept = []
    for one in np.sort(cycles):
        if not kept or one - kept[-1] > NEAR:
            kept.append(one)
    return np.array(kept)


def _best(score, cycles, most_cycles, n_best):
    """The best of the peaks, their multiples and fractions, each at its top."""
    values = score(cycles)
    best = cycles[_order(values)[:n_best]]
    others = np.outer(best, RATIOS).ravel()
    others = others[(others >= 1.0) & (others <= most_cycles)]
    cycles, values = np.append(cycles, others), np.append(values, score(others))
    best = cycles[_order(values)[: 4 * n_best]]
    for step in STEPS:
        tried = best[:, None] + step * np.arange(-2, 3)
        values = score(tried.ravel()).reshape(tried.shape)
        best = tried[np.arange(len(best)), values.argmax(axis=1)]
    return _unrelated(best[_order(values.max(axis=1))])[:n_best]


def _unrelated(cycles):
    """Those that may not be mistaken for one before: others have other periods."""
    kept = []
    for one in cycles:
        others = np.outer(kept, [1.0, *RATIOS])
        if not (np.abs(one - others) <= NEAR).any():
            kept.append(one)
    return np.array(kept)


def _order(values):
    """From the highest on."""
    return np.argsort(-values, kind="stable")


class _Score:
    """Log likelihood of harmonics, with a price for the many high frequencies."""

    def __init__(self, x, tasks, y, together):
        largest = [tasks == task for task in _largest(tasks)]
        kept = np.any(largest, axis=0) | together
        self.x, self.y = x[kept], y[kept]
        self.tasks = np.unique(tasks[kept], return_inverse=True)[1]
        counts = np.bincount(self.tasks)
        self.mean_of = np.eye(len(counts))[self.tasks] / counts
        parts = [np.ones(kept.sum(), dtype=bool)] if together else largest
        self.parts = [rows if together else rows[kept] for rows in parts]
        self.n_free = max(1, len(self.y) - len(counts))

    def __call__(self, cycles):
        parts = np.array_split(cycles, 1 + len(cycles) * len(self.x) // AT_ONCE)
        return np.concatenate(list(map(self._of, parts))) - np.log(cycles)

    def _of(self, cycles):
        first = np.exp(2j * np.pi * np.outer(cycles, self.x))[:, None]
        powers = np.cumprod(np.repeat(first, HARMONICS, axis=1), axis=1)
        waves = np.concatenate([powers.real, powers.imag], axis=1)
        waves -= (waves @ self.mean_of)[:, :, self.tasks]
        values = [self._with(waves * _sizes(shape)[:, None]) for shape in SHAPES]
        return np.max(values, axis=(0, 1))

    def _with(self, waves):
        """By the ratio of signal and noise, and the frequency."""
        signals = np.array(SIGNALS)[:, None]
        determinant, explained = 0.0, 0.0
        for rows in self.parts:
            of_part = waves[:, :, rows]
            G = of_part @ of_part.transpose(0, 2, 1)
            e, V = np.linalg.eigh(G)
            b = np.einsum("fkj,fk->fj", V, of_part @ self.y[rows])
            widened = 1.0 + signals[..., None] * np.maximum(e, 0.0)
            determinant = determinant + np.log(widened).sum(axis=2)
            explained = explained + (signals[..., None] * b**2 / widened).sum(axis=2)
        total = self.y @ self.y or 1.0
        left = np.maximum(1.0 - explained / total, 1e-10)
        return -0.5 * determinant - 0.5 * self.n_free * np.log(left)


def _sizes(shape):
    """Deviations of the waves, twice, of a periodic kernel with a length-scale."""
    variances = ive(np.arange(1, HARMONICS + 1), shape**-2.0)
    return np.sqrt(np.tile(variances / variances.sum(), 2))
