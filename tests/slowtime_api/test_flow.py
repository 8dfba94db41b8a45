"""From a model to signals, modes, a diagnosis and a twin; truth by closed forms."""

import numpy as np
import pytest
from scipy import signal

import slowtime as st

FREQUENCIES = np.sqrt(400.0 * (3 + np.array([-1, 1]) * np.sqrt(5)) / 2) / (2 * np.pi)
"""[Hz] Of two masses of 1 kg on springs of 400 N/m in a row: closed form."""


@pytest.fixture(scope="module")
def model():
    return st.Model.chain([1.0, 1.0], [400.0, 400.0], rayleigh=(0.1, 1e-4))


@pytest.fixture(scope="module")
def modes(model):
    signals = st.simulate(model, rate_hz=50.0, duration_s=600.0, seed=1)
    return st.identify(signals, method="modes")


def test_frequencies_of_a_chain_are_those_of_the_closed_form(model):
    np.testing.assert_allclose(model.natural_frequencies_hz, FREQUENCIES, rtol=1e-12)


def test_modes_are_found_within_four_standard_deviations(modes):
    assert len(modes) == 2
    for mode, true in zip(modes, FREQUENCIES, strict=True):
        assert abs(mode.frequency_hz.value - true) < 4 * mode.frequency_hz.sd
        assert mode.frequency_hz.sd < 0.01 * true
    ratio = modes[0].shape.real[1] / modes[0].shape.real[0]
    assert ratio == pytest.approx((1 + np.sqrt(5)) / 2, rel=0.05)


def test_modes_are_chosen_by_a_file(modes, tmp_path):
    path = tmp_path / "modes.yaml"
    modes.to_selection(path)
    drop = f"edits:\n- drop: {modes[0].frequency_hz.value:.4g}\n"
    path.write_text(path.read_text().replace("edits:\n", drop))
    chosen = st.identify(modes.signals, select=path)
    assert chosen.rows() == modes.rows()[1:]
    assert chosen.notes[-1].startswith("Modes chosen by hand")
    with pytest.raises(ValueError, match="select= chooses among poles"):
        st.identify(modes.signals, select=path, method="efdd")


def test_modes_are_shown_and_exported(modes, tmp_path):
    pyuff = pytest.importorskip("pyuff")
    assert modes.table().count("\n") == 2
    modes.plot_stabilisation(tmp_path / "poles.png")
    modes.plot_shapes(tmp_path / "shapes.png")
    modes.plot_mac(tmp_path / "mac.png")
    drawn = ("poles.png", "shapes.png", "mac.png")
    assert all((tmp_path / name).stat().st_size > 5000 for name in drawn)
    modes.to_uff(tmp_path / "modes.uff")
    sets = [
        one for one in pyuff.UFF(str(tmp_path / "modes.uff")).read_sets() if one["type"] == 55
    ]
    assert len(sets) == 2
    assert modes.to_pandas()["frequency_hz"].tolist() == modes.frequencies_hz.tolist()


def test_a_model_file_gives_the_same_model_again(model, tmp_path):
    model.save(tmp_path / "model.yaml")
    again = st.Model.from_file(tmp_path / "model.yaml")
    for one, other in zip(again.matrices(), model.matrices(), strict=True):
        np.testing.assert_allclose(one, other)


def test_the_response_to_an_input_is_that_of_scipy(tmp_path):
    text = (
        "slowtime_model: 1\nname: one\nnodes:\n  - {id: m1, mass_kg: 2.0}\nelements:\n"
        "  - {id: k1, kind: spring, between: [base, m1], stiffness_n_per_m: 800.0, "
        "damping_n_s_per_m: 1.6}\nsensors:\n  - {channel: x, quantity: displacement, node: m1, "
        "unit: m}\ninputs:\n  - {channel: u, kind: force, node: m1, unit: N}\n"
    )
    (tmp_path / "one.yaml").write_text(text)
    t = np.arange(2000) / 100.0
    force = np.sin(2 * np.pi * 0.7 * t) + 0.3 * t
    found = st.simulate(st.Model.from_file(tmp_path / "one.yaml"), {"u": force}, rate_hz=100.0)
    _, want, _ = signal.lsim(([1.0], [2.0, 1.6, 800.0]), force, t)
    np.testing.assert_allclose(found.samples[:, 0], want, atol=1e-6)


def test_an_ambient_simulation_has_defaults_that_identify_its_modes(model):
    signals = st.simulate(model)
    assert signals.rate_hz == pytest.approx(4 * FREQUENCIES[1])
    assert signals.duration_s == pytest.approx(1000 / FREQUENCIES[0], rel=1e-3)
    found = st.identify(signals, method="modes")
    assert len(found) == 2
    for mode, true in zip(found, FREQUENCIES, strict=True):
        assert abs(float(mode.frequency_hz) - true) < 4 * mode.frequency_hz.sd


