"""Migration, backup, restore, adoption and composites killed by SIGKILL at each of their steps.

A step is a statement of SQL, or a call that copies, renames, removes or syncs a file. The
process dies before it; afterwards the database is as before or as after, never in between.
"""

import contextlib
import itertools
import os
import shutil
import signal
import sqlite3

import pytest

from twin_server.history.states import LAYOUT, blank
from twin_server.persist import CompositeRow, SqliteStore, backup, restore
from twin_server.persist.layout import APPLICATION
from twin_server.pipeline import Pipeline
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

from .test_layout import VERSION_3, filled, told

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system"),
]

MOST_KILLS = 40
"""Kills of one operation, spread evenly over its steps and at each of the last five."""


class Steps:
    """Counts the steps of this process, and kills it before one of them."""

    def __init__(self, kill_at):
        self.count, self._kill_at = 0, kill_at

    def step(self, *_):
        if self.count == self._kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
        self.count += 1

    def install(self):
        connect = sqlite3.connect

        def connected(*arguments, **options):
            connection = connect(*arguments, **options)
            connection.set_trace_callback(self.step)
            return connection

        sqlite3.connect = connected
        for name in ("rename", "replace", "unlink", "fsync"):
            setattr(os, name, self._before(getattr(os, name)))
        shutil.copyfile = self._before(shutil.copyfile)

    def _before(self, function):
        def stepped(*arguments, **options):
            self.step()
            return function(*arguments, **options)

        return stepped


