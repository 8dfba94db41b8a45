"""Records in the model's channels and units: what is read is what was meant, or is refused."""

import dataclasses
import re

import numpy as np
import pytest

from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring
from slowtime.dynamics.plant import Plant
from slowtime_services.diagnose import campaign_of, read_any, roles_of
from slowtime_services.diagnose.record_checks import refuse_nonsense
from slowtime_services.files import Gap, RecordError
from tests.services.diagnose.slide import RATE_HZ, SAMPLES, arrays_of, source_of

T = np.arange(SAMPLES) / RATE_HZ


@pytest.fixture(scope="session")
def arrays(slide):
    return arrays_of(slide, 1)


def test_channels_stand_in_the_order_of_the_model_whatever_their_order_in_the_file(
    slide, arrays
):
    turned = {name: arrays[name] for name in ("a", "u", "x")}
    campaign, notes = campaign_of(slide, [source_of(turned)])
    assert notes == ()
    np.testing.assert_array_equal(campaign.trials[0].outputs[:, 0], arrays["x"])
    np.testing.assert_array_equal(campaign.trials[0].inputs[:, 0], arrays["u"])


def test_units_that_a_record_states_are_turned_into_the_models(slide, arrays):
    said = {"u": arrays["u"] / 1e3, "x": arrays["x"] * 1e3, "a": arrays["a"] / 9.80665}
    campaign, notes = campaign_of(slide, [source_of(said, units=("kN", "mm", "g"))])
    np.testing.assert_allclose(campaign.trials[0].inputs[:, 0], arrays["u"])
    np.testing.assert_allclose(campaign.trials[0].outputs[:, 1], arrays["a"])
    assert "x converted from mm to the model's m" in " ".join(notes)
    with pytest.raises(RecordError, match="x in V, the model in m"):
        campaign_of(slide, [source_of(arrays, units=("N", "V", "m/s^2"))])


def test_roles_make_a_channel_of_columns_and_single_numbers(slide, arrays):
    said = {"volts": arrays["u"] / 35.0, "qm": arrays["x"] * 1e3, "a": arrays["a"]}
    source = source_of(said, aux={"gain": np.array(35.0)})
    roles = roles_of(["u=gain*volts", "x = qm/1000"])
    campaign, _ = campaign_of(slide, [source], roles=roles)
    np.testing.assert_allclose(campaign.trials[0].inputs[:, 0], arrays["u"])
    np.testing.assert_allclose(campaign.trials[0].outputs[:, 0], arrays["x"])


@pytest.mark.parametrize(
    ("role", "says"),
    [
        ("u", "maps no channel"),
        ("u=__import__('os')", "is neither a column nor an expression"),
        ("u=volts**2", "is neither a column nor an expression"),
        ("u=nowhere*2", "holds nothing called 'nowhere'"),
        ("y=u", "'y', which is not a channel of the model. The model has: u, x, a"),
    ],
)
def test_a_role_that_cannot_be_read_says_what_is_allowed(slide, arrays, role, says):
    with pytest.raises(RecordError, match=re.escape(says)):
        campaign_of(slide, [source_of(arrays)], roles=roles_of([role]))


def test_a_jump_in_time_makes_two_records_each_at_its_own_time(slide, arrays):
    source = source_of(arrays, gaps=(Gap(250, 150),), aux={"t": 7.0 + T})
    campaign, notes = campaign_of(slide, [source])
    assert [len(trial.outputs) for trial in campaign.trials] == [250, 350]
    assert [trial.start_s for trial in campaign.trials] == [7.0, 7.0 + 400 / RATE_HZ]
    assert "read as 2 records" in notes[0]


def test_an_input_that_is_missing_for_a_while_is_cut_out_and_a_sensor_masked(slide, arrays):
    holed = {name: values.copy() for name, values in arrays.items()}
    holed["u"][300:310] = np.nan
    holed["x"][100:120] = np.nan
    campaign, notes = campaign_of(slide, [source_of(holed)])
    assert [len(trial.outputs) for trial in campaign.trials] == [300, 290]
    assert campaign.trials[1].start_s == 310 / RATE_HZ
    assert int((~campaign.trials[0].used).sum()) == 20
    assert "10 samples between are left out" in notes[0]


def test_records_that_were_dated_absolutely_count_from_the_first(slide, arrays):
    late = [source_of(arrays, start_ns=1_700_000_000_000_000_000 + k * 10**11) for k in (2, 0)]
    campaign, _ = campaign_of(slide, late)
    assert [trial.start_s for trial in campaign.trials] == [200.0, 0.0]


def test_a_sensor_that_some_records_lack_is_masked_there(slide, arrays):
    less = {name: arrays[name] for name in ("u", "x")}
    campaign, notes = campaign_of(slide, [source_of(arrays), source_of(less, "less.npz")])
    assert not campaign.trials[1].used[:, 1].any()
    assert "less.npz has no channel 'a'" in notes[0]


