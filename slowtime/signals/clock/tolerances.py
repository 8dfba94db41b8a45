"""Assumed tolerances of sampling clocks, host clocks and transport delays."""

import dataclasses


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ClockTolerances:
    """Tolerances of the clock model, each with its source.

    Parameters
    ----------
    rate
        Standard deviation of the device's rate about the nominal one, before anything was
        measured; relative. 1 %: sensors with an RC oscillator instead of a crystal state 1 to
        5 % over temperature (ADXL355: 'output data rate accuracy' is that of an internal
        oscillator, MPU-6050: +-1 %). Give 1e-4 for a crystal.
    rate_limit
        Error of the rate that is thought impossible; relative. 5 %: the worst of the above.
        Messages that only a greater one explains are queues that were drained late.
    wander
        Instability of a rate at constant temperature; relative, a standard deviation. 1e-8:
        upper end of simple crystal oscillators over 1 to 1000 s (J. R. Vig, "Quartz crystal
        resonators and oscillators", 2004).
    latency_s, latency_sd_s
        Time from a sample to the earliest arrival of its message, which no arrival shows, and
        its standard deviation [s]. 5 ms: sensor filter, driver and local network together.
    resolution_s
        Of the stamps [s]. 1 us: what operating systems stamp arrivals with, or better.
    span_s
        Sensor time of the shortest span of messages [s]. Half a second holds several messages
        of usual devices, and gives a first estimate after three seconds.
    spans
        Spans kept, at most; beyond, two become one. 32: fewer would be more precise with
        latencies that crowd at their minimum, more would know their own scatter better.
    horizon_s
        Sensor time that is remembered [s]. An hour: temperature moves a rate over longer.
    patience_s
        For so long messages must be late, or early, before the host's clock is thought to have
        stepped [s]. 30 s: longer than the stalls of a network that does not lose connection.
    notable
        Spans in a row that must be late or early before a reading says so.
    fewest
        Spans on either side of a change of rate or clock.
    change
        Size of a change in standard deviations, from which on it is believed. 5: once in a
        million; a stream is asked some hundred times while it grows.
    """

    rate: float = 0.01
    rate_limit: float = 0.05
    wander: float = 1e-8
    latency_s: float = 0.0
    latency_sd_s: float = 0.005
    resolution_s: float = 1e-6
    span_s: float = 0.5
    spans: int = 32
    horizon_s: float = 3600.0
    patience_s: float = 30.0
    notable: int = 10
    fewest: int = 4
    change: float = 5.0

    def __post_init__(self) -> None:
        """Refuse tolerances that cannot be."""
        if not 0 < self.rate < self.rate_limit < 1:
            raise ValueError(
                f"rate={self.rate}, rate_limit={self.rate_limit}: allowed is 0 < rate < "
                "rate_limit < 1, relative. Give 1e-4 for a crystal of 100 ppm."
            )
        if self.spans < 16 or self.spans % 2:
            raise ValueError(f"spans={self.spans}: give an even number of 16 or more.")
