"""A thermal camera has seen which joint warms: what it says, as a proposer of the diagnosis."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.proposers import PROPOSERS, Proposal, Round
from slowtime.discrepancy.search import SearchOptions
from slowtime_services.diagnose.campaign import campaign_of
from slowtime_services.diagnose.sources import read_any
from slowtime_services.models import read_description, run_model


@dataclasses.dataclass(frozen=True)
class ThermalCamera:
    """Proposes friction in the joint that warms most [K]."""

    rise_k: Mapping[str, float]
    name: str = "thermal camera"

    def __call__(self, given: Round) -> Proposal:
        """Propose laws of friction along the motion that was recovered in that joint."""
        warmest = max(self.rise_k, key=lambda joint: self.rise_k[joint])
        there = [one for one in given.tried if one.effect.place.id == warmest]
        rubbing = [one for one in there if given.kinds[one.effect.kind].family == "friction"]
        return Proposal(self.name, tuple(rubbing), only=True)


def main() -> None:
    """Measure a rig whose second joint rubs, and diagnose it with what the camera saw."""
    model, rng = read_description("rig.yaml"), np.random.default_rng(1)
    rubs = {"effect": "coulomb", "element": "j2", "friction_n": 0.5}
    push = np.repeat(rng.normal(0.0, 3.0, 600), 5)
    seen = run_model(dataclasses.replace(model, effects=(rubs,)), {"u": push}, 100.0)
    noisy = {name: a + 0.02 * rng.standard_normal(len(a)) for name, a in seen.items()}
    arrays: Any = {"rate_hz": 100.0, "u": push, **noisy}
    np.savez("record.npz", **arrays)
    campaign, _ = campaign_of(model, [read_any("record.npz")])
    camera = ThermalCamera({"j1": 0.1, "j2": 1.4})
    options = SearchOptions(proposers=(camera, *PROPOSERS))
    print(diagnose(campaign, options=options).sentence)


if __name__ == "__main__":
    main()
