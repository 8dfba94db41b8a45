"""The equations of motion of a rig and its effects, written as straight-line Python.

Every number is a literal and every sum is spelled out: twenty times faster than small arrays,
and able to be read (`System.source`). State: displacements q, velocities v, inner states z.
"""

import dataclasses
import functools
import math
import re
from collections.abc import Callable
from typing import Any

from .law import Placed
from .outside.operators import OPERATORS
from .rig import BASE, Rig
from .signals import Signal

Function = Callable[..., Any]


@dataclasses.dataclass(frozen=True, eq=False)
class System:
    """A rig with its effects under its excitations.

    Parameters
    ----------
    forces
        By index of the node [N].
    base
        Accelerations of the base, measured or not, which add up.
    campaign_s
        Time of the campaign at which the excitations begin.
    """

    rig: Rig
    effects: tuple[Placed, ...]
    forces: dict[int, Signal]
    base: tuple[Signal, ...]
    campaign_s: float = 0.0

    @property
    def states(self) -> int:
        """How many: two a mass, and those within effects."""
        inner = [2 if _is_body(p) else len(p.law.rates) for p in self.effects]
        return 2 * self.rig.size + sum(inner)

    @functools.cached_property
    def friction(self) -> Placed | None:
        """The one effect that can stick."""
        sticking = [placed for placed in self.effects if placed.law.grip]
        if len(sticking) > 1:
            raise ValueError("Two dry frictions at once are more than this integrator knows.")
        return sticking[0] if sticking else None

    @functools.cached_property
    def rates(self) -> Function:
        """Give ``(t, mode, *state) -> rates``; mode 1 or -1 slips that way, 0 sticks."""
        return self._compiled()["rates"]  # type: ignore[no-any-return]

    @functools.cached_property
    def grip(self) -> Function:
        """Give ``(t, *state) -> speed, force that would hold, most that can hold``."""
        return self._compiled()["grip"]  # type: ignore[no-any-return]

    @functools.cached_property
    def step(self) -> Function:
        """Give one step of Dormand and Prince: ``(t, h, mode, rates0, *state)``."""
        return self._compiled()["step"]  # type: ignore[no-any-return]

    def _compiled(self) -> dict[str, Any]:
        if "_space" not in self.__dict__:
            space: dict[str, Any] = {
                name: getattr(math, name)
                for name in ("tanh", "exp", "cos", "sin", "sqrt", "copysign")
            } | OPERATORS
            for number, signal in enumerate([*self.forces.values(), *self.base]):
                space[f"C{number}"] = signal.coefficients.tolist()
            exec(compile(self.source, "<rig>", "exec"), space)
            self.__dict__["_space"] = space
        return self.__dict__["_space"]  # type: ignore[no-any-return]

    @functools.cached_property
    def source(self) -> str:
        """What is compiled."""
        n = self.rig.size
        names = [f"q{i}" for i in range(n)] + [f"v{i}" for i in range(n)]
        names += [f"z{i}" for i in range(self.states - 2 * n)]
        body, rates, held = self._body()
        state = ", ".join(names)
        lines = [f"def rates(t, mode, {state}):", *(f"    {line}" for line in body)]
        if held:
            lines += [
                "    d = mode",
                "    if mode:",
                f"        fr = mode*({held['most']})",
                "    else:",
            ]
            lines += [
                f"        fr = {held['hold']}",
                *(f"    {line}" for line in held["apply"]),
            ]
        lines += [f"    return ({', '.join(rates)},)"]
        if held:
            lines += [f"def grip(t, {state}):", *(f"    {line}" for line in body)]
            lines += [f"    hold = {held['hold']}", "    d = 1.0 if hold > 0 else -1.0"]
            lines += [f"    return {held['speed']}, hold, {held['most']}"]
            lines += _step(names)
        return "\n".join(lines) + "\n"

    def _body(self) -> tuple[list[str], list[str], dict[str, Any]]:
        rig, n = self.rig, self.rig.size
        lines = [f"T = t + {self.campaign_s!r}"]
        net: list[list[str]] = [[] for _ in range(n)]
        rate_hz = next(iter([*self.forces.values(), *self.base])).rate_hz
        lines += [f"s = t*{rate_hz!r}", "i = int(s)", "s -= i"]
        for number, node in enumerate([*self.forces, *[None] * len(self.base)]):
            lines.append(f"c3, c2, c1, c0 = C{number}[i]")
            lines.append(f"u{number} = ((c3*s + c2)*s + c1)*s + c0")
            if node is not None:
                net[node].append(f"u{number}")
        shaken = [f"u{len(self.forces) + i}" for i in range(len(self.base))]
        lines.append(f"ab = {' + '.join(shaken) or '0.0'}")
        inner: list[str] = []
        after: list[str] = []
        held: dict[str, Any] = {}
        masses = list(rig.masses)
        for element in rig.elements:
            a, b = element.first, element.second
            ends = ("" if a == BASE else f" - q{a}", "" if a == BASE else f" - v{a}")
            lines += [f"e = q{b}{ends[0]}", f"v = v{b}{ends[1]}"]
            terms = [f"{element.stiffness!r}*e + {element.damping!r}*v"]
            for placed in self.effects:
                if placed.law.where != "element" or placed.place != element.id:
                    continue
                for number in range(len(placed.law.rates)):
                    lines.append(f"h{number} = z{len(inner) + number}")
                for rate in placed.law.rates:
                    inner.append(f"r{len(inner)}")
                    lines.append(f"{inner[-1]} = {filled(rate, placed.parameters)}")
                if placed.law.force:
                    terms.append(filled(placed.law.force, placed.parameters))
                if placed.law.grip:
                    held = {"most": filled(placed.law.grip, placed.parameters), "ends": (a, b)}
                    lines += ["we = abs(v)", "ee = e"]
            name = f"F_{element.id}"
            lines.append(f"{name} = {' + '.join(terms)}")
            net[b].append(f"-{name}")
            if a != BASE:
                net[a].append(name)
        for placed in self.effects:
            if placed.law.where == "node":
                after += self._at_node(placed, lines, net, inner, masses)
        for i in range(n):
            lines.append(f"a{i} = ({' '.join(_signed(net[i]))})/{masses[i]!r} - ab")
        lines += after
        if held:
            held = _stuck(held, masses)
        rates = [f"v{i}" for i in range(n)] + [f"a{i}" for i in range(n)] + inner
        return lines, rates, held

    def _at_node(
        self,
        placed: Placed,
        lines: list[str],
        net: list[list[str]],
        inner: list[str],
        masses: list[float],
    ) -> list[str]:
        """Write a law at a node; return what has to follow the accelerations of the nodes."""
        i, p = self.rig.nodes.index(placed.place), placed.parameters
        if placed.law.name == "added_mass":
            masses[i] += p["dm_kg"]
        elif placed.law.name == "harmonic_force":
            omega = 2 * math.pi * p["frequency_hz"]
            lines.append(f"tone = {p['amplitude_n']!r}*sin({omega!r}*T + {p['phase_rad']!r})")
            net[i].append("tone")
        elif placed.law.name == "extra_dof":
            stiffness = p["mass_kg"] * (2 * math.pi * p["frequency_hz"]) ** 2
            x, y = f"z{len(inner)}", f"z{len(inner) + 1}"
            pull = f"{stiffness!r}*({x} - q{i}) + {p['damping_n_s_per_m']!r}*({y} - v{i})"
            lines += [f"pull = {pull}", f"hidden = -pull/{p['mass_kg']!r} - ab"]
            net[i].append("pull")
            inner += [y, "hidden"]
        else:
            # A body that rolls moves with the node by a part of its mass and turns by the rest.
            turning, mass = placed.law.inertia, p["mass_kg"]
            lines += [f"e = z{len(inner)}", f"v = z{len(inner) + 1}"]
            lines.append(f"pull = ({filled(placed.law.force, p)})/{1 + turning!r}")
            net[i].append("pull")
            masses[i] += mass * turning / (1 + turning)
            inner += [f"z{len(inner) + 1}", "hidden"]
            return [f"hidden = -(a{i} + ab)/{1 + turning!r} - pull/{mass!r}"]
        return []


