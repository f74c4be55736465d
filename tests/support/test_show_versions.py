import runpy
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from threadpoolctl import threadpool_info

import skmtgp
from skmtgp import show_versions
from skmtgp.__main__ import main
from skmtgp._support import versions as _show_versions

ROOT = Path(__file__).parents[2]


def shown(capsys):
    """What was printed, one (name, value) a line."""
    lines = capsys.readouterr().out.splitlines()
    return {tuple(line.strip().split(": ", 1)) for line in lines if ": " in line}


def test_versions_of_all_that_is_installed(capsys):
    show_versions()
    lines = shown(capsys)
    for name in ("skmtgp", *_show_versions.DEPENDENCIES):
        assert (name, version(name)) in lines
    assert ("python", sys.version.replace("\n", " ")) in lines
    for library in threadpool_info():
        assert ("filepath", library["filepath"]) in lines


def test_what_is_not_installed_is_none(capsys, monkeypatch):
    monkeypatch.setattr(_show_versions, "EXTRAS", ("no-such-package",))
    show_versions()
    assert ("no-such-package", "None") in shown(capsys)


def test_every_dependency_is_shown():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]

    def names(lines):
        return {Requirement(line).name for line in lines}

    needed = names(project["dependencies"])
    assert set(_show_versions.DEPENDENCIES) == needed
    for_users = extras["puma"] + extras["plot"] + extras["dask"]
    assert set(_show_versions.EXTRAS) == names(for_users) - needed


def test_module_prints_the_same(capsys):
    show_versions()
    expected = capsys.readouterr().out
    main([])
    assert capsys.readouterr().out == expected


def test_module_prints_the_version_alone(capsys, monkeypatch):
    """As python -m does, but for what it takes to import everything again."""
    monkeypatch.setattr(sys, "argv", ["skmtgp", "--version"])
    monkeypatch.delitem(sys.modules, "skmtgp.__main__", raising=False)
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("skmtgp", run_name="__main__", alter_sys=True)
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"{skmtgp.__version__}\n"


def test_module_takes_nothing_else(capsys):
    with pytest.raises(SystemExit):
        main(["--versions"])
    assert "unrecognized arguments: --versions" in capsys.readouterr().err
