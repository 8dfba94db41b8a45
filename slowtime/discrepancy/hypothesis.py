"""What the search supposes at any time: which effects a model lacks, and the fits with them."""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.dynamics.effects import Kind, Place

from .calibration import Fit
from .candidates.library_fit import Candidate
from .diagnosis import NamedEffect, Rival
from .estimation.input_hold import Hold
from .estimation.model_evidence import FittedCandidate
from .localization import Localization
from .quoting import requote_all
from .records import Trial


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A model with effects added, fitted to records, and what speaks for and against it.

    Nothing in it is changed: every step of the search gives another one.

    Parameters
    ----------
    fits
        Of the model as given, and after each effect.
    trials
        Records that the fits explain: whole ones, or segments of them.
    localized, rest
        Where a force was missing from the model as given, and from the last fit.
    fitted, tried
        Candidates for the first effect: those fitted, and all, the best first.
    nested
        Fitted candidates of more parameters that do what a simpler one does.
    undecided, pair
        Rivals that the records cannot tell apart, and two of their fits.
    constants_suffice
        Whether constants of the model that are off are among these rivals.
    near_unknown
        Whether a law that is near the one named, and not known, is among them.
    holds
        What inputs do between samples, where another hold than the stated one was taken.
    suggested_holds
        Another hold, under which all effects found so far would explain everything.
    final
        Whether the last effect follows no law, so that nothing more can be found.
    without_sensor
        Whether effects before the last, a sensor's drift, were found by other sensors alone.
    refuted_at
        Element at which a free force shows that no law named is what acts there.
    released
        Whether constants of the model as given were fitted again from where a law led them.
    combined
        Whether all combinations of laws were compared, so that none of them is needless.
    """

    fits: tuple[Fit, ...]
    trials: tuple[Trial, ...]
    effects: tuple[NamedEffect, ...] = ()
    localized: Localization | None = None
    rest: Localization | None = None
    fitted: tuple[FittedCandidate, ...] = ()
    tried: tuple[Candidate, ...] = ()
    nested: tuple[FittedCandidate, ...] = ()
    undecided: tuple[Rival, ...] = ()
    pair: tuple[FittedCandidate, ...] | None = None
    constants_suffice: bool = False
    near_unknown: bool = False
    holds: tuple[Hold, ...] | None = None
    suggested_holds: tuple[Hold, ...] | None = None
    final: bool = False
    without_sensor: bool = False
    refuted_at: Place | None = None
    released: bool = False
    exhausted: bool = False
    combined: bool = False

    @property
    def first(self) -> Fit:
        """Fit of the model as given."""
        return self.fits[0]

    @property
    def last(self) -> Fit:
        """Fit with all effects."""
        return self.fits[-1]

    @property
    def given_effects(self) -> int:
        """Number of effects that the model had before the search."""
        return len(self.first.plant.effects)

    @property
    def fits_whole_records(self) -> bool:
        """Whether every fit has an initial state for each of the records."""
        return all(len(fit.states) == len(self.trials) for fit in self.fits)

    @property
    def last_fits_whole_records(self) -> bool:
        """Whether the last fit has an initial state for each of the records."""
        return len(self.last.states) == len(self.trials)

    def with_last(self, fit: Fit, kinds: Mapping[str, Kind]) -> "Hypothesis":
        """Give the same effects with another last fit, their parameters read off it."""
        return dataclasses.replace(
            self,
            fits=(*self.fits[:-1], fit),
            effects=tuple(requote_all(self.effects, fit, kinds)),
        )

    def with_effect(self, fit: Fit, effect: NamedEffect) -> "Hypothesis":
        """Give the hypothesis with one effect more."""
        return dataclasses.replace(
            self, fits=(*self.fits, fit), effects=(*self.effects, effect)
        )

    def with_effects(self, fits: Sequence[Fit], effects: Sequence[NamedEffect]) -> "Hypothesis":
        """Give the hypothesis with other effects, and a fit after each."""
        return dataclasses.replace(self, fits=tuple(fits), effects=tuple(effects))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SearchStep:
    """A hypothesis after one step of the search.

    Parameters
    ----------
    added
        Number of effects that the step added, or 1 where another hold of the inputs took the
        place of one; 0 also where the last one ends the search, such as a sensor's error.
    again
        Whether the same effect is to be looked for again, in what the hypothesis leaves now.
    drift, base
        A sensor's slow error that follows no law, and is still to be taken account of; and the
        fit that it is added to.
    """

    hypothesis: Hypothesis
    added: int
    again: bool = False
    drift: NamedEffect | None = None
    base: Fit | None = None
