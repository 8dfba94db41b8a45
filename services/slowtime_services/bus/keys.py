"""Key expressions: chunks between slashes, `*` for any one chunk, `**` for any number of them.

The rules are Zenoh's, written once so that the in-memory bus follows them too. A chunk that
begins with ``@`` is verbatim: only itself matches it.
"""

import functools

LONGEST_EXPRESSION = 1024
"""Characters of the longest address [1]. Results are remembered by address; Zenoh itself takes
64 KiB."""


class InvalidKeyError(ValueError):
    """A key that no bus accepts."""


@functools.lru_cache(maxsize=65536)
def check_key(key: str, *, wildcards: bool) -> str:
    """Return `key` if it is valid.

    Raises
    ------
    InvalidKeyError
        If it is empty, has an empty chunk or a forbidden character, or a wildcard where one
        process must be named.
    """
    if len(key) > LONGEST_EXPRESSION:
        raise InvalidKeyError(
            f"A bus address of {len(key)} characters was given: {key:.60}… Allowed: up to "
            f"{LONGEST_EXPRESSION}."
        )
    chunks = key.split("/")
    if not all(chunks) or any(mark in key for mark in "?#$"):
        raise InvalidKeyError(
            f"{key!r} is not a valid bus address (key expression). Use parts separated by "
            "single '/', without '?', '#' and '$', for example "
            "'slowtime/v1/lab/beam/features'."
        )
    starred = [chunk for chunk in chunks if "*" in chunk]
    if any(chunk not in ("*", "**") for chunk in starred):
        raise InvalidKeyError(
            f"{key!r} mixes '*' with other characters. Allowed: '*' and '**' as "
            "whole parts between '/'."
        )
    if starred and not wildcards:
        raise InvalidKeyError(f"{key!r} has a wildcard. Give one key: a message has one.")
    return key


@functools.lru_cache(maxsize=65536)
def matches(expression: str, key: str) -> bool:
    """Whether two key expressions have a key in common.

    Examples
    --------
    >>> matches("slowtime/v1/*/*/features", "slowtime/v1/lab/beam/features")
    True
    >>> matches("slowtime/**", "slowtime"), matches("slowtime/*", "slowtime/v1/lab")
    (True, False)
    >>> matches("a/*/c", "a/**"), matches("a/**", "a/@hidden")
    (True, False)
    """
    return expression == key or _meet(tuple(expression.split("/")), tuple(key.split("/")))


def _meet(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    if not one or not other:
        return all(chunk == "**" for chunk in one + other)
    if one[0] == "**":
        return _meet(one[1:], other) or (_is_free(other[0]) and _meet(one, other[1:]))
    if other[0] == "**":
        return _meet(other, one)
    same = one[0] == other[0]
    either = (one[0] == "*" and _is_free(other[0])) or (other[0] == "*" and _is_free(one[0]))
    return (same or either) and _meet(one[1:], other[1:])


def _is_free(chunk: str) -> bool:
    return not chunk.startswith("@")
