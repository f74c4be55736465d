import numpy as np
import pytest

from skmtgp._data import complete as _complete
from skmtgp._data.complete import (
    complete_design,
    count_missing,
    design_of,
    few_missing,
    nearly_complete,
    row_keys,
)


class TestCompleteDesign:
    @pytest.fixture(params=[1, 2, 4])
    def design(self, request):
        """Every task at each of five inputs, in any order; inputs in their order."""
        rng, M = np.random.default_rng(0), request.param
        inputs = np.unique(rng.integers(0, 3, (40, 2)), axis=0)[:5].astype(float)
        which, codes = np.divmod(rng.permutation(5 * M), M)
        return inputs, inputs[which], codes

    def test_rows(self, design):
        inputs, features, codes = design
        rows = complete_design(features, codes)
        assert rows.shape == (5, codes.max() + 1)
        assert sorted(rows.ravel()) == list(range(len(codes)))
        for m, of_task in enumerate(rows.T):
            assert (codes[of_task] == m).all()
            np.testing.assert_array_equal(features[of_task], inputs)

    def test_a_cell_is_missing(self, design):
        _, features, codes = design
        for k in range(len(codes)):
            rows = complete_design(np.delete(features, k, axis=0), np.delete(codes, k))
            assert (rows is None) == (codes.max() > 0)  # one task is always complete

    def test_an_input_that_differs(self, design):
        _, features, codes = design
        features[3, 1] += 1e-12
        assert (complete_design(features, codes) is None) == (codes.max() > 0)

    def test_a_cell_is_observed_twice(self, design):
        """Also instead of another one, so that all counts are right."""
        _, features, codes = design
        more = np.vstack([features, features[:1]]), np.append(codes, codes[0])
        assert complete_design(*more) is None
        twice = features.copy()
        own = np.flatnonzero(codes == codes[0])
        twice[own[1]] = twice[own[0]]
        assert complete_design(twice, codes) is None

    def test_all_is_observed_twice(self, design):
        _, features, codes = design
        assert complete_design(np.tile(features, (2, 1)), np.tile(codes, 2)) is None

    def test_counts_that_differ(self):
        features = np.array([[0.0], [1.0], [2.0], [0.0]])
        assert complete_design(features, np.array([0, 0, 0, 1])) is None

    def test_zero_has_no_sign(self):
        features = np.array([[0.0, 1.0], [-0.0, 1.0]])
        np.testing.assert_array_equal(
            complete_design(features, np.array([1, 0])), [[1, 0]]
        )

    def test_by_blocks(self, design, monkeypatch):
        monkeypatch.setattr(_complete, "BLOCK", 2)
        self.test_rows(design)
        self.test_an_input_that_differs(design)

    def test_as_numpy_finds_it(self):
        """Of a few inputs, drawn so that about half of the data are complete."""
        rng, found = np.random.default_rng(0), []
        for _ in range(100):
            inputs = np.unique(rng.integers(0, 2, (4, 3)), axis=0).astype(float)
            which, codes = np.indices((len(inputs), 2)).reshape(2, -1)
            which[0] = rng.integers(0, len(inputs))
            count = np.zeros((len(inputs), 2))
            np.add.at(count, (which, codes), 1)
            expected = (count == 1).all()
            rows = complete_design(inputs[which], codes)
            assert (rows is not None) == expected
            found.append(expected)
        assert 10 < sum(found) < 90


def test_keys_are_those_of_the_rows():
    rng = np.random.default_rng(0)
    features = rng.choice([0.0, -0.0, 1.0, -1.0, 1e300, 5e-324], (3000, 4))
    keys = row_keys(features)
    assert len(np.unique(keys)) == len(np.unique(features, axis=0))
    np.testing.assert_array_equal(row_keys(-0.0 * features), row_keys(0.0 * features))


class TestDesignOf:
    @pytest.fixture
    def data(self):
        """Six inputs of three tasks in any order, and the cell of each row."""
        rng = np.random.default_rng(0)
        inputs = np.unique(rng.integers(0, 3, (40, 2)), axis=0)[:6].astype(float)
        which, codes = np.divmod(rng.permutation(18), 3)
        return inputs[which], codes, (which, codes)

    @pytest.mark.parametrize("n_missing", [0, 1, 2, 4])
    def test_rows(self, data, n_missing):
        features, codes, cells = data
        expected = np.full((6, 3), -1)
        expected[cells] = np.arange(18) - n_missing
        found = design_of(features[n_missing:], codes[n_missing:])
        np.testing.assert_array_equal(found, np.maximum(expected, -1))
        assert count_missing(found) == n_missing
        assert few_missing(found) == (n_missing < 2)

    def test_half_are_missing(self, data):
        features, codes, (inputs, tasks) = data
        some = (tasks == 0) | ((tasks == 1) & (inputs < 3))
        assert design_of(features[some], codes[some]) is not None  # of two tasks
        rest = (tasks == 2) & (inputs == 5)
        assert design_of(features[some | rest], codes[some | rest]) is not None
        some &= inputs != 2
        some |= (tasks == 0) | rest
        assert design_of(features[some], codes[some]) is None

    def test_a_cell_is_observed_twice(self, data):
        features, codes, _ = data
        rows = np.r_[1:18, 5]
        assert design_of(features[rows], codes[rows]) is None
        assert not few_missing(None)
        assert count_missing(None) == 0

    def test_other_inputs_of_the_same_key(self, data, monkeypatch):
        """Which a hash may give them, if hardly ever."""
        features, codes, (inputs, _) = data
        monkeypatch.setattr(_complete, "row_keys", lambda of: inputs[: len(of)])
        assert design_of(features[:-1], codes[:-1]) is not None
        features[3, 0] = features[inputs != inputs[3]][0, 0]
        features[3, 1] += 100.0
        assert design_of(features[:-1], codes[:-1]) is None


class TestNearlyComplete:
    @pytest.fixture
    def data(self):
        """20 inputs, 3 tasks."""
        x = np.random.default_rng(0).standard_normal((20, 2))
        return np.tile(x, (3, 1)), np.repeat([0, 1, 2], 20)

    def test_what_is_missing_and_repeated(self, data):
        features, codes = (of[3:] for of in data)
        found = nearly_complete(features, codes)
        assert found.startswith("3 cells are missing of 20 inputs of 3 tasks, 0 observ")
        rows = [*range(len(codes)), 5, 5]
        found = nearly_complete(features[rows], codes[rows])
        assert "3 cells are missing" in found
        assert "1 observed repeatedly. With none repeated and at most 10% mi" in found

    def test_one_cell(self, data):
        features, codes = (of[1:] for of in data)
        assert nearly_complete(features, codes).startswith("1 cell is missing of 20")

    def test_other_data(self, data):
        """Complete, of one task, with too many faults, or with nothing in common."""
        features, codes = data
        assert not nearly_complete(features, codes)
        assert not nearly_complete(features[:19], codes[:19])
        assert not nearly_complete(features[:-16], codes[:-16])
        assert nearly_complete(features[:-15], codes[:-15])
        features = np.random.default_rng(1).standard_normal(features.shape)
        assert not nearly_complete(features, codes)
        features[:, 0] = codes
        assert not nearly_complete(features, codes)
