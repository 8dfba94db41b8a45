"""The compose files: what each container may do, take and know."""

import re
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from slowtime_cli.shared.options import Size

ROOT = Path(__file__).parents[2]
FILES = ("docker-compose.yml", "docker-compose.postgres.yml")
PASSWORDS = ROOT / "services/docker/passwords.py"
SECRET = re.compile(r"PASS|SECRET|TOKEN|PRIVATE|CREDENTIAL", re.IGNORECASE)


def services() -> dict[str, dict[str, Any]]:
    """Services of both files, the second laid over the first as far as is asked here."""
    merged: dict[str, dict[str, Any]] = {}
    for file in FILES:
        for name, told in yaml.safe_load((ROOT / file).read_text())["services"].items():
            before = merged.get(name, {})
            both = {
                "volumes": [*before.get("volumes", []), *told.get("volumes", [])],
                "environment": before.get("environment", {}) | told.get("environment", {}),
            }
            merged[name] = before | told | both
    return merged


SERVICES = services()


@pytest.mark.parametrize("name", SERVICES)
def test_no_container_has_capabilities_or_writes_into_its_image(name):
    service = SERVICES[name]
    assert service["cap_drop"] == ["ALL"]
    assert service["read_only"] is True
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not {"cap_add", "privileged", "devices", "pid", "ipc", "userns_mode"} & {*service}
    assert "network_mode" not in service
    assert str(service.get("user", "")).partition(":")[0] not in ("root", "0")
    for volume in service["volumes"]:
        assert "docker.sock" not in volume
        if volume.startswith((".", "/")):
            assert volume.endswith(":ro"), f"{name} may write to {volume} of the machine"


@pytest.mark.parametrize("name", SERVICES)
def test_what_each_container_takes_is_bounded(name):
    service = SERVICES[name]
    assert 0 < Size().convert(f"{service['mem_limit']}b", None, None) <= 4 * 10**9
    assert 0 < service["pids_limit"] <= 512
    assert service["logging"]["options"].keys() >= {"max-size", "max-file"}
    assert all("size=" in mount for mount in service["tmpfs"])


def test_no_password_stands_in_a_file():
    for name, service in SERVICES.items():
        for variable, value in service["environment"].items():
            if SECRET.search(variable):
                from_file = str(value).startswith("/passwords/")
                from_outside = re.fullmatch(r"\$\{\w+:-\}", str(value))
                assert from_file or from_outside, f"{name}: {variable}={value}"
        for word in map(str, service.get("command", [])):
            assert not re.search(r"://[^/@\s]+:[^/@\s]+@", word), f"{name}: {word}"


def test_a_password_is_seen_by_who_makes_it_and_one_other():
    for volume in ("passwords-grafana", "passwords-postgres", "passwords-twin"):
        mounts = {
            name: mounted.endswith(":ro")
            for name, service in SERVICES.items()
            for mounted in service["volumes"]
            if mounted.startswith(f"{volume}:")
        }
        assert mounts == {"passwords": False, volume.removeprefix("passwords-"): True}


def test_recordings_and_metrics_are_bounded_on_the_disk():
    assert any(word.startswith("--keep=") for word in SERVICES["recorder"]["command"])
    metrics = SERVICES["prometheus"]["command"]
    assert any("retention.size=" in word for word in metrics)


def make(folder: Path, **environment: str) -> str:
    for whose in ("grafana", "postgres", "twin"):
        (folder / whose).mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, str(PASSWORDS), str(folder)],
        capture_output=True, text=True, check=True, env=environment, umask=0o077,
    )  # fmt: skip
    return done.stdout


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_passwords_are_made_once_and_are_not_said(tmp_path):
    said = make(tmp_path)
    files = [tmp_path / name for name in ("grafana/password", "postgres/password")]
    made = [path.read_text() for path in files]
    assert len({*made}) == 2
    assert all(len(word) >= 32 for word in made)
    assert not any(word in said for word in made)
    assert all(f"/passwords/{path.relative_to(tmp_path)}" in said for path in files)
    assert [mode(path) for path in files] == [0o444, 0o444]
    pgpass = tmp_path / "twin/pgpass"
    assert pgpass.read_text() == f"postgres:5432:slowtime:slowtime:{made[1]}\n"
    assert mode(pgpass) == 0o600  # libpq looks at no other
    make(tmp_path)
    assert [path.read_text() for path in files] == made
    assert not list(tmp_path.rglob("*.new"))


def test_a_password_that_is_given_is_taken_and_stays(tmp_path):
    make(tmp_path)
    make(tmp_path, SLOWTIME_DATABASE_PASSWORD=r"a:b\c", SLOWTIME_GRAFANA_PASSWORD="d")
    make(tmp_path)
    assert (tmp_path / "postgres/password").read_text() == r"a:b\c"
    assert (tmp_path / "grafana/password").read_text() == "d"
    assert (tmp_path / "twin/pgpass").read_text().endswith(r":a\:b\\c" + "\n")
