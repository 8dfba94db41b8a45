"""Commands for words that newcomers try first."""

import difflib
from collections.abc import Iterable, Mapping

SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "agent": ("edge",),
    "analyse": ("identify", "diagnose"),
    "analyze": ("identify", "diagnose"),
    "broker": ("router",),
    "certificates": ("keys",),
    "damage": ("assess", "fatigue", "diagnose"),
    "fmi": ("fmu",),
    "health": ("doctor", "status"),
    "help": ("--help",),
    "info": ("doctor",),
    "life": ("forecast",),
    "database": ("db",),
    "modal": ("identify", "modes"),
    "fe": ("model",),
    "mesh": ("convert",),
    "oma": ("identify",),
    "play": ("replay",),
    "predict": ("forecast",),
    "quota": ("holdings",),
    "read": ("identify", "import"),
    "repair": ("recover", "event"),
    "run": ("demo", "twin"),
    "serve": ("twin",),
    "server": ("twin",),
    "start": ("demo", "twin"),
    "users": ("tokens",),
    "version": ("--version",),
    "web": ("twin",),
}
"""Word that is no verb → verbs that do what it probably means."""


def suggestions(word: str, verbs: Iterable[str]) -> tuple[str, ...]:
    """Return verbs that a wrong word may mean; none where nothing is close.

    Parameters
    ----------
    word
        Word that is no verb.
    verbs
        All verbs.

    Returns
    -------
    tuple of str
        Likeliest verb first, three at most.

    Examples
    --------
    >>> suggestions("identfy", ["identify", "edge"])
    ('identify',)
    >>> suggestions("server", ["identify", "edge"])
    ('twin',)
    >>> suggestions("frobnicate", ["identify", "edge"])
    ()
    """
    lower = word.lower()
    return SYNONYMS.get(lower) or tuple(difflib.get_close_matches(lower, list(verbs)))
