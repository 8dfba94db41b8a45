"""Reasons of errors in words for users, without what only developers can use.

Libraries put class names, addresses of objects and paths of modules into their errors. Whoever
gave the file or the request that failed can do nothing with those, and they tell a stranger how
the server is built.
"""

import re

MOST_CHARACTERS = 400
"""Length of a reason [1]; libraries quote what they met, which is as long as a file likes."""

_FAULTS = (
    ArithmeticError, AssertionError, AttributeError, LookupError, NameError, TypeError,
)  # fmt: skip
"""What libraries raise where they had not thought of a file; the text speaks of their code."""

_INTERNALS: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(pattern, re.DOTALL), plain)
    for pattern, plain in (
        (r"Traceback \(most recent call last\):.*", ""),
        (r"<frozen [\w.]+>(:\d+:)?", ""),
        (r"<(?:class|enum|function|module) '?(?:[\w<>]+\.)*(\w+)'?[^>]*>", r"\1"),
        (r"<(?:[\w<>]+\.)*(\w+) object(?: at 0x[0-9a-fA-F]+)?>", r"\1"),
        (r"\bat 0x[0-9a-fA-F]{5,}", ""),
        (r"File \"[^\"]*\", line \d+(, in \w+)?", ""),
        (r"<(?:unknown|string|stdin|module)>", ""),
        (r"\S*/site-packages/\S*", ""),
        (
            r"Exceeds the limit \((\d+) digits\) for integer string conversion.*",
            r"a number has more than \1 digits",
        ),
        (r"maximum recursion depth exceeded[^.\n]*", "it is nested too deep"),
        (r"<urlopen error (.*?)>", r"\1"),
        (r"\[(?:Errno|WinError) -?\d+\] ", ""),
        (r"int too large to convert to float", "a number is larger than 1.8e308"),
    )
)


def without_internals(text: str) -> str:
    """Return a text without names of classes, addresses of objects and paths of modules.

    Examples
    --------
    >>> without_internals("expected a footer, found <class 'mcap.records.Header'>")
    'expected a footer, found Header'
    """
    for pattern, plain in _INTERNALS:
        text = pattern.sub(plain, text)
    return re.sub(r"[ \t]{2,}", " ", text).strip()


def reason_of(error: BaseException) -> str:
    """Return the reason of an error as one sentence.

    Examples
    --------
    >>> reason_of(FileNotFoundError(2, "No such file or directory", "a.json"))
    'a.json: No such file or directory.'
    >>> reason_of(MemoryError())
    'It takes more memory than is allowed.'
    >>> reason_of(UnboundLocalError("cannot access local variable 'data'"))
    'Its parts contradict each other, or one is missing.'
    """
    if isinstance(error, MemoryError):
        return "It takes more memory than is allowed."
    if isinstance(error, RecursionError):
        return "It is nested too deep."
    if isinstance(error, _FAULTS):
        return "Its parts contradict each other, or one is missing."
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if isinstance(error.filename, str) else ""
        text = f"{where}{error.strerror}"
    else:
        text = str(error)
    text = without_internals(" ".join(text.split()))
    if len(text) > MOST_CHARACTERS:
        return f"{text[:MOST_CHARACTERS]} ..."
    return f"{text.rstrip('.')}." if text else "No reason is given."
