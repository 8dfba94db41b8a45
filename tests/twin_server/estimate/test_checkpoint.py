"""Checkpoints: the same text as that of the standard library's way, and back."""

import dataclasses
import json
import math

import numpy as np
import pytest

from twin_server.estimate.checkpoint import Checkpoint, NominalInUse, SteadyFlag, Twin
from twin_server.estimate.covariates import Training
from twin_server.estimate.elements.memory import Baseline, ElementMemory, Reference
from twin_server.estimate.estimator import estimate
from twin_server.registration.twin import Registration

NORMAL = NominalInUse(3.0 + 1e-15, 1e-3, math.pi, 0.1)
CHECKPOINTS = {
    "new": Checkpoint(),
    "in use": Checkpoint(
        known=NORMAL, raised=(SteadyFlag(True, 3), SteadyFlag(False)), renewals=2.0
    ),
    "learning": Checkpoint(learning=((3.0, 0.1, 0.02, 1e-3), (1 / 3, 1e-300, 0.0, 5e300))),
    "in training": Checkpoint(training=Training().added(np.array([0.0, 3.0, 0.1, 0.02, 0.0]))),
    "of elements": Checkpoint(
        elements=ElementMemory(
            references=(Reference(3.0, (0.1, 0.2)), Reference(9.0, None, "b", 2)),
            baselines=(Baseline(0, 3.0, 1e-3, 0.02, 0.1, (0.6, 0.8), (0.01, 0.02)),),
        )
    ),
}


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoint_is_written_as_the_standard_library_writes_its_fields_and_read_back(name):
    checkpoint = CHECKPOINTS[name]
    assert checkpoint.to_json() == json.dumps(dataclasses.asdict(checkpoint))
    assert Checkpoint.from_json(checkpoint.to_json()) == checkpoint


def test_twins_of_many_kinds_in_one_batch_have_the_states_of_each_alone(features, frame):
    elements = Registration.model_validate(frame().registration())
    registrations = [
        elements
        if number % 7 == 3
        else Registration.model_validate(
            {
                "changes": ("both", "stiffness", "mass")[number % 3],
                "nominal": {"frequency_hz": 3.0 + number / 100, "damping_ratio": 0.02},
                "prior_stiffness_sd": 0.1 + number / 1000,
                "damping_coefficient_sd": 0.01 * (number % 4),
            }
        )
        for number in range(24)
    ]
    twins = [Twin(one, Checkpoint.start(one)) for one in registrations]
    owners = [*range(24), *range(23, -1, -1)]
    messages = [
        features(row // 24, frequency_hz=2.9 + 0.01 * owner, damping=0.02 + 1e-4 * owner)
        for row, owner in enumerate(owners)
    ]
    together = estimate(twins, messages, owners, [0] * 48)
    for number, twin in enumerate(twins):
        rows = [row for row, owner in enumerate(owners) if owner == number]
        alone = estimate([twin], [messages[row] for row in rows], [0] * 2, [0] * 2)
        assert together.states[rows].tobytes() == alone.states.tobytes()
        assert together.checkpoints[number] == alone.checkpoints[0]