def test_inputs_without_a_rate_are_asked_for_it():
    driven = st.Model.chain([1.0], [400.0], inputs=["m1"])
    with pytest.raises(ValueError, match="Give them as `inputs`"):
        st.simulate(driven)
    with pytest.raises(ValueError, match="Give rate_hz"):
        st.simulate(driven, {"f_m1": np.zeros(9)})
    stiff = st.Model.chain([1.0, 1.0], [1e-2, 1e6], rayleigh=(1e-3, 1e-6))
    with pytest.raises(ValueError, match="Give rate_hz and duration_s"):
        st.simulate(stiff)


def test_a_twin_follows_a_stiffness_that_falls(tmp_path):
    with_stiffness = 1.0 - 0.004 * np.arange(25)
    twin = st.Twin(nominal_hz=3.0, nominal_damping=0.02)
    rng = np.random.default_rng(3)
    for number, stiffness in enumerate(with_stiffness):
        hz = 3.0 * np.sqrt(stiffness) + 0.002 * rng.standard_normal()
        state = twin.update(float(number), hz, 0.002)
    change = state.stiffness_change
    assert change is not None
    assert change.lo - 0.002 < with_stiffness[-1] - 1 < change.hi + 0.002
    assert len(twin.history()) == 25
    (crossing,) = twin.forecast(50.0, threshold=-0.2).crossings
    assert crossing.median is not None
    assert 30 < crossing.median < 70
    twin.plot(tmp_path / "twin.png")
    assert len(twin.to_pandas()) == 25
    with pytest.raises(ValueError, match="was given after 24"):
        twin.update(3.0, 3.0, 0.01)
    twin.close()


@pytest.mark.long
def test_a_missing_friction_is_named_from_signals(tmp_path):
    """Friction by a stiff integrator of SciPy, not by the simulator."""
    from scipy.integrate import solve_ivp

    rate, seconds = 100.0, 40.0
    t = np.arange(int(rate * seconds)) / rate
    b, a = signal.butter(4, [0.5, 8.0], "bandpass", fs=rate)
    forces = [
        30.0 * signal.lfilter(b, a, np.random.default_rng(seed).standard_normal(len(t)))
        for seed in (1, 2)
    ]

    def response(force):
        def rate_of(at, y):
            drive = np.interp(at, t, force)
            friction = 2.0 * np.tanh(y[1] / 1e-3)
            return [y[1], drive - 0.4 * y[1] - 400.0 * y[0] - friction]

        found = solve_ivp(rate_of, (0, t[-1]), [0, 0], "Radau", t, rtol=1e-6, atol=1e-9)
        x = found.y[0]
        noise = 0.005 * x.std() * np.random.default_rng(7).standard_normal(len(t))
        return np.stack([force, x + noise], axis=1)

    (tmp_path / "rig.yaml").write_text(
        "slowtime_model: 1\nname: rig\nnodes:\n  - {id: m1, mass_kg: 1.0}\nelements:\n"
        "  - {id: k1, kind: spring, between: [base, m1], stiffness_n_per_m: 400.0, "
        "damping_n_s_per_m: 0.4}\nsensors:\n  - {channel: x, quantity: displacement, node: m1, "
        "unit: m}\ninputs:\n  - {channel: u, kind: force, node: m1, unit: N}\n"
    )
    learnt, judged = (st.Signals(response(force), rate, ["u", "x"]) for force in forces)
    found = st.diagnose(tmp_path / "rig.yaml", learnt, holdout=judged)
    named = {one["effect"] for one in found.effects()} | {
        r.effect for r in found.document.undecided
    }
    assert "coulomb" in named, found.sentence
    assert found.error["with effects"] < 0.3 * found.error["refitted"]
    assert found.report(tmp_path / "out").exists()
    assert "coulomb" in found._repr_html_()
    found.plot_gap(tmp_path / "gap.png")
    assert len(found.augmented.description.effects) >= 1


def test_a_decay_is_followed_from_all_channels_and_one_mode_is_chosen():
    t = np.arange(0, 30, 0.02)
    first = np.maximum(1 - 0.03 * t, 0) * np.cos(8 * t)
    second = 0.5 * np.exp(-0.01 * 27 * t) * np.cos(27 * t)
    both = np.outer(first, [1.0, 0.4]) + np.outer(second, [0.3, -0.6])
    both += 1e-3 * np.random.default_rng(0).standard_normal(both.shape)
    signals = st.Signals(both, rate_hz=50.0, channels=["x", "y"])
    law = st.fit_decay(signals)
    assert not law.one_number
    assert law.terms == ("dry friction",)
    assert signals.channels[law.channel] == "x"
    # Friction takes 0.03 of an amplitude in a second of 8 / pi half cycles.
    assert law.coefficients[0] == pytest.approx(0.03 * np.pi / 8, rel=0.01)
    law = st.fit_decay(signals, near_hz=27 / (2 * np.pi))
    assert law.one_number
    assert law.damping[0] == pytest.approx(0.01, abs=max(4 * law.damping_sd[0], 1e-4))
    assert st.fit_decay(signals, band_hz=(3.0, 6.0)).damping[0] == pytest.approx(0.01, rel=0.05)
