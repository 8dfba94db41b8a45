"""Lines are what another library reads from them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_services.outputs.receivers.line_protocol import LONGEST_TEXT, line

parser = pytest.importorskip("line_protocol_parser")
# What a name may hold here: no control characters, and no backslash at the end.
NAMES = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1
)
TEXTS = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"]), max_size=50
)


@given(
    tag=NAMES.filter(lambda text: "\\" not in text and text.strip()),
    text=TEXTS,
    number=st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False),
    whole=st.integers(-(2**63), 2**63 - 1),
    t_ns=st.integers(0, 2**63 - 2),  # the last one is not a stamp of InfluxDB
)
def test_a_line_is_read_as_it_was_meant(tag, text, number, whole, t_ns):
    fields = {"x": number, "n": whole, "is": True, "say": text}
    read = parser.parse_line(line("slowtime_state", {"asset": tag}, fields, t_ns))
    assert read["measurement"] == "slowtime_state"
    assert read["tags"] == {"asset": " ".join(tag.splitlines())}
    assert read["fields"] == fields | {"say": " ".join(text.splitlines())}
    assert read["time"] == t_ns


def test_what_the_protocol_has_no_form_for_is_left_out_or_cut():
    read = parser.parse_line(
        line(
            "m", {"site": "lab", "none": ""}, {"x": float("nan"), "y": 1.0, "z": "é" * 10**5}, 1
        )
    )
    assert read["tags"] == {"site": "lab"}
    assert read["fields"].keys() == {"y", "z"}
    assert len(read["fields"]["z"].encode()) == LONGEST_TEXT
