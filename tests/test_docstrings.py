"""Public docstrings are numpydoc's, complete and with examples."""

import importlib
import inspect
import pkgutil

import pytest
from numpydoc.validate import validate
from sklearn.gaussian_process.kernels import Kernel

import skmtgp

SUMMARY = {
    "GL08": "there is a docstring",
    "SS01": "it has a summary",
    "SS03": "which ends with a period",
    "SS06": "and fits on one line",
}
CONTENT = {
    "GL06": "sections are numpydoc's",
    "GL07": "in its order",
    "PR01": "parameters are documented",
    "PR02": "and no others",
    "PR03": "in their order",
    "PR04": "with a type",
    "PR07": "and a description",
    "RT01": "so is what is returned",
    "RT03": "with a description",
}
EXAMPLES = {"EX01": "there is an example"}


def public_modules():
    """The package and its modules that a user may import."""
    names = [m.name for m in pkgutil.iter_modules(skmtgp.__path__)]
    public = [f"skmtgp.{name}" for name in names if not name.startswith("_")]
    return [importlib.import_module(name) for name in ("skmtgp", *public)]


def public_objects():
    """Classes and functions in the modules' __all__, by where they are defined."""
    found = {}
    for module in public_modules():
        for name in getattr(module, "__all__", ()):
            item = getattr(module, name)
            if inspect.isclass(item) or inspect.isroutine(item):
                found[f"{item.__module__}.{item.__qualname__}"] = item
    return found


def public_methods(cls):
    """Names of the methods and properties that the class itself defines."""
    kinds = (property, staticmethod, classmethod)
    return [
        name
        for name, item in vars(cls).items()
        if not name.startswith("_") and (callable(item) or isinstance(item, kinds))
    ]


def overrides_kernel(cls, name):
    """Whether scikit-learn documents the method: kernels are in its language."""
    return issubclass(cls, Kernel) and hasattr(Kernel, name)


def checks():
    """Dotted names and the codes that are to hold for them."""
    for path, item in public_objects().items():
        yield path, {**SUMMARY, **CONTENT, **EXAMPLES}
        for name in public_methods(item) if inspect.isclass(item) else ():
            brief = isinstance(vars(item)[name], property)
            brief |= overrides_kernel(item, name)
            yield f"{path}.{name}", SUMMARY if brief else {**SUMMARY, **CONTENT}


CHECKS = dict(checks())


def faults(path, codes):
    return [
        f"{code} {text}" for code, text in validate(path)["errors"] if code in codes
    ]


@pytest.mark.parametrize("path", CHECKS)
def test_docstring(path):
    found = faults(path, CHECKS[path])
    assert not found, "\n".join([path, *found])


def test_no_example_is_skipped():
    """An example that needs an extra is named in conftest.py instead."""
    items = public_objects().items()
    assert [path for path, item in items if "+SKIP" in (item.__doc__ or "")] == []


def test_every_kind_of_object_is_found():
    assert "skmtgp.metrics.coverage" in CHECKS
    assert "skmtgp.preprocessing.InverseDynamicsFeatures.transform" in CHECKS
    assert "skmtgp.kernels.Columns.select" in CHECKS
    assert "skmtgp.preprocessing.InverseDynamicsFeatures.set_params" not in CHECKS


def undocumented(number):
    return number


def half_documented(number, other):
    """Do something

    Parameters
    ----------
    number : int
        A number.
    another : int
        No such thing.
    """
    return number


def test_faults_are_found():
    codes = {**SUMMARY, **CONTENT, **EXAMPLES}
    assert faults(f"{__name__}.undocumented", codes)[0].startswith("GL08")
    found = [fault.split()[0] for fault in faults(f"{__name__}.half_documented", codes)]
    assert found == ["SS03", "PR01", "PR02", "RT01", "EX01"]
