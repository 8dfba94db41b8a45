"""Situations of a twin, and the answer to each whether anything is wrong."""

from typing import Any

from twin_server.history import states
from twin_server.serve.conclusion import Evidence, FailureProspect, LimitProspect

WELL = Evidence(reasons=0, alive=True)
NEAR = LimitProspect(0.3, 0.0, "Stiffness change below −30 %: 10 %: by 700.")
FAR = LimitProspect(0.01, 0.0, "Stiffness change below −30 %.")
PASSED = LimitProspect(0.9, 0.8, "Stiffness change below −30 %.")
SAFE = FailureProspect(1e-9, 1e-7, 1e-4, False, "collapse: 1e-9")
RISING = FailureProspect(1e-5, 2e-4, 1e-4, True, "collapse: 1e-5")
FAILING = FailureProspect(3e-4, 4e-4, 1e-4, True, "collapse: 3e-4")
DOOMED = FailureProspect(0.001, 0.69, 0.9, False, "collapse: 0.001")
BEGUN = FailureProspect(0.0, 0.2, 0.9, False, "collapse: 0.2")
RAISED = ("Stiffness change is below −10 %.",)
SITUATIONS: dict[str, tuple[dict[str, Any], str, list[str]]] = {
    "well": ({}, "no", []),
    "not begun": ({"reasons": None}, "cannot_say", ["no_readings"]),
    "never begun, no agent": (
        {"reasons": None, "alive": False}, "cannot_say", ["no_readings", "agent_offline"],
    ),
    "offline": ({"alive": False}, "cannot_say", ["agent_offline"]),
    "silent sensor": ({"silent_s": 90}, "cannot_say", ["sensor_silent"]),
    "stale": ({"late_s": 900}, "cannot_say", ["readings_late"]),
    "offline explains stale": (
        {"alive": False, "late_s": 900, "silent_s": 9}, "cannot_say", ["agent_offline"],
    ),
    "learning": ({"reasons": states.LEARNING}, "cannot_say", ["learning"]),
    "training": ({"reasons": states.TRAINING}, "cannot_say", ["learning"]),
    "no mode": ({"reasons": states.NO_MODE}, "cannot_say", ["not_valid"]),
    "misfit": ({"reasons": states.MODEL_MISFIT}, "cannot_say", ["not_valid"]),
    "beyond covariates": ({"reasons": states.BEYOND_COVARIATES}, "cannot_say", ["not_valid"]),
    "measured before": ({"reasons": states.MEASURED_BEFORE}, "no", []),
    "beyond a limit": ({"raised": RAISED}, "act", ["limit_passed"]),
    "beyond two": ({"raised": RAISED * 2}, "act", ["limit_passed"] * 2),
    "beyond, offline": (
        {"raised": RAISED, "alive": False}, "act", ["limit_passed", "agent_offline"],
    ),
    "beyond, not valid": (
        {"raised": RAISED, "reasons": states.NO_MODE}, "act", ["limit_passed", "not_valid"],
    ),
    "likely beyond soon": ({"limits": [NEAR]}, "watch", ["limit_near"]),
    "hardly beyond": ({"limits": [FAR]}, "no", []),
    "probably passed, no alarm yet": ({"limits": [PASSED]}, "no", []),
    "safe": ({"failures": [SAFE]}, "no", []),
    "accepted risk reached later": ({"failures": [RISING]}, "watch", ["risk_rising"]),
    "accepted risk exceeded": ({"failures": [FAILING]}, "act", ["risk_too_high"]),
    "failure more likely than not, later": ({"failures": [DOOMED]}, "watch", ["risk_rising"]),
    "failure possible": ({"failures": [BEGUN]}, "watch", ["risk_rising"]),
    "one of two states fails": (
        {"failures": [SAFE, FAILING]}, "act", ["risk_too_high"],
    ),
    "repair is due": ({"plan": ("repair", "Repair now.")}, "act", ["repair_due"]),
    "close it": ({"plan": ("close", "Close it.")}, "act", ["repair_due"]),
    "inspection is due": ({"plan": ("inspect", "Inspect.")}, "act", ["inspection_due"]),
    "plan waits": ({"plan": ("wait", "Wait.")}, "no", []),
    "plan undecided": ({"plan": ("undecided", "Equal.")}, "no", []),
    "element changed": ({"suspects": ["storey2"]}, "watch", ["changed"]),
    "unexplained": ({"unexplained": True}, "watch", ["unexplained_change"]),
    "model disagrees": ({"disagrees": True}, "watch", ["model_disagrees"]),
    "message set aside": ({"set_aside": 1}, "watch", ["set_aside"]),
    "changed and offline": (
        {"suspects": ["k1"], "alive": False}, "watch", ["changed", "agent_offline"],
    ),
}  # fmt: skip
"""Name → what differs from a twin that is well, the answer, and kinds of findings in order."""
