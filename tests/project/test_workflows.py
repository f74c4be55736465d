"""The files for GitHub and Read the Docs are valid and call what exists."""

import re
import tomllib
from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted(ROOT.glob(".github/workflows/*.yml"))
FORMS = sorted(ROOT.glob(".github/ISSUE_TEMPLATE/*_*.yml"))
OTHERS = [
    ".github/ISSUE_TEMPLATE/config.yml",
    ".github/dependabot.yml",
    ".pre-commit-config.yaml",
    ".readthedocs.yaml",
]
MAJOR = re.compile(r"[\w-]+/[\w-]+@(v\d+|release/v\d+)")

pytestmark = pytest.mark.skipif(not WORKFLOWS, reason="only in a checkout")


def read(path):
    return yaml.safe_load(Path(path).read_text("utf-8"))


def jobs(path):
    return read(path)["jobs"].values()


def steps(path):
    return [step for job in jobs(path) for step in job["steps"]]


def targets():
    """Targets of the Makefile that are no files."""
    text = (ROOT / "Makefile").read_text("utf-8").replace("\\\n", "")
    return set(re.search(r"^\.PHONY:(.*)$", text, re.MULTILINE)[1].split())


def test_help_lists_all_targets():
    text = (ROOT / "Makefile").read_text("utf-8")
    listed = re.findall(r"^\t@echo 'make ([\w-]+) ", text, re.MULTILINE)
    assert len(listed) == len(set(listed))
    assert set(listed) == targets()


def stem(path):
    return path.stem


@pytest.mark.parametrize("path", WORKFLOWS, ids=stem)
def test_commands_are_targets_of_the_makefile(path):
    called = [
        re.findall(r"^make ([\w-]+)", step["run"], re.MULTILINE)
        for step in steps(path)
        if "run" in step
    ]
    assert any(called)
    assert set().union(*called) <= targets()


@pytest.mark.parametrize("path", WORKFLOWS, ids=stem)
def test_actions_are_pinned_to_a_major_version(path):
    used = [step["uses"] for step in steps(path) if "uses" in step]
    assert used
    assert [name for name in used if not MAJOR.fullmatch(name)] == []


@pytest.mark.parametrize("path", WORKFLOWS, ids=stem)
def test_nothing_may_be_written(path):
    assert set(read(path)["permissions"]) <= {"contents"}
    granted = [job.get("permissions", {}) for job in jobs(path)]
    granted.append(read(path)["permissions"])
    for permissions in granted:
        assert permissions.get("contents", "read") == "read"
        assert set(permissions) <= {"contents", "id-token"}


@pytest.mark.parametrize("path", WORKFLOWS, ids=stem)
def test_jobs_end_and_need_what_exists(path):
    for job in jobs(path):
        assert job["timeout-minutes"] <= 90
        assert job.get("needs", "none") in {"none", *read(path)["jobs"]}


def test_only_publishing_may_ask_for_an_identity():
    (publish,) = [
        job
        for path in WORKFLOWS
        for job in jobs(path)
        if "id-token" in job.get("permissions", {})
    ]
    assert publish["environment"] == "pypi"
    assert not any("run" in step for step in publish["steps"])


@pytest.mark.parametrize("path", FORMS, ids=stem)
def test_form_asks_questions(path):
    form = read(path)
    assert {"name", "description", "body"} <= form.keys()
    labels = [question["attributes"]["label"] for question in form["body"]]
    assert len(labels) == len(set(labels))


def test_reports_ask_for_the_versions():
    text = (ROOT / ".github/ISSUE_TEMPLATE/bug_report.yml").read_text("utf-8")
    assert "python -m skmtgp" in text


@pytest.mark.parametrize("path", OTHERS)
def test_is_yaml(path):
    assert read(ROOT / path)


def test_documentation_is_built_with_an_extra_that_exists():
    (install,) = read(ROOT / ".readthedocs.yaml")["python"]["install"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert set(install["extra_requirements"]) <= project["optional-dependencies"].keys()
