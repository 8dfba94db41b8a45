"""Rights of all certificate holders → the access control of a Zenoh router.

Zenoh allows a message where the key expression of a rule includes the message's own, so that
a question about `*` is refused to who may only ask about one asset. What no rule allows is
denied, and so is who holds a certificate of the site that is not on the list.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from slowtime_schemas.streams import current_key

from .roles import Role, rights


class CertificateHolder(Protocol):
    """Holder of a certificate."""

    @property
    def role(self) -> str:
        """Role of the holder, one of `ROLES`."""
        ...

    @property
    def site(self) -> str:
        """The site."""
        ...

    @property
    def asset(self) -> str | None:
        """The asset, of an edge."""
        ...

    @property
    def name(self) -> str:
        """Common name of the certificate."""
        ...


def access_control(holders: Iterable[CertificateHolder]) -> dict[str, Any]:
    """Value of Zenoh's `access_control` for a router that serves only `holders`."""
    grouped: dict[tuple[str, str, str | None], list[str]] = {}
    for holder in holders:
        who = (holder.role, holder.site, holder.asset)
        grouped.setdefault(who, []).append(holder.name)
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for (role, site, asset), names in sorted(grouped.items(), key=str):
        label = ":".join(part for part in (role, site, asset) if part)
        own = _ROUTERS if role == "router" else _rules(label, rights(role, site, asset))
        rules += own
        subjects.append({"id": label, "cert_common_names": sorted(names)})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [label]})
    if not subjects:  # Zenoh wants all three lists, or none
        return {"enabled": True, "default_permission": "deny"}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def in_both_versions(access: Mapping[str, Any]) -> dict[str, Any]:
    """Add present keys to access control that was written with former ones alone.

    Else agents of today would be denied by a router whose credentials are older than its
    software.
    """
    rules = [
        rule | {"key_exprs": list(dict.fromkeys([*keys, *map(current_key, keys)]))}
        for rule in access.get("rules", ())
        for keys in [rule["key_exprs"]]
    ]
    return {**access, "rules": rules} if rules else dict(access)


_ROUTERS: list[dict[str, Any]] = [
    {
        "id": "router all",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": [
            "put",
            "delete",
            "declare_subscriber",
            "declare_queryable",
            "query",
            "reply",
            "liveliness_token",
            "liveliness_query",
            "declare_liveliness_subscriber",
        ],
        "key_exprs": ["**"],
    }
]
"""What routers may say to each other: all that passes through them."""


def _rules(label: str, role: Role) -> list[dict[str, Any]]:
    """Rules of one role, seen from the router: ingress is the traffic of its holder."""
    told: list[tuple[str, str, str, Sequence[str]]] = [
        ("writes", "ingress", "put", role.writes),
        ("hears", "egress", "put", role.hears),
        ("subscribes", "ingress", "declare_subscriber", role.subscribes),
        ("answers", "ingress", "declare_queryable", role.answers),
        ("asked", "egress", "query", role.answers),
        ("replies", "ingress", "reply", role.replies),
        ("asks", "ingress", "query", role.asks),
        ("answered", "egress", "reply", (*role.hears, *role.asks) if role.asks else ()),
        ("announces", "ingress", "liveliness_token", role.announces),
        ("watches", "ingress", "declare_liveliness_subscriber", role.watches),
        ("sees", "egress", "liveliness_token", role.watches),
    ]
    return [
        {
            "id": f"{label} {what}",
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": list(keys),
        }
        for what, flow, message, keys in told
        if keys
    ]
