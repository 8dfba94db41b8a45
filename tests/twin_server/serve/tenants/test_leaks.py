"""Ways in which one site could learn of another, each tried."""

import pytest

from tests.twin_server.serve.conftest import RIG
from twin_server.composites.composite import Composite
from twin_server.composites.visibility import history_of
from twin_server.diagnose.jobs import JobId, Jobs
from twin_server.identity.principals import Principal, Scope
from twin_server.settings import DiagnoseSettings

from .scenario import Tenant


@pytest.fixture
def given(house):
    """Upload a recording of the own site under a name; the answer."""
    made = []

    def give(site, name, of=None, **more):
        content = Tenant(house, of or site).recorded("given", 3)
        made.append((site, name))
        return house.ask(site, "admin", "PUT", f"/recordings/{name}", content=content, **more)

    yield give
    for site, name in made:
        house.ask(site, "admin", "DELETE", f"/recordings/{name}")


def kept(house, site, scope="admin"):
    """Name and name space of each recording that a caller sees."""
    found = house.ask(site, scope, "GET", "/recordings").json()["recordings"]
    return sorted((one["name"], one["site"]) for one in found)


def put(house, site, composite, members, **more):
    body = {"members": members, **more}
    return house.ask(site, "admin", "PUT", f"/composites/{composite}", json=body)


def kinds(house, site, composite):
    found = house.ask(site, "viewer", "GET", f"/composites/{composite}/events").json()["events"]
    return [(one["kind"], one["details"]["member"]) for one in found]


def test_a_diagnosis_of_an_unknown_file_lists_the_recordings_of_the_own_site_only(house, given):
    rig = {"changes": "stiffness", "model": RIG}
    assert house.ask("lab", "operator", "PUT", "/twins/lab.rig", json=rig).status_code == 201
    assert given("plant", "plans-of-plant.mcap").status_code == 201
    assert given("lab", "own.mcap").status_code == 201
    for name in ("plans-of-plant.mcap", "nowhere.mcap"):
        order = {"recordings": {"files": [name]}}
        told = house.ask("lab", "operator", "POST", "/twins/lab.rig/diagnoses", json=order)
        assert (told.status_code, told.json()["detail"]) == (
            422, f"{name} were asked for. There are, of those that you may see: own.mcap.",
        )  # fmt: skip


def test_a_name_that_another_site_has_given_is_free_and_means_the_own_recording(house, given):
    assert given("plant", "monday.mcap").status_code == 201
    assert given("lab", "monday.mcap").status_code == 201
    assert given("lab", "monday.mcap").status_code == 409
    for site in ("lab", "plant"):
        assert kept(house, site) == [("monday.mcap", site)]
        one = house.ask(site, "viewer", "GET", "/recordings").json()["recordings"][0]
        assert one["twins"] == [f"{site}.given"]
        other = {"lab": "plant", "plant": "lab"}[site]
        asked = {"site": other}
        gone = house.ask(site, "viewer", "GET", "/recordings/monday.mcap", params=asked)
        assert gone.status_code == 404


def test_who_sees_several_recordings_of_a_name_says_of_which_site(house, given):
    given("plant", "monday.mcap")
    given("lab", "monday.mcap")
    assert kept(house, "*") == [("monday.mcap", "lab"), ("monday.mcap", "plant")]
    path = "/recordings/monday.mcap"
    unclear = house.ask("*", "admin", "GET", path)
    assert (unclear.status_code, unclear.json()["type"][-18:]) == (409, "several-recordings")
    assert "lab, plant" in unclear.json()["detail"]
    for site in ("lab", "plant"):
        told = house.ask("*", "admin", "GET", path, params={"site": site})
        assert told.content == house.ask(site, "viewer", "GET", path).content
    assert given("*", "monday.mcap", of="lab").status_code == 409


def test_a_file_of_the_whole_server_stays_reachable_by_its_name(house, given):
    content = Tenant(house, "lab").recorded("old", 3)
    folder = house.home / "kept"
    folder.mkdir(exist_ok=True)
    (folder / "old.mcap").write_bytes(content)
    try:
        assert kept(house, "lab") == [("old.mcap", None)]
        assert kept(house, "plant") == []
        assert house.ask("lab", "viewer", "GET", "/recordings/old.mcap").content == content
        assert given("lab", "old.mcap").status_code == 409
        assert given("plant", "old.mcap").status_code == 201
        assert house.ask("*", "admin", "GET", "/recordings/old.mcap").content == content
    finally:
        (folder / "old.mcap").unlink()


