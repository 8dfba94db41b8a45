"""Slots: never more than there are, and always some left for who holds none."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_server.fairness import ALONE, Holder, Holdings, OverQuotaError, Quota, QuotaHolding
from twin_server.fairness.quota import ALPHA
from twin_server.identity.principals import EVERYBODY, Principal, Scope

SITES = [f"site-{i}" for i in range(6)]
HOLDERS = st.builds(Holder, st.sampled_from(SITES), st.sampled_from(["s", "t"]))


def fill(quota, holder, most=10_000):
    """Take all that a holder may have; the holdings."""
    held: list[QuotaHolding] = []
    while len(held) < most:
        try:
            held.append(quota.take(holder, "something"))
        except OverQuotaError:
            return held
    return held


@given(
    most=st.integers(1, 40),
    of_site=st.none() | st.integers(1, 10),
    of_token=st.none() | st.integers(1, 10),
    steps=st.lists(st.tuples(HOLDERS, st.booleans(), st.integers(0, 99)), max_size=200),
)
def test_no_bound_is_exceeded_whatever_is_taken_and_given_back(most, of_site, of_token, steps):
    quota = Quota("uploads", most, setting="s", of_site=of_site, of_token=of_token)
    held: list[QuotaHolding] = []
    for holder, takes, which in steps:
        if takes:
            before = Counter(one.holder.site for one in held)[holder.site]
            free = most - len(held)
            try:
                held.append(quota.take(holder, "a thing"))
            except OverQuotaError:
                continue
            assert free > 0
            assert before < ALPHA * free
        elif held:
            held.pop(which % len(held)).release()
        assert quota.count == len(held) <= most
        sites = Counter(one.holder.site for one in held)
        tokens = Counter(one.holder for one in held)
        assert max(sites.values(), default=0) <= min(of_site or most, -(-most // 2))
        assert max(tokens.values(), default=0) <= (of_token or most)
        assert {one.id for one in quota.held()} == {one.id for one in held}


@given(most=st.integers(1, 200), greedy=st.integers(1, 6))
def test_where_some_take_all_they_can_another_still_finds_its_share_of_the_reserve(
    most, greedy
):
    quota = Quota("uploads", most, setting="s")
    for site in SITES[:greedy]:
        for token in "tuvw":
            fill(quota, Holder(site, token))
    free = most - quota.count
    assert free >= most // 2**greedy
    if free:
        assert quota.take(Holder("another", "t"), "what it needs")


@given(most=st.integers(2, 100), greedy=st.integers(1, 5))
def test_sites_that_give_back_and_take_again_come_to_equal_shares(most, greedy):
    quota = Quota("uploads", most, setting="s")
    holders = [Holder(site, token) for site in SITES[:greedy] for token in "tuvw"]
    for _ in range(4 * most):
        for holder in holders:
            fill(quota, holder, 1)
        held = quota.held()
        held[0].release()
    for holder in holders:
        fill(quota, holder, 1)
    counts = [quota.of_site(site) for site in SITES[:greedy]]
    assert max(counts) - min(counts) <= 2
    assert most - quota.count >= most // (1 + greedy) - greedy


@given(most=st.integers(1, 200))
def test_one_site_alone_may_have_half_and_one_token_four_fifths_of_that(most):
    quota, alone = Quota("uploads", most, setting="s"), -(-most // 2)
    held = fill(quota, Holder("a", "t"))
    assert quota.count == -(-alone * 4 // 5)
    for token in "uvw":
        fill(quota, Holder("a", token))
    assert alone - 1 <= quota.count <= alone
    count = quota.count
    held[0].release()
    held[0].release()
    assert quota.count == count - 1
    assert quota.take(Holder("a", "new"), "again")


def test_one_token_leaves_a_place_to_another_of_its_site():
    quota = Quota("diagnoses", 38, setting="s", of_site=5)
    assert len(fill(quota, Holder("a", "greedy"))) == 4
    assert len(fill(quota, Holder("a", "modest"))) == 1


def test_everybody_on_a_server_without_tokens_may_have_all():
    quota = Quota("uploads", 5, setting="a.setting")
    assert len(fill(quota, ALONE)) == 5
    with pytest.raises(
        OverQuotaError, match=r"no room for more uploads\. Allowed: 5.*a\.setting"
    ):
        quota.take(ALONE, "one more")


def test_a_refusal_says_what_is_held_and_what_to_do_and_names_no_other_site():
    quota = Quota("uploads", 6, setting="recordings.max_at_once")
    fill(quota, Holder("other-secret", "their-secret"))
    mine = fill(quota, Holder("a", "t"))
    with pytest.raises(OverQuotaError) as refused:
        quota.take(Holder("a", "t"), "one more")
    said = str(refused.value)
    assert f"{len(mine)} uploads of your" in said
    assert "recordings.max_at_once" in said
    assert "cancel one: GET /api/v1/holdings" in said
    assert "secret" not in said
    assert refused.value.own
    assert quota.refused["a"] >= 1


def test_what_is_held_is_told_to_those_who_reach_all_of_its_sites_and_counted_by_site():
    holdings = Holdings()
    quota = holdings.add(Quota("uploads", 100, setting="s"))
    for site in ("a", "b", "a,b", "*"):
        quota.take(Holder(site, "t"), f"of {site}")
    seen = {
        name: [one["what"] for one in holdings.seen(Principal(name, Scope.VIEWER, sites))]
        for name, sites in {
            "of a": frozenset("a"), "of both": frozenset("ab"), "of none": frozenset(),
        }.items()
    }  # fmt: skip
    assert seen == {"of a": ["of a"], "of both": ["of a", "of b", "of a,b"], "of none": []}
    everything = holdings.seen(EVERYBODY)
    assert len(everything) == 4
    first = everything[0]["id"]
    found = holdings.find(first, EVERYBODY)
    assert found is not None
    assert found.what == "of a"
    assert holdings.find(first, Principal("of b", Scope.ADMIN, frozenset("b"))) is None
    assert ("uploads", "a,b", 1, 0) in set(holdings.counts())
