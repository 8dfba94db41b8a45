"""A twin server that answers from lists, without a network."""

import pytest

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import STATE_EXAMPLE, RegisteredTwin, State
from slowtime_services.client import AnswerError

TWIN = "demo.tower"


def state(sequence, boot="b1"):
    told = {**STATE_EXAMPLE, "boot": boot, "sequence": sequence, "t_ns": 10**9 * sequence}
    return State.model_validate(told)


def event(number, kind="features_lost"):
    return EventModel(
        number=number, event_id=f"e{number}", id=TWIN, boot="b1", sequence=0, t_ns=number,
        slow_time=None, kind=kind, severity="info", message="Said.", details={},
    )  # fmt: skip


class Server:
    """Histories of one twin, as the client tells them."""

    def __init__(self):
        self.states, self.given_events, self.asked = [], [], 0

    def twins(self):
        empty = dict.fromkeys(RegisteredTwin.model_fields) | {
            "id": TWIN, "valid": True, "reasons": [], "alive": True, "registration": {},
            "t_ns": self.states[-1].t_ns if self.states else None, "normal": [], "modes": [],
            "elements": {}, "posterior_to_prior": {}, "suspects": [], "channels": [],
            "raised": [], "aside": 0,
        }  # fmt: skip
        return [RegisteredTwin.model_validate(empty)]

    def history(self, twin_id, *, start, max_points):
        return [one for one in self.states if one.t_ns >= int(start)]

    def history_after(self, twin_id, position=":0", *, limit):
        self.asked += 1
        boot, _, sequence = position.rpartition(":")
        if not boot:
            return self.states[:limit]
        places = [n for n, one in enumerate(self.states) if one.boot == boot]
        if not places:
            raise AnswerError(404, "no-such-boot", "There is none.")
        first = next(
            (n + 1 for n in reversed(places) if self.states[n].sequence <= int(sequence)), 0
        )
        return self.states[first : first + limit]

    def events(self, twin_id, *, after=None, limit):
        if after is None:
            return self.given_events[-limit:]
        return [one for one in self.given_events if one.number > after][:limit]


@pytest.fixture
def server():
    return Server()
