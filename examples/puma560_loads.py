"""
Learn the inverse dynamics of a robot arm under many loads
==========================================================

A Puma 560 carries 14 loads, one after another. For each load there are 20 samples of
joint positions, velocities, accelerations and torques, from a trajectory common to all
loads and from the load's own trajectory. Four models learn the torques from these 280
samples:

- sGP, each load alone;
- iGP, loads that share the kernel only;
- pGP, loads taken to be one and the same;
- mGP, the multi-task model, with its rank chosen by BIC,

The models predict the torques on the trajectories that they saw (interpolation) and on
all 16 (extrapolation). This is section 6 of Chai, Williams, Klanke and Vijayakumar
(2008) at n = 280, with its settings: one mean, one unit and one noise variance for all
loads.

Run ``python examples/puma560_loads.py``; ``--short`` takes two joints and two ranks.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    SingleTaskGP,
    make_inverse_dynamics_regressor,
)
from skmtgp.datasets import load_puma560
from skmtgp.inspection import color_of
from skmtgp.metrics import normalized_mean_squared_error

LOADS = range(1, 15)
N_PER_LOAD = 20
PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}


def load(subset, joints, n_per_load=None):
    """Joint states with the load in the last column, and torques of the joints."""
    X, tau = load_puma560(
        subset=subset, loads=LOADS, n_per_load=n_per_load, return_X_y=True
    )
    return X, tau[:, joints]


def make_models(ranks, n_jobs):
    """The four models of the paper, by name."""
    options = {"n_jobs": n_jobs, "verbose": 1}
    models = {
        "sGP": SingleTaskGP(**options),
        "iGP": IndependentGP(**PAPER, **options),
        "pGP": PooledGP(noise="shared", **options),
        "mGP-BIC": RankSearchIC(
            MultiTaskGPRegressor(**PAPER), ranks=ranks, criterion="bic", **options
        ),
    }
    return {name: make_inverse_dynamics_regressor(m) for name, m in models.items()}


def fit_all(models, X, y):
    """Fit each model and say how long it took."""
    for name, model in models.items():
        print(f"\n{name}: learning from {len(X)} samples of {y.shape[1]} joints")
        begin = time.perf_counter()
        model.fit(X, y)
        print(f"{name}: {time.perf_counter() - begin:.0f} s")


def errors(models, joints):
    """nMSE, averaged over loads, of each model, joint and test set."""
    rows = []
    for subset in ("interpolation", "extrapolation"):
        X, y = load(subset, joints)
        for name, model in models.items():
            nmse = normalized_mean_squared_error(
                y, model.predict(X), tasks=X[:, -1], multioutput="raw_values"
            )
            rows += [
                {"test": subset, "joint": j + 1, "model": name, "nMSE": e}
                for j, e in zip(joints, nmse, strict=True)
            ]
    return pd.DataFrame(rows)


def likelihoods(models, joints):
    """Log marginal likelihood (of torques in N m) of each joint and model, in nats."""
    table = {name: _fitted(m).log_marginal_likelihoods_ for name, m in models.items()}
    return pd.DataFrame(table, index=_joint_names(joints))


def report(models, table, joints):
    """Print everything that was learned."""
    for subset in ("interpolation", "extrapolation"):
        of_subset = table[table["test"] == subset]
        print(f"\nnMSE, {subset}")
        wide = of_subset.pivot(index="joint", columns="model", values="nMSE")
        print(wide[list(models)].to_string(float_format="{:.1e}".format))
    print("\nLog marginal likelihood, nats")
    print(likelihoods(models, joints).to_string(float_format="{:.1f}".format))
    search = models["mGP-BIC"][-1]
    print("\nRank of the task covariance")
    ranks = search.results_.filter(regex="^(?!output)")
    print(ranks.to_string(index=False, float_format="%.1f"))
    print(f"BIC chooses rank {search.best_rank_}.")


def compare(table):
    """Extrapolation error of the best other model over that of mGP-BIC, by joint."""
    wide = table[table["test"] == "extrapolation"].pivot(
        index="joint", columns="model", values="nMSE"
    )
    others = wide.drop(columns="mGP-BIC")
    print("\nExtrapolation: the best other model's nMSE over mGP-BIC's")
    for joint, row in others.iterrows():
        factor = row.min() / wide.loc[joint, "mGP-BIC"]
        print(f"  joint {joint}: {factor:.1f} ({row.idxmin()})")


def plot(models, table, joints, path):
    """Draw the errors and the task covariances."""
    import matplotlib.pyplot as plt

    n = len(joints)
    figure = plt.figure(figsize=(max(9.0, 2.1 * n), 7.2), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.7, 1.0])
    _plot_errors(above, models, table, joints)
    _plot_task_covariances(below, _fitted(models["mGP-BIC"]), joints)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    plt.close(figure)
    print(f"\nFigure: {path}")


def _plot_errors(figure, models, table, joints):
    axes = figure.subplots(1, 2, sharey=True)
    figure.suptitle(f"Error of the torques after {N_PER_LOAD} samples of each load")
    for ax, subset in zip(axes, ("interpolation", "extrapolation"), strict=True):
        wide = table[table["test"] == subset].pivot(
            index="joint", columns="model", values="nMSE"
        )
        for k, (name, model) in enumerate(models.items()):
            x = np.arange(len(joints)) + 0.17 * (k - 1.5)
            ax.plot(x, wide[name], "o", ms=8, color=color_of(model), label=name)
        ax.set_yscale("log")
        ax.set_xticks(range(len(joints)), [f"joint {j + 1}" for j in joints])
        ax.set_title(subset.capitalize())
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("nMSE, averaged over 14 loads")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(models))


def _plot_task_covariances(figure, regressor, joints):
    """K^rho of each joint, of the loads' deviations from their average."""
    axes = figure.subplots(1, len(joints), squeeze=False)[0]
    figure.suptitle(
        f"Learned task covariance, rank {regressor.rank_}: how the loads, from 0.2 to "
        "2.8 kg, deviate from their average"
    )
    ticks = [0, len(regressor.tasks_) - 1]
    labels = [f"c{regressor.tasks_[t]}" for t in ticks]
    for ax, joint, K in zip(axes, joints, regressor.task_covariance_, strict=True):
        K = K - K.mean(axis=0) - K.mean(axis=1)[:, None] + K.mean()
        image = ax.imshow(K / np.abs(K).max(), vmin=-1, vmax=1, cmap="RdBu_r")
        ax.set_title(f"joint {joint + 1}")
        ax.set_xticks(ticks, labels)
        ax.set_yticks(ticks, labels)
    figure.colorbar(image, ax=axes, shrink=0.8, label="relative to the largest")


def _fitted(pipeline):
    return getattr(pipeline[-1], "best_estimator_", pipeline[-1])


def _joint_names(joints):
    return pd.Index([j + 1 for j in joints], name="joint")


def main():
    """Learn, compare, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--short", action="store_true", help="two joints, two ranks")
    parser.add_argument("--n-jobs", type=int, default=-1, help="processes; -1 is all")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    arguments = parser.parse_args()
    joints = [1, 3] if arguments.short else list(range(6))
    ranks = (4, 5) if arguments.short else (2, 4, 5, 6, 8, 10)

    begin = time.perf_counter()
    models = make_models(ranks, arguments.n_jobs)
    fit_all(models, *load("train", joints, N_PER_LOAD))
    table = errors(models, joints)
    report(models, table, joints)
    compare(table)
    plot(models, table, joints, arguments.output / "puma560_loads.png")
    print(f"All in {time.perf_counter() - begin:.0f} s.")


if __name__ == "__main__":
    main()