def test_a_replay_of_another_site_blocks_nobody_and_is_not_named(house, given):
    speed = {"speed": 0.01}
    for site in ("plant", "lab"):
        assert given(site, "slow.mcap").status_code == 201
        path = "/recordings/slow.mcap/replay"
        assert house.ask(site, "operator", "POST", path, json=speed).status_code == 202
    assert given("lab", "second.mcap").status_code == 201
    again = house.ask("lab", "operator", "POST", "/recordings/second.mcap/replay", json={})
    assert (again.status_code, again.json()["detail"]) == (
        409,
        "slow.mcap is being played to twins of the same site. Wait, or stop it first.",
    )
    for site in ("plant", "lab"):
        assert house.ask(site, "operator", "DELETE", path).status_code == 200
        house.until(
            lambda site=site: (
                "playing" not in house.ask(site, "viewer", "GET", "/recordings").text
            )
        )


def test_a_revision_is_told_to_who_may_see_what_it_held(house):
    joint = put(house, "*", "lab.shared", ["lab.beam", "plant.beam"], name="Joint venture")
    assert joint.status_code == 201
    assert put(house, "*", "lab.shared", ["lab.beam"], name="Own").status_code == 200
    path = "/composites/lab.shared/revisions"
    seen = {
        site: [
            one["registration"]["name"]
            for one in house.ask(site, "admin", "GET", path).json()["revisions"]
        ]
        for site in ("lab", "*")
    }
    assert seen == {"lab": ["Own"], "*": ["Joint venture", "Own"]}
    assert house.ask("lab", "admin", "DELETE", "/composites/lab.shared").status_code == 204


def test_a_revision_held_what_its_member_composites_held_then():
    line = Composite(members=("lab.beam", "plant.beam"))
    yard = Composite(members=("lab.line",))
    own = Composite(members=("lab.beam",))
    told = [("lab.line", line), ("lab.yard", yard), ("lab.line", own), ("lab.yard", None)]
    assert history_of("lab.yard", told) == [{"lab", "plant"}, {"lab", "plant"}]
    assert history_of("lab.line", told) == [{"lab", "plant"}, {"lab"}]


def test_a_composite_with_members_out_of_reach_is_neither_shown_nor_replaced(house):
    assert put(house, "*", "lab.held", ["lab.beam", "plant.beam"]).status_code == 201
    try:
        path = "/composites/lab.held"
        for method, body in (
            ("GET", None),
            ("PUT", {"members": ["lab.beam"]}),
            ("DELETE", None),
        ):
            told = house.ask("lab", "admin", method, path, json=body)
            assert told.status_code == 403
            assert "plant" not in told.text
        listed = house.ask("lab", "viewer", "GET", "/composites").json()
        assert listed == {"composites": []}
    finally:
        house.ask("*", "admin", "DELETE", "/composites/lab.held")


def test_a_foreign_composite_of_own_twins_is_in_no_list_and_no_graph(house):
    assert put(house, "*", "plant.watched", ["lab.beam"], name="Watched").status_code == 201
    try:
        for path in (
            "/composites", "/dtdl", "/twins/lab.beam/dtdl", "/twins/lab.beam/memberships",
        ):  # fmt: skip
            assert "atched" not in house.ask("lab", "viewer", "GET", path).text
        assert "Watched" in house.ask("*", "admin", "GET", "/dtdl").text
    finally:
        house.ask("*", "admin", "DELETE", "/composites/plant.watched")


def test_a_member_is_refused_before_it_is_looked_whether_it_is_there(house):
    there = put(house, "lab", "lab.x", ["lab.beam", "plant.beam"])
    nowhere = put(house, "lab", "lab.x", ["lab.beam", "plant.nothing"])
    assert there.status_code == nowhere.status_code == 403
    assert there.content == nowhere.content


