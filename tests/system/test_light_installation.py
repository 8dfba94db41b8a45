"""An installation without extras is an edge agent, and says what else would be needed.

It wants the folder of programs of such an environment in `SLOWTIME_LIGHT`, as `.ci/run` makes.
"""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

PROGRAMS = Path(os.environ.get("SLOWTIME_LIGHT", "."))

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif("SLOWTIME_LIGHT" not in os.environ, reason="SLOWTIME_LIGHT is not set"),
]


def run(*words, folder):
    return subprocess.run(
        [PROGRAMS / "slowtime", *words], cwd=folder, capture_output=True, text=True, check=False
    )


def test_nothing_is_installed_that_the_edge_does_not_run():
    listed = subprocess.run(
        [PROGRAMS / "python", "-m", "pip", "list", "--format", "freeze"],
        capture_output=True, text=True, check=True,
    ).stdout.lower()  # fmt: skip
    installed = set(re.findall(r"^([\w.-]+)==", listed, re.M))
    assert {"numpy", "scipy", "slowtime"} <= installed
    assert not installed & {"fastapi", "h5py", "llvmlite", "mcap", "numba", "plotly", "rich"}


@pytest.mark.parametrize("words", [("--help",), ("edge", "--help"), ("twin", "--help")])
def test_help_is_given_without_extras(words, tmp_path):
    assert "slowtime" in run(*words, folder=tmp_path).stdout


def test_an_edge_over_a_file_leaves_features_in_its_spool(tmp_path):
    np.savetxt(tmp_path / "a.csv", np.random.default_rng(1).standard_normal((3000, 2)))
    (tmp_path / "edge.toml").write_text(
        'connect = ["tcp/127.0.0.1:1"]\nconnect_wait_s = 0.0\n'
        '[input]\nkind = "file"\npath = "a.csv"\nrate_hz = 100.0\nstart_ns = 1\n'
        "[extract]\nwindow_s = 10.0\n[publish]\nlinger_s = 0.0\n"
    )
    done = run("edge", "--config", "edge.toml", "--spool", "spool", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    files = [path for path in (tmp_path / "spool").rglob("*") if path.is_file()]
    kept = b"".join(path.read_bytes() for path in files)
    assert kept.count(b'"sequence"') == 3


def test_a_simulated_tower_needs_no_compiler(tmp_path):
    code = (
        "from slowtime_services.simulate import simulated_structure as made\n"
        "from slowtime_cli.shared.demo_structures import structure\n"
        "print(sum(len(block.samples) for block in made(structure('tower')).epoch(0)))"
    )
    done = subprocess.run(
        [PROGRAMS / "python", "-c", code], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.stdout.strip() == "3000", done.stderr


@pytest.mark.parametrize(
    ("words", "verb", "extra"),
    [
        (("twin",), "twin run", "twin"),
        (("identify", "a.csv"), "identify", "analysis"),
        (("edge", "--file", "a.mcap"), "edge", "analysis"),
    ],
)
def test_a_verb_that_needs_more_names_the_extra(words, verb, extra, tmp_path):
    (tmp_path / "a.csv").write_text("1\n2\n")
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    done = run(*words, folder=tmp_path)
    assert done.returncode == 2
    told = rf"`slowtime {verb}` needs .* 'slowtime\[{extra}\]'` installs: \w+ is missing\."
    assert re.search(told, done.stderr)


def test_an_edge_reads_text_without_extras(tmp_path):
    (tmp_path / "a.csv").write_text("1\n2\n")
    assert "Give --rate-hz" in run("edge", "--file", "a.csv", folder=tmp_path).stderr


def test_a_matlab_file_of_hdf5_names_what_reads_it(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"\0" * 512 + b"\x89HDF\r\n\x1a\n" + b"\0" * 64)
    code = "from slowtime_services.files import read_record; read_record('a.mat', rate_hz=1.0)"
    path = code.replace("'a.mat'", "__import__('pathlib').Path('a.mat')")
    done = subprocess.run(
        [PROGRAMS / "python", "-c", path], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert "pip install 'slowtime[formats]' or pip install h5py" in done.stderr
