r"""Recursive filters applied in blocks of samples by matrix products.

A recursion of few states over a block of samples :math:`x` is linear in block and state,

.. math:: y = H x + O s, \qquad s' = K x + P s

so that a stream of any length takes one product a block. The matrices are made by stepping the
recursion itself through unit inputs and unit states.
"""

import functools
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float, Inexact

Sections = Float[np.ndarray, "section 6"]
Memory = Float[np.ndarray, "section 2 channel"]
Rows = Float[np.ndarray, "time channel"]

BLOCK = 64
"""Samples of a block: the cheapest, within a factor of 1.5 from 32 to 128 for 1 to 16 rows."""


def first_order(
    series: Inexact[np.ndarray, "*rows time"], pole: float
) -> Inexact[np.ndarray, "*rows time"]:
    r"""Recursion :math:`y_k = x_k + p\,y_{k-1}` from rest, along the last axis.

    Parameters
    ----------
    series
        Samples along the last axis.
    pole
        Pole p.

    Returns
    -------
    Filtered samples.

    Examples
    --------
    >>> first_order(np.array([1.0, 0.0, 0.0, 1.0]), 0.5)
    array([1.   , 0.5  , 0.25 , 1.125])
    """
    count = series.shape[-1]
    blocks = -(-count // BLOCK)
    padded = np.zeros((*series.shape[:-1], blocks * BLOCK), dtype=series.dtype)
    padded[..., :count] = series
    cut = padded.reshape(*series.shape[:-1], blocks, BLOCK)
    lag = np.subtract.outer(np.arange(BLOCK), np.arange(BLOCK))
    weights = np.tril(pole ** np.maximum(lag, 0)).astype(series.real.dtype)
    out = cut @ weights.T
    decay = (pole ** np.arange(1, BLOCK + 1)).astype(series.real.dtype)
    for number in range(1, blocks):
        out[..., number, :] += out[..., number - 1, -1:] * decay
    return np.asarray(out.reshape(padded.shape)[..., :count])


def at_rest(sections: Sections) -> Float[np.ndarray, "section 2"]:
    """Steady state of each section under a unit input.

    Parameters
    ----------
    sections
        Second-order sections.
    """
    states, level = [], 1.0
    for b0, b1, b2, _, a1, a2 in sections.tolist():
        gain = (b0 + b1 + b2) / (1.0 + a1 + a2)
        states.append((level * (gain - b0), level * (b2 - a2 * gain)))
        level *= gain
    return np.array(states)


def filtered(sections: Sections, rows: Rows, memory: Memory) -> tuple[Rows, Memory]:
    """Run rows through second-order sections, one after the other.

    Parameters
    ----------
    sections
        Of each :math:`b_0, b_1, b_2, 1, a_1, a_2`.
    rows
        Rows to filter, one after the other.
    memory
        As the rows before left it; `at_rest` times the first row to begin without ringing.

    Returns
    -------
    Filtered rows, and the memory after them.
    """
    whole = len(rows) // BLOCK * BLOCK
    out = np.empty_like(rows)
    table = _block(sections.tobytes(), len(sections))
    state = memory.reshape(-1, memory.shape[-1])
    for start in range(0, whole, BLOCK):
        both = table @ np.concatenate([rows[start : start + BLOCK], state])
        out[start : start + BLOCK], state = both[:BLOCK], both[BLOCK:]
    memory = state.reshape(memory.shape)
    out[whole:], memory = _stepped(sections, rows[whole:], memory)
    return out, memory


def _stepped(sections: Sections, rows: Rows, memory: Memory) -> tuple[Rows, Memory]:
    """Transposed direct form II, sample by sample."""
    memory, out = memory.copy(), np.empty_like(rows)
    parts = list(zip(sections.tolist(), memory, strict=True))
    for number, row in enumerate(rows):
        value = row
        for (b0, b1, b2, _, a1, a2), state in parts:
            after = b0 * value + state[0]
            state[0] = b1 * value - a1 * after + state[1]
            state[1] = b2 * value - a2 * after
            value = after
        out[number] = value
    return out, memory


@functools.lru_cache(maxsize=16)
def _block(sections: bytes, count: int) -> Float[np.ndarray, "out given"]:
    """Matrix from a block of rows and the states before it to filtered rows and states."""
    given = np.eye(BLOCK + 2 * count)
    table, rows = np.frombuffer(sections).reshape(count, 6), given[:BLOCK]
    out, memory = _stepped(table, rows, given[BLOCK:].reshape(count, 2, -1))
    return np.concatenate([out, memory.reshape(2 * count, -1)])


def butterworth(
    order: int, edge: float, kind: Literal["lowpass", "highpass"]
) -> Float[np.ndarray, "section 6"]:
    """Sections of a maximally flat filter.

    Parameters
    ----------
    order
        Order of the filter.
    edge
        Where the gain is 1/sqrt(2), as a fraction of the Nyquist frequency, in (0, 1).
    kind
        ``"lowpass"`` or ``"highpass"``.

    Returns
    -------
    Second-order sections.
    """
    angle = np.pi * (2 * np.arange((order + 1) // 2) + 1) / (2 * order)
    return _bilinear(-np.sin(angle) + 1j * np.cos(angle), order, edge, kind, 1.0)


def chebyshev(order: int, ripple_db: float, edge: float) -> Float[np.ndarray, "section 6"]:
    """Sections of a lowpass of type I, of even order, with a gain of 1 at most.

    Parameters
    ----------
    order
        Order of the filter, even.
    ripple_db
        Of the gain below `edge` [dB].
    edge
        As a fraction of the Nyquist frequency, in (0, 1).

    Returns
    -------
    Second-order sections.
    """
    squared = 10 ** (ripple_db / 10) - 1
    spread = np.arcsinh(1 / np.sqrt(squared)) / order
    angle = np.pi * (2 * np.arange(order // 2) + 1) / (2 * order)
    poles = -np.sinh(spread) * np.sin(angle) + 1j * np.cosh(spread) * np.cos(angle)
    return _bilinear(poles, order, edge, "lowpass", 1 / np.sqrt(1 + squared))


def _bilinear(
    poles: Sequence[complex] | np.ndarray, order: int, edge: float, kind: str, gain: float
) -> Float[np.ndarray, "section 6"]:
    """Poles of a lowpass prototype, of each pair one, as sections of samples.

    The edge is warped beforehand, s becomes (1 - 1/z) / (1 + 1/z) over its tangent; a highpass
    has 1/s in the place of s.
    """
    warped, sections = np.tan(np.pi * edge / 2), []
    warp, sign = (warped, 1.0) if kind == "lowpass" else (1 / warped, -1.0)
    for number, pole in enumerate(poles):
        if 2 * number + 1 == order:
            rate = -pole.real * warp
            top, low, high = (rate, rate * sign, 0.0), 1 + rate, (rate - 1) * sign
            sections.append(np.array([*top, low, high, 0.0]) / low)
            continue
        square, line = abs(pole * warp) ** 2, -2 * pole.real * warp
        top = (square, 2 * square * sign, square)
        low = 1 + line + square
        rest = (2 * (square - 1) * sign, 1 - line + square)
        sections.append(np.array([*top, low, *rest]) / low)
    sections[0][:3] *= gain
    return np.array(sections)
