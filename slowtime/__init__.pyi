__all__ = [
    "Assessment",
    "ConstantHistory",
    "ConvertedMesh",
    "DecayLaw",
    "DetectionLimit",
    "DiagnosisResult",
    "EffectCatalogue",
    "EnvelopeSpectrum",
    "EstimatedMode",
    "FailureProbability",
    "FatigueDamage",
    "FiniteElementModel",
    "FittedSurrogate",
    "FoundEvents",
    "Input",
    "MachineOrders",
    "MeasuredDistortion",
    "MergedModes",
    "Model",
    "Modes",
    "OptimalDesigns",
    "PlacedSensors",
    "Predictions",
    "ReducedFiniteElements",
    "ResponseSpectrum",
    "ScaledModes",
    "Sensor",
    "SeparatedHistory",
    "ShakingMeasures",
    "Signals",
    "SmootherChoice",
    "Twin",
    "TwinResponse",
    "UpdatedModel",
    "VirtualQuantity",
    "__version__",
    "assess",
    "bearing_frequencies",
    "choose_smoother",
    "connect",
    "convert",
    "detection_limits",
    "diagnose",
    "distortion",
    "effects",
    "envelope_spectrum",
    "evolve",
    "failure_probability",
    "fatigue_damage",
    "find_events",
    "fit_decay",
    "fit_surrogate",
    "identify",
    "merge",
    "merge_signals",
    "optimise_design",
    "orders",
    "place",
    "read",
    "reduce",
    "response_spectrum",
    "scale",
    "separate",
    "shaking",
    "simulate",
    "track",
    "update",
    "virtual",
]

from slowtime.dynamics.channels.declarations import Input as Input
from slowtime.dynamics.channels.declarations import Sensor as Sensor
from slowtime_api.assessments import Assessment as Assessment
from slowtime_api.assessments import DetectionLimit as DetectionLimit
from slowtime_api.assessments import assess as assess
from slowtime_api.assessments import detection_limits as detection_limits
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
from slowtime_api.mode_sets.merging import MergedModes as MergedModes
from slowtime_api.mode_sets.merging import merge as merge
from slowtime_api.mode_sets.merging import merge_signals as merge_signals
from slowtime_api.mode_sets.scaling import ScaledModes as ScaledModes
from slowtime_api.mode_sets.scaling import scale as scale
from slowtime_api.models import Model as Model
from slowtime_api.models import simulate as simulate
from slowtime_api.probabilities.designs import OptimalDesigns as OptimalDesigns
from slowtime_api.probabilities.designs import optimise_design as optimise_design
from slowtime_api.probabilities.reliability_methods import (
    FailureProbability as FailureProbability,
)
from slowtime_api.probabilities.reliability_methods import (
    failure_probability as failure_probability,
)
from slowtime_api.probabilities.surrogates import FittedSurrogate as FittedSurrogate
from slowtime_api.probabilities.surrogates import Predictions as Predictions
from slowtime_api.probabilities.surrogates import fit_surrogate as fit_surrogate
from slowtime_api.responses.distortions import MeasuredDistortion as MeasuredDistortion
from slowtime_api.responses.distortions import distortion as distortion
from slowtime_api.responses.fatigue_damage import FatigueDamage as FatigueDamage
from slowtime_api.responses.fatigue_damage import fatigue_damage as fatigue_damage
from slowtime_api.responses.machine_orders import MachineOrders as MachineOrders
from slowtime_api.responses.machine_orders import orders as orders
from slowtime_api.responses.time_scales import SeparatedHistory as SeparatedHistory
from slowtime_api.responses.time_scales import separate as separate
from slowtime_api.responses.tracked_constants import ConstantHistory as ConstantHistory
from slowtime_api.responses.tracked_constants import track as track
from slowtime_api.responses.virtual_quantities import VirtualQuantity as VirtualQuantity
from slowtime_api.responses.virtual_quantities import virtual as virtual
from slowtime_api.signals import Signals as Signals
from slowtime_api.signals import read as read
from slowtime_api.smoothing import SmootherChoice as SmootherChoice
from slowtime_api.smoothing import choose_smoother as choose_smoother
from slowtime_api.twin_responses import TwinResponse as TwinResponse
from slowtime_api.twins import Twin as Twin
from slowtime_api.twins import connect as connect
from slowtime_api.twins import evolve as evolve

__version__: str
from slowtime_api.responses.envelope_lines import EnvelopeSpectrum as EnvelopeSpectrum
from slowtime_api.responses.envelope_lines import bearing_frequencies as bearing_frequencies
from slowtime_api.responses.envelope_lines import envelope_spectrum as envelope_spectrum
from slowtime_api.responses.shaking_events import FoundEvents as FoundEvents
from slowtime_api.responses.shaking_events import ResponseSpectrum as ResponseSpectrum
from slowtime_api.responses.shaking_events import ShakingMeasures as ShakingMeasures
from slowtime_api.responses.shaking_events import find_events as find_events
from slowtime_api.responses.shaking_events import response_spectrum as response_spectrum
from slowtime_api.responses.shaking_events import shaking as shaking
