"""Who asks, and may they? A request with a token → the same request with a principal, or no."""

from .guard import Guard, NotSecuredError, guarded
from .openid import OpenId
from .policy import POLICY, Reach, Rule, find
from .principals import EVERYBODY, Principal, Scope, principal_of
from .tokens import Token, TokenFile, WrongNameError, WrongTokenFileError

__all__ = [
    "EVERYBODY",
    "POLICY",
    "Guard",
    "NotSecuredError",
    "OpenId",
    "Principal",
    "Reach",
    "Rule",
    "Scope",
    "Token",
    "TokenFile",
    "WrongNameError",
    "WrongTokenFileError",
    "find",
    "guarded",
    "principal_of",
]
