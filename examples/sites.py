"""Five sites, some with few measurements: one model of all, and a model of each.

``python examples/sites.py`` prints the errors that README.md shows and draws its first
figure, by default into examples/output. It needs matplotlib.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from skmtgp import MultiTaskGPRegressor, SingleTaskGP
from skmtgp.datasets import make_sites
from skmtgp.inspection import TaskPredictionDisplay

OUTPUT = Path(__file__).parent / "output" / "sites.png"


def fitted(X, y):
    """The models by what they are called in the figure."""
    return {
        "one model of all": MultiTaskGPRegressor(task_feature="site").fit(X, y),
        "a model of each": SingleTaskGP(task_feature="site").fit(X, y),
    }


def errors(models, sites, truth):
    """Root mean squared errors over a whole day, by site and model."""
    rows = [(site, hour) for site in sites for hour in np.arange(0.0, 24.0, 0.5)]
    day = pd.DataFrame(rows, columns=["site", "hour"])
    squares = {
        name: np.square(model.predict(day) - truth(day))
        for name, model in models.items()
    }
    means = pd.DataFrame(squares).groupby(day["site"]).mean()
    return means.loc[sites] ** 0.5


def draw(models, X, y, truth, sites, narrow=False):
    """The predictions: a row of panels for each model, or on phones a column."""
    shape = (len(models), len(sites))
    figure, axes = plt.subplots(
        *(shape[::-1] if narrow else shape),
        figsize=(4.2, 7.2) if narrow else (9.5, 4.2),
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    panels, lines = axes.T if narrow else axes, []
    for row, (name, model) in zip(panels, models.items(), strict=True):
        display = TaskPredictionDisplay.from_estimator(
            model, X, y, truth=truth, tasks=sites, ax=row
        )
        display.lines_[0].set_label(name)
        lines += display.lines_[:1]
        for ax, site in zip(row, sites, strict=True):
            ax.set(title=f"{site}: {(X['site'] == site).sum()} rows")
            ax.set(xlabel="", ylabel="", xticks=[0, 6, 12, 18, 24])
    name_models(panels, models, narrow)
    for ax in axes[-1]:
        ax.set_xlabel("hour")
    others = display.bands_[0], display.truths_[0], display.observed_[0]
    style = {"loc": "outside upper center", "ncols": 2 if narrow else 5}
    figure.legend(handles=[*lines, *others], frameon=False, **style)
    return figure


def name_models(panels, models, narrow):
    """Above the columns, or beside the rows, which then need the sites but once."""
    for row, name in zip(panels, models, strict=True):
        if narrow:
            row[0].set_title(f"{name}\n\n{row[0].get_title()}")
        else:
            row[0].set_ylabel(name)
    for ax in [] if narrow else panels[1:].flat:
        ax.set_title("")


def main():
    """Fit, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=OUTPUT)
    output = parser.parse_args().output
    X, y, truth = make_sites(return_truth=True)
    sites = X["site"].unique().tolist()
    models = fitted(X, y)
    print(errors(models, sites, truth).round(2).T.to_string())
    output.parent.mkdir(parents=True, exist_ok=True)
    draw(models, X, y, truth, sites).savefig(output, dpi=150)
    narrow = draw(models, X, y, truth, sites, narrow=True)
    narrow.savefig(output.with_stem(f"{output.stem}-narrow"), dpi=200)


if __name__ == "__main__":
    main()
