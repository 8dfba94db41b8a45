"""Messages that nobody should send: each is refused with a reason, or can be used."""

import random
from pathlib import Path

from slowtime_schemas.codec import Refused, decode_sample, encode
from slowtime_schemas.messages import Features, Health, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ACK, EVENT, FEATURES, HEALTH, RAW, REGISTRATION, STATE
from slowtime_services.bus import Sample
from twin_server.collect import Reception, Refusals
from twin_server.settings import AdmissionSettings

from .mutate import WORST, mutated

GOLDEN = Path(__file__).parents[2] / "schemas/golden"
NOW_NS = 1_800_000_000 * 10**9


def _good() -> list[tuple[str, list[bytes]]]:
    """Keys, and payloads that are right on them."""
    beam = {"site": "lab", "asset": "beam-1", "boot": "b1", "sequence": 0, "t_ns": NOW_NS}
    features = Features(
        **beam,
        start_ns=NOW_NS,
        slow_time=0.0,
        time_base="live",
        method="ambient",
        modes=(
            Mode(
                frequency_hz=Quantity(value=3.0, sd=0.002),
                damping_ratio=Quantity(value=0.02, sd=0.001),
            ),
        ),
        quality=Quality(samples=1000),
    )
    health = Health(**beam, first_held=0, last_sequence=3, uptime_s=1.0, counters={"blocks": 3})
    found = []
    for stream in (FEATURES, HEALTH, REGISTRATION, RAW, ACK, EVENT, STATE):
        paths = sorted((GOLDEN / stream.name).iterdir())
        kept = [path.read_bytes() for path in paths]
        kept += [encode(features)] * (stream is FEATURES) + [encode(health)] * (
            stream is HEALTH
        )
        found.append((stream.key("lab", "beam-1"), kept))
    return found


GOOD = _good()
KEYS = [key for key, _ in GOOD] + [
    "slowtime/v2/lab/features/1/beam", "slowtime/v2/lab/features/174",
    "slowtime/v2/lab/alive/0/a", "slowtime/v1/lab/beam",
    "slowtime/v1/lab/beam/features/x", "slowtime/v9/a/b/features", "",
    "slowtime/v1/LAB/../features", "slowtime/v1/a/b/" + "x" * 5_000, "a\x00b",
]  # fmt: skip


def case(rng: random.Random) -> Sample:
    """One sample that may be anything."""
    key, good = GOOD[min(rng.randrange(12), len(GOOD) - 1) if rng.random() < 0.5 else 0]
    if rng.random() < 0.05:
        key = rng.choice(KEYS)
    payload = mutated(good, rng) if rng.random() < 0.97 else rng.choice(WORST)
    sent = rng.choice([None, NOW_NS, NOW_NS, NOW_NS, 0, 2**64 - 1])
    return Sample(key, payload, sent, rng.random() < 0.7)


def run(cases: int, seed: int) -> dict[str, int]:
    """Read `cases` of them; what came of it, by kind. Raises what the reading raised."""
    rng, counts = random.Random(seed), {"accepted": 0, "refused": 0}
    reception, longest = Reception(AdmissionSettings(), Refusals()), 0
    for number in range(cases):
        sample = case(rng)
        try:
            received = reception.read([sample], NOW_NS)
            counts["accepted" if any(received) else "refused"] += 1
            decode_sample(sample.key, sample.payload)
        except Refused as refused:
            longest = max(longest, len(str(refused)))
        except BaseException:
            _keep(number, seed, sample)
            raise
    assert longest < 3_000, "a refusal as long as what it refuses"
    return counts


def _keep(number: int, seed: int, sample: Sample) -> None:
    print(
        f"case {number} of seed {seed}: key {sample.key!r}, payload {sample.payload[:2000]!r}"
    )


def accepted(cases: int, seed: int) -> list[Sample]:
    """Of so many cases, those that were let in: what the estimators then have to stand."""
    rng = random.Random(seed)
    reception = Reception(AdmissionSettings(), Refusals())
    made = (case(rng) for _ in range(cases))
    return [sample for sample in made if any(reception.read([sample], NOW_NS))]