def _is_body(placed: Placed) -> bool:
    """Whether an effect is a hidden body with a displacement and a speed of its own."""
    named = placed.law.name in ("added_mass", "harmonic_force")
    return placed.law.where == "node" and not named


def filled(text: str, parameters: dict[str, float]) -> str:
    for name in sorted(parameters, key=len, reverse=True):
        text = _replaced(text, name, f"({parameters[name]!r})")
    return text


def _replaced(text: str, name: str, by: str) -> str:
    return re.sub(rf"\b{re.escape(name)}\b", by, text)


def _signed(terms: list[str]) -> list[str]:
    return [term if term.startswith("-") else f"+ {term}" for term in terms] or ["0.0"]


def _stuck(held: dict[str, Any], masses: list[float]) -> dict[str, Any]:
    """Expressions of friction: its speed, what would hold it, and how it is felt."""
    a, b = held["ends"]
    most = _replaced(_replaced(held["most"], "w", "we"), "e", "ee")
    ease = 1.0 / masses[b] + (0.0 if a == BASE else 1.0 / masses[a])
    apply = [f"a{b} -= fr/{masses[b]!r}"]
    if a != BASE:
        apply.append(f"a{a} += fr/{masses[a]!r}")
    at_rest = f"(a{b}{'' if a == BASE else f' - a{a}'})/{ease!r}"
    speed = f"v{b}{'' if a == BASE else f' - v{a}'}"
    return {"most": most, "hold": at_rest, "apply": apply, "speed": speed}


# Dormand & Prince (1980), RK5(4)7M.
_TABLE = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_NODES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


def _step(names: list[str]) -> list[str]:
    """Source of one step: new state, its rates, estimate of the error of each state."""
    size = range(len(names))
    lines = [f"def step(t, h, mode, k0, {', '.join(names)}):"]
    lines.append(f"    {', '.join(f'k0_{i}' for i in size)}, = k0")
    for stage, (row, node) in enumerate(zip(_TABLE, _NODES, strict=True), start=1):
        for i in size:
            slopes = " + ".join(f"{b!r}*k{j}_{i}" for j, b in enumerate(row) if b)
            lines.append(f"    y{i} = {names[i]} + h*({slopes})")
        lines.append(f"    k = rates(t + {node!r}*h, mode, {', '.join(f'y{i}' for i in size)})")
        lines.append(f"    {', '.join(f'k{stage}_{i}' for i in size)}, = k")
    errors = [
        "h*(" + " + ".join(f"{b!r}*k{j}_{i}" for j, b in enumerate(_ERROR) if b) + ")"
        for i in size
    ]
    new = ", ".join(f"y{i}" for i in size)
    return [*lines, f"    return ({new},), k, ({', '.join(errors)},)"]
