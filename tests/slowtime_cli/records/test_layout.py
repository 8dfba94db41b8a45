"""`layout`: a file for Foxglove and Lichtblick, or a sentence."""

import json


def test_a_recording_gets_its_layout(run, recorded):
    done = run("mcap", "layout", recorded(assets=("beam", "mast")), "--out", "layout.json")
    assert done.status == 0, done.err
    with open("layout.json") as file:
        whole = json.load(file)
    tabs = whole["configById"][whole["layout"]]["tabs"]
    assert [tab["title"] for tab in tabs] == ["lab.beam", "lab.mast"]
    assert done.out == f"layout.json: {len(whole['configById']) - 1} panels\n"


def test_what_has_nothing_to_plot_is_refused(refused, recorded, text):
    empty = recorded(count=0)
    assert "nothing to plot" in refused("mcap", "layout", empty, "--out", "layout.json")
    other = text(["a,b"], "no.mcap")
    assert "no.mcap" in refused("mcap", "layout", other, "--out", "layout.json")
