"""A frame in software only: its truth and its records agree with matrices made by hand."""

import numpy as np
import pytest
import scipy.linalg
from pydantic import TypeAdapter, ValidationError

from slowtime_services.simulate import (
    AnyStructure,
    Linear,
    Machine,
    SensorErrors,
    SimulatedFrame,
    SimulatedStructure,
    StepLoss,
    Temperature,
    Unchanged,
)

SILENT = SensorErrors(noise=0.0, dtype="<f8")


def by_hand(storeys, floors):
    """Frequencies [Hz] and shapes of a shear frame."""
    k = np.array([*storeys, 0.0])
    stiffness = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    squares, shapes = scipy.linalg.eigh(stiffness, np.diag(floors))
    return np.sqrt(squares) / (2 * np.pi), shapes


def record(frame, epoch=0):
    return np.concatenate([block.samples for block in frame.epoch(epoch)]).astype(float)


def densities(frame, epochs):
    """Mean cross-spectral matrix of the channels, at the lines of whole epochs."""
    lines = [
        np.fft.rfft(record(frame, n) * np.hanning(frame.samples)[:, None], axis=0)
        for n in range(epochs)
    ]
    spectra = np.mean([line[:, :, None] * line[:, None, :].conj() for line in lines], axis=0)
    return np.fft.rfftfreq(frame.samples, 1 / frame.rate_hz), spectra


