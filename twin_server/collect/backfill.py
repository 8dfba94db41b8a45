"""Asks edges for missing features until the account is complete."""

import concurrent.futures
import itertools
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence

from slowtime_schemas.messages import ACK_VERSION
from slowtime_schemas.quantities import SEQUENCES
from slowtime_schemas.streams import FEATURES, request_key
from slowtime_services.bus import Bus, BusClosedError, Sample
from slowtime_services.documents.json_documents import read_json
from twin_server.settings import BackfillSettings

from .runs import MOST_AT_ONCE, EdgeQuery, Holding

logger = logging.getLogger(__name__)

MOST_ANSWER_BYTES = 16 * 2**20
"""Bytes of one answer: `MOST_AT_ONCE` features of 3 KiB. What is beyond is asked for again."""

MOST_LISTED = 20_000
"""Boots of an edge's account that are looked at, oldest first, of some 100 bytes each: twice
what an asset may have. Those beyond are listed again once these are acknowledged."""

BOOT = re.compile(r"[0-9A-Za-z][0-9A-Za-z._-]{0,63}")
"""Name of a boot, as in messages."""

MOST_DAMAGED = 1_000
"""Damaged ranges of a boot that are looked at; an edge agent lists as many."""

SLOW_S = 1.0
"""An edge that took longer to answer is asked in a queue of its own kind [s]."""

QUICK_ASKERS, SLOW_ASKERS = 8, 4
"""Threads that ask: of a hundred edges that answer in 50 ms each is asked within a second."""

Wants = Callable[[], Sequence[EdgeQuery]]
Take = Callable[[EdgeQuery, Sequence[Sample]], tuple[bool, bool]]
Settle = Callable[[EdgeQuery, Sequence[Holding] | None, bool], None]


class Backfill:
    """A few threads that put the account's questions to the edges.

    Parameters
    ----------
    wants
        Lists what to ask now.
    take
        Takes the features that came in answer; says whether the first asked for is missing
        still, and whether all could be judged: not where the edge's clock is off for now.
    settle
        Concludes, soon: from what the edge says it holds, None where that was not asked, and
        from whether all was answered without error.
    """

    def __init__(
        self, bus: Bus, settings: BackfillSettings, wants: Wants, take: Take, settle: Settle
    ) -> None:
        self._bus, self._settings = bus, settings
        self._wants, self._take, self._settle = wants, take, settle
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="backfill", daemon=True)
        # A frozen edge answers nothing until the timeout; the others shall not wait for it.
        self._askers = concurrent.futures.ThreadPoolExecutor(QUICK_ASKERS, "ask")
        self._slow_askers = concurrent.futures.ThreadPoolExecutor(SLOW_ASKERS, "ask-slow")
        self._slow: set[tuple[str, str]] = set()
        self.asked = 0

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wake(self) -> None:
        """Check for queries now: after one missing range, another may be missing."""
        self._wake.set()

    def stop(self) -> None:
        """Send no more queries, and wait for those in progress."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        for askers in (self._askers, self._slow_askers):
            askers.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                for want in self._wants():
                    is_slow = (want.site, want.asset) in self._slow
                    (self._slow_askers if is_slow else self._askers).submit(self._ask, want)
            except Exception:
                logger.exception("Listing the missing features failed; continuing.")
            self._wake.wait(0.05)
            self._wake.clear()

    def _ask(self, want: EdgeQuery) -> None:
        """Query features first; if they do not suffice, query what the edge holds."""
        self.asked += 1
        began_s = time.monotonic()
        listing: list[Holding] | None = None
        try:
            missing, sound = self._features(want) if want.boot else (True, True)
            if missing:
                listing, answered = self._account(want)
                sound = sound and answered
        except BusClosedError:
            return
        except Exception:
            logger.exception("The query to %s.%s failed; trying again.", want.site, want.asset)
            listing, sound = None, False
        if time.monotonic() - began_s > SLOW_S:
            self._slow.add((want.site, want.asset))
        else:
            self._slow.discard((want.site, want.asset))
        self._settle(want, listing, sound)

    def _features(self, want: EdgeQuery) -> tuple[bool, bool]:
        """Whether the first asked for is missing still, and whether all was answered."""
        answers = self._bus.ask(
            request_key(want.site, want.asset, "features"),
            {"boot": want.boot, "first": str(want.first), "last": str(want.last)},
            timeout_s=self._settings.ask_timeout_s,
            max_bytes=MOST_ANSWER_BYTES,
        )
        key = FEATURES.key(want.site, want.asset)
        samples = [
            answer._replace(replayed=want.replayed)
            for answer in itertools.islice(answers, MOST_AT_ONCE)
            if answer.key == key
        ]
        missing, judged = self._take(want, samples)
        return missing, judged and not answers.errors

    def _account(self, want: EdgeQuery) -> tuple[list[Holding], bool]:
        answers = self._bus.ask(
            request_key(want.site, want.asset, "account"),
            timeout_s=self._settings.ask_timeout_s,
            max_bytes=MOST_ANSWER_BYTES,
        )
        looked_at = itertools.islice(answers, MOST_LISTED)
        listing = [entry for entry in map(_holding, looked_at) if entry is not None]
        return listing, not answers.errors and len(listing) == len(answers)


def _holding(answer: Sample) -> Holding | None:
    """Read one entry of an edge's account; None, and logged, where it makes no sense."""
    try:
        content = read_json(bytes(answer.payload))
        listed = content.get("damaged", ())[:MOST_DAMAGED]
        damaged = tuple((int(a), int(b)) for a, b in listed)
        holding = Holding(
            str(content["boot"]),
            int(content["first"]),
            int(content["last"]),
            damaged,
            int(content.get(ACK_VERSION, 1)),
            content.get("withheld") is True,
        )
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError) as error:
        said = answer.payload[:200]
        logger.warning("An account on %s is invalid: %.200r (%r)", answer.key, error, said)
        return None
    numbers = (holding.first, holding.last + 1, *(n for part in damaged for n in part))
    if all(0 <= number <= SEQUENCES for number in numbers) and BOOT.fullmatch(holding.boot):
        return holding
    logger.warning(
        "An account on %s holds a sequence or a boot that is not allowed: %r. Sequences are "
        "from 0 to 2^40; boots are as in the schema of messages.",
        answer.key,
        answer.payload[:200],
    )
    return None
