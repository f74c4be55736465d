"""Errors on everyday data, from what benchmarks/real_data.py has measured."""

from statistics import mean

from markup import DASH, number, table

SETS = {  # in the order of the pages
    "boys": "heights of boys, by age",
    "states": "output of states of the USA, by year",
    "pupils": "marks of pupils, by school",
    "firms": "investment of firms, by year",
    "jura": "metals in soil (Jura)",
    "jura_logs": "metals in soil, in logarithms",
    "meat": "contents of meat, from spectra",
    "ur10e": "motor currents of a UR10e arm",
    "ur10e_friction": "the same, with the directions of turning as inputs",
}
DEFAULT = "MultiTaskGPRegressor"
MODELS = (
    *(DEFAULT, "RankSearchIC", "default, map", "default, sampled"),
    *("IndependentGP", "PooledGP", "SingleTaskGP"),
    *("GPR of each task", "GPR, one-hot tasks", "ridge", "boosted trees"),
    *("GPy ICM", "GPy LMC", "GPyTorch ICM", "GPyTorch LMC"),
)


def of_set(rows, data):
    """The fits to a set that came to an end."""
    return [r for r in rows if r["data"] == data and "tests" in r]


def there(rows):
    """The sets that have been measured, in order."""
    found = {r["data"] for r in rows if "tests" in r}
    return [data for data in SETS if data in found]


def tests(rows):
    """The names of a set's test sets."""
    return list(rows[0]["tests"])


def outputs(rows, model):
    """What a model has been fitted to."""
    return {(r["draw"], r["output"]) for r in rows if r["model"] == model}


def mean_of(rows, model, of, value):
    """The mean of a value of a model's fits to some outputs."""
    own = [r for r in rows if r["model"] == model and (r["draw"], r["output"]) in of]
    return mean(map(value, own))


def sets_table(rows):
    """What the sets are."""
    lines = []
    for data in there(rows):
        row = of_set(rows, data)[0]
        lines.append((SETS[data], f"`{data}`", row["n"], row["tasks"], row["measure"]))
    head = ["data", "name", "rows learned from", "tasks", "error"]
    return table(head, lines, "---") if lines else "Not measured."


def tables(rows):
    """A table for each test set of each set."""
    text = []
    for data in there(rows):
        fits = of_set(rows, data)
        for test in tests(fits):
            name = SETS[data]
            title = f"{name[0].upper()}{name[1:]}, n = {fits[0]['n']}, "
            title += f"{fits[0]['tasks']} tasks, predicted: {test}\n"
            text += [title, one_table(fits, test, fits[0]["measure"])]
    return text or ["Not measured."]


def one_table(fits, test, measure):
    """Means of each model over what it was fitted to."""
    lines = []
    for model in MODELS:
        own = [r for r in fits if r["model"] == model]
        if own:
            columns = [[r["tests"][test][k] for r in own] for k in COLUMNS]
            means = [number(mean(values)) for values in columns]
            draws = len({r["draw"] for r in own})
            seconds = sum(r["seconds"] for r in own) / draws
            lines.append((model, *means, number(seconds), len(own)))
    return table(["model", measure, "MSLL", "coverage", "seconds", "fits"], lines)


COLUMNS = "error", "msll", "coverage"


def compared(rows, data, test, groups):
    """Errors on the same outputs: the lowest of each group of models.

    Returns
    -------
    errors : list of (float, float) or None
        The error and the seconds of that model's fits; None where none was fitted.
    """
    fits = of_set(rows, data)
    models = [model for group in groups for model in group if outputs(fits, model)]
    same = set.intersection(*(outputs(fits, model) for model in models))
    found = []
    for group in groups:
        costs = [
            (
                mean_of(fits, model, same, lambda r: r["tests"][test]["error"]),
                mean_of(fits, model, same, lambda r: r["seconds"]),
            )
            for model in group
            if model in models
        ]
        found.append(min(costs, default=None))
    return found


def shown(value):
    """An error with three digits, never in full powers where it need not be."""
    if value is None:
        return DASH
    return f"{value:.3g}" if value >= 1e-3 else f"{value:.1e}"
