import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import slowtime.estimation
import slowtime.evolution

MODULES = [
    f"{package.__name__}.{module.name}"
    for package in (slowtime.evolution, slowtime.estimation)
    for module in pkgutil.iter_modules(package.__path__)
]


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_in_the_docstrings_are_true(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module, extraglobs={"np": np}).failed == 0
