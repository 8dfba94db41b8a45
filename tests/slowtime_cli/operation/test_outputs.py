"""`slowtime twin outputs`: what is wrong is said before anything is sent."""

import json
import threading

from slowtime_services.outputs import OutputsSettings
from slowtime_services.outputs import run as run_outputs

DATABASE = {"kind": "influx", "url": "http://127.0.0.1:1", "database": "plant"}


def written(folder, **settings):
    path = folder / "outputs.json"
    path.write_text(json.dumps({"folder": str(folder / "positions"), **settings}))
    return path


def test_settings_that_are_none_are_refused(refused, tmp_path):
    said = refused("twin", "outputs", written(tmp_path, outputs={"db": {"kind": "influx"}}))
    assert "url" in said
    assert "outputs" in refused("twin", "outputs", written(tmp_path))
    path = tmp_path / "outputs.yaml"
    path.write_text("")
    assert "Allowed: .toml and .json" in refused("twin", "outputs", path)


def test_a_secret_that_is_not_there_is_named(run, tmp_path, caplog):
    path = written(tmp_path, outputs={"db": DATABASE}, token_file=str(tmp_path / "token"))
    assert run("twin", "outputs", path).status == 2
    assert "A secret cannot be read" in caplog.text


def test_positions_belong_to_one_process(run, tmp_path, caplog):
    path = written(tmp_path, outputs={"db": DATABASE}, server="http://127.0.0.1:1")
    stop, ready = threading.Event(), threading.Event()
    settings = OutputsSettings(config=path)
    first = threading.Thread(
        target=run_outputs, args=(settings,), kwargs={"stop": stop, "ready": ready.set}
    )
    first.start()
    assert ready.wait(30)
    try:
        assert run("twin", "outputs", path).status == 2
        assert "Another process sends from" in caplog.text
    finally:
        stop.set()
        first.join(30)
