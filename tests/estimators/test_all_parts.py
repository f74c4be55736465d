"""Terms, trends, known noise, levels, units and noises of the tasks, all together.

Each part has tests of its own; here every two of them meet, and are compared with the
book and with finite differences.
"""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
import textbook
from fuzz_book import Book, by_the_book, read_book
from hypothesis import given
from hypothesis import strategies as st
from pairs import in_pairs
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF, Matern
from strategies import examples

from skmtgp import MultiTaskGPRegressor, WideRegressor

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.usefixtures("certain_theta"),  # variances are those of the definition
]

RNG = np.random.default_rng(0)
N, M = 42, 3
TASK = np.arange(N) % M
X = np.column_stack([RNG.uniform(0, 6, (N, 2)), TASK])
Y = (1 + TASK) * np.sin(X[:, 0]) + 3 * TASK + 0.5 * X[:, 1]
Y = Y + 0.3 * RNG.standard_normal(N)
COUNTS = RNG.integers(1, 4, N)
ALPHA = RNG.uniform(0.01, 0.3, N)
SPREAD = np.where(COUNTS > 1, RNG.uniform(0.01, 0.2, N), 0.0)
NEW = np.column_stack([RNG.uniform(-1, 7, (9, 2)), np.arange(9) % M])
FEW = np.column_stack([RNG.uniform(0, 6, (4, 2)), [0, 1, 1, 2]])

SLOW, FAST = RBF([2.0, 3.0]), Matern(0.5, nu=1.5)
PRIORS = {
    "one": {"kernel": SLOW, "rank": 2},
    "shared": {"kernel": FAST, "rank": 1, "shared": True},
    "two": {"kernel": [SLOW, FAST], "rank": 1},
    "three": {
        "kernel": [None, SLOW, "matern52"],
        "rank": [2, 0, 1],
        "shared": [False, True, False],
        "diagonal": [False, False, "equal"],
    },
}
TRENDS = {
    "no trend": {},
    "columns": {"trend": [1]},
    "linear": {"trend": "linear"},
    "of each": {"trend": [1], "trend_per_task": True},
    "linear of each": {"trend": "linear", "trend_per_task": True},
}
COLUMNS = {
    "linear": lambda F: np.column_stack([np.ones(len(F)), F]),
    "[1]": lambda F: F[:, [1]],
}
KNOWN = {
    "nothing": {},
    "alpha": {"alpha": ALPHA},
    "repeats": {"sample_weight": COUNTS, "repeat_variance": SPREAD},
    "all": {"alpha": ALPHA, "sample_weight": COUNTS, "repeat_variance": SPREAD},
}
LEVELS = {"levels": True, "no levels": False}
NOISES = {"one noise": "shared", "noise of each": "per_task"}
UNITS = {"shared": "shared", "per task": "per_task", "no units": False}
ASKED = {"mode": "mode", "map": "map"}


@pytest.fixture(scope="module")
def fitted():
    """Makes models that are fitted once."""
    found = {}

    def fit(prior, trend, known, **options):
        key = repr((prior, trend, sorted(known), options))
        if trend.get("trend") == "linear" and not trend.get("trend_per_task"):
            options["normalize_y"] = options["normalize_y"] and "shared"
        if key not in found:
            if not isinstance(prior["kernel"], list):
                options["learning"] = "staged"
            model = MultiTaskGPRegressor(**prior, **trend, **options, max_iter=1)
            found[key] = model.fit(X, Y, **known)
        return found[key]

    return fit


def part_of(model):
    """What the book needs to know of a model."""
    return SimpleNamespace(trend=COLUMNS.get(str(model.trend)))


