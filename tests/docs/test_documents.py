"""Documents from outside are read by one reader for each language, which has bounds."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "edge_agent", "schemas/slowtime_schemas", "services/slowtime_services", "slowtime",
    "slowtime_api", "slowtime_cli", "twin_server",
)  # fmt: skip
DOCUMENTS = "services/slowtime_services/documents/"
OWN = {
    "schemas/slowtime_schemas/asyncapi.py": "schemas of the package",
    "schemas/slowtime_schemas/frozen.py": "schemas of the package",
    "services/slowtime_services/record/channels.py": "schemas of the package",
    "twin_server/serve/routes/page.py": "messages of the package",
    "services/slowtime_services/credentials/authority.py": "written by the authority",
    "services/slowtime_services/credentials/credential_folder.py": "written by the authority",
    "services/slowtime_services/files/binary/reader_process.py": "of an own process",
    "twin_server/diagnose/jobs.py": "of an own process",
    "twin_server/diagnose/plugin_effects.py": "of an own process",
    "services/slowtime_services/reports/page.py": "a figure of Plotly",
    "edge_agent/publish/spool.py": "written by the spool itself",
    "slowtime_api/twins.py": "an answer of the own pipeline",
    "slowtime_cli/twins/evolve.py": "an answer of the own pipeline",
    "slowtime_cli/twins/whatif.py": "an answer of the own pipeline",
    "slowtime_cli/operation/doctor/surroundings.py": "10,000 bytes of a health check",
    "twin_server/history/rendering.py": "a row of the database",
    "twin_server/notify/message.py": "a row of the database",
    "twin_server/persist/ledger_audit/signed_heads.py": "a row of the database",
    "twin_server/estimate/checkpoint.py": "a row of the database",
    "twin_server/events/deliveries.py": "a row of the database",
}
"""Modules that may parse JSON without bounds, and whose it is."""

OWN_FOLDERS = {"twin_server/pipeline/": "rows of the database"}


def _calls(names: set[str]) -> Iterator[tuple[str, int]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and ast.unparse(node.func) in names:
                    yield str(path.relative_to(ROOT)), node.lineno


def test_json_from_outside_is_read_within_bounds():
    found = [
        f"{path}, line {line}"
        for path, line in _calls({"json.loads", "json.load"})
        if path not in OWN and not path.startswith((DOCUMENTS, *OWN_FOLDERS))
    ]
    assert not found, f"read JSON by slowtime_services.documents: {found}"


def test_no_module_is_excused_that_needs_no_excuse():
    parsing = {path for path, _ in _calls({"json.loads", "json.load"})}
    assert set(OWN) <= parsing


def test_formulas_are_parsed_in_one_place():
    allowed = {f"{DOCUMENTS}formulas.py"}
    assert {path for path, _ in _calls({"ast.parse", "ast.literal_eval"})} <= allowed


@pytest.mark.parametrize("call", ["eval", "exec"])
def test_nothing_that_is_given_is_run_as_code(call):
    assert not [path for path, _ in _calls({call})]
