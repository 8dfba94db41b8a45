__all__ = [
    "ConvertedMesh",
    "DecayLaw",
    "DiagnosisResult",
    "EffectCatalogue",
    "EstimatedMode",
    "FailureProbability",
    "FatigueDamage",
    "FiniteElementModel",
    "Input",
    "Model",
    "Modes",
    "PlacedSensors",
    "ReducedFiniteElements",
    "Sensor",
    "Signals",
    "Twin",
    "TwinResponse",
    "UpdatedModel",
    "VirtualQuantity",
    "__version__",
    "connect",
    "convert",
    "diagnose",
    "effects",
    "evolve",
    "failure_probability",
    "fatigue_damage",
    "fit_decay",
    "identify",
    "place",
    "read",
    "reduce",
    "simulate",
    "update",
    "virtual",
]

from slowtime.dynamics.channels.declarations import Input as Input
from slowtime.dynamics.channels.declarations import Sensor as Sensor
from slowtime_api.decays import DecayLaw as DecayLaw
from slowtime_api.decays import fit_decay as fit_decay
from slowtime_api.diagnoses import DiagnosisResult as DiagnosisResult
from slowtime_api.diagnoses import diagnose as diagnose
from slowtime_api.effect_list import EffectCatalogue as EffectCatalogue
from slowtime_api.effect_list import effects as effects
from slowtime_api.finite_elements.conversion import ConvertedMesh as ConvertedMesh
from slowtime_api.finite_elements.conversion import convert as convert
from slowtime_api.finite_elements.matrix_models import FiniteElementModel as FiniteElementModel
from slowtime_api.finite_elements.placement import PlacedSensors as PlacedSensors
from slowtime_api.finite_elements.placement import place as place
from slowtime_api.finite_elements.reduction import (
    ReducedFiniteElements as ReducedFiniteElements,
)
from slowtime_api.finite_elements.reduction import reduce as reduce
from slowtime_api.finite_elements.updating import UpdatedModel as UpdatedModel
from slowtime_api.finite_elements.updating import update as update
from slowtime_api.modal_estimates import EstimatedMode as EstimatedMode
from slowtime_api.modal_estimates import Modes as Modes
from slowtime_api.modal_estimates import identify as identify
from slowtime_api.models import Model as Model
from slowtime_api.models import simulate as simulate
from slowtime_api.probabilities.reliability_methods import (
    FailureProbability as FailureProbability,
)
from slowtime_api.probabilities.reliability_methods import (
    failure_probability as failure_probability,
)
from slowtime_api.responses.fatigue_damage import FatigueDamage as FatigueDamage
from slowtime_api.responses.fatigue_damage import fatigue_damage as fatigue_damage
from slowtime_api.responses.virtual_quantities import VirtualQuantity as VirtualQuantity
from slowtime_api.responses.virtual_quantities import virtual as virtual
from slowtime_api.signals import Signals as Signals
from slowtime_api.signals import read as read
from slowtime_api.twin_responses import TwinResponse as TwinResponse
from slowtime_api.twins import Twin as Twin
from slowtime_api.twins import connect as connect
from slowtime_api.twins import evolve as evolve

__version__: str
