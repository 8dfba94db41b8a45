__all__ = [
    "DecayLaw",
    "DiagnosisResult",
    "EstimatedMode",
    "Model",
    "Modes",
    "Signals",
    "Twin",
    "__version__",
    "connect",
    "diagnose",
    "fit_decay",
    "identify",
    "read",
    "simulate",
]

from slowtime_api.decays import DecayLaw as DecayLaw
from slowtime_api.decays import fit_decay as fit_decay
from slowtime_api.diagnoses import DiagnosisResult as DiagnosisResult
from slowtime_api.diagnoses import diagnose as diagnose
from slowtime_api.modal_estimates import EstimatedMode as EstimatedMode
from slowtime_api.modal_estimates import Modes as Modes
from slowtime_api.modal_estimates import identify as identify
from slowtime_api.models import Model as Model
from slowtime_api.models import simulate as simulate
from slowtime_api.signals import Signals as Signals
from slowtime_api.signals import read as read
from slowtime_api.twins import Twin as Twin
from slowtime_api.twins import connect as connect

__version__: str
