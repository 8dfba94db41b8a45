"""Roving hammers and sensors: records that SciPy simulates, one for each point."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from tests.slowtime.identification.modal_fit.test_third_party_hammer import (
    BAND,
    MASSES,
    RATE,
    STIFFNESS,
    TRUTH,
    record,
)


@pytest.mark.parametrize("roving", ["hammer", "sensor"])
def test_roving_hammers_and_sensors_give_all_modes_with_whole_shapes(run, roving):
    content = b""
    for place in range(5):
        force, responses = record(40 + place, place if roving == "hammer" else 4)
        seen = responses[:, 4 if roving == "hammer" else place]
        names = (f"f{place}", "a4") if roving == "hammer" else ("f4", f"a{place}")
        np.savez(f"{place}.npz", rate_hz=RATE, **dict(zip(names, (force, seen), strict=True)))
        flags = ("--input", names[0], "--setting", "excitation=hammer", "--band-hz", *BAND)
        done = run(
            "identify", f"{place}.npz", *flags, "--setting", "block_s=5.5", "--frf", "h.uff"
        )
        assert done.status == 0, done.err
        content += Path("h.uff").read_bytes()
    Path("all.uff").write_bytes(content)
    modes = run("identify", "all.uff", "--out", "-").json["modes"]
    assert len(modes) == 5
    shapes = scipy.linalg.eigh(STIFFNESS, MASSES)[1]
    for mode, (hz, damping), true in zip(modes, TRUTH, shapes.T, strict=True):
        for name, value in (("frequency_hz", hz), ("damping_ratio", damping)):
            assert abs(mode[name]["value"] - value) < 3 * mode[name]["sd"]
        shape = np.array(mode["shape"]["re"]) + 1j * np.array(mode["shape"]["im"])
        size = np.vdot(shape, shape).real * (true @ true)
        assert abs(np.vdot(shape, true)) ** 2 / size > 0.999
