"""What all results have: tables, pictures, equality, copies; and truths of some."""

import json
import pickle
from pathlib import Path

import matplotlib.axes
import numpy as np
import pytest
from scipy import linalg

import slowtime as st
from slowtime.reliability import Problem, marginal
from slowtime_api.results import Result, same
from slowtime_schemas.answers.forecasts import ForecastModel
from slowtime_schemas.answers.plans import PlanModel
from slowtime_schemas.answers.risks import RiskModel
from slowtime_schemas.answers.twins import State
from twin_server.registration.costs import COSTS_EXAMPLE, DECISION_EXAMPLE
from twin_server.registration.limit_states import EXAMPLE

pytest.importorskip("pandas")
RNG = np.random.default_rng
K1 = np.array([[400.0, 0.0], [0.0, 0.0]])
K2 = np.array([[400.0, -400.0], [-400.0, 400.0]])


def limit_state(x):
    """Fail where a standard normal number exceeds 3."""
    return 3.0 - x[:, 0]


@pytest.fixture(scope="module")
def elements():
    """Two masses of 1 kg on springs of 400 N/m, as a finite-element model."""
    return st.FiniteElementModel.from_matrices(
        K1 + K2, np.eye(2), {"k1": K1, "k2": K2}, nodes=["m1", "m2"]
    )


@pytest.fixture(scope="module")
def weaker():
    """Modes of the same structure whose first spring has lost a tenth."""
    chain = st.Model.chain([1.0, 1.0], [360.0, 400.0], rayleigh=(0.1, 1e-4))
    signals = st.simulate(chain, rate_hz=50.0, duration_s=900.0, seed=4)
    return st.identify(signals, method="modes")


@pytest.fixture(scope="module")
def twin():
    """A twin whose frequency falls, with costs and limit states."""
    days = np.arange(25.0)
    registration = {
        "costs": COSTS_EXAMPLE, "decision": DECISION_EXAMPLE, "limit_states": EXAMPLE,
    }  # fmt: skip
    return st.evolve(
        days, 3.0 - 0.002 * days, np.full(25, 0.002), nominal_hz=3.0, nominal_damping=0.02,
        registration=registration,
    )  # fmt: skip


def tacho_record() -> st.Signals:
    """A shaft at 10 Hz, and its second order."""
    angle = 2 * np.pi * 10.0 * np.arange(8000) / 1000.0
    both = np.stack([(np.sin(angle) > 0.9).astype(float), 0.5 * np.cos(2 * angle)], 1)
    return st.Signals(both, 1000.0, ["tacho", "x"])


def multisine_record() -> st.Signals:
    """Six periods of a multisine through a linear system."""
    spectrum = np.zeros(257, dtype=complex)
    lines = np.arange(1, 120, 2)
    spectrum[lines] = np.exp(2j * np.pi * RNG(0).random(len(lines)))
    force = np.tile(np.fft.irfft(spectrum), 6)
    motion = 2.0 * force + 1e-5 * RNG(1).standard_normal(len(force))
    return st.Signals(np.stack([force, motion], 1), 512.0, ["force", "motion"])


@pytest.fixture(scope="module")
def results(elements, weaker, twin):
    """One result of each class."""
    t = np.arange(60.0)
    frame = st.Model.shear_frame([1.0, 1.0], [400.0, 400.0], rayleigh=(0.2, 1e-4))
    noise = st.Signals(
        RNG(0).standard_normal((6000, 2)), 50.0, channels=frame.channels, units="m/s^2"
    )
    drift = st.virtual(frame, noise, "force", element="storey1", factor=1e-3, factor_unit="MPa")
    surrogate = st.fit_surrogate({"x": np.linspace(-1, 1, 30)}, t[:30] ** 2, ["chaos"])
    normal = marginal("normal", mean=0.0, sd=1.0)
    found = [
        st.update(elements, weaker), st.place(elements, 1, modes=2, directions=["ux"]),
        st.reduce(elements, modes=2), drift, st.fatigue_damage(drift, detail_category=71),
        st.failure_probability(Problem({"u": normal}, limit_state), ["form", "importance"]),
        st.effects(), st.separate(t, 3.0 - 1e-3 * t + 0.01 * np.sin(t / 2), np.full(60, 1e-3)),
        st.orders(tacho_record(), "tacho", [2]), surrogate, surrogate.predict({"x": [0.5]}),
        st.distortion(multisine_record(), "force", "motion", period=512),
        st.merge([weaker, weaker]), st.scale(weaker, [(weaker, {"a_m1": 0.1})]),
        st.find_events(noise, long_s=10.0), st.shaking(noise, building="residential"),
        st.response_spectrum(noise, [1.0, 5.0, 20.0]),
        st.envelope_spectrum(noise, noise.channels[0], band_hz=(5.0, 20.0)),
        twin.simulate({"kind": "harmonic", "amplitude": 0.5, "frequency_hz": 2.9}),
    ]  # fmt: skip
    return {type(one).__name__: one for one in found}


