"""Python and the command line take options from one declaration."""

import dataclasses
import inspect
import itertools
from typing import Literal, get_type_hints

import click
import pytest
from click.testing import CliRunner

import slowtime as st
from slowtime.identification.options import IdentifyOptions
from slowtime_cli.shared.declared import gathered, options_of
from slowtime_cli.verbs.records.identify import identify
from slowtime_services.argument_checks import parameter_entries
from slowtime_services.declared import takes
from slowtime_services.files import ReadingOptions


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoundOptions:
    """How to sound.

    Parameters
    ----------
    level
        How loud [dB].
    voice
        Which voice: ``"low"`` or ``"high"``.
    """

    level: float | None = None
    voice: Literal["low", "high"] = "low"


@takes(SoundOptions)
def sound(text: str, options: SoundOptions) -> str:
    """Sound.

    Parameters
    ----------
    text
        What to say.

    Returns
    -------
    What was said.
    """
    return f"{text} {options.voice} {options.level}"


def test_a_field_is_a_keyword_with_its_default_and_description():
    assert sound("a", voice="high") == "a high None"
    assert sound(text="a", level=2.0) == "a low 2.0"  # type: ignore[call-arg]
    assert list(inspect.signature(sound).parameters) == ["text", "level", "voice"]
    assert parameter_entries(sound) == {
        "text": "What to say.", "level": "How loud [dB].",
        "voice": 'Which voice: "low" or "high".',
    }  # fmt: skip
    with pytest.raises(ValueError, match=r"voice='loud' was given\. Allowed: low, high"):
        sound("a", voice="loud")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="pitch"):
        sound("a", pitch=1.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"too many positional arguments\. Its arguments: text"):
        sound("a", 2.0)  # type: ignore[call-arg]


def test_a_class_that_extends_another_has_its_fields_and_their_descriptions():
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class ChoirOptions(SoundOptions):
        """How many to sound.

        Parameters
        ----------
        voices
            How many voices.
        """

        voices: int = 1

    assert list(parameter_entries(ChoirOptions)) == ["level", "voice", "voices"]


def test_a_field_is_an_option_with_its_default_and_help():
    @click.command()
    @options_of(SoundOptions)
    def verb(**flags):
        click.echo(gathered(SoundOptions, flags))
        assert not flags

    told = CliRunner().invoke(verb, ["--voice", "high", "--level", "3"]).output
    assert told == "SoundOptions(level=3.0, voice='high')\n"
    shown = CliRunner().invoke(verb, ["--help"]).output
    assert "How loud [dB]." in shown
    assert "[default: low]" in shown


def test_a_type_without_an_option_is_refused_when_it_is_declared():
    @dataclasses.dataclass
    class Odd:
        """Odd.

        Parameters
        ----------
        when
            At which complex time.
        """

        when: complex = 0j

    with pytest.raises(TypeError, match="when: there is no option of type"):
        options_of(Odd)


@pytest.mark.parametrize(
    ("options", "function"), [(IdentifyOptions, st.identify), (ReadingOptions, st.read)]
)
def test_every_option_is_described_once_and_said_everywhere(options, function):
    declared = parameter_entries(options)
    assert set(declared) == set(get_type_hints(options))
    python = parameter_entries(function)
    keys = (getattr(option, "settings", {}).values() for option in identify.params)
    helps = {
        option.name: getattr(option, "help", "")
        for option in itertools.chain(identify.params, *keys)
    }
    for name, text in declared.items():
        assert python[name] == text
        assert helps[name] == text
