"""Files of frequency responses, and the table of modal masses."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.identification.modal_fit.assembly import ModalTest
from slowtime_cli.shared.terminal import show, write_json
from slowtime_services.exports.frequency_responses import write_responses
from slowtime_services.files.units import unit_of
from slowtime_services.modal import UNIVERSAL, Geometry

Channels = Sequence[tuple[str, str]]
"""Name and unit of each."""

HEADS = ("frequency [Hz]", "modal mass [kg]", "driving point", "participation [1]")


def show_masses(found: ModalTest, outputs: Sequence[str], inputs: Sequence[str]) -> None:
    """Print modal masses and participation, where there is more than one input or a mass."""
    rows, plain = [], []
    for mode, constants in zip(found.result.modes, found.constants, strict=True):
        mass, point = constants.modal_mass, constants.driving_point
        place = "" if point is None else f"{outputs[point[0]]}={inputs[point[1]]}"
        share = np.abs(constants.participation)
        hz = mode.frequency_hz.value
        rows.append(
            (
                f"{hz:.4f}",
                "" if mass is None else f"{mass.value:.4g} ± {mass.sd:.2g}",
                place,
                " ".join(f"{one:.2f}" for one in share),
            )
        )
        plain.append(
            {
                "frequency_hz": hz,
                "modal_mass": None if mass is None else mass.value,
                "modal_mass_sd": None if mass is None else mass.sd,
                "driving_point": place,
                "participation": " ".join(f"{one:.4g}" for one in share),
            }
        )
    if any(row[1] for row in rows) or (rows and len(inputs) > 1):
        show(
            "Modal masses, for a deflection of 1 at the driving point", HEADS, rows, plain=plain
        )


def write_response_file(
    path: Path, found: ModalTest, outputs: Channels, inputs: Channels, geometry: Geometry | None
) -> None:
    """Write frequency responses as a universal file, CSV, or else JSON with modal constants."""
    kind = path.suffix.lower()
    if kind in UNIVERSAL:
        write_responses(path, found.response, outputs, inputs, geometry)
    elif kind == ".csv":
        _write_csv(path, found, outputs, inputs)
    else:
        write_json(path, _body(found, outputs, inputs))


def _write_csv(path: Path, found: ModalTest, outputs: Channels, inputs: Channels) -> None:
    response = found.response
    pairs = [(o, i) for o in range(len(outputs)) for i in range(len(inputs))]
    heads = ["frequency_hz"]
    for o, i in pairs:
        name = f"{_with_unit(outputs[o])}/{inputs[i][0]}"
        heads += [f"re {name}", f"im {name}", f"sd {name}"]
    heads += [f"coherence {name}" for name, _ in outputs]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(heads)
        for line, hz in enumerate(response.frequency_hz):
            row: list[Any] = [float(hz)]
            for o, i in pairs:
                value = response.response[line, o, i]
                row += [value.real, value.imag, response.sd[line, o, i]]
            table.writerow([*row, *response.coherence[line]])


def _with_unit(channel: tuple[str, str]) -> str:
    """Name of an output; with its unit where it is no acceleration, as a reader assumes."""
    unit = unit_of(channel[1], channel[0])
    plain = unit is None or unit.quantity == "acceleration"
    return channel[0] if plain else f"{channel[0]} [{channel[1]}]"


def _body(found: ModalTest, outputs: Channels, inputs: Channels) -> dict[str, Any]:
    response = found.response
    return {
        "slowtime_frequency_responses": 1,
        "kind": response.kind,
        "outputs": [{"channel": name, "unit": unit} for name, unit in outputs],
        "inputs": [{"channel": name, "unit": unit} for name, unit in inputs],
        "averages": response.averages,
        "exponential_window_per_s": response.decay_rate,
        "frequency_hz": response.frequency_hz.tolist(),
        "response": _complex(response.response),
        "sd": _numbers(response.sd),
        "coherence": _numbers(response.coherence),
        "fitted": None if found.fitted is None else _complex(found.fitted),
        "chi_square_ratio": _number(found.chi_square_ratio),
        "modes": [
            {
                "frequency_hz": mode.frequency_hz.value,
                "residues": _complex(constants.residues),
                "participation": _complex(constants.participation),
                "modal_mass": None
                if constants.modal_mass is None
                else {"value": constants.modal_mass.value, "sd": constants.modal_mass.sd},
                "driving_point": constants.driving_point,
            }
            for mode, constants in zip(found.result.modes, found.constants, strict=True)
        ],
    }


def _complex(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    return {"re": values.real.tolist(), "im": values.imag.tolist()}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: np.ndarray[Any, Any]) -> Any:
    finite = values.astype(object)
    finite[~np.isfinite(values)] = None
    return finite.tolist()