def test_a_part_of_a_record_keeps_its_time(tmp_path, arrays):
    np.savez(tmp_path / "r.npz", t=3.0 + T, **arrays)
    part = read_any(f"{tmp_path}/r.npz@2:4.5")
    assert part.name == "r.npz@2:4.5"
    assert part.record.samples.shape == (125, 3)
    np.savez(tmp_path / "bare.npz", rate_hz=RATE_HZ, **arrays)
    undated = read_any(f"{tmp_path}/bare.npz@2:")
    assert float(undated.record.aux["t"][0]) == 2.0
    with pytest.raises(RecordError, match=r"12:inf is no part of it"):
        read_any(f"{tmp_path}/bare.npz@12:")


def taken(slide, given):
    campaign, _ = campaign_of(slide, [source_of(given)])
    refuse_nonsense(campaign, ["r.npz"])


def refused(slide, given):
    with pytest.raises(RecordError) as caught:
        taken(slide, given)
    return str(caught.value)


def test_units_wrong_by_a_thousand_are_told_with_their_likely_cause(slide, arrays):
    said = refused(slide, arrays | {"x": 1e3 * arrays["x"]})
    assert "x is" in said
    assert "--channel x=x/1000" in said
    assert "unit of the inputs, u [N]" in refused(slide, arrays | {"u": 1e-3 * arrays["u"]})


def test_swapped_channels_are_told_with_the_roles_that_mend_them(slide, arrays):
    swapped = arrays | {"x": arrays["a"], "a": arrays["x"]}
    said = refused(slide, swapped)
    assert "--channel x=a --channel a=x" in said
    campaign, _ = campaign_of(slide, [source_of(swapped)], roles=roles_of(["x=a", "a=x"]))
    refuse_nonsense(campaign, ["r.npz"])


def test_an_input_that_was_not_recorded_is_told(slide, arrays):
    assert "no channel called 'u'" in refused(
        slide, {name: arrays[name] for name in ("x", "a")}
    )
    assert "input 'u' never changes" in refused(slide, arrays | {"u": 0 * arrays["u"]})
    assert "'u' has no finite values" in refused(slide, arrays | {"u": np.nan * arrays["u"]})


def test_a_structure_that_was_let_go_needs_no_input(slide):
    free = {"u": np.zeros(SAMPLES)}
    ringing = np.exp(-0.4 * T) * np.cos(20.0 * T)
    campaign, _ = campaign_of(
        slide, [source_of(free | {"x": 1e-2 * ringing, "a": -4.0 * ringing})]
    )
    refuse_nonsense(campaign, ["r.npz"])


def test_channels_that_are_not_there_or_say_nothing_are_told(slide, arrays):
    unknown = {"u": arrays["u"], "disp": arrays["x"], "acc": arrays["a"]}
    assert "There are: acc, disp, u" in refused(slide, unknown)
    assert "no finite sample" in refused(slide, arrays | {"x": np.nan * arrays["x"]})


def test_two_seconds_are_refused_where_nothing_is_left_to_judge_by(slide, arrays):
    short = {name: values[:100] for name, values in arrays.items()}
    assert "at least 192" in refused(slide, short)
    rest = {name: values[100:] for name, values in arrays.items()}
    campaign, _ = campaign_of(slide, [source_of(short)], [source_of(rest)])
    assert len(campaign.trials[0].outputs) == 100
    tiny = {name: values[:50] for name, values in arrays.items()}
    assert "needs 64 consecutive samples" in refused(slide, tiny)


def test_arrays_of_the_wrong_shape_and_times_that_run_back_are_told(tmp_path, slide, arrays):
    np.savez(tmp_path / "shape.npz", t=T, **(arrays | {"a": arrays["a"][:500]}))
    with pytest.raises(RecordError, match=r"Left out, not being of length 600: a"):
        campaign_of(slide, [read_any(tmp_path / "shape.npz")])
    np.savez(tmp_path / "back.npz", t=np.where(T < 5, T, T - 3), **arrays)
    with pytest.raises(RecordError, match=r"back\.npz: Time does not run forwards"):
        read_any(tmp_path / "back.npz")


def test_what_is_held_out_is_not_learnt_from(slide, arrays):
    half = {name: values[300:] for name, values in arrays.items()}
    first = {name: values[:300] for name, values in arrays.items()}
    for learnt, judged in ((arrays, arrays), (arrays, half), (half, arrays)):
        with pytest.raises(RecordError, match="its error would prove nothing"):
            campaign_of(slide, [source_of(learnt)], [source_of(judged)])
    campaign, _ = campaign_of(slide, [source_of(first)], [source_of(half)])
    assert len(campaign.holdout) == 1


def test_a_clock_too_slow_for_the_model_is_told_with_its_likely_cause(tmp_path, slide, arrays):
    np.savez(tmp_path / "ms.npz", t=1e3 * T, **arrays)
    with pytest.raises(RecordError, match=r"in seconds .* 0\.05 Hz.* in milliseconds .* 50 Hz"):
        read_any(tmp_path / "ms.npz")
    campaign, _ = campaign_of(slide, [read_any(tmp_path / "ms.npz", rate_hz=0.05)])
    with pytest.raises(RecordError, match=r"0\.05 samples per second.*such as t_ms"):
        refuse_nonsense(campaign, ["ms.npz"])
    np.savez(tmp_path / "named.npz", t_ms=1e3 * T, **arrays)
    campaign, _ = campaign_of(slide, [read_any(tmp_path / "named.npz")])
    refuse_nonsense(campaign, ["named.npz"])


