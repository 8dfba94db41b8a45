"""Modal tests beside sdypy-EMA and pyOMA-2: accuracy and time on the same data.

`.venv-peers/bin/python -m benchmarks.methods.modal_testing --seeds 30`

Frequency responses of a five-storey frame with noise go to slowtime and to the LSCF of
sdypy-EMA, which is told where the modes are. Records of three set-ups go to slowtime (merged
before and after identification) and to the PreGER and PoSER of pyOMA-2.
"""

import argparse
import contextlib
import io
import logging
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime.identification.modal_fit.identification import identify_responses
from slowtime.identification.mode_shapes.merging import SetUp, merge
from slowtime.identification.subspace.setup_merging import SetUpRecord, merge_before

STOREYS, DAMPING, FIRST_HZ = 5, 0.01, 3.0
SPACING_HZ, LINES = 0.05, 600
NOISE = 0.05
"""Of the frequency responses, relative to their median size [1]."""
RATE_HZ, SECONDS = 64.0, 600.0
PARTS, LEVELS = ((4, 2, 0), (4, 2, 1), (4, 2, 3)), (1.0, 3.0, 0.5)
"""Storeys of each set-up, 4 and 2 staying, and how strong the wind was."""

Found = tuple[np.ndarray, np.ndarray]
"""Frequencies [Hz] and damping ratios of the modes, nan where not found."""


