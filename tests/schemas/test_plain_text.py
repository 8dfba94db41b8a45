"""Names: every script of the world, and nothing that is not seen."""

import pytest

from slowtime_schemas.plain_text import BIDIRECTIONAL, plain_text, plain_throughout


@pytest.mark.parametrize(
    "name", ["", "Brücke 7", "الجسر", "می‌خواهم", "橋", "m1.mass", "²³", "🏗"]
)
def test_names_of_every_script_are_taken_as_they_are(name):
    assert plain_text(name) == name


@pytest.mark.parametrize(
    "character",
    [*sorted(BIDIRECTIONAL), *"\x00\t\n\x1b\x7f\x9b\u200b\u2028\ufeff\ud800\U000e0041"],
)
def test_a_character_that_is_not_seen_is_named(character):
    with pytest.raises(
        ValueError, match=rf"has U\+{ord(character):04X}.*at position 6\. Remove it"
    ) as refused:
        plain_text(f"tower{character}7")
    assert character not in str(refused.value)


def test_keys_and_texts_are_looked_through_however_deep():
    assert plain_throughout({"a": [{"b": ("c", 1.0, None)}]}) == {
        "a": [{"b": ("c", 1.0, None)}]
    }
    for value in ({"a": [{"b": "\u202e"}]}, {"a": [{"\u202e": "b"}]}, ("\u202e",)):
        with pytest.raises(ValueError, match="RIGHT-TO-LEFT OVERRIDE"):
            plain_throughout(value)
