"""What a release says of itself is the same everywhere."""

import importlib.util
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import skmtgp
from skmtgp._estimators.estimator import DOCUMENTATION

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]


def read(path):
    """What a YAML file of the checkout says; not all are in the source distribution."""
    if not (ROOT / path).exists():
        pytest.skip("only in a checkout")
    return yaml.safe_load((ROOT / path).read_text("utf-8"))


def bounds(lines):
    """Requirements as pairs of a name and its versions."""
    parsed = [Requirement(line) for line in lines]
    return {(each.name, str(each.specifier)) for each in parsed}


def test_citation_has_the_version_and_licence():
    citation = read("CITATION.cff")
    assert citation["version"] == skmtgp.__version__
    assert citation["license"] == PROJECT["license"]


def test_recipe_has_the_version_and_licence():
    recipe = read("conda/recipe.yaml")
    assert recipe["context"]["version"] == skmtgp.__version__
    assert recipe["about"]["license"] == PROJECT["license"]


def test_recipe_requires_the_same():
    recipe = read("conda/recipe.yaml")
    python, *others = recipe["requirements"]["run"]
    assert python == "python >=${{ python_min }}"
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
    assert bounds(others) == bounds(PROJECT["dependencies"])
    built_with = bounds(PYPROJECT["build-system"]["requires"])
    assert built_with <= bounds(recipe["requirements"]["host"][1:])


