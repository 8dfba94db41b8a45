"""Generate hidden cases, diagnose them, score the answers: ``python -m tests.blind run``."""

import argparse
import json
import sys
from pathlib import Path

from .adjudicate import adjudicate
from .design import GROUPS
from .loop import close_loop, generate_pairs, tabulate_pairs
from .peers import PEERS, peer
from .running import Trial, diagnose, generate, run_all, score
from .tables import beside, leaves, tabulate, text_of


def main(words: list[str] | None = None) -> int:
    """Run one verb."""
    given = _parser().parse_args(words)
    out: Path = given.out
    trial = (
        peer(given.peer, given.timeout)
        if given.peer
        else diagnose(given.command, given.timeout)
    )
    if given.verb == "pairs":
        _pairs(out, given.cases, given.seed, trial)
        return 0
    if given.verb in ("generate", "run"):
        generate(out, given.cases, given.seed, given.jobs, given.group)
    if given.verb == "run":
        run_all(out, trial, given.jobs, given.again)
    if given.verb in ("run", "score"):
        if given.adjudicate:
            adjudicate(out, trial.name)
        rows = score(out, trial.name)
        tables = tabulate(rows)
        text = text_of(tables, trial.name)
        (out / f"{trial.name}.json").write_text(
            json.dumps({"tables": tables, "rows": rows}, indent=1)
        )
        (out / f"{trial.name}.txt").write_text(text)
        print(text)
        print(_compared(out))
    return 0


def _compared(out: Path) -> str:
    """Put all tools that were scored on these cases beside each other, ours first."""
    scored = [path for path in sorted(out.glob("*.json")) if not path.stem.endswith("-pairs")]
    scored.sort(key=lambda path: path.stem != "slowtime")
    told = {path.stem: json.loads(path.read_text())["tables"] for path in scored}
    text = beside(told)
    (out / "beside.txt").write_text(text)
    return text


def _pairs(out: Path, count: int, seed: int, trial: Trial) -> None:
    """Close the loop on cases of equivalent pairs."""
    rows = []
    for name in generate_pairs(out, count, seed):
        rows.append(close_loop(out, name, trial))
        told = {key: rows[-1][key] for key in ("pair", "verdict", "after", "decided")}
        print(json.dumps(told), flush=True)
    tables = tabulate_pairs(rows)
    (out / f"{trial.name}-pairs.json").write_text(
        json.dumps({"tables": tables, "rows": rows}, indent=1)
    )
    print("\n".join(["6. Cannot decide, and the experiment that would", *leaves(tables, 3)]))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind", description=__doc__)
    parser.add_argument("verb", choices=["generate", "run", "score", "pairs"])
    parser.add_argument(
        "--out", type=Path, default=Path("var/blind"), help="folder of the battery"
    )
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--group", choices=GROUPS, help="only cases of one group")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a case")
    parser.add_argument("--command", help="run instead of `slowtime diagnose`")
    parser.add_argument("--peer", choices=sorted(PEERS), help="run another tool instead")
    parser.add_argument("--again", action="store_true", help="also where there is a result")
    parser.add_argument(
        "--adjudicate", action=argparse.BooleanOptionalAction, default=True,
        help="find out whether what was left undecided could not have been decided",
    )  # fmt: skip
    return parser


if __name__ == "__main__":
    sys.exit(main())