def frame() -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and mass-normalised shapes of a shear frame of unit masses."""
    angle = (2 * np.arange(1, STOREYS + 1) - 1) * np.pi / (2 * STOREYS + 1)
    shapes = np.sin(np.outer(np.arange(1, STOREYS + 1), angle))
    frequency = np.sin(angle / 2)
    return FIRST_HZ * frequency / frequency[0], shapes / np.linalg.norm(shapes, axis=0)


def accelerance(s: np.ndarray, places: Sequence[int]) -> np.ndarray:
    """Acceleration of all storeys per force at some, [line output input]."""
    hz, shapes = frame()
    omega = 2 * np.pi * hz
    modal = s[:, None] ** 2 / (s[:, None] ** 2 + 2 * DAMPING * omega * s[:, None] + omega**2)
    return np.asarray(np.einsum("ok,fk,ik->foi", shapes, modal, shapes[list(places)]))


def measured(seed: int) -> FrequencyResponse:
    """Frequency responses of one force, with noise."""
    rng = np.random.default_rng(seed)
    hz = SPACING_HZ * np.arange(1, LINES + 1)
    true = accelerance(2j * np.pi * hz, [4])
    sd = np.full(true.shape, NOISE * np.median(np.abs(true)))
    error = rng.standard_normal(true.shape) + 1j * rng.standard_normal(true.shape)
    return FrequencyResponse(
        frequency_hz=hz,
        response=true + sd * error / np.sqrt(2),
        sd=sd,
        coherence=np.full(true.shape[:2], np.nan),
        averages=10,
        kind="acceleration",
    )


def by_slowtime(response: FrequencyResponse) -> Found:
    """Modes without a hint where they are."""
    modes = identify_responses(response).result.modes
    hz = np.array([mode.frequency_hz.value for mode in modes])
    damping = np.array([mode.damping_ratio.value for mode in modes])
    return nearest(hz, damping)


def by_sdypy(response: FrequencyResponse) -> Found:
    """Modes of LSCF at order 40, the stable pole closest to each true frequency."""
    import sdypy.EMA

    hz = np.concatenate([[0.0], response.frequency_hz])
    whole = np.concatenate([np.zeros((1, STOREYS)), response.response[:, :, 0]]).T
    model = sdypy.EMA.Model(
        whole, hz, lower=1, upper=hz[-2], pol_order_high=40, frf_form="accelerance"
    )
    with _silent():
        model.get_poles(show_progress=False)
        model.select_closest_poles(list(frame()[0]), f_window=1)
        model.get_constants()
    return nearest(np.asarray(model.nat_freq), np.asarray(model.nat_xi))


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep what other packages print to themselves."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        logging.disable(logging.INFO)
        with contextlib.redirect_stderr(io.StringIO()):
            yield
        logging.disable(logging.NOTSET)


def nearest(hz: np.ndarray, damping: np.ndarray) -> Found:
    """Return the mode nearest to each true one, within a twentieth."""
    found = np.full((2, STOREYS), np.nan)
    for k, true in enumerate(frame()[0]):
        near = int(np.argmin(np.abs(hz - true))) if len(hz) else -1
        if near >= 0 and abs(hz[near] / true - 1) < 0.05:
            found[:, k] = hz[near], damping[near]
    return found[0], found[1]


def bound(response: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
    """Return standard deviations of the Cramér-Rao bound, by the fit at the truth."""
    from slowtime.identification.modal_fit.basis import pole_quantities
    from slowtime.identification.modal_fit.identification import data_of
    from slowtime.identification.modal_fit.maximum_likelihood import fit_poles

    omega = 2 * np.pi * frame()[0]
    poles = omega * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    fit = fit_poles(data_of(response), poles, rounds=0)
    _, _, derivative = pole_quantities(fit.poles)
    sd = []
    for k in range(STOREYS):
        both = np.ix_([k, STOREYS + k], [k, STOREYS + k])
        sd.append(np.sqrt(np.diag(derivative[k] @ fit.covariance[both] @ derivative[k].T)))
    return np.array(sd)[:, 0], np.array(sd)[:, 1]


def compare_responses(seeds: int) -> None:
    """Print errors over the bound, and times."""
    data = [measured(seed) for seed in range(seeds)]
    law = bound(data[0])
    for name, find in (("slowtime", by_slowtime), ("sdypy-EMA", by_sdypy)):
        found, seconds = timed(find, data)
        if found is None:
            continue
        for what, values, true, sd in (
            ("frequency", [f for f, _ in found], frame()[0], law[0]),
            ("damping", [z for _, z in found], np.full(STOREYS, DAMPING), law[1]),
        ):
            squared = np.ma.masked_invalid((np.array(values) - true) ** 2)
            rmse = np.ma.sqrt(squared.mean(axis=0))
            ratio = np.round(np.ma.filled(rmse / sd, np.nan), 2)
            print(f"{name}: RMSE of {what} over the bound: {ratio}")
        missing = int(np.isnan([f for f, _ in found]).sum())
        print(f"{name}: {missing} modes missing; {seconds:.3f} s each")


def timed(find: Callable[..., Any], data: Sequence[Any]) -> tuple[list[Any] | None, float]:
    """Results of all data and seconds of each; None where a library is missing."""
    start = time.perf_counter()
    try:
        found = [find(one) for one in data]
    except ImportError as error:
        print(f"{error.name} is not installed, and is left out.")
        return None, 0.0
    return found, (time.perf_counter() - start) / len(data)


def set_ups(seed: int) -> list[SetUpRecord]:
    """Return records of the set-ups under unmeasured white forces on all storeys."""
    rng = np.random.default_rng(seed)
    found = []
    for part, level in zip(PARTS, LEVELS, strict=True):
        count = round(SECONDS * RATE_HZ)
        force = np.fft.rfft(rng.standard_normal((count, STOREYS)), 2 * count, axis=0)
        s = 2j * np.pi * np.fft.rfftfreq(2 * count, 1 / RATE_HZ)
        h = accelerance(s, range(STOREYS))
        y = level * np.fft.irfft(np.einsum("foi,fi->fo", h, force), axis=0)[:count, part]
        y = y + 0.05 * y.std() * rng.standard_normal(y.shape)
        found.append(SetUpRecord(samples=y, channels=tuple(f"s{one}" for one in part)))
    return found


Shapes = list[tuple[float, np.ndarray]]
"""Frequency [Hz] and shape over the storeys 0 to 4 of each mode."""


def merged_before(records: list[SetUpRecord]) -> Shapes:
    """PreGER of slowtime."""
    found = merge_before(
        records, RATE_HZ, ("s4", "s2"), block_rows=30, orders=range(2, 31), band_hz=(1.0, 25.0)
    )
    order = np.argsort(found.channels)
    return [(mode.frequency_hz.value, mode.shape[order]) for mode in found.modes]


def merged_after(records: list[SetUpRecord]) -> Shapes:
    """PoSER of slowtime."""
    parts = [
        SetUp(
            modes=identify_modes(one.samples, RATE_HZ, band_hz=(1.0, 25.0)).structural,
            channels=one.channels,
        )
        for one in records
    ]
    return [
        (one.mode.frequency_hz.value, one.mode.shape[np.argsort(one.channels)])
        for one in merge(parts)
        if len(one.channels) == STOREYS
    ]


def merged_by_pyoma(records: list[SetUpRecord]) -> Shapes:
    """PreGER of pyOMA-2: covariance-driven, order 30, the stable pole at each true mode."""
    from pyoma2.algorithms import SSI_MS
    from pyoma2.setup import MultiSetup_PreGER

    with _silent():
        test = MultiSetup_PreGER(
            fs=RATE_HZ, ref_ind=[[0, 1]] * len(records), datasets=[r.samples for r in records]
        )
        test.add_algorithms(SSI_MS(name="ssi", method="cov", br=30, ordmax=30))
        test.run_by_name("ssi")
        test.mpe("ssi", sel_freq=list(frame()[0]), order_in=30)
    result = test["ssi"].result
    # References first, then the moved sensors of each set-up: storeys 4, 2, 0, 1, 3.
    order = np.argsort([4, 2, 0, 1, 3])
    return [(float(f), np.asarray(result.Phi)[order, k]) for k, f in enumerate(result.Fn)]


def compare_merging(seeds: int) -> None:
    """Print 1 - MAC of merged shapes with the truth, and times."""
    data = [set_ups(seed) for seed in range(seeds)]
    hz, shapes = frame()
    for name, find in (
        ("slowtime, merged before", merged_before),
        ("slowtime, merged after", merged_after),
        ("pyOMA-2, PreGER", merged_by_pyoma),
    ):
        found, seconds = timed(find, data)
        if found is None:
            continue
        unlike = np.full((len(found), STOREYS), np.nan)
        for row, modes in enumerate(found):
            for k in range(STOREYS):
                near = [one for one in modes if abs(one[0] / hz[k] - 1) < 0.02]
                values = [
                    1 - abs(np.vdot(s, shapes[:, k])) ** 2 / np.vdot(s, s).real for _, s in near
                ]
                unlike[row, k] = min(values, default=np.nan)
        average = np.ma.masked_invalid(unlike).mean(axis=0)
        mean = ", ".join(f"{value:.1e}" for value in np.ma.filled(average, np.nan))
        print(f"{name}: 1 - MAC {mean}; {int(np.isnan(unlike).sum())} missing; {seconds:.2f} s")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--merging-seeds", type=int, default=5)
    given = parser.parse_args(arguments)
    compare_responses(given.seeds)
    compare_merging(given.merging_seeds)


if __name__ == "__main__":
    main()
