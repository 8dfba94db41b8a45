"""Modes of many channels against pyOMA-2 in the same run, and what an endless stream costs.

Run `python -m benchmarks.methods.modal [--runs 20] [--seeds 3] [--hours 2]`. All read the same
simulated records at the same block rows, model orders and number of blocks for the uncertainty:
`slowtime` with past and future whitened, as `identify_modes` does, `plain` without, as pyOMA-2.
At each order the pole nearest to each true mode is compared with the truth: errors over the
uncertainty law, and how often the 95 % interval of either holds it. Time and memory are those
of covariance-driven subspace identification with standard deviations of frequency, damping and
shape; memory is the most that a reading holds at once, beside the record. pyOMA-2 leaves out
unstable poles as it goes; here they are left out afterwards. Last, whole identifications by
`identify_modes` are beside bare runs of pyOMA-2 without deviations.
"""

import argparse
import contextlib
import dataclasses
import functools
import importlib.util
import io
import logging
import pickle
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg

from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Structure
from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.recursive import RecursiveModes
from slowtime.identification.single_mode.bounds import ambient_law
from slowtime.identification.subspace.ssi import Weighting, ssi_covariance

FASTER = 5.0
CHANCE = 2.0
"""Standard errors by which squared errors may be larger than the peer's and be no worse."""

COVERAGE = 0.90
MOST_SHARE = 0.10
LEVEL = 1.96
BLOCKS = 48
"""Draws of the one, segments of the other."""

REACH = 4.0
"""Half-bandwidths about a true mode within which a pole is one of it."""

