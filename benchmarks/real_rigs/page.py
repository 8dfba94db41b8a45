"""The page of the comparison, `docs/real_rigs.md`, with its pictures."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .pictures import draw
from .running import BLACK_BOX, KNOWN, SINDY, SLOWTIME
from .scores import DIVERGED, NOMINAL, REFITTED, Row, ScoredSet, outcomes
from .sets import SETS

COLUMNS = (NOMINAL, REFITTED, SLOWTIME.title, SINDY.title, BLACK_BOX.title, KNOWN.title)
LONGEST = 240
"""[characters] Length at which an equation in a table is cut. Source: a choice."""
NOT_RUN = "slowtime was not run on this set."
HEAD = """# Real rigs with known answers

`make real` writes this page. On records that others measured, it compares the model file as
written, the same model with refitted constants, `slowtime diagnose`, PySINDy, and a recurrent
state-space model of jax-sysid.

How it is done:

- Every tool reads the same pieces of records, and the same model file. `slowtime diagnose` is
  run by the plain command, without options.
- The error is that of free runs on held-out records. Each model estimates its initial state
  from the first 20 % of the record's outputs; after that it gets the inputs only. Where motion
  is imposed, the force is predicted from the motion.
- The error is the root mean square of measured minus simulated, divided by the standard
  deviation of the measured signal, over all held-out samples; the mean over channels. The
  quoted sentences of slowtime may state another error, as they omit samples masked as faulty.
- PySINDy: motion is smoothed and differentiated, and terms are chosen by sequential
  thresholding. Smoothing, library, threshold and form are chosen by cross-validation: free
  runs on parts left out of the training records (`benchmarks/real_rigs/peers/sindy.py`).
- jax-sysid: a linear part that starts from the nominal model, networks of six neurons, Adam and
  L-BFGS as in its documentation (`benchmarks/real_rigs/peers/black_box.py`).
- Known law, fitted: where the known answer is a sum of simple terms, their coefficients are
  fitted to free runs. It searches for no terms, and shows the error that can be reached
  (`benchmarks/real_rigs/peers/known_law.py`).
- Times are seconds of one processor. The load of the machine is stated with each set.
- A dash means that there is no result: the tool was not run on this set, or its run failed.
- The measurements are not part of the project: see the source of each. Sets whose measurements
  are missing are skipped.
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


def page_text(found: Sequence[ScoredSet], skipped: Mapping[str, str], pictures: str) -> str:
    """Return the page as Markdown."""
    parts = [HEAD, summary(found), tally(found)]
    done = {outcome.one.name for outcome in found}
    not_run = [one.name for one in SETS if one.name not in done]
    if not_run:
        reasons = [f"`{n}` ({skipped[n]})" if n in skipped else f"`{n}`" for n in not_run]
        parts.append(f"Not run: {', '.join(reasons)}.\n")
    parts += [section(outcome, pictures) for outcome in found]
    return "\n".join(parts)


def summary(found: Sequence[ScoredSet]) -> str:
    """Return the table of all sets."""
    lines = [
        "## Summary",
        "",
        "Error on held-out records. Bold: the least error, without the known law.",
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


def tally(found: Sequence[ScoredSet]) -> str:
    """State in how many sets the answer is the known one, and where other tools do better."""
    exact = [o for o in found if o.verdict == "as known"]
    among = [o for o in found if o.verdict.startswith("undecided, the known")]
    ran = [o for o in found if o.command]
    words = (
        f"slowtime was run on {len(ran)} sets. Its answer is the known one in {len(exact)}; in "
        f"{len(among)} more it is undecided, with the known answer among the alternatives."
    )
    behind = [f"{o.one.name} ({o.behind})" for o in found if o.behind is not None]
    if behind:
        words += (
            " Its error is more than 1.2 times that of the best other tool, or of the source's "
            f"own figure, in: {', '.join(behind)}."
        )
    return words + "\n"


def section(outcome: ScoredSet, pictures: str) -> str:
    """Return the section of the page on one set."""
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
    said = " ".join(outcome.sentence.split()) or NOT_RUN
    lines += ["", f"> {said}", ""]
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


def _error(outcome: ScoredSet, name: str) -> float | None:
    row = outcome.row(name)
    return None if row is None else row.error


def percent(error: float | None) -> str:
    """Format a relative error in per cent, with two digits; a dash where there is none."""
    if error is None:
        return "–"
    if not error < DIVERGED:
        return "diverged"
    return f"{100 * error:.0f} %" if error >= 0.0995 else f"{100 * error:.2g} %"
