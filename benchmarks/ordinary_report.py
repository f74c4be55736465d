"""The report of ordinary.py: tables by class, and which goals are met.

Best known is the highest objective of the same model (rank, units, noise, ...) of the
same problem, whoever found it: the log likelihood and, where each task has its own
noise, the log density by which their variances are alike. A fit counts in the columns
of nats where "best" has looked for it. Ratios of errors are medians over the problems
of a class. "best of 3" is the ratio over the least of the errors of IndependentGP,
PooledGP and SingleTaskGP, which is taken for each problem. Coverage is of 95 %
intervals of y, "noise" the deviation that was learned over the true one.
"""

import json

import numpy as np
import pandas as pd

BY_PRIOR = ("small-tasks",)  # rows of F that are not the likeliest
CLOSE, MOST = 0.5, 5.0  # nats below the best known
SHARES = {"default": 0.98, "search": 0.99}
RATIOS = {"default": 1.10, "search": 1.05}
NAMES = {"default": "MultiTaskGPRegressor()", "search": "RankSearchIC()"}
BASELINES = "independent", "pooled", "single"
RANKED = "rank-1", "rank-2", "rank-3"  # eight tasks of ten rows and more
RIGHT = 0.95  # of the ranks that BIC chooses there
BESIDE = "ridge", "leveled"  # for hundreds of tasks, in each draw
ERRORS = 2.0  # standard errors over tasks by which an error is worse beyond noise
COVERED = 0.92, 0.97
POOR = 1.5  # an error over the best of the baselines', to be listed
SHOWN = 40  # fits of a list, the worst first


class Verdicts:
    """Goals, and whether they are met."""

    def __init__(self):
        self.rows = []

    def judge(self, of, measure, value, limit, sign=1):
        """Keep whether a value is at most a limit, or at least where sign is -1."""
        if value is None or np.isnan(value):
            return
        met = sign * round(value, 4) <= sign * round(limit, 4)
        goal = f"at {'most' if sign > 0 else 'least'} {limit:g}"
        shown = f"{value:.4g}"
        self.rows.append((of, measure, shown, goal, "met" if met else "NOT MET"))

    def show(self):
        """Print the table."""
        columns = ["of", "measure", "value", "goal", "is"]
        print("\nGoals\n")
        print(pd.DataFrame(self.rows, columns=columns).to_string(index=False))


def report(rows, settings):
    """Print what there is.

    Parameters
    ----------
    rows : list of dict
        Of the file.
    settings : str
        Of the two models; the others have none.
    """
    rows = [{**row, "class": row["problem"].split("/")[0]} for row in rows]
    best, errors = best_known(rows), errors_of(rows)
    verdicts = Verdicts()
    for model, name in NAMES.items():
        fits = [r for r in rows if (r["model"], r["settings"]) == (model, settings)]
        if fits:
            print(f"\n{name}, {settings}\n")
            table = pd.DataFrame([described(fit, best, errors) for fit in fits])
            print(by_class(table).to_string(float_format="{:.3g}".format))
            show_far(table)
            show_poor(table)
            judge(verdicts, model, table)
    show_failures(rows)
    if verdicts.rows:
        verdicts.show()


def best_known(rows):
    """The highest objective of each problem and model; whether it was looked for."""
    found = {}
    for row in rows:
        if "objective" not in row:
            continue
        key = row["problem"], config_of(row)
        value, sought = found.get(key, (-np.inf, False))
        found[key] = max(value, row["objective"]), sought or row["model"] == "best"
    return found


def config_of(row):
    """The model whose objective it is."""
    return json.dumps(row["config"], sort_keys=True)


def errors_of(rows):
    """Errors of each task, of the baselines of each problem."""
    return {
        (row["problem"], row["model"]): np.array(row["errors"], dtype=float)
        for row in rows
        if "errors" in row and row["model"] not in NAMES
    }


def described(fit, best, errors):
    """A fit beside the best known and the baselines."""
    kept = {key: fit.get(key) for key in ("problem", "class", "seconds", "evaluations")}
    kept |= {"failed": "failed" in fit, "coverage": fit.get("coverage", np.nan)}
    kept |= {"noise": fit.get("noise", np.nan), "/best of 3": np.nan}
    kept |= {"below": np.nan, "best": np.nan, "found": fit.get("objective")}
    if kept["failed"]:
        return kept
    if "config" in fit:
        value, sought = best.get((fit["problem"], config_of(fit)), (np.nan, False))
        if sought and fit["class"] not in BY_PRIOR:
            kept |= {"below": value - fit["objective"], "best": value}
    kept["chose"] = chosen(fit)
    if fit.get("right") is not None:
        kept["right"] = fit["right"]
    own = np.array(fit["errors"], dtype=float)
    of_this = {m: e for (problem, m), e in errors.items() if problem == fit["problem"]}
    kept |= {f"/{m}": own.mean() / np.nanmean(e) for m, e in of_this.items()}
    kept |= {f"-{m}": worse(own, of_this[m]) for m in BESIDE if m in of_this}
    kept["/best of 3"] = over_best(own, of_this)
    if fit["unrelated"] is not None:
        kept |= by_relation(own, of_this, fit["unrelated"])
    return kept


def worse(own, other):
    """Whether errors of tasks are larger beyond noise."""
    more = own - other
    return float(more.mean() > ERRORS * more.std(ddof=1) / np.sqrt(len(more)))