def test_every_class_of_results_is_tried(results):
    classes = {
        name
        for name in st.__all__
        if isinstance(one := getattr(st, name), type) and issubclass(one, Result)
    }
    # Made of files and of records, and tried with the commands that make them.
    assert classes == set(results) | {"ConvertedMesh", "OptimalDesigns", "ConstantHistory"}


def test_a_result_is_a_table_a_picture_and_its_own_equal(results, tmp_path):
    for name, one in results.items():
        rows = one.rows()
        assert len(one.to_pandas()) == len(rows), name
        assert "<p>" in one._repr_html_()
        assert one.heading in repr(one)
        assert one == one
        assert one != rows
        if hasattr(one, "plot"):
            drawn = one.plot(tmp_path / f"{name}.png")
            axes = drawn if isinstance(drawn, list) else [drawn]
            assert all(isinstance(panel, matplotlib.axes.Axes) for panel in axes), name
            assert (tmp_path / f"{name}.png").stat().st_size > 3000
        if name not in ("EffectCatalogue", "FittedSurrogate"):  # which hold functions
            assert same(pickle.loads(pickle.dumps(one)).rows(), rows), name


def test_update_finds_the_loss_from_modes_and_from_their_file(elements, weaker, tmp_path):
    found = st.update(elements, weaker)
    assert found.parameters == ("k1", "k2")
    for true, lo, hi in zip([-0.1, 0.0], found.lo, found.hi, strict=True):
        assert lo < true < hi
    weaker.to_json(tmp_path / "modes.json")
    assert st.update(elements, tmp_path / "modes.json").rows() == found.rows()
    none = st.FiniteElementModel.from_matrices(K1 + K2, np.eye(2), {})
    with pytest.raises(ValueError, match="has no `parameters`"):
        st.update(none, weaker)


def test_matrices_have_the_modes_of_scipy(elements):
    want = np.sqrt(linalg.eigh(K1 + K2, np.eye(2), eigvals_only=True)) / (2 * np.pi)
    small = st.Model.from_matrices(np.eye(2), K1 + K2, coordinates=["m1", "m2"])
    reduced = st.reduce(elements, modes=2)
    for hz in (elements.natural_frequencies_hz(2), reduced.frequency_hz):
        np.testing.assert_allclose(hz, want, rtol=1e-9)
    np.testing.assert_allclose(small.natural_frequencies_hz, want, rtol=1e-9)
    np.testing.assert_allclose(reduced.model().natural_frequencies_hz, want, rtol=1e-6)
    with pytest.raises(ValueError, match=r"stiffness is not symmetric"):
        st.Model.from_matrices(np.eye(2), [[1.0, 2.0], [0.0, 1.0]])


def test_a_known_added_mass_gives_the_modal_mass():
    bare, heavy = (
        st.identify(
            st.simulate(
                st.Model.chain([m1, 2.0], [900.0, 900.0], rayleigh=(0.1, 1e-4)),
                rate_hz=50.0, duration_s=2000.0, seed=5,
            ),
            method="modes",
        )
        for m1 in (2.0, 2.2)
    )  # fmt: skip
    found = st.scale(bare, [(heavy, {"a_m1": 0.2})])
    assert len(found) == 2
    for row in found.rows():  # equal masses of 2 kg: any shape of norm 1 has a modal mass of 2
        assert abs(row["modal_mass_kg"] - 2.0) < max(4 * row["modal_mass_sd_kg"], 0.2)
    with pytest.raises(ValueError, match=r"A mass on 'a_m9' was given\. Allowed: a_m1, a_m2"):
        st.scale(bare, [(heavy, {"a_m9": 0.2})])


def test_set_ups_are_merged_over_all_channels():
    chain = st.Model.chain([1.0] * 3, [400.0] * 3, rayleigh=(0.1, 1e-4))
    whole = st.simulate(chain, rate_hz=50.0, duration_s=900.0, seed=6)
    first, second = whole["a_m1", "a_m2"], whole["a_m1", "a_m3"]
    found = st.merge([st.identify(one, method="modes") for one in (first, second)])
    assert set(found.channels) == {"a_m1", "a_m2", "a_m3"}
    before = st.merge_signals([first, second], (0.5, 8.0))
    for merged in (found, before):
        hz = [mode.frequency_hz.value for mode in merged.modes]
        np.testing.assert_allclose(hz, chain.natural_frequencies_hz, rtol=0.01)
        assert len(merged.file().modes or ()) == 3


