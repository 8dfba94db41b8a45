import json
import signal

import pytest


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            (),
            "An edge agent needs an input. Give --source, --simulate, --file, or",
        ),
        (
            ("--simulate", "tower", "--file", __file__),
            "--simulate and --file exclude each other",
        ),
        (
            ("--simulate", "tower", "--rate-hz", "1"),
            "--rate-hz goes with --file or --source; other inputs",
        ),
        (
            ("--simulate", "tower", "--unit", "mg"),
            "--unit and the sensitivity of --reading go with --file or --source.",
        ),
        (("--simulate", "cathedral"), "not one of 'bridge', 'frame', 'tank', 'tower', 'wing'"),
        (
            ("--simulate", "tower", "--site", "A B"),
            "'A B' is not a valid name. Allowed: at most 63",
        ),
        (("--simulate", "tower", "--window-s", "-1"), "-1.0 is not in the range x>0"),
        (("--simulate", "tower", "--hop-s", "nan"), "nan is not a finite number"),
        (("--simulate", "tower", "--channels", "a,,b"), "has an empty name"),
        (
            ("--simulate", "tower", "--connect", "nonsense"),
            "'nonsense' is not a valid endpoint",
        ),
        (("--file", "missing.csv"), "File 'missing.csv' does not exist"),
    ],
)
def test_an_edge_that_cannot_run_says_why(refused, arguments, says):
    assert says in refused("edge", *arguments)


@pytest.mark.parametrize("kind", ["file", "recording", "source"])
def test_units_that_are_given_reach_the_input(run, monkeypatch, record, kind):
    taken = []
    monkeypatch.setattr("edge_agent.__main__.run", lambda settings: taken.append(settings))
    where = "stdin:?layout=csv&channels=acc_x&rate_hz=200" if kind == "source" else record
    if kind == "recording":
        where = record.rename(record.with_suffix(".mcap"))
    flags = ("--unit", "mg", "--unit", "acc_x=mV", "--reading", "sensitivity=acc_x=100mV/g")
    run("edge", "--source" if kind == "source" else "--file", where, *flags)
    (settings,) = taken
    assert settings.input.kind == ("live" if kind == "source" else kind)
    assert settings.input.units == ("mg", "acc_x=mV")
    assert settings.input.sensitivities == ("acc_x=100mV/g",)


@pytest.mark.parametrize("verb", ["edge", "twin"])
def test_a_config_that_cannot_be_read_is_named(refused, tmp_path, verb):
    for name, content, says in [
        ("a.json", "{", "--config a.json: This is not JSON: Expecting property name"),
        ("a.toml", "x =", "--config a.toml: This is not TOML: "),
        ("a.ini", "", "a.ini is not a valid settings file. Allowed: .toml and .json."),
        ("b.json", '{"colour": 1}', "colour=1: Extra inputs are not permitted"),
    ]:
        (tmp_path / name).write_text(content)
        assert says in refused(verb, "--config", name)


def test_a_twin_that_cannot_run_says_why_before_a_router_is_waited_for(
    refused, unawaited, tmp_path
):
    (tmp_path / "twins.json").write_text(json.dumps({"Beam": {"changes": "mass"}}))
    for arguments, says in [
        (
            ("--register", "twins.json"),
            "'Beam' is not a valid twin's id. Give SITE.ASSET in lower case",
        ),
        (("--port", "99999"), "99999 is not in the range 0<=x<=65535"),
        (
            ("--connect", "nonsense"),
            "'nonsense' is not a valid endpoint. Give PROTOCOL/ADDRESS",
        ),
        (("--database", "."), ". is a folder. Give a file in it."),
    ]:
        assert says in refused("twin", *arguments)


def test_a_router_that_cannot_listen_says_why(refused):
    assert "'nonsense' is not a valid endpoint" in refused("router", "--listen", "nonsense")
    assert "an endpoint is misspelt; they look like tcp/0.0.0.0:7447" in refused(
        "router", "--insecure", "--listen", "tcp/999.1.1.1:1"
    )


def test_status_is_1_where_nobody_answers_and_2_where_the_question_is_wrong(run, refused):
    done = run("router", "status", "--connect", "tcp/127.0.0.1:1", "--timeout-s", "0.2")
    assert (done.status, done.out) == (1, "")
    assert "No router answers at tcp/127.0.0.1:1. Start one with `slowtime router`" in done.err
    assert "'tower' is not a valid name. Allowed: SITE.ASSET" in refused(
        "router", "status", "--asset", "tower"
    )


@pytest.mark.system
def test_ctrl_c_ends_edge_and_router_cleanly_and_status_sees_them(run, start, router):
    edge = start(
        "edge", "--simulate", "tank", "--connect", router, "--setting", "epochs_per_s=2"
    )
    done = run(
        "router", "status", "--connect", router, "--asset", "demo.tank", "--timeout-s", "20"
    )
    assert (done.status, done.out) == (0, "demo.tank is alive\n")
    absent = run(
        "router", "status", "--connect", router, "--asset", "demo.wing", "--timeout-s", "0.2"
    )
    assert (absent.status, absent.out) == (1, "demo.wing is not alive; the router answers.\n")
    edge.send_signal(signal.SIGINT)
    out, err = edge.communicate(timeout=300)
    assert (edge.returncode, out) == (0, "")
    assert "Traceback" not in err


@pytest.mark.long
@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_router_told_to_end_ends_with_success(start, port, number):
    router = start("-q", "router", "--listen", f"tcp/127.0.0.1:{port}")
    assert router.stdout.readline() == f"Router on tcp/127.0.0.1:{port}\n"
    router.send_signal(number)
    out, err = router.communicate(timeout=300)
    assert (router.returncode, out, err) == (0, "", "")
