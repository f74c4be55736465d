"""The report of grouped.py: tables of models and of sets."""

from collections import Counter

import numpy as np
import pandas as pd
from grouped_data import LAST
from grouped_models import DEFAULT, FITTED, GPS, MODELS, SEARCH
from ordinary_models import settings_of

AS_SHIPPED = settings_of({})
WORST = 3.0  # which a log loss above counts as
APART, POOR = 1.05, 0.8  # a ratio of errors, and a coverage, that count
TOLD = "NarrowIntervalsWarning"

HEADER = f"""
"ratio" is the geometric mean over sets of the RMSE over that of {DEFAULT}
as shipped, on the splits that both have. "better" and "worse" are the shares of sets in
which it is more than 5 % better or worse. "log loss" is the mean over fits of the log
loss less the log of the deviation of all targets of the set, where one above
{WORST:g} counts as {WORST:g}, so that single disasters do not decide; "median" is the
median of the same. "cover" is the mean coverage of 95 % intervals, "below" the share of
sets in which it is below {POOR:g}. Seconds are of all fits together. Failed fits count
in "fits", "failed" and "seconds" alone.

In the table of a warning, "told" are the sets and splits in which {DEFAULT},
as shipped, gives it. The fits of a row are compared with its fits to the same ones:
"ratio" is that of the RMSE, "times" that of the seconds, and "default" has its values.

In a table of sets, "rmse" is over that of the best other model, "loss" is the log loss
less that of the best other Gaussian process, each on the splits that both have, and
"chose" is what {DEFAULT} chose most often."""


def report(rows, settings):
    """Print the tables of random splits, and those of the last third.

    Parameters
    ----------
    rows : list of dict
        Of the file.
    settings : str
        Of the two models in the table of sets.
    """
    print(HEADER)
    frame = pd.DataFrame(rows)
    absent = {"failed", "rmse", "log_loss", "coverage", "chose"} - set(frame)
    frame = frame.assign(**dict.fromkeys(absent, np.nan))
    frame["over"] = frame["log_loss"] - np.log(frame["deviation"])
    last = frame["split"] == LAST
    for title, of in (("Random splits", ~last), ("The last third", last)):
        if of.any():
            sets = frame.loc[of, "set"].nunique()
            print(f"\n{title}, {sets} sets\n")
            show(by_model(frame[of]))
            told = by_word(frame[of])
            if len(told):
                print(f"\n{title}: {TOLD}, and fits of the same sets and splits\n")
                show(told)
            print(f"\n{title}: each set, {settings}\n")
            show(by_set(frame[of], settings))


def show(table):
    """Print a table."""
    print(table.to_string(index=False, na_rep="-", float_format="{:.3f}".format))


def errors_of(frame, other):
    """RMSE of each set, of two frames on the splits that both have."""
    both = [of.set_index(["set", "split"])["rmse"] for of in (frame, other)]
    both = pd.concat(both, axis=1, keys=["one", "other"]).dropna()
    return np.sqrt((both**2).groupby("set", sort=False).mean())


def by_model(frame):
    """A row for each model and its settings."""
    named = (frame["model"] == DEFAULT) & (frame["settings"] == AS_SHIPPED)
    reference, table = frame[named], []
    order = {model: k for k, model in enumerate(MODELS)}
    groups = frame.groupby(["model", "settings"], sort=False)
    for (model, settings), fits in sorted(groups, key=lambda of: order[of[0][0]]):
        errors = errors_of(fits, reference)
        ratios = errors["one"] / errors["other"]
        clipped = fits["over"].clip(upper=WORST)
        cover = fits.groupby("set")["coverage"].mean().dropna()
        row = {"model": model if settings == AS_SHIPPED else f"{model}, {settings}"}
        row |= {"fits": len(fits), "failed": fits["failed"].notna().sum()}
        row["ratio"] = np.exp(np.log(ratios).mean())
        row["better"] = (ratios < 1.0 / APART).mean()
        row["worse"] = (ratios > APART).mean()
        row |= {"log loss": clipped.mean(), "median": clipped.median()}
        row["cover"] = fits["coverage"].mean()
        row["below"] = (cover < POOR).mean() if len(cover) else np.nan
        table.append(row | {"seconds": round(fits["seconds"].sum())})
    return pd.DataFrame(table)


