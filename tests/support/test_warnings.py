"""Warnings that are given or collected, in any number of threads."""

import ast
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest
from test_layers import MODULES

from skmtgp import exceptions
from skmtgp._support.warnings import collect_warnings, quiet, warn
from skmtgp.exceptions import JitterWarning, SkmtgpWarning


def test_given():
    with pytest.warns(JitterWarning, match="some jitter") as caught:
        warn("some jitter", JitterWarning)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("name", [of for of in exceptions.__all__ if "Warning" in of])
def test_one_filter_for_all(name):
    kind = getattr(exceptions, name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkmtgpWarning)
        warn("not given", kind)
    own = kind is SkmtgpWarning
    assert own or issubclass(kind, (UserWarning, RuntimeWarning))


def test_collected():
    with collect_warnings() as outer:
        warn("a", UserWarning)
        with collect_warnings() as inner:
            warn("b", JitterWarning)
        warn("c", UserWarning)
    assert inner == [(JitterWarning, "b")]
    assert outer == [(UserWarning, "a"), (UserWarning, "c")]
    with pytest.warns(UserWarning, match="d"):
        warn("d", UserWarning)


def test_errors_end_the_collection():
    with pytest.raises(ZeroDivisionError, match="zero"), collect_warnings():
        1 / 0  # noqa: B018
    with pytest.warns(UserWarning, match="given"):
        warn("given", UserWarning)


def test_of_threads_that_overlap():
    """Each has its own, and what is done with warnings stays as it is."""
    met, before = threading.Barrier(2), list(warnings.filters)

    def work(i):
        met.wait(10)
        with collect_warnings() as collected:
            met.wait(10)
            warn(f"of {i}", UserWarning)
            met.wait(10)
            return collected

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(work, range(2)))
    assert found == [[(UserWarning, "of 0")], [(UserWarning, "of 1")]]
    assert warnings.filters == before


def test_other_packages_can_be_tried_without_their_warnings():
    before = list(warnings.filters)
    with quiet():
        warnings.warn("tried", UserWarning, stacklevel=1)
    assert warnings.filters == before
    with pytest.warns(UserWarning, match="again"):
        warnings.warn("again", UserWarning, stacklevel=1)


def test_one_thread_at_a_time_is_quiet():
    before, inside, most = list(warnings.filters), [], []

    def work():
        with quiet():
            inside.append(1)
            most.append(len(inside))
            time.sleep(0.01)
            inside.pop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 4
    assert warnings.filters == before


@pytest.mark.parametrize("module", MODULES)
def test_nothing_else_gives_warnings_or_changes_what_is_done_with_them(module):
    """``warnings.warn`` cannot be collected; the others are not for threads."""
    if module == "skmtgp._support.warnings" or module.startswith("skmtgp.datasets"):
        return
    names = {"warn", "catch_warnings", "simplefilter", "filterwarnings"}
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.Attribute) and node.attr in names:
            assert getattr(node.value, "id", None) != "warnings", ast.unparse(node)
        if isinstance(node, ast.ImportFrom):
            assert node.module != "warnings"
