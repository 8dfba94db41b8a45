"""Our rules of matching against Zenoh's own."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from slowtime_services.bus.keys import InvalidKeyError, check_key, matches

expressions = st.lists(st.sampled_from(["a", "b", "@v", "*", "**"]), min_size=1, max_size=5)


@given(one=expressions, other=expressions)
def test_two_expressions_meet_exactly_where_zenoh_says_they_do(one, other):
    mine = matches("/".join(one), "/".join(other))
    theirs = zenoh.KeyExpr.autocanonize("/".join(one)).intersects(
        zenoh.KeyExpr.autocanonize("/".join(other))
    )
    assert mine == theirs


@given(st.text(alphabet="ab/*?#$@ ", min_size=0, max_size=6))
def test_what_we_accept_zenoh_accepts(text):
    try:
        check_key(text, wildcards=True)
    except InvalidKeyError:
        return
    zenoh.KeyExpr.autocanonize(text)


@pytest.mark.parametrize("key", ["a/b*", "a/***", "a/*b/c"])
def test_a_star_inside_a_chunk_is_refused(key):
    with pytest.raises(InvalidKeyError, match="as whole parts"):
        check_key(key, wildcards=True)