def test_pythons_that_are_claimed_are_those_that_are_tested():
    prefix = "Programming Language :: Python :: 3."
    claimed = {
        line.removeprefix(prefix[:-2])
        for line in PROJECT["classifiers"]
        if line.startswith(prefix)
    }
    matrix = read(".github/workflows/ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    assert claimed == set(matrix["python-version"])
    assert f">={min(claimed)}" == PROJECT["requires-python"]


def checks():
    """The module of .ci/check_release.py."""
    path = ROOT / ".ci" / "check_release.py"
    if not path.exists():
        pytest.skip("only in a checkout")
    spec = importlib.util.spec_from_file_location("check_release", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FILES = "pyproject.toml", "CITATION.cff", "conda/recipe.yaml", "CHANGELOG.md"
REPOSITORY = "https://git.example.org/skmtgp"
DATED = f"## [{skmtgp.__version__}] - 2030-01-31"


@pytest.fixture
def release(tmp_path):
    """A copy of what a release says of itself, with all filled in."""
    blank = checks().BLANK
    for name in (*FILES, "skmtgp/__init__.py"):
        text = (ROOT / name).read_text("utf-8")
        text = text.replace(f"https://{blank}.invalid/skmtgp", REPOSITORY)
        text = re.sub(r"^## .*$", DATED, text, count=name == FILES[-1], flags=re.M)
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    return tmp_path


def test_nothing_is_wrong_but_what_is_to_be_filled_in():
    assert [line for line in checks().findings(ROOT) if "fill in" not in line] == []


def test_what_is_filled_in_is_ready(release):
    assert list(checks().findings(release)) == []


@pytest.mark.parametrize(
    ("name", "before", "after", "match"),
    [
        ("skmtgp/__init__.py", '"0.', '"0.0.dev', "is no version of a release"),
        (
            "CITATION.cff",
            "version: 0",
            "version: 9",
            r"CITATION.cff: version 9.*has 0",
        ),
        (
            "conda/recipe.yaml",
            "numpy >=1.26",
            "numpy >=1.0",
            "numpy>=1.0 is in one alone",
        ),
        ("conda/recipe.yaml", "3.11", "3.10", "python_min 3.10, pyproject.toml has"),
        (
            "conda/recipe.yaml",
            REPOSITORY,
            "https://else.org",
            "recipe.yaml, repository",
        ),
        ("CITATION.cff", "https://skmtgp.", "https://", "CITATION.cff, url: "),
        ("CHANGELOG.md", " - 2030-01-31", "", "CHANGELOG.md: fill in the date"),
        (
            "pyproject.toml",
            REPOSITORY,
            "https://FILL-IN.invalid",
            "line .*: fill in Repo",
        ),
    ],
)
def test_what_is_not_ready_is_named(release, name, before, after, match):
    path = release / name
    text = path.read_text("utf-8")
    assert before in text
    path.write_text(text.replace(before, after), "utf-8")
    assert re.search(match, "\n".join(checks().findings(release)))


def test_links_of_the_readme_are_absolute_in_the_metadata(release):
    """PyPI shows it by itself, without the files that it links to."""
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hook", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shutil.copy(ROOT / "README.md", release)
    metadata = {}
    module.CustomMetadataHook(str(release), {}).update(metadata)
    readme = (ROOT / "README.md").read_text("utf-8")
    before, after = (
        re.findall(r"\]\(([^)]+)\)", text)
        for text in (readme, metadata["readme"]["text"])
    )
    assert len(before) == len(after)
    assert all(url.startswith(("https://", "#")) for url in after)
    assert [url for url in before if "://" in url] == [
        url for url in after if url in before
    ]
    urls = PROJECT["urls"] | {"Repository": REPOSITORY}
    found = module.absolute(
        "![a](docs/images/a.png) [b](docs/guide/b.md#c), [two\nlines](examples/d.py) "
        "[e](https://e.org) [f](#f)",
        urls,
        "9.1",
    )
    assert found == (
        f"![a]({REPOSITORY}/raw/v9.1/docs/images/a.png) "
        "[b](https://skmtgp.readthedocs.io/en/stable/guide/b.html#c), "
        f"[two\nlines]({REPOSITORY}/blob/v9.1/examples/d.py) "
        "[e](https://e.org) [f](#f)"
    )


def test_links_are_those_of_the_metadata():
    """Wherever the project's own pages are linked, as pyproject.toml has them."""
    urls = tuple(PROJECT["urls"].values())
    own = re.compile(r"https://[\w./-]*\bskmtgp\b[\w./-]*")
    names = ["README.md", "CONTRIBUTING.md", ".github/ISSUE_TEMPLATE/config.yml"]
    texts = [
        path.read_text("utf-8") for name in names if (path := ROOT / name).exists()
    ]
    found = [url for text in texts for url in own.findall(text)]
    assert all(url.startswith(urls) for url in [*found, DOCUMENTATION])


def paper(name):
    path = ROOT / "paper" / name
    if not path.exists():
        pytest.skip("only in a checkout")
    return path.read_text("utf-8")


def test_the_paper_cites_what_it_lists():
    known = re.findall(r"^@\w+\{(\w+),", paper("paper.bib"), re.MULTILINE)
    cited = re.findall(r"@([a-z]+\d{4})", paper("paper.md"))
    assert set(cited) == set(known)
    assert len(known) == len(set(known))
    for entry in paper("paper.bib").split("\n@"):
        assert re.search(r"^  (doi|url) = \{.+\}$", entry, re.MULTILINE), entry


def test_the_paper_has_the_length_and_the_sections_of_its_journal():
    _, head, text = paper("paper.md").split("---\n", 2)
    assert {"title", "authors", "affiliations", "bibliography"} <= yaml.safe_load(
        head
    ).keys()
    sections = re.findall(r"^# (.*)$", text, re.MULTILINE)
    assert sections[:2] == ["Summary", "Statement of need"]
    assert sections[-1] == "References"
    assert 250 <= len(text.split()) <= 1000


def test_numbers_of_the_paper_are_those_of_the_results():
    text = " ".join(paper("paper.md").split())
    results = ROOT / "benchmarks" / "results"
    noisy = (results / "noisy_modes.txt").read_text("utf-8")
    n, *below = re.search(r"Of (\d+) fits: (\d+) > 0.5, (\d+) > 5,", noisy).groups()
    assert f"Of {n} fits to small, noisy data, {below[0]} end more" in text
    assert f"and {below[1]} more than 5 nats" in text
    search, alone = (results / "modes.txt").read_text("utf-8").split("Rank 4 alone")
    table = search.split("nats below the best known\n")[1].splitlines()[2:8]
    worst = max(float(value) for line in table for value in line.split()[1:])
    assert f"ends at most {worst} nats below the best" in text
    worst = max(float(line.split()[-1]) for line in alone.splitlines()[1:7])
    assert f"one rank alone, {worst} nats below on one joint" in text
    orders = (results / "modes_orders.txt").read_text("utf-8").splitlines()
    *others, most = sorted(float(line.split()[-1]) for line in orders[-6:])
    assert f"up to {most:.0f} nats on one joint, and up to {max(others):.0f} on" in text
    page = " ".join((ROOT / "docs" / "benchmarks.md").read_text("utf-8").split())
    for number in ("36 of 36 problems", "take 0.28 s", "3.2 (GPy) to 14 times as long"):
        assert number in page
    assert "On 6 of 9 tests" in page
    for command in re.findall(r"`python (\S+)`", text):
        assert (ROOT / command).exists()
