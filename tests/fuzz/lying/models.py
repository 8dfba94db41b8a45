"""Model, problem, mesh, matrix and mode files that lie."""

import functools
import gzip
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io
from scipy import sparse

from .cases import Case

Maker = Callable[[Path], None]
GOLDEN = Path(__file__).parents[3] / "schemas/golden"
ROWS = 30
FAR = 1_900_000_000
"""Rows that a file of a few lines states: 15 GB of row starts."""
UNPACKED = 900_000_000

ALIASES = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 9)
)
LIES: dict[str, str] = {
    "aliases": ALIASES,
    "levels": "a: " + "[" * 100_000,
    "tables": "{a: " * 50_000,
    "dashes": "- " * 100_000,
    "digits": "a: " + "9" * 401 + "\n",
    "many_digits": "a: " + "9" * 1_000_000 + "\n",
    "infinity": "a: 1e400\n",
    "values": "a: [" + "1," * 1_900_000 + "1]\n",
    "lists": "a: [" + "[]," * 1_000_000 + "[]]\n",
    "keys": "{" + ", ".join(f"k{n}: 1" for n in range(600_000)) + "}",
    "key_twice": "{" + ", ".join(f"k{n}: 1" for n in range(90_000)) + ", k1: 2}",
    "long_text": "a: " + "x" * 4_000_000 + "\n",
    "anchors": "".join(f"a{n}: &b{n} 1\n" for n in range(100_000)),
    "syntax_at_the_end": "a: [" + "1, " * 90_000 + "}\n",
    "large": "a: 1\n" * 2_000_000,
    "wrong_items": "nodes: [" + "1," * 450_000 + "1]\n",
    "empty_items": "inputs: [" + "{}," * 150_000 + "{}]\n",
}  # fmt: skip
"""What a text document can lie about."""

MODEL = """slowtime_model: 1
name: rig
nodes: [{id: m1, mass_kg: 1.9}]
elements: [{id: k1, between: [base, m1], stiffness_n_per_m: 4.0e3, damping_n_s_per_m: 2.0}]
initial: [{node: m1, velocity_m_per_s: 0.1}]
sensors: [{channel: a, quantity: acceleration, node: m1, unit: m/s^2}]
"""
PROBLEM = """slowtime_reliability: 1
inputs: {r: {marginal: normal, mean: 10, sd: 1}, s: {marginal: normal, mean: 5, sd: 1}}
limit_state: r - s
"""
FORMULAS: dict[str, str] = {
    "digits": "r - " + "9" * 401,
    "infinity": "r - 1e400",
    "powers": "r - 9**9**9**9",
    "brackets": "(" * 1900 + "r" + ")" * 1900,
    "signs": "-" * 3900 + "r",
    "sum": "r" + "+r" * 1900,
    "calls": "sqrt(" * 700 + "r" + ")" * 700,
    "code": "().__class__.__bases__[0].__subclasses__()",
    "comprehension": "[x for x in range(10**9)]",
    "text": "'a' * 10**10",
    "shift": "1 << 10**10",
    "factorial": "factorial(10**9)",
    "minima": "min(" + ", ".join(["r"] * 1500) + ")",
    "soft_keyword": "1if r else 2",
    "long": "r - " + "1 + " * 5000 + "1",
}

HARMLESS = frozenset(("continuations", "tabs", "digits_behind_a_field", "blanks"))
"""Lies that are read as what they are: infinite, repeated or blank."""


@functools.cache
def text(content: str) -> Maker:
    def write(path: Path) -> None:
        path.write_text(content)

    return write


def _texts(kind: str, file: str, honest: str, command: tuple[str, ...]) -> list[Case]:
    makers = {name: text(content) for name, content in LIES.items()}
    return [
        Case(f"{kind}_of_{name}", file, text(honest), maker, command)
        for name, maker in makers.items()
    ]


