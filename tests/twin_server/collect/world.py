"""An account, the spool of an edge, and a clock that is moved by hand."""

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from twin_server.collect import Account, Arrival, Holding, StoreChange
from twin_server.settings import BackfillSettings

HEALING = BackfillSettings(
    grace_s=1.0, backoff_s=1.0, max_backoff_s=4.0, tries=2, foreign_patience_s=5.0, max_held=50
)


class World:
    """An account, an edge's spool, and a clock that is moved by hand."""

    def __init__(self, make, *, alone=False, max_jump=1000, max_boots=100):
        self.make = make
        self.account = Account(HEALING, max_jump=max_jump, max_boots=max_boots, alone=alone)
        self.now_s = 0.0
        self.spool: dict[str, set[int]] = {}
        self.order: list[tuple[str, int]] = []
        self.changes = StoreChange()
        self.reachable = True
        self.asked = 0
        self.damaged: tuple[tuple[int, int], ...] = ()

    def note(self, change):
        self.order += [(o.run.boot, o.features.sequence) for o in change.ordered]
        for name in (
            "ordered",
            "held",
            "released",
            "lost",
            "refused",
            "rivals",
            "doubted",
            "limits",
        ):
            getattr(self.changes, name).extend(getattr(change, name))
        self.changes.touched.update(change.touched)

    def arrive(self, *which):
        change = StoreChange()
        self.account.take([self.arrival(*one) for one in which], self.now_s, change)
        self.note(change)
        return change

    def arrival(self, boot, sequence, **more):
        # A millisecond each, so that the largest sequence has a time too.
        t_ns = more.pop("t_ns", 1_767_225_600_000_000_000 + sequence * 10**6)
        message = self.make(sequence, boot=boot, t_ns=t_ns, **more)
        return Arrival(message, encode(message))

    def health(self, boot, last, first_held=0, uptime_s=1.0, t_s=1000):
        change = StoreChange()
        message = Health(
            site="lab", asset="beam", boot=boot, sequence=0, t_ns=t_s * 10**9,
            last_sequence=last, first_held=first_held, uptime_s=uptime_s,
        )  # fmt: skip
        self.account.hear([(message, False)], self.now_s, change)
        self.note(change)

    def alive(self, alive=True):
        self.account.watch("lab", "beam", alive=alive)

    def heal(self, rounds=40, step_s=1.0):
        """Let time pass, and answer the account's questions as an edge would."""
        for _ in range(rounds):
            for want in self.account.wants(self.now_s):
                self.asked += 1
                listing = None
                if want.boot and self.reachable:
                    kept = self.spool.get(want.boot, ())
                    self.arrive(
                        *((want.boot, s) for s in sorted(kept) if want.first <= s <= want.last)
                    )
                if not want.boot or self.account.still_missing(want):
                    listing = self.listing() if self.reachable else []
                change = StoreChange()
                self.account.settle(want, listing, self.now_s, change, sound=self.reachable)
                self.note(change)
            self.now_s += step_s

    def listing(self):
        ends = [n for _, n in self.damaged]
        return [
            Holding(boot, min(kept), max([*kept, *ends]), self.damaged)
            for boot, kept in self.spool.items()
            if kept
        ]

    @property
    def reasons(self):
        return [reason for reason, _ in self.changes.refused]

    @property
    def lost(self):
        return [(lost.run.boot, lost.first, lost.last) for lost in self.changes.lost]
