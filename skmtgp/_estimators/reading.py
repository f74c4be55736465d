"""What a model learns from, as the user gives it: checked, encoded and put together."""

import numpy as np

from skmtgp._data.checks import check_training
from skmtgp._data.complete import count_copies
from skmtgp._data.dask import is_dask
from skmtgp._data.descriptors import locate_descriptors, read_descriptors
from skmtgp._data.known import read_known, weighed_rows
from skmtgp._data.labels import Labels
from skmtgp._data.oddities import (
    FEW_ROWS,
    warn_of_constants,
    warn_of_copies,
    warn_of_counts,
)
from skmtgp._data.outliers import far_off, warn_of_outliers
from skmtgp._data.partitions import check_partitions
from skmtgp._data.sticking import stuck_runs, warn_of_sticking
from skmtgp._data.task_column import locate
from skmtgp._data.trend import read_trend
from skmtgp._estimators.slopes import Slopes
from skmtgp._estimators.targets import fit_target
from skmtgp._estimators.training import Training
from skmtgp.inference.engines import leaves_rows, repeats_rows

MOST_ROWS = 100_000  # of which copies are looked for
NOTHING = None, None, None  # is known of the noise of the rows


def read(model, X, y, given=NOTHING):
    """The training data of `fit`; units, noise and k^x are not decided yet.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Gets n_features_in_ and feature_names_in_.
    X, y : array-like
        What the user gave.
    given : tuple of (alpha, sample_weight, repeat_variance), default=NOTHING
        What is known of the noise of the rows.

    Returns
    -------
    training : Training

    Raises
    ------
    ValueError
        If something cannot be used, which it names.
    """
    plain = all(part is None for part in given)
    repeats = repeats_rows(model.inference)
    X, y, given = weighed_rows(X, y, given, repeats=repeats)
    stay = is_dask(X, y) and leaves_rows(model.inference)
    if stay:
        _refuse_what_needs_rows(model, given)
    check = check_partitions if stay else check_training
    training = gathered(model, *check(model, X, y), given)
    if plain and not stay:
        tell_copies(model, training.features, training.codes, training.Y)
        _tell_outliers(training)
        _tell_sticking(training)
    elif not plain and repeats and training.known is None and learns_noise(model):
        copies = count_copies(training.features, training.codes, training.Y)
        warn_of_counts(copies, inference=model.inference)
    return training


def _refuse_what_needs_rows(model, given):
    """Raise a ValueError where an argument needs rows that are not in memory."""
    way = model.hyperparameters
    drawn, trend = way in ("laplace", "sampled"), getattr(model, "trend", None)
    known = any(part is not None for part in given)
    for is_asked, name, instead in (
        (drawn, f"hyperparameters={way!r}", "set hyperparameters='mode'"),
        (has_descriptors(model), "task_descriptors", "leave the descriptors out"),
        (trend is not None, "trend", "leave the trend out"),
        (known, "alpha or sample_weight", "leave it out"),
    ):
        if is_asked:
            raise ValueError(
                f"{name} needs the rows in memory, and X is a Dask collection. Give "
                f"arrays, which may be memory-mapped, or {instead}."
            )


def gathered(model, features, codes, tasks, Y, given=NOTHING):
    """The same of rows that are checked and encoded.

    Parameters
    ----------
    model : BaseMultiTaskGP
        Its parameters say how to transform targets, and which trend there is.
    features, codes, tasks, Y
        See `check_training`.
    given : tuple of (alpha, sample_weight, repeat_variance), default=NOTHING
        What is known of the noise of the rows.

    Returns
    -------
    training : Training
    """
    single_output, Y = Y.ndim == 1, Y.reshape(len(Y), -1)
    known = read_known(*given, Y.shape)
    if known is not None:
        known.refuse_transform(model.target_transform)
    target = fit_target(model.target_transform, Y)
    Y, described = target.forward(Y), None
    if has_descriptors(model):
        described = _descriptors(model, features, Labels(tasks, codes))
        features = described.inputs(features)
    slopes = _slopes(model, features, codes, tasks, described)
    _tell_constants(model, Y)
    more = {"target": target, "slopes": slopes, "known": known}
    return Training(
        features, codes, tasks, Y, single_output, descriptors=described, **more
    )


