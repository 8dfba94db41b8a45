import pytest


@pytest.fixture
def whole(run, record, tmp_path):
    """A recording of several chunks."""
    assert run("import", record, "--out", "whole.mcap").status == 0
    return (tmp_path / "whole.mcap").read_bytes()


def test_a_sound_recording_is_copied_and_called_sound(run, whole):
    done = run("recover", "whole.mcap", "--out", "out.mcap")
    assert done.status == 0
    assert done.out == (
        "out.mcap: 600 messages (600 of slowtime/v1/import/record/raw). "
        "The recording was sound; this is a copy.\n"
    )
    assert run("identify", "out.mcap", "--method", "peak").status == 0


def test_a_recording_without_its_end_is_made_sound(run, whole, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(whole[:-100])
    assert run("identify", "cut.mcap").status == 2
    done = run("recover", "cut.mcap", "--out", "out.mcap")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("out.mcap: 600 messages (600 of slowtime/v1/import/record/raw);")
    first, second = (
        run("identify", name, "--method", "peak", "--out", "-").json["modes"]
        for name in ("whole.mcap", "out.mcap")
    )
    assert first == second


def test_what_is_lost_is_told(run, whole, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 4])
    assert "at the end not readable." in run("recover", "cut.mcap", "--out", "a.mcap").out
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    done = run("recover", "damaged.mcap", "--out", "b.mcap")
    assert (done.status, "1 damaged chunk left out" in done.out) == (0, True)


def test_what_cannot_be_recovered_is_refused(refused, whole, record, tmp_path):
    for arguments, says in [
        (("missing.mcap", "--out", "a.mcap"), "File 'missing.mcap' does not exist"),
        ((record, "--out", "a.mcap"), "is no MCAP file: it begins with b'time,acc'"),
        (("whole.mcap", "--out", "whole.mcap"), "whole.mcap exists. Give another name"),
        (("whole.mcap", "--out", "a.csv"), "'a.csv' does not end in .mcap"),
        (("whole.mcap", "--out", "nowhere/a.mcap"), "There is no folder nowhere"),
    ]:
        assert says in refused("recover", *arguments)
    assert (tmp_path / "whole.mcap").read_bytes() == whole
    assert not (tmp_path / "a.mcap").exists()
