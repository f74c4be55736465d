import pandas as pd
import pytest
from numpy.testing import assert_array_equal
from pictured import MODELS, X, texts, y
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from skmtgp.inspection import RankSelectionDisplay

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")


class TestRankSelection:
    def test_one_criterion(self, fitted):
        search = fitted["RankSearchIC"]
        display = RankSelectionDisplay.from_estimator(make_pipeline(search))
        (line,) = display.lines_
        assert_array_equal(line.get_xdata(), search.results_["rank"])
        assert_array_equal(line.get_ydata(), search.results_[search.criterion_])
        assert set(display.chosen_.get_xdata()) == {search.best_rank_}
        assert display.ax_.get_ylabel() == search.criterion_.upper()
        assert texts(display.ax_.get_xticklabels()) == ["1", "2"]

    def test_the_criterion_of_the_search(self):
        search = clone(MODELS["RankSearchIC"]).set_params(criterion="aic").fit(X, y)
        display = RankSelectionDisplay.from_estimator(search)
        assert display.ax_.get_ylabel() == "AIC"

    @pytest.mark.parametrize("container", [dict, pd.DataFrame])
    def test_several_less_their_minimum(self, container):
        results = {"rank": [2, 4], "bic": [30.0, 10.0], "aic": [5.0, 7.0]}
        display = RankSelectionDisplay(results=container(results), best_rank=4)
        display.plot(criteria=["bic", "aic"])
        found = [line.get_ydata().tolist() for line in display.lines_]
        assert found == [[20.0, 0.0], [0.0, 2.0]]
        labels = texts(display.ax_.get_legend().get_texts())
        assert labels == ["rank 4, chosen", "BIC", "AIC"]

    @pytest.mark.parametrize(("worst", "scale"), [(9.0, "linear"), (90.0, "symlog")])
    def test_several_near_and_far(self, worst, scale):
        results = {"rank": [2, 4], "bic": [worst, 0.0], "aic": [5.0, 7.0]}
        display = RankSelectionDisplay(results=results, best_rank=4)
        display.plot(criteria=["bic", "aic"])
        assert display.ax_.get_yscale() == scale

    def test_leave_one_out(self):
        search = clone(MODELS["RankSearchIC"]).set_params(criterion="loo").fit(X, y)
        display = RankSelectionDisplay.from_estimator(search)
        assert display.ax_.get_ylabel() == "LOO"
        assert_array_equal(display.lines_[0].get_ydata(), search.results_["loo"])

    def test_a_criterion_that_was_not_computed(self, fitted):
        search = fitted["RankSearchIC"]
        with pytest.raises(ValueError, match=r"computed no 'loo': fit .*='loo'"):
            RankSelectionDisplay.from_estimator(search, criteria=["bic", "loo"])

    @pytest.mark.parametrize("criteria", ["cv", ["bic", "cv"], []])
    def test_unknown_criteria(self, criteria):
        display = RankSelectionDisplay(results={}, best_rank=1)
        with pytest.raises(ValueError, match="must be one of 'bic', 'aic', 'hqc'"):
            display.plot(criteria=criteria)

    def test_a_model_without_search(self, fitted):
        with pytest.raises(TypeError, match="PooledGP has compared no ranks"):
            RankSelectionDisplay.from_estimator(fitted["PooledGP"])