STIFF = Description(
    name="mount",
    nodes=(Node(id="m", mass_kg=0.01),),
    elements=(
        Spring(id="k", between=("base", "m"), stiffness_n_per_m=6000.0, damping_n_s_per_m=5.0),
    ),
    inputs=(Input(channel="u", kind="force", node="m", unit="N"),),
    sensors=(Sensor(channel="x", quantity="displacement", node="m", unit="m"),),
)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_motion_far_below_resonance_is_diagnosed_and_motion_of_its_own_is_not(loss):
    """A stiff mount moved slowly follows its force; ringing at the same rate is a question."""
    force = np.sin(2 * np.pi * 1.3 * T) + 0.4 * np.sin(2 * np.pi * 2.1 * T)
    follows = {"u": force, "x": force / (6000.0 * (1.0 - loss))}
    refuse_nonsense(campaign_of(STIFF, [source_of(follows)])[0], ["slow"])
    rings = {"u": force, "x": np.exp(-0.3 * T) * np.sin(2 * np.pi * 7.0 * T) / 6000.0}
    campaign, _ = campaign_of(STIFF, [source_of(rings)])
    with pytest.raises(RecordError, match="samples per second, which show vibration up"):
        refuse_nonsense(campaign, ["rings"])


def test_a_force_that_a_strong_missing_law_makes_of_slow_motion_is_diagnosed():
    """The model explains hardly any of the force, but any spring and damper explain most."""
    motion = 0.01 * np.sin(2 * np.pi * 1.3 * T) + 0.004 * np.sin(2 * np.pi * 2.1 * T)
    rate = np.gradient(motion, T)
    force = 6000.0 * motion + 5.0 * rate + 5e5 * rate * np.abs(rate)
    assert np.std(force - 6000.0 * motion) > 0.9 * np.std(force)
    campaign, _ = campaign_of(STIFF, [source_of({"u": force, "x": motion})])
    refuse_nonsense(campaign, ["damper"])


def test_a_clock_that_counts_minutes_is_asked_about_though_most_motion_is_slow():
    """Sixty times as fast, the model says all of it; as read, only what follows the force."""
    noise = np.random.default_rng(4).standard_normal(SAMPLES)
    force = np.sin(2 * np.pi * 0.2 * T) + 0.25 * noise
    plant = Plant.of(STIFF)
    moved = plant.simulate(plant.values, force[:, None], 60 * RATE_HZ)[:, 0]
    campaign, _ = campaign_of(STIFF, [source_of({"u": force, "x": moved})])
    read = plant.simulate(plant.values, force[:, None], RATE_HZ)[:, 0]
    assert np.std(moved - read) < 0.9 * np.std(moved)
    with pytest.raises(RecordError, match="samples per second, which show vibration up"):
        refuse_nonsense(campaign, ["minutes"])


def test_why_a_column_is_missing_or_no_clock_is_said(tmp_path, slide, arrays):
    np.savez(tmp_path / "phasor.npz", t=T, **(arrays | {"a": arrays["a"] + 1j}))
    with pytest.raises(RecordError, match="Left out, holding complex numbers: a"):
        campaign_of(slide, [read_any(tmp_path / "phasor.npz")])
    np.savez(tmp_path / "mixed.npz", t=T[::-1], **arrays)
    with pytest.raises(RecordError, match="'t' does not run forwards in 599 of 599 steps"):
        read_any(tmp_path / "mixed.npz")
    twice = "t,u,a,x,x\n" + "\n".join(f"{t:.2f},0,{t},0,0" for t in T)
    (tmp_path / "twice.csv").write_text(twice)
    with pytest.raises(RecordError, match="'x' heads several columns"):
        campaign_of(slide, [read_any(tmp_path / "twice.csv")])
    holed = arrays | {"u": np.where(np.arange(SAMPLES) % 100 == 99, np.nan, arrays["u"])}
    with pytest.raises(
        RecordError, match="99 consecutive samples without a gap, because its clock"
    ):
        campaign_of(slide, [source_of(holed)])


def test_ambient_records_are_not_weighed(slide, arrays):
    ambient = dataclasses.replace(slide, inputs=())
    campaign, _ = campaign_of(ambient, [source_of(arrays | {"x": 1e3 * arrays["x"]})])
    refuse_nonsense(campaign, ["r.npz"])
    assert campaign.trials[0].inputs.shape == (SAMPLES, 0)


def test_a_record_that_no_sensor_heard_anything_of_is_left_out_and_said(slide, arrays):
    silent = arrays | {name: np.full(SAMPLES, np.nan) for name in ("x", "a")}
    campaign, notes = campaign_of(slide, [source_of(arrays), source_of(silent)])
    assert len(campaign.trials) == 1
    assert "has no finite reading of any sensor" in " ".join(notes)
    with pytest.raises(RecordError, match="has no finite sample in any record"):
        campaign_of(slide, [source_of(silent)])
