"""Metrics as Prometheus reads them, by the names that it asks for."""

import re

import pytest
from prometheus_client.parser import text_string_to_metric_families

from twin_server.serve import metrics
from twin_server.serve.metrics import exposition

NOT_BASE = re.compile(r"_(ms|minutes|hours|hz|khz|percent|kilo|milli|nanoseconds)(_|$)")


@pytest.fixture(scope="module")
def whole(beam_and_frame):
    return beam_and_frame(
        nominal={"frequency_hz": 3.0, "damping_ratio": 0.02},
        alarms=[{"quantity": "stiffness_change", "below": -0.1}],
    )


@pytest.fixture(scope="module")
def families(whole):
    text = whole.get("/metrics").text
    return {family.name: family for family in text_string_to_metric_families(text)}


def values(family):
    return {
        tuple(v for k, v in sample.labels.items() if k not in ("site", "unit")): sample.value
        for sample in family.samples
    }


def test_every_family_is_named_typed_and_explained_once(whole, families):
    text = whole.get("/metrics").text
    assert text.count("# TYPE ") == text.count("# HELP ") == len(families)
    for family in families.values():
        assert re.fullmatch(r"slowtime_(twin|asset)_[a-z][a-z_]*[a-z]", family.name)
        assert family.type in ("counter", "gauge")
        assert family.documentation
        assert not NOT_BASE.search(family.name)
        for sample in family.samples:
            assert sample.name.endswith("_total") == (family.type == "counter")
            assert all(re.fullmatch(r"[a-z]+", label) for label in sample.labels)


def test_no_series_is_told_twice(families):
    seen = [
        (sample.name, *sorted(sample.labels.items()))
        for family in families.values()
        for sample in family.samples
    ]
    assert len(set(seen)) == len(seen) > 60


def test_an_asset_is_measured_as_rest_tells_of_it(whole, families):
    twin = whole.get("/api/v1/twins/lab.beam").json()
    told = values(families["slowtime_asset_stiffness_change_ratio"])
    for part in ("value", "lo", "hi"):
        assert told["lab.beam", part] == twin["stiffness_change"][part]
    assert values(families["slowtime_asset_alarms_raised"])[("lab.beam",)] == 1
    assert values(families["slowtime_asset_valid"])[("lab.beam",)] == 1
    assert values(families["slowtime_asset_alive"])[("lab.frame",)] == 0
    assert values(families["slowtime_asset_slow_time"])[("lab.beam",)] == 59
    at = values(families["slowtime_asset_reading_timestamp_seconds"])[("lab.beam",)]
    assert at == twin["t_ns"] / 1e9
    heard = values(families["slowtime_asset_heard_timestamp_seconds"])[("lab.beam",)]
    assert heard > at


def test_an_element_is_measured_as_rest_tells_of_it(whole, families):
    twin = whole.get("/api/v1/twins/lab.frame").json()
    told = values(families["slowtime_asset_element_change_ratio"])
    assert twin["elements"]
    for name, estimate in twin["elements"].items():
        for part in ("value", "lo", "hi"):
            assert told["lab.frame", name, part] == estimate[part]


def test_what_cannot_be_is_left_out(families):
    frequency = values(families["slowtime_asset_frequency_hertz"])
    assert all(number == number for number in frequency.values())
    assert ("lab.frame", "value") not in values(families["slowtime_asset_mass_change_ratio"])


def test_of_too_many_twins_no_asset_is_measured():
    class Crowd:
        def ids(self, principal):
            return ["a.b", "a.c"]

        def counts(self):
            return {}

        refused = gauges = counts

    text = exposition(Crowd(), 0, 0, 1)  # type: ignore[arg-type]
    assert "slowtime_asset_alive" in text
    assert "slowtime_asset_alive{" not in text


def test_names_of_elements_that_need_quoting_are_quoted():
    odd = 'a"b\\c\nd'
    lines = metrics._family("x", "gauge", "X.", [metrics.Metric({"element": odd}, 1.0)])
    (family,) = text_string_to_metric_families("\n".join(lines) + "\n")
    assert family.samples[0].labels == {"element": odd}
