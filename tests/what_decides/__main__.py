"""Run the ablation of batteries; print the table."""

import argparse
import json
import time
from pathlib import Path

from . import __doc__ as what
from .ablation import Ablation, Diagnosed
from .cases import cases_of, histories
from .table import table

PAGE = """\
# What decides a diagnosis

For those who change the diagnosis: which steps, guards and thresholds an answer depends on. An
answer is a verdict with the names and places of effects, and what is left undecided; numbers of
parameters and notes are not compared. Written by
`python -m tests.what_decides --page docs/what_decides.md`
([how](testing.md#what-decides-a-diagnosis)).

- *Acts in*: cases in which a step changes anything at all. *Decides in*: cases in which the
  answer differs without it.
- A threshold is halved and doubled; of a probability above one half, the distance from one. One
  that is not listed gives the same answers at half and at double its value in each of these
  cases, which says nothing of cases in which its step does not act.

{table}
"""


def main() -> int:
    """Ablate case after case, until all are done or the time is over."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.what_decides", description=what,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--battery", type=Path, action="append", default=[])
    parser.add_argument(
        "--histories", type=int, default=0, metavar="N", help="hidden histories of each group"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the histories")
    parser.add_argument("--out", type=Path, default=Path("var/what_decides"))
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--cases", type=int, default=1000, help="of each battery, at most")
    parser.add_argument(
        "--part", type=int, nargs=2, default=(0, 1), metavar=("I", "N"),
        help="every N-th case from the I-th on: one process for each part",
    )  # fmt: skip
    parser.add_argument(
        "--steps-only", action="store_true", help="leave thresholds as they are"
    )
    parser.add_argument("--page", type=Path, help="write the table to this page, too")
    given = parser.parse_args()
    until_s = time.monotonic() + 3600 * given.hours
    cases: list[Diagnosed] = []
    for folder in given.battery:
        cases += [*cases_of(folder)][: given.cases]
    cases += histories(given.histories, given.seed)
    first, step = given.part
    for case in cases[first::step]:
        ablation = Ablation(
            case, given.out / f"{case.name}.json", lambda: time.monotonic() < until_s
        )
        try:
            ablation.run(thresholds=not given.steps_only)
        except TimeoutError:
            break
        print(f"{case.name}: {len(ablation.known['without'])} without", flush=True)
    text = table(json.loads(path.read_text()) for path in sorted(given.out.glob("*.json")))
    print(text)
    if given.page is not None:
        given.page.write_text(PAGE.format(table=text))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
