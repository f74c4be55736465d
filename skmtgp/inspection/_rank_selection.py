"""Information criteria of each rank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from skmtgp.inspection._drawing import Display, check_option, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CRITERIA = "bic", "aic", "hqc", "loo", "laplace"
# A difference of BIC that is very strong evidence (Kass and Raftery, 1995).
CLEAR = 10.0


class RankSelectionDisplay(Display):
    """Information criteria against the rank of the task covariance.

    If simpler models of the same rank were candidates, too, the axis has the names of
    all candidates.

    Parameters
    ----------
    results : mapping or DataFrame
        ``results_`` of a RankSearchIC, with the columns rank, bic, aic, hqc and, if it
        was the search's criterion, loo or laplace. With several candidates of one rank
        also model and chosen.
    best_rank : int
        The chosen rank.

    Attributes
    ----------
    lines_ : list of matplotlib Line2D
        One for each criterion.
    chosen_ : matplotlib Line2D
        Mark of the chosen rank.
    ax_ : matplotlib Axes
        Axes of the drawing.
    figure_ : matplotlib Figure
        The figure of the axes.

    See Also
    --------
    skmtgp.RankSearchIC : Chooses the rank.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> import numpy as np
    >>> from skmtgp import RankSearchIC
    >>> from skmtgp.inspection import RankSelectionDisplay
    >>> rng = np.random.default_rng(0)
    >>> x, task = rng.uniform(0, 6, 60), np.tile([0, 1, 2], 20)
    >>> y = np.array([1.0, -2.0, 0.5])[task] * np.sin(x)
    >>> y += 0.1 * rng.standard_normal(60)
    >>> search = RankSearchIC(ranks=(1, 2, 3)).fit(np.column_stack([x, task]), y)
    >>> RankSelectionDisplay.from_estimator(search)
    <...>
    >>> plt.show()

    Several criteria, each less its minimum:

    >>> RankSelectionDisplay.from_estimator(search, criteria=["bic", "aic", "hqc"])
    <...>
    >>> plt.show()
    """

    def __init__(self, *, results: Mapping[str, Any], best_rank: int) -> None:
        self.results = results
        self.best_rank = best_rank

    def plot(
        self, *, ax: Axes | None = None, criteria: str | Sequence[str] = "bic"
    ) -> Self:
        """Draw one criterion, or compare several.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        criteria : str or sequence of str, default="bic"
            "bic", "aic", "hqc", "loo" or "laplace". If there are several, the minimum
            of each is subtracted, and the axis is linear up to 10 and logarithmic
            above.

        Returns
        -------
        display : RankSelectionDisplay
            The display itself.

        Raises
        ------
        ValueError
            If a criterion is none of these, or if it is "loo" or "laplace" and the
            search did not use it.
        """
        names: list[str] = [criteria] if isinstance(criteria, str) else [*criteria]
        for name in names or [""]:
            check_option("criteria", name, CRITERIA)
        for name in names:
            if name not in self.results:
                raise ValueError(
                    f"The search has computed no {name!r}: fit a RankSearchIC with "
                    f"criterion={name!r}."
                )
        ax = self._set_axes(ax)
        at, label = self._chosen()
        self.chosen_ = ax.axvline(
            at, color="0.6", lw=6, alpha=0.4, label=f"{label}, chosen"
        )
        several = len(names) > 1
        self.lines_ = [self._draw(name, k, several) for k, name in enumerate(names)]
        largest = max(np.nanmax(line.get_ydata()) for line in self.lines_)
        if several and largest > CLEAR:
            ax.set_yscale("symlog", linthresh=CLEAR)
        ax.set_ylabel("criterion less its minimum" if several else names[0].upper())
        if self._has_names():
            names = np.asarray(self.results["model"])
            ax.set_xticks(self._positions(), names, rotation=30, ha="right")
        else:
            ax.set_xticks(self._positions())
            ax.set_xlabel("rank of the task covariance")
        ax.legend()
        return self

    def _has_names(self):
        """Whether ranks do not tell the candidates apart."""
        ranks = np.asarray(self.results["rank"])
        return ranks.dtype == object or len(np.unique(ranks)) < len(ranks)

    def _positions(self):
        ranks = np.asarray(self.results["rank"])
        return np.arange(len(ranks)) if self._has_names() else ranks

    def _chosen(self):
        """Where the chosen candidate is, and its name."""
        if not self._has_names():
            return self.best_rank, f"rank {self.best_rank}"
        at = int(np.argmax(self.results["chosen"]))
        return at, np.asarray(self.results["model"])[at]

    def _draw(self, name, k, relative):
        values = np.asarray(self.results[name], dtype=np.float64)
        values = values - np.nanmin(values) if relative else values
        at = self._positions()
        (line,) = self.ax_.plot(at, values, label=name.upper(), **style(k))
        return line

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        *,
        ax: Axes | None = None,
        criteria: str | Sequence[str] | None = None,
    ) -> Self:
        """Draw the criteria of a search.

        Parameters
        ----------
        estimator : RankSearchIC or Pipeline that ends with one
            Fitted.
        ax : matplotlib Axes, default=None
            Axes to draw on. None makes a new figure.
        criteria : str or sequence of str, default=None
            "bic", "aic", "hqc", "loo" or "laplace". If there are several, the minimum
            of each is subtracted. None takes `criterion_`, which the search used,
            and BIC beside it if that said of which candidates to compute it.

        Returns
        -------
        display : RankSelectionDisplay
            The display, drawn.

        Raises
        ------
        NotFittedError
            If the search was not fitted.
        TypeError
            If the estimator is not a RankSearchIC.
        ValueError
            If a criterion is none of these, or if it is "loo" or "laplace" and the
            search did not use it.
        """
        search = estimator[-1] if isinstance(estimator, Pipeline) else estimator
        check_is_fitted(search)
        if not hasattr(search, "results_"):
            raise TypeError(
                f"{type(search).__name__} has compared no ranks: fit a RankSearchIC."
            )
        display = cls(results=search.results_, best_rank=search.best_rank_)
        if criteria is None:
            criteria = search.criterion_
            if np.isnan(np.asarray(search.results_[criteria], dtype=float)).any():
                criteria = ["bic", criteria]  # which said where to look
        return display.plot(ax=ax, criteria=criteria)
