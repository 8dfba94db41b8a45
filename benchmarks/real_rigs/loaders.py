"""Files of the measured rigs → the pieces that are learnt from and held out.

Every loader takes the folder of the measurements. What it does to a record are facts of its
file: which column is which channel, factors to SI units, where a decay begins.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.signal

from .pieces import Array, Piece, Pieces

SILVERBOX_HZ = 610.35
"""[Hz] Rate of the Silverbox record. Source: its README (10 MHz / 2¹⁴)."""
DRIVER_GAIN = 10.0
"""[1/s²] Torque on the disc, per unit inertia, by radian of the driver: one of two equal
springs, which together give ω0² = 20 1/s². Source: the README of the measurements."""
TOWER_FACTORS = {
    "a5": (2, -9.8),
    "a4": (3, 2.0),
    "a1": (4, 2.0),
    "a2": (5, 1.0),
    "a3": (6, 1.0),
}
"""Column and factor [m/s² per V] of each floor. Source: the authors' `run.m`."""
DAMPER_KG = 1500.0
"""[kg] Moving mass of the tower's hybrid mass damper. Source: README of the measurements."""
FRAME_BAND_HZ = (1.0, 2.0)
"""[Hz] From where to where the spectrum of the pulse on the frame rises; it is flat above, so
that the noise of the measurement stays in all of the band. Source: the measured responses are
mostly noise below 1 Hz, and the lowest mode is at 6.5 Hz."""
FRAME_HZ, FRAME_PULSE_N, FRAME_DELAY_S, FRAME_S = 128.0, 100.0, 1.0, 16.0
"""[Hz], [N], [s], [s] Rate, size, instant and length of the pulse's response. Source: a choice;
after 16 s the first mode has died down to 3 % at the published 0.5 % damping."""


def _table(path: Path) -> Array:
    return np.loadtxt(path, delimiter=",", skiprows=1, dtype=float, ndmin=2)


def emps(data: Path) -> Pieces:
    """Learn from the closed loop; the one with pulses of force is held out."""

    def piece(name: str) -> Piece:
        told = scipy.io.loadmat(data / "emps" / name)
        force = float(told["gtau"].item()) * told["vir"].ravel()
        times = told["t"].ravel()
        rate = round((len(times) - 1) / float(times[-1] - times[0]), 3)
        return Piece(rate, {"force": force, "x": told["qm"].ravel().astype(float)})

    return Pieces((piece("DATA_EMPS.mat"),), (piece("DATA_EMPS_PULSES.mat"),))


def _silverbox(data: Path) -> Piece:
    path = data / "silverbox/SNLS80mV.csv"
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(0, 1))
    return Piece(SILVERBOX_HZ, {"V1": table[:, 0], "V2": table[:, 1]})


def silverbox(data: Path) -> Pieces:
    """Multisines to learn from; the noise of growing amplitude held out."""
    whole = _silverbox(data)
    return Pieces((whole.part(66.5, 82.0),), (whole.part(0.0, 65.5),))


def silverbox_both(data: Path) -> Pieces:
    """Learn from a multisine and some noise; louder noise and a multisine are held out."""
    whole = _silverbox(data)
    return Pieces(
        (whole.part(66.5, 76.5), whole.part(22.0, 32.0)),
        (whole.part(45.0, 65.5), whole.part(150.0, 160.0)),
    )


def _disc(data: Path, name: str) -> Piece:
    table = _table(data / "torsion_disc" / f"{name}.csv")
    channels = {"angle": table[:, 1]}
    if table.shape[1] > 2:
        channels["torque"] = DRIVER_GAIN * table[:, 2]
    return Piece(1.0 / round(float(np.median(np.diff(table[:, 0]))), 6), channels)


def from_largest_peak(piece: Piece, channel: str) -> Piece:
    """Cut a free decay where it is released: at its largest peak."""
    peak = int(np.argmax(np.abs(piece.channels[channel])))
    return Piece(piece.rate_hz, {n: v[peak:] for n, v in piece.channels.items()})


def disc_free(data: Path) -> Pieces:
    """Decays without the magnet, each from its largest peak."""
    eight, nine, ten = (
        from_largest_peak(_disc(data, f"free_no_magnet_{i}"), "angle") for i in (8, 9, 10)
    )
    return Pieces((eight, nine), (ten,))


