"""Other tools, run on the same cases by the same words as `slowtime diagnose`."""

from pathlib import Path

from .running import Trial

ROOT = Path(__file__).parents[2]
VENV = ROOT / ".venv-peers"
PEERS = {
    f"pysindy-{method}": ("tests.blind.pysindy_peer", "--method", method)
    for method in ("threshold", "weak", "ensemble", "discrepancy")
}


def peer(name: str, timeout_s: float) -> Trial:
    """Give a peer's command; `make peers` sets it up."""
    python = VENV / "bin" / "python"
    if not python.exists():
        raise SystemExit(f"{python} is not there. Run `make peers` first.")
    module, *flags = PEERS[name]
    return Trial(name, (str(python), "-m", module, *flags), timeout_s)