def assert_by_the_book(model, new=NEW):
    expected = by_the_book(model, part_of(model), 0, new)
    mean, std = model.predict(new, return_std=True)
    np.testing.assert_allclose(mean, expected.mean, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(std**2, expected.variance, rtol=1e-6, atol=1e-8)


def log_density(book: Book, counts, spread):
    """Of all measurements."""
    H = book.columns(book.X, book.tasks)
    K = book.of_f(book.X, book.tasks) + np.diag(book.noise)
    rest = book.y - textbook.of_rows(book.centre, book.tasks)
    value = (
        textbook.restricted_likelihood(K, H, rest)
        if H.size
        else textbook.log_marginal_likelihood(K, rest)
    )
    v = book.noise * counts
    more = (counts - 1) * np.log(2 * np.pi * v) + np.log(counts) + counts * spread / v
    return value - 0.5 * more.sum()


@in_pairs(
    prior=PRIORS,
    trend=TRENDS,
    known=KNOWN,
    levels=LEVELS,
    noise=NOISES,
    units=UNITS,
    asked=ASKED,
)
class TestAllParts:
    @pytest.fixture
    def model(self, fitted, prior, trend, known, levels, noise, units, asked):
        options = {"task_levels": levels, "noise": noise, "normalize_y": units}
        return fitted(prior, trend, known, **options, hyperparameters=asked)

    def test_predictions(self, model, known):
        assert_by_the_book(model)
        terms = model.predict_terms(NEW)
        np.testing.assert_allclose(terms.sum(axis=1), model.predict(NEW), rtol=1e-9)
        again = pickle.loads(pickle.dumps(model))
        np.testing.assert_array_equal(again.predict(NEW), model.predict(NEW))

    def test_value(self, model, known):
        counts = known.get("sample_weight", np.ones(N))
        spread = known.get("repeat_variance", np.zeros(N))
        expected = log_density(read_book(model, part_of(model), 0), counts, spread)
        value = model.log_marginal_likelihood_value_
        assert value == pytest.approx(expected, rel=1e-8, abs=1e-7)

    def test_gradient(self, model, known):
        """Of all parameters, away from where learning ended."""
        theta = model.theta_ + 0.2 * np.random.default_rng(0).standard_normal(
            len(model.theta_)
        )
        gradient = model.log_marginal_likelihood(theta, eval_gradient=True)[1]
        expected = textbook.derivative(model.log_marginal_likelihood, theta, 3e-3)
        size = np.abs(expected).max()
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6 * size)

    def test_left_out(self, model, known):
        """K^-1 of the book, whose rows are each predicted from the others."""
        book = read_book(model, part_of(model), 0)
        H = book.columns(book.X, book.tasks)
        K = book.of_f(book.X, book.tasks) + np.diag(book.noise)
        P = np.linalg.inv(K)
        P = P - P @ H @ np.linalg.pinv(H.T @ P @ H) @ H.T @ P
        rest = book.y - textbook.of_rows(book.centre, book.tasks)
        mean, std = model.loo_predict(include_noise=True)
        expected = Y - P @ rest / np.diag(P)
        np.testing.assert_allclose(mean, expected, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(std, np.diag(P) ** -0.5, rtol=1e-6)

    def test_rows_that_join(self, model, known):
        joined = pickle.loads(pickle.dumps(model)).partial_fit(FEW, np.arange(4.0))
        assert_by_the_book(joined)


@examples(15)
@given(
    seed=st.integers(0, 10**6),
    unit=st.floats(-6, 6),
    names=st.permutations(range(M)),
    prior=st.sampled_from([*PRIORS]),
    trend=st.sampled_from([*TRENDS]),
)
def test_units_orders_and_names_do_not_matter(seed, unit, names, prior, trend):
    """With all that is known of the noise, in squared units of y."""
    rng, scale = np.random.default_rng(seed), 10.0**unit
    model = MultiTaskGPRegressor(
        **PRIORS[prior], **TRENDS[trend], normalize_y="shared", max_iter=0
    )
    order, names = rng.permutation(N), np.array(names)
    expected = clone(model).fit(X, Y, **KNOWN["all"]).predict(NEW, return_std=True)
    known = {name: values[order] for name, values in KNOWN["all"].items()}
    known |= {name: scale**2 * known[name] for name in ("alpha", "repeat_variance")}
    renamed, new = X[order].copy(), NEW.copy()
    for rows in (renamed, new):
        rows[:, 2] = names[rows[:, 2].astype(int)]
    model.fit(renamed, scale * Y[order], **known)
    found = np.array(model.predict(new, return_std=True)) / scale
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * size)


def test_skops():
    """What docs/guide/persistence.md says is all that must be trusted."""
    io = pytest.importorskip("skops.io")
    complete = np.column_stack([np.repeat(np.arange(14.0), M), TASK])
    there = np.arange(N) != 4
    wide = Y.reshape(-1, M)
    quick = {"rank": 1, "normalize_y": "shared", "noise": "shared", "max_iter": 2}
    one = MultiTaskGPRegressor(**quick)
    models = {
        "all": clone(one).set_params(**PRIORS["two"], **TRENDS["of each"]),
        "gaps": clone(one).fit(complete[there], Y[there]),
        "wide": WideRegressor(one).fit(complete[::M, :1], wide),
    }
    models["all"].fit(X, Y, **KNOWN["all"])
    named = {
        "all": {
            "skmtgp._data.known.Known",
            "skmtgp._data.trend.TrendColumns",
            "skmtgp.inference.flat.Coefficients",
            "skmtgp.inference.flat.Flat",
            "skmtgp.model.several.Forms",
            "skmtgp.model.several.Kernels",
            "skmtgp.model.trend.Basis",
            "skmtgp.model.trend.TaskBases",
            "skmtgp.model.trend.Trend",
        },
        "gaps": {"skmtgp.inference.gaps.GappyEigen"},
        "wide": {"skmtgp.wide.WideRegressor"},
    }
    usual = ("sklearn.", "skmtgp.inference.eigen.")
    plain = clone(one).fit(X, Y), clone(one).fit(complete, Y)
    known = {t for of in plain for t in io.get_untrusted_types(data=io.dumps(of))}
    for name, model in models.items():
        data = io.dumps(model)
        types = io.get_untrusted_types(data=data)
        more = {t for t in types if t not in known and not t.startswith(usual)}
        assert more == named[name]
        again = io.loads(data, trusted=types)
        new = {"all": NEW, "gaps": complete[:5], "wide": complete[:5, :1]}[name]
        np.testing.assert_array_equal(again.predict(new), model.predict(new))
