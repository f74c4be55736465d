"""Compiled predictors that follow partial_fit of their models."""

import gc
import pickle
import threading
import time
from copy import copy, deepcopy
from weakref import ref

import numpy as np
import pytest
from multitask_models import PAPER
from samples import draw
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from skmtgp import (
    IndependentGP,
    MultiTaskGPRegressor,
    PooledGP,
    RankSearchIC,
    add_task,
    compile_predictor,
    partial_fit,
)
from skmtgp._support import followers

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
START = {"max_iter": 0}
MODELS = {
    "mGP": MultiTaskGPRegressor(rank=2, **PAPER, **START),
    "iGP": IndependentGP(**START),
    "pGP": PooledGP(**START),
    "sparse": MultiTaskGPRegressor(
        rank=2, inference="sparse", n_inducing=12, n_exact=20, **PAPER, **START
    ),
    "search": RankSearchIC(MultiTaskGPRegressor(**START), ranks=(1,), simpler=False),
}
X_STATE, TASK = np.array([0.1, 0.2]), 1
ROW = np.array([[0.1, 0.2, TASK]])
every_model = pytest.mark.parametrize("name", MODELS)


def fitted(name="mGP"):
    return clone(MODELS[name]).fit(*draw())


def as_it_predicts(predictor, model):
    np.testing.assert_allclose(predictor(X_STATE, TASK), model.predict(ROW), rtol=1e-9)


@every_model
def test_it_predicts_what_the_model_does(name):
    model = fitted(name)
    predictor = compile_predictor(model)
    for target in (9.0, -9.0):
        before = predictor(X_STATE, TASK)
        assert model.partial_fit(ROW, [target]) is model
        assert abs(predictor(X_STATE, TASK) - before) > 0.01
        as_it_predicts(predictor, model)


def test_deviations_and_all_that_is_dropped():
    model = fitted()
    predictor = compile_predictor(model, task=TASK, std=True)
    before = predictor.std(X_STATE)
    model.partial_fit(ROW, [9.0], max_rows=len(model.y_train_) - 5)
    as_it_predicts(predictor, model)
    std = model.predict(ROW, return_std=True)[1]
    np.testing.assert_allclose(predictor.std(X_STATE), std, rtol=1e-9)
    assert predictor.std(X_STATE) < before


def test_a_new_task_can_be_predicted():
    model = fitted()
    one, all_of_them = compile_predictor(model, task=TASK), compile_predictor(model)
    model.partial_fit([[0.1, 0.2, 7]], [3.0])
    assert all_of_them.tasks == model.tasks_.tolist()
    assert one.tasks == [TASK]
    found = all_of_them(X_STATE, 7)
    np.testing.assert_allclose(found, model.predict([[0.1, 0.2, 7]]), rtol=1e-9)


def test_through_a_pipeline():
    model = make_pipeline(FunctionTransformer().fit(draw()[0]), fitted())
    predictor = compile_predictor(model)
    partial_fit(model, ROW, [9.0])
    as_it_predicts(predictor, model)


def test_of_several_models_each_counts():
    models = {"a": fitted(), "b": make_pipeline(fitted("iGP")), "c": fitted("search")}
    predictor = compile_predictor(models, TASK)
    for name in ("b", "a", "c"):
        partial_fit(models[name], ROW, [9.0])
        expected = [model.predict(ROW)[0] for model in models.values()]
        np.testing.assert_allclose(predictor(X_STATE), expected, rtol=1e-9)


def test_the_best_model_of_a_search():
    search = fitted("search")
    predictor = compile_predictor(search)
    search.best_estimator_.partial_fit(ROW, [9.0])
    as_it_predicts(predictor, search)
    search.partial_fit(ROW, [-9.0])  # it has another best model from here on
    search.best_estimator_.partial_fit(ROW, [9.0])
    as_it_predicts(predictor, search)


