"""What is built for a release, and the files that a project is expected to have."""

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from email.message import Message
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
URL = "https://host.example/owner/slowtime"


def load():
    place = ROOT / "release/build.py"
    if not place.exists():
        pytest.skip("release/build.py is not here: this is a copy of the tests alone")
    spec = importlib.util.spec_from_file_location("release_build", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def release():
    return load()


def distribution(version="0.1.0", readme="[map](https://z.io)", urls=True):
    metadata = Message()
    for header, value in {
        "Version": version, "License-Expression": "Apache-2.0", "License-File": "LICENSE",
        "Requires-Python": ">=3.11", "Summary": "A twin.",
    }.items():  # fmt: skip
        metadata[header] = value
    for name in load().PAGES if urls else ():
        metadata["Project-URL"] = f"{name}, {URL}/x"
    metadata.set_payload(readme)
    return metadata


def test_links_of_the_readme_become_absolute(release):
    text = release.absolute((ROOT / "README.md").read_text(), URL, "v9")
    links = [match[3] for match in release.LINK.finditer(text)]
    assert len(links) > 40
    assert [link for link in links if not link.startswith(("https://", "#"))] == []
    assert f"{URL}/blob/v9/docs/map.md" in links
    assert f"{URL}/raw/v9/docs/page.png" in links
    assert f"{URL}/tree/v9/docs/decisions" in links


def test_a_picture_that_is_a_link_keeps_both(release):
    text = release.absolute("[![p](a.png)](b.md)", URL, "v1")
    assert text == f"[![p]({URL}/raw/v1/a.png)]({URL}/blob/v1/b.md)"


def test_sound_metadata_have_no_faults(release):
    assert list(release.metadata_faults(distribution(), "0.1.0", URL)) == []


@pytest.mark.parametrize(
    ("metadata", "fault"),
    [
        ({"version": "0.0.9"}, "of version 0.0.9 instead of 0.1.0"),
        ({"readme": "[map](docs/map.md)"}, "relative: docs/map.md"),
        ({"readme": ""}, "description is empty"),
        ({"urls": False}, "Project URLs are missing: Changelog"),
    ],
)
def test_faults_of_metadata_are_named(release, metadata, fault):
    found = " ".join(release.metadata_faults(distribution(**metadata), "0.1.0", URL))
    assert fault in found


def test_an_address_that_is_none_is_refused(release, capsys):
    with pytest.raises(SystemExit):
        release.main(["--url", "slowtime"])
    assert "Give https://HOST/OWNER/NAME" in capsys.readouterr().err


@pytest.mark.long
def test_a_dry_run_builds_what_passes_its_checks_twice_alike():
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    told = [
        subprocess.run(
            [sys.executable, "release/build.py"], cwd=ROOT, capture_output=True, text=True,
            check=False,
        )
        for _ in range(2)
    ]  # fmt: skip
    assert told[0].returncode == 0, told[0].stderr
    assert "Dry run" in told[0].stdout
    hashes = [re.findall(r"^([0-9a-f]{64})  ", one.stdout, re.M) for one in told]
    assert len(hashes[0]) == 3
    assert hashes[0] == hashes[1]
    (bill,) = (ROOT / "var/release/dist").glob("*.cdx.json")
    components = {one["name"]: one for one in json.loads(bill.read_text())["components"]}
    assert "licenses" in components["numpy"]


def test_every_package_of_the_wheel_is_typed(release):
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    packages = wheel["targets"]["wheel"]["packages"]
    assert {Path(package).name for package in packages} == set(release.PACKAGES)
    assert [one for one in packages if not (ROOT / one / "py.typed").exists()] == []


def test_the_citation_is_of_this_version_and_complete(release):
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert list(release.version_faults(version)) == []
    assert len(list(release.version_faults("9.9.9"))) == 2
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)


def test_forms_of_issues_are_complete_and_ask_the_doctor(release):
    forms = {
        path.stem: yaml.safe_load(path.read_text())
        for path in (ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")
        if path.stem != "config"
    }
    assert set(forms) == {"error", "result", "system", "wish"}
    for form in forms.values():
        assert {"name", "description", "body"} <= set(form)
        ids = [field["id"] for field in form["body"]]
        assert len(ids) == len(set(ids))
    assert all("doctor" in json.dumps(forms[name]) for name in ("error", "result", "system"))


@pytest.mark.parametrize(
    "name", ["CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md", "CHANGELOG.md"]
)
def test_links_of_the_project_files_lead_somewhere(release, name):
    links = re.findall(r"\]\(([^)#\s]+)", (ROOT / name).read_text())
    relative = [link for link in links if "://" not in link]
    assert relative
    assert [link for link in relative if not (ROOT / link).exists()] == []


def test_commands_of_contributing_are_targets(release):
    targets = set(re.findall(r"^([a-z./-]+):", (ROOT / "Makefile").read_text(), re.M))
    said = set(re.findall(r"`make ([a-z./-]+)`", (ROOT / "CONTRIBUTING.md").read_text()))
    assert {"test", "check", "site"} <= said <= targets


def test_hooks_before_a_commit_run_tools_of_the_development_environment(release):
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    tools = {Path(hook["entry"].split()[0]).name for hook in hooks}
    assert tools == {"ruff", "lint-imports"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    dev = "\n".join(project["optional-dependencies"]["dev"])
    assert all(name in dev for name in ("ruff", "import-linter"))