def _formulas() -> list[Case]:
    command = ("reliability", "{file}", "--method", "form")
    return [
        Case(
            f"formula_of_{name}", "p.yaml", text(PROBLEM),
            text(PROBLEM.replace("r - s", json.dumps(formula))), command, name in HARMLESS,
        )
        for name, formula in FORMULAS.items()
    ]  # fmt: skip


def _json_lies() -> list[Case]:
    """Lies of JSON, in a file of features."""
    lies = {
        "levels": "[" * 200_000 + "]" * 200_000,
        "tables": '{"a":' * 50_000 + "1" + "}" * 50_000,
        "digits": '{"epochs": %s}' % ("9" * 5000),
        "some_digits": '{"epochs": [%s]}' % ("9" * 401),
        "infinity": '{"epochs": [{"t": 1e400}]}',
        "key_twice": '{"epochs": [], "epochs": [1]}',
        "quotes": '{"' * 2_000_000,
        "escapes": '"' + "\\" * 4_000_001,
    }
    command = ("twin", "evolve", "{file}", "--nominal-hz", "5", "--setting", "learn_epochs=2")
    return [
        Case(f"json_of_{name}", "modes.json", _modes, text(lie), command)
        for name, lie in lies.items()
    ]


def _modes(path: Path) -> None:
    epochs = [
        {
            "start_s": 60.0 * k,
            "end_s": 60.0 * (k + 1),
            "modes": [
                {
                    "frequency_hz": {"value": 5.0, "sd": 0.01},
                    "damping_ratio": {"value": 0.01, "sd": 0.001},
                    "correlation": 0.0,
                    "flags": [],
                }
            ],
        }
        for k in range(4)
    ]
    path.write_text(json.dumps({"epochs": epochs}))


# Meshes


MESH = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
*ELEMENT, TYPE=B31, ELSET=BEAMS
1, 1, 2
*MATERIAL, NAME=STEEL
*ELASTIC
2.1E11, 0.3
*DENSITY
7850.
*BEAM SECTION, ELSET=BEAMS, MATERIAL=STEEL, SECTION=RECT
0.01, 0.02
0., 0., 1.
*NSET, NSET=ENDS
1
*BOUNDARY
ENDS, ENCASTRE
"""
BULK = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
CBAR,1,1,1,2,0.,0.,1.
PBAR,1,1,1.-4,1.-8,1.-8,1.-8
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123456,1
ENDDATA
"""
ABAQUS = {
    "generated_range": MESH.replace("*NSET, NSET=ENDS\n1", "*NSET, NSET=ENDS, GENERATE\n1, 2000000000"),
    "wide_range": MESH.replace("*NSET, NSET=ENDS\n1", f"*NSET, NSET=ENDS, GENERATE\n1, {'9' * 300}"),
    "sets_within_sets": MESH.replace("*NSET, NSET=ENDS\n1", "*NSET, NSET=ENDS\n1\n" + "*NSET, NSET=ENDS\nENDS, ENDS, ENDS\n" * 30),
    "long_keyword": "*NODE,\n" + "a,\n" * 1_000_000,
    "many_terms": MESH + "*EQUATION\n2000000000\n1, 1, 1.\n",
    "many_directions": MESH.replace("ENDS, ENCASTRE", "1, 1, 2000000000"),
    "include": MESH + "*INCLUDE, INPUT=/etc/passwd\n",
    "node_file": "*NODE, INPUT=/etc/passwd\n" + MESH,
}  # fmt: skip
NASTRAN = {
    "range": BULK.replace("SPC1,1,123456,1", "SPC1,1,123456,1,THRU,2000000000"),
    "wide_range": BULK.replace("SPC1,1,123456,1", f"SPC1,1,123456,1,THRU,{'9' * 300}"),
    "digits": BULK.replace("GRID,2", f"GRID,{'9' * 5000}"),
    "tabs": BULK + "\t" * 20_000_000 + "\n",
    "include": BULK.replace("ENDDATA", "INCLUDE '/etc/passwd'\nENDDATA"),
    "continuations": BULK + "SPC1,1,123456,1\n" + "+,1,1,1,1\n" * 400_000,
}


