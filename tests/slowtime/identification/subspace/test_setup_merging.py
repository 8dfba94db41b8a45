"""Set-ups merged before identification, against the truth and merging after it."""

import numpy as np
import pytest

from slowtime.identification.subspace.setup_merging import SetUpRecord, merge_before
from tests.slowtime.identification.modal_fit.structures import Structure, frame, response_to

RATE = 32.0
STRUCTURE = frame(4, first_hz=2.0)
PARTS = ((3, 1, 0), (3, 1, 2))


def records(seed, levels=(1.0, 3.0), seconds=400.0):
    rng = np.random.default_rng(seed)
    everywhere = Structure(
        STRUCTURE.frequency_hz, STRUCTURE.damping_ratio, STRUCTURE.shapes, STRUCTURE.shapes
    )
    found = []
    for part, level in zip(PARTS, levels, strict=True):
        force = rng.standard_normal((round(seconds * RATE), 4))
        y = level * response_to(everywhere, force, RATE, padding=2)[:, part]
        y = y + 0.05 * y.std() * rng.standard_normal(y.shape)
        found.append(SetUpRecord(samples=y, channels=tuple(f"s{one}" for one in part)))
    return found


def merged(seed, **given):
    return merge_before(
        records(seed, **given), RATE, ("s3", "s1"), block_rows=20, orders=range(2, 21),
        band_hz=(1.0, 14.0),
    )  # fmt: skip


def true_shape(found, k):
    order = [int(name[1]) for name in found.channels]
    shape = STRUCTURE.shapes[order, k]
    return shape / np.linalg.norm(shape)


def test_whole_shapes_come_back_though_the_excitation_differs():
    found = merged(1)
    assert found.channels == ("s3", "s1", "s0", "s2")
    hz = np.array([mode.frequency_hz.value for mode in found.modes])
    for k, true in enumerate(STRUCTURE.frequency_hz[:3]):
        mode = found.modes[int(np.argmin(np.abs(hz - true)))]
        assert abs(mode.frequency_hz.value - true) < 4.5 * mode.frequency_hz.sd < 0.05 * true
        assert abs(np.vdot(true_shape(found, k), mode.shape)) ** 2 > 0.99


def test_a_set_up_without_the_reference_is_refused():
    first, second = records(2)
    other = SetUpRecord(samples=second.samples, channels=("a", "b", "c"))
    with pytest.raises(ValueError, match=r"Set-up 2 .*lacks the references"):
        merge_before(
            [first, other], RATE, ("s3",), block_rows=10, orders=range(2, 11),
            band_hz=(1.0, 14.0),
        )  # fmt: skip


@pytest.mark.long
def test_errors_of_shapes_are_those_seen_over_seeds():
    ratios = []
    for seed in range(30):
        found = merged(seed, seconds=200.0)
        for mode in found.modes:
            k = int(np.argmin(np.abs(STRUCTURE.frequency_hz - mode.frequency_hz.value)))
            if abs(STRUCTURE.frequency_hz[k] - mode.frequency_hz.value) > 0.1 or k > 2:
                continue
            true = true_shape(found, k)
            true = true * np.sign(true[int(np.argmax(np.abs(mode.shape)))])
            ratios.append(np.abs(mode.shape - true) / mode.shape_sd)
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 2.0
