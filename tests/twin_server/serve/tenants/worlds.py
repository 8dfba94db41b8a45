"""The same scenario of one site, alone on the server and beside another site's."""

import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .house import Answer, House
from .scenario import Tenant
from .sweep import sweep

Play = Callable[[Tenant], Iterator[None]]
"""A scenario, step by step."""


class Root:
    """An admin of all sites, who joins what the other site has with what this one has."""

    def __init__(self, house: House, secret: str) -> None:
        self.house, self.secret, self.turn = house, secret, 0

    def act(self) -> None:
        """Try everything again, whatever is there by now; some of it succeeds each time."""
        self.turn += 1
        city = {"name": f"{self.secret} {self.turn}", "members": ["plant.beam", "lab.beam"]}
        for members in ([], ["lab.line"], ["lab.yard"]):
            wanted = city | {"members": [*city["members"], *members]}
            self.ask("PUT", "/composites/plant.city", json=wanted)
        self.ask("PUT", f"/composites/plant.{self.secret}", json={"members": ["lab.beam"]})

    def fill_folder(self, content: bytes) -> None:
        """Put files of the other site and of nobody beside those of this one."""
        kept = self.house.home / "kept"
        kept.mkdir()
        for name in ("monday.mcap", "unknown.mcap", f"{self.secret}.mcap"):
            (kept / name).write_bytes(content)
        (kept / "broken.mcap").write_bytes(b"broken")
        (kept / "foreign.mcap").write_bytes(b"broken")

    def ask(self, method: str, path: str, **more: Any) -> None:
        """Ask with the token of all sites."""
        assert self.house.ask("*", "admin", method, path, **more).status_code < 500


class Worlds:
    """Answers to one site, alone and beside another whose secret is in all that it has."""

    def __init__(self, home: Path, play: Play, *, swept: bool) -> None:
        self.secret = f"zq{secrets.token_hex(12)}"
        with House(_made(home / "alone")) as house:
            self.document = house.document
            self.alone = _answers(house, play, iter(()), None)
            if swept:
                self.alone += sweep(Tenant(house, "lab"), house.document)
        with House(_made(home / "beside")) as house:
            other = Tenant(house, "plant", self.secret)
            root = Root(house, self.secret)
            root.fill_folder(other.recorded("rig"))
            self.beside = _answers(house, play, play(other), root)
            self.of_other = other.answers
            if swept:
                self.beside += sweep(Tenant(house, "lab"), house.document)


def _made(path: Path) -> Path:
    path.mkdir()
    return path


def _answers(
    house: House, play: Play, before: Iterator[None], root: Root | None
) -> list[Answer]:
    """Run the scenario of `lab`, each step after one of `before` and what `root` does."""
    lab = Tenant(house, "lab")
    house.set_step(0)
    for number, _ in enumerate(play(lab), start=1):
        house.set_step(number)
        next(before, None)
        if root is not None:
            root.act()
    return lab.answers