def steps_of(operation, kill_at=-1):
    """Do something in a process of its own; return its steps, or None where it was killed."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        steps = Steps(kill_at)
        with contextlib.suppress(BaseException):
            steps.install()
            operation()
            os.write(writer, str(steps.count).encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as told_steps:
        text = told_steps.read()
    _, status = os.waitpid(pid, 0)
    if os.WIFSIGNALED(status):
        assert os.WTERMSIG(status) == signal.SIGKILL
        return None
    return int(text)


def places(count):
    """Steps before which an operation of so many is killed."""
    spread = {count * turn // MOST_KILLS for turn in range(MOST_KILLS)}
    return sorted(spread | set(range(max(0, count - 5), count)))


def outcomes(tmp_path, prepare, operation, look):
    """What is found after each kill, of a folder of its own each; first before, then after."""
    folders = (tmp_path / str(number) for number in itertools.count())

    def fresh():
        folder = next(folders)
        folder.mkdir()
        prepare(folder)
        return folder

    before = look(fresh())
    whole = fresh()
    count = steps_of(lambda: operation(whole))
    after = look(whole)
    found = []
    for place in places(count):
        folder = fresh()
        assert steps_of(lambda folder=folder: operation(folder), place) is None
        found.append(look(folder))
    return before, after, found


def old_database(folder):
    old = sqlite3.connect(folder / "twin.sqlite", isolation_level=None)
    old.executescript(VERSION_3)
    state = blank(1).tobytes()
    with contextlib.closing(old):
        old.execute("begin")
        old.execute("insert into twins values ('lab.beam', 1, 'lab', 'beam', '{}', '{}')")
        old.execute(
            "insert into runs values "
            "(1,'lab.beam','lab','beam','b1','d',40,39,5,39,0,'[]',0.5,1)"
        )
        for number in range(40):
            row = ((1 << 40) + number, number, number / 2, b"m" * 500, state)
            old.execute("insert into features values (?,?,?,?,?)", row)
        old.execute(f"pragma application_id = {APPLICATION}")
        old.execute(f"pragma user_version = {256 * LAYOUT + 3}")
        old.execute("commit")


def opened_and_closed(folder):
    SqliteStore(folder / "twin.sqlite").close()


def test_a_killed_migration_is_done_again_from_the_beginning_or_not_at_all(tmp_path):
    def look(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            return store.twins(), store.runs(), store.messages("lab.beam", (0, -1), 99)

    before, after, found = outcomes(tmp_path, old_database, opened_and_closed, look)
    assert before == after
    assert len(after[2]) == 40
    assert len(found) >= MOST_KILLS
    assert all(one == after for one in found)


def test_a_killed_backup_leaves_a_whole_copy_or_none_of_its_name(tmp_path):
    def prepare(folder):
        filled(folder / "twin.sqlite").close()

    def look(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            database = told(store)
        out = folder / "monday.sqlite"
        if not out.exists():
            return database, None
        with contextlib.closing(SqliteStore(out)) as store:
            return database, told(store)

    before, after, found = outcomes(
        tmp_path,
        prepare,
        lambda folder: backup(folder / "twin.sqlite", folder / "monday.sqlite"),
        look,
    )
    assert before[1] is None
    assert after == (before[0], before[0])
    assert set(map(repr, found)) <= {repr(before), repr(after)}


def test_a_killed_restore_leaves_the_one_database_or_the_other(tmp_path):
    def prepare(folder):
        filled(folder / "monday.sqlite", 100).close()
        # With a log, as a server leaves it that was killed.
        shutil.copy(folder / "monday.sqlite", folder / "twin.sqlite")
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            store.add_composites([CompositeRow(0, "lab.all", 1, "me", "{}")])

    def look(folder):
        # Whoever restores again, or moves back what was set aside, has one of the two.
        path = folder / "twin.sqlite"
        if not path.exists():
            aside = folder / "twin.sqlite.aside-1"
            assert aside.exists()
            path = aside
        with contextlib.closing(SqliteStore(path)) as store:
            return path == folder / "twin.sqlite", store.composites(), told(store)

    before, after, found = outcomes(
        tmp_path,
        prepare,
        lambda folder: restore(folder / "monday.sqlite", folder / "twin.sqlite"),
        look,
    )
    assert before[1]
    assert not after[1]
    assert {repr(one[1:]) for one in found} <= {repr(before[1:]), repr(after[1:])}
    # The moment without a file of that name is short, and what was there is beside it.
    assert sum(not one[0] for one in found) <= 8


NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}
ADOPTED = {"nominal": NOMINAL, "name": "with friction"}


@pytest.mark.parametrize("back", [False, True], ids=["adopt", "undo"])
def test_a_killed_adoption_or_undoing_leaves_the_twin_before_or_after(
    tmp_path, ageing, sample, back
):
    """Both register the twin again, with an event, and estimate its history anew."""

    def register(folder, body, kind):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            pipeline = Pipeline(TwinSettings(), store)
            pipeline.register("lab.beam", Registration.model_validate(body), kind, "So it was.")

    def prepare(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            pipeline = Pipeline(TwinSettings(), store)
            pipeline.register("lab.beam", Registration.model_validate({"nominal": NOMINAL}))
            pipeline.ingest(map(sample, ageing(30)))
        if back:
            register(folder, ADOPTED, "adopted")

    def operation(folder):
        if back:
            register(folder, {"nominal": {**NOMINAL, "frequency_hz": 3.1}}, "undone")
        else:
            register(
                folder, {**ADOPTED, "nominal": {**NOMINAL, "frequency_hz": 3.1}}, "adopted"
            )

    def look(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            kinds = [row.body.partition('"kind":"')[2][:8] for row in store.events()]
            return store.twins()[0].registration, store.digest("lab.beam"), kinds

    before, after, found = outcomes(tmp_path, prepare, operation, look)
    assert before[0] != after[0]
    assert before[1] != after[1]
    assert len(found) >= MOST_KILLS
    assert {repr(one) for one in found} <= {repr(before), repr(after)}


def test_a_killed_change_of_composites_leaves_all_of_them_before_or_after(tmp_path):
    def prepare(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            store.add_composites([CompositeRow(0, "lab.all", 1, "me", "{}")])

    def operation(folder):
        rows = [CompositeRow(0, f"lab.c{number}", 2, "me", "{}") for number in range(5)]
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            store.add_composites(rows)

    def look(folder):
        with contextlib.closing(SqliteStore(folder / "twin.sqlite")) as store:
            return [(row.number, row.composite) for row in store.composites()]

    before, after, found = outcomes(tmp_path, prepare, operation, look)
    assert (len(before), len(after)) == (1, 6)
    assert all(one in (before, after) for one in found)
