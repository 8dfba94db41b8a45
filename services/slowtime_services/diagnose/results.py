"""The folder of results of a diagnosis."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.discrepancy.diagnosis import Diagnosis, Surface
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.models import model_text

from .report import write_report

REPORT, AUGMENTED, HOLDOUT = "report.json", "augmented.yaml", "holdout.npz"
PAGE, SURFACE = "report.html", "surface.npz"


def write_results(out: Path, diagnosis: Diagnosis, document: DiagnosisFile) -> None:
    """Write ``report.html``, ``report.json``, ``augmented.yaml``, and arrays to draw from.

    ``holdout.npz`` is written only where a record was held out and compared in time (which
    ambient records are not), ``surface.npz`` where a force was recovered. Earlier results are
    replaced.
    """
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document.plain(), indent=1, allow_nan=False, ensure_ascii=False)
    (out / REPORT).write_text(text + "\n", encoding="utf-8")
    words = "\n".join(f"# {line}" for line in document.sentence.splitlines())
    (out / AUGMENTED).write_text(
        f"# {document.verdict}\n{words}\n{model_text(diagnosis.augmented)}", encoding="utf-8"
    )
    write_report(out / PAGE, diagnosis, document)
    if diagnosis.gap.on == "holdout" and diagnosis.traces:
        write_runs(out / HOLDOUT, diagnosis)
    else:
        (out / HOLDOUT).unlink(missing_ok=True)
    (out / SURFACE).unlink(missing_ok=True)
    if diagnosis.surface is not None:
        write_surface(out / SURFACE, diagnosis.surface)


def write_surface(path: Path, surface: Surface) -> None:
    """Write the force that was missing over the motion there, and the law if there is one."""
    law = {} if surface.law is None else {"law": surface.law}
    arrays: dict[str, Any] = {"e": surface.e, "v": surface.v, "force": surface.force} | law
    np.savez(path, place=np.array(str(surface.place)), **arrays)


def write_runs(path: Path, diagnosis: Diagnosis) -> None:
    """Write free runs on held-out records: `nominal` and so on, each [time, sensor].

    Where motion was imposed, the only column is the force, under the channel of the input.
    Several records follow each other; `record` counts them from 0.
    """
    traces, given = diagnosis.traces, diagnosis.nominal
    columns = given.inputs if traces[0].of_force else given.sensors
    lengths = [len(trace.times_s) for trace in traces]
    np.savez(
        path,
        channels=np.array([one.channel for one in columns]),
        t=np.concatenate([trace.times_s for trace in traces]),
        record=np.repeat(np.arange(len(traces)), lengths),
        measured=np.concatenate([trace.measured for trace in traces]),
        nominal=np.concatenate([trace.nominal for trace in traces]),
        refitted_nominal=np.concatenate([trace.refitted for trace in traces]),
        augmented=np.concatenate([trace.augmented for trace in traces]),
    )