def by_word(frame):
    """Intervals where the default, as shipped, warns of narrow ones, and elsewhere."""
    frame = frame[frame["coverage"].notna()].set_index(["set", "split"])
    shipped = frame[(frame["model"] == DEFAULT) & (frame["settings"] == AS_SHIPPED)]
    told = np.array([TOLD in names for names in shipped["warnings"]], dtype=bool)
    table = []
    for word, of in (("told", told), ("not told", ~told)):
        fits = frame[frame.index.isin(shipped.index[of])]
        for (model, settings), same in fits.groupby(["model", "settings"], sort=False):
            if model in FITTED:
                named = {"": word, "model": model, "settings": settings}
                table.append(named | beside(same, shipped.loc[same.index]))
    return pd.DataFrame(table)


def beside(fits, shipped):
    """Fits beside those of the default, as shipped, to the same sets and splits."""
    ratios = fits["rmse"] / shipped["rmse"]
    row = {"fits": len(fits), "ratio": np.exp(np.log(ratios).mean())}
    for name, of in (("", fits), (", default", shipped)):
        row[f"cover{name}"] = of["coverage"].mean()
        row[f"log loss{name}"] = of["over"].clip(upper=WORST).mean()
    return row | {"times": fits["seconds"].sum() / shipped["seconds"].sum()}


def by_set(frame, settings):
    """A row for each set."""
    return pd.DataFrame(
        described(name, fits, settings)
        for name, fits in frame.groupby("set", sort=False)
    )


def described(name, fits, settings):
    """A set: the two models over the best of the others, by errors and log loss."""
    first = fits.iloc[0]
    row = {"set": name, "n": first["n"], "groups": first["groups"]}
    row |= {"inputs": first["inputs"], "splits": fits["split"].nunique()}
    others = {m: of for m, of in fits.groupby("model") if m not in FITTED}
    of_fitted = fits[fits["settings"] == settings]
    of_two = {model: of_fitted[of_fitted["model"] == model] for model in FITTED}
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        errors = [errors_of(of_two[model], of) for of in others.values()]
        ratios = [(of["one"] / of["other"]).max() for of in errors]
        row[f"rmse {short}"] = max(ratios, default=np.nan)
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        losses = [
            paired(of_two[model], of)
            for other, of in others.items()
            if other in GPS and other not in FITTED
        ]
        row[f"loss {short}"] = max(losses, default=np.nan)
    for short, model in (("default", DEFAULT), ("search", SEARCH)):
        row[f"cover {short}"] = of_two[model]["coverage"].mean()
    return row | {"chose": what_it_chose(of_two[DEFAULT])}


def paired(frame, other):
    """Mean log loss less the other's, on the splits that both have."""
    losses = [of.set_index("split")["log_loss"] for of in (frame, other)]
    return (losses[0] - losses[1]).mean()


def what_it_chose(fits):
    """The most frequent choice, and in how many fits if not in all."""
    counts = Counter(map(in_words, fits["chose"].dropna())).most_common()
    if not counts:
        return "-"
    what, times = counts[0]
    return what if len(counts) == 1 else f"{what} ({times} of {len(fits)})"


def in_words(chose):
    """A choice."""
    words = ["shared" if chose["shared"] == "True" else f"rank {chose['rank']}"]
    if chose["diagonal"] != "False":
        words.append(f"diagonal {chose['diagonal']}".replace(" True", ""))
    if chose["noise"] != "shared":
        words.append(f"noise {chose['noise']}")
    if chose["normalize_y"] != "shared":
        words.append(f"units {chose['normalize_y']}")
    return ", ".join(words)
