import click
import pytest

from slowtime_cli.shared.options import (
    POSITIVE,
    Endpoint,
    Instant,
    Name,
    Names,
    OutFile,
    Real,
    Size,
)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "0", "-1", "x", "1e999"])
def test_only_a_positive_number_is_one(value):
    with pytest.raises(click.BadParameter, match=r"not a finite number|not in the range|valid"):
        POSITIVE.convert(value, None, None)
    assert POSITIVE.convert("1e-3", None, None) == 1e-3
    assert Real(min=0).convert("0", None, None) == 0.0


@pytest.mark.parametrize("value", ["", "A", "a b", "a/b", "*", "a.b", "-a", "a" * 64, "ä"])
def test_a_name_that_could_be_no_part_of_a_key_is_refused(value):
    with pytest.raises(click.BadParameter, match="at most 63 lower-case letters"):
        Name().convert(value, None, None)
    assert Name().convert("tower-1", None, None) == "tower-1"


def test_site_and_asset_are_named_together_and_either_may_be_any():
    assert Name(parts=2).convert("demo.tower", None, None) == "demo.tower"
    assert Name(parts=2, any_=True).convert("*.tower", None, None) == "*.tower"
    for value in ("tower", "*.tower", "a.b.c"):
        with pytest.raises(click.BadParameter, match=r"Allowed: SITE\.ASSET"):
            Name(parts=2).convert(value, None, None)


@pytest.mark.parametrize("value", ["nonsense", "127.0.0.1:7447", "tcp/", "TCP/a:1", "tcp/a b"])
def test_what_is_no_endpoint_is_refused_before_it_is_opened(value):
    with pytest.raises(click.BadParameter, match=r"such as tcp/127\.0\.0\.1:7447"):
        Endpoint().convert(value, None, None)
    for good in ("tcp/router:7447", "tls/[::1]:7447", "unixsock-stream/tmp/a.sock"):
        assert Endpoint().convert(good, None, None) == good


@pytest.mark.parametrize(
    "value",
    [
        "2022-07-19T22:55:00.25Z",
        "2022-07-19T22:55:00.250",
        "2022-07-19 22:55:00.25",
        "2022-07-20T00:55:00.25+02:00",
    ],
)
def test_an_instant_is_utc_unless_it_says_otherwise(value):
    assert Instant().convert(value, None, None) == 1_658_271_300_250_000_000


@pytest.mark.parametrize("value", ["yesterday", "1969-12-31", "2300-01-01", "1658271300"])
def test_an_instant_outside_the_clock_is_refused(value):
    with pytest.raises(
        click.BadParameter, match=r"is not a valid time|between the years 1970 and 2262"
    ):
        Instant().convert(value, None, None)


def test_a_file_to_write_must_have_its_folder_and_its_kind_before_the_work(tmp_path):
    out = OutFile(".mcap")
    assert out.convert(str(tmp_path / "a.mcap"), None, None) == tmp_path / "a.mcap"
    with pytest.raises(click.BadParameter, match=r"'a\.txt' does not end in \.mcap"):
        out.convert(str(tmp_path / "a.txt"), None, None)
    with pytest.raises(click.BadParameter, match=r"no folder .*missing.*Create it first"):
        out.convert(str(tmp_path / "missing/a.mcap"), None, None)
    with pytest.raises(click.BadParameter, match="is a directory"):
        out.convert(str(tmp_path), None, None)
    with pytest.raises(click.BadParameter, match=r"does not end in"):
        out.convert("-", None, None)
    assert str(OutFile(stdout=True).convert("-", None, None)) == "-"


@pytest.mark.parametrize("text", ["", ",", "a,", "a,,b"])
def test_an_empty_name_is_refused(text):
    with pytest.raises(click.BadParameter, match="has an empty name"):
        Names().convert(text, None, None)
    assert Names().convert("acc_x, acc_y", None, None) == ("acc_x", "acc_y")


@pytest.mark.parametrize(
    ("text", "size"),
    [("4GB", 4 * 10**9), ("1.5 GiB", 3 * 2**29), ("500mb", 500 * 10**6), ("4096", 4096)],
)
def test_a_size_is_in_bytes_whatever_its_unit(text, size):
    assert Size().convert(text, None, None) == size


@pytest.mark.parametrize("text", ["", "GB", "4 parsecs", "-1MB", "0", "0.0GB", "1e9", "nan"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(
        click.BadParameter, match=r"is not a valid size\. Give one such as 500MB"
    ):
        Size().convert(text, None, None)


@pytest.mark.parametrize("character", ["\u202e", "\x1b", "\n"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("tokens", "add", "ann{}", "--scope", "viewer", "--site", "lab"),
        ("tokens", "add", "ann", "--scope", "viewer", "--site", "lab{}"),
        ("keys", "make", "lab", "--asset", "beam{}"),
        ("edge", "--site", "lab", "--asset", "beam{}"),
        ("import", "record.csv", "out.mcap", "--asset", "beam{}"),
    ],
)
def test_a_name_with_a_character_that_is_not_seen_is_refused_by_its_code(
    refused, record, arguments, character
):
    said = refused(*(text.format(character) for text in arguments))
    assert f"U+{ord(character):04X}" in said
    assert character not in said.replace("\n", "") or character == "\n"


def test_settings_say_which_character_of_a_name_is_not_allowed(refused, tmp_path):
    (tmp_path / "edge.json").write_text('{"site": "lab", "asset": "beam\\u202e"}')
    assert "U+202E RIGHT-TO-LEFT OVERRIDE" in refused("edge", "--config", "edge.json")
