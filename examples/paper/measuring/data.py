"""Training and test sets, and the errors on them.

A draw is the `random_state` of `fetch_puma560`: it draws the loads and the subsets. Of
one draw, the subsets of different n are nested, the first rows of each load; the
paper's were selected independently.
"""

from dataclasses import dataclass
from functools import lru_cache

from skmtgp.datasets import fetch_puma560, load_puma560
from skmtgp.metrics import normalized_mean_squared_error

from .plan import ALL_LOADS, LOADS, TEST_SETS


@dataclass(frozen=True)
class Source:
    """Where the data come from.

    Attributes
    ----------
    data_home : str or None
        Folder of the stored data.
    bundled : bool
        Whether the small sets that come with the package are used, draw 0 only.
    """

    data_home: str | None = None
    bundled: bool = False

    def rows(self, draw, subset, loads, n_per_load=None):
        """X with the load in its last column, and the torques of six joints."""
        options = {"subset": subset, "loads": loads, "n_per_load": n_per_load}
        if self.bundled:
            return load_puma560(return_X_y=True, **options)
        options |= {"data_home": self.data_home, "random_state": draw}
        return fetch_puma560(return_X_y=True, **options)

    def train(self, draw, n_per_load, loads, joint):
        """The first rows of each load, and the torque of a joint."""
        X, torque = self.rows(draw, "train", loads, n_per_load)
        return X, torque[:, joint - 1]

    def prepare(self, draws):
        """Make the data of these draws, if they are not there."""
        for draw in draws:
            print(f"data: draw {draw}", flush=True)
            self.rows(draw, "train", [1], 1)


def per_load(n):
    """Samples of each of the 14 loads, of n in all."""
    each, rest = divmod(n, len(LOADS))
    if rest:
        raise ValueError(f"n={n} is not a multiple of {len(LOADS)} loads.")
    return each


def errors(model, source, draw, joint, loads):
    """Error on each test set, averaged over loads; load by load to save memory."""
    scores = {}
    for subset in TEST_SETS:
        X, torque = _test_set(source, draw, subset)
        per_load = []
        for load in loads:
            rows = X[:, -1] == load
            mean = model.predict(X[rows])
            truth = torque[rows, joint - 1]
            per_load.append(normalized_mean_squared_error(truth, mean))
        scores[f"nmse_{subset}"] = sum(per_load) / len(per_load)
    return scores


@lru_cache(maxsize=len(TEST_SETS))  # those of one draw
def _test_set(source, draw, subset):
    return source.rows(draw, subset, ALL_LOADS)
