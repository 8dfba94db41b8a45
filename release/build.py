"""Build wheel, source distribution and bill of materials, and check them: ``make release``.

The project is copied from the last commit. In the copy, links of the README become absolute and
the addresses of the project are stated, as the wheel's description is read far from the files.
Without an address it is a dry run: everything is built and checked in ``var/release``, and
nothing there is meant for publication. Nothing is uploaded in either case.
"""

import argparse
import email
import email.message
import hashlib
import importlib.metadata
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PLACEHOLDER = "https://example.invalid/slowtime"
"""Address of a dry run, in a domain that RFC 2606 reserves."""
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
PAGES = {
    "Homepage": "",
    "Repository": "",
    "Documentation": "/blob/{tag}/docs/index.md",
    "Changelog": "/blob/{tag}/CHANGELOG.md",
    "Issues": "/issues",
}
"""Name of a project URL → path below the repository."""
PACKAGES = (
    "edge_agent", "slowtime", "slowtime_api", "slowtime_cli", "slowtime_schemas",
    "slowtime_services", "twin_server",
)  # fmt: skip


class ReleaseError(Exception):
    """Something that must not be released; the text says what to do."""


def absolute(readme: str, url: str, tag: str) -> str:
    """Make the relative links of a README absolute.

    Parameters
    ----------
    readme
        Text in Markdown.
    url
        Address of the repository.
    tag
        Tag of the release, at which the files are looked up.

    Returns
    -------
    str
        The same text; pictures lead to the files themselves, other links to their pages.

    Examples
    --------
    >>> absolute("[map](docs/map.md#flow) ![p](a.png) [z](https://z.io)", "https://h/s", "v1")
    '[map](https://h/s/blob/v1/docs/map.md#flow) ![p](https://h/s/raw/v1/a.png) [z](https://z.io)'
    """

    def rewritten(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        inner = LINK.sub(rewritten, text)
        if re.match(r"[a-z][a-z+.-]*:|#", target):
            return f"{picture}[{inner}]({target})"
        kind = "raw" if picture else "tree" if (ROOT / target).is_dir() else "blob"
        return f"{picture}[{inner}]({url}/{kind}/{tag}/{target})"

    return LINK.sub(rewritten, readme)


def urls(url: str, tag: str) -> str:
    """Return the table of project URLs, for pyproject.toml."""
    lines = (f'{name} = "{url}{path.format(tag=tag)}"' for name, path in PAGES.items())
    return "[project.urls]\n" + "\n".join(lines) + "\n\n"


def copy(folder: Path, url: str) -> str:
    """Copy the last commit into a folder, with absolute addresses; return the version."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    archive = subprocess.run(
        ["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True
    )
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
        files.extractall(folder, filter="data")
    project = folder / "pyproject.toml"
    text = project.read_text()
    version = str(tomllib.loads(text)["project"]["version"])
    tag = f"v{version}"
    marker = "[project.optional-dependencies]"
    if text.count(marker) != 1:
        raise ReleaseError(f"pyproject.toml has no single line {marker}.")
    project.write_text(text.replace(marker, urls(url, tag) + marker))
    readme = folder / "README.md"
    readme.write_text(absolute(readme.read_text(), url, tag))
    return version


def build(source: Path, out: Path) -> tuple[Path, Path]:
    """Build wheel and source distribution; the same files give the same bytes."""
    shutil.rmtree(out, ignore_errors=True)
    when = subprocess.run(
        ["git", "log", "-1", "--format=%ct"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(out)]
    done = subprocess.run(
        command, cwd=source, capture_output=True, text=True, check=False,
        env=os.environ | {"SOURCE_DATE_EPOCH": when},
    )  # fmt: skip
    if done.returncode:
        raise ReleaseError(f"The build failed:\n{done.stderr}")
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, sdist


def wheel_faults(wheel: Path, version: str, url: str) -> Iterator[str]:
    """Say what is wrong with a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (place,) = [name for name in names if name.endswith(".dist-info/METADATA")]
        metadata = email.message_from_string(archive.read(place).decode())
    for package in PACKAGES:
        if f"{package}/py.typed" not in names:
            yield f"{package}/py.typed is missing, so types are not seen by users."
    top = {name.partition("/")[0] for name in names}
    if extra := top - {*PACKAGES, place.partition("/")[0]}:
        yield f"Folders that do not belong into a wheel: {', '.join(sorted(extra))}."
    if not any(name.startswith("slowtime_schemas/json/") for name in names):
        yield "The JSON Schemas are missing."
    yield from metadata_faults(metadata, version, url)


def metadata_faults(metadata: email.message.Message, version: str, url: str) -> Iterator[str]:
    """Say what is wrong with the metadata of a distribution."""
    if metadata["Version"] != version:
        yield f"It is of version {metadata['Version']} instead of {version}."
    stated = dict(str(one).split(", ", 1) for one in metadata.get_all("Project-URL", []))
    if missing := sorted(set(PAGES) - set(stated)):
        yield f"Project URLs are missing: {', '.join(missing)}."
    if any(not address.startswith(url) for address in stated.values()):
        yield "A project URL leads elsewhere."
    readme = str(metadata.get_payload())
    relative = [m[3] for m in LINK.finditer(readme) if not re.match(r"[a-z+.-]+:|#", m[3])]
    if not readme.strip():
        yield "The description is empty."
    if relative:
        yield f"Links of the README are relative: {', '.join(relative[:5])}."
    for header in ("License-Expression", "License-File", "Requires-Python", "Summary"):
        if not metadata.get(header):
            yield f"{header} is not stated."


def sdist_faults(sdist: Path) -> Iterator[str]:
    """Say what is missing from a source distribution."""
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for needed in ("pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"):
        if needed not in names:
            yield f"{needed} is missing from the source distribution."


def version_faults(version: str) -> Iterator[str]:
    """Say where another version is stated."""
    changelog = re.search(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.M)
    if changelog is None or changelog[1] != version:
        yield f"The first section of CHANGELOG.md is not {version}."
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    if citation is None or citation[1].strip("\"'") != version:
        yield f"CITATION.cff does not state version {version}."


def materials(wheel: Path, version: str) -> dict[str, Any]:
    """Return the bill of materials of a wheel in CycloneDX 1.5.

    Parameters
    ----------
    wheel
        The built wheel.
    version
        Its version.

    Returns
    -------
    dict
        The distribution, and every distribution of constraints.txt with the licence that its
        installed metadata states, where it is installed.
    """
    pinned = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().split() if line
    )
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application", "name": "slowtime", "version": version,
                "purl": f"pkg:pypi/slowtime@{version}",
                "licenses": [{"license": {"id": "Apache-2.0"}}],
                "hashes": [{"alg": "SHA-256", "content": digest}],
            }
        },
        "components": [
            {
                "type": "library", "name": name, "version": of,
                "purl": f"pkg:pypi/{name.lower().replace('_', '-')}@{of}",
                **licences(name),
            }
            for name, of in sorted(pinned.items())
        ],
    }  # fmt: skip