def tell_copies(model, features, codes, Y):
    """Warn of rows that are there twice, where noise is learned."""
    if looks_for_copies(model, Y):
        warn_of_copies(count_copies(features, codes, Y))


def tell_counts(model, known):
    """Warn of rows that count more than once, as if their measurements were equal."""
    if known is not None and learns_noise(model):
        spread = known.spread.reshape(len(known.counts), -1)
        counts = known.counts[~spread.any(axis=1)]
        warn_of_counts((counts - 1.0).sum(), whole=(counts % 1.0 == 0.0).all())


def looks_for_copies(model, Y):
    """Whether copies among rows with these targets matter, and can be found."""
    return learns_noise(model) and len(Y) <= MOST_ROWS


def learns_noise(model):
    """Whether the noise is not known before the fit."""
    return model.max_iter and not isinstance(model.noise_variance_bounds, str)


def _tell_outliers(training):
    """Warn of targets that are far from all others, whatever the trend."""
    far = far_off(training.unexplained(False), training.codes)
    if far.any():
        targets = training.target.back(training.Y)
        warn_of_outliers(far, targets, training.codes, training.tasks)


def _tell_sticking(training):
    """Warn of sensors that seem to be stuck."""
    Y = training.target.back(training.Y)
    for j, y in enumerate(Y.T, 1):
        runs = stuck_runs(training.features, training.codes, y)
        if runs:
            which = f" in output {j}" * (Y.shape[1] > 1)
            warn_of_sticking(runs, training.tasks, which)


def _tell_constants(model, Y):
    """Warn of targets that do not vary."""
    if len(Y) > FEW_ROWS:
        same = np.asarray(Y.min(axis=0) == Y.max(axis=0))
        # without normalize_y one that is not zero has a size, if nothing else
        sized = not model.normalize_y and model._learns_amplitude()
        warn_of_constants(same & ~(sized & np.asarray(Y.max(axis=0) != 0.0)))


def has_descriptors(model):
    """Whether tasks have descriptors, which are columns of X."""
    return getattr(model, "task_descriptors", None) is not None


def _descriptors(model, features, labels):
    """What is known of the tasks, from their columns of the features."""
    names, columns = locate(model)[1], columns_of_descriptors(model)
    return read_descriptors(columns, names, features, labels)


def columns_of_descriptors(model):
    """Where they are among the columns of X without the task's."""
    names = getattr(model, "feature_names_in_", None)
    position, n = locate(model)[0], model.n_features_in_
    return locate_descriptors(model.task_descriptors, position, n, names)


def names_of_inputs(model):
    """Names of the columns that the kernel sees; None without names."""
    if getattr(model, "feature_names_in_", None) is None:
        return None
    names = locate(model)[1]
    if has_descriptors(model):
        names = np.delete(names, columns_of_descriptors(model))
    return names.tolist()


def _slopes(model, inputs, codes, tasks, descriptors):
    """The trend at the training rows, None without one."""
    trend = getattr(model, "trend", None)
    per_task = getattr(model, "trend_per_task", False)
    if trend is None:
        if per_task:
            raise ValueError(
                "trend_per_task=True needs a trend: name its columns in trend, or set "
                "trend='linear'."
            )
        return None
    given = getattr(model, "feature_names_in_", None)
    described = None if descriptors is None else descriptors.columns
    columns = read_trend(trend, inputs, *locate(model), given, described)
    slopes = Slopes(
        columns, inputs, codes, tasks, bool(per_task), bool(model.normalize_y)
    )
    slopes.check()
    return slopes