def chosen(fit):
    """What was chosen, in a few words."""
    if "config" not in fit:
        return fit["chose"]
    config = fit["config"]
    return f"{fit['chose']}, {config['normalize_y']} units, {config['noise']}"


def over_best(own, of_this, tasks=slice(None)):
    """An error over the least of the baselines', of some tasks."""
    known = [of_this[name][tasks].mean() for name in BASELINES if name in of_this]
    return own[tasks].mean() / min(known) if len(known) == len(BASELINES) else np.nan


def by_relation(own, of_this, alone):
    """Errors of the unrelated task and of the others, over what they are apart."""
    others = np.arange(len(own)) != alone
    found = {"others/best of 3": over_best(own, of_this, others)}
    if "single" in of_this:
        found["alone/single"] = own[alone] / of_this["single"][alone]
    if "without" in of_this:
        without = of_this["without"][others].mean()
        found["others/without it"] = own[others].mean() / without
    return found


def by_class(table):
    """A line for each class, and one for all."""
    groups = list(table.groupby("class", sort=False))
    lines = {name: line(part) for name, part in [*groups, ("ALL", table)]}
    return pd.DataFrame(lines).T.dropna(axis=1, how="all")


def line(part):
    """What is said of some fits."""
    known = part["below"].dropna()
    found = {
        "fits": len(part),
        "failed": int(part["failed"].sum()),
        "known": len(known),
        "close %": 100.0 * (known <= CLOSE).mean() if len(known) else np.nan,
        "largest": known.max() if len(known) else np.nan,
    }
    beside = [f"/{name}" for name in (*BASELINES, *BESIDE)]
    for column in ("/truth", *beside, "/best of 3"):
        found[column] = part[column].median() if column in part else np.nan
    right = part["right"].dropna() if "right" in part else part["below"].head(0)
    return found | {
        "coverage": part["coverage"].mean(),
        "noise": part["noise"].median(),
        "rank %": 100.0 * right.mean() if len(right) else np.nan,
        "s": part["seconds"].median(),
        "s, all": part["seconds"].sum(),
        "evaluations": part["evaluations"].median(),
    }


def show_far(table):
    """The fits that are not close to the best known."""
    far = table[table["below"] > CLOSE].sort_values("below", ascending=False)
    if len(far):
        print(f"\nMore than {CLOSE:g} nats below the best known: {len(far)}\n")
        columns = ["problem", "found", "best", "below", "chose"]
        print(far[columns].head(SHOWN).to_string(index=False))


def show_poor(table):
    """The fits that are worse than the best of the baselines, the worst first."""
    poor = table[table["/best of 3"] > POOR].sort_values("/best of 3", ascending=False)
    if len(poor):
        print(f"\nErrors of more than {POOR:g} times the best of 3: {len(poor)}\n")
        columns = ["problem", "/best of 3", "/truth", "coverage", "noise", "chose"]
        shown = [column for column in columns if column in poor]
        print(
            poor[shown].head(SHOWN).to_string(index=False, float_format="{:.3g}".format)
        )


def show_failures(rows):
    """The fits that failed."""
    failed = [row for row in rows if "failed" in row]
    if failed:
        print(f"\nFailed: {len(failed)}\n")
    for row in failed:
        print(f"{row['problem']} {row['model']} ({row['settings']}): {row['failed']}")


def judge(verdicts, model, table):
    """The goals of a model."""
    name, known = NAMES[model], table["below"].dropna()
    verdicts.judge(name, "failed", float(table["failed"].sum()), 0.0)
    if len(known):
        share = float((known <= CLOSE).mean())
        verdicts.judge(name, f"within {CLOSE:g} nats", share, SHARES[model], -1)
        verdicts.judge(name, "nats below, largest", float(known.max()), MOST)
    judge_errors(verdicts, name, RATIOS[model], table)
    if model == "search":
        judge_search(verdicts, name, table)


def judge_errors(verdicts, name, limit, table):
    """Errors over those of the best of three in each class; the unrelated task."""
    columns = ["/best of 3", "alone/single", "others/best of 3", "others/without it"]
    for of, part in table.groupby("class", sort=False):
        for column in columns:
            if column in part:
                measure = f"{of}: error{'' if column[0] == '/' else ', '}{column}"
                verdicts.judge(name, measure, part[column].median(), limit)


def judge_search(verdicts, name, table):
    """Ranks, and hundreds of tasks."""
    ranked = table[table["class"].isin(RANKED) & ~table["failed"]]
    if len(ranked):
        right = float(ranked["right"].astype(float).mean())
        verdicts.judge(
            name, "rank right, 8 tasks of 10 rows and more", right, RIGHT, -1
        )
    for of, part in table.groupby("class", sort=False):
        known = part.dropna(axis=1, how="all")
        hundreds = [other for other in BESIDE if f"-{other}" in known]
        for other in hundreds:
            measure = f"{of}: draws worse than {other}"
            verdicts.judge(name, measure, part[f"-{other}"].sum(), 0.0)
        if hundreds:
            covered = float(part["coverage"].mean())
            verdicts.judge(name, f"{of}: coverage", covered, COVERED[0], -1)
            verdicts.judge(name, f"{of}: coverage", covered, COVERED[1])
