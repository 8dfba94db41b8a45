"""Many records are diagnosed by one command, and those that cannot be are told."""

import csv
import sys

import pytest

MODEL = """\
slowtime_model: 1
name: cart
nodes:
  - {id: cart, mass_kg: 1.0}
elements:
  - {id: spring, between: [base, cart], stiffness_n_per_m: 100.0, damping_n_s_per_m: 0.4}
inputs:
  - {channel: force, kind: force, node: cart, unit: N}
sensors:
  - {channel: x, quantity: displacement, node: cart, frame: relative_to_base, unit: m}
"""


@pytest.fixture
def rigs(tmp_path):
    folder = tmp_path / "rigs"
    folder.mkdir()
    (folder / "cart.yaml").write_text(MODEL)
    return folder


def test_records_that_cannot_be_read_are_told_and_keep_no_others(run, rigs, tmp_path):
    for name in ("one", "other"):
        (rigs / name).mkdir()
        (rigs / name / "record.csv").write_text("no numbers here\n")
    found = run("diagnose", "--batch", rigs, "--out", tmp_path / "out", "--jobs", 2)
    assert found.status == 1
    assert "0 of 2 cases diagnosed" in found.err
    rows = list(csv.DictReader((tmp_path / "out" / "summary.csv").read_text().splitlines()))
    assert [(row["case"], row["status"]) for row in rows] == [
        ("one", "failed"), ("other", "failed"),
    ]  # fmt: skip
    assert all("record.csv" in row["sentence"] for row in rows)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--batch", "RIGS"], "There are no cases in"),
        (["--batch", "RIGS", "RIGS/cart.yaml"], "--batch takes no MODEL"),
        (["--batch", "RIGS", "--history", "x.csv"], "--batch takes no MODEL"),
        (["--batch", "RIGS/absent"], "does not exist"),
    ],
)
def test_what_is_no_batch_is_refused(run, rigs, words, told):
    found = run("diagnose", *(word.replace("RIGS", str(rigs)) for word in words))
    assert found.status == 2
    assert told in found.err


def test_an_engine_that_is_none_is_refused(run, rigs):
    (rigs / "one").mkdir()
    (rigs / "one" / "record.csv").write_text("t,force,x\n")
    found = run("diagnose", "--batch", rigs, "--engine", "slurm")
    assert found.status == 2
    assert 'There is no engine "slurm"' in found.err


def test_without_ray_its_extra_is_named(run, rigs, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    (rigs / "one").mkdir()
    (rigs / "one" / "record.csv").write_text("t,force,x\n")
    found = run("diagnose", "--batch", rigs, "--engine", "ray", "--out", tmp_path / "out")
    assert found.status == 2
    assert "slowtime[ray]" in found.err
    assert "Traceback" not in found.err


def test_options_are_those_of_each_diagnosis(run, rigs, tmp_path):
    """Lines that are skipped make a record readable, so that the next complaint is another."""
    (rigs / "one").mkdir()
    rows = "".join(f"{n / 50},0.0,0.0\n" for n in range(200))
    (rigs / "one" / "record.csv").write_text("1,2\n3,4\nt,elsewhere,x\n" + rows)
    words = ("--batch", rigs, "--out", tmp_path / "out", "--quick", "--channel")
    run("diagnose", *words, "force=absent", "--reading", "skip_lines=2")
    (row,) = csv.DictReader((tmp_path / "out" / "summary.csv").read_text().splitlines())
    assert "absent" in row["sentence"]
