"""What docs/live.md says of schemes, layouts, counters and settings is so."""

import ast
import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from edge_agent.acquire.live import SCHEMES, importing
from edge_agent.acquire.live.table import counters, filled, main, schemes
from edge_agent.inputs import LAYOUT_WORDS, LIMIT_WORDS, LiveInput
from edge_agent.layouts import Layout, PackedLayout
from edge_agent.settings import EdgeSettings
from slowtime_schemas.codec import decode
from slowtime_schemas.streams import SAMPLES

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/live.md").read_text()
TOML = re.findall(r"```toml\n(.*?)```", TEXT, re.S)


def test_its_tables_are_those_of_the_registry():
    assert filled(TEXT) == TEXT


def test_its_tables_can_be_written_anew_and_printed(tmp_path, capsys):
    page = tmp_path / "live.md"
    page.write_text(
        re.sub(
            r"(<!-- (?:table|counters) -->\n).*?(<!-- end -->)", r"\1old\2", TEXT, flags=re.S
        )
    )
    assert page.read_text() != TEXT
    assert main(["--write", str(page)]) == 0
    assert page.read_text() == TEXT
    assert main([]) == 0
    printed = capsys.readouterr().out
    assert printed == f"{schemes()}\n\n{counters()}\n"


def test_every_link_leads_somewhere():
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", TEXT) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []


def test_every_word_of_a_url_is_in_the_table():
    said = set(
        re.findall(r"`(\w+)`", TEXT.partition("| in the URL |")[2].partition("**`json`")[0])
    )
    assert set(LAYOUT_WORDS) | set(LIMIT_WORDS) == said


def test_every_example_in_toml_is_a_setting_or_a_layout():
    settings = EdgeSettings.model_validate(tomllib.loads(TOML[0]))
    assert isinstance(settings.input, LiveInput)
    assert settings.input.scheme == "mqtts"
    layout = TypeAdapter(Layout).validate_python(tomllib.loads(TOML[1]))
    assert isinstance(layout, PackedLayout)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=lambda scheme: scheme.name)
def test_every_example_of_a_url_can_be_read(scheme, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frame.toml").write_text(TOML[1])
    live = LiveInput.of(scheme.example)
    assert live.scheme == scheme.name
    assert set(live.parameters) <= set(scheme.parameters)
    importing(scheme)


def test_every_command_names_a_source_that_can_be_read():
    lines = [
        line for line in TEXT.splitlines() if line.startswith("    ") and "--source" in line
    ]
    assert len(lines) >= 2
    for line in lines:
        words = shlex.split(line)
        assert LiveInput.of(words[words.index("--source") + 1]).scheme in SCHEMES


def test_every_setting_that_it_names_is_one():
    for name in ("reorder_s", "queue_samples", "silent_after_s", "rate_tolerance"):
        assert f"`{name}`" in TEXT
        assert name in LiveInput.model_fields


def test_the_example_publisher_sends_what_the_schema_says(monkeypatch):
    path = ROOT / "docs/examples/publish_samples.py"
    tree = ast.parse(path.read_text())
    assert sum(isinstance(node, ast.stmt) for node in tree.body) <= 20
    sent = []

    class Session:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            return False

        def put(self, key, payload):
            sent.append((key, payload))
            raise StopIteration

    monkeypatch.setattr("zenoh.open", lambda config: Session())
    with pytest.raises(StopIteration):
        exec(compile(tree, str(path), "exec"), {})
    ((key, payload),) = sent
    message = decode(SAMPLES, payload.encode())
    assert key == SAMPLES.key(message.site, message.asset)
    assert json.loads(payload)["rate_hz"] == 100.0
