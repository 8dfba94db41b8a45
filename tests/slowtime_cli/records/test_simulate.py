import numpy as np
import pytest

from slowtime_services.replay import raw_blocks


def test_a_recording_holds_blocks_and_their_truth(run, tmp_path):
    done = run("simulate", "--structure", "tower", "--epochs", 2, "--out", "a.mcap")
    assert (done.status, done.err) == (0, "")
    assert done.out == "a.mcap: 2 epochs of 60 s at 50 Hz\n"
    blocks = [block for _, block in raw_blocks("a.mcap")]
    assert {block.epoch for block in blocks} == {0, 1}
    assert all("stiffness_change" in block.truth for block in blocks)


def test_arrays_hold_the_same_samples(run, tmp_path):
    flags = ("--structure", "wing", "--epochs", 2, "--seed", 7)
    for name in ("a.mcap", "a.npz"):
        assert run("simulate", *flags, "--out", name).status == 0
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    assert arrays["acceleration"].shape == (2, 1000)
    assert float(arrays["rate_hz"]) == 50.0
    assert len(arrays["true_stiffness_change"]) == len(arrays["slow_time"]) == 2
    recorded = np.concatenate([block.samples[:, 0] for _, block in raw_blocks("a.mcap")])
    np.testing.assert_array_equal(arrays["acceleration"].ravel(), recorded)


def test_every_channel_of_a_frame_is_an_array_of_its_own(run, tmp_path):
    flags = ("--structure", "frame", "--epochs", 32)
    done = run("simulate", *flags, "--out", "a.npz")
    assert done.out == "a.npz: 32 epochs of 120 s at 50 Hz\n"
    assert run("simulate", *flags, "--out", "a.mcap").status == 0
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    for number, (_, block) in enumerate(raw_blocks("a.mcap")):
        for column, channel in enumerate(block.channels):
            assert channel == f"a_floor{column + 1}"
            np.testing.assert_array_equal(arrays[channel][number], block.samples[:, column])
        assert block.truth["element.storey2"] == arrays["true_element.storey2"][number]
    assert arrays["true_element.storey2"][30] == 0 > arrays["true_element.storey2"][31]
    assert not arrays["true_element.storey1"].any()


def test_a_seed_decides_every_number(run, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        flags = ("--structure", "tank", "--epochs", 1, "--seed", seed)
        assert run("simulate", *flags, "--out", f"{name}.mcap").status == 0
    a, b, c = ((tmp_path / f"{name}.mcap").read_bytes() for name in "abc")
    assert a == b != c


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--out", "a.mcap"), "Missing option '--structure' or '--model'"),
        (
            ("--structure", "cathedral", "--out", "a.mcap"),
            "not one of 'bridge', 'frame', 'tank', 'tower', 'wing'",
        ),
        (("--structure", "tower", "--out", "a.csv"), "does not end in .mcap or .npz"),
        (("--structure", "tower", "--out", "nowhere/a.npz"), "There is no folder nowhere"),
        (("--structure", "tower", "--epochs", "0", "--out", "a.npz"), "0 is not in the range"),
        (("--structure", "tower", "--seed", "-1", "--out", "a.npz"), "-1 is not in the range"),
        (
            ("--structure", "tower", "--epochs", "1000000", "--out", "a.npz"),
            "of at most 1024 MiB. Give fewer --epochs, or write .mcap.",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(refused, tmp_path, flags, says):
    assert says in refused("simulate", *flags)
    assert not list(tmp_path.iterdir())


def test_a_recording_is_never_written_over(refused, tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"precious")
    assert "may be the only copy" in refused(
        "simulate", "--structure", "tower", "--epochs", 1, "--out", "a.mcap"
    )
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"
