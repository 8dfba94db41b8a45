"""Set-ups that share reference sensors: one structure, whose parts fit or are said not to."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Structure
from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.bayes import bayesian_modes
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.agreement import weighted_mean
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.mode_shapes.merging import SetUp, merge
from slowtime.identification.modes import Mode

TRUE = np.array([0.5, 0.9, 0.3, -0.4, 0.8, -0.6])
NAMES = tuple("abcdef")
PARTS = ("abc", "abd", "abef")


def mode(hz, shape, *, sd=0.01, sd_hz=0.01, damping=0.01, kind="structural", flags=()):
    shape = np.asarray(shape, dtype=complex)
    return Mode(
        frequency_hz=Measured(hz, sd_hz),
        damping_ratio=Measured(damping, 0.002),
        correlation=0.3,
        shape=shape,
        shape_sd=np.full(len(shape), sd),
        kind=kind,
        flags=flags,
    )


def part(rng, names, *, sd=0.01, hz=2.0, true=TRUE, sd_hz=0.01):
    """What a set-up makes of its part of the shape: of unit norm, turned, and a bit off."""
    exact = true[[NAMES.index(name) for name in names]]
    exact = exact / np.linalg.norm(exact)
    off = sd / np.sqrt(2.0) * (rng.standard_normal((len(names), 2)) @ [1.0, 1.0j])
    seen = (exact + off) * np.exp(1j * rng.uniform(0, 2 * np.pi))
    found = mode(hz + sd_hz * rng.standard_normal(), seen, sd=sd, sd_hz=sd_hz)
    return SetUp(modes=[found], channels=tuple(names))


def whole_of(merged):
    at = [merged.channels.index(name) for name in NAMES]
    return merged.mode.shape[at], merged.mode.shape_sd[at]


def test_parts_without_errors_give_the_whole_exactly():
    rng = np.random.default_rng(1)
    setups = [part(rng, names, sd=0.0, sd_hz=1e-9) for names in PARTS]
    (merged,) = merge(setups, references=("a", "b"))
    assert set(merged.channels) == set(NAMES)
    assert merged.channels[:2] == ("a", "b")
    assert merged.setups == (0, 1, 2)
    shape, _ = whole_of(merged)
    np.testing.assert_allclose(shape, TRUE / np.linalg.norm(TRUE), atol=1e-9)


def test_the_whole_is_off_by_as_much_as_it_says_and_parts_agree():
    rng = np.random.default_rng(2)
    off, said, p = [], [], []
    unit = TRUE / np.linalg.norm(TRUE)
    for _ in range(150):
        (merged,) = merge([part(rng, names, sd=0.02) for names in PARTS], ("a", "b"))
        shape, sd = whole_of(merged)
        off.append(np.abs(shape - unit) ** 2)
        said.append(sd**2)
        p.append([merged.shape.p_value, merged.frequency.p_value])
    ratio = np.mean(off, axis=0) / np.mean(said, axis=0)
    assert (ratio > 0.7).all()
    assert (ratio < 1.4).all()
    refused = np.mean(np.array(p) < 0.05, axis=0)
    assert (refused < 0.11).all()
    assert (np.abs(np.mean(p, axis=0) - 0.5) < 0.1).all()


def test_the_covariance_is_that_of_all_parts_at_once_by_differences():
    rng = np.random.default_rng(3)
    setups = []
    for names in PARTS:
        (exact,) = part(rng, names, sd=0.0).modes
        unsure = dataclasses.replace(exact, shape_sd=np.full(len(names), 0.003))
        setups.append(SetUp(modes=[unsure], channels=tuple(names)))
    (merged,) = merge(setups, ("a", "b"))
    variance = np.zeros(len(merged.channels))
    for number, setup in enumerate(setups):
        (given,) = setup.modes
        for j in range(len(setup.channels)):
            for step in (1e-6, 1e-6j):
                moved = given.shape.copy()
                moved[j] += step
                changed = dataclasses.replace(given, shape=moved)
                again = [*setups]
                again[number] = SetUp(modes=[changed], channels=setup.channels)
                slope = (merge(again, ("a", "b"))[0].mode.shape - merged.mode.shape) / 1e-6
                variance += np.abs(slope) ** 2 * 0.003**2 / 2
    np.testing.assert_allclose(merged.mode.shape_sd, np.sqrt(variance), rtol=2e-2)


def test_the_order_of_set_ups_does_not_matter():
    rng = np.random.default_rng(4)
    setups = [part(rng, names, sd=0.02) for names in PARTS]
    one, other = merge(setups, ("a", "b"))[0], merge(setups[::-1], ("a", "b"))[0]
    for first, second in zip(whole_of(one), whole_of(other), strict=True):
        np.testing.assert_allclose(first, second, atol=1e-7)
    assert one.mode.frequency_hz == pytest.approx(other.mode.frequency_hz)
    assert one.shape.chi_square == pytest.approx(other.shape.chi_square, rel=1e-6)


def test_a_frequency_that_differs_between_set_ups_is_flagged_and_less_sure():
    rng = np.random.default_rng(5)
    same = [part(rng, names, sd_hz=1e-3) for names in PARTS]
    warm = [*same[:2], part(rng, PARTS[2], hz=2.02, sd_hz=1e-3)]
    (alike,), (apart,) = merge(same, ("a", "b")), merge(warm, ("a", "b"))
    assert alike.frequency.holds
    assert "frequencies_disagree" not in alike.mode.flags
    assert not apart.frequency.holds
    assert "frequencies_disagree" in apart.mode.flags
    assert apart.mode.frequency_hz.sd > 8 * alike.mode.frequency_hz.sd
    low, high = apart.mode.frequency_hz.interval()
    assert low < 2.0 < high


def test_shapes_that_do_not_fit_at_the_references_are_flagged_and_less_sure():
    rng = np.random.default_rng(6)
    changed = TRUE * [1.0, 0.85, 1.0, 1.0, 1.0, 1.0]
    same = [part(rng, names, sd=0.005) for names in PARTS]
    odd = [*same[:2], part(rng, PARTS[2], sd=0.005, true=changed)]
    (alike,), (apart,) = merge(same, ("a", "b")), merge(odd, ("a", "b"))
    assert "shapes_disagree" not in alike.mode.flags
    assert "shapes_disagree" in apart.mode.flags
    assert (whole_of(apart)[1] > 2 * whole_of(alike)[1]).all()


def test_a_part_whose_references_hardly_move_is_hardly_known():
    rng = np.random.default_rng(7)
    node = TRUE * [0.02, 0.03, 1.0, 1.0, 1.0, 1.0]
    (merged,) = merge([part(rng, names, true=node) for names in PARTS], ("a", "b"))
    _, sd = whole_of(merged)
    assert sd[3] > 0.1


def test_modes_of_one_frequency_are_told_by_their_references():
    rng = np.random.default_rng(8)
    other = TRUE * [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    setups = []
    for k, names in enumerate(PARTS):
        both = [part(rng, names), part(rng, names, hz=2.01, true=other)]
        modes = [setup.modes[0] for setup in both]
        setups.append(SetUp(modes=modes[:: 1 if k else -1], channels=tuple(names)))
    merged = merge(setups, ("a", "b"))
    assert len(merged) == 2
    found = [whole_of(each)[0] for each in merged]
    for true in (TRUE, other):
        assert max(mac(shape, true) for shape in found) > 0.995


def test_a_mode_that_one_set_up_missed_is_known_at_the_channels_of_the_others():
    rng = np.random.default_rng(9)
    setups = [part(rng, names) for names in PARTS]
    setups[1] = SetUp(modes=[], channels=setups[1].channels)
    (merged,) = merge(setups, ("a", "b"))
    assert merged.setups == (0, 2)
    assert set(merged.channels) == set("abcef")


def test_lines_of_machines_are_left_out():
    line = mode(3.0, [1.0, 0.0], kind="harmonic")
    given = SetUp(modes=[mode(2.0, [0.6, 0.8]), line], channels=("a", "b"))
    assert [each.mode.kind for each in merge([given, given])] == ["structural"]


def test_a_damping_that_no_set_up_knows_stays_unknown():
    rng = np.random.default_rng(10)
    unknown = Measured(float("nan"), float("nan"))
    setups = []
    for names in PARTS:
        (found,) = part(rng, names).modes
        found = dataclasses.replace(found, damping_ratio=unknown)
        setups.append(SetUp(modes=[found], channels=tuple(names)))
    (merged,) = merge(setups, ("a", "b"))
    assert np.isnan(merged.mode.damping_ratio.sd)
    assert "dampings_disagree" not in merged.mode.flags


def test_means_are_those_of_least_squares():
    values, sds = np.array([1.0, 1.3, 0.9]), np.array([0.2, 0.4, 0.1])
    mean, agreement, weights = weighted_mean(
        [Measured(v, s) for v, s in zip(values, sds, strict=True)]
    )
    expected, covariance = np.polyfit(values * 0, values, 0, w=1 / sds, cov="unscaled")
    assert mean.value == pytest.approx(expected[0])
    assert mean.sd == pytest.approx(np.sqrt(covariance[0, 0]))
    assert weights @ values == pytest.approx(mean.value)
    assert agreement.chi_square == pytest.approx(np.sum(((values - mean.value) / sds) ** 2))


def test_references_that_a_set_up_lacks_are_refused():
    given = SetUp(modes=[mode(2.0, [0.6, 0.8])], channels=("a", "b"))
    other = SetUp(modes=[mode(2.0, [0.6, 0.8])], channels=("a", "c"))
    with pytest.raises(ValueError, match=r"all set-ups have \('a',\)"):
        merge([given, other], references=("b",))
    with pytest.raises(ValueError, match="one for each component"):
        merge([SetUp(modes=given.modes, channels=("a", "b", "c"))])
    with pytest.raises(ValueError, match="No set-up"):
        merge([])


@pytest.mark.long
def test_two_set_ups_of_a_simulated_structure_give_its_shapes():
    stiffness = 2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
    stiffness[-1, -1] = 1.0
    squared, shapes = scipy.linalg.eigh(stiffness)
    omega = 2 * np.pi * np.sqrt(squared / squared[0])
    structure = Structure(
        mass=np.eye(6),
        damping=shapes * (0.02 * omega) @ shapes.T,
        stiffness=shapes * omega**2 @ shapes.T,
    )
    rng, setups = np.random.default_rng(11), []
    for places in ((5, 2, 0, 1), (5, 2, 3, 4)):
        names = tuple(structure.names[i] for i in places)
        samples = ambient_structure(structure, 20_000, 20.0, rng, channels=names)
        samples = samples + 0.05 * samples.std(axis=0) * rng.standard_normal(samples.shape)
        modes = bayesian_modes(samples, 20.0, omega / (2 * np.pi))
        setups.append(SetUp(modes=modes, channels=names))
    merged = merge(setups)
    assert len(merged) == 6
    for each, hz, true in zip(merged, omega / (2 * np.pi), shapes.T, strict=True):
        assert each.channels[:2] == (structure.names[5], structure.names[2])
        at = [each.channels.index(name) for name in structure.names]
        off, said = 1 - mac(each.mode.shape[at], true), np.sum(each.mode.shape_sd**2)
        assert off < 0.01
        assert off < 5 * said
        assert abs(each.mode.frequency_hz.value - hz) < 4 * each.mode.frequency_hz.sd


@pytest.mark.long
@pytest.mark.data
def test_two_set_ups_of_a_real_frame_are_one_structure():
    root = Path(__file__).parents[3]
    folder = Path(os.environ.get("SLOWTIME_DATA", root / "../shared/data")) / "steel_frame"
    if not folder.exists():
        pytest.skip("needs steel_frame in SLOWTIME_DATA")
    setups = []
    for number, node in ((1, 5), (2, 6)):
        samples = np.load(folder / f"measurement_{number}.npy")[:, :5]
        found = identify_modes(samples, 256.0, band_hz=(1.0, 14.5))
        names = tuple(f"node{node}.{side}" for side in "lrt")
        setups.append(SetUp(modes=found.modes, channels=(*names, "ref_x", "ref_y")))
    merged = merge(setups, references=("ref_x", "ref_y"))
    both = [each for each in merged if each.setups == (0, 1)]
    published = [1.2283, 1.4358, 2.1, 4.0175, 4.7704, 6.6824, 7.6157, 9.6653]
    published += [12.1663, 12.5979, 13.8545]
    near = [hz for hz in published for e in both if abs(e.mode.frequency_hz.value - hz) < 0.02]
    assert len(near) >= 9
    for each in both:
        assert len(each.channels) == 8
        assert np.linalg.norm(each.mode.shape) == pytest.approx(1.0)