def _meshes() -> list[Case]:
    command = ("model", "convert", "{file}", "--out", "m.yaml")
    return [
        Case(f"abaqus_of_{name}", "m.inp", text(MESH), text(lie), command, name in HARMLESS)
        for name, lie in ABAQUS.items()
    ] + [
        Case(f"nastran_of_{name}", "m.bdf", text(BULK), text(lie), command, name in HARMLESS)
        for name, lie in NASTRAN.items()
    ]


# Matrices


def stiffness() -> sparse.coo_array:
    chain = 2.0 * np.eye(ROWS) - np.eye(ROWS, k=1) - np.eye(ROWS, k=-1)
    return sparse.coo_array(chain)


MATRICES = """slowtime_model: 2
name: rods
matrices:
  stiffness: {file: %(file)s}
  mass: {file: m.mtx}
"""


@functools.cache
def matrix(ending: str, write: Maker) -> Maker:
    """Write a model of two matrices, the first one as a maker does."""

    def made(path: Path) -> None:
        name = f"k{ending}"
        scipy.io.mmwrite(path.with_name("m.mtx"), sparse.eye_array(ROWS))
        write(path.with_name(name))
        path.write_text(MATRICES % {"file": name})

    return made


def mtx(path: Path) -> None:
    scipy.io.mmwrite(path, stiffness())


def mtx_of_more_rows(path: Path) -> None:
    path.write_text(f"%%MatrixMarket matrix coordinate real general\n{FAR} {FAR} 1\n1 1 2.0\n")


def mtx_of_more_entries(path: Path) -> None:
    path.write_text(f"%%MatrixMarket matrix coordinate real general\n30 30 {FAR}\n1 1 2.0\n")


def mtx_of_a_dense_matrix(path: Path) -> None:
    path.write_text("%%MatrixMarket matrix array real general\n40000 40000\n1.0\n")


def mtx_gz(path: Path) -> None:
    buffer = io.BytesIO()
    scipy.io.mmwrite(buffer, stiffness())
    path.write_bytes(gzip.compress(buffer.getvalue()))


def mtx_gz_of_blanks(path: Path) -> None:
    head = b"%%MatrixMarket matrix coordinate real general\n30 30 1\n"
    with gzip.open(path, "wb") as file:
        file.write(head)
        for _ in range(UNPACKED // (1 << 24)):
            file.write(b" " * (1 << 24))


def npz(path: Path) -> None:
    sparse.save_npz(path, sparse.csr_matrix(stiffness()))


def npz_of_more_rows(path: Path) -> None:
    np.savez(
        path, row=np.array([0]), col=np.array([0]), data=np.array([1.0]),
        shape=np.array([FAR, FAR]), format=np.array("coo"),
    )  # fmt: skip


def npz_of_zeros(path: Path) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("data.npy", "w") as member,
    ):
        head = (
            f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({UNPACKED // 8},), }}".ljust(
                117
            )
            + "\n"
        )
        member.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())
        for _ in range(UNPACKED >> 24):
            member.write(bytes(1 << 24))


def mat(path: Path) -> None:
    scipy.io.savemat(path, {"K": sparse.csc_matrix(stiffness())}, do_compression=True)


def _mat_element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def _mat(path: Path, inner: bytes) -> None:
    packed = zlib.compress(struct.pack("<II", 14, len(inner)) + inner, 9)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def mat_of_zeros(path: Path) -> None:
    size = UNPACKED // 12
    flags = _mat_element(6, struct.pack("<II", 6, 0))
    _mat(
        path,
        flags + _mat_element(5, struct.pack("<2i", size, 1)) + _mat_element(1, b"K")
        + struct.pack("<II", 1, size) + bytes(size),
    )  # fmt: skip


def mat_of_nested_cells(path: Path) -> None:
    inner = b""
    while len(inner) < 1_000_000:
        inner = (
            _mat_element(6, struct.pack("<II", 1, 0)) + _mat_element(5, struct.pack("<2i", 1, 1))
            + _mat_element(1, b"K") + (struct.pack("<II", 14, len(inner)) + inner if inner else b"")
        )  # fmt: skip
    _mat(path, inner)


