"""A diagnosis in; a folder of files out, for people, machines and simulators."""

import json
from pathlib import Path

import numpy as np

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime_schemas.diagnosis_file import DiagnosisFile
from slowtime_services.models import model_text

from .page import write_report

REPORT, AUGMENTED, HOLDOUT = "report.json", "augmented.yaml", "holdout.npz"
PAGE = "report.html"


def write_results(out: Path, diagnosis: Diagnosis, document: DiagnosisFile) -> None:
    """Write ``report.html``, ``report.json``, ``augmented.yaml`` and ``holdout.npz``.

    What is there is replaced. The last is written only where a record was held out.
    """
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document.plain(), indent=1, allow_nan=False, ensure_ascii=False)
    (out / REPORT).write_text(text + "\n", encoding="utf-8")
    words = "\n".join(f"# {line}" for line in document.sentence.splitlines())
    (out / AUGMENTED).write_text(
        f"# {document.verdict}\n{words}\n{model_text(diagnosis.augmented)}", encoding="utf-8"
    )
    write_report(out / PAGE, diagnosis, document)
    if diagnosis.gap.on == "holdout":
        write_runs(out / HOLDOUT, diagnosis)
    else:
        (out / HOLDOUT).unlink(missing_ok=True)


def write_runs(path: Path, diagnosis: Diagnosis) -> None:
    """Write free runs on what was held out: `nominal` and so on, each [time, sensor].

    Several records follow each other; `record` counts them from 0.
    """
    traces = diagnosis.traces
    lengths = [len(trace.times_s) for trace in traces]
    np.savez(
        path,
        channels=np.array([sensor.channel for sensor in diagnosis.nominal.sensors]),
        t=np.concatenate([trace.times_s for trace in traces]),
        record=np.repeat(np.arange(len(traces)), lengths),
        measured=np.concatenate([trace.measured for trace in traces]),
        nominal=np.concatenate([trace.nominal for trace in traces]),
        refitted_nominal=np.concatenate([trace.refitted for trace in traces]),
        augmented=np.concatenate([trace.augmented for trace in traces]),
    )
