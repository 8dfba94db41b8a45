"""Only the tests are collected; the rest is imported by them, and by the command."""

collect_ignore = [
    "__main__.py",
    "reader_server.py",
    "files.py",
    "formats.py",
    "house.py",
    "mutate.py",
    "rest.py",
    "wire.py",
    "workers.py",
]