Errors = list[tuple[float, float, float, float] | None]
Read = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Frequency [Hz] and damping ratio of the poles of one order, then their deviations."""


@dataclasses.dataclass(frozen=True, slots=True)
class ChainCase:
    """Unit masses in a row, every mode damped alike, heard at every mass through noise."""

    masses: int
    highest_hz: float
    rate_hz: float
    seconds: float
    block_rows: int
    orders: tuple[int, ...]
    damping_ratio: float = 0.01
    noise: float = 0.1

    @property
    def structure(self) -> tuple[Structure, np.ndarray]:
        """Structure and its natural frequencies [Hz]."""
        number = self.masses
        stiffness = 2 * np.eye(number) - np.eye(number, k=1) - np.eye(number, k=-1)
        stiffness[-1, -1] = 1.0
        values, shapes = scipy.linalg.eigh(stiffness)
        omega = np.sqrt(values / values[-1]) * 2 * np.pi * self.highest_hz
        whole = Structure(
            mass=np.eye(number),
            damping=shapes * (2 * self.damping_ratio * omega) @ shapes.T,
            stiffness=shapes * omega**2 @ shapes.T,
        )
        return whole, omega / (2 * np.pi)

    def record(self, rng: np.random.Generator) -> np.ndarray:
        """Accelerations and noise."""
        count = round(self.seconds * self.rate_hz)
        motion = ambient_structure(self.structure[0], count, self.rate_hz, rng)
        noise = rng.standard_normal(motion.shape) * motion.std(axis=0)
        return np.asarray(motion + self.noise * noise)


ACCURACY = ChainCase(3, 4.05, 12.0, 1500.0, 15, (6, 8, 10, 12))
SPEEDS = (
    ChainCase(6, 4.5, 12.0, 3000.0, 20, tuple(range(2, 51, 2))),
    ChainCase(6, 4.5, 12.0, 3000.0, 30, tuple(range(2, 81, 2))),
    ChainCase(10, 4.5, 12.0, 3000.0, 20, tuple(range(2, 61, 2))),
)
STREAM = ChainCase(16, 80.0, 200.0, 600.0, 12, ())
WHOLE = (
    (ChainCase(3, 40.0, 100.0, 600.0, 0, ()), ((20, 40), (30, 60), (50, 100))),
    (ChainCase(16, 80.0, 200.0, 600.0, 0, ()), ((20, 60), (30, 80), (50, 100))),
)
"""Records of whole identifications; block rows and highest orders of the bare runs beside."""

MOST_OF_BARE = 2.0
"""Most processor time of a whole identification, over that of a bare run [1]."""


def ours(case: ChainCase, record: np.ndarray, weighting: Weighting = "both") -> dict[int, Read]:
    """Read a record by slowtime."""
    poles = ssi_covariance(
        record,
        case.rate_hz,
        block_rows=case.block_rows,
        orders=case.orders,
        weighting=weighting,
    )
    sd_f, sd_z, _ = poles.standard_deviations()
    poles.shape_sd()
    return {
        order: (poles.frequency_hz[at], poles.damping_ratio[at], sd_f[at], sd_z[at])
        for order in case.orders
        for at in [(poles.order == order) & (poles.damping_ratio > 0)]
    }


def theirs(case: ChainCase, record: np.ndarray, deviations: bool = True) -> dict[int, Read]:
    """Read a record by pyOMA-2, nothing of its poles left out but unstable ones.

    Without `deviations`, it computes none, and those that are returned are NaN.
    """
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    logging.disable(logging.CRITICAL)
    algorithm = SSI(
        name="peer",
        method="cov",
        br=case.block_rows,
        ordmax=max(case.orders),
        step=2,
        calc_unc=deviations,
        nb=BLOCKS,
        hc={"xi_max": 0.99, "mpc_lim": None, "mpd_lim": None, "CoV_max": None},
    )
    with contextlib.redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        setup = SingleSetup(record, fs=case.rate_hz)
        setup.add_algorithms(algorithm)
        setup.run_by_name("peer")
    found = algorithm.result
    unknown = np.full_like(found.Fn_poles, np.nan)
    tables = (
        (found.Fn_poles, found.Xi_poles, found.Fn_poles_std, found.Xi_poles_std)
        if deviations
        else (found.Fn_poles, found.Xi_poles, unknown, unknown)
    )
    read: dict[int, Read] = {}
    for order in case.orders:
        columns = [np.asarray(table)[:, order // 2] for table in tables]
        there = np.isfinite(columns[0])
        read[order] = tuple(column[there] for column in columns)
    return read


READERS: dict[str, Callable[[ChainCase, np.ndarray], dict[int, Read]]] = {
    "slowtime": ours,
    "plain": functools.partial(ours, weighting="none"),
    "pyOMA-2": theirs,
    "pyOMA-2, bare": functools.partial(theirs, deviations=False),
}


def errors(case: ChainCase, read: Read) -> Errors:
    """Error of each true mode over the law and over what was said; None where it was missed."""
    frequency, damping, sd_f, sd_z = read
    out: Errors = []
    for true_hz in case.structure[1]:
        width = case.damping_ratio * true_hz
        distance = np.hypot(frequency - true_hz, damping * true_hz - width)
        if not len(distance) or not distance.min() < REACH * width:
            out.append(None)
            continue
        k = int(np.argmin(distance))
        law = ambient_law(case.damping_ratio, true_hz * case.seconds)
        off_f, off_z = frequency[k] - true_hz, damping[k] - case.damping_ratio
        out.append(
            (
                off_f / true_hz / law[0],
                off_z / case.damping_ratio / law[1],
                off_f / sd_f[k],
                off_z / sd_z[k],
            )
        )
    return out


def accuracy(names: Sequence[str], runs: int) -> bool:
    """Print errors and coverage at every order; whether slowtime is no worse."""
    case = ACCURACY
    collected: dict[tuple[str, int], Errors] = {}
    for seed in range(runs):
        record = case.record(np.random.default_rng(seed))
        for name in names:
            for order, read in READERS[name](case, record).items():
                collected.setdefault((name, order), []).extend(errors(case, read))
    print(
        f"Accuracy: {case.masses} modes damped by {100 * case.damping_ratio:g} %, "
        f"{case.seconds:g} s at {case.rate_hz:g} Hz, noise -20 dB, {runs} runs; RMSE / law"
    )
    print("order  method      f     zeta   95 % holds f  zeta %   missed")
    passed = True
    for order in case.orders:
        for name in names:
            every = collected[name, order]
            found = np.array([one for one in every if one is not None])
            rmse = np.sqrt(np.mean(found[:, :2] ** 2, axis=0))
            held = np.mean(np.abs(found[:, 2:]) < LEVEL, axis=0)
            fine = name != "slowtime" or bool((held >= COVERAGE).all())
            if name == "slowtime" and "pyOMA-2" in names:
                fine &= no_worse(every, collected["pyOMA-2", order])
            print(
                f"{order:5d}  {name:9s} {rmse[0]:6.2f} {rmse[1]:6.2f}          "
                f"{100 * held[0]:5.1f} {100 * held[1]:5.1f}    {len(every) - len(found):4d}"
                f"{'' if fine else '  MISSED'}",
                flush=True,
            )
            passed &= fine
    return passed


def no_worse(own: Errors, peers: Errors) -> bool:
    """Whether squared errors on the same modes are no larger than chance allows."""
    both = [(a[:2], b[:2]) for a, b in zip(own, peers, strict=True) if a and b]
    more = np.array([np.square(a) - np.square(b) for a, b in both])
    by_chance = CHANCE * more.std(axis=0) / np.sqrt(len(more))
    return bool((more.mean(axis=0) <= by_chance + 1e-9).all())


def seconds_of(name: str, case: ChainCase, record: np.ndarray, times: int = 3) -> float:
    """CPU seconds of one reading, the best of some."""
    spent = []
    for _ in range(times):
        begun = time.process_time()
        READERS[name](case, record)
        spent.append(time.process_time() - begun)
    return min(spent)


def peak_of(name: str, case: ChainCase, record: np.ndarray) -> float:
    """Most that the arrays and objects of one reading hold at once [MB]."""
    tracemalloc.start()
    try:
        READERS[name](case, record)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def speed(names: Sequence[str]) -> bool:
    """Print time and peak memory; whether slowtime is fast enough."""
    print(
        "\nSSI-cov with deviations of frequency, damping and shape at every order (bare: none)"
    )
    print("channels  rows  orders    samples  method         CPU s   peak MB   ratio of time")
    passed = True
    for case in SPEEDS:
        record = case.record(np.random.default_rng(0))
        spent = {}
        for name in names:
            times = 1 if name.startswith("pyOMA-2") else 3
            spent[name] = seconds_of(name, case, record, times)
            ratio = spent[name] / spent["slowtime"]
            peak = peak_of(name, case, record)
            print(
                f"{case.masses:8d}  {case.block_rows:4d}  2..{max(case.orders):3d}  "
                f"{len(record):10d}  {name:13s} {spent[name]:6.2f} {peak:9.0f}"
                f"   {ratio:8.1f}",
                flush=True,
            )
        if "pyOMA-2" in names:
            passed &= spent["pyOMA-2"] >= FASTER * spent["slowtime"]

    return passed


def whole(seeds: int) -> bool:
    """Print time and errors of whole identifications; whether they take little enough.

    pyOMA-2 runs bare: covariances, decomposition and poles of every order, but no bands, no
    choice of modes and no standard deviations.
    """
    peer = importlib.util.find_spec("pyoma2") is not None
    print("\nWhole identification (bands, orders, choice, fits, intervals) beside bare SSI-cov")
    passed = True
    for case, sizes in WHOLE:
        record = case.record(np.random.default_rng(0))
        bare = {one: bare_seconds(case, record, *one) for one in sizes if peer}
        spent: list[float] = []
        found: Errors = []
        for seed in range(seeds):
            record = case.record(np.random.default_rng(seed))
            begun = time.process_time()
            modes = identify_modes(record, case.rate_hz).structural
            spent.append(time.process_time() - begun)
            of_each = [(mode.frequency_hz, mode.damping_ratio) for mode in modes]
            columns = [
                [getattr(m[k], n) for m in of_each] for n in ("value", "sd") for k in (0, 1)
            ]
            found += errors(case, tuple(np.array(column) for column in columns))  # type: ignore[arg-type]
        there = np.array([one for one in found if one is not None])
        rmse = np.sqrt(np.mean(there[:, :2] ** 2, axis=0))
        held = 100 * np.mean(np.abs(there[:, 2:]) < LEVEL, axis=0)
        typical = float(np.median(spent))
        print(
            f"{case.masses} channels, {case.seconds:g} s at {case.rate_hz:g} Hz, {seeds} seeds"
            f", CPU {typical:.2f} s; RMSE / law f {rmse[0]:.2f} zeta {rmse[1]:.2f}; 95 % holds "
            f"{held[0]:.1f} % and {held[1]:.1f} %; {len(found) - len(there)} missed",
            flush=True,
        )
        for (rows, order), seconds in bare.items():
            fine = typical <= MOST_OF_BARE * seconds
            passed &= fine
            print(
                f"  bare, {rows} block rows, orders to {order}: {seconds:.2f} s, ratio "
                f"{typical / seconds:.1f}{'' if fine else '  MISSED'}",
                flush=True,
            )
    return passed


def bare_seconds(case: ChainCase, record: np.ndarray, block_rows: int, highest: int) -> float:
    """CPU seconds of one bare run of pyOMA-2, the best of three."""
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    logging.disable(logging.CRITICAL)
    spent = []
    for _ in range(3):
        algorithm = SSI(name="peer", method="cov", br=block_rows, ordmax=highest)
        begun = time.process_time()
        with contextlib.redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
            setup = SingleSetup(record, fs=case.rate_hz)
            setup.add_algorithms(algorithm)
            setup.run_by_name("peer")
        spent.append(time.process_time() - begun)
    return min(spent)


def stream(hours: int, every_s: float) -> bool:
    """Print what each hour of an endless stream costs; whether that is little and steady."""
    case = STREAM
    recursive = RecursiveModes(rate_hz=case.rate_hz, band_hz=(1.0, 90.0), every_s=every_s)
    state = recursive.start()
    print(
        f"\nStream: {case.masses} channels at {case.rate_hz:g} Hz, 1-90 Hz, blocks of 1 s, "
        f"bands solved each {every_s:g} s (aim: {100 * MOST_SHARE:g} % of a core)"
    )
    print("hour   CPU s   share of a core %   dearest block s   state MB   modes of 16")
    shares = []
    modes: tuple[object, ...] = ()
    for hour in range(hours):
        spent = dearest = 0.0
        for part in range(round(3600 / case.seconds)):
            record = case.record(np.random.default_rng([hour, part]))
            for at in range(0, len(record), round(case.rate_hz)):
                begun = time.process_time()
                state, modes = recursive.step(state, record[at : at + round(case.rate_hz)])
                took = time.process_time() - begun
                spent, dearest = spent + took, max(dearest, took)
        shares.append(spent / 3600.0)
        size = len(pickle.dumps(state)) / 1e6
        print(
            f"{hour + 1:4d}  {spent:6.1f}   {100 * shares[-1]:17.2f}   {dearest:15.2f}"
            f"   {size:8.1f}   {len(modes):11d}",
            flush=True,
        )
    if not shares:
        return True
    return max(shares) <= MOST_SHARE and max(shares) <= 1.5 * max(shares[:2])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print all tables; status 1 if any figure misses its mark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=20, help="seeded records for accuracy")
    parser.add_argument("--seeds", type=int, default=3, help="of whole identifications")
    parser.add_argument("--hours", type=int, default=2, help="of the stream")
    parser.add_argument("--every", type=float, default=60.0, help="seconds between solutions")
    parser.add_argument("--speed", action="store_true", help="print time and memory only")
    given = parser.parse_args(arguments)
    names = ["slowtime", "plain", "pyOMA-2"]
    if importlib.util.find_spec("pyoma2") is None:
        names.remove("pyOMA-2")
        print(
            "pyOMA-2 is not installed here, so nothing is compared with it. `make bench` "
            "installs it into .venv-peers.\n"
        )
    bare = [f"{names[-1]}, bare"] if "pyOMA-2" in names else []
    passed = given.speed or accuracy(names, given.runs)
    passed &= speed(names + bare)
    passed &= whole(given.seeds)
    passed &= given.speed or stream(given.hours, given.every)
    print("\nall within their marks" if passed else "\nSOME FIGURE MISSED ITS MARK")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
