"""Adopting and undoing diagnoses as a state machine: what is adopted is a stack of changes.

Whatever is asked for, in whatever order and with however old a view of the twin, each adopted
diagnosis is adopted once, the model before the first is kept, and undoing all leaves no trace.
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from slowtime_services.clock import HandClock
from slowtime_services.models.model_reader import parse_model
from tests.state_machines import assert_found, run_long, run_share, steps_in
from twin_server.persist import DiagnosisRow, SqliteStore
from twin_server.pipeline import Diagnoses, Pipeline
from twin_server.pipeline.diagnoses import orders
from twin_server.registration.twin import MODEL_EXAMPLE, Registration
from twin_server.serve import ProblemError
from twin_server.settings import DiagnoseSettings, GapSettings, TwinSettings

FILE = Path(orders.__file__)
STEPS = 150
"""Lines of an operation: a diagnosis is looked up by its number, however many there are."""
ID, OTHER = "lab.beam", "lab.fan"
MOST = 16
"""Diagnoses that a twin adopts at most."""
ADOPTABLE = ("coulomb", "cubic", "temperature")
KINDS = (*ADOPTABLE, *ADOPTABLE, "sensor_fault", "nothing", "trend", "failed")
SELDOM = st.integers(0, 3).map(lambda n: n == 3)
EFFECTS = {
    "coulomb": {"effect": "coulomb", "element": "storey1", "friction_n": 12.0},
    "cubic": {"effect": "cubic_hardening", "element": "storey2", "k3_n_per_m3": 1e9},
}


def registration(name):
    return Registration.model_validate({**MODEL_EXAMPLE, "name": name})


def report_of(kind):
    slow = kind in ("temperature", "trend")
    named = EFFECTS[kind]["effect"] if kind in EFFECTS else kind
    effect = {"effect": named, "covariate": None, "family": kind}
    if kind == "temperature":
        effect["covariate"] = "temperature_c"
    return json.dumps(
        {
            "clock": "slow" if slow else "fast",
            "effects": [] if kind == "nothing" else [effect],
            "sentence": f"Found {kind}.",
            "verdict": kind if kind == "sensor_fault" else "named",
        }
    )


class AdoptionMachine(RuleBasedStateMachine):
    """One twin with diagnoses, some of which can be adopted, and people who ask for it."""

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="adoption-model-"))
        self.found = {}
        self.stack = []
        self.seen = list[Registration]()
        self.base = registration("Frame")
        self.store = SqliteStore(self.folder / "twin.sqlite")
        self.open()
        self.pipeline.register(ID, self.base)
        self.pipeline.register(OTHER, registration("Fan"))

    def teardown(self):
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def open(self):
        settings = TwinSettings(connect=())
        self.pipeline = Pipeline(settings, self.store, clock=HandClock(10**18))
        self.pipeline.start()
        self.orders = Diagnoses(
            self.pipeline, self.store, DiagnoseSettings(), GapSettings(every_s=0.0),
            (sys.executable, "-c", ""),
        )  # fmt: skip

    def close(self):
        self.pipeline.stop()
        self.store.close()

    @property
    def now(self):
        twin = self.pipeline.twin(ID)
        assert twin is not None
        return twin.registration

    def changes(self, given, number):
        """What adopting a diagnosis gives; None where it cannot be adopted."""
        kind = self.found.get(number)
        if kind in EFFECTS:
            return {"model": json.loads(self.augmented(kind))}
        if kind != "temperature":
            return None
        names = given["covariates"]["names"] if given["covariates"] else []
        return {"names": list(dict.fromkeys([*names, "temperature_c"]))}

    def augmented(self, kind):
        base = self.base.to_dict()["model"]
        return json.dumps(base | {"effects": [EFFECTS[kind]]})

    @rule(kind=st.sampled_from(KINDS), twin=st.sampled_from([ID, ID, ID, OTHER]))
    def diagnose(self, kind, twin):
        row = DiagnosisRow(0, twin, 1, None, "queued", "{}")
        number = self.store.add_diagnosis(row, 100)
        state = "failed" if kind == "failed" else "done"
        model = self.augmented(kind) if kind in EFFECTS else ""
        report = None if kind == "failed" else report_of(kind)
        ended = row._replace(number=number, state=state, ended_ns=2, report=report)
        self.store.end_diagnosis(ended, b"", model)
        if twin == ID:  # each twin counts its own
            self.found[number] = kind

    def attempt(self, function, given, number):
        before, refused = self.now, None
        with steps_in(FILE) as steps:
            try:
                function(ID, given, number)
            except ProblemError as error:
                refused = error
        assert steps.count <= STEPS
        if refused is not None:
            assert 400 <= refused.status < 500
            assert self.now == before
        elif self.now != before:
            self.seen = [*self.seen, before][-5:]
        return refused is None

    @rule(data=st.data(), late=SELDOM)
    def adopt(self, data, late):
        """With `late`, as somebody who has looked at the twin some time ago."""
        number = data.draw(st.integers(1, len(self.found) + 1))
        given = data.draw(st.sampled_from([*self.seen, self.now])) if late else self.now
        fits = given == self.now and number not in [n for n, _ in self.stack]
        changed = self.changes(given.to_dict(), number) if fits else None
        expected = changed is not None and len(self.stack) < MOST
        before = self.now
        assert self.attempt(self.orders.adopt, given, number) == expected
        if expected and changed is not None:
            self.stack.append((number, before))
            after = self.now.to_dict()
            if "model" in changed:
                assert after["model"] == parse_model(
                    json.dumps(changed["model"]), "augmented.yaml"
                ).model_dump(mode="json")
            else:
                assert after["covariates"]["names"] == changed["names"]

    @rule(data=st.data(), late=SELDOM)
    def undo(self, data, late):
        number = data.draw(st.integers(1, len(self.found) + 1))
        given = data.draw(st.sampled_from([*self.seen, self.now])) if late else self.now
        expected = given == self.now and bool(self.stack) and self.stack[-1][0] == number
        assert self.attempt(self.orders.undo, given, number) == expected
        if expected:
            _, before = self.stack.pop()
            assert self.now == before

    @rule()
    def undo_the_last(self):
        if self.stack:
            number, before = self.stack.pop()
            assert self.attempt(self.orders.undo, self.now, number)
            assert self.now == before

    @rule(number=st.integers(0, 9))
    def register_anew(self, number):
        """Somebody gives the twin another registration, with nothing adopted."""
        self.seen = [*self.seen, self.now][-5:]
        self.base, self.stack = registration(f"Frame {number}"), []
        self.pipeline.register(ID, self.base)

    @rule()
    def restart(self):
        self.close()
        self.store = SqliteStore(self.folder / "twin.sqlite")
        self.open()

    @invariant()
    def what_is_adopted_is_the_stack(self):
        assert [one.diagnosis for one in self.now.adopted] == [n for n, _ in self.stack]
        assert self.now.name == self.base.name
        assert self.now.nominal_model == self.base.model
        documents = {one["number"]: one["adopted"] for one in self.orders.all_of(ID)}
        assert {n for n, adopted in documents.items() if adopted} == {n for n, _ in self.stack}
        if not self.stack:
            assert self.now == self.base


@pytest.mark.gate
def test_what_is_adopted_is_undone_in_its_order_and_leaves_no_trace():
    run_share(AdoptionMachine, examples=20)


@pytest.mark.long
def test_adoption_holds_for_as_long_as_is_asked():
    assert run_long(AdoptionMachine) > 0


def _whatever_it_was_asked_of(self, twin_id, before, given, because):
    self._pipeline.register(twin_id, Registration.model_validate(given), *because)


def _undo_the_first(self, twin_id, registration, number):
    given = registration.to_dict()
    given["adopted"] = given["adopted"][1:]
    self._register(twin_id, registration, given, orders.Because("undone", "Undone.", {}))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("where", "name", "fault"),
    [
        (Diagnoses, "_register", _whatever_it_was_asked_of),
        (Diagnoses, "undo", _undo_the_first),
        (Registration, "nominal_model", property(lambda self: self.model)),
        (Diagnoses, "_is_adopted", lambda self, row: row.state == "done"),
    ],
)
def test_the_machine_finds_a_planted_fault(monkeypatch, where, name, fault):
    monkeypatch.setattr(where, name, fault)
    assert_found(AdoptionMachine, examples=20)