def disc_magnet(data: Path) -> Pieces:
    """Decays with the magnet, each from its largest peak."""
    three, six, ten = (
        from_largest_peak(_disc(data, f"free_magnet_{i}"), "angle") for i in (3, 6, 10)
    )
    return Pieces((three, six), (ten,))


def disc_driven(data: Path) -> Pieces:
    """Learn from three speeds of the motor; the torque is that of the driven spring.

    Means are taken off: incremental encoders begin at zero wherever they stand.
    """
    runs = {i: _disc(data, f"driven_{i}").centred() for i in (8, 10, 14, 22, 25)}
    return Pieces((runs[8], runs[14], runs[22]), (runs[10], runs[25]))


def _with_zeros(pieces: Pieces, channel: str) -> Pieces:
    def more(piece: Piece) -> Piece:
        return piece.with_channel(channel, np.zeros(len(piece)))

    return Pieces(tuple(map(more, pieces.learn)), tuple(map(more, pieces.judge)))


def disc_free_zeros(data: Path) -> Pieces:
    """Decays without the magnet, with a torque of zero as input."""
    return _with_zeros(disc_free(data), "torque")


def _damper(data: Path, number: str) -> Pieces:
    told = scipy.io.loadmat(data / "mr_damper" / f"data_simulation_{number}_MRdamper.mat")
    rows = told["x_F"][:1500].astype(float)
    channels = {"x": 1e-3 * rows[:, 0], "force": rows[:, 2]}
    whole = Piece(1.0 / float(told["Ts"].item()), channels)
    return Pieces((whole.part(0.0, 7.5),), (whole.part(7.5),))


def damper_off(data: Path) -> Pieces:
    """Damper without current, first half to learn from."""
    return _damper(data, "4.1")


def damper_slow(data: Path) -> Pieces:
    """Damper at 0.88 V, slow and wide."""
    return _damper(data, "4.2")


def damper_on(data: Path) -> Pieces:
    """Damper at 0.88 V, as fast as the one without current."""
    return _damper(data, "4.4")


def _arm(data: Path) -> Piece:
    table = _table(data / "single_pendulum/swing_1kHz.csv")
    return Piece(1000.0, {"angle": table[:, 1]}).every(10)


def pendulum(data: Path) -> Pieces:
    """First and last 12 s of a long decay to learn from; 12 s between them held out."""
    whole = _arm(data)
    return Pieces((whole.part(0, 12), whole.part(40, 52)), (whole.part(20, 32),))


def pendulum_zeros(data: Path) -> Pieces:
    """Add a torque of zero as input."""
    return _with_zeros(pendulum(data), "torque")


def pendulum_end(data: Path) -> Pieces:
    """Learn from the same; the last cycles of another swing, until the arm sticks."""
    table = _table(data / "single_pendulum/small_swing_end_1kHz.csv")
    end = Piece(1000.0, {"angle": table[:, 1] - np.pi}).every(10)
    return Pieces(pendulum(data).learn, (end.part(0, 10),))


def ship(data: Path) -> Pieces:
    """Thirds of the decay from its largest peak on; the middle one held out."""
    table = _table(data / "ship_roll/model_test_21337.csv")
    whole = Piece(100.0, {"roll": table[:, 4]})
    decay = from_largest_peak(whole, "roll").every(5)
    third = len(decay) / decay.rate_hz / 3
    return Pieces(
        (decay.part(0, third), decay.part(2 * third)), (decay.part(third, 2 * third),)
    )


def _wheel(data: Path, axis: str, cut_s: float) -> Pieces:
    table = _table(
        data / f"bicycle_wheel/bicycle-wheel-{axis}-inertia-rate-gyro-measurement.csv"
    )
    whole = Piece(500.0, {"rate": table[:, 1]}).every(5)
    return Pieces((whole.part(0, cut_s),), (whole.part(cut_s),))


def wheel_radial(data: Path) -> Pieces:
    """Wheel on a torsion rod: 1.2 of 2 s to learn from."""
    return _wheel(data, "radial", 1.2)


def wheel_axial(data: Path) -> Pieces:
    """Wheel on a pivot: 3 of 4.6 s to learn from."""
    return _wheel(data, "axial", 3.0)


