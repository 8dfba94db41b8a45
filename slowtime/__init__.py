"""slowtime: a digital twin for things that vibrate.

The functions below are what users need; each is imported when it is first used. The packages
of `slowtime` (`dynamics`, `identification`, `discrepancy`, ...) hold the arithmetic: functions
of arrays, without files, clocks or networks.

Examples
--------
>>> import slowtime as st
>>> model = st.Model.chain([1.0, 1.0], [400.0, 400.0], rayleigh=(0.1, 1e-4))
>>> signals = st.simulate(model, rate_hz=50.0, duration_s=600.0, seed=1)
>>> modes = st.identify(signals, method="modes")
>>> len(modes)
2
"""

import importlib
from typing import Any

_MODULES = {
    "slowtime.dynamics.channels.declarations": ("Input", "Sensor"),
    "slowtime_api.signals": ("Signals", "read"),
    "slowtime_api.modal_estimates": ("EstimatedMode", "Modes", "identify"),
    "slowtime_api.decays": ("DecayLaw", "fit_decay"),
    "slowtime_api.models": ("Model", "simulate"),
    "slowtime_api.diagnoses": ("DiagnosisResult", "diagnose"),
    "slowtime_api.finite_elements.matrix_models": ("FiniteElementModel",),
    "slowtime_api.finite_elements.updating": ("UpdatedModel", "update"),
    "slowtime_api.finite_elements.placement": ("PlacedSensors", "place"),
    "slowtime_api.finite_elements.reduction": ("ReducedFiniteElements", "reduce"),
    "slowtime_api.finite_elements.conversion": ("ConvertedMesh", "convert"),
    "slowtime_api.effect_list": ("EffectCatalogue", "effects"),
    "slowtime_api.responses.virtual_quantities": ("VirtualQuantity", "virtual"),
    "slowtime_api.responses.fatigue_damage": ("FatigueDamage", "fatigue_damage"),
    "slowtime_api.responses.distortions": ("MeasuredDistortion", "distortion"),
    "slowtime_api.responses.machine_orders": ("MachineOrders", "orders"),
    "slowtime_api.responses.envelope_lines": (
        "EnvelopeSpectrum",
        "bearing_frequencies",
        "envelope_spectrum",
    ),
    "slowtime_api.responses.shaking_events": (
        "FoundEvents",
        "ResponseSpectrum",
        "ShakingMeasures",
        "find_events",
        "response_spectrum",
        "shaking",
    ),
    "slowtime_api.responses.time_scales": ("SeparatedHistory", "separate"),
    "slowtime_api.responses.tracked_constants": ("ConstantHistory", "track"),
    "slowtime_api.mode_sets.merging": ("MergedModes", "merge", "merge_signals"),
    "slowtime_api.mode_sets.scaling": ("ScaledModes", "scale"),
    "slowtime_api.probabilities.surrogates": (
        "FittedSurrogate",
        "Predictions",
        "fit_surrogate",
    ),
    "slowtime_api.probabilities.designs": ("OptimalDesigns", "optimise_design"),
    "slowtime_api.probabilities.reliability_methods": (
        "FailureProbability",
        "failure_probability",
    ),
    "slowtime_api.twin_responses": ("TwinResponse",),
    "slowtime_api.twins": ("Twin", "connect", "evolve"),
    "slowtime_api.smoothing": ("SmootherChoice", "choose_smoother"),
    "slowtime_api.assessments": ("Assessment", "DetectionLimit", "assess", "detection_limits"),
}
_EXTRAS = {"slowtime_api.twins": "twin"}
"""Extra that a module needs; `analysis` where none is listed."""
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

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


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (SPEC 1, lazy loading)."""
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("slowtime")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'slowtime' has no attribute {name!r}")
    module = _MODULE_OF[name]
    try:
        found = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get(module, "analysis")
        raise ImportError(
            f"slowtime.{name} needs {error.name}, which is not installed. Install it with: "
            f"pip install 'slowtime[{extra}]'"
        ) from error
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
