"""A model file → the members and connections that may lose stiffness."""

import dataclasses
from collections.abc import Iterator

from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.frame import Beam, Direction, Frame
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime_schemas.files.finite_elements import FrameModel
from slowtime_services.matrices import MatrixFileError, MatrixModel
from slowtime_services.matrices.frame_model import frame_of

BENDING: tuple[Direction, ...] = ("ry", "rz")
"""Rotations about the local axes that a loose end of a beam passes no moment in."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Members:
    """Members and connections whose stiffness is assessed.

    Parameters
    ----------
    matrices
        The model, with the stiffness of each as a part.
    kinds
        Name → `member` or `connection`.
    """

    matrices: ParametricMatrices
    kinds: dict[str, str]


def members_of(model: MatrixModel, *, ends: bool = False) -> Members:
    """List what may lose stiffness: parameters of the stiffness, and ends of beams if wanted.

    Parameters
    ----------
    model
        The model. Parameters of springs alone are connections, all others members; those of
        the mass are left out.
    ends
        Whether the ends of beams may come loose. The part of such an end is the stiffness that
        its beam loses by a hinge there about both axes of bending: a spring in the joint leaves
        a share of it.

    Returns
    -------
    The members.

    Raises
    ------
    MatrixFileError
        Where no parameter acts on the stiffness, or matrices of files should have ends.
    """
    matrices = model.matrices
    named = zip(matrices.names, matrices.stiffness_parts, strict=True)
    parts = {name: part for name, part in named if part is not None}
    if not parts:
        raise MatrixFileError(
            f"{model.name} has no parameter of the stiffness. List under `parameters` each "
            "member that may change, or each group of them."
        )
    section = model.file.frame
    springs = set() if section is None else _of_springs(section)
    kinds = {name: "connection" if name in springs else "member" for name in parts}
    if ends:
        if section is None:
            raise MatrixFileError(
                f"{model.name} is given by matrices, which do not say where beams end. Give a "
                "`frame`, or a parameter for each connection."
            )
        loose = dict(_loose_ends(frame_of(section), matrices.stiffness))
        parts |= loose
        kinds |= dict.fromkeys(loose, "connection")
    own = dataclasses.replace(
        matrices,
        names=tuple(parts),
        stiffness_parts=tuple(parts.values()),
        mass_parts=(None,) * len(parts),
    )
    return Members(matrices=own, kinds=kinds)


def _of_springs(section: FrameModel) -> set[str]:
    """Parameters that scale springs and nothing else."""
    found = set()
    for one in section.parameters:
        own = [e for e in section.elements if e.group in one.groups or e.id in one.elements]
        shells = any(shell.group in one.groups for shell in section.shells)
        if own and not shells and all(element.kind == "spring" for element in own):
            found.add(one.name)
    return found


def _loose_ends(
    frame: Frame, stiffness: sparse.csr_array
) -> Iterator[tuple[str, sparse.csr_array]]:
    """Yield the ends of beams that have no hinge, and the stiffness that each loses by one."""
    for k, beam in enumerate(frame.beams):
        for end in (0, 1):
            if set(beam.released[end]) & set(BENDING):
                continue
            hinged = _hinged(beam, end)
            beams = (*frame.beams[:k], hinged, *frame.beams[k + 1 :])
            other = assemble(dataclasses.replace(frame, beams=beams)).stiffness
            # An end that alone holds the rotations of its node would leave a mechanism.
            if other.shape == stiffness.shape:
                lost = sparse.csr_array(stiffness - other)
                yield f"end of {beam.name} at {beam.ends[end]}", lost


def _hinged(beam: Beam, end: int) -> Beam:
    released = list(beam.released)
    released[end] = (*released[end], *BENDING)
    return dataclasses.replace(beam, released=(released[0], released[1]))