class TestNotFollowed:
    def stays(self, change, **options):
        model = fitted()
        predictor = compile_predictor(model, TASK, **options)
        before = predictor(X_STATE)
        change(model)
        np.testing.assert_array_equal(predictor(X_STATE), before)
        return predictor, model

    def test_if_asked(self):
        predictor, model = self.stays(
            lambda model: model.partial_fit(ROW, [9.0]), follow=False
        )
        as_it_predicts(predictor.refresh(model), model)
        before = predictor(X_STATE)
        model.partial_fit(ROW, [-9.0])
        np.testing.assert_array_equal(predictor(X_STATE), before)

    def test_copies_of_the_model(self):
        def change(model):
            for copied in (copy(model), deepcopy(model), clone(model)):
                copied.partial_fit(
                    *(draw() if not hasattr(copied, "tasks_") else (ROW, [9.0]))
                )
            pickle.loads(pickle.dumps(model)).partial_fit(ROW, [9.0])

        self.stays(change)

    def test_models_with_another_task(self):
        self.stays(lambda model: add_task(model, [[0.1, 0.2, 7]], [3.0]))

    def test_a_failure(self):
        def change(model):
            with pytest.raises(ValueError, match="max_rows=1 is below"):
                model.partial_fit(ROW, [9.0], max_rows=1)
            with pytest.raises(ValueError, match="NaN"):
                model.partial_fit(ROW, [np.nan])

        predictor, model = self.stays(change)
        as_it_predicts(predictor, model)

    @pytest.mark.parametrize("duplicate", [copy, deepcopy, "pickled"])
    def test_copies_of_the_predictor(self, duplicate):
        model = fitted()
        predictor = compile_predictor(model)
        if duplicate == "pickled":
            other = pickle.loads(pickle.dumps(predictor))
        else:
            other = duplicate(predictor)
        before = other(X_STATE, TASK)
        model.partial_fit(ROW, [9.0])
        as_it_predicts(predictor, model)
        np.testing.assert_array_equal(other(X_STATE, TASK), before)
        as_it_predicts(other.refresh(model), model)

    def test_a_model_that_was_replaced(self):
        old, new = fitted(), fitted("iGP")
        predictor = compile_predictor(old)
        predictor.refresh(new)
        old.partial_fit(ROW, [9.0])
        as_it_predicts(predictor, new)
        new.partial_fit(ROW, [9.0])
        as_it_predicts(predictor, new)

    def test_models_it_does_not_fit_any_more(self):
        models = [fitted(), fitted()]
        predictor = compile_predictor(models, TASK)
        before = predictor(X_STATE)
        X, y = draw()
        models[0].fit(np.column_stack([X[:, 0], X]), y)
        with pytest.warns(RuntimeWarning, match="follows its models no more"):
            models[1].partial_fit(ROW, [9.0])
        np.testing.assert_array_equal(predictor(X_STATE), before)
        models[1].partial_fit(ROW, [9.0])  # of which it hears no more


class TestLives:
    """Neither keeps the other."""

    def test_of_the_model(self):
        model = fitted()
        predictor, gone = compile_predictor(model), ref(model)
        expected = model.predict(ROW)
        del model
        gc.collect()
        assert gone() is None
        np.testing.assert_allclose(predictor(X_STATE, TASK), expected, rtol=1e-9)

    def test_of_one_of_several_models(self):
        models = [fitted(), fitted()]
        predictor = compile_predictor(models, TASK)
        before = predictor(X_STATE)
        del models[0]
        gc.collect()
        models[0].partial_fit(ROW, [9.0])
        np.testing.assert_array_equal(predictor(X_STATE), before)

    def test_of_a_pipeline(self):
        model = fitted()
        predictor = compile_predictor(
            make_pipeline(FunctionTransformer().fit(ROW), model)
        )
        gc.collect()
        model.partial_fit(ROW, [9.0])
        as_it_predicts(predictor, model)

    def test_of_the_predictor(self):
        model = fitted()
        gone = ref(compile_predictor(model))
        gc.collect()
        assert gone() is None
        model.partial_fit(ROW, [9.0])
        assert not list(followers._FOLLOWERS[model])
        size = len(pickle.dumps(model))
        predictor = compile_predictor(model)
        assert len(pickle.dumps(model)) == size
        assert predictor.tasks == model.tasks_.tolist()


def test_a_thread_sees_the_old_or_the_new_state():
    """Outputs of one model that always agree are computed while it learns."""
    X, y = draw()
    model = MultiTaskGPRegressor(rank=1, **START).fit(X, np.stack([y, y], axis=1))
    predictor = compile_predictor(model, std=True)
    done, found = threading.Event(), []

    def control():
        while not done.is_set():
            found.append(predictor.predict_tasks(X_STATE))

    thread = threading.Thread(target=control)
    thread.start()
    states = [predictor.predict_tasks(X_STATE)]
    try:
        for k in range(20):
            model.partial_fit(ROW + [[0.01 * k, 0.0, 0.0]], [[9.0 * k, 9.0 * k]])
            states.append(predictor.predict_tasks(X_STATE))
            time.sleep(1e-3)
    finally:
        done.set()
        thread.join()
    assert len(found) > 20
    known = {state.tobytes() for state in states}
    assert {of.tobytes() for of in found} <= known


def test_threads_that_learn_at_once():
    models = [fitted() for _ in range(3)]
    predictor = compile_predictor(models, TASK)

    def learn(model):
        for k in range(10):
            model.partial_fit(ROW + [[0.01 * k, 0.0, 0.0]], [9.0])

    threads = [threading.Thread(target=learn, args=(model,)) for model in models]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    expected = [model.predict(ROW)[0] for model in models]
    np.testing.assert_allclose(predictor(X_STATE), expected, rtol=1e-9)
