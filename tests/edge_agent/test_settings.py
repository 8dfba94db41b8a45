"""A flag overrules the environment, which overrules the file; what cannot be says why."""

import json

import pytest
from pydantic import ValidationError

from edge_agent.settings import EdgeSettings, FileInput, Processing, SimulatedInput
from slowtime_schemas.messages import About
from slowtime_services.simulate import FatigueLoss, SimulatedStructure


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch):
    for name in ("CONFIG", "SITE", "ASSET", "EXTRACT__WINDOW_S", "CONNECT"):
        monkeypatch.delenv(f"SLOWTIME_EDGE_{name}", raising=False)


TOML = """
site = "harbour"
asset = "crane-7"
connect = ["tcp/10.0.0.2:7447"]

[input]
kind = "simulated"
every_s = 0.2
[input.structure]
frequency_hz = 2.5
stiffness = {kind = "fatigue", rate = 1e-3}

[extract]
band_hz = [1, 4]
window_s = 30
"""


def test_flags_before_environment_before_file(tmp_path, monkeypatch):
    path = tmp_path / "edge.toml"
    path.write_text(TOML)
    monkeypatch.setenv("SLOWTIME_EDGE_EXTRACT__WINDOW_S", "40")
    monkeypatch.setenv("SLOWTIME_EDGE_ASSET", "crane-8")
    settings = EdgeSettings(config=path, asset="crane-9")
    assert (settings.site, settings.asset) == ("harbour", "crane-9")
    assert settings.extract.window_s == 40.0
    assert settings.extract.band_hz == (1.0, 4.0)
    assert settings.connect == ("tcp/10.0.0.2:7447",)
    assert isinstance(settings.input, SimulatedInput)
    assert isinstance(settings.input.structure, SimulatedStructure)
    assert settings.input.structure.stiffness == FatigueLoss(rate=1e-3)
    assert settings.input.structure.rate_hz == 100.0


def test_the_file_may_be_named_by_the_environment_and_be_json(tmp_path, monkeypatch):
    path = tmp_path / "edge.json"
    path.write_text(json.dumps({"asset": "mast", "input": {"kind": "file", "path": "a.csv"}}))
    monkeypatch.setenv("SLOWTIME_EDGE_CONFIG", str(path))
    settings = EdgeSettings()
    assert settings.asset == "mast"
    assert isinstance(settings.input, FileInput)


def test_settings_cannot_be_changed_once_they_are_made():
    settings = EdgeSettings()
    with pytest.raises(ValidationError, match="frozen"):
        settings.site = "elsewhere"  # type: ignore[misc]


def test_what_decides_the_features_survives_the_way_through_about():
    settings = EdgeSettings(extract={"band_hz": (1, 4)}, condition={"lowpass_hz": 20})
    about = About(
        site="a",
        asset="b",
        boot="c",
        sequence=0,
        t_ns=0,
        software="slowtime 0",
        settings={"processing": settings.processing.model_dump(mode="json")},
    )
    again = About.model_validate_json(about.model_dump_json())
    assert Processing.from_about(again) == settings.processing


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sight = 'x'", "Extra inputs are not permitted"),
        ("site = 'Big Site'", "String should match pattern"),
        ("[extract]\nmedian_window = 4", "has no middle"),
        ("[input]\nkind = 'telepathy'", "does not match any of the expected tags"),
        ("[condition]\nmax_gap_s = nan", "finite|greater than or equal"),
    ],
)
def test_a_file_that_says_something_else_is_refused_with_the_reason(tmp_path, text, says):
    path = tmp_path / "edge.toml"
    path.write_text(text)
    with pytest.raises(ValidationError, match=says):
        EdgeSettings(config=path)


def test_a_file_that_is_not_there_or_of_another_kind_is_named(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"no settings file .*Give an existing --config"
    ):
        EdgeSettings(config=tmp_path / "none.toml")
    (tmp_path / "edge.yaml").write_text("a: 1")
    with pytest.raises(
        ValueError, match=r"edge\.yaml is not a valid settings file. Allowed: \.toml and"
    ):
        EdgeSettings(config=tmp_path / "edge.yaml")


@pytest.mark.parametrize(
    "given",
    [
        {"input": {"kind": "file", "path": "a.csv", "columns": ["t", "x\u202e"]}},
        {"extract": {"covariates": {"temperature_c\x1b": "t"}}},
    ],
)
def test_names_with_characters_that_are_not_seen_are_refused(given):
    with pytest.raises(ValidationError, match=r"has U\+\w{4}"):
        EdgeSettings(**given)
