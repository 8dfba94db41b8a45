"""Thresholds that several stages of the search share."""

import dataclasses


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """By which the search decides; each with its unit, its meaning and its source.

    "Hidden cases" are those of `tests/blind`: figures and seeds are in `docs/diagnosing.md`.
    """

    white_p_value: float = 1e-3
    """[probability] p-value of chi squared from which a fit leaves noise only. Source: one
    false alarm in a thousand fits; some hundred are judged in a campaign."""
    coloured_p_value: float = 1e-6
    """[probability] p-value of chi squared below which the rest is not called noise. Source:
    three decades under `white_p_value`, because the noise floor is an estimate itself."""
    explained_chi2: float = 1.5
    """[noise variances] Mean square in band up to which a model explains the records. Source:
    docs/what_decides.md: half and double change no answer; chi squared over thousands of
    samples alone would allow 1.05."""
    far_off_chi2: float = 5.0
    """[noise variances] Mean square in band above which a fit of whole records has not found
    the right law, or not its minimum. Source: docs/what_decides.md: half and double change no
    answer."""
    segment_chi2: float = 2.0
    """[noise variances] Mean square in band that a right law leaves at most of short segments,
    each with an initial state of its own. Source: docs/what_decides.md: half and double change
    no answer."""
    several_forces_chi2: float = 3.0
    """[noise variances] Mean square that a free force at the best place leaves, from which one
    force is not all that is missing. Source: docs/what_decides.md: half and double change no
    answer."""
    false_alarm_p_value: float = 1e-4
    """[probability] p-value of a gain of likelihood at which a force counts as found. Source:
    one false alarm in ten thousand places tried."""
    least_log_evidence: float = 6.0
    """[nats] Log evidence that an effect has to bring. Source: odds of 400 to 1; Kass and
    Raftery (1995) call 5 nats very strong."""
    evidence_power: float = 0.5
    """[1] Power to which evidence is taken before probabilities are formed, because a model is
    never as right as its likelihood supposes (Grünwald, 2012). Source: calibrated on hidden
    cases: what is given 0.9 and more is right as often."""
    decided_probability: float = 0.9
    """[probability] From which one name is given. Source: a decision of the interface."""
    undecided_mass: float = 0.95
    """[probability] That a set called undecided has together. Source: a 95 % credible set."""
    told_probability: float = 1e-6
    """[probability] From which a rival is listed. Source: a decision of the interface."""
    negligible_share: float = 2e-4
    """[share of what was missing at first] Up to which a later effect explains too little to be
    one. Source: true second effects of eighty hidden cases explained 7e-4 at least."""
    moved_tolerances: float = 3.0
    """[stated standard deviations] By which a constant must have moved to be reported. Source:
    three-sigma rule: one constant in 370 by chance."""
    alone_tolerances: float = 4.0
    """[stated standard deviations] By which one constant must be off, and no other, to count as
    an effect. Source: one sigma above `moved_tolerances`, as it is the strongest of several."""
    clear_sds: float = 3.0
    """[standard deviations] By which the strength of a law with one parameter must differ from
    nothing. Source: three-sigma rule."""
    seen_sds: float = 2.0
    """[standard deviations] The same for a law with several parameters. Source: the 95 % level;
    evidence has charged for the other parameters."""


LIMITS = Limits()