def test_a_twin_answers_the_objects_of_a_client(twin):
    state = twin.state
    assert isinstance(state, State)
    assert state.stiffness_change is not None
    assert isinstance(twin.forecast(5.0), ForecastModel)
    assert isinstance(twin.plan(), PlanModel)
    assert isinstance(twin.risk(5.0), RiskModel)
    assert float(state.stiffness_change) == pytest.approx((2.952 / 3.0) ** 2 - 1, abs=2e-3)
    for answer in (state, twin.forecast(5.0), twin.plan(), twin.risk(5.0)):
        assert len(answer.to_pandas()) == len(answer.rows()) > 0
        assert "<table>" in answer._repr_html_()
    with pytest.warns(DeprecationWarning, match=r"\['stiffness_change'\], is deprecated"):
        assert state["stiffness_change"] == state.stiffness_change


def test_a_twin_is_its_readings(twin):
    again = pickle.loads(pickle.dumps(twin))
    assert again == twin
    assert again.history() == twin.history()
    other = st.Twin(nominal_hz=3.0)
    assert other != twin
    with pytest.raises(ValueError, match="no readings yet"):
        other.simulate({"kind": "step", "amplitude": 1.0})
    other.update(0.0, 3.0, 0.01)
    for ask, missing in ((other.plan, "costs and decision"), (other.risk, "limit states")):
        with pytest.raises(ValueError, match=missing):
            ask()
    with pytest.raises(ValueError, match=r"frequency_hz=|load"):
        other.simulate({"kind": "harmonic", "amplitude": 1.0})


def test_a_twin_of_a_file_is_that_of_its_columns(tmp_path):
    rows = [(day, 3.0 - 0.002 * day, 0.002) for day in range(12)]
    path = tmp_path / "history.csv"
    path.write_text(
        "slow_time,frequency_hz,frequency_sd\n"
        + "".join(f"{day},{hz!r},{sd!r}\n" for day, hz, sd in rows)
    )
    known = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    found = st.Twin.from_file(path, registration=known)
    columns = st.evolve(*np.array(rows).T, nominal_hz=3.0, nominal_damping=0.02)
    changes = [one.to_pandas()["stiffness_change_value"].tolist() for one in (found, columns)]
    assert changes[0] == changes[1]
    (tmp_path / "bad.csv").write_text("slow_time,frequency_hz,frequency_sd\n0,x,1\n")
    with pytest.raises(ValueError, match="line 2: frequency_hz is 'x'"):
        st.Twin.from_file(tmp_path / "bad.csv")


def test_signals_are_saved_cut_compared_and_copied(tmp_path):
    signals = st.Signals(RNG(0).standard_normal((100, 2)), 10.0, ["x", "y"], "m")
    cut = signals[2:4, "y"]
    assert cut.channels == ("y",)
    np.testing.assert_array_equal(cut.samples[:, 0], signals.samples[20:40, 1])
    assert signals[:] == signals == pickle.loads(pickle.dumps(signals))
    assert signals != cut
    for kind in ("csv", "mcap"):
        signals.save(tmp_path / f"x.{kind}")
        again = st.read(tmp_path / f"x.{kind}")
        np.testing.assert_allclose(again.samples, signals.samples, rtol=1e-12)
        assert again.units == signals.units
    with pytest.raises(ValueError, match=r"Allowed endings: \.csv"):
        signals.save(tmp_path / "x.docx")
    with pytest.warns(DeprecationWarning, match="Write to_pandas instead"):
        signals.to_dataframe()


def test_inputs_and_sensors_of_a_frame_are_where_they_are_said():
    motion = st.Sensor(channel="d", quantity="displacement", node="floor1", unit="mm")
    frame = st.Model.shear_frame(
        [900.0, 800.0], [1.2e6, 1e6], inputs=["base"],
        sensors=["floor2", motion],
    )  # fmt: skip
    assert frame.channels == ("a_floor2", "d")
    quake = np.zeros(400)
    quake[50:] = 1.0  # a steady acceleration of the base, in the end
    found = st.simulate(frame, {"a_base": quake}, rate_hz=100.0)
    assert found.units == ("m/s^2", "m")
    with pytest.raises(ValueError, match="floor9"):
        st.Model.shear_frame([900.0], [1e6], inputs=["floor9"])


def test_commands_print_what_the_functions_return(elements, weaker, tmp_path, capsys):
    from slowtime_cli.models.effects import effects

    effects(("coulomb",), markdown=False)
    assert st.effects("coulomb")["coulomb"].equation in capsys.readouterr().out
    weaker.to_json(tmp_path / "modes.json")
    body = json.loads(Path(tmp_path / "modes.json").read_text())
    assert body["channels"] == list(weaker.signals.channels)
