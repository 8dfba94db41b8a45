"""The folder of results of a diagnosis."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.discrepancy.diagnosis import Diagnosis, MeasuredForce, Surface
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.models import model_text

from .report import write_report

REPORT, AUGMENTED, HOLDOUT = "report.json", "augmented.yaml", "holdout.npz"
PAGE, SURFACE, MEASURED_FORCE = "report.html", "surface.npz", "measured_force.npz"


def write_results(
    out: Path,
    diagnosis: Diagnosis,
    document: DiagnosisFile,
    *,
    structure: str = "",
    language: str = "en",
) -> None:
    """Write ``report.html``, ``report.json``, ``augmented.yaml``, and arrays to draw from.

    ``holdout.npz`` is written only where a record was held out and compared in time (which
    ambient records are not), ``surface.npz`` where a force was recovered,
    ``measured_force.npz`` where a force surface closes the gap. Earlier results are replaced.
    """
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document.plain(), indent=1, allow_nan=False, ensure_ascii=False)
    (out / REPORT).write_text(text + "\n", encoding="utf-8")
    words = "\n".join(f"# {line}" for line in document.sentence.splitlines())
    (out / AUGMENTED).write_text(
        f"# {document.verdict}\n{words}\n{model_text(diagnosis.augmented)}", encoding="utf-8"
    )
    write_report(out / PAGE, diagnosis, document, structure=structure, language=language)
    if diagnosis.gap.on == "holdout" and diagnosis.traces:
        write_runs(out / HOLDOUT, diagnosis)
    else:
        (out / HOLDOUT).unlink(missing_ok=True)
    (out / SURFACE).unlink(missing_ok=True)
    if diagnosis.surface is not None:
        write_surface(out / SURFACE, diagnosis.surface)
    (out / MEASURED_FORCE).unlink(missing_ok=True)
    if diagnosis.measured_force is not None:
        write_measured_force(out / MEASURED_FORCE, diagnosis.measured_force)


def write_surface(path: Path, surface: Surface) -> None:
    """Write the force that was missing over the motion there, and the law if there is one."""
    law = {} if surface.law is None else {"law": surface.law}
    arrays: dict[str, Any] = {"e": surface.e, "v": surface.v, "force": surface.force} | law
    np.savez(path, place=np.array(str(surface.place)), **arrays)


def write_measured_force(path: Path, measured: MeasuredForce) -> None:
    """Write the cuts of a force surface with standard deviations, and where it was measured.

    ``over_e`` has the columns elongation, force, standard deviation; ``over_v`` rate, force,
    standard deviation; ``range`` is least and largest elongation and largest rate.
    """
    arrays: dict[str, Any] = {
        name: np.stack([cut.at, cut.force, cut.sd], axis=1)
        for name, cut in (("over_e", measured.over_e), ("over_v", measured.over_v))
    }
    np.savez(
        path,
        place=np.array(str(measured.place)),
        range=np.array([measured.low, measured.high, measured.most]),
        e=measured.e,
        v=measured.v,
        grid_e=measured.grid_e,
        grid_v=measured.grid_v,
        grid_force=measured.grid_force,
        **arrays,
    )


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
