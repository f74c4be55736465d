"""Everything public has type hints: the package ships py.typed."""

import importlib
import inspect
from typing import Literal, Unpack, get_args, get_origin, get_overloads, get_type_hints

import pytest

MODULES = [
    "skmtgp",
    "skmtgp.datasets",
    "skmtgp.kernels",
    "skmtgp.inspection",
    "skmtgp.metrics",
    "skmtgp.preprocessing",
]


def public_names():
    """Dotted names of the public callables and the objects themselves."""
    for path in MODULES:
        module = importlib.import_module(path)
        for name in module.__all__:
            yield f"{path}.{name}", getattr(module, name)


def methods(cls):
    """Names and functions of what the package defines of a class, its bases too."""
    for name, _ in inspect.getmembers(cls):
        item = inspect.getattr_static(cls, name)
        item = item.fget if isinstance(item, property) else item
        public = not name.startswith("_") or name in ("__init__", "__call__")
        if public and inspect.isfunction(item) and item.__module__.startswith("skmtgp"):
            yield name, item


def callables():
    for path, item in public_names():
        if inspect.isclass(item):
            yield from ((f"{path}.{name}", method) for name, method in methods(item))
        else:
            yield path, item


CALLABLES = dict(callables())
OVERLOADED = [
    path for path, item in CALLABLES.items() if get_overloads(inspect.unwrap(item))
]


def unhinted(function):
    """Names of the parameters without a hint, and "return"."""
    signature = inspect.signature(function)
    found = [
        name
        for name, parameter in signature.parameters.items()
        if name != "self" and parameter.annotation is parameter.empty
    ]
    without = signature.return_annotation is signature.empty
    return found + ["return"] * (without and function.__name__ != "__init__")


@pytest.mark.parametrize("path", CALLABLES)
def test_hints(path):
    assert not unhinted(CALLABLES[path])


@pytest.mark.parametrize("path", CALLABLES)
def test_signatures_can_be_read(path):
    """Aliases such as ArrayLike are not written out, over five lines of help()."""
    assert "numpy._typing" not in str(inspect.signature(CALLABLES[path]))


def arguments(function):
    """Hints of the arguments by their names; those of a TypedDict count one by one."""
    hints = get_type_hints(function)
    del hints["return"]
    for name, hint in list(hints.items()):
        if get_origin(hint) is Unpack:
            hints |= get_type_hints(*get_args(hints.pop(name)))
    return hints


def depends(function):
    """Whether one of several types is returned, and a flag may say which."""
    signature = inspect.signature(function)
    hints = [str(each.annotation) for each in signature.parameters.values()]
    flags = [hint for hint in hints if "bool" in hint or "Literal" in hint]
    return bool(flags) and " | " in str(signature.return_annotation)


@pytest.mark.parametrize("path", CALLABLES)
def test_what_a_flag_decides_has_overloads(path):
    if depends(CALLABLES[path]):
        assert path in OVERLOADED


@pytest.mark.parametrize("path", OVERLOADED)
def test_overloads_have_the_arguments_of_the_function(path):
    function = inspect.unwrap(CALLABLES[path])
    whole = arguments(function)
    for variant in get_overloads(function):
        found = arguments(variant)
        assert found.keys() == whole.keys()
        other = [hint for name, hint in found.items() if hint != whole[name]]
        assert all(get_origin(hint) is Literal for hint in other)


def test_functions_without_overloads_are_found():
    def example(std: bool) -> int | str:
        pass

    assert depends(example)
    assert "skmtgp.datasets.make_puma560" in OVERLOADED
    assert "skmtgp.WideRegressor.predict" in OVERLOADED  # behind a decorator


@pytest.mark.parametrize(
    "path",
    [
        "skmtgp.RankSearchIC.__init__",
        "skmtgp.MultiTaskGPRegressor.sample_y",  # of a base class
        "skmtgp.SingleTaskGP.fit",  # behind a decorator
        "skmtgp.make_inverse_dynamics_regressor",
        "skmtgp.datasets.load_puma560",
        "skmtgp.kernels.Columns.__call__",
        "skmtgp.kernels.Columns.theta",  # a property
    ],
)
def test_every_kind_of_callable_is_found(path):
    assert path in CALLABLES


def test_missing_hints_are_found():
    class Example:
        def __init__(self, number: int, other=None):
            pass

        def method(self, number: int, *, other: str):
            pass

    assert unhinted(Example.__init__) == ["other"]
    assert unhinted(Example.method) == ["return"]
