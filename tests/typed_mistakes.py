"""Mistakes of users: mypy finds every line that is marked as wrong.

test_typed_programs.py checks it. Nothing here is run.
"""

from skmtgp import MultiTaskGPRegressor, RankSearchIC, WideRegressor
from skmtgp.datasets import load_puma560, make_puma560, make_sites, make_soil
from skmtgp.kernels import Spherical
from skmtgp.metrics import coverage


def misspelt_arguments() -> None:
    X, y = make_sites()
    MultiTaskGPRegressor(task_column="site")  # wrong
    model = MultiTaskGPRegressor(task_feature="site")
    model.fit(X, y, weights=y)  # wrong
    model.predict(X, return_sdt=True)  # wrong
    model.predict_interval(X, levels=0.9)  # wrong
    model.log_marginal_likelihood(gradient=True)  # wrong
    WideRegressor().predict(X, return_cov=True)  # wrong
    load_puma560(n_rows=20)  # wrong
    make_puma560(n_tasks=3)  # wrong
    coverage(y, y, y, multioutput="none")  # wrong


def missing_arguments() -> None:
    X, _ = make_sites()
    MultiTaskGPRegressor().fit(X)  # wrong
    RankSearchIC().predict()  # wrong


def values_of_other_types() -> None:
    X, y = make_sites()
    MultiTaskGPRegressor(normalize_y="each")  # wrong
    load_puma560(subset="test")  # wrong
    make_puma560(tool=3)  # wrong
    model = MultiTaskGPRegressor().fit(X, y)
    model.predict(X, return_std="yes")  # wrong


def mistaken_results(with_truth: bool) -> None:
    X, y = make_sites(return_truth=True)  # wrong
    make_soil(return_truth=True).plot()  # wrong
    X, y = make_sites()
    model = MultiTaskGPRegressor().fit(X, y)
    model.predict(X, return_std=True).max()  # wrong
    mean, std, covariance = model.predict(X, return_std=True)  # wrong
    words: str = model.predict(X)  # wrong
    value, gradient = model.log_marginal_likelihood()  # wrong
    model.log_marginal_likelihood(eval_gradient=True) + 1.0  # wrong
    Spherical()(X, eval_gradient=True).shape  # wrong
    coverage(y, y, y).mean()  # wrong
