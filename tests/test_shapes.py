"""What the tests look at in the calls of the house."""

import dataclasses

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError

from slowtime.evolution.forecasting.scores import crps
from tests.shapes import EVERY, FIRST, TEST, wrapped

Row = Float[np.ndarray, " time"]


def longer(values: Row, by: int) -> Row:
    return np.append(values, np.zeros(by))


def test_the_house_is_looked_at():
    with pytest.raises(TypeCheckError, match=r"\(2,\), which does not equal the existing"):
        crps(np.zeros(3), np.zeros(2), np.zeros(3))


def test_axes_of_one_name_are_alike_within_a_call_and_free_between_calls():
    look = wrapped(longer)
    for count in (2, 3):
        np.testing.assert_array_equal(look(np.ones(count), 0), np.ones(count))
    with pytest.raises(TypeCheckError, match="return"):
        look(np.ones(2), 1)
    with pytest.raises(TypeCheckError, match="values"):
        look(np.ones((2, 2)), 0)


def test_axes_of_a_call_within_a_call_are_its_own():
    inner = wrapped(longer)

    def outer(values: Row) -> Row:
        inner(np.ones(len(values) + 5), 0)
        return values

    assert len(wrapped(outer)(np.ones(3))) == 3


def test_the_first_calls_of_every_test_are_looked_at_and_some_of_the_rest():
    look = wrapped(longer)
    wrong = []
    for number in range(1, FIRST + 2 * EVERY + 1):
        try:
            look(np.ones(2), 1)
        except TypeCheckError:
            wrong.append(number)
    assert wrong[:FIRST] == [*range(1, FIRST + 1)]
    assert len(wrong) == FIRST + 2
    TEST.begins()
    with pytest.raises(TypeCheckError, match="return"):
        look(np.ones(2), 1)


def size(pair: "Pair") -> int:
    return "two"  # type: ignore[return-value]


@wrapped
@dataclasses.dataclass
class Pair:
    """Two of one length."""

    one: Row
    other: Row
    size = wrapped(property(size))

    @wrapped
    @classmethod
    def of(cls, count: int) -> "Pair":
        """Twice the same."""
        return cls(np.ones(count), np.ones(count))


def test_what_has_no_arrays_and_what_belongs_to_a_class_is_looked_at_too():
    with pytest.raises(TypeCheckError, match="other"):
        Pair(np.ones(2), np.ones(3))
    with pytest.raises(TypeCheckError, match="count"):
        Pair.of("two")
    with pytest.raises(TypeCheckError, match="return"):
        _ = Pair.of(2).size
