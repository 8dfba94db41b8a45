"""No public function takes a wrong input in silence."""

import pytest

import slowtime as st

from .wrong_inputs import WrongInput, public_functions, wrong_inputs

FUNCTIONS = [name for name, _, _ in public_functions()]


def test_every_public_function_is_tried():
    tried = [one.function.partition(".")[0] for one in wrong_inputs()]
    assert {"Signals", "Model", "Twin", "identify", "simulate", "update"} <= set(tried)
    functions = {name for name in FUNCTIONS if name in st.__all__}
    assert functions <= set(tried)
    assert len(tried) >= 60


@pytest.mark.parametrize("name", FUNCTIONS)
def test_wrong_inputs_are_refused_by_name_before_any_arithmetic(name):
    """Objects of classes are empty: arithmetic on them would fail in another way."""
    faults = [(one, fault) for one in wrong_inputs(name) if (fault := fault_of(one))]
    assert faults == []


def fault_of(wrong: WrongInput) -> str:
    """Say what is wrong with the refusal of a wrong input; empty where it is right."""
    try:
        wrong.call(**wrong.arguments)
    except (TypeError, ValueError) as error:
        last = str(error).splitlines()[-1]
        said = any(word in last for word in ("Give", "Allowed", "Its arguments"))
        return "" if said and wrong.parameter in last else last
    except Exception as error:
        return repr(error)
    return "taken in silence"
