"""A process → signs of life, a watcher that ends it without them, notices to systemd."""

from .heartbeat import BEAT_S, Heartbeat, Watch
from .stacks import all_stacks
from .systemd import notify, watchdog_s

__all__ = ["BEAT_S", "Heartbeat", "Watch", "all_stacks", "notify", "watchdog_s"]