def test_truth_is_that_of_the_matrices_with_each_part_changed_in_its_own_way():
    frame = SimulatedFrame(
        floors_kg=(900.0, 700.0, 500.0),
        storeys_n_per_m=(1.0e6, 0.9e6, 0.5e6),
        damping_ratio=1e-3,
        stiffness={"storey2": Linear(rate=-1e-3)},
        mass={"floor3": StepLoss(at_slow_time=50.0, change=0.2)},
    )
    truth = frame.truth(100)
    expected, _ = by_hand([1.0e6, 0.81e6, 0.5e6], [900.0, 700.0, 600.0])
    found = [truth[f"mode.{n}.frequency_hz"] for n in (1, 2, 3)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert truth["frequency_hz"] == found[0]
    changes = {k: v for k, v in truth.items() if k.startswith(("element", "node"))}
    assert changes == pytest.approx(
        {
            "element.storey1": 0.0,
            "element.storey2": -0.1,
            "element.storey3": 0.0,
            "node.floor3.mass": 0.2,
        }
    )


def test_dampers_stay_as_built_and_give_the_lowest_and_highest_mode_their_ratio():
    frame = SimulatedFrame(
        damping_ratio=0.02, stiffness={f"storey{n}": Unchanged(change=-0.19) for n in (1, 2, 3)}
    )
    built = SimulatedFrame(damping_ratio=0.02).truth(0)
    assert built["damping_ratio"] == pytest.approx(0.02)
    assert built["mode.3.damping_ratio"] == pytest.approx(0.02)
    assert built["mode.2.damping_ratio"] < 0.02
    # All frequencies are 0.9 of what they were; c / (2 m omega) rises as they fall.
    for mode in ("1", "2", "3"):
        ratio = frame.truth(0)[f"mode.{mode}.damping_ratio"]
        assert ratio == pytest.approx(built[f"mode.{mode}.damping_ratio"] / 0.9, rel=1e-9)
    single = SimulatedFrame(floors_kg=(10.0,), storeys_n_per_m=(4e3,), damping_ratio=0.03)
    assert single.truth(0)["damping_ratio"] == pytest.approx(0.03)


def test_records_ring_in_the_modes_of_the_changed_frame():
    frame = SimulatedFrame(
        seconds=120.0,
        rate_hz=50.0,
        damping_ratio=0.005,
        sensor=SILENT,
        stiffness={"storey3": Unchanged(change=-0.3)},
    )
    frequencies, shapes = by_hand([1.2e6, 1.0e6, 0.56e6], [1000.0, 1000.0, 800.0])
    lines, spectra = densities(frame, 12)
    for frequency, shape in zip(frequencies, shapes.T, strict=True):
        near = np.flatnonzero(np.abs(lines - frequency) < 0.05 * frequency)
        peak = near[np.argmax(np.trace(spectra[near], axis1=1, axis2=2).real)]
        assert lines[peak] == pytest.approx(frequency, rel=0.015)
        found = np.linalg.eigh(spectra[peak])[1][:, -1]
        likeness = abs(found @ shape) ** 2 / (shape @ shape)
        assert likeness > 0.98


def test_the_sensors_mean_square_is_that_of_the_resonances_asked_for():
    frame = SimulatedFrame(seconds=60.0, rate_hz=50.0, acceleration_rms=0.2, sensor=SILENT)
    lines, spectra = densities(frame, 25)
    power = np.trace(spectra, axis1=1, axis2=2).real / 3
    resonant = (lines > 1.0) & (lines < 12.0)
    density = power / (np.sum(np.hanning(frame.samples) ** 2) * frame.rate_hz)
    assert 2 * density[resonant].sum() * lines[1] == pytest.approx(0.04, rel=0.15)


def test_an_epoch_is_the_same_however_many_came_before_it_and_another_seed_is_another():
    made = {"seconds": 8.0, "machine": Machine(floor="floor2", frequency_hz=5.0)}
    frame = SimulatedFrame(**made, epochs=4)
    alone = record(frame, 3)
    np.testing.assert_array_equal(
        alone, np.concatenate([b.samples for b in frame.blocks() if b.epoch == 3])
    )
    assert not np.allclose(alone, record(SimulatedFrame(**made, seed=1), 3))


def test_sensors_stand_where_they_are_put_and_spoil_each_channel_by_itself():
    noisy = SensorErrors(noise=0.1, spikes_per_epoch=3.0, dtype="<f8")
    frame = SimulatedFrame(sensors=("floor3", "floor1"), sensor=SILENT)
    spoilt = frame.model_copy(update={"sensor": noisy})
    assert frame.channels == spoilt.epoch(0)[0].channels == ("a_floor3", "a_floor1")
    extra = record(spoilt) - record(frame)
    quiet = np.abs(extra) < 0.06
    assert (extra * quiet).std(axis=0) == pytest.approx([0.01, 0.01], rel=0.1)
    assert abs(np.corrcoef((extra * quiet).T)[0, 1]) < 0.05
    spiked = np.concatenate([record(spoilt, n) - record(frame, n) for n in range(10)])
    where = [set(np.flatnonzero(column > 0.5)) for column in np.abs(spiked).T]
    assert min(map(len, where)) > 10
    assert not where[0] & where[1]
    everywhere = SimulatedFrame(acceleration_rms=frame.acceleration_rms, sensor=SILENT)
    assert everywhere.channels == ("a_floor1", "a_floor2", "a_floor3")


def test_a_machine_adds_a_line_of_its_size_that_is_no_mode():
    machine = Machine(floor="floor2", frequency_hz=4.5, size=2.0)
    quiet = SimulatedFrame(seconds=20.0, sensor=SILENT)
    loud = quiet.model_copy(update={"machine": machine})
    hum = record(loud, 2) - record(quiet, 2)
    assert hum[:, 1].std() == pytest.approx(2.0 * quiet.acceleration_rms, rel=1e-3)
    lines = np.abs(np.fft.rfft(hum, axis=0))
    assert np.fft.rfftfreq(loud.samples, 0.01)[lines.argmax(axis=0)] == pytest.approx(4.5)
    assert loud.truth(2) == quiet.truth(2)
    assert not np.allclose(hum, record(loud, 3) - record(quiet, 3))


def test_a_changed_copy_is_a_changed_frame():
    frame = SimulatedFrame()
    stiffer = frame.model_copy(update={"storeys_n_per_m": (4.8e6, 4.0e6, 3.2e6)})
    assert stiffer.truth(0)["frequency_hz"] == pytest.approx(2 * frame.truth(0)["frequency_hz"])
    assert frame.truth(0)["frequency_hz"] == pytest.approx(
        by_hand(frame.storeys_n_per_m, frame.floors_kg)[0][0]
    )


def test_temperature_softens_every_storey():
    swing = Temperature(swing_c=20.0, period=4.0, stiffness_per_c=-0.005)
    frame = SimulatedFrame(temperature=swing, stiffness={"storey1": Unchanged(change=-0.1)})
    truth = frame.truth(1)
    assert truth["element.storey1"] == pytest.approx(0.9 * 0.9 - 1)
    assert truth["element.storey3"] == pytest.approx(-0.1)
    assert truth["lasting.element.storey1"] == pytest.approx(-0.1)
    assert truth["lasting.element.storey3"] == 0.0


def test_settings_say_which_structure_they_mean_and_an_oscillator_where_they_do_not():
    adapter = TypeAdapter(AnyStructure)
    assert adapter.validate_python({"frequency_hz": 3.0}) == SimulatedStructure(
        frequency_hz=3.0
    )
    for structure in (SimulatedStructure(), SimulatedFrame(sensors=("floor3",))):
        assert adapter.validate_python(adapter.dump_python(structure)) == structure
        assert adapter.validate_json(adapter.dump_json(structure)) == structure
    with pytest.raises(ValidationError, match=r"'tower'.*'oscillator', 'frame'"):
        adapter.validate_python({"kind": "tower"})


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"stiffness": {"storey4": Unchanged()}}, "Name one of: storey1, storey2, storey3"),
        ({"mass": {"storey1": Unchanged()}}, "Name one of: floor1, floor2, floor3"),
        ({"sensors": ("roof",)}, "'roof' is no part of this frame"),
        ({"machine": {"floor": "cellar", "frequency_hz": 3.0}}, "'cellar' is no part"),
        ({"rate_hz": 20.0}, "Sample faster, or simulate a slower structure"),
        ({"floors_kg": (1.0, 2.0)}, "3 storeys for 2 floors"),
        ({"floors_kg": (1.0, 2.0, -3.0)}, "greater than 0"),
    ],
)
def test_a_frame_that_cannot_be_says_why(wrong, says):
    with pytest.raises(ValidationError, match=says):
        SimulatedFrame(**wrong)
