"""Settings: flags before environment before file, and nothing misspelt goes unnoticed."""

import pytest
from pydantic import ValidationError

from twin_server.settings import TwinSettings


def test_flags_overrule_the_environment_which_overrules_the_file(tmp_path, monkeypatch):
    file = tmp_path / "twin.toml"
    file.write_text('port = 1\nhost = "a"\n[healing]\ntries = 7\ngrace_s = 1.5\n')
    monkeypatch.setenv("SLOWTIME_TWIN_HOST", "b")
    monkeypatch.setenv("SLOWTIME_TWIN_HEALING__TRIES", "9")
    monkeypatch.setenv("SLOWTIME_TWIN_CONFIG", str(file))
    found = TwinSettings(port=3)
    assert (found.port, found.host) == (3, "b")
    assert (found.healing.tries, found.healing.grace_s) == (9, 1.5)
    assert found.healing.backoff_s == TwinSettings.model_fields["healing"].default.backoff_s


def test_json_will_do(tmp_path):
    (tmp_path / "twin.json").write_text('{"default_registration": {"changes": "mass"}}')
    assert TwinSettings(config=tmp_path / "twin.json").default_registration.changes == "mass"


@pytest.mark.parametrize(
    "wrong", [{"prot": 1}, {"port": 70_000}, {"healing": {"trys": 1}}, {"synchronous": "OFF"}]
)
def test_what_is_misspelt_or_out_of_range_is_refused(wrong):
    with pytest.raises(ValidationError):
        TwinSettings(**wrong)


def test_settings_stay_as_they_are():
    with pytest.raises(ValidationError, match="frozen"):
        setattr(TwinSettings(), "port", 1)  # noqa: B010


@pytest.mark.parametrize(
    ("name", "error", "says"),
    [
        ("none.toml", FileNotFoundError, "no settings file"),
        ("x.ini", ValueError, "Allowed: .toml"),
    ],
)
def test_a_settings_file_that_cannot_be_is_refused(tmp_path, name, error, says):
    (tmp_path / "x.ini").write_text("")
    with pytest.raises(error, match=says):
        TwinSettings(config=tmp_path / name)
