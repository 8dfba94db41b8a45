"""What one twin of a fleet costs in estimation and in its checkpoint, as ratios.

`python -m benchmarks.processes.fleet [--twins 8000]` takes about half a minute. Estimation: the
time a twin in a batch of the whole fleet to that in a batch of a sixteenth of it; 1 means that
the cost is linear in the number of twins. Once where all registrations are alike, and once
where each has priors of its own. Checkpoints: the time of `dataclasses.asdict` and `json.dumps`
to that of `Checkpoint.to_json`, for the same text.
"""

import argparse
import dataclasses
import json
import random
import sys
import time
import timeit

from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.estimate.checkpoint import NominalInUse, SteadyFlag
from twin_server.registration.twin import Registration

CHECKPOINT_US = 20.0
"""Aim for the checkpoint of a twin in use [us]."""

LINEAR = 1.5
"""Aim for the ratio of the times of a twin [1]; batches of a few twins have fixed costs too."""


def features_of(count: int) -> list[Features]:
    """Make the next features of each of `count` twins."""
    rng = random.Random(1)
    made = []
    for number in range(count):
        mode = Mode(
            frequency_hz=Quantity(value=3.0 + 1e-3 * rng.gauss(0.0, 1.0), sd=2e-3),
            damping_ratio=Quantity(value=0.02, sd=1e-3),
        )
        made.append(
            Features(
                site="lab", asset=f"a{number}", boot="b1", sequence=0, t_ns=10**18,
                start_ns=0, slow_time=0.0, method="ambient", modes=(mode,),
                quality=Quality(samples=1000),
            )
        )  # fmt: skip
    return made


def time_of_twin_us(twins: int, *, own_priors: bool) -> float:
    """Processor time of one estimate in a batch of `twins` [us]; the least of three."""
    fleet = []
    for number in range(twins):
        registration = Registration.model_validate(
            {
                "changes": "both",
                "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                "prior_stiffness_sd": 0.1 + number * 1e-6 * own_priors,
            }
        )
        fleet.append(Twin(registration, Checkpoint.start(registration)))
    features = features_of(twins)
    times = []
    for _ in range(3):
        began = time.process_time()
        estimate(fleet, features, range(twins), [0] * twins)
        times.append(time.process_time() - began)
    return 1e6 * min(times) / twins


def checkpoints() -> dict[str, Checkpoint]:
    """Checkpoints of a twin in use, and of one that is still learning."""
    registration = Registration()
    begun = Checkpoint.start(registration)
    epochs = tuple((3.0 + i / 7, 1e-3 + i / 7e6, 0.02 + i / 7e5, 1e-3) for i in range(30))
    used = NominalInUse(3.0123456, 0.001234, 0.0212345, 0.0312345)
    return {
        "in use": dataclasses.replace(begun, known=used, raised=(SteadyFlag(False),) * 2),
        "learning from 30 epochs": dataclasses.replace(begun, learning=epochs),
    }


def _least_us(function: object) -> float:
    number = 200
    return 1e6 * min(timeit.repeat(function, number=number, repeat=20)) / number  # type: ignore[arg-type]


def main() -> int:
    """Print a line for each comparison; 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description="Costs of the twins of a fleet.")
    parser.add_argument("--twins", type=int, default=8_000)
    twins = parser.parse_args().twins
    missed = False
    for own_priors in (False, True):
        few = time_of_twin_us(twins // 16, own_priors=own_priors)
        many = time_of_twin_us(twins, own_priors=own_priors)
        missed |= many / few > LINEAR
        print(
            f"estimate, priors {'of each twin' if own_priors else 'alike':<13} "
            f"{twins // 16:>6} twins {few:7.1f} us a twin, {twins:>6} twins {many:7.1f}, "
            f"ratio {many / few:5.2f} (aim at most {LINEAR})"
        )
    for name, checkpoint in checkpoints().items():
        ours = _least_us(checkpoint.to_json)
        plain = _least_us(lambda c=checkpoint: json.dumps(dataclasses.asdict(c)))
        missed |= name == "in use" and ours > CHECKPOINT_US
        print(
            f"checkpoint {name}: {ours:.1f} us (aim {CHECKPOINT_US:.0f} in use), "
            f"asdict and dumps {plain:.1f} us, ratio {plain / ours:.1f}"
        )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
