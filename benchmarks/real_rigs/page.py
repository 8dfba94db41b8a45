"""The page of the comparison, `docs/real_rigs.md`, with its pictures."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .pictures import draw
from .running import BLACK_BOX, KNOWN, SINDY, SLOWTIME
from .scores import DIVERGED, NOMINAL, REFITTED, Outcome, Row, outcomes
from .sets import SETS

COLUMNS = (NOMINAL, REFITTED, SLOWTIME.title, SINDY.title, BLACK_BOX.title, KNOWN.title)
LONGEST = 240
"""[characters] Of an equation in a table. Source: a choice."""
HEAD = """# Real rigs with known answers

`make real` writes this page. On records that others measured it compares the model file as it
is written, the same with its constants refitted, `slowtime diagnose`, PySINDy and a recurrent
state-space model of jax-sysid.

How it is done:

- Every tool reads the same pieces of records, and the same model file. `slowtime diagnose` is
  run by the plain command, without options.
- What is judged was held out. Each model runs free on it, from an initial state that it finds
  from the first 20 % of the record's outputs; after that it gets the inputs only. Where motion
  is imposed, the force is foretold from the motion.
- The error is the root mean square of measured less simulated over the standard deviation of
  the measured, over all samples held out, mean over channels. The sentences of slowtime leave
  out samples that it masks as faulty.
- PySINDy: motion is smoothed and differentiated, terms are chosen by sequential thresholding.
  Smoothing, library, threshold and form are chosen by free runs on what is left out of the
  records that are learnt from (`benchmarks/real_rigs/peers/sindy.py`).
- jax-sysid: a linear part that begins as the nominal model, networks of six neurons, Adam and
  L-BFGS as in its documentation (`benchmarks/real_rigs/peers/black_box.py`).
- The known law is told the terms of the answer, where it is made of such terms, and is fitted
  to the free run: it finds nothing, and shows what can be reached
  (`benchmarks/real_rigs/peers/known_law.py`).
- Times are seconds of one processor, with the load of the machine beside them.
- The measurements are not part of the project: see the source of each. A set that is not there
  is skipped.
"""


def write_page(page: Path, out: Path, skipped: Mapping[str, str]) -> None:
    """Write the page and its pictures from the results that are kept.

    Parameters
    ----------
    page
        Markdown file; pictures go into a folder of its name beside it.
    out
        Folder of the results.
    skipped
        Reason by name of each set whose measurements are not there.
    """
    found = outcomes(out)
    pictures = page.with_suffix("")
    for outcome in found:
        if outcome.one.same_as is None:
            draw(outcome, pictures / f"{outcome.one.name}.png")
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(page_text(found, skipped, pictures.name), encoding="utf-8")


def page_text(found: Sequence[Outcome], skipped: Mapping[str, str], pictures: str) -> str:
    """Return the page as Markdown."""
    parts = [HEAD, summary(found), tally(found)]
    done = {outcome.one.name for outcome in found}
    not_run = [one.name for one in SETS if one.name not in done]
    if not_run:
        reasons = [f"`{n}` ({skipped[n]})" if n in skipped else f"`{n}`" for n in not_run]
        parts.append(f"Not run: {', '.join(reasons)}.\n")
    parts += [section(outcome, pictures) for outcome in found]
    return "\n".join(parts)


def summary(found: Sequence[Outcome]) -> str:
    """Return the table of all sets."""
    lines = [
        "## Summary",
        "",
        "Error on what was held out; bold is the least of those not told the answer.",
        "",
        f"| set | {' | '.join(COLUMNS)} | slowtime's answer | time of slowtime [s] |",
        f"|---|{'---:|' * len(COLUMNS)}---|---:|",
    ]
    for outcome in found:
        errors = [_error(outcome, name) for name in COLUMNS]
        known = [e for e in errors[:-1] if e is not None]
        least = min(known) if known else np.nan
        cells = [f"**{percent(e)}**" if e == least else percent(e) for e in errors]
        own = outcome.row(SLOWTIME.title)
        seconds = f"{own.cpu_s:.0f}" if own is not None and own.cpu_s is not None else ""
        link = f"[{outcome.one.name}](#{outcome.one.name})"
        lines.append(f"| {link} | {' | '.join(cells)} | {outcome.verdict} | {seconds} |")
    return "\n".join([*lines, ""])


def tally(found: Sequence[Outcome]) -> str:
    """Say in how many sets the answer is the known one, and where others are ahead."""
    exact = [o for o in found if o.verdict == "as known"]
    among = [o for o in found if o.verdict.startswith("undecided, the known")]
    words = (
        f"Of {len(found)} sets slowtime's answer is the known one in {len(exact)}; in "
        f"{len(among)} more it is undecided, with the known answer among what may be."
    )
    behind = [f"{o.one.name} ({o.behind})" for o in found if o.behind is not None]
    if behind:
        words += (
            " Its error is more than 1.2 times that of the best other one, or of the figure of "
            f"the source, in: {', '.join(behind)}."
        )
    return words + "\n"


def section(outcome: Outcome, pictures: str) -> str:
    """Return the part of the page about one set."""
    one = outcome.one
    lines = [
        f"## {one.name}",
        "",
        f"{one.title}. Source: {one.source}.",
        "",
        f"- Pieces: {one.split}.",
        f"- Known: {one.known}.",
    ]
    if one.reference:
        lines.append(f"- The source's figures: {one.reference}.")
    if outcome.command:
        lines += [f"- Command: `{outcome.command}`", f"- Judged: {outcome.verdict}."]
    lines += ["", "> " + " ".join(outcome.sentence.split()), ""]
    lines += ["| | error held out | time [s] | can a person read it? |", "|---|---:|---:|---|"]
    lines += [_line(row) for row in outcome.rows]
    low, high = min(outcome.loads), max(outcome.loads)
    lines += [
        "",
        f"Load of the machine: {low:.1f} to {high:.1f} on {os.cpu_count()} processors.",
    ]
    if one.same_as is not None:
        lines.append(f"The other tools: as for [{one.same_as}](#{one.same_as}).")
    else:
        lines += ["", f"![measured and simulated]({pictures}/{one.name}.png)"]
    return "\n".join([*lines, ""])


def _line(row: Row) -> str:
    seconds = "" if row.cpu_s is None else f"{row.cpu_s:.0f}"
    words = row.readable.replace("|", "\\|")
    if len(words) > LONGEST:
        words = words[:LONGEST].rstrip() + " …"
    return f"| {row.name} | {percent(row.error)} | {seconds} | {words} |"


def _error(outcome: Outcome, name: str) -> float | None:
    row = outcome.row(name)
    return None if row is None else row.error


def percent(error: float | None) -> str:
    """Write an error for a person, with two digits."""
    if error is None:
        return "–"
    if not error < DIVERGED:
        return "diverged"
    return f"{100 * error:.0f} %" if error >= 0.0995 else f"{100 * error:.2g} %"