def test_who_deletes_a_member_learns_nothing_of_a_foreign_composite_whose_site_is_told(house):
    assert put(house, "lab", "lab.line", ["lab.beam"]).status_code == 201
    assert put(house, "*", "plant.city", ["plant.beam", "lab.line"]).status_code == 201
    assert put(house, "*", "plant.country", ["plant.city"]).status_code == 201
    assert put(house, "lab", "lab.line", ["lab.beam"], name="Changed").status_code == 200
    assert kinds(house, "plant", "plant.city") == [("member_changed", None)]
    assert kinds(house, "plant", "plant.country") == [("member_changed", None)]
    assert house.ask("lab", "admin", "DELETE", "/composites/lab.line").status_code == 204
    assert len(kinds(house, "plant", "plant.city")) == 2
    told = house.ask("plant", "viewer", "GET", "/composites/plant.city/events")
    assert "lab" not in told.text
    whole = house.ask("*", "admin", "GET", "/composites/plant.city")
    assert whole.status_code == 200
    assert "lab.line is not registered any more." in whole.text
    for name in ("plant.country", "plant.city"):
        assert house.ask("*", "admin", "DELETE", f"/composites/{name}").status_code == 204


def test_the_site_of_a_composite_is_told_that_a_member_twin_was_deleted(house):
    assert house.ask("lab", "operator", "PUT", "/twins/lab.short", json={}).status_code == 201
    assert put(house, "*", "plant.union", ["plant.beam", "lab.short"]).status_code == 201
    assert put(house, "lab", "lab.pair", ["lab.beam", "lab.short"]).status_code == 201
    assert house.ask("lab", "admin", "DELETE", "/twins/lab.short").status_code == 204
    assert kinds(house, "plant", "plant.union") == [("member_changed", None)]
    assert kinds(house, "lab", "lab.pair") == [("member_changed", "lab.short")]
    for name in ("plant.union", "lab.pair"):
        assert house.ask("*", "admin", "DELETE", f"/composites/{name}").status_code == 204


def test_numbers_of_events_do_not_count_those_of_other_sites(house):
    def last():
        told = house.ask("lab", "viewer", "GET", "/twins/lab.beam/events", params={"limit": 1})
        return told.json()["events"][-1]["number"]

    def note(site):
        order = {"event": f"n{len(seen)}", "kind": "note", "person": "Ann", "text": "x"}
        told = house.ask(site, "operator", "POST", f"/twins/{site}.beam/events", json=order)
        assert told.status_code == 201

    seen = [last()]
    for site in ("plant", "lab", "plant", "lab"):
        note(site)
        seen.append(last())
    first = seen[0]
    assert seen == [first, first, first + 1, first + 1, first + 2]
    live = house.ask("lab", "viewer", "GET", "/twins/lab.beam/live", headers={
        "Last-Event-ID": f":0-{first}"})  # fmt: skip
    assert [line for line in live.text.splitlines() if line.startswith("id:")] == [
        f"id: :0-{first + 1}", f"id: :0-{first + 2}",
    ]  # fmt: skip


def test_a_waiting_diagnosis_counts_those_of_its_own_site_only(tmp_path):
    jobs = Jobs(("true",), DiagnoseSettings(max_queued=4), lambda *_: None)
    for twin in ("plant.a", "lab.a", "plant.b", "lab.b"):
        jobs.submit(JobId(twin, 1), tmp_path, jobs.reserve(f"diagnosis of {twin}"))
    told = jobs.progress(JobId("lab.b", 1))
    assert told is not None
    assert told.stage == "waiting, 1 of its site ahead of it"


def test_heads_over_all_sites_are_for_who_may_see_all_sites(house):
    assert house.ask("lab", "admin", "GET", "/ledger/heads").status_code == 403
    assert house.ask("*", "admin", "GET", "/ledger/heads").status_code == 200


def test_what_belongs_to_no_site_is_for_who_may_see_all_sites():
    of_some = Principal("ann", Scope.ADMIN, frozenset({"lab", "plant"}))
    of_all = Principal("root", Scope.ADMIN, None)
    assert [one.covers(()) for one in (of_some, of_all)] == [False, True]
    assert [of_some.covers(sites) for sites in (("lab",), ("lab", "north"))] == [True, False]
    assert Principal.of_message(of_some.to_message()) == of_some
