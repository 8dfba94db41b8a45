"""Asks edges for missing features until the account is complete."""

import concurrent.futures
import logging
import threading
from collections.abc import Callable, Sequence

from slowtime_schemas.messages import ACK_VERSION
from slowtime_schemas.streams import request_key
from slowtime_services.bus import Bus, BusClosedError, Sample
from slowtime_services.documents.json_documents import read_json
from twin_server.settings import BackfillSettings

from .runs import SEQUENCES, EdgeQuery, Holding

logger = logging.getLogger(__name__)

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
        self._askers = concurrent.futures.ThreadPoolExecutor(4, "ask")
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
        self._askers.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                for want in self._wants():
                    self._askers.submit(self._ask, want)
            except Exception:
                logger.exception("Listing the missing features failed; continuing.")
            self._wake.wait(0.05)
            self._wake.clear()

    def _ask(self, want: EdgeQuery) -> None:
        """Query features first; if they do not suffice, query what the edge holds."""
        self.asked += 1
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
        self._settle(want, listing, sound)

    def _features(self, want: EdgeQuery) -> tuple[bool, bool]:
        """Whether the first asked for is missing still, and whether all was answered."""
        answers = self._bus.ask(
            request_key(want.site, want.asset, "features"),
            {"boot": want.boot, "first": str(want.first), "last": str(want.last)},
            timeout_s=self._settings.ask_timeout_s,
        )
        samples = [answer._replace(replayed=want.replayed) for answer in answers]
        missing, judged = self._take(want, samples)
        return missing, judged and not answers.errors

    def _account(self, want: EdgeQuery) -> tuple[list[Holding], bool]:
        answers = self._bus.ask(
            request_key(want.site, want.asset, "account"),
            timeout_s=self._settings.ask_timeout_s,
        )
        listing = [entry for entry in map(_holding, answers) if entry is not None]
        return listing, not answers.errors and len(listing) == len(answers)


def _holding(answer: Sample) -> Holding | None:
    """Read one entry of an edge's account; None, and logged, where it makes no sense."""
    try:
        content = read_json(bytes(answer.payload))
        damaged = tuple((int(a), int(b)) for a, b in content.get("damaged", ()))
        holding = Holding(
            str(content["boot"]),
            int(content["first"]),
            int(content["last"]),
            damaged,
            int(content.get(ACK_VERSION, 1)),
            content.get("withheld") is True,
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        logger.warning("An account on %s is invalid: %r (%s)", answer.key, error, answer)
        return None
    return holding if 0 <= holding.first < SEQUENCES and holding.last < SEQUENCES else None
