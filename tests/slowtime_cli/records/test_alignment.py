import json

import numpy as np
import pytest

from slowtime.identification.mode_shapes.criteria import mac
from tests.slowtime.identification.clock_alignment.boards import Structure, motion

RATE_HZ, SECONDS = 100.0, 120.0


@pytest.fixture
def boards(tmp_path):
    """Two files of three places each, 20 ms and 50 ppm apart; the shapes of the structure."""
    rng = np.random.default_rng(4)
    structure = Structure(shapes=rng.normal(size=(6, 3)))
    moved = motion(rng, structure, SECONDS, 60.0)
    count = int(RATE_HZ * SECONDS)
    one = moved.sampled(RATE_HZ, 1.0, count)[:, :3]
    two = moved.sampled(RATE_HZ * (1 + 50e-6), 1.02, count)[:, 3:]
    for name, samples in (("deck", one), ("tower", two)):
        noisy = samples + 0.03 * samples.std() * rng.normal(size=samples.shape)
        np.save(tmp_path / f"{name}.npy", noisy)
    return structure.shapes


def test_modes_over_two_boards_have_the_shapes_of_the_structure(run, boards):
    done = run(
        *("identify", "deck.npy", "--with", "tower.npy", "--rate-hz", RATE_HZ),
        *("--band-hz", 1, 20, "--method", "modes", "--out", "modes.json"),
    )
    assert done.status == 0, done.err
    assert "Aligned: the second board starts +" in done.err
    with open("modes.json") as file:
        found = json.load(file)
    assert len(found["channels"]) == 6
    assert any("Aligned" in said for said in found["assumptions"])
    shapes = [
        np.array(mode["shape"]["re"]) + 1j * np.array(mode["shape"]["im"])
        for mode in found["modes"]
    ]
    assert len(shapes) == 3
    assert all(mac(shape, true) > 0.99 for shape, true in zip(shapes, boards.T, strict=True))


def test_boards_without_common_motion_are_refused_with_the_reason(refused, boards, tmp_path):
    np.save(tmp_path / "else.npy", np.random.default_rng(1).normal(size=(12_000, 2)))
    said = refused("identify", "deck.npy", "--with", "else.npy", "--rate-hz", RATE_HZ)
    assert "no mode is seen by both boards in common motion" in said
