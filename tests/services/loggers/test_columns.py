"""Names, units and values of columns: none is shifted, scaled or mixed in silence."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record

GRAVITY = 9.80665
ROWS = 800
TIME = np.arange(ROWS) / 100.0
A, B, C = (
    np.round(np.sin((5 + 4 * k) * TIME) + 0.2 * np.random.default_rng(k).normal(size=ROWS), 4)
    for k in range(3)
)


@pytest.fixture
def read(tmp_path):
    """Record of a heading and columns."""

    def reading(heading, columns, sep=",", **given):
        rows = (sep.join(map(str, row)) for row in zip(*columns, strict=True))
        path = tmp_path / "file.csv"
        path.write_text("\n".join([heading, *rows, ""]))
        return read_record(path, **{"skip_missing": True, **given})

    return reading


def dated(second):
    return f"2024-05-01 10:00:{second:06.3f}"


@pytest.mark.parametrize(
    ("heading", "names", "factors"),
    [
        ("Time,Roof (g, 50 Hz low pass),Base", ("Roof", "Base"), (GRAVITY, 1)),
        (
            "Time,Roof (g, raw),Roof (g, 9 Hz)",
            ("Roof (g, raw)", "Roof (g, 9 Hz)"),
            (GRAVITY,) * 2,
        ),
        ("Time [s, GPS],Roof [g],Base [mg]", ("Roof", "Base"), (GRAVITY, GRAVITY / 1000)),
        ("Time,Roof (left, above),Base", ("Roof (left, above)", "Base"), (1, 1)),
    ],
)
def test_a_delimiter_in_brackets_parts_no_names(read, heading, names, factors):
    record = read(heading, (TIME, A, B))
    assert record.channels == names
    np.testing.assert_allclose(record.samples, np.column_stack([A, B]) * factors)


def test_a_time_zone_in_brackets_is_part_of_the_name_of_the_clock(read):
    record = read("Timestamp (local, GMT-5),ax,ay", (map(dated, TIME), A, B))
    assert record.channels == ("ax", "ay")


def test_where_one_name_is_lacking_a_time_stays_the_name_of_the_first_column(read):
    record = read("time,ax,ay", (TIME, A, B, C))
    assert record.channels == ("ax", "ay", "channel_3")
    np.testing.assert_array_equal(record.channel("ax"), A)
    assert any("3 names for 4 columns" in note for note in record.notes)


def test_decimals_of_a_stamp_behind_a_comma_shift_no_names(read):
    stamps = [dated(second)[:-4] for second in TIME]
    decimals = [dated(second)[-3:] for second in TIME]
    record = read("time,ax,ay", (stamps, decimals, A, B))
    assert record.channels == ("ax", "ay")
    np.testing.assert_array_equal(record.samples, np.column_stack([A, B]))


def test_where_one_name_is_lacking_and_no_column_runs_the_last_has_none(read):
    record = read("Sample rate: 100 Hz\nax,ay", (A, B, C))
    assert record.channels == ("ax", "ay", "channel_2")
    np.testing.assert_array_equal(record.channel("ay"), B)


@pytest.mark.parametrize(
    ("heading", "first"),
    [("time,ax,ay", (range(1, ROWS + 1), TIME)), ("ax,ay", (TIME,)), ("ax,ay", (range(ROWS),))],
)
def test_a_row_number_or_a_time_in_front_may_have_no_name(read, heading, first):
    record = read(heading, (*first, A, B), rate_hz=100.0)
    assert record.channels == ("ax", "ay")
    np.testing.assert_array_equal(record.samples, np.column_stack([A, B]))


KEYED = "Channel name;Roof;Mid;Base\nUnit;g;g;g\nSensitivity [mV/g];98;99;101"


@pytest.mark.parametrize("clock", [(), (TIME,)])
def test_keys_before_settings_of_each_channel_are_no_names(read, clock):
    given = {} if clock else {"rate_hz": 100.0}
    record = read(KEYED, (*clock, A, B, C), ";", **given)
    assert record.channels == ("Roof", "Mid", "Base")
    assert record.units == ("m/s^2",) * 3
    np.testing.assert_allclose(record.samples[:, 2], C * GRAVITY)


def test_a_key_of_units_alone_tells_that_names_have_one_too(read):
    record = read("Thing;Roof;Mid;Base\nUnit;g;g;g", (A, B, C), ";", rate_hz=100.0)
    assert record.channels == ("Roof", "Mid", "Base")
    assert record.units == ("m/s^2",) * 3


@pytest.mark.parametrize(
    ("heading", "names"),
    [
        ("Name;Roof X;Roof Y;Base X", ("Roof X", "Roof Y", "Base X")),
        ("ax;ay;az;remark", ("ax", "ay", "az")),
        ("Thing;Roof;Mid;Base", ("channel_0", "channel_1", "channel_2")),
    ],
)
def test_one_name_too_many_is_the_first_if_it_is_a_key_and_else_the_last(read, heading, names):
    record = read(heading, (A, B, C), ";", rate_hz=100.0)
    assert record.channels == names
    assert any("one word more" in note for note in record.notes) == ("Thing" in heading)


def test_a_counter_in_front_keeps_its_name_where_the_last_name_has_no_rows(read):
    record = read("No,ax,ay,remark", (range(1, ROWS + 1), A, B), rate_hz=100.0)
    assert record.channels == ("ax", "ay")
    np.testing.assert_array_equal(record.samples, np.column_stack([A, B]))


@pytest.mark.parametrize("marks", ["123", "VLT", "NEZ", "ABC", "xyz"])
@pytest.mark.parametrize("form", ["Acc({})", "Acc ({})", "acc[{}]"])
@pytest.mark.parametrize("unit", ["", "g"])
def test_an_index_or_direction_in_brackets_is_part_of_the_name(read, marks, form, unit):
    names = tuple(form.format(mark) for mark in marks)
    below = f"\ns,{unit},{unit},{unit}" if unit else ""
    record = read(f"time,{','.join(names)}{below}", (TIME, A, B, C))
    assert record.channels == names
    assert record.units == ("m/s^2" if unit else "",) * 3
    np.testing.assert_allclose(record.samples[:, 0], A * (GRAVITY if unit else 1.0))


def test_words_in_brackets_that_are_no_units_are_part_of_the_name(read):
    record = read("time,Acc [roof],Acc [base],F [kN/m]", (TIME, A, B, C))
    assert record.channels == ("Acc [roof]", "Acc [base]", "F")
    assert record.units == ("", "", "kN/m")


def test_units_in_brackets_of_one_name_remain_units(read):
    record = read("time,Ch1 (V),Ch2 (g),Ch3 (N)", (TIME, A, B, C))
    assert record.channels == ("Ch1", "Ch2", "Ch3")
    assert record.units == ("V", "m/s^2", "N")


def test_a_kind_of_processing_behind_the_unit_stays_in_the_name(read):
    record = read("time,AI 1 [g] (MIN),AI 1 [g] (MAX),AI 1 [g] (AVE)", (TIME, A, B, C))
    assert record.channels == ("AI 1 (MIN)", "AI 1 (MAX)", "AI 1 (AVE)")
    assert record.units == ("m/s^2",) * 3


def test_a_serial_number_hides_no_unit_and_a_colon_no_names(read):
    heading = '"Date Time, GMT-04:00","Accel X, g (LGR S/N: 12, SEN S/N: 12)","SOUND : "'
    record = read(heading, (map(dated, TIME), A, B))
    assert record.channels == ("Accel X", "SOUND")
    assert record.units == ("m/s^2", "")


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("a [10^-3 g]", GRAVITY / 1000),
        ("a (milli g)", GRAVITY / 1000),
        ("a [g-force]", GRAVITY),
        ("a [1e-3 m/s2]", 1e-3),
        ("a / (mm/s^2)", 1e-3),
        ("Acc X in g", GRAVITY),
        ("ax_g", GRAVITY),
        ("ax_mg", GRAVITY / 1000),
        ("AccX_ms2", 1.0),
    ],
)
def test_plain_units_are_understood_wherever_they_stand(read, name, factor):
    record = read(f"time,{name}", (TIME, A))
    assert record.units == ("m/s^2",)
    assert record.channels[0].startswith(("ax_", "AccX_")) or record.channels[0][-1] in "aX"
    np.testing.assert_allclose(record.samples[:, 0], A * factor)


@pytest.mark.parametrize("name", ["low_g", "acc_high_g", "x_g"])
def test_a_range_in_a_name_is_no_unit(read, name):
    assert read(f"time,{name}", (TIME, A)).units == ("",)


def test_a_unit_of_motion_that_is_not_understood_is_noted(read):
    record = read("time,a [0.061 mg/LSB]", (TIME, A))
    assert any("not understood: a in 0.061 mg/LSB" in note for note in record.notes)
    scaled = read("time,a [0.061 mg/LSB]", (TIME, A), sensitivities=["0.061mg/LSB"])
    np.testing.assert_allclose(scaled.samples[:, 0], A * 0.061e-3 * GRAVITY)


COUNTS = tuple(np.round(2000 * values).astype(int) for values in (A, B))


@pytest.mark.parametrize(
    ("sep", "mark", "form"),
    [(",", ",", '"{}"'), (";", ".", "{}"), (";", ",", "{}"), ("\t", ",", "{}")],
)
def test_marks_between_thousands_are_no_decimal_marks(read, sep, mark, form):
    texts = [[form.format(f"{v:,d}".replace(",", mark)) for v in column] for column in COUNTS]
    record = read(f"Rate: 100 Hz\nax{sep}ay", texts, sep)
    np.testing.assert_array_equal(record.samples, np.column_stack(COUNTS))
    assert any("parts thousands" in said for said in record.assumptions)


@pytest.mark.parametrize(("sep", "mark"), [(";", ","), (",", "."), (";", ".")])
@pytest.mark.parametrize("offset", [0.0, 9.8])
def test_three_decimals_remain_decimals(read, sep, mark, offset):
    texts = [f"{v + offset:.3f}".replace(".", mark) for v in B / 4]
    record = read(f"Rate: 100 Hz\nn{sep}ax", (range(ROWS), texts), sep)
    np.testing.assert_allclose(record.channel("ax"), B / 4 + offset, atol=6e-4)


def test_quoted_numbers_that_may_be_thousands_or_decimals_are_asked_about(read):
    texts = [[f'"{20_000 + v // 2:,d}"' for v in column] for column in COUNTS]
    with pytest.raises(RecordError, match=r"stands before three digits .*decimal points"):
        read("Rate: 100 Hz\nax,ay", texts)


def test_decimal_commas_between_commas_behind_a_counter_are_asked_about(read):
    texts = [[f"{2 + v / 9:.5f}".replace(".", ",") for v in column] for column in (A, B)]
    for first in (range(ROWS), map(dated, TIME)):
        with pytest.raises(RecordError, match=r"between numbers and, it seems, before their"):
            read("Nr,ax,ay", (first, *texts), rate_hz=100.0)
    padded = [f"{i % 7:03d}" for i in range(ROWS)]
    record = read("n,ax,state", (range(ROWS), COUNTS[0], padded), rate_hz=100.0)
    assert record.channels == ("ax", "state")


@pytest.mark.parametrize("cell", ["", "NaN"])
@pytest.mark.parametrize("policy", ["skip_missing", "keep_missing"])
def test_a_row_without_a_time_is_a_gap_and_the_time_no_channel(read, cell, policy):
    times = [*map(str, TIME)]
    times[300] = cell
    given = {"skip_missing": False, policy: True}
    record = read("time,ch1,ch2", (times, A, B), **given)
    assert record.channels == ("ch1", "ch2")
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(300, 1)]
    np.testing.assert_array_equal(record.samples[:, 0], np.delete(A, 300))


@pytest.mark.parametrize(
    "code", ["9999", "-9999", "-999.25", "1e30", "3.402823E+38", "-32768", "99999"]
)
def test_a_code_far_beyond_all_values_is_missing(read, code):
    texts = [*map(str, A)]
    for row in (100, 101, 500):
        texts[row] = code
    record = read("time,ch1,ch2", (TIME, texts, B))
    np.testing.assert_array_equal(record.samples[:, 0], np.delete(A, [100, 101, 500]))
    assert sum(gap.missing for gap in record.gaps) == 3
    assert any("3 rows of 'ch1'" in note and "missing" in note for note in record.notes)
    with pytest.raises(RecordError, match=r"in 3 rows of 'ch1'.*in row 100"):
        read("time,ch1,ch2", (TIME, texts, B), skip_missing=False)


def test_values_that_only_look_like_codes_are_kept(read):
    clipped = np.clip(np.round(40_000 * A), -32_768, 32_767).astype(int)
    record = read("time,ch1", (TIME, clipped))
    np.testing.assert_array_equal(record.samples[:, 0], clipped)
    (note,) = record.notes
    assert "'ch1' is clipped" in note
    doubtful = np.round(1500 * A).astype(int)
    doubtful[[7, 90]] = 9999
    record = read("time,ch1", (TIME, doubtful))
    np.testing.assert_array_equal(record.samples[:, 0], doubtful)
    assert any("9999 stands in 2 rows of 'ch1'" in note for note in record.notes)


@pytest.mark.parametrize("sensors", [("ACC", "GYR"), ("1", "2"), ("17", "23")])
@pytest.mark.parametrize("every", [1, 4])
def test_rows_of_two_sensors_in_turn_are_asked_about(read, sensors, every):
    rows = []
    for i in range(ROWS):
        rows.append((sensors[0], f"{TIME[i]:.4f}", A[i]))
        if i % every == 0:
            rows.append((sensors[1], f"{TIME[i] + 0.004:.4f}", 5 + C[i]))
    with pytest.raises(RecordError, match=r"'sensor' alternates between .*--rate-hz"):
        read("sensor,time,value", zip(*rows, strict=True))


@pytest.mark.parametrize("name", ["flag", "tooth", "type", "phase"])
def test_states_and_counters_are_no_sensors_in_turn(read, name):
    states = {
        "flag": np.random.default_rng(4).integers(0, 2, ROWS),
        "tooth": np.arange(ROWS) % 20,
        "type": np.repeat([1, 2], ROWS // 2),
        "phase": np.repeat(["quiet", "shaken"], ROWS // 2),
    }[name]
    record = read(f"time,{name},ax,ay", (TIME, states, A, B))
    assert record.channels[-2:] == ("ax", "ay")


def test_words_in_few_rows_of_a_last_column_are_noted(read):
    last = [""] * ROWS
    last[300] = "hammer"
    record = read("time,ax,ay,event", (TIME, A, B, last))
    assert record.channels == ("ax", "ay")
    assert any("line 302: 'hammer'" in note for note in record.notes)
    last[::2] = ["x"] * (ROWS // 2)
    last[0] = last[1] = ""
    with pytest.raises(RecordError, match="has 4 fields"):
        read("time,ax,ay,event", (TIME, A, B, last))


def test_statistics_below_the_rows_are_set_aside(read):
    columns = [*TIME, "Max", "Min", "Std. Dev."], [*A, 3, 1, 2], [*B, 1, 2, 3]
    record = read("time,ax,ay", columns)
    np.testing.assert_array_equal(record.samples, np.column_stack([A, B]))
    assert any("Statistics below the rows, from line 802" in note for note in record.notes)


@pytest.mark.parametrize("token", ["OVERLOAD", "OL", "*****", "No Data", "N.A.", "1.#INF"])
def test_words_of_instruments_for_no_value_are_missing(read, token):
    texts = [*map(str, A)]
    texts[300] = token
    record = read("time,ax,ay", (TIME, texts, B))
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(300, 1)]
