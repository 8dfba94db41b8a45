"""Requests with tokens in; requests with principals, or refusals, out."""

from twin_server.identity.principals import EVERYBODY, Principal, Scope, principal_of
from twin_server.identity.tokens import Token, TokenFile, WrongTokenFileError

from .guard import Guard, NotSecuredError, guarded
from .openid import OpenId
from .policy import POLICY, Reach, Rule, find

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
    "WrongTokenFileError",
    "find",
    "guarded",
    "principal_of",
]
