import pytest
from mcap.reader import make_reader

from slowtime_services.replay import raw_blocks


@pytest.fixture
def whole(run, record, tmp_path):
    """A recording of several chunks."""
    assert run("import", record, "--out", "whole.mcap").status == 0
    return (tmp_path / "whole.mcap").read_bytes()


def test_a_sound_recording_is_copied_and_called_sound(run, whole):
    done = run("mcap", "recover", "whole.mcap", "--out", "out.mcap")
    assert done.status == 0
    assert done.out == (
        "out.mcap: 600 messages (600 of slowtime/v2/import/raw/112/record). "
        "The recording was sound; this is a copy.\n"
    )
    assert run("identify", "out.mcap", "--method", "peak").status == 0


def test_a_recording_without_its_end_is_made_sound(run, whole, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(whole[:-100])
    assert run("identify", "cut.mcap").status == 2
    done = run("mcap", "recover", "cut.mcap", "--out", "out.mcap")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith(
        "out.mcap: 600 messages (600 of slowtime/v2/import/raw/112/record);"
    )
    first, second = (
        run("identify", name, "--method", "peak", "--out", "-").json["modes"]
        for name in ("whole.mcap", "out.mcap")
    )
    assert first == second


def test_what_is_lost_is_told(run, whole, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 4])
    assert (
        "at the end not readable." in run("mcap", "recover", "cut.mcap", "--out", "a.mcap").out
    )
    damaged = bytearray(whole)
    with (tmp_path / "whole.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    damaged[summary.chunk_indexes[1].chunk_start_offset + 200] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    done = run("mcap", "recover", "damaged.mcap", "--out", "b.mcap")
    assert (done.status, "1 damaged chunk left out" in done.out) == (0, True)


def test_where_nothing_is_recovered_nothing_is_written_and_the_status_says_so(
    run, whole, tmp_path
):
    (tmp_path / "cut.mcap").write_bytes(whole[:200])
    done = run("mcap", "recover", "cut.mcap", "--out", "a.mcap")
    assert (done.status, done.out) == (1, "")
    assert "nothing was recovered: cut.mcap holds no whole message" in done.err
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize("block_s", ["1", "0.3", "0.1"])
def test_what_was_imported_and_cut_short_comes_back_but_for_a_second(run, tmp_path, block_s):
    rows = "".join(f"{i / 100:.2f},{(i * 37 % 101) / 50 - 1:.5f}\n" for i in range(3000))
    (tmp_path / "record.csv").write_text("time,acc\n" + rows)
    run("import", "record.csv", "--out", "long.mcap", "--setting", f"block_s={block_s}")
    data = (tmp_path / "long.mcap").read_bytes()
    with (tmp_path / "long.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for index in summary.chunk_indexes:
        assert index.message_end_time - index.message_start_time < 10**9
    before = sum(i.chunk_start_offset + i.chunk_length <= len(data) * 0.6
                 for i in summary.chunk_indexes)  # fmt: skip
    (tmp_path / "torn.mcap").write_bytes(data[: len(data) * 6 // 10])
    assert run("mcap", "recover", "torn.mcap", "--out", "back.mcap").status == 0
    blocks = [block for _, block in raw_blocks(tmp_path / "back.mcap")]
    assert sum(len(block.samples) for block in blocks) >= 90 * before > 1400


def test_what_cannot_be_recovered_is_refused(refused, whole, record, tmp_path):
    for arguments, says in [
        (("missing.mcap", "--out", "a.mcap"), "File 'missing.mcap' does not exist"),
        ((record, "--out", "a.mcap"), "is not a valid MCAP file: it begins with b'time,acc'"),
        (("whole.mcap", "--out", "whole.mcap"), "whole.mcap exists. Give another name"),
        (("whole.mcap", "--out", "a.csv"), "'a.csv' does not end in .mcap"),
        (("whole.mcap", "--out", "nowhere/a.mcap"), "There is no folder nowhere"),
    ]:
        assert says in refused("mcap", "recover", *arguments)
    assert (tmp_path / "whole.mcap").read_bytes() == whole
    assert not (tmp_path / "a.mcap").exists()
