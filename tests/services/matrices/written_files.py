"""Matrix files and maps as other programs write them, for the tests of their readers."""

import csv

from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS
from slowtime_services.matrices.dof_tables import COLUMNS, PLACES


def write_dof_map(path, dofs):
    """Write a map of degrees of freedom as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *PLACES])
        for node, direction in zip(dofs.node.tolist(), dofs.direction.tolist(), strict=True):
            place = [repr(value) for value in dofs.coordinates[node].tolist()]
            writer.writerow([dofs.node_names[node], DIRECTIONS[direction], *place])


def write_dmig(path, name, matrix, places):
    """Write a symmetric matrix as DMIG cards of large fields; a place is a node and 0 to 5."""
    lower = sparse.csc_array(sparse.tril(matrix))
    lines = [f"{'DMIG':<8}{name:<8}{0:>8}{6:>8}{2:>8}{0:>8}"]
    for column in range(lower.shape[1]):
        inside = slice(lower.indptr[column], lower.indptr[column + 1])
        if inside.start == inside.stop:
            continue
        node, direction = places[column]
        lines.append(f"{'DMIG*':<8}{name:<16}{node:>16}{direction + 1:>16}")
        for row, value in zip(lower.indices[inside], lower.data[inside], strict=True):
            node, direction = places[row]
            number = f"{value:.9E}".replace("E", "D")
            lines.append(f"{'*':<8}{node:>16}{direction + 1:>16}{number:>16}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
