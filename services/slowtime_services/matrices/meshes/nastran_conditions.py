"""Supports, relations and rigid elements of bulk data → conditions of a frame."""

from .mesh import DIRECTIONS, Mesh
from .nastran_averages import average
from .nastran_deck import Deck, Fields

ALL = (0, 1, 2, 3, 4, 5)
_TERMS = (2, 5, 10, 13)
"""Fields of the first four terms of an MPC; each further line adds two, eight fields on."""


def add_conditions(mesh: Mesh, deck: Deck) -> None:
    """Add SPC, SPC1, MPC, RBE2, RBE3 and RBAR to a mesh.

    Parameters
    ----------
    mesh
        With all points.
    deck
        Cards, and the sets that the case control selects.

    Raises
    ------
    MatrixFileError
        Where several sets are there and none is selected, or a condition cannot be kept.
    """
    for card in _selected(mesh, deck, "SPC", ("SPC", "SPC1")):
        _hold(mesh, card)
    for card in _selected(mesh, deck, "MPC", ("MPC",)):
        _relate(mesh, card)
    for card in deck.of("RBE2"):
        _tie(mesh, card, card.whole(2), card.directions(3), card.numbers(4))
    for card in deck.of("RBAR"):
        _add_bar(mesh, card)
    for card in deck.of("RBE3"):
        average(mesh, card)


def _selected(mesh: Mesh, deck: Deck, what: str, kinds: tuple[str, ...]) -> list[Fields]:
    """Cards of the selected set; where the file selects none, of its only one."""
    cards = list(deck.of(*kinds))
    numbers = {card.whole(1) for card in cards}
    sums = {card.whole(1): set(card.numbers(2)) for card in deck.of(f"{what}ADD")}
    chosen = deck.selected[what]
    if len(chosen) > 1:
        raise mesh.error(
            1,
            f"the cases select {what} = {', '.join(sorted(chosen))}. Allowed is one set for "
            "the whole file.",
        )
    if not chosen and (len(numbers) > 1 or len(sums) > 1):
        raise mesh.error(
            1,
            f"the sets {', '.join(sorted(numbers | set(sums)))} of {what} are there and the "
            f"case control selects none. Add a line `{what} = number` before BEGIN BULK.",
        )
    if not chosen:
        return cards
    (number,) = chosen
    wanted = sums.get(number, {number})
    return [card for card in cards if card.whole(1) in wanted]


def _hold(mesh: Mesh, card: Fields) -> None:
    if card.kind == "SPC1":
        for node in card.numbers(3):
            mesh.place(node, card.line)
            mesh.hold(node, card.directions(2))
        return
    for first in (2, 5):
        if card.text(first):
            if card.real(first + 2):
                raise card.error("prescribes a displacement. Allowed is zero, which holds.")
            node = card.whole(first)
            mesh.place(node, card.line)
            mesh.hold(node, card.directions(first + 1))


def _relate(mesh: Mesh, card: Fields) -> None:
    terms = []
    places = [k + 16 * m for m in range(len(card) // 16 + 1) for k in _TERMS]
    for k in places:
        if card.text(k):
            (direction,) = card.directions(k + 1) or (0,)
            node = card.whole(k)
            mesh.place(node, card.line)
            size = mesh.units.length_m if direction > 2 else 1.0
            term = {"node": node, "direction": DIRECTIONS[direction]}
            terms.append(term | {"factor": size * card.real(k + 2)})
    mesh.constraints.append({"terms": terms})


def _tie(
    mesh: Mesh, card: Fields, leading: str, directions: tuple[int, ...], following: list[str]
) -> None:
    """Let points follow another as on a rigid body, in all or some of their directions."""
    mesh.place(leading, card.line)
    for node in following:
        mesh.place(node, card.line)
        if directions == ALL:
            mesh.links.append({"leading": leading, "following": node})
            continue
        arm = [b - a for a, b in zip(mesh.nodes[leading], mesh.nodes[node], strict=True)]
        for k in directions:
            terms = [(node, k, 1.0), (leading, k, -1.0)]
            if k < 3:
                # Displacement by a rotation is its cross product with the arm.
                left, right = (k + 1) % 3, (k + 2) % 3
                terms += [(leading, 3 + left, -arm[right]), (leading, 3 + right, arm[left])]
            mesh.constraints.append(
                {
                    "terms": [
                        {"node": n, "direction": DIRECTIONS[d], "factor": factor}
                        for n, d, factor in terms
                        if factor
                    ]
                }
            )


def _add_bar(mesh: Mesh, card: Fields) -> None:
    ends = card.whole(2), card.whole(3)
    lead_a, lead_b = card.directions(4), card.directions(5)
    if lead_a == ALL and not lead_b:
        leading, following, moved = ends[0], ends[1], card.directions(7) or ALL
    elif lead_b == ALL and not lead_a:
        leading, following, moved = ends[1], ends[0], card.directions(6) or ALL
    else:
        raise card.error(
            "has independent components at both points. Allowed are 123456 at one of them."
        )
    _tie(mesh, card, leading, moved, [following])
