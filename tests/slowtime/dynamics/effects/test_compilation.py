"""Machine code is kept where it can be, does without where not, and survives a fork."""

import os
import subprocess
import sys
from pathlib import Path

import hypothesis
import numba
import numpy as np
import pytest
from hypothesis import strategies as st

import slowtime
from slowtime.dynamics.effects import Motion, catalogue, force_along
from slowtime.dynamics.effects.compilation import (
    ROUND,
    Routines,
    compiled,
    law_address,
    sum_rows,
)

TRY = """
import numpy as np
from slowtime.dynamics.effects import Motion, catalogue, force_along
still = np.zeros(3)
seen = Motion(e=np.arange(3.0), v=still, a=still, times=np.arange(3.0))
print(force_along(catalogue()["cubic_hardening"], {"k3_n_per_m3": 5.0}, seen)[2])
"""
ROOT = Path(slowtime.__file__).parents[1]


def tried(path, **environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", TRY],
        env=os.environ | {"PYTHONPATH": str(path)} | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


@pytest.mark.long
def test_code_is_kept_in_a_folder_of_ones_own_choice(tmp_path):
    assert tried(ROOT, NUMBA_CACHE_DIR=str(tmp_path)) == 40.0
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}
    assert kept
    assert tried(ROOT, NUMBA_CACHE_DIR=str(tmp_path)) == 40.0
    assert kept == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}


def test_where_nothing_can_be_kept_code_is_compiled_anew(monkeypatch):
    """As numba does where no folder can be written: it raises RuntimeError."""
    # What numba compiles for itself at the first use of all is not asked for by us.
    assert numba.njit(lambda number: number + 1)(2) == 3
    asked = []

    def refusing(really):
        def compile_it(*arguments, cache=False, **options):
            asked.append(cache)
            if cache:
                raise RuntimeError("cannot cache function: no locator available")
            return really(*arguments, **options)

        return compile_it

    monkeypatch.setattr(numba, "njit", refusing(numba.njit))
    monkeypatch.setattr(numba, "cfunc", refusing(numba.cfunc))
    assert compiled(lambda number: number + 1)(2) == 3
    assert law_address(lambda e, v, t, z, p: e) != 0
    assert asked == [True, False, True, False]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_code_runs_in_a_forked_process():
    still = np.zeros(3)
    seen = Motion(e=np.arange(3.0), v=still, a=still, times=np.arange(3.0))
    kind = catalogue()["cubic_hardening"]
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        force = force_along(kind, {"k3_n_per_m3": 5.0}, seen)
        os.write(write, str(float(force[2])).encode())
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert float(os.read(read, 100)) == 40.0
    for end in (read, write):
        os.close(end)


@compiled
def _sum(found, start, shares, count, rows, column):
    width = rows.shape[1]
    sum_rows(
        found.ctypes.data,
        start.ctypes.data,
        shares.ctypes.data,
        count,
        rows.ctypes.data + 8 * column,
        width,
    )


@hypothesis.given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 40),
    column=st.integers(0, 9),
    more=st.integers(0, 9),
)
def test_a_round_of_columns_is_summed_and_nothing_beside_it(seed, count, column, more):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((max(count, 1), column + ROUND + more))
    shares, start = rng.standard_normal(max(count, 1)), rng.standard_normal(ROUND)
    found = np.full(ROUND + 2, 7.0)
    _sum(found, start, shares, count, rows, column)
    due = start + shares[:count] @ rows[:count, column : column + ROUND]
    assert found[:ROUND] == pytest.approx(due, rel=1e-12, abs=1e-12)
    assert (found[ROUND:] == 7.0).all()


STORE = numba.int64[:, ::1]
ROUTINES = Routines(first_row=1)


@ROUTINES.define(numba.float64(STORE, numba.float64))
def twice(store, number):
    return 2.0 * number


@ROUTINES.define(numba.float64(STORE, numba.float64))
def twice_and_one(store, number):
    return twice(store, number) + 1.0


@ROUTINES.define(numba.float64(STORE, numba.float64), rare=True)
def never(store, number):
    return number.no_such_attribute  # cannot be compiled


@compiled
def outer(store, number):
    return twice_and_one(store, number)


@pytest.mark.long
def test_routines_call_each_other_by_the_addresses_in_the_table():
    table = np.zeros((4, 5), dtype=np.int64)
    table[1:, 0] = ROUTINES.addresses(rare=False)
    assert outer(table, 3.0) == 7.0
    # What is called is what the table says: with the same routine in both rows, no 1 is added.
    table[2, 0] = table[1, 0]
    assert outer(table, 3.0) == 6.0


@pytest.mark.long
def test_a_rare_routine_is_compiled_only_where_it_is_needed():
    assert ROUTINES.addresses(rare=False)[2] == 0
    with pytest.raises(numba.core.errors.NumbaError):
        ROUTINES.addresses(rare=True)
