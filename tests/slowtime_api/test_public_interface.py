"""Promises of ``import slowtime``: small, lazy, typed, stable."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import slowtime as st

ROOT = Path(__file__).parents[2]
SIGNATURES = Path(__file__).with_name("public_signatures.txt")


def public_signatures() -> list[str]:
    """Return one line for each public name, method and property."""
    lines = []
    for name in sorted(st.__all__):
        one = getattr(st, name)
        if not callable(one):
            continue
        lines.append(f"{name}{inspect.signature(one)}")
        if inspect.isclass(one):
            for member, value in sorted(vars(one).items()):
                if member.startswith("_"):
                    continue
                function = getattr(value, "__func__", value)
                if inspect.isfunction(function):
                    lines.append(f"{name}.{member}{inspect.signature(function)}")
                elif isinstance(value, property):
                    lines.append(f"{name}.{member}")
    return lines


def test_every_public_name_exists_is_typed_and_documented():
    stub = ast.parse((ROOT / "slowtime" / "__init__.pyi").read_text())
    typed = {
        one.asname
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for one in node.names
    }
    assert typed | {"__version__"} == set(st.__all__)
    assert dir(st) == sorted(st.__all__)
    for name in st.__all__:
        assert getattr(st, name).__doc__


def test_a_changed_signature_is_stated_in_the_changelog():
    """Renew the file with ``python -m tests.slowtime_api.test_public_interface``."""
    assert public_signatures() == SIGNATURES.read_text().splitlines(), (
        "The public interface has changed. State it in CHANGELOG.md, then renew "
        "public_signatures.txt."
    )


def test_public_functions_document_each_parameter():
    missing = []
    for name in st.__all__:
        one = getattr(st, name)
        members = [one] if callable(one) else []
        if inspect.isclass(one):
            members += [
                getattr(value, "__func__", value)
                for member, value in vars(one).items()
                if not member.startswith("_") and callable(getattr(value, "__func__", value))
            ]
        for member in members:
            if hasattr(member, "__deprecated__"):
                continue
            document = inspect.getdoc(member) or ""
            missing += [
                f"{member.__qualname__}: {parameter}"
                for parameter in inspect.signature(member).parameters
                if parameter not in ("self", "cls") and parameter not in document
            ]
    assert missing == []


def test_importing_it_imports_neither_numpy_nor_a_framework():
    code = (
        "import sys, slowtime; print([m for m in ('numpy', 'scipy', 'pydantic', 'fastapi', "
        "'zenoh', 'matplotlib', 'pandas', 'slowtime_api') if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], text=True, capture_output=True, check=True
    )
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("blocked", "use", "install"),
    [
        ("matplotlib", "st.Signals([0.0] * 99, 9.0).plot()", "slowtime[plots]"),
        ("pandas", "st.Signals([0.0] * 99, 9.0).to_pandas()", "slowtime[tables]"),
        ("xarray", "st.Signals([0.0] * 99, 9.0).to_xarray()", "slowtime[tables]"),
        ("yaml", "st.Model", "slowtime[analysis]"),
        ("fastapi", "st.Twin", "slowtime[twin]"),
    ],
)
def test_a_missing_extra_is_named_with_its_command(blocked, use, install):
    code = (
        "import sys, importlib.abc\n"
        "class Block(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.partition('.')[0] == {blocked!r}:\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Block())\n"
        f"import slowtime as st\n{use}\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], text=True, capture_output=True, check=False
    )
    assert run.returncode == 1
    assert f"pip install '{install}'" in run.stderr.splitlines()[-1]


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'identfy'"):
        getattr(st, "identfy")  # noqa: B009  # as a user types it


if __name__ == "__main__":
    SIGNATURES.write_text("\n".join(public_signatures()) + "\n")
