"""What a seed decides: effect, place, moment; and that simulator and twin can be given it."""

from pathlib import Path

import pytest

from edge_agent.settings import EdgeSettings
from slowtime_cli.operation.story.scenario import (
    KINDS,
    UNJOINED,
    YEAR,
    YEARS,
    edge_settings,
    model,
    registration,
    scenario,
    structure,
    years_of,
)
from slowtime_services.simulate import ORIGIN_NS, simulated_structure
from twin_server.registration.twin import Registration

SEEDS = range(2 * len(KINDS))


def test_of_seven_seeds_in_a_row_each_has_another_effect():
    kinds = [scenario(seed, 300.0).effect.kind for seed in SEEDS]
    assert sorted(kinds[: len(KINDS)]) == sorted(kinds[len(KINDS) :]) == sorted(KINDS)
    assert kinds[: len(KINDS)] != kinds[len(KINDS) :]
    assert scenario(5, 300.0) == scenario(5, 300.0)


def test_the_effect_enters_in_year_three_at_a_place_of_its_own():
    elements = {one["id"]: tuple(one["between"]) for one in model()["elements"]}
    for seed in SEEDS:
        effect = scenario(seed, 300.0).effect
        assert 3.0 < effect.enters < 4.0 < effect.leaves < YEARS
        if effect.between is None:
            places = {*elements, *(f"floor{i}" for i in range(1, 5))}
            assert effect.is_sensor_fault or effect.place in places
        else:
            assert effect.between in UNJOINED
            assert effect.between not in elements.values()


@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_simulator_edge_and_twin_take_what_a_scenario_says(seed, tmp_path):
    of = scenario(seed, 300.0)
    simulated = simulated_structure(structure(of))
    before, after = (simulated.truth(of.record_at(of.effect.enters) + k) for k in (-1, 0))
    assert (before["effects"], after["effects"]) == (0.0, 1.0)
    assert -0.045 < simulated.truth(of.records - 1)["lasting.element.storey1"] < -0.035
    settings = EdgeSettings(**edge_settings(of, tmp_path / "hold"))
    assert (settings.extract.method, settings.extract.median_window) == ("peak", 5)
    twin = Registration.model_validate(registration(of))
    assert twin.on_disagreement is not None
    assert twin.model is not None
    assert [one.id for one in twin.model.elements] == [f"storey{i}" for i in range(1, 5)]


def test_sped_up_and_in_real_time_the_records_cover_ten_years():
    for of in (scenario(1, 300.0), scenario(1, 7200.0, real_time=True)):
        assert of.records * of.days_per_record == pytest.approx(YEARS * YEAR)
        block = simulated_structure(structure(of)).epoch(of.record_at(5.0))[0]
        assert years_of(of, block.start_ns) == pytest.approx(5.0, abs=0.1)
        assert years_of(of, ORIGIN_NS) == 0.0
    assert scenario(1, 7200.0, real_time=True).records == 120
    assert scenario(1, 300.0).records == 1500
    assert "hold" not in edge_settings(of, Path("hold"))["input"]
