"""Frequency responses in named arrays: NumPy archives, MATLAB and HDF5 files."""

import re
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from slowtime_services.files.binary.hdf5_objects import own_datasets, stored_bytes
from slowtime_services.files.binary.numpy_arrays import Arrays, refuse_above, unreadable
from slowtime_services.files.binary.reader_process import bound_resources, save_arrays
from slowtime_services.files.record import RecordError

from .measured import Channel, FrfCurve

_FREQUENCY = re.compile(
    r"(?:freq(?:uency|uencies|s)?|f|hz|f_?hz|freq_?hz|frequency_?hz|lines_?hz)"
)
_CIRCULAR = re.compile(r"(?:omega|w|om|omega_rad_s|angular_frequency)")
_REAL = re.compile(r"(?i)(?:_|\b)(re|real)(?:$|_|\b)")
_COHERENCE = re.compile(r"(?i)coh|gamma")
_ERRORS = re.compile(r"(?i)^(?:.*_)?(?:sd|std)(?:_.*)?$")
_OUTPUTS = re.compile(r"(?i)outputs?(?:_names)?|responses?_names|channels?(?:_names)?")
_INPUTS = re.compile(r"(?i)inputs?(?:_names)?|references?(?:_names)?|forces?_names")


def holds_complex(arrays: Arrays) -> bool:
    """Whether there is a complex array, or two of its parts, along an axis of frequencies."""
    hz = _lines(arrays)
    return hz is not None and bool(_complex(arrays, len(hz)))


def curves_of_arrays(file: str, arrays: Arrays) -> list[FrfCurve]:
    """Take a curve from each pair of output and input of every complex array.

    Parameters
    ----------
    file
        Its name, for messages.
    arrays
        One of frequencies [Hz], as `frequency_hz`, or [rad/s], as `omega`; complex ones, or
        pairs named after their parts, of shape (line,), (line, output) or
        (line, output, input), axes in any order where their lengths tell them; coherences and
        standard deviations of the same shapes; names as `outputs`, `inputs`.

    Raises
    ------
    RecordError
        Where there is none, or shapes do not fit.
    """
    hz = _lines(arrays)
    found = {} if hz is None else _complex(arrays, len(hz))
    if hz is None or not found:
        shapes = ", ".join(
            f"{k} {np.shape(v)} {np.asarray(v).dtype}" for k, v in arrays.items()
        )
        raise RecordError(
            f"{file} holds no frequency responses, but: {shapes or 'nothing'}. Give an array "
            "frequency_hz, and complex ones of the shape (line, output, input)."
        )
    outputs, inputs = _texts(arrays, _OUTPUTS), _texts(arrays, _INPUTS)
    extra = {
        name: _matrix(array, len(hz))
        for name, array in arrays.items()
        if np.asarray(array).dtype.kind == "f" and len(hz) in np.shape(array)
    }
    coherence = next((v for k, v in extra.items() if _COHERENCE.search(_last(k))), None)
    errors = next((v for k, v in extra.items() if _ERRORS.search(_last(k))), None)
    curves = []
    for name, matrix in found.items():
        _, rows, columns = matrix.shape
        named = len(found) == 1 and len(outputs) == rows
        for o in range(rows):
            for i in range(columns):
                curves.append(
                    FrfCurve(
                        output=_channel(outputs[o] if named else _numbered(name, o, rows)),
                        input=_channel(inputs[i] if len(inputs) == columns else f"input_{i}"),
                        frequency_hz=hz,
                        values=matrix[:, o, i],
                        sd=_of(errors, o, i, matrix.shape),
                        coherence=_of(coherence, o, i, matrix.shape),
                    )
                )
    return curves


def _last(name: str) -> str:
    return re.split(r"[./]", name)[-1]


def _numbered(name: str, place: int, count: int) -> str:
    return name if count == 1 else f"{name}_{place}"


def _lines(arrays: Arrays) -> np.ndarray | None:
    for pattern, scale in ((_FREQUENCY, 1.0), (_CIRCULAR, 2 * np.pi)):
        for name, array in arrays.items():
            flat = np.squeeze(np.asarray(array))
            if pattern.fullmatch(_last(name).casefold()) and flat.ndim == 1 and flat.size > 1:
                if flat.dtype.kind in "fiu":
                    return np.asarray(flat, dtype=float) / scale
    return None


def _complex(arrays: Arrays, lines: int) -> Mapping[str, np.ndarray]:
    """Complex arrays, and those of two parts, as (line, output, input)."""
    found = {}
    for name, array in arrays.items():
        values = np.asarray(array)
        if values.dtype.kind == "f" and _REAL.search(name):
            other = _REAL.sub(lambda m: m[0].replace(m[1], _imaginary(m[1])), name)
            if other in arrays and np.shape(arrays[other]) == values.shape:
                values = values + 1j * np.asarray(arrays[other])
        if values.dtype.kind == "c" and lines in values.shape and values.ndim <= 3:
            found[name] = _matrix(values, lines)
    return found


def _imaginary(real: str) -> str:
    both = {"re": "im", "real": "imag"}
    found = both[real.casefold()]
    return (
        found.upper() if real.isupper() else found.capitalize() if real[0].isupper() else found
    )


def _matrix(values: np.ndarray, lines: int) -> np.ndarray:
    """Bring lines to the front; one output, and one input, where there is no axis of them."""
    axes = [k for k, size in enumerate(values.shape) if size == lines]
    front = np.moveaxis(np.asarray(values), axes[0] if 0 not in axes else 0, 0)
    return front.reshape(*front.shape, *(1,) * (3 - front.ndim))


def _of(extra: np.ndarray | None, o: int, i: int, shape: tuple[int, ...]) -> np.ndarray | None:
    if extra is None or extra.shape[1] != shape[1] or extra.shape[2] not in (1, shape[2]):
        return None
    return np.asarray(extra[:, o, min(i, extra.shape[2] - 1)])


def _texts(arrays: Arrays, pattern: re.Pattern[str]) -> list[str]:
    for name, array in arrays.items():
        values = np.asarray(array)
        if pattern.fullmatch(_last(name)) and values.dtype.kind in "US":
            return [
                one.decode(errors="replace") if isinstance(one, bytes) else str(one)
                for one in values.reshape(-1).tolist()
            ]
    return []


def _channel(text: str) -> Channel:
    name, _, unit = text.partition("[")
    return name.strip() or text, unit.rstrip("] ")


def main(path: str, max_bytes: str, out: str) -> int:
    """Read an HDF5 file in a process of its own, or say why not."""
    return save_arrays(_read, path, max_bytes, out)


def _read(path: Path, max_bytes: int) -> dict[str, np.ndarray]:
    # Here, for a NumPy archive needs no library.
    import h5py

    bound_resources(path, max_bytes)
    found = {}
    try:
        with h5py.File(path, "r") as file:
            kept = [item for item in own_datasets(path, file) if item.dtype.kind in "fiucSO"]
            refuse_above(path, sum(stored_bytes(item) for item in kept), max_bytes)
            for item in kept:
                name = item.name.strip("/").replace("/", ".")
                if item.dtype.kind in "SO":
                    if item.size < 10_000 and h5py.check_string_dtype(item.dtype) is not None:
                        found[name] = np.asarray(item.asstr()[()], dtype=np.str_)
                else:
                    found[name] = np.asarray(item[()])
    except RecordError:
        raise
    except Exception as error:  # the library says in many ways that a file is torn
        raise unreadable(path, error) from error
    return found


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
