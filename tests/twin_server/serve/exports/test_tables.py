"""A history as a table is the history, to the last bit."""

import csv
import io
import sys

import pyarrow.parquet
import pytest

ESTIMATES = ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change")
PARTS = {"value": "", "sd": "_sd", "lo": "_lo", "hi": "_hi"}


def exported(house, twin_id, **query):
    return house.get(f"/api/v1/twins/{twin_id}/history/export", **query)


def rows_of_csv(answer):
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    return list(csv.DictReader(io.StringIO(answer.text)))


def rows_of_parquet(answer):
    table = pyarrow.parquet.read_table(io.BytesIO(answer.content))
    return table.to_pylist()


@pytest.mark.long
@pytest.mark.parametrize("twin_id", ["lab.beam", "lab.frame"])
def test_every_number_of_the_history_is_in_the_parquet_file(house, points, twin_id):
    rows, expected = (
        rows_of_parquet(exported(house, twin_id, format="parquet")),
        points(twin_id),
    )
    assert len(rows) == len(expected) > 0
    for row, point in zip(rows, expected, strict=True):
        for key in ("t_ns", "slow_time", "boot", "sequence", "valid", "correlation"):
            assert row[key] == point[key]
        for name in ESTIMATES:
            told = point[name] or dict.fromkeys(PARTS)
            assert {part: row[name + end] for part, end in PARTS.items()} == told
        for name, told in point.get("elements", {}).items():
            of_it = {part: row[f"elements.{name}{end}"] for part, end in PARTS.items()}
            assert of_it == told


@pytest.mark.long
def test_csv_and_parquet_say_the_same(house):
    of_csv = rows_of_csv(exported(house, "lab.frame"))
    of_parquet = rows_of_parquet(exported(house, "lab.frame", format="parquet"))
    assert len(of_csv) == len(of_parquet) == 40
    for text, row in zip(of_csv, of_parquet, strict=True):
        assert text.keys() == row.keys()
        for name, value in row.items():
            if value is None:
                assert text[name] == ""
            elif isinstance(value, bool):
                assert text[name] == str(value).lower()
            elif isinstance(value, float):
                assert float(text[name]) == value
            elif name != "time":
                assert text[name] == str(value)
    assert of_csv[0]["time"] == "2026-01-01T00:00:00.000000000Z"


@pytest.mark.long
def test_a_table_is_cut_where_it_is_asked_for(house):
    cut = rows_of_csv(exported(house, "lab.beam", start="slow:10", end="slow:12"))
    assert [row["sequence"] for row in cut] == ["10", "11", "12"]
    cut = rows_of_csv(exported(house, "lab.beam", start="2026-01-01T00:04:58Z"))
    assert [row["sequence"] for row in cut] == ["298", "299"]
    none = exported(house, "lab.beam", start="slow:900")
    assert none.text.count("\n") == 1
    assert exported(house, "lab.beam", start="soon").status_code == 422


def test_pages_join_without_a_seam(house, points, monkeypatch):
    monkeypatch.setattr("twin_server.serve.exports.tables.PAGE", 7)
    rows = rows_of_csv(exported(house, "lab.beam"))
    assert [int(row["sequence"]) for row in rows] == list(range(300))
    of_parquet = rows_of_parquet(exported(house, "lab.beam", format="parquet"))
    assert [row["sequence"] for row in of_parquet] == list(range(300))


@pytest.mark.long
def test_without_pyarrow_the_server_says_what_to_install(house, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    answer = exported(house, "lab.beam", format="parquet")
    assert answer.status_code == 501
    assert "slowtime[parquet]" in answer.json()["detail"]
    assert exported(house, "lab.beam").status_code == 200
    assert exported(house, "lab.beam", format="excel").status_code == 422
