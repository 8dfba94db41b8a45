"""Graphs through other parsers than ours: Microsoft's DTDLParser, and a processor of JSON-LD.

DTDLParser runs under Node, as the npm package @digicatapult/dtdl-parser carries it. Where it
is, is said by SLOWTIME_DTDL_PARSER:

    npm install --prefix /tmp/dtdl @digicatapult/dtdl-parser
    SLOWTIME_DTDL_PARSER=/tmp/dtdl pytest -m long -k dtdlparser tests/twin_server/serve/exports
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from twin_server.composites.composite import Composite
from twin_server.registration.twin import MODEL_EXAMPLE, Registration
from twin_server.serve.composites import composites_of
from twin_server.serve.exports import Asset, as_json_ld, as_version_2, graph

PARSER = Path(os.environ.get("SLOWTIME_DTDL_PARSER", "/nowhere"))
MODULE = PARSER / "node_modules/@digicatapult/dtdl-parser/build/index.js"
SCRIPT = """
const { getInterop } = await import(process.argv[1]);
const parser = await getInterop();
let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(parser.parse(text));
"""
TWINS = {
    "lab.beam": Registration(),
    "lab.2nd": Registration(changes="mass"),
    "lab.both-1": Registration(changes="both"),
    "lab.frame": Registration.model_validate(MODEL_EXAMPLE),
}
YARD = Composite(
    members=tuple(TWINS),
    tree={"series": ["lab.frame", {"k": 2, "of": ["lab.beam", "lab.2nd", "lab.both-1"]}]},
    dependence=[{"members": ["lab.beam", "lab.2nd"], "rho": 0.3}],
)


@pytest.fixture(scope="module")
def whole():
    assets = [Asset(i, r, {"valid": False, "reasons": ["No."]}) for i, r in TWINS.items()]
    return graph(assets, {"lab.yard": YARD})


def parsed(models):
    """Object model that DTDLParser makes of some interfaces."""
    if shutil.which("node") is None or not MODULE.exists():
        pytest.skip(f"{MODULE} is not there; see above")
    command = ["node", "--input-type=module", "-e", SCRIPT, str(MODULE)]
    done = subprocess.run(
        command, input=json.dumps(models), capture_output=True, text=True, timeout=120
    )
    if done.returncode:
        raise ValueError(done.stderr)
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.parametrize("older", [False, True])
def test_dtdlparser_reads_what_was_written(whole, older):
    models = (as_version_2(whole) if older else whole)["digitalTwinsModels"]
    found = parsed(models)
    for model in models:
        theirs = found[model["@id"]]
        assert theirs["EntityKind"] == "Interface"
        assert theirs["languageMajorVersion"] == (2 if older else 3)
        inherited = {} if "extends" not in model else found[model["extends"]]["contents"]
        own = {name: i for name, i in theirs["contents"].items() if name not in inherited}
        assert set(own) == {content["name"] for content in model["contents"]}
        for content in model["contents"]:
            one = found[own[content["name"]]]
            kind = (
                content["@type"] if isinstance(content["@type"], str) else content["@type"][0]
            )
            assert one["EntityKind"] == kind
            if "unit" in content:
                assert one["SupplementalTypes"][0].endswith(
                    "class:Frequency" if not older else "Frequency;2"
                )
                assert any(
                    "hertz" in str(unit) for unit in one["SupplementalProperties"].values()
                )


@pytest.mark.long
def test_dtdlparser_refuses_a_wrong_unit(whole):
    broken = json.loads(json.dumps(whole["digitalTwinsModels"]))
    for content in broken[1]["contents"]:
        if "unit" in content:
            content["unit"] = "newton"
    with pytest.raises(ValueError, match="FrequencyUnit"):
        parsed(broken)


def test_json_ld_becomes_the_same_links_in_a_processor_of_json_ld(whole):
    jsonld = pytest.importorskip("pyld").jsonld
    quads = jsonld.to_rdf(as_json_ld(whole), {"format": "application/n-quads"}).splitlines()
    members = {line.split()[2] for line in quads if "term:has_member>" in line}
    assert members == {f"<urn:slowtime:twin:{name}>" for name in TWINS}
    flat = jsonld.flatten(as_json_ld(whole))
    found = composites_of(json.dumps({"@graph": flat}), list(TWINS))
    assert found.composites["lab.yard"].members == tuple(TWINS)