def tower(data: Path) -> Pieces:
    """Two minutes of each record, at 25 Hz, in SI units, means taken off."""

    def piece(name: str) -> Piece:
        table = np.loadtxt(data / "unison_tower" / name)
        channels = {n: factor * table[:, i] for n, (i, factor) in TOWER_FACTORS.items()}
        channels["force"] = -DAMPER_KG * 9.8 * table[:, 1]
        slow = {
            n: scipy.signal.decimate(v - v.mean(), 4, ftype="fir", zero_phase=True)
            for n, v in channels.items()
        }
        return Piece(25.0, slow).part(60, 180)

    return Pieces((piece("wn_01.dat"),), (piece("wn_02.dat"),))


def pulse_response(frequency_hz: Array, response: Any, place: int) -> Piece:
    """Return what a band-limited pulse on one floor does, by the inverse FFT of its FRFs.

    Parameters
    ----------
    frequency_hz
        Evenly spaced lines [line], without 0 Hz.
    response
        Acceleration over force [line, floor], complex [1/kg].
    place
        Floor that is pushed, from 0.
    """
    step = float(frequency_hz[0])
    window = np.interp(frequency_hz, FRAME_BAND_HZ, [0.0, 1.0])
    pulse = np.sin(window * np.pi / 2) ** 2 * np.exp(-2j * np.pi * frequency_hz * FRAME_DELAY_S)
    count = round(FRAME_HZ / step)
    kept = np.arange(len(frequency_hz)) < count // 2 - 1

    def series(spectrum: Array) -> Array:
        padded = np.concatenate([[0.0], spectrum[kept]])
        return np.asarray(np.fft.irfft(padded, count))

    force = series(pulse)
    scale = FRAME_PULSE_N / np.abs(force).max()
    channels = {f"f{i + 1}": np.zeros(count) for i in range(response.shape[1])}
    channels[f"f{place + 1}"] = scale * force
    for i in range(response.shape[1]):
        channels[f"a{i + 1}"] = scale * series(pulse * response[:, i])
    return Piece(FRAME_HZ, channels).part(0, FRAME_S)


def frame(data: Path) -> Pieces:
    """Responses to pulses on the lowest and the highest floor; the middle one held out."""
    pieces = []
    for place, name in enumerate(("Experimental.csv", "test_2.csv", "test_3.csv")):
        text = (data / "three_storey_frf" / name).read_text(encoding="utf-8-sig")
        rows = [line.split(";") for line in text.split()]
        table = np.array([[complex(cell) for cell in row] for row in rows])
        pieces.append(pulse_response(table[:, 0].real, table[:, 1:4], place))
    return Pieces((pieces[0], pieces[2]), (pieces[1],))


def _case(data: Path, name: str, renamed: dict[str, str]) -> Piece:
    with np.load(data.parent / "cases/real" / name) as told:
        channels = {new: told[old].astype(float) for new, old in renamed.items()}
        return Piece(float(told["rate_hz"]), channels)


def loop(data: Path) -> Pieces:
    """Return a published benchmark of hysteresis, another excitation held out."""
    roles = {"u": "u", "y": "y"}
    return Pieces(
        (_case(data, "loop_learn.npz", roles),), (_case(data, "loop_judge.npz", roles),)
    )


def rub(data: Path) -> Pieces:
    """Force of a band that rubs: two thirds to learn from."""
    whole = _case(data, "rub.npz", {"x": "x", "force": "f"})
    return Pieces((whole.part(0, 19),), (whole.part(19),))


def rub_beside_spring(data: Path) -> Pieces:
    """Add the force of a known spring, 3 N/m, to that of the band."""

    def stiffer(piece: Piece) -> Piece:
        return piece.with_channel("force", piece.channels["force"] + 3.0 * piece.channels["x"])

    plain = rub(data)
    return Pieces(tuple(map(stiffer, plain.learn)), tuple(map(stiffer, plain.judge)))


def mount(data: Path) -> Pieces:
    """Return the records of a store on a shaken rail at three levels."""
    one, two, three = (
        _case(data, f"{n}.npz", {"rail": "rail", "store": "store"})
        for n in ("one", "two", "three")
    )
    return Pieces((one, two), (three,))


def swing(data: Path) -> Pieces:
    """Slow pendulum: 20 of 30 s to learn from."""
    table = _table(data.parent / "cases/real/swing.csv")
    rate = (len(table) - 1) / (table[-1, 0] - table[0, 0])
    whole = Piece(round(float(rate), 3), {"angle": table[:, 1]})
    return Pieces((whole.part(0, 20),), (whole.part(20),))


def swing_zeros(data: Path) -> Pieces:
    """Add a torque of zero as input."""
    return _with_zeros(swing(data), "torque")
