"""Warnings of surrogates, all of them subclasses of `SurrogateWarning`."""


class SurrogateWarning(UserWarning):
    """A surrogate was asked for more than its design supports."""


class FewPointsWarning(SurrogateWarning):
    """A design has fewer points than a plane through it would need twice over."""


class ExtrapolationWarning(SurrogateWarning):
    """A prediction lies where the design has no points."""


class IllConditionedWarning(SurrogateWarning):
    """Inputs that do not vary, or that cannot be told apart in the design."""


class NothingLearntWarning(SurrogateWarning):
    """The outputs are foretold no better with their inputs than without."""
