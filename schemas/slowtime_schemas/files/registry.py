"""The registry of files with frozen schemas, as `streams` is of messages."""

from typing import Any, ClassVar, Protocol

from .diagnosis import DiagnosisFile
from .model import ModelFile
from .model_v2 import ModelFile2
from .modes import ModesFile
from .slow_diagnosis import SlowDiagnosisFile


class Versioned(Protocol):
    """What has a name, a version and a JSON Schema."""

    MESSAGE: ClassVar[str]
    VERSION: ClassVar[int]

    @classmethod
    def model_json_schema(cls) -> dict[str, Any]:
        """Describe itself."""


DOCUMENTS: dict[str, type[Versioned]] = {
    document.MESSAGE: document
    for document in (DiagnosisFile, ModelFile2, ModesFile, SlowDiagnosisFile)
}
"""Every such file by its name, at its newest version."""

EARLIER: tuple[type[Versioned], ...] = (ModelFile,)
"""Earlier versions of files that are still read and written as they are."""
