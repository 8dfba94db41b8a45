"""Each kind of event of an asset as a sentence for people."""

import pytest

from twin_server.events.asset_events import AssetEventOrder, accepted, sentence

CURVE = {"a50": 0.1, "slope": 2.0}


def told(**order):
    made = AssetEventOrder(event="e1", **order)
    return sentence(accepted(made, "lab.beam", 1, 5, "ann", None))


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"kind": "repair"}, "Repair recorded by ann: restored share unknown."),
        (
            {"kind": "repair", "repair": {"restored_share": 1.0}},
            "Repair recorded by ann: perfect, all damage restored.",
        ),
        (
            {"kind": "repair", "repair": {"restored_share": 1.0, "restored_share_sd": 0.05}},
            "Repair recorded by ann: 100 % ± 5 % of the damage restored.",
        ),
        (
            {"kind": "replacement"},
            "Replacement recorded by ann: new part at +0 % of the nominal model.",
        ),
        (
            {"kind": "replacement", "replacement": {"change": None}},
            "Replacement recorded by ann: stiffness of the new part unknown until readings "
            "follow.",
        ),
        (
            {"kind": "replacement", "replacement": {"change": -0.021, "sd": 0.01}},
            "Replacement recorded by ann: new part at -2.1 % of the nominal model.",
        ),
        (
            {
                "kind": "load_test",
                "quantity": "stiffness_change",
                "measured": {"value": -0.123, "sd": 0.02},
            },
            "Load test of stiffness_change recorded by ann: -12.3 % ± 2 %.",
        ),
        (
            {
                "kind": "inspection",
                "quantity": "j2",
                "detection": {"detected": True, "probability_of_detection": CURVE},
            },
            "Inspection of j2 recorded by ann: damage found.",
        ),
        (
            {
                "kind": "inspection",
                "quantity": "j2",
                "detection": {"detected": False, "probability_of_detection": CURVE},
            },
            "Inspection of j2 recorded by ann: no damage found.",
        ),
        (
            {"kind": "note", "text": "Gates were open.", "person": "Bo"},
            "Note recorded by Bo. Gates were open.",
        ),
        (
            {"kind": "note", "reverses": "r1", "text": "Another beam."},
            "ann took back the event r1. Another beam.",
        ),
    ],
    ids=lambda x: "" if isinstance(x, dict) else x,
)
def test_what_was_done_and_found_is_said_with_who_reports_it(order, says):
    assert told(**order) == says
