"""Manifests of Kubernetes and the cluster of Compose: by schema, and by the command."""

import re
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from slowtime_cli.__main__ import app
from slowtime_cli.shared.verb_groups import VerbGroup

FOLDER = Path(__file__).parents[2] / "services/kubernetes"
VERSION = "1.37"
OF_OPERATORS = {"postgres.yaml", "ray.yaml"}
"""Files with resources whose schema is an operator's own."""


def manifests(*, of_operators: bool = False) -> list[tuple[str, dict[str, Any]]]:
    """All manifests with the names of their files."""
    return [
        (path.name, one)
        for path in sorted(FOLDER.glob("*.yaml"))
        if of_operators or path.name not in OF_OPERATORS
        for one in yaml.safe_load_all(path.read_text())
    ]


def containers() -> list[dict[str, Any]]:
    """All containers of the manifests."""
    templates = [
        one["spec"]["template"] for _, one in manifests() if "template" in one.get("spec", {})
    ]
    return [container for t in templates for container in t["spec"]["containers"]]


@pytest.mark.parametrize(
    ("name", "manifest"),
    manifests(),
    ids=lambda part: part if isinstance(part, str) else part["kind"],
)
def test_a_manifest_is_valid_by_the_schema_of_kubernetes(name, manifest):
    validating = pytest.importorskip("kubernetes_validate", reason="not in this environment")
    validating.validate(manifest, VERSION, strict=True)


def test_a_manifest_with_a_misspelt_field_would_not_be():
    validating = pytest.importorskip("kubernetes_validate", reason="not in this environment")
    (_, manifest) = next(m for m in manifests() if m[1]["kind"] == "Deployment")
    manifest["spec"]["replica"] = 1
    with pytest.raises(validating.ValidationError):
        validating.validate(manifest, VERSION, strict=True)


@pytest.mark.parametrize("container", containers(), ids=lambda one: one["name"])
def test_a_container_runs_a_command_that_there_is_with_options_that_it_has(container):
    verb, *arguments = container["args"]
    command: Any = app.get_command(click.Context(app), verb)
    if isinstance(command, click.Group):
        context, name = click.Context(command), arguments[0]
        if isinstance(command, VerbGroup) and name not in command.verbs:
            name = command.default
        command = command.get_command(context, name)
    known = {option for one in command.params for option in one.opts}
    given = {one.partition("=")[0] for one in arguments if one.startswith("--")}
    assert given <= known


@pytest.mark.parametrize("container", containers(), ids=lambda one: one["name"])
def test_a_container_is_bounded_and_has_no_rights(container):
    context = container["securityContext"]
    assert context["capabilities"] == {"drop": ["ALL"]}
    assert context["readOnlyRootFilesystem"]
    assert not context["allowPrivilegeEscalation"]
    assert "memory" in container["resources"]["limits"]


def test_services_and_claims_that_are_named_are_there():
    every = manifests(of_operators=True)
    names = {(one["kind"], one["metadata"]["name"]) for _, one in every}
    text = "".join(path.read_text() for path in FOLDER.glob("*.yaml"))
    for claim in re.findall(r"claimName: (\w+)", text):
        assert ("PersistentVolumeClaim", claim) in names
    for service in re.findall(r"router-\d\.(\w+)\.slowtime\.svc", text):
        assert ("Service", service) in names
    assert ("Cluster", "database") in names
    assert all(one["metadata"].get("namespace", "slowtime") == "slowtime" for _, one in every)


def test_workers_of_ray_find_what_the_twin_server_is_given_at_the_same_paths():
    every = {(o["kind"], o["metadata"]["name"]): o for _, o in manifests(of_operators=True)}
    front = every["Deployment", "twin"]["spec"]["template"]["spec"]["containers"][0]
    (group,) = every["RayCluster", "shards"]["spec"]["workerGroupSpecs"]
    worker = group["template"]["spec"]["containers"][0]
    mounts = [{one["mountPath"]: one for one in c["volumeMounts"]} for c in (front, worker)]
    assert mounts[0] == mounts[1]
    assert front["env"] == worker["env"]
    assert front["image"] == worker["image"]


def cluster() -> dict[str, list[str]]:
    """Commands of the containers of `docker-compose.cluster.yml`."""
    text = (FOLDER.parents[1] / "docker-compose.cluster.yml").read_text()
    services = yaml.safe_load(text.replace("!override ", ""))["services"]
    return {name: one["command"] for name, one in services.items()}


@pytest.mark.parametrize("name", cluster())
def test_a_container_of_the_cluster_runs_a_command_with_options_that_it_has(name):
    test_a_container_runs_a_command_that_there_is_with_options_that_it_has(
        {"args": cluster()[name]}
    )


def test_whoever_connects_in_the_cluster_knows_both_routers():
    clients = {name: args for name, args in cluster().items() if "router" not in name}
    del clients["keys"]
    assert len(clients) == 5
    for arguments in clients.values():
        assert {"--connect=tls/router:7447", "--connect=tls/router-2:7447"} <= set(arguments)
