"""Virtual sensor: unmeasured outputs, with standard deviations, from accelerations.

Samples are taken in windows: of each, the levels of forces are estimated, and the filters of
all models run through it with their states carried over. Where the stream is cut changes
nothing.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.dynamics.description import Description

from .filters import BLOCK, Filters, make_filters
from .latent import Latent, latent_model, modes_kept, noise_of
from .levels import Groups, Levels, fit_levels, responses
from .outputs import Output
from .settings import VirtualSettings
from .tolerances import members_of

PERIODS = 40
LEAST_WINDOW_S = 10.0
LOWEST_SHARE = 0.25
MISFIT = 2.0
"""Misfit of the spectra [1] above which the model is said not to explain what is measured."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SensorWindow:
    """Outputs over one window.

    Parameters
    ----------
    first_index
        Of the first sample, counted from where the stream began.
    values, sd
        Of each output in its unit, and standard deviation of the error.
    settled
        Where the filters have forgotten how they began.
    levels
        As fitted to the window.
    missing_variance, model_variance
        Of each output: variance of what the filters cannot tell, and mean square of the
        error that tolerances of the model and of the output's factor cause.
    reasons
        Why the values may be worse than they say.
    """

    first_index: int
    values: Float[np.ndarray, "time output"]
    sd: Float[np.ndarray, "time output"]
    settled: Bool[np.ndarray, " time"]
    levels: Levels
    missing_variance: Float[np.ndarray, " output"]
    model_variance: Float[np.ndarray, " output"]
    reasons: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class VirtualState:
    """What a virtual sensor remembers: samples of a window begun, and the filters' states."""

    waiting: tuple[np.ndarray, ...] = ()
    taken: int = 0
    states: np.ndarray | None = None
    levels: Levels | None = None
    filters: Filters | None = None


class VirtualSensor:
    """Estimates outputs of a model from accelerations.

    Parameters
    ----------
    description
        The structure, with its sensors, their noise and its tolerance.
    channels
        Which are listened to; they are columns of the samples, in SI.
    outputs
        What is asked for.
    rate_hz
        Samples per second.
    moving_base
        Whether the base moves without being measured: absolute accelerations then hold it.

    Raises
    ------
    ValueError
        Where model, channels and outputs do not go together.
    """

    def __init__(
        self,
        description: Description,
        channels: Sequence[str],
        outputs: Sequence[Output],
        rate_hz: float,
        settings: VirtualSettings | None = None,
        *,
        moving_base: bool = False,
    ) -> None:
        settings = VirtualSettings() if settings is None else settings
        if not channels or not outputs:
            raise ValueError("Give at least one channel, and at least one output.")
        modes = modes_kept(description, rate_hz, settings)
        first = latent_model(
            description, channels, outputs, rate_hz, settings,
            lowest_hz=settings.lowest_hz or 1.0, modes=modes, moving_base=moving_base,
        )  # fmt: skip
        self.outputs, self.rate_hz = tuple(outputs), rate_hz
        self.lowest_hz = settings.lowest_hz or LOWEST_SHARE * float(first.frequency_hz[0])
        self.frequency_hz = first.frequency_hz
        self._settings, self._noise = settings, noise_of(description, channels)
        self._models: list[Latent] = [
            latent_model(
                member, channels, outputs, rate_hz, settings,
                lowest_hz=self.lowest_hz, modes=modes, moving_base=moving_base,
            )
            for member in (description, *members_of(description, settings.members))
        ]  # fmt: skip
        nominal = self._models[0]
        if len(self._models) > 2:
            del self._models[0]
        else:
            del self._models[1:]
        seconds = settings.window_s or max(LEAST_WINDOW_S, PERIODS / self.frequency_hz[0])
        self.window = max(1, round(seconds * rate_hz / BLOCK)) * BLOCK
        self._groups = Groups.of(
            self.window, rate_hz, self.lowest_hz, float(self.frequency_hz[-1])
        )
        if len(self._groups.sizes) < 8:
            raise ValueError(
                f"A window of {self.window / rate_hz:g} s holds too few frequencies above "
                f"{self.lowest_hz:g} Hz. Give a longer window_s."
            )
        response = nominal.response(self._groups.frequency_hz)
        self._responses = responses(response, self._groups)
        self._factor_sd = np.array([output.factor_sd for output in outputs])
        self.unseen = nominal.unseen

    def start(self) -> VirtualState:
        """Begin with nothing seen."""
        return VirtualState()

    def step(
        self, state: VirtualState, samples: Float[np.ndarray, "time channel"]
    ) -> tuple[VirtualState, tuple[SensorWindow, ...]]:
        """Process samples; return the windows that they complete.

        Parameters
        ----------
        state
            State after the samples before.
        samples
            Accelerations in SI, all finite.

        Returns
        -------
        State after the samples, and the windows that they complete.
        """
        if not np.isfinite(samples).all():
            raise ValueError(
                "Samples are missing (not finite). Bridge short gaps; begin anew after others."
            )
        waiting = np.concatenate([*state.waiting, samples])
        out = []
        while len(waiting) >= self.window:
            state, window = self._take(state, waiting[: self.window])
            waiting = waiting[self.window :]
            out.append(window)
        return dataclasses.replace(state, waiting=(waiting,)), tuple(out)

    def finish(self, state: VirtualState) -> tuple[VirtualState, tuple[SensorWindow, ...]]:
        """Work what is left of the last window, by the levels of the window before it."""
        left = np.concatenate(state.waiting) if state.waiting else np.zeros((0, 1))
        whole = len(left) // BLOCK * BLOCK
        if not whole or state.filters is None:
            return state, ()
        state, window = self._run(state, left[:whole], state.filters)
        return dataclasses.replace(state, waiting=()), (window,)

    def _take(
        self, state: VirtualState, samples: np.ndarray
    ) -> tuple[VirtualState, SensorWindow]:
        levels = fit_levels(
            self._groups.spectra(samples, self.rate_hz),
            self._responses,
            self._groups.sizes,
            self._noise,
            self.rate_hz,
            iterations=self._settings.iterations,
            start=state.levels,
        )
        filters = make_filters(self._models, levels, self.rate_hz)
        return self._run(
            dataclasses.replace(state, levels=levels, filters=filters), samples, filters
        )

    def _run(
        self, state: VirtualState, samples: np.ndarray, filters: Filters
    ) -> tuple[VirtualState, SensorWindow]:
        states = state.states
        if states is None:
            states = np.zeros((len(self._models), filters.onward.shape[1]))
        states, values = filters.run(states, samples)
        mean = values.mean(axis=0)
        spread = values.var(axis=0, ddof=1) if len(values) > 1 else np.zeros_like(mean)
        missing = filters.variance.mean(axis=0)
        wrong = spread + (self._factor_sd * mean) ** 2
        levels = state.levels
        assert levels is not None
        index = state.taken + np.arange(len(samples))
        window = SensorWindow(
            first_index=state.taken,
            values=mean,
            sd=np.sqrt(missing + wrong),
            settled=index >= filters.settles_s * self.rate_hz,
            levels=levels,
            missing_variance=missing,
            model_variance=wrong.mean(axis=0),
            reasons=self._reasons(levels),
        )
        after = dataclasses.replace(state, states=states, taken=state.taken + len(samples))
        return after, window

    def _reasons(self, levels: Levels) -> tuple[str, ...]:
        reasons = tuple(f"unseen_mode_{j + 1}" for j in self.unseen)
        return reasons + (("model_misfit",) if levels.misfit > MISFIT else ())