def hdf5(path: Path) -> None:
    import h5py

    csr = sparse.csr_matrix(stiffness())
    with h5py.File(path, "w") as file:
        group = file.create_group("K")
        group.attrs["shape"] = csr.shape
        for name in ("data", "indices", "indptr"):
            group[name] = getattr(csr, name)


def hdf5_of_more_rows(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        group = file.create_group("K")
        group.attrs["shape"] = (FAR, FAR)
        group["row"], group["col"], group["data"] = [0], [0], [1.0]


def hdf5_of_zeros(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset(
            "K", shape=(10_000, 10_000), dtype="f8", chunks=(1000, 1000), compression="gzip"
        )


def hdf5_with_external_storage(path: Path) -> None:
    import h5py

    np.eye(ROWS).tofile(path.with_name("secret.bin"))
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "K", shape=(ROWS, ROWS), dtype="f8", external=[("secret.bin", 0, 8 * ROWS**2)]
        )


def hdf5_with_an_external_link(path: Path) -> None:
    import h5py

    with h5py.File(path.with_name("other.h5"), "w") as file:
        file["K"] = np.eye(ROWS)
    with h5py.File(path, "w") as file:
        file["K"] = h5py.ExternalLink("other.h5", "/K")


def harwell(path: Path) -> None:
    scipy.io.hb_write(path, sparse.csc_array(stiffness()))


def harwell_of_more_rows(path: Path) -> None:
    harwell(path)
    lines = path.read_text().splitlines()
    kind = lines[2].split()
    lines[2] = f"{kind[0]:<14}{FAR:>14}{FAR:>14}{FAR:>14}{0:>14}"
    path.write_text("\n".join(lines) + "\n")


def calculix(path: Path) -> None:
    whole = stiffness()
    rows = zip(whole.row, whole.col, whole.data, strict=True)
    path.write_text("".join(f"{r + 1} {c + 1} {v}\n" for r, c, v in rows))


def calculix_of_far_rows(path: Path) -> None:
    path.write_text(f"1 1 2.0\n{FAR} {FAR} 2.0\n")


def calculix_of_infinite_rows(path: Path) -> None:
    path.write_text("1 1 2.0\n1e300 1e300 2.0\n")


def calculix_of_digits(path: Path) -> None:
    path.write_text(f"1 1 {'9' * 1_000_000}\n")


def output4(path: Path) -> None:
    from slowtime_services.matrices.nastran_output4_writing import write_output4

    write_output4(path, {"K": sparse.csr_array(stiffness())})


def output4_of_more_rows(path: Path) -> None:
    head = struct.pack("<4i", FAR, -FAR, 2, 2) + b"K       "
    column = struct.pack("<3i", 1, 0, 4) + struct.pack("<2i", 3, 1) + struct.pack("<d", 1.0)
    end = struct.pack("<3id", FAR + 1, 1, 2, 1.0)
    path.write_bytes(
        b"".join(
            struct.pack("<i", len(r)) + r + struct.pack("<i", len(r))
            for r in (head, column, end)
        )
    )


def output4_of_more_numbers(path: Path) -> None:
    path.write_text(
        f"{30:>8}{30:>8}{2:>8}{2:>8}K       1P,3E23.16\n{1:>8}{1:>8}{99_999_999:>8}\n 1.0\n"
    )


def dmig(path: Path) -> None:
    path.write_text(
        "DMIG,K,0,6,2,0\n" + "".join(f"DMIG,K,{n},1,,{n},1,2.\n" for n in range(1, ROWS + 1))
    )


def dmig_of_digits(path: Path) -> None:
    path.write_text(f"DMIG,K,0,6,2,0\nDMIG,K,{'9' * 5000},1,,{'9' * 5000},1,2.\n")


def _matrix_cases() -> list[Case]:
    kinds: dict[str, tuple[Maker, tuple[Maker, ...]]] = {
        ".mtx": (mtx, (mtx_of_more_rows, mtx_of_more_entries, mtx_of_a_dense_matrix)),
        ".mtx.gz": (mtx_gz, (mtx_gz_of_blanks,)),
        ".npz": (npz, (npz_of_more_rows, npz_of_zeros)),
        ".mat": (mat, (mat_of_zeros, mat_of_nested_cells)),
        ".h5": (
            hdf5,
            (
                hdf5_of_more_rows,
                hdf5_of_zeros,
                hdf5_with_external_storage,
                hdf5_with_an_external_link,
            ),
        ),
        ".hb": (harwell, (harwell_of_more_rows,)),
        ".sti": (
            calculix,
            (calculix_of_far_rows, calculix_of_infinite_rows, calculix_of_digits),
        ),
        ".op4": (output4, (output4_of_more_rows, output4_of_more_numbers)),
        ".pch": (dmig, (dmig_of_digits,)),
    }
    command = ("model", "reduce", "{file}", "--modes", "2", "--out", "r.npz")
    return [
        Case(
            f"matrix_{lie.__name__}",
            "model.yaml",
            matrix(ending, honest),
            matrix(ending, lie),
            command,
        )
        for ending, (honest, lies) in kinds.items()
        for lie in lies
    ]


# Modes


def _universal(lines: list[str]) -> str:
    return "\n".join(["    -1", *lines, "    -1"]) + "\n"


SHAPES = _universal(
    ["    55", "a", "b", "c", "d", "e"]
    + [
        "".join(f"{n:>10}" for n in (1, 2, 3, 12, 2, 3)),
        "".join(f"{n:>10}" for n in (2, 4, 1, 1)),
    ]
    + ["".join(f"{v:>13.5e}" for v in (5.0, 1.0, 0.01, 0.0))]
    + [
        row
        for node in range(1, 4)
        for row in (f"{node:>10}", "".join(f"{v:>13.5e}" for v in (0.1, 0.2, 0.3)))
    ]
)
UNIVERSAL = {
    "more_parameters": SHAPES.replace(
        f"{2:>10}{4:>10}{1:>10}{1:>10}", f"{2:>10}{999999999:>10}{1:>10}{1:>10}"
    ),
    "more_values": SHAPES.replace(f"{2:>10}{3:>10}\n", f"{2:>10}{999999999:>10}\n"),
    "digits": SHAPES.replace("5.00000e+00", "9" * 4000),
    "marks": "    -1\n    -1\n" * 500_000,
    "traces": SHAPES + _universal(["    82", f"{1:>10}{2000000000:>10}{1:>10}", "t", "1 2 0"]),
}


def _modal() -> list[Case]:
    beside = ("--rate-hz", "100", "--method", "modes", "--out", "o.uff")
    lies = {
        ("modes", "--model", "m.uff", SHAPES): UNIVERSAL,
        ("geometry", "--geometry", "g.csv", PLACES): GEOMETRIES,
        ("nodes", "--geometry", "g.uff", NODES): NODE_FILES,
    }
    return [
        Case(
            f"{kind}_of_{name}", file, _beside_a_record(honest), _beside_a_record(lie),
            ("identify", "r.csv", option, "{file}", *beside), name in HARMLESS,
        )
        for (kind, option, file, honest), some in lies.items()
        for name, lie in some.items()
    ]  # fmt: skip


@functools.cache
def _beside_a_record(content: str) -> Maker:
    """Write a file, and a record of two channels in its folder."""

    def write(path: Path) -> None:
        noise = np.random.default_rng(3).normal(size=(600, 2))
        rows = "".join(f"{a:.4f},{b:.4f}\n" for a, b in np.cumsum(noise, axis=0) * 0.1)
        path.with_name("r.csv").write_text("a,b\n" + rows)
        path.write_text(content)

    return write


def _results() -> list[Case]:
    """Files that a command has written, read again by another one."""
    honest = json.loads((GOLDEN / "modes_file/v1.json").read_text())
    whole = json.dumps(honest)
    lies = {
        "levels": "[" * 200_000 + "]" * 200_000,
        "digits": whole.replace('"slowtime_modes": 1', f'"slowtime_modes": {"9" * 5000}'),
        "some_digits": json.dumps(honest | {"rate_hz": "@"}).replace('"@"', "9" * 401),
        "infinity": json.dumps(honest | {"rate_hz": "@"}).replace('"@"', "1e400"),
        "no_number": json.dumps(honest | {"rate_hz": "@"}).replace('"@"', "NaN"),
        "wrong_type": json.dumps(honest | {"modes": {"a": 1}}),
        "wrong_items": json.dumps(honest | {"modes": [1] * 400_000}),
        "empty_items": json.dumps(honest | {"modes": [{}] * 400_000}),
        "long_shapes": json.dumps(honest | {"channels": ["x"] * 1_000_000}),
        "key_twice": whole[:-1] + ', "slowtime_modes": 1}',
    }
    tables = {
        "digits": HISTORY + "9" * 5_000_000 + ",1,2\n",
        "columns": ",".join(f"a{k}" for k in range(300_000)) + "\n" + HISTORY,
        "one_field": HISTORY + '"' + "1," * 3_000_000,
        "blanks": HISTORY + " " * 20_000_000,
    }
    merge = ("modes", "merge", "{file}", "{file}", "--out", "o.json")
    return [
        Case(f"result_of_{name}", "m.json", text(whole), text(lie), merge)
        for name, lie in lies.items()
    ] + [
        Case(
            f"table_of_{name}", "t.csv", text(HISTORY), text(lie),
            ("surrogate", "{file}", "--output", "y", "--kind", "chaos"), name in HARMLESS,
        )
        for name, lie in tables.items()
    ]  # fmt: skip


PLACES = "channel,x,y,z,direction,node\na,0,0,0,+X,1\nb,0,0,1,+X,2\n"
GEOMETRIES = {
    "infinity": PLACES.replace("0,0,1", "0,0,1e400"),
    "no_number": PLACES.replace("0,0,1", "0,0,nan"),
    "digits": PLACES.replace("+X,2", f"+X,{'9' * 5000}"),
    "rows": PLACES + "".join(f"c{k},{k},0,0,+X,\n" for k in range(200_000)),
    "rows_at_one_place": PLACES + "c,0,0,0,+X,\n" * 300_000,
    "one_field": PLACES + '"' + "1," * 1_500_000,
    "columns": "channel,x,y,z" + ",a" * 400_000 + "\n" + "a,0,0,0\n" * 3,
}
NODES = _universal(
    [
        "  2411",
        *(
            "".join(f"{n:>10}" for n in (node, 1, 1, 11)) + "\n" + f"{node:>25.16E}" * 3
            for node in (1, 2)
        ),
    ]
)
NODE_FILES = {
    "digits_behind_a_field": NODES.replace(f"{2:>10}", "9" * 5000),
    "infinity": NODES.replace("2.0000000000000000E+00", "2.000000000000000E+400"),
    "marks": "    -1\n    -1\n" * 500_000,
    "half_a_dataset": NODES + "    -1\n  2411\n" + "1 " * 2_000_000,
}
HISTORY = "x,y\n" + "".join(f"{k},{k * k}\n" for k in range(12))

CASES: list[Case] = [
    *_texts("model", "m.yaml", MODEL, ("simulate", "--model", "{file}", "--duration", "5", "--rate-hz", "100", "--out", "o.npz")),
    *_texts("problem", "p.yaml", PROBLEM, ("reliability", "{file}", "--method", "form")),
    *_texts(
        "composite", "c.yaml", "members: [demo.tower]\n",
        ("twin", "composite", "add", "{file}", "--id", "demo.yard", "--server", "http://127.0.0.1:9"),
    ),
    *_formulas(),
    *_json_lies(),
    *_meshes(),
    *_matrix_cases(),
    *_modal(),
    *_results(),
]  # fmt: skip