def licences(name: str) -> dict[str, Any]:
    """Return the licence of an installed distribution as CycloneDX states it; else nothing."""
    try:
        metadata = importlib.metadata.metadata(name)
    except importlib.metadata.PackageNotFoundError:
        return {}
    if "License-Expression" in metadata:
        return {"licenses": [{"expression": metadata["License-Expression"]}]}
    told = [
        one.rpartition(" :: ")[2]
        for one in metadata.get_all("Classifier") or []
        if one.startswith("License ::")
    ]
    return {"licenses": [{"license": {"name": one}} for one in told]} if told else {}


def main(arguments: list[str]) -> int:
    """Build and check; 1 where something must not be released."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", default="", help="address of the repository; dry run if none")
    given = parser.parse_args(arguments)
    url = given.url.rstrip("/") or PLACEHOLDER
    if not re.fullmatch(r"https://[\w.-]+/\S+", url):
        parser.error(f"{url!r} is no address of a repository. Give https://HOST/OWNER/NAME.")
    out = ROOT / ("dist" if given.url else "var/release/dist")
    try:
        version = copy(ROOT / "var/release/source", url)
        wheel, sdist = build(ROOT / "var/release/source", out)
    except ReleaseError as error:
        print(error, file=sys.stderr)
        return 1
    faults = [
        *version_faults(version), *wheel_faults(wheel, version, url), *sdist_faults(sdist)
    ]  # fmt: skip
    bill = out / f"slowtime-{version}.cdx.json"
    bill.write_text(json.dumps(materials(wheel, version), indent=1))
    for path in (wheel, sdist, bill):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        print(f"{digest}  {path.relative_to(ROOT)}  ({path.stat().st_size:,} bytes)")
    for fault in faults:
        print(f"fault: {fault}", file=sys.stderr)
    if not given.url:
        print("Dry run, not for publication. For a release: make release URL=https://...")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
