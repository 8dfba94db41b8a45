"""What the documentation site promises, without building it: `make site` does, in a minute."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NOTEBOOKS = sorted(page for page in (DOCS / "notebooks").glob("*.md") if page.stem != "index")
LINK = re.compile(r"(?<!`)\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^)\s#]+)(?:#[^)\s]*)?\)")


def shown() -> set[str]:
    """Functions, classes and packages that the pages document."""
    text = "\n".join(page.read_text() for page in PAGES)
    return set(re.findall(r"^\.\. auto(?:function|class|module):: (\S+)", text, re.M))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_every_relative_link_of_a_page_leads_somewhere(page):
    text = re.sub(r"^```.*?^```|^ {4}.*$", "", page.read_text(), flags=re.M | re.S)
    links = [link for link in LINK.findall(text) if not re.match(r"[a-z]+:", link)]
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_every_reference_link_of_the_comparison_is_defined_and_used():
    text = (DOCS / "comparison.md").read_text()
    defined = set(re.findall(r"^\[([^\]]+)\]: https?://\S+$", text, re.M))
    used = set(re.findall(r"\]\[([^\]]+)\]", text)) | {"pyOMA2", "PySINDy"}
    assert used == defined


def test_every_documented_name_exists():
    names = shown()
    assert len(names) > 50
    for name in names:
        place, _, last = name.rpartition(".")
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            assert hasattr(importlib.import_module(place), last), name


def test_every_public_name_is_in_the_reference():
    import slowtime as st

    public = {f"slowtime.{name}" for name in st.__all__ if name != "__version__"}
    assert public <= shown()


def test_every_page_is_in_the_contents():
    entries = set()
    for page in PAGES:
        for block in re.findall(r"^```\{toctree\}(.*?)^```", page.read_text(), re.M | re.S):
            for line in block.splitlines():
                if line and not line.startswith(":"):
                    found = page.parent.glob(f"{line}.md") if "../" not in line else [
                        (page.parent / f"{line}.md").resolve()
                    ]  # fmt: skip
                    entries |= set(found)
    left_out = {DOCS / "index.md", *(DOCS / "tutorials/parts").rglob("*.md")}
    assert [page for page in PAGES if page not in entries | left_out] == []


def test_every_schema_and_version_is_on_the_page_of_formats():
    text = (DOCS / "formats.md").read_text()
    schemas = sorted((ROOT / "schemas/json").rglob("*.json"))
    assert schemas
    assert [one for one in schemas if f"../{one.relative_to(ROOT)}" not in text] == []


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_the_code_of_a_notebook_compiles(page):
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```", page.read_text(), re.M | re.S)
    assert len(cells) >= 3
    for cell in cells:
        compile(cell, page.name, "exec")


def test_there_are_six_notebooks_and_all_are_listed():
    listed = (DOCS / "notebooks/index.md").read_text()
    assert len(NOTEBOOKS) >= 6
    assert all(f"({page.name})" in listed for page in NOTEBOOKS)


def test_what_builds_the_site_is_an_extra():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    names = {re.split(r"[>=\[]", line)[0] for line in extras["docs"]}
    assert {"sphinx", "myst-nb", "numpydoc", "jupytext"} <= names


@pytest.mark.long
@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_the_code_of_a_notebook_passes_strict_types(page, tmp_path):
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```", page.read_text(), re.M | re.S)
    code = tmp_path / f"{page.stem}_code.py"
    code.write_text("\n".join(cells))
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml"]
    done = subprocess.run(
        [*command, str(code)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
